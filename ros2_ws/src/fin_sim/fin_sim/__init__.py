"""The simulated fish: physics of a body with a flexible caudal fin, and the plant node that swims it.

The public face for other packages: `fin_sim.swim` for one swim and the papers' fish, `fin_sim.batch` for many swims at
once. Nothing is imported here: the node starts without the batch's kernels.

The fish:

* `fish`: body, peduncle, motor and water; `presets`: the papers' fish; `fish_shape`: what it looks like;
* `servo`: lag, rate and play between a command and a joint; `motor`: what torque a joint has, and what that costs;
* `materials`: what fins are made of; `strip`: Young's modulus from a strip that a weight bends;
* `water_settings`: which water; `oscillating_drag`: the drag of a tail that beats to and fro.

Its motion:

* `chain`: from fish and fin to a chain of rigid links;
* `dynamics`: the equations of motion; `dense_dynamics`: the same where links move each other's water;
* `time_stepping`: their integration; `compiled`, `compile_all`: how and when kernels are compiled;
* `swim`: one swim; `swim_result`: its figures; `picture`: its pictures; `case`: a swim as a file;
  `source_digest`: what stands for all of this code where results are kept;
* `energy`, `angular_momentum`: balances that prove the equations; `closed_forms`, `rigid_fin`: answers without
  integration; `paper_models`: the two models of the papers.

The node: `simulator`; `pace`: how many samples are due; `stream_messages`, `message_template`: its streams.

The commands: `swim_command/`, `measure_strip`, `materials_command`, `validation/`.

Other ways to swim: `batch/`, many fish at once; `surface_3d/`, `ideal_2d/`: ideal flow in space and in the plane.
"""
