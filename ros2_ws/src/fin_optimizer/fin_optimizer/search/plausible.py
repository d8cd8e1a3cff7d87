"""Fish that a laboratory's might be: the simulator's, with other numbers and another structure, and how they swim.

Widths of the priors are standard deviations of logarithms, wide enough for what a fish of known size and gait may hide:
priors that are too narrow cost more than any choice of the next trial gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from threadpoolctl import threadpool_limits

from fin_plant.gait import Gait
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.result import FIGURES
from fin_sim.batch.task import checked_task
from fin_sim.swim import PAPER_FISH, RAMP_TIME

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_sim.chain import Reactive
    from fin_sim.fish import Fish

    Array = NDArray[np.float64]

WIDTHS = {
    "mass": 0.3,
    "added_sway": 0.3,
    "drag_area": 0.55,
    "lift_area": 0.6,
    "yaw_drag": 0.8,
    "normal_drag": 0.8,
    "damping_time": 1.0,
    "amplitude": 0.11,
}
"""Of factors on the numbers of body and water, the sheets' damping, and the tail's amplitude, where a servo lags."""
STIFFNESS_WIDTH = 0.4
"""Of the factor on the modulus of each material."""
_MATERIALS = 8
"""Moduli that have a factor each; where there are more, all have the same."""
_SPEED = FIGURES.index("mean_forward_speed")
_LARGEST_NORMAL_DRAG = 10.0
_OTHER_KIND = 0.1
_STEP_PARTS = (1, 4, 8)

Kind = tuple[int, Literal["between", "midpoint"], "Reactive"]
KINDS: tuple[Kind, ...] = tuple(
    (segments, hinges, reactive)
    for segments in (3, 8)
    for hinges in cast("tuple[Literal['between', 'midpoint'], ...]", ("between", "midpoint"))
    for reactive in cast("tuple[Reactive, ...]", ("distributed", "tip"))
)
"""Structures of the simulated fin: segments, hinges, form of the water's force; all as likely as each other."""


@dataclass(frozen=True)
class Fins:
    """Fins and their gaits, for many fish to swim with.

    Attributes:
        fins: Nominal, (N,).
        gaits: Commanded, (N,).
        duration: Of the window over which the speed is a mean, s.
        settle: From a start from rest to that window, s.
        fish: The nominal fish.
    """

    fins: tuple[Fin, ...]
    gaits: tuple[Gait, ...]
    duration: float
    settle: float = 0.0
    fish: Fish = PAPER_FISH

    @property
    def materials(self) -> list[int]:
        """Place of each fin's modulus among the different ones, in rising order; 0 where there are many."""
        moduli = sorted({fin.young_modulus for fin in self.fins})
        if len(moduli) > _MATERIALS:
            return [0] * len(self.fins)
        return [moduli.index(fin.young_modulus) for fin in self.fins]

    @property
    def numbers(self) -> int:
        """Numbers that make a fish of these fins."""
        return len(WIDTHS) + max(self.materials) + 1


def drawn(fins: Fins, count: int, random: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Return so many fish of the prior: numbers in standard deviations, (count, numbers), and their kinds, (count,)."""
    kinds = np.arange(count) % len(KINDS)
    return random.standard_normal((count, fins.numbers)), kinds.astype(np.intp)


def speeds(fins: Fins, numbers: Array, kinds: NDArray[np.intp]) -> Array:
    """Return the mean forward speed of each fish with each fin, m/s, (fish, N); NaN where a swim diverged.

    Steps of the batch's default, without its proof by shorter ones: right to 0.1 %.

    Args:
        fins: The fins.
        numbers: As `drawn` returns them.
        kinds: As `drawn` returns them.
    """
    with threadpool_limits(1):
        return np.array([_speeds_of(fins, row, KINDS[kind]) for row, kind in zip(numbers, kinds, strict=True)])


def _speeds_of(fins: Fins, row: Array, kind: Kind) -> Array:
    segments, hinges, reactive = kind
    widths = np.array([*WIDTHS.values(), *[STIFFNESS_WIDTH] * (len(row) - len(WIDTHS))])
    factors = np.exp(widths * row)
    of = dict(zip(WIDTHS, factors.tolist(), strict=False))
    body, water = fins.fish.body, fins.fish.water
    fish = replace(
        fins.fish,
        body=replace(
            body,
            mass=body.mass * of["mass"],
            inertia=body.inertia * of["mass"],
            added_sway=body.added_sway * of["added_sway"],
            drag_area=body.drag_area * of["drag_area"],
            lift_area=body.lift_area * of["lift_area"],
            yaw_drag=body.yaw_drag * of["yaw_drag"],
        ),
        water=replace(water, normal_drag=min(water.normal_drag * of["normal_drag"], _LARGEST_NORMAL_DRAG)),
    )
    stiffness = factors[len(WIDTHS) :]
    built = [
        replace(
            fin,
            segments=segments,
            hinges=hinges,
            young_modulus=float(np.clip(fin.young_modulus * stiffness[place], 1e5, 2.1e11)),
            damping_time=min(fin.damping_time * of["damping_time"], 1.0),
        )
        for fin, place in zip(fins.fins, fins.materials, strict=True)
    ]
    result = np.full(len(built), np.nan)
    for gait in dict.fromkeys(fins.gaits):
        places = [place for place, each in enumerate(fins.gaits) if each == gait]
        rows = gait.rows()
        rows[:, 0] = np.minimum(rows[:, 0] * of["amplitude"], math.pi)
        task = checked_task(
            fish,
            Gait.from_rows(rows),
            fins.settle + fins.duration,
            reactive,
            "free",
            0.0,
            RAMP_TIME,
            fins.settle,
            None,
            "double",
        )
        for parts in _STEP_PARTS:  # a fin that hardly damps diverges in long steps
            left = [place for place in places if np.isnan(result[place])]
            if left:
                columns = fin_columns([built[place] for place in left])
                result[left] = lane_figures(task.refined(parts), columns)[:, _SPEED]
    return result


@lru_cache(maxsize=4)
def prior_cloud(fins: Fins, count: int) -> tuple[Array, NDArray[np.intp], Array]:
    """Return fish of the prior, their kinds and speeds; the same ones for every study of these fins."""
    numbers, kinds = drawn(fins, count, np.random.default_rng(0))
    return numbers, kinds, speeds(fins, numbers, kinds)


def drawn_around(
    numbers: Array, kinds: NDArray[np.intp], weights: Array, count: int, width: float, random: np.random.Generator
) -> tuple[Array, NDArray[np.intp], Array]:
    """Return fish drawn anew around those that scores left likely, with the logarithm of prior over density.

    Args:
        numbers: Of the cloud before, (F, D).
        kinds: (F,).
        weights: (F,).
        count: Of fish.
        width: Of the steps, in standard deviations of the prior.
        random: Draws.
    """
    chosen = random.choice(len(weights), count, p=weights)
    fresh = numbers[chosen] + width * random.standard_normal((count, numbers.shape[1]))
    # As likely to come from any fish of its kind as that fish was to be chosen; a tenth may change its kind.
    new_kinds = np.where(random.random(count) < _OTHER_KIND, random.integers(len(KINDS), size=count), kinds[chosen])
    apart = ((fresh[:, None, :] - numbers[None, :, :]) ** 2).sum(axis=2)
    from_kind = np.where(new_kinds[:, None] == kinds[None, :], 1.0 - _OTHER_KIND, 0.0) + _OTHER_KIND / len(KINDS)
    density = -0.5 * apart / width**2 + np.log(weights[None, :] * from_kind + 1e-300)
    peak = density.max(axis=1)
    log_density = peak + np.log(np.exp(density - peak[:, None]).sum(axis=1)) - numbers.shape[1] * math.log(width)
    log_prior = -0.5 * (fresh**2).sum(axis=1) - math.log(len(KINDS))
    return fresh, new_kinds.astype(np.intp), log_prior - log_density
