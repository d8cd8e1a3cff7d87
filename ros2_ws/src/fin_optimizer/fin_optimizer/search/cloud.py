"""What scores tell of a cloud of plausible fish, and which trial tells most: for the choice of the next fin.

Every fish of the cloud predicts every fin's speed. Measured speeds weigh the fish; a Gaussian process stands for what
no fish of the cloud explains, the same for all of them, so that the weights and the predictions have closed forms
(Kennedy & O'Hagan, Journal of the Royal Statistical Society B 63, 2001). The next fin is the one after whose trial the
best fin is expected to be best by most: the knowledge gradient of Frazier, Powell & Dayanik, INFORMS Journal on
Computing 21, 2009, over outcomes that the cloud itself draws. All speeds are compared by their logarithms: noise and
discrepancy are shares of a speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.told import NEAR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SLOWEST = 3e-3
"""m/s, below which a speed counts as this: a fin that hardly swims."""
NEIGHBOURS = 20.0
"""Fish that are to count, of a cloud of a thousand or more: where fewer do, what lies between them counts too."""
_OF_A_CLOUD = 1.0 / 50.0
_SMOOTHING = 0.6
"""Width of what lies around a fish over that of its neighbours' differences: about what is best for so many of a
density in six dimensions (Silverman, Density Estimation, 1986, eq. 4.14)."""
_OUTCOMES = 16
"""Of a trial, that are thought through."""
_DRAWS, _MORE_DRAWS = 1000, 2000
"""From what is believed, to choose the next fin, and to say how sure the best one is."""
_LEAST = 1e-10
"""Weight over the largest one, below which a fish is left out."""


@dataclass(frozen=True)
class Belief:
    """What is believed of every fin.

    Attributes:
        weights: Of the fish that count, (K,), their sum 1.
        logarithms: Of their speeds with each fin, corrected by what no fish explains, (K, N).
        covariance: Of what no fish explains, and of what lies around a fish, (N, N).
        mean: Expected speed of each fin, m/s, (N,).
        deviation: Standard deviation of it, m/s, (N,).
    """

    weights: Array
    logarithms: Array
    covariance: Array
    mean: Array
    deviation: Array

    @property
    def variance(self) -> Array:
        """Of what no fish explains, of each fin, (N,)."""
        return np.maximum(np.diag(self.covariance), 0.0)

    @property
    def effective_size(self) -> float:
        """How many fish of equal weight would tell as much: near 1 the cloud has collapsed."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def best(self) -> int:
        """Fin that is expected to be fastest by the logarithm, in which a fin that nobody knows is not the best."""
        return int(np.argmax(self.weights @ self.logarithms))

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Return logarithms of speeds drawn from what is believed, (count, N)."""
        values, vectors = np.linalg.eigh(self.covariance)
        spread = vectors * np.sqrt(np.maximum(values, 0.0))
        fish = _systematic(self.weights, count, random)
        result: Array = self.logarithms[fish] + random.standard_normal((count, len(values))) @ spread.T
        return result


@dataclass(frozen=True)
class Cloud:
    """Plausible fish and what they do with every fin.

    Attributes:
        speeds: Of each fish with each fin, m/s, (F, N).
        importance: Logarithm of each fish's prior over the density that it was drawn from, (F,).
        places: Of the fins, where likeness is distance 1, (N, D).
        noise: Of one trial, as a share of the speed.
        discrepancy: Of the real fish from the best of the cloud, as a share of the speed.
    """

    speeds: Array
    importance: Array
    places: Array
    noise: float
    discrepancy: float

    def _likeness(self) -> Array:
        apart = self.places[:, None, :] - self.places[None, :, :]
        result: Array = self.discrepancy**2 * np.exp(-0.5 * np.sum(apart**2, axis=2))
        return result

    def belief(self, tried: NDArray[np.intp], scores: Array) -> Belief:
        """Return what is believed after trials.

        Where few fish are near the scores, what lies between them is believed too: around every fish a Gaussian with
        the covariance of the fish that are near enough.

        Args:
            tried: Fins by number, (T,), in any order and as often as they were tried.
            scores: m/s, (T,).
        """
        logarithms = self._logarithms
        covariance, weights = self._likeness(), self.importance
        if len(tried):
            left = np.log(np.maximum(scores, SLOWEST)) - logarithms[:, tried]
            unlikely = self._unlikely(covariance, tried, left)
            softened = _softened(weights, unlikely, min(NEIGHBOURS, _OF_A_CLOUD * len(weights)))
            if softened is not None:
                near = np.flatnonzero(softened > _LEAST * softened.max())
                apart = logarithms[near] - softened[near] @ logarithms[near]
                covariance = covariance + _SMOOTHING**2 * (apart.T * softened[near]) @ apart
                unlikely = self._unlikely(covariance, tried, left)
            weights = weights - unlikely
            kept = np.flatnonzero(weights > weights.max() + math.log(_LEAST))
            weights, logarithms, left = weights[kept], logarithms[kept], left[kept]
            spread = covariance[np.ix_(tried, tried)] + self.noise**2 * np.eye(len(tried))
            answer = np.linalg.solve(spread, covariance[tried])  # (T, N)
            logarithms = logarithms + left @ answer
            covariance = covariance - covariance[tried].T @ answer
        weights = _normalised(weights)
        variance = np.maximum(np.diag(covariance), 0.0)
        mean = weights @ np.exp(logarithms + 0.5 * variance)
        second = weights @ np.exp(2.0 * (logarithms + variance))
        return Belief(weights, logarithms, covariance, mean, np.sqrt(np.maximum(second - mean**2, 0.0)))

    def neighbours(self, tried: NDArray[np.intp], scores: Array) -> Array:
        """Return weights of the fish that are near the scores, (F,): of so many that they tell what lies around."""
        left = np.log(np.maximum(scores, SLOWEST)) - self._logarithms[:, tried]
        unlikely = self._unlikely(self._likeness(), tried, left)
        fewest = min(NEIGHBOURS, _OF_A_CLOUD * len(self.importance))
        softened = _softened(self.importance, unlikely, fewest)
        return _normalised(self.importance - unlikely) if softened is None else softened

    @property
    def _logarithms(self) -> Array:
        result: Array = np.log(np.maximum(np.nan_to_num(self.speeds), SLOWEST))
        return result

    def _unlikely(self, covariance: Array, tried: NDArray[np.intp], left: Array) -> Array:
        """Return minus the logarithm of each fish's likelihood, up to a constant, (F,)."""
        spread = covariance[np.ix_(tried, tried)] + self.noise**2 * np.eye(len(tried))
        result: Array = 0.5 * np.einsum("ft,ft->f", left, np.linalg.solve(spread, left.T).T)
        return result

    def gains(self, belief: Belief, random: np.random.Generator) -> Array:
        """Return by what share of the best speed a trial of each fin is expected to raise the best, (N,)."""
        logarithms = belief.drawn(_DRAWS, random)
        speeds = np.exp(logarithms)
        true = _systematic(np.full(_DRAWS, 1.0 / _DRAWS), _OUTCOMES, random)
        quantiles = [NormalDist().inv_cdf((index + 0.5) / _OUTCOMES) for index in range(_OUTCOMES)]
        error = self.noise * random.permutation(np.array(quantiles))
        gains = np.empty(logarithms.shape[1])
        for fin in range(len(gains)):
            outcomes = logarithms[true, fin] + error
            likely = np.exp(-0.5 * ((outcomes[:, None] - logarithms[None, :, fin]) / self.noise) ** 2)
            likely /= likely.sum(axis=1, keepdims=True)
            gains[fin] = float(np.mean(np.max(likely @ speeds, axis=1)))
        result: Array = gains / float(np.max(speeds.mean(axis=0))) - 1.0
        return result


def regret(belief: Belief, random: np.random.Generator) -> tuple[float, float]:
    """Return by what share of the best speed the fin thought best is expected to be slower, and how sure that is.

    Fish are drawn by their weights, and with each what none explains: every draw has a best fin of its own.

    Returns:
        Expected regret; and the part of the draws in which it is no more than `NEAR`.
    """
    logarithms = belief.drawn(_MORE_DRAWS, random)
    slower = 1.0 - np.exp(logarithms[:, belief.best] - logarithms.max(axis=1))
    return float(np.mean(slower)), float(np.mean(slower <= NEAR))


def _normalised(logarithms: Array) -> Array:
    result: Array = np.exp(logarithms - logarithms.max())
    return result / result.sum()


def _softened(importance: Array, unlikely: Array, fewest: float) -> Array | None:
    """Return weights by a power of the likelihood with which so many fish count; None where as many do anyway."""

    def weights(power: float) -> Array:
        return _normalised(importance - power * unlikely)

    if 1.0 / np.sum(weights(1.0) ** 2) >= fewest:
        return None
    low, high = -10.0, 0.0  # logarithms of the power
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 1.0 / np.sum(weights(math.exp(middle)) ** 2) >= fewest else (low, middle)
    return weights(math.exp(low))


def _systematic(weights: Array, count: int, random: np.random.Generator) -> NDArray[np.intp]:
    """Return so many places drawn by their weights, evenly spread over them."""
    points = (np.arange(count) + random.random()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), points), len(weights) - 1)
