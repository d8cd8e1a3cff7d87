"""The same swim by the general kernel, by SciPy and by MuJoCo, one core each."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.integrate

from fin_bringup.benchmarks import mujoco_fish
from fin_bringup.benchmarks.measuring import DURATION, MODULI, PAPER, core_time
from fin_plant.gait import PAPER_GAIT
from fin_plant.gait_follower import GaitFollower
from fin_sim import dynamics
from fin_sim.chain import build_chain
from fin_sim.swim import RAMP_TIME, swim

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_bringup.benchmarks.measuring import Sizes

MUJOCO_ERROR = 0.01
"""Largest change of MuJoCo's speed, over the same range, from its finest step to the step that it is timed at."""


def scipy_swim(relative_tolerance: float) -> float:
    """Return the mean speed of the paper fin by `solve_ivp` (LSODA) on the equations of the general kernel, m/s."""
    chain = build_chain(PAPER.fish, PAPER.fin, reactive=PAPER.reactive)
    table, body, links = chain.link_table(), chain.body_vector(), len(chain.links)
    follower = GaitFollower(1, RAMP_TIME)
    follower.command(PAPER_GAIT, 0.0)
    record, scratch = np.zeros(dynamics.RECORD_HEAD + links), np.zeros((links, dynamics.SCRATCH_COLUMNS))
    drive = np.zeros((links, 3))

    def slope(moment: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        drive[0] = follower.motion([moment])[0, 0]
        derivative, current = np.zeros(len(state)), state.copy()
        dynamics.evaluate(current, drive, table, body, True, False, derivative, record, scratch)  # noqa: FBT003
        derivative[dynamics.BODY_STATES + links] = drive[0, 2]
        return derivative

    start = np.zeros(dynamics.BODY_STATES + 2 * links)
    solution = scipy.integrate.solve_ivp(
        slope,
        (0.0, DURATION),
        start,
        method="LSODA",
        max_step=0.1,
        rtol=relative_tolerance,
        atol=1e-3 * relative_tolerance,
    )
    return float(np.hypot(*solution.y[:2, -1]) / DURATION)


def others(sizes: Sizes) -> dict[str, dict[str, float]]:
    """Return core time and error of the same swim by the general kernel, SciPy and MuJoCo, one core each."""
    exact = swim(PAPER.fin, PAPER.fish, duration=DURATION, reactive=PAPER.reactive).mean_speed
    general: dict[str, Any] = {
        "fin": PAPER.fin,
        "fish": PAPER.fish,
        "reactive": PAPER.reactive,
        "duration": DURATION,
        "sample_time": 0.025,
        "step": 0.025,
    }
    rows = {
        "general kernel at 25 ms": {
            "core_ms": core_time(lambda: swim(**general), sizes.repeats) * 1e3,
            "error": abs(swim(**general).mean_speed / exact - 1.0),
        }
    }
    tolerance = 1e-4
    rows["SciPy solve_ivp"] = {
        "core_ms": core_time(lambda: scipy_swim(tolerance), 1) * 1e3,
        "error": abs(scipy_swim(tolerance) / exact - 1.0),
        "relative_tolerance": tolerance,
    }
    fins = [replace(PAPER.fin, young_modulus=e) for e in (MODULI[0], PAPER.fin.young_modulus, MODULI[-1])]
    speeds = {
        step: np.array([mujoco_fish.swim(fin, PAPER.fish, PAPER_GAIT, DURATION, step) for fin in fins])
        for step in sizes.mujoco_steps
    }
    finest = speeds[min(speeds)]
    errors = {step: float(np.abs(speed / finest - 1.0).max()) for step, speed in speeds.items()}
    good = [step for step in errors if errors[step] <= MUJOCO_ERROR and step > min(speeds)]
    step = max(good, default=min(speeds))
    taken = core_time(lambda: mujoco_fish.swim(PAPER.fin, PAPER.fish, PAPER_GAIT, DURATION, step), sizes.repeats)
    row = {"core_ms": taken * 1e3, "error": errors[step], "step_ms": step * 1e3, "speed_cm_s": float(finest[1]) * 100.0}
    rows["MuJoCo rollout"] = row
    return rows
