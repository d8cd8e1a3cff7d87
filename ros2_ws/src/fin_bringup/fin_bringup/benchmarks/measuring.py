"""How much is measured, and how a time is taken."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_sim.batch import swim_batch
from fin_sim.presets import preset

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


def batch(count: int, **options: Any) -> Callable[[], object]:
    """Return the work of swimming so many paper fins on one core, or as many as ``threads`` says."""
    moduli = np.linspace(MODULI[0], MODULI[-1], count)
    columns = {**vars(PAPER.fin), "young_modulus": moduli, **options.pop("columns", {})}
    arguments = {"reactive": PAPER.reactive, "threads": 1, **options}
    return lambda: swim_batch(columns, PAPER.fish, **arguments)
