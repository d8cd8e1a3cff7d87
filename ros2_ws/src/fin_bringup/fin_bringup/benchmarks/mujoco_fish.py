"""The paper's fish in MuJoCo, to be compared with: its ellipsoid fluid model, the body free in the plane, three hinges.

MuJoCo's water (drag, lift and virtual mass of ellipsoids) is another model than Lighthill's, so its speed differs; what
is compared is the cost of a swim of the same chain. Its own error is that against its own finest step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_plant.gait_follower import GaitFollower
from fin_plant.start import interrupt_held_back
from fin_sim.chain import fin_links
from fin_sim.swim import RAMP_TIME, SIMULATOR_PARAMETERS

if TYPE_CHECKING:
    from fin_plant.fin import Fin
    from fin_plant.gait import Gait
    from fin_sim.fish import Fish

_SERVO_STIFFNESS = 5.0
"""N m/rad: holds the drive's angle to 0.1 %, far stiffer than any hinge of the fin."""
_SERVO_DAMPING = 0.05


def require() -> Any:
    """Return the module `mujoco`.

    Raises:
        ValueError: It is not installed.
    """
    try:
        with interrupt_held_back():  # one that comes while it loads can be an ImportError
            import mujoco  # noqa: PLC0415  (needed for the comparison only)
            import mujoco.rollout  # noqa: PLC0415
    except ImportError:
        msg = "the comparison needs MuJoCo: pip install -r requirements/bench.txt, or use `make bench`"
        raise ValueError(msg) from None
    return mujoco


def description(fin: Fin, fish: Fish, step: float) -> str:
    """Return the fish as MuJoCo's XML."""
    defaults = SIMULATOR_PARAMETERS.checked({})
    length, width, height = (0.5 * float(str(defaults[f"body.{axis}"])) for axis in ("length", "width", "height"))
    links, _ = fin_links(fin)
    tail, close = "", ""
    position = -fish.body.tail_offset
    for index, link in enumerate(links):
        spring = f'stiffness="{link.stiffness!r}" damping="{link.damping!r}"' if index else ""
        size = f"{0.5 * link.length!r} {0.5 * fin.thickness!r} {0.5 * link.root_height!r}"
        mass = link.mass_per_area * link.root_height * link.length
        tail += (
            f'<body pos="{position!r} 0 0"><joint name="j{index}" type="hinge" axis="0 0 1" {spring}/>'
            f'<geom type="box" size="{size}" pos="{-0.5 * link.length!r} 0 0" mass="{mass!r}"/>'
        )
        close += "</body>"
        position = -link.length
    return f"""
<mujoco>
  <option timestep="{step!r}" integrator="implicitfast" density="{fish.water.density!r}" gravity="0 0 0"/>
  <default><geom fluidshape="ellipsoid" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body>
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>
      <geom type="ellipsoid" size="{length!r} {width!r} {height!r}" mass="{fish.body.mass!r}"/>
      {tail}{close}
    </body>
  </worldbody>
  <actuator><position joint="j0" kp="{_SERVO_STIFFNESS}" kv="{_SERVO_DAMPING}"/></actuator>
</mujoco>"""


def swim(fin: Fin, fish: Fish, gait: Gait, duration: float, step: float) -> float:
    """Return the mean speed in m/s over a swim from rest, by MuJoCo's rollout on one core."""
    mujoco = require()
    model = mujoco.MjModel.from_xml_string(description(fin, fish, step))
    data = mujoco.MjData(model)
    steps = round(duration / step)
    follower = GaitFollower(1, RAMP_TIME)
    follower.command(gait, 0.0)
    control = follower.motion(np.linspace(0.0, duration - step, steps))[:, 0, :1][None]
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    states, _ = mujoco.rollout.rollout(model, data, start[None], control)
    return math.hypot(*states[0, -1, 1:3]) / duration
