"""How much is measured, and how a time is taken."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_plant.gait import PAPER_GAIT
from fin_sim.batch import swim_batch
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.task import checked_task
from fin_sim.presets import preset
from fin_sim.swim import RAMP_TIME

if TYPE_CHECKING:
    from collections.abc import Callable

PAPER = preset("three_segments")
"""Fin and fish that are swum where nothing else is said."""
DURATION = 10.0
"""Of a swim, in s."""
MODULI = np.linspace(0.5e9, 4e9, 15)
"""Stiffnesses over which the accuracy is stated, Pa: the paper's range."""
MANY = 4096
"""Swims of which one is timed: enough that the set-up of a batch does not count."""


@dataclass(frozen=True)
class Sizes:
    """How much is measured."""

    repeats: int
    swims: tuple[int, ...]
    segments: tuple[int, ...]
    mujoco_steps: tuple[float, ...]
    trials: int


def core_time(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of this thread in s that ``work`` took, after a first time that may compile."""
    work()
    taken = []
    for _ in range(repeats):
        begun = time.thread_time()
        work()
        taken.append(time.thread_time() - begun)
    return min(taken)


def wall_time(work: Callable[[], object], repeats: int) -> float:
    """Return the least time in s that ``work`` took, after a first time that may compile."""
    work()
    taken = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begun)
    return min(taken)


def _columns(count: int, changes: dict[str, Any]) -> dict[str, Any]:
    return {**vars(PAPER.fin), "young_modulus": np.linspace(MODULI[0], MODULI[-1], count), **changes}


def batch(count: int, **options: Any) -> Callable[[], object]:
    """Return the work of swimming so many paper fins on one core, or as many as ``threads`` says."""
    columns = _columns(count, options.pop("columns", {}))
    arguments = {"reactive": PAPER.reactive, "threads": 1, **options}
    return lambda: swim_batch(columns, PAPER.fish, **arguments)


def lanes(count: int, changes: dict[str, Any]) -> Callable[[], object]:
    """Return the work of swimming so many fins once at the default step, whatever that is worth."""
    task = checked_task(PAPER.fish, PAPER_GAIT, DURATION, PAPER.reactive, "free", 0.0, RAMP_TIME, 0.0, None, "double")
    columns = fin_columns(_columns(count, changes))
    return lambda: lane_figures(task, columns)
