"""What all fins of a batch share: the fish, its gait and the time steps, checked once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from fin_plant import checks
from fin_plant.gait import COLUMNS, Gait
from fin_sim.batch.columns import GAITS
from fin_sim.batch.step import LANES
from fin_sim.batch.window import whole_beats
from fin_sim.chain import CLAMPS, Clamp, Reactive, convective_form
from fin_sim.ideal_2d.plane_fish import refuse_fish

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_sim.fish import Fish
    from fin_sim.water_settings import Wake

Precision = Literal["double", "single"]


STEPS_A_BEAT = 56.0
LONGEST_STEP = 0.02
"""Default step in s for slow gaits: the mean speeds of fins like the default one are then within 0.1 % of the
converged ones."""
RAMP_STEPS, MOST_STEPS_A_BEAT = 16.0, 224.0
"""Least steps in the gait's ramp, as far as that takes no more than so many a beat."""
LEAST_STEPS = 4
_PARTS: dict[Wake, int] = {"lighthill": 1, "none": 4}
"""Into how many parts a step is divided: without a wake the speed is what forces leave that nearly cancel."""


@dataclass(frozen=True)
class Task:
    """What all fins of a batch share; the gait is None where each has its own, in a column."""

    fish: Fish
    gait: Gait | None
    duration: float
    steps: int
    settle: float
    reactive: Reactive
    clamp: Clamp
    tow_speed: float
    ramp_time: float
    precision: Precision
    whole_beats: bool = False

    @property
    def step(self) -> float:
        """Time step, s."""
        return self.duration / self.steps

    @property
    def body_speed(self) -> float:
        """Speed that a held or towed body keeps, m/s."""
        return self.tow_speed if self.clamp == "towed" else 0.0

    def gaits(self, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
        """Return the fins' gaits as `Gait.rows`, shape (n, joints, 4), or (1, joints, 4) where they share one."""
        return fins[GAITS].astype(float) if self.gait is None else self.gait.rows()[None]

    def begins(self, gaits: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where each gait's window begins, s, shape (n,)."""
        if not self.whole_beats:
            return np.full(len(gaits), self.settle)
        return whole_beats(self.duration, self.settle, fastest_joints(gaits))

    def begin(self, gait: Gait) -> float:
        """Return where the window of one gait begins, s."""
        return float(self.begins(gait.rows()[None])[0])

    def refined(self, factor: int) -> Task:
        """Return the same swim at a step shorter by a factor."""
        return replace(self, steps=self.steps * factor)


def fastest_joints(gaits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the highest frequency of any joint of each gait, Hz, shape (n,)."""
    return np.asarray(gaits[:, :, COLUMNS.index("frequency")].max(axis=1))


def beating(gaits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest product of frequency and amplitude of any joint of each gait, rad/s, shape (n,)."""
    products = gaits[:, :, COLUMNS.index("frequency")] * gaits[:, :, COLUMNS.index("amplitude")]
    return np.asarray(products.max(axis=1))


def first_steps(gaits: NDArray[np.float64], ramp_time: float, wake: Wake = "lighthill") -> NDArray[np.float64]:
    """Return the default step for each gait, s, shape (n,)."""
    fastest = fastest_joints(gaits)
    with np.errstate(divide="ignore"):
        step = np.minimum(LONGEST_STEP, 1.0 / (STEPS_A_BEAT * fastest))
        if ramp_time > 0.0:
            least = np.maximum(ramp_time / RAMP_STEPS, 1.0 / (MOST_STEPS_A_BEAT * fastest))
            step = np.minimum(step, least)
    return np.asarray(step / _PARTS[wake])


def window_step(duration: float, settle: float) -> float:
    """Return the longest step in s for the window over which means are taken, as far as it has any length."""
    window = duration - settle
    return window / LEAST_STEPS if window >= 1e-4 * duration else np.inf


@lru_cache(maxsize=64)
def checked_task(
    fish: Fish,
    gait: Gait | None,
    duration: float,
    reactive: str,
    clamp: str,
    tow_speed: float,
    ramp_time: float,
    settle: float,
    step: float | None,
    precision: str,
    whole_beats: bool = False,
) -> Task:
    """Return what all fins share; see `swim_batch`. Without a gait the step is the longest, whatever the fins' own.

    Raises:
        ValueError: An argument that is refused; the message names it.
    """
    duration = checks.number("duration", duration, 0.0, 1e5, unit="s", exclusive_minimum=True)
    settle = checks.number("settle", settle, 0.0, duration, unit="s")
    if step is None:
        wake = fish.water.wake
        longest = LONGEST_STEP / _PARTS[wake]
        step = longest if gait is None else float(first_steps(gait.rows()[None], ramp_time, wake)[0])
    step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
    step = min(step, window_step(duration, settle))
    if gait is not None and len(gait.joints) != fish.driven_joints:
        msg = f"gait has {len(gait.joints)} rows, the tail has {fish.driven_joints} driven joints: give one row a joint"
        raise ValueError(msg)
    if fish.water.model == "ideal_2d":
        refuse_fish(fish, clamp)
    steps = max(LEAST_STEPS, int(np.ceil(duration / step - 1e-9)))
    return Task(
        fish=fish,
        gait=gait,
        duration=duration,
        steps=steps,
        settle=min(settle, duration - 1e-3 * step),
        reactive=convective_form(reactive, fish.water),
        clamp=cast("Clamp", checks.choice("clamp", clamp, CLAMPS)),
        tow_speed=checks.number("tow_speed", tow_speed, unit="m/s"),
        ramp_time=checks.number("ramp_time", ramp_time, 0.0, unit="s"),
        precision=cast("Precision", checks.choice("precision", precision, tuple(LANES))),
        whole_beats=whole_beats,
    )
