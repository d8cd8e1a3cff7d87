"""Swims of one fin by the general kernel at ever shorter steps, for what does not swim in lanes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_plant.gait import Gait
from fin_sim.batch.columns import fin_at
from fin_sim.batch.result import FIGURES, Status
from fin_sim.batch.task import LEAST_STEPS, fastest_joints, window_step
from fin_sim.batch.tolerances import difference, error_floors, settled
from fin_sim.batch.window import window_weights
from fin_sim.chain import build_chain
from fin_sim.swim import swim_chain
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_sim.batch.task import Task

GENERAL_STEP = 5e-3
GENERAL_STEPS_A_BEAT, GENERAL_RAMP_STEPS = 100.0, 16.0
"""First step of the fish that swim by the general kernel: at most so long in s, in parts of a beat and of the ramp."""
_HALVINGS = 6


def _general_figures(task: Task, gait: Gait, fin: Fin, steps: int) -> NDArray[np.float64]:
    """Return the figures of one fin by the general kernel in so many steps, shape (figures,); NaN if it diverged."""
    step = task.duration / steps
    chain = build_chain(task.fish, fin, reactive=task.reactive, clamp=task.clamp, tow_speed=task.tow_speed)
    try:
        swum = swim_chain(chain, gait, task.duration, ramp_time=task.ramp_time, step=step, sample_time=step)
    except StepError:
        return np.full(len(FIGURES), np.nan)
    samples = len(swum.time)
    weights = window_weights(samples, task.begin(gait) / task.duration * (samples - 1))
    forward = np.stack((np.cos(swum.heading), np.sin(swum.heading)), axis=1)
    has_motor = chain.motor is not None
    driven = swum.joint_torques[swum.time >= task.ramp_time][:, np.array(chain.driven)]
    figures = {
        "mean_speed": swum.mean_speed,
        "mean_forward_speed": weights @ swum.surge,
        "thrust": weights @ np.sum(swum.convective_force * forward, axis=1),
        "servo_power": weights @ swum.servo_power,
        "electrical_power": weights @ swum.electrical_power,
        "servo_torque": np.abs(driven).max(initial=0.0) if has_motor else 0.0,
        "x": swum.x[-1],
        "y": swum.y[-1],
        "heading": swum.heading[-1],
        "largest_hinge_angle": swum.largest_hinge_angle,
    }
    return np.array([figures[name] for name in FIGURES])


def swim_by_general_kernel(
    task: Task, fins: Mapping[str, NDArray[np.generic]]
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Return the figures of one fin by the general kernel, shape (1, figures), and its status, shape (1,)."""
    fin, floors, gaits = fin_at(fins, 0), error_floors(task, fins), task.gaits(fins)
    gait = Gait.from_rows(gaits[0])
    step = min(GENERAL_STEP, task.step)
    if task.fish.motor:
        step = min(step, task.fish.motor.longest_step)
    fastest = float(fastest_joints(gaits)[0])
    if fastest > 0.0:
        step = min(step, 1.0 / (GENERAL_STEPS_A_BEAT * fastest))
        if task.ramp_time > 0.0:
            step = min(step, max(task.ramp_time / GENERAL_RAMP_STEPS, 0.1 * step))
    step = min(step, window_step(task.duration, task.settle))
    steps = max(LEAST_STEPS, int(np.ceil(task.duration / step)))
    coarse, before = _general_figures(task, gait, fin, steps)[None], np.array([np.inf])
    for halving in range(1, _HALVINGS + 1):
        fine = _general_figures(task, gait, fin, steps * 2**halving)[None]
        last = difference(coarse, fine, floors)
        if settled(last, before)[0]:
            return fine, np.array([Status.OK], dtype=np.int8)
        coarse, before = fine, last
    status = Status.NOT_CONVERGED if np.isfinite(coarse).all() else Status.DIVERGED
    return coarse, np.array([status], dtype=np.int8)
