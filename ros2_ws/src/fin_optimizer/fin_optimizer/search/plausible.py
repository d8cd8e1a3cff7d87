"""Fish that a laboratory's might be: the simulator's, with other numbers and another structure, and how they swim.

Widths of the priors are standard deviations of logarithms, wide enough for what a fish of known size and gait may hide:
priors that are too narrow cost more than any choice of the next trial gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from threadpoolctl import threadpool_limits

from fin_optimizer.search.kept_speeds import content_key, keep, kept
from fin_plant.gait import Gait
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.result import FIGURES
from fin_sim.batch.task import checked_task
from fin_sim.swim import LARGEST_NORMAL_DRAG, PAPER_FISH, RAMP_TIME

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_sim.chain import Reactive
    from fin_sim.fish import Fish as SimulatedFish

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
    "servo_lag": 0.7,
}
"""Of factors on the numbers of body and water, the sheets' damping, the tail's amplitude and the servo's lag."""
SERVO_LAG = 0.03
"""s, of a servo of first order, the middle one: it takes amplitude from fast beats."""
STIFFNESS_WIDTH = 0.4
"""Of the factor on the modulus of each material."""
_MATERIALS = 8
"""Moduli that have a factor each; where there are more, all have the same."""
_SPEED = FIGURES.index("mean_forward_speed")
STEP = 0.35
"""Of fish drawn anew, in standard deviations of the prior."""
_OTHER_KIND = 0.1
_LEAST_CENTRE = 1e-4
_BLOCK = 5000
"""Fish with random numbers of their own, so that a larger cloud begins with the fish of a smaller one."""
_STEP_PARTS = (1, 4, 8)
_LENGTHS_A_BEAT = 10.0
"""Fin lengths a beat that no fish swims: a swim whose steps were too long, though its numbers are still finite."""

Kind = tuple[int, Literal["between", "midpoint"], "Reactive"]
KINDS: tuple[Kind, ...] = tuple(
    (segments, hinges, reactive)
    for segments in (3, 8)
    for hinges in cast("tuple[Literal['between', 'midpoint'], ...]", ("between", "midpoint"))
    for reactive in cast("tuple[Reactive, ...]", ("distributed", "tip"))
)
"""Structures of the simulated fin: segments, hinges, form of the water's force; all as likely as each other."""


@dataclass(frozen=True)
class Prior:
    """What is believed of the fish besides the nominal one.

    Attributes:
        widths: In the order of `WIDTHS`.
        stiffness_width: Of the factor on the modulus of each material.
        amplitude: True over commanded amplitude, the middle one.
        stiffness: True over nominal modulus, the middle one.
        servo_lag: s, the middle one.
    """

    widths: tuple[float, ...] = tuple(WIDTHS.values())
    stiffness_width: float = STIFFNESS_WIDTH
    amplitude: float = 1.0
    stiffness: float = 1.0
    servo_lag: float = SERVO_LAG


@dataclass(frozen=True)
class Fins:
    """Fins and their gaits, for many fish to swim with.

    Attributes:
        fins: Nominal, (N,).
        gaits: Commanded, (N,).
        duration: Of the window over which the speed is a mean, s.
        settle: From a start from rest to that window, s.
        fish: The nominal fish.
        prior: How far it may be off.
    """

    fins: tuple[Fin, ...]
    gaits: tuple[Gait, ...]
    duration: float
    settle: float = 0.0
    fish: SimulatedFish = PAPER_FISH
    prior: Prior = Prior()

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
    result = np.empty((len(kinds), len(fins.fins)))
    with threadpool_limits(1), np.errstate(invalid="ignore", over="ignore"):  # of swims that diverge
        for fish, (row, kind) in enumerate(zip(numbers, kinds, strict=True)):
            result[fish] = _speeds_of(fins, row, KINDS[kind])
    return result


@dataclass
class Fish:
    """Fish of a cloud, that swim slice by slice: thousands take a minute or two.

    Attributes:
        numbers: As `drawn` returns them, (F, D).
        kinds: (F,).
        importance: Logarithm of each fish's prior over the density that it was drawn from, (F,).
        speeds: Of those that have swum, m/s, (F, N).
        swum: How many have.
        kept: Where speeds are kept once all have swum; nowhere if None.
    """

    numbers: Array
    kinds: NDArray[np.intp]
    importance: Array
    speeds: Array
    swum: int = 0
    kept: Path | None = None

    @classmethod
    def of(cls, fins: Fins, numbers: Array, kinds: NDArray[np.intp]) -> Fish:
        """Return fish of the prior that have not swum."""
        return cls(numbers, kinds, np.zeros(len(kinds)), np.empty((len(kinds), len(fins.fins))))

    @property
    def left(self) -> int:
        """How many have not swum."""
        return len(self.kinds) - self.swum

    def swim(self, fins: Fins, most: int) -> int:
        """Let so many more swim, or as many as are left; return how many that were."""
        these = slice(self.swum, min(self.swum + most, len(self.kinds)))
        self.speeds[these] = speeds(fins, self.numbers[these], self.kinds[these])
        self.swum = these.stop
        if not self.left and self.kept is not None:
            keep(self.kept, self.speeds)
        return these.stop - these.start


def _speeds_of(fins: Fins, row: Array, kind: Kind) -> Array:
    segments, hinges, reactive = kind
    prior = fins.prior
    widths = np.array([*prior.widths, *[prior.stiffness_width] * (len(row) - len(WIDTHS))])
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
        water=replace(water, normal_drag=min(water.normal_drag * of["normal_drag"], LARGEST_NORMAL_DRAG)),
    )
    stiffness = prior.stiffness * factors[len(WIDTHS) :]
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
        lagging = np.hypot(1.0, 2.0 * math.pi * rows[:, 1] * prior.servo_lag * of["servo_lag"])
        rows[:, 0] = np.minimum(rows[:, 0] * prior.amplitude * of["amplitude"] / lagging, math.pi)
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
                swum = lane_figures(task.refined(parts), columns)[:, _SPEED]
                reach = rows[-1, 1] * np.array([built[place].length for place in left])
                result[left] = np.where(np.abs(swum) < _LENGTHS_A_BEAT * reach, swum, np.nan)
    return result


def prior_cloud(fins: Fins, count: int, folder: Path | None = None) -> Fish:
    """Return fish of the prior, the same ones for every study of these fins; those of ``folder`` have swum.

    Args:
        fins: The fins.
        count: Of fish.
        folder: Where speeds are kept, by all that they follow from; nowhere if None.
    """
    blocks = [
        drawn(fins, min(_BLOCK, count - first), np.random.default_rng(block))
        for block, first in enumerate(range(0, count, _BLOCK))
    ]
    numbers, kinds = (np.concatenate(each) for each in zip(*blocks, strict=True))
    fish = Fish.of(fins, numbers, kinds)
    if folder is not None:
        fish.kept = folder / f"{content_key(fins, numbers, kinds)}.npy"
        known = kept(fish.kept, fish.speeds.shape)
        if known is not None:
            fish.speeds, fish.swum = known, count
    return fish


def drawn_around(
    numbers: Array, kinds: NDArray[np.intp], weights: Array, count: int, random: np.random.Generator
) -> tuple[Array, NDArray[np.intp]]:
    """Return numbers and kinds of fish drawn anew around those that scores left likely.

    Args:
        numbers: Of the cloud before, (F, D).
        kinds: (F,).
        weights: (F,).
        count: Of fish.
        random: Draws.
    """
    chosen = random.choice(len(weights), count, p=weights)
    fresh = numbers[chosen] + STEP * random.standard_normal((count, numbers.shape[1]))
    new_kinds = np.where(random.random(count) < _OTHER_KIND, random.integers(len(KINDS), size=count), kinds[chosen])
    return fresh, new_kinds.astype(np.intp)


def with_fresh(prior: Fish, fins: Fins, around: Fish, weights: Array, fresh: tuple[Array, NDArray[np.intp]]) -> Fish:
    """Return the fish of the prior, which have swum, with others drawn around likely ones, which have not.

    Every fish counts by the prior over the density of both draws together, so that the two stand for the same belief
    as the prior's alone (Veach & Guibas, SIGGRAPH 1995: the balance heuristic).

    Args:
        prior: Fish of the prior.
        fins: The fins.
        around: Those that the fresh ones were drawn around.
        weights: Of them.
        fresh: As `drawn_around` returns them, with `STEP`.
    """
    result = Fish.of(fins, *(np.concatenate(pair) for pair in zip((prior.numbers, prior.kinds), fresh, strict=True)))
    result.speeds[: len(prior.kinds)], result.swum = prior.speeds, len(prior.kinds)
    near = np.flatnonzero(weights > _LEAST_CENTRE * weights.max())
    centres, own, share = around.numbers[near], around.kinds[near], weights[near] / weights[near].sum()
    # As likely to come from any fish of its kind as that fish was to be chosen; a tenth may change its kind.
    apart = (result.numbers**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * result.numbers @ centres.T
    from_kind = np.where(result.kinds[:, None] == own, 1.0 - _OTHER_KIND, 0.0) + _OTHER_KIND / len(KINDS)
    density = -0.5 * apart / STEP**2 + np.log(share * from_kind)
    peak = density.max(axis=1)
    log_density = peak + np.log(np.exp(density - peak[:, None]).sum(axis=1)) - centres.shape[1] * math.log(STEP)
    log_prior = -0.5 * (result.numbers**2).sum(axis=1) - math.log(len(KINDS))
    drawn_shares = np.array([len(prior.kinds), len(fresh[1])]) / len(result.kinds)
    result.importance = -np.logaddexp(np.log(drawn_shares[0]), np.log(drawn_shares[1]) + log_density - log_prior)
    return result
