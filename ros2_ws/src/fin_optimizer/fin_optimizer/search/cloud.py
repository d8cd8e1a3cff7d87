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

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SLOWEST = 1e-4
"""m/s, below which a speed counts as this: a fin that does not swim."""
_OUTCOMES = 16
"""Of a trial, that are thought through."""
_MOST = 2000
"""Fish that are thought through, drawn by their weights where there are more."""


@dataclass(frozen=True)
class Belief:
    """What is believed of every fin.

    Attributes:
        weights: Of the fish, (F,), their sum 1.
        logarithms: Of each fish's speed with each fin, corrected by what no fish explains, (F, N).
        variance: Of what no fish explains, (N,).
        mean: Expected speed of each fin, m/s, (N,).
        deviation: Standard deviation of it, m/s, (N,).
    """

    weights: Array
    logarithms: Array
    variance: Array
    mean: Array
    deviation: Array

    @property
    def effective_size(self) -> float:
        """How many fish of equal weight would tell as much: near 1 the cloud has collapsed."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def best(self) -> int:
        """Fin that is expected to be fastest."""
        return int(np.argmax(self.mean))


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

        Args:
            tried: Fins by number, (T,), in any order and as often as they were tried.
            scores: m/s, (T,).
        """
        logarithms = np.log(np.maximum(np.nan_to_num(self.speeds), SLOWEST))
        likeness = self._likeness()
        weights, variance = self.importance.copy(), np.diag(likeness).copy()
        if len(tried):
            left = np.log(np.maximum(scores, SLOWEST)) - logarithms[:, tried]
            spread = likeness[np.ix_(tried, tried)] + self.noise**2 * np.eye(len(tried))
            answer = np.linalg.solve(spread, likeness[tried])  # (T, N)
            weights -= 0.5 * np.einsum("ft,ft->f", left, np.linalg.solve(spread, left.T).T)
            logarithms = logarithms + left @ answer
            variance = np.maximum(variance - np.einsum("tn,tn->n", likeness[tried], answer), 0.0)
        weights = np.exp(weights - weights.max())
        weights /= weights.sum()
        speeds = np.exp(logarithms + 0.5 * variance)
        mean = weights @ speeds
        second = weights @ (speeds**2 * np.exp(variance))
        return Belief(weights, logarithms, variance, mean, np.sqrt(np.maximum(second - mean**2, 0.0)))

    def gains(self, belief: Belief, random: np.random.Generator) -> Array:
        """Return by what share of the best speed a trial of each fin is expected to raise the best, (N,)."""
        kept = np.flatnonzero(belief.weights > 1e-6 * belief.weights.max())
        weights = belief.weights[kept] / belief.weights[kept].sum()
        if len(kept) > _MOST:
            kept = kept[_systematic(weights, _MOST, random)]
            weights = np.full(_MOST, 1.0 / _MOST)
        logarithms = belief.logarithms[kept]
        speeds = np.exp(logarithms + 0.5 * belief.variance)
        before = float(np.max(weights @ speeds))
        drawn = _systematic(weights, _OUTCOMES, random)
        quantiles = [NormalDist().inv_cdf((index + 0.5) / _OUTCOMES) for index in range(_OUTCOMES)]
        error = random.permutation(np.array(quantiles))
        gains = np.empty(logarithms.shape[1])
        for fin in range(len(gains)):
            spread = math.sqrt(belief.variance[fin] + self.noise**2)
            outcomes = logarithms[drawn, fin] + spread * error
            apart = (outcomes[:, None] - logarithms[None, :, fin]) / spread
            likely = weights * np.exp(-0.5 * apart**2)
            likely /= likely.sum(axis=1, keepdims=True)
            gains[fin] = float(np.mean(np.max(likely @ speeds, axis=1)))
        result: Array = gains / before - 1.0
        return result


def _systematic(weights: Array, count: int, random: np.random.Generator) -> NDArray[np.intp]:
    """Return so many places drawn by their weights, evenly spread over them."""
    points = (np.arange(count) + random.random()) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), points), len(weights) - 1)
