"""The next fin for a robot, the simulator being what is known before: a cloud of plausible fish, weighed by scores."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from fin_optimizer.search.cloud import Belief, Cloud
from fin_optimizer.search.plausible import Fins, drawn_around, prior_cloud, speeds
from fin_optimizer.search.quasi_random import QuasiRandom
from fin_optimizer.search.space import Evaluation, generator
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Space, Values
    from fin_plant.fin import Fin
    from fin_plant.gait import Gait

    Array = NDArray[np.float64]

MOST_FINS = 240
"""Candidates that are looked at: all that there are, or as many spread over the space."""
FISH = 1500
"""Of the cloud at first."""
FRESH = 150
"""Drawn anew around the likely ones where the cloud has collapsed."""
COLLAPSED = 6.0
"""Effective number of fish below which the cloud is drawn anew."""
STOP = 0.005
"""Expected gain of the best trial, as a share of the best speed, below which another trial is hardly worth it."""
_REDRAWN = 1_000_000  # apart from the numbers of candidates, whose random numbers are others
_STEP = 0.35  # of fish drawn anew, in standard deviations of the prior
# How much a feature's logarithm changes until two fins are no longer alike for what no fish explains.
_LIKE = {"young_modulus": 1.0, "thickness": 0.5, "length": 0.33, "height": 0.5, "tip_height": 0.5}


@dataclass(frozen=True)
class Told:
    """What the search is sure of.

    Attributes:
        best: Candidate that is expected to be fastest.
        speed: Its expected speed, m/s.
        deviation: Standard deviation of that, m/s.
        gain: What the best next trial is expected to add, as a share of that speed.
        effective_fish: How many fish of the cloud still count.
    """

    best: Values
    speed: float
    deviation: float
    gain: float
    effective_fish: float

    @property
    def enough(self) -> bool:
        """Whether another trial is hardly worth it."""
        return self.gain < STOP


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
        fish: Of the cloud.

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
    fish: int = FISH
    _clouds: dict[tuple[Any, ...], tuple[Array, NDArray[np.intp], Array, Array]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
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
        return Fins(tuple(fin for fin, _ in built), tuple(gait for _, gait in built), self.duration, self.settle)

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

    def _cloud(self, speed: Array, importance: Array) -> Cloud:
        return Cloud(speed, importance, self._places, self.noise, self.discrepancy)

    def _after(self, tried: NDArray[np.intp], scores: Array) -> tuple[Array, NDArray[np.intp], Array, Array]:
        """Return numbers, kinds, speeds and importance of the cloud after trials, drawn anew wherever it collapsed."""
        known = list(zip(tried.tolist(), scores.tolist(), strict=True))
        done = next((count for count in range(len(known), 0, -1) if tuple(known[:count]) in self._clouds), 0)
        if done:
            state = self._clouds[tuple(known[:done])]
        else:
            numbers, kinds, speed = prior_cloud(self._fins, self.fish)
            state = numbers, kinds, speed, np.zeros(len(kinds))
        for count in range(done + 1, len(known) + 1):
            belief = self._cloud(state[2], state[3]).belief(tried[:count], scores[:count])
            if belief.effective_size < COLLAPSED:
                random = generator(self.seed, _REDRAWN + count)
                size = min(FRESH, self.fish)
                numbers, kinds, importance = drawn_around(state[0], state[1], belief.weights, size, _STEP, random)
                state = (numbers, kinds, speeds(self._fins, numbers, kinds), importance)
            self._clouds[tuple(known[:count])] = state
        return state

    def _belief(self, history: Sequence[Evaluation]) -> tuple[Cloud, Belief]:
        tried, scores = self._tried(history)
        _, _, speed, importance = self._after(tried, scores)
        cloud = self._cloud(speed, importance)
        return cloud, cloud.belief(tried, scores)

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``: of those that neither failed nor swim just now."""
        with threadpool_limits(1):  # their number decides in which order sums are made, and so the last bits
            cloud, belief = self._belief(history)
            gains = cloud.gains(belief, generator(self.seed, len(history)))
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
            return dict(self.candidates[self._belief(history)[1].best])

    def told(self, history: Sequence[Evaluation]) -> Told:
        """Return what is believed after ``history``, and how sure that is."""
        with threadpool_limits(1):
            cloud, belief = self._belief(history)
            gains = cloud.gains(belief, generator(self.seed, len(history)))
        best = belief.best
        return Told(
            dict(self.candidates[best]),
            float(belief.mean[best]),
            float(belief.deviation[best]),
            float(gains.max()),
            belief.effective_size,
        )
