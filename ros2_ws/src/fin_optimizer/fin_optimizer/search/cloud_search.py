"""The next fin for a robot, the simulator being what is known before: a cloud of plausible fish, weighed by scores."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from fin_optimizer.search.cloud import Belief, Cloud, regret
from fin_optimizer.search.plausible import Fins, Fish, drawn_around, prior_cloud, with_fresh
from fin_optimizer.search.quasi_random import QuasiRandom
from fin_optimizer.search.space import Evaluation, generator
from fin_optimizer.search.told import Told
from fin_plant import checks
from fin_plant.private_folder import private_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Space, Values
    from fin_plant.fin import Fin
    from fin_plant.gait import Gait

    Array = NDArray[np.float64]

MOST_FINS = 240
"""Candidates that are looked at: all that there are, or as many spread over the space."""
FISH = 10_000
"""Of the cloud at first, where that is no more than `MOST_SWIMS`."""
MOST_SWIMS = 600_000
"""Of the cloud at first: some minutes of one processor, once for a stock."""
LEAST_FISH = 1500
SLICE = 16
"""Fish that swim at a time while something else waits: some tenths of a second."""
FRESH = 150
"""Drawn anew around the likely ones where the cloud has collapsed."""
COLLAPSED = 1.05
"""Effective number of fish below which others are drawn around the likely ones."""
_REDRAWN, _JUDGED = 1_000_000, 2_000_000  # apart from the numbers of candidates, whose random numbers are others
# How much a feature's logarithm changes until two fins are no longer alike for what no fish explains.
_LIKE = {"young_modulus": 1.0, "thickness": 0.5, "length": 0.33, "height": 0.5, "tip_height": 0.5}


@dataclass(frozen=True)
class _Believed:
    """What is believed after some scores, and what was drawn from it, by the number of trials: drawn once.

    Attributes:
        cloud: The fish.
        belief: What they make believe.
        gains: Of a trial of each fin, (N,).
        told: What is said of the best fin.
    """

    cloud: Cloud
    belief: Belief
    gains: dict[int, Array] = field(default_factory=dict)
    told: dict[int, Told] = field(default_factory=dict)


def kept_clouds() -> Path:
    """Return the user's folder in which the speeds of simulated clouds are kept, for all studies."""
    return private_folder("fin_clouds")


@dataclass(frozen=True)
class CloudSearch:
    """Proposes the trial after which the best fin is expected to be best.

    Attributes:
        space: Where to search.
        seed: Of all its random numbers, 0 or more.
        swum: Returns the fin and the gait that a candidate stands for.
        duration: Of the window of a score, s.
        settle: From a start from rest to it, s.
        noise: Of one trial, as a share of the speed.
        discrepancy: Of a real fish from the best of the cloud, as a share of the speed.
        fish: Of the cloud at first; 0 takes `FISH`, or as many as `MOST_SWIMS` allows.
        around: The nominal fish and the prior, as `Fins` names them; the simulator's default if None.
        kept: Folder where the cloud's speeds are kept; nowhere if None.

    Raises:
        ValueError: A seed, noise or number that cannot be.
    """

    space: Space
    seed: int
    swum: Callable[[Values], tuple[Fin, Gait]]
    duration: float = 10.0
    settle: float = 0.0
    noise: float = 0.05
    discrepancy: float = 0.03
    fish: int = 0
    kept: Path | None = None
    around: Mapping[str, Any] | None = None
    _clouds: dict[tuple[Any, ...], Fish] = field(default_factory=dict, repr=False, compare=False)
    _last: dict[tuple[Any, ...], _Believed] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
        if self.fish:
            checks.whole_number("fish of the cloud", self.fish, 8, 1_000_000)
        checks.number("noise of a trial", self.noise, 0.0, 1.0, exclusive_minimum=True)
        checks.number("discrepancy", self.discrepancy, 0.0, 1.0)

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: what still swims is left out of what is known."""
        return 0

    @cached_property
    def candidates(self) -> tuple[Values, ...]:
        """The candidates that are looked at, the same ones for every seed."""
        counts = [dimension.count for dimension in self.space.dimensions]
        if all(counts) and float(np.prod([float(count or 0) for count in counts])) <= 20.0 * MOST_FINS:
            rows = np.array(list(product(*(self._numbers(place) for place in range(len(counts))))))
            allowed = np.delete(rows, self.space.refused(rows), axis=0)
            if 0 < len(allowed) <= MOST_FINS:
                return tuple(self.space.values(row) for row in allowed.tolist())
        spread, found = QuasiRandom(self.space, 0), list[Evaluation]()
        while len(found) < MOST_FINS:
            found.append(Evaluation(spread.propose(found), None, pending=True))
        return tuple({tuple(self.space.row(entry.values)): dict(entry.values) for entry in found}.values())

    def _numbers(self, place: int) -> list[float]:
        """Return every number that a parameter with a limited number of values takes."""
        dimension = self.space.dimensions[place]
        everywhere = np.linspace(dimension.low, dimension.high, 16 * (dimension.count or 0) + 1)
        return sorted(set(np.asarray(dimension.numbers(everywhere)).tolist()))

    @cached_property
    def _fins(self) -> Fins:
        built = [self.swum(values) for values in self.candidates]
        if joints := {len(gait.joints) for _, gait in built} - {1}:
            msg = f"search.algorithm = cloud knows tails of one driven joint, this one has {max(joints)}: use gp"
            raise ValueError(msg)
        fins, gaits = tuple(fin for fin, _ in built), tuple(gait for _, gait in built)
        return Fins(fins, gaits, self.duration, self.settle, **(self.around or {}))

    @cached_property
    def _places(self) -> Array:
        columns = [
            np.log(np.maximum([getattr(fin, name) for fin in self._fins.fins], 1e-9)) / like
            for name, like in _LIKE.items()
        ]
        columns += [np.array([gait.joints[-1].frequency for gait in self._fins.gaits])]
        return np.stack(columns, axis=1)

    def _tried(self, history: Sequence[Evaluation]) -> tuple[NDArray[np.intp], Array]:
        number = {tuple(self.space.row(values)): place for place, values in enumerate(self.candidates)}
        known = [(number.get(tuple(self.space.row(entry.values))), entry.score) for entry in history]
        both = [(place, score) for place, score in known if place is not None and score is not None]
        return np.array([place for place, _ in both], dtype=np.intp), np.array([score for _, score in both])

    @property
    def _first(self) -> int:
        """Fish of the cloud at first."""
        return self.fish or min(FISH, max(LEAST_FISH, MOST_SWIMS // len(self.candidates)))

    def _cloud(self, fish: Fish) -> Cloud:
        return Cloud(fish.speeds, fish.importance, self._places, self.noise, self.discrepancy)

    def _after(self, tried: NDArray[np.intp], scores: Array, left: float = math.inf) -> Fish:
        """Return the cloud after trials, drawn anew wherever it collapsed; fish are left once so many have swum."""
        known = list(zip(tried.tolist(), scores.tolist(), strict=True))
        done = next((count for count in range(len(known), -1, -1) if tuple(known[:count]) in self._clouds), -1)
        if done < 0:
            done, self._clouds[()] = 0, prior_cloud(self._fins, self._first, self.kept)
        fish = self._clouds[tuple(known[:done])]
        for count in range(done, len(known) + 1):
            if count > done:
                belief = self._cloud(fish).belief(tried[:count], scores[:count])
                if belief.effective_size < COLLAPSED:
                    random = generator(self.seed, _REDRAWN + count)
                    size = min(FRESH, self._first)
                    weights = self._cloud(fish).neighbours(tried[:count], scores[:count])
                    fresh = drawn_around(fish.numbers, fish.kinds, weights, size, random)
                    fish = with_fresh(self._clouds[()], self._fins, fish, weights, fresh)
                self._clouds[tuple(known[:count])] = fish
            while fish.left:
                if left <= 0:
                    return fish
                left -= fish.swim(self._fins, SLICE)
        return fish

    def prepare(self, history: Sequence[Evaluation]) -> float:
        """Do a slice of the work that `propose` waits for; return how much of the cloud has swum, 1 when all has.

        Who has nothing else to do need not call it.
        """
        tried, scores = self._tried(history)
        with threadpool_limits(1):
            fish = self._after(tried, scores, SLICE)
        return fish.swum / len(fish.kinds)

    def _believed(self, history: Sequence[Evaluation]) -> _Believed:
        tried, scores = self._tried(history)
        key = (*tried.tolist(), *scores.tolist())
        if key not in self._last:
            cloud = self._cloud(self._after(tried, scores))
            self._last.clear()
            self._last[key] = _Believed(cloud, cloud.belief(tried, scores))
        return self._last[key]

    def _gains(self, history: Sequence[Evaluation]) -> tuple[Belief, Array]:
        """Return what is believed after ``history``, and what a trial of each fin is expected to gain, (N,)."""
        known, number = self._believed(history), len(history)
        if number not in known.gains:
            known.gains[number] = known.cloud.gains(known.belief, generator(self.seed, number))
        return known.belief, known.gains[number]

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``: of those that neither failed nor swim just now."""
        with threadpool_limits(1):  # their number decides in which order sums are made, and so the last bits
            belief, gains = self._gains(history)
        closed = {tuple(self.space.row(entry.values)) for entry in history if entry.score is None}
        is_open = np.array([tuple(self.space.row(values)) not in closed for values in self.candidates])
        if not is_open.any():
            is_open[:] = True
        # Where nothing is expected to be gained any more, the best one is worth a repeat.
        worth = np.where(is_open, gains + 1e-9 * belief.mean / belief.mean.max(), -np.inf)
        return dict(self.candidates[int(np.argmax(worth))])

    def best(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that is expected to be fastest after ``history``, tried or not."""
        with threadpool_limits(1):
            return dict(self.candidates[self._believed(history).belief.best])

    def told(self, history: Sequence[Evaluation]) -> Told:
        """Return what is believed after ``history``, and how sure that is."""
        with threadpool_limits(1):
            known, number = self._believed(history), len(history)
            if number not in known.told:
                known.told[number] = self._judged(history)
        return known.told[number]

    def _judged(self, history: Sequence[Evaluation]) -> Told:
        belief, gains = self._gains(history)
        slower, sure = regret(belief, generator(self.seed, _JUDGED + len(history)))
        best = belief.best
        return Told(
            dict(self.candidates[best]),
            float(belief.mean[best]),
            float(belief.deviation[best]),
            float(gains.max()),
            slower,
            sure,
            belief.effective_size,
        )
