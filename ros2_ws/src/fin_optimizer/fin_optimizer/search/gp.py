"""Bayesian optimisation: a Gaussian process of all scores, and next the candidate that promises most.

Jones, Schonlau & Welch, Efficient Global Optimization of Expensive Black-Box Functions, 1998, with the improvement of
Huang et al. 2006, which knows that a swim repeated gives another score. Several objectives become one score by weights
that are drawn anew for each candidate: ParEGO (Knowles, IEEE Trans. Evolutionary Computation 10, 2006). Each constraint
has a process of its own, and the improvement counts as much as the constraints are likely to be met (Schonlau, Welch &
Jones, Global versus Local Search in Constrained Optimization of Computer Models, 1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize
from threadpoolctl import ThreadpoolController

from fin_optimizer.search.features import Features
from fin_optimizer.search.gaussian_process import (
    GaussianProcess,
    Kernel,
    Likelihood,
    log_improvement,
    log_improvement_with_slope,
    log_met,
    log_met_with_slope,
)
from fin_optimizer.search.quasi_random import QuasiRandom
from fin_optimizer.search.space import generator, pareto_front, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Evaluation, Space, Values

    Array = NDArray[np.float64]

_LEAST = 3
"""Scores without which there is nothing to model."""
_MOST = 400
"""Scores that are modelled: the best half of them and as many of the latest; the time grows with their cube."""
_MOST_FOR_START = 80
"""Scores with which the likelihood is climbed from several starts; with all it is then climbed from the best end."""
_STARTS = 3
_STEPS, _LAST_STEPS = 30, 12
"""Of the climbs on the likelihood, from several starts, and from the best end with all scores."""
_POOL = 1000
"""Candidates drawn from the whole space, of which the most promising are climbed from."""
_NEAR = 200
"""Candidates drawn near the best ones."""
_DISTANCES = (0.1, 0.01)
"""Standard deviations of those, as shares of a range."""
_CLIMBS = 4
"""Candidates that are climbed from."""
_CLIMB_STEPS = 30
_TRIED = 1e30
"""By which the logarithm of what was tried is less: more than any has."""
_SAME = 1e-3
"""Share of a range within which two values of it are the same fin."""
_SUM_SHARE = 0.05
"""Of the weighted sum beside the largest weighted objective (Knowles 2006, eq. 2)."""
_SHARES = (1.0, 0.5, 0.25, 0.125)
"""Of the way to the top of a climb: what is tried where the space refuses the end."""
_ROUNDS = 3
"""How often such a climb goes over the parameters with a limited number of values."""
_ALTERNATIVES = 100
"""Values of one such parameter that are looked at in a round, those next to the present one."""


@dataclass(frozen=True)
class GpSearch:
    """Proposes where the expected improvement over the best fin known is largest.

    The first candidates, twice as many as there are parameters and two, are spread over the space (`QuasiRandom`), as
    are all others until three have a score. A candidate that still swims is believed to score as expected (the kriging
    believer of Ginsbourger, Le Riche & Carraro 2010); one that has no score counts as bad as the worst that has one.
    As long as none meets the constraints, the one is proposed that most likely does.

    Attributes:
        space: Where to search; ranges, steps and choices.
        seed: Of all its random numbers, 0 or more.

    Raises:
        ValueError: A seed that cannot be.
    """

    space: Space
    seed: int

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)

    @cached_property
    def _features(self) -> Features:
        return Features(self.space)

    @cached_property
    def _spread(self) -> QuasiRandom:
        return QuasiRandom(self.space, self.seed)

    @property
    def first(self) -> int:
        """Candidates that are spread over the space before any is modelled."""
        return 2 * (len(self.space.names) + 1)

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: what still swims is believed to score as expected."""
        return 0

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``."""
        if len(history) < self.first or sum(entry.score is not None for entry in history) < _LEAST:
            return self._spread.propose(history)
        # One thread: their number decides in which order sums are made, and so the last bits.
        with _threads().limit(limits=1):
            return self._most_promising(history, generator(self.seed, len(history)))

    def _most_promising(self, history: Sequence[Evaluation], random: np.random.Generator) -> Values:
        single = _single_scores(history, random)
        chosen = _chosen(single)
        numbers = np.array([self.space.row(entry.values) for entry in history])
        features = self._features.of(numbers)
        raw = np.array([single[place] for place in chosen])
        scores = (raw - raw.mean()) / (raw.std() or 1.0)
        groups = self._features.groups
        kernel = _likely_kernel(features[chosen], scores, groups, random)
        process = GaussianProcess(features[chosen], scores, groups, kernel)
        failed = [place for place, entry in enumerate(history) if entry.score is None and not entry.pending]
        pending = [place for place, entry in enumerate(history) if entry.score is None and entry.pending]
        if others := failed[-_MOST:] + pending:
            believed = np.full(len(others), scores.min())
            if pending:
                believed[-len(pending) :] = process.predict(features[pending])[0]
            all_scores = np.concatenate((scores, believed))
            process = GaussianProcess(features[[*chosen, *others]], all_scores, groups, kernel)
        # The best that is surely so: mean less one deviation (Huang et al. 2006, eq. 11).
        mean, variance = process.predict(features[chosen])
        violations = np.array([history[place].violation for place in chosen])
        sure = np.where(violations > 0.0, -np.inf, mean - np.sqrt(variance))
        best = float(mean[np.argmax(sure)]) if (violations == 0.0).any() else None
        good = numbers[chosen][np.lexsort((-scores, violations))[:_CLIMBS]]
        tried = self._features.unit(numbers)
        limits = self._limits(history, chosen, pending, features, random)
        promise = _Promise(self.space, self._features, process, best, limits, tried)
        return self.space.values(promise.best_of(self._pool(good, random)).tolist())

    def _limits(
        self,
        history: Sequence[Evaluation],
        chosen: Sequence[int],
        pending: Sequence[int],
        features: Array,
        random: np.random.Generator,
    ) -> tuple[GaussianProcess, ...]:
        """Return a process of each constraint's excess; those that still swim are believed to miss as expected."""
        limits = []
        groups = self._features.groups
        for excesses in zip(*(history[place].excesses for place in chosen), strict=True):
            raw = np.arcsinh(excesses)  # what misses by far must not hide where the limit is
            told = raw / (raw.std() or 1.0)
            process = GaussianProcess(
                features[chosen], told, groups, _likely_kernel(features[chosen], told, groups, random)
            )
            if pending:
                told = np.concatenate((told, process.predict(features[pending])[0]))
                process = GaussianProcess(features[[*chosen, *pending]], told, groups, process.kernel)
            limits.append(process)
        return tuple(limits)

    def _pool(self, good: Array, random: np.random.Generator) -> Array:
        """Return candidates that can be, some from the whole space, some near ``good``, both of shape (n, parameters).

        Raises:
            ValueError: None of ten thousand that are drawn can be.
        """
        unit = self._features.unit(good)
        anywhere = random.random((_POOL, unit.shape[1]))
        near = [
            unit[random.integers(len(unit), size=_NEAR)] + distance * random.standard_normal((_NEAR, unit.shape[1]))
            for distance in _DISTANCES
        ]
        pool = self._features.numbers(np.vstack([anywhere, *near]))
        pool = np.delete(pool, self.space.refused(pool), axis=0)
        return pool if len(pool) else np.array([self.space.row(uniform(self.space, random))])


@dataclass(frozen=True)
class _Promise:
    """What a trial of a candidate promises, and how to find the one that promises most.

    What was tried, to `_SAME` of each range, promises less than anything else: how often a candidate is swum is the
    study's to say.

    Attributes:
        process: Of the score.
        best: What is to be improved; None while nothing is known that meets the constraints.
        limits: A process of each constraint's excess.
        tried: What was tried, as places in the unit box, shape (candidates, parameters).
    """

    space: Space
    features: Features
    process: GaussianProcess
    best: float | None
    limits: tuple[GaussianProcess, ...]
    tried: Array

    def of(self, numbers: Array) -> Array:
        """Return the logarithm of the expected improvement by candidates of shape (n, parameters).

        It is less by the logarithm of how likely they meet the constraints, and nothing else while nothing meets them.
        """
        features = self.features.of(numbers)
        promise = np.zeros(len(numbers))
        if self.best is not None:
            mean, variance = self.process.predict(features)
            promise = log_improvement(mean, variance, self.best, self.process.kernel.noise)
        for limit in self.limits:
            promise = promise + log_met(*limit.predict(features))
        return np.where(self._new(numbers), promise, promise - _TRIED)

    def _new(self, numbers: Array) -> NDArray[np.bool_]:
        """Return which candidates, shape (n, parameters), differ from each that was tried, in any parameter."""
        same = np.ones((len(numbers), len(self.tried)), dtype=bool)
        for own, others in zip(self.features.unit(numbers).T, self.tried.T, strict=True):
            same &= np.abs(own[:, None] - others) < _SAME
        return np.asarray(~same.any(axis=1))

    def best_of(self, pool: Array) -> Array:
        """Return the candidate that promises most, found by climbing from the most promising ones of the pool."""
        starts = pool[np.argsort(-self.of(pool), kind="stable")[:_CLIMBS]]
        # A climb may end where something was tried; the pool holds what was not.
        ends = np.vstack([*(self._climbed(start) for start in starts), starts])
        return np.asarray(ends[int(np.argmax(self.of(ends)))])

    def _climbed(self, start: Array) -> Array:
        for _ in range(_ROUNDS):
            end = self._switched(self._moved(start))
            if np.array_equal(end, start) or not any(self.features.counts):
                return end
            start = end
        return start

    def _moved(self, start: Array) -> Array:
        """Return where the parameters that take any value of a range lead, as far as the space does not refuse it."""
        moving, columns = self.features.moving, self.features.columns
        if not moving:
            return start
        point = self.features.of(start[None, :])[0]

        def downhill(places: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            point[columns] = places
            value, slope = self._with_slope(point)
            return -value, -slope[columns]

        unit = self.features.unit(start[None, :])
        found = minimize(
            downhill,
            unit[0, moving],
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0)] * len(moving),
            options={"maxiter": _CLIMB_STEPS},
        )
        way = np.zeros_like(unit)
        way[0, moving] = found.x - unit[0, moving]
        for share in _SHARES:
            end = self.features.numbers(unit + share * way)
            if not self.space.refused(end).size:
                return np.asarray(end[0])
        return start

    def _with_slope(self, point: Array) -> tuple[float, Array]:
        """Return what a point, shape (features,), promises, whether or not it was tried, and the gradient of that."""
        parts = []
        if self.best is not None:
            told = self.process.predict_with_slope(point)
            parts.append(log_improvement_with_slope(*told, self.best, self.process.kernel.noise))
        parts += [log_met_with_slope(*limit.predict_with_slope(point)) for limit in self.limits]
        value, slope = parts[0]
        for more, steeper in parts[1:]:
            value, slope = value + more, slope + steeper
        return value, slope

    def _switched(self, start: Array) -> Array:
        """Return the best found by changing the parameters with a limited number of values, one after another."""
        for place, count in enumerate(self.features.counts):
            if count:
                values = self.features.alternatives(place, float(start[place]), _ALTERNATIVES)
                others = np.tile(start, (len(values), 1))
                others[:, place] = values
                others = np.vstack((start, np.delete(others, self.space.refused(others), axis=0)))
                start = others[int(np.argmax(self.of(others)))]
        return start


def _single_scores(history: Sequence[Evaluation], random: np.random.Generator) -> list[float | None]:
    """Return one score a candidate, more is better: of several objectives the augmented Chebyshev scalar of ParEGO.

    The objectives are scaled to costs that are 0 to 1 on the front known so far, whose shares the weights are; what is
    far behind it must not decide them. Beyond 1 a cost grows as its logarithm. The weights are drawn evenly from those
    whose sum is 1.
    """
    objectives = np.array([entry.objectives for entry in history if entry.score is not None])
    if objectives.shape[1] == 1:
        return [entry.score for entry in history]
    front = np.array([history[place].objectives for place in pareto_front(history)] or objectives)
    best, worst = front.max(axis=0), front.min(axis=0)
    level = best <= worst
    best, worst = np.where(level, objectives.max(axis=0), best), np.where(level, objectives.min(axis=0), worst)
    costs = (best - objectives) / np.where(best > worst, best - worst, np.inf)  # none where all are alike
    costs = np.where(costs > 1.0, 1.0 + np.log(np.maximum(costs, 1.0)), costs)
    weighted = random.dirichlet(np.ones(objectives.shape[1])) * costs
    # f = max_j(w_j c_j) + rho sum_j w_j c_j (Knowles 2006, eq. 2)
    singles = iter((-weighted.max(axis=1) - _SUM_SHARE * weighted.sum(axis=1)).tolist())
    return [None if entry.score is None else next(singles) for entry in history]


def _chosen(scores: Sequence[float | None]) -> list[int]:
    """Return the places of the scored candidates that are modelled, in order: all, or the best ones and the latest."""
    scored = [place for place, score in enumerate(scores) if score is not None]
    latest = scored[-_MOST // 2 :]
    earlier = np.array([scores[place] for place in scored[: -_MOST // 2]], dtype=float)
    best = np.argsort(-earlier, kind="stable")[: _MOST - len(latest)]
    return sorted(scored[place] for place in best) + latest


def _likely_kernel(features: Array, scores: Array, groups: NDArray[np.intp], random: np.random.Generator) -> Kernel:
    """Return the most likely kernel that is found."""
    few = np.arange(len(scores))
    if len(scores) > _MOST_FOR_START:
        best = np.argsort(-scores, kind="stable")[: _MOST_FOR_START // 2]
        others = np.setdiff1d(np.arange(len(scores)), best)
        drawn = random.choice(others, _MOST_FOR_START - len(best), replace=False)
        few = np.sort(np.concatenate((best, drawn)))
    first = Likelihood(features[few], scores[few], groups)
    low, high = np.array(first.bounds).T
    spread = 2.0 * random.standard_normal((_STARTS - 1, len(low)))
    starts = [first.start, *np.clip(first.start + spread, low, high)]
    found = first.best(starts, _STEPS)
    if len(scores) > _MOST_FOR_START:
        found = Likelihood(features, scores, groups).best([found], _LAST_STEPS)
    return Kernel.of_logarithms(found)


@cache
def _threads() -> ThreadpoolController:
    """Return what limits the threads of linear algebra; to find its libraries takes longer than to use it."""
    return ThreadpoolController()
