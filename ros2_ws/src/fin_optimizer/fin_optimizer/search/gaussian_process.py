"""A Gaussian process of few hundred points: its likelihood with gradient, its prediction, and what a trial promises.

Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006 (GPML); Matern 5/2 covariance with a length of its
own for each group of features (eq. 4.17), a constant mean that is estimated too (section 2.7, the limit of a vague
prior), and Gaussian noise of one variance.

    r^2(x, y) = sum_f (x_f - y_f)^2 / l_g(f)^2
    k(x, y)   = s^2 (1 + sqrt(5) r + 5/3 r^2) exp(-sqrt(5) r),    K = k(X, X) + noise I
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve, lapack, solve_triangular
from scipy.optimize import minimize
from scipy.special import erfcx, log_ndtr

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_ROOT_5 = math.sqrt(5.0)
_SHORTEST, _LONGEST = 1e-2, 1e2
"""Of a length, for features between 0 and 1: a hundredth of a range is not resolved by few hundred points."""
_LEAST_SIGNAL, _LARGEST_SIGNAL = 1e-2, 1e2
_LEAST_NOISE, _LARGEST_NOISE = 1e-8, 1.0
"""Variances, for scores of variance 1; the least noise keeps K well conditioned where swims repeat exactly."""
_SMALLEST_VARIANCE = 1e-14
"""Of a prediction, whose variance may be nothing but rounding."""
_SERIES = 1e3
"""|z| above which the first terms of the series, 1/z^2 - 3/z^4, are more exact than the difference."""
_NOT_POSITIVE = 1e25
"""Taken for the likelihood's negative logarithm where K is not positive definite in floats."""


@dataclass(frozen=True)
class Kernel:
    """Covariance and noise.

    Attributes:
        lengths: Length of each group of features, shape (groups,).
        signal: Variance s^2 of what is modelled.
        noise: Variance of what is measured around it.
    """

    lengths: Array
    signal: float
    noise: float

    @classmethod
    def of_logarithms(cls, logarithms: Array) -> Kernel:
        """Return the kernel with these logarithms of lengths, signal and noise."""
        numbers = np.exp(logarithms)
        return cls(numbers[:-2], float(numbers[-2]), float(numbers[-1]))

    @property
    def logarithms(self) -> Array:
        """Logarithms of lengths, signal and noise, shape (groups + 2,)."""
        return np.log(np.array([*self.lengths, self.signal, self.noise]))


def _correlation(squared: Array) -> tuple[Array, Array]:
    """Return Matern 5/2 of these squared distances, and (1 + sqrt(5) r) exp(-sqrt(5) r), which its slope needs."""
    scaled = _ROOT_5 * np.sqrt(squared)
    decay = np.exp(-scaled)
    slope = (1.0 + scaled) * decay
    return slope + (5.0 / 3.0) * squared * decay, slope


class Likelihood:
    """How likely the scores are under a kernel, times what was thought of kernels before (a log posterior)."""

    def __init__(self, features: Array, scores: Array, groups: NDArray[np.intp]) -> None:
        """Take what was measured.

        Args:
            features: Shape (points, features), between 0 and 1.
            scores: Shape (points,), of variance about 1.
            groups: For each feature the group whose length it shares, shape (features,), from 0.
        """
        self._scores = scores
        self._upper = np.triu_indices(len(scores), 1)
        count = int(groups.max()) + 1
        self._squared = np.zeros((count, len(self._upper[0])))
        for column, group in zip(features.T, groups.tolist(), strict=True):
            self._squared[group] += (column[self._upper[0]] - column[self._upper[1]]) ** 2
        # Lengths that grow with the root of their number keep the sum over more features as smooth (Hvarfner, Hellsten
        # & Nardi, Vanilla Bayesian Optimization Performs Great in High Dimensions, 2024, eq. 6).
        self._length_mean = math.sqrt(2.0) + 0.5 * math.log(count)

    @property
    def start(self) -> Array:
        """Logarithms of the kernel that is likely before anything is known."""
        groups = len(self._squared)
        # The mode of the prior's lengths is far longer than what is worth a search: begin at half a range.
        return np.log(np.array([0.5 * math.sqrt(groups)] * groups + [1.0, 1e-3]))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Smallest and largest logarithm of each number of a kernel."""
        lengths = [(math.log(_SHORTEST), math.log(_LONGEST))] * len(self._squared)
        signal = (math.log(_LEAST_SIGNAL), math.log(_LARGEST_SIGNAL))
        return [*lengths, signal, (math.log(_LEAST_NOISE), math.log(_LARGEST_NOISE))]

    def __call__(self, logarithms: Array) -> tuple[float, Array]:
        """Return the negative logarithm of likelihood times prior, and its gradient by the kernel's logarithms.

        GPML eq. 5.8 and 5.9, the mean at its best value for this kernel, where the likelihood has no slope by it.
        """
        kernel = Kernel.of_logarithms(logarithms)
        count = len(self._scores)
        correlation, slope = _correlation(kernel.lengths**-2.0 @ self._squared)
        matrix = np.zeros((count, count))
        matrix[self._upper] = kernel.signal * correlation
        np.fill_diagonal(matrix, kernel.signal + kernel.noise)
        factor, failed = lapack.dpotrf(matrix, lower=0, overwrite_a=1)
        if failed:
            return _NOT_POSITIVE, np.zeros_like(logarithms)
        ones = np.ones(count)
        solved = lapack.dpotrs(factor, np.column_stack((self._scores, ones)), lower=0)[0]
        residual = self._scores - solved[:, 0].sum() / solved[:, 1].sum()
        weights = solved[:, 0] - solved[:, 1] * (solved[:, 0].sum() / solved[:, 1].sum())  # alpha = K^-1 (y - m)
        inverse = lapack.dpotri(factor, lower=0)[0]
        value = 0.5 * residual @ weights + np.log(np.diag(factor)).sum()
        # W = K^-1 - alpha alpha', of which both triangles are the same
        off = inverse[self._upper] - weights[self._upper[0]] * weights[self._upper[1]]
        diagonal = np.diag(inverse) - weights**2
        by_length = self._squared @ (off * slope) * ((5.0 / 3.0) * kernel.signal * kernel.lengths**-2.0)
        by_signal = kernel.signal * (off @ correlation + 0.5 * diagonal.sum())
        by_noise = 0.5 * kernel.noise * diagonal.sum()
        prior, prior_slope = self._prior(kernel)
        return float(value + prior), np.array([*by_length, by_signal, by_noise]) + prior_slope

    def _prior(self, kernel: Kernel) -> tuple[float, Array]:
        """Return the negative log prior and its gradient by the logarithms.

        Lengths log-normal with the wide spread sqrt(3) of Hvarfner et al. 2024; signal Gamma(2, 1), about the scores'
        variance; noise Gamma(1.1, 30), little, but not pressed against nothing (both as in Optuna's Gaussian process).
        """
        excess = np.log(kernel.lengths) - self._length_mean
        value = (excess**2).sum() / 6.0
        value += kernel.signal - math.log(kernel.signal) + 30.0 * kernel.noise - 0.1 * math.log(kernel.noise)
        return value, np.array([*(excess / 3.0), kernel.signal - 1.0, 30.0 * kernel.noise - 0.1])

    def best(self, starts: Sequence[Array], steps: int) -> Array:
        """Return the most likely kernel's logarithms that are found from any of ``starts`` in so many steps each."""
        found = [
            minimize(self, start, jac=True, method="L-BFGS-B", bounds=self.bounds, options={"maxiter": steps})
            for start in starts
        ]
        return np.asarray(min(found, key=lambda each: float(each.fun)).x)


class GaussianProcess:
    """What is expected at a point, and how surely, after some were measured."""

    def __init__(self, features: Array, scores: Array, groups: NDArray[np.intp], kernel: Kernel) -> None:
        """Condition the process on what was measured.

        Args:
            features: Shape (points, features), between 0 and 1.
            scores: Shape (points,).
            groups: For each feature the group whose length it shares, shape (features,).
            kernel: Covariance and noise.
        """
        self.kernel = kernel
        self._inverse_lengths = 1.0 / kernel.lengths[groups]
        self._scaled = features * self._inverse_lengths
        squared = ((self._scaled[:, None, :] - self._scaled[None, :, :]) ** 2).sum(axis=2)
        matrix = kernel.signal * _correlation(squared)[0]
        matrix[np.diag_indices(len(scores))] += kernel.noise
        self._factor = np.asarray(np.linalg.cholesky(matrix))
        self._ones = cho_solve((self._factor, True), np.ones(len(scores)))
        self._total = float(self._ones.sum())
        solved = cho_solve((self._factor, True), scores)
        self.mean = float(solved.sum()) / self._total
        self._weights = solved - self._ones * self.mean

    def predict(self, features: Array) -> tuple[Array, Array]:
        """Return mean and variance at points of shape (n, features), without the noise of a measurement.

        GPML eq. 2.25, 2.26 and, for the mean that is not known, 2.42.
        """
        scaled = features * self._inverse_lengths
        squared = -2.0 * scaled @ self._scaled.T
        squared += (scaled**2).sum(axis=1)[:, None]
        squared += (self._scaled**2).sum(axis=1)
        covariance = self.kernel.signal * _correlation(np.maximum(squared, 0.0))[0]
        mean = self.mean + covariance @ self._weights
        solved = solve_triangular(self._factor, covariance.T, lower=True, check_finite=False)
        unknown = 1.0 - covariance @ self._ones
        variance = self.kernel.signal - (solved**2).sum(axis=0) + unknown**2 / self._total
        return mean, np.maximum(variance, 0.0)

    def predict_with_slope(self, point: Array) -> tuple[float, float, Array, Array]:
        """Return mean and variance at one point, shape (features,), and the gradients of both."""
        away = point * self._inverse_lengths - self._scaled
        correlation, slope = _correlation((away**2).sum(axis=1))
        covariance = self.kernel.signal * correlation
        # dk/dx_f = -5/3 s^2 (1 + sqrt(5) r) exp(-sqrt(5) r) (x_f - y_f) / l_f^2
        gradient = (-5.0 / 3.0 * self.kernel.signal) * slope[:, None] * away * self._inverse_lengths
        solved = cho_solve((self._factor, True), covariance, check_finite=False)
        unknown = 1.0 - covariance @ self._ones
        variance = self.kernel.signal - covariance @ solved + unknown**2 / self._total
        mean_slope = self._weights @ gradient
        variance_slope = -2.0 * (solved @ gradient + (unknown / self._total) * (self._ones @ gradient))
        return self.mean + float(covariance @ self._weights), float(variance), mean_slope, variance_slope


def log_improvement(mean: Array, variance: Array, best: float, noise: float) -> Array:
    """Return the logarithm of the augmented expected improvement over ``best``.

    E[max(f - best, 0)] (1 - sqrt(noise / (variance + noise))) (Huang, Allen, Notz & Zeng, J. Global Optimization 34,
    2006, eq. 12 and 13): the second factor is what a further noisy trial still tells. Its logarithm has a slope also
    where the improvement is 0 in floats (Ament et al., Unexpected Improvements to Expected Improvement, 2023, eq. 9).
    """
    variance = np.maximum(variance, _SMALLEST_VARIANCE)
    deviation = np.sqrt(variance)
    return np.asarray(np.log(deviation) + _log_h((mean - best) / deviation) + _log_augmented(variance, noise))


def log_improvement_with_slope(
    mean: float, variance: float, mean_slope: Array, variance_slope: Array, best: float, noise: float
) -> tuple[float, Array]:
    """Return `log_improvement` at one point and its gradient, from those of mean and variance."""
    if variance <= _SMALLEST_VARIANCE:
        variance, variance_slope = _SMALLEST_VARIANCE, np.zeros_like(variance_slope)
    deviation = math.sqrt(variance)
    standard = (mean - best) / deviation
    log_h = float(_log_h(np.array([standard]))[0])
    ratio = math.exp(float(log_ndtr(standard)) - log_h)  # d log h / dz = Phi / h
    total = variance + noise
    value = math.log(deviation) + log_h + float(_log_augmented(np.array([variance]), noise)[0])
    by_variance = 0.5 / variance * (1.0 - standard * ratio)
    share = math.sqrt(noise / total)
    by_variance += 0.5 * share * (1.0 + share) / variance
    return value, (ratio / deviation) * mean_slope + by_variance * variance_slope


def log_met(mean: Array, variance: Array) -> Array:
    """Return the logarithm of how likely a number is 0 or less: log Phi(-mean / deviation)."""
    return np.asarray(log_ndtr(-mean / np.sqrt(np.maximum(variance, _SMALLEST_VARIANCE))))


def log_met_with_slope(mean: float, variance: float, mean_slope: Array, variance_slope: Array) -> tuple[float, Array]:
    """Return `log_met` at one point and its gradient, from those of mean and variance."""
    if variance <= _SMALLEST_VARIANCE:
        variance, variance_slope = _SMALLEST_VARIANCE, np.zeros_like(variance_slope)
    standard = mean / math.sqrt(variance)
    value = float(log_ndtr(-standard))
    hazard = math.exp(-0.5 * standard**2 - 0.5 * math.log(2.0 * math.pi) - value)  # phi(z) / Phi(-z)
    slope = mean_slope / math.sqrt(variance) - (0.5 * standard / variance) * variance_slope
    return value, -hazard * slope


def _log_h(standard: Array) -> Array:
    """Return log(phi(z) + z Phi(z)), exact to some 1e-10 also where that is 0 in floats (Ament et al. 2023, eq. 14)."""
    near = np.maximum(standard, -1.0)
    density = np.exp(-0.5 * near**2) / math.sqrt(2.0 * math.pi)
    result = np.log(density + near * np.exp(log_ndtr(near)))
    low = standard < -1.0
    size = -standard[low]
    lost = size * math.sqrt(math.pi / 2.0) * erfcx(size / math.sqrt(2.0))  # of 1; 1 - lost goes to 1 / z^2
    left = np.where(size > _SERIES, (1.0 - 3.0 / size**2) / size**2, 1.0 - lost)
    result[low] = -0.5 * standard[low] ** 2 - 0.5 * math.log(2.0 * math.pi) + np.log(left)
    return np.asarray(result)


def _log_augmented(variance: Array, noise: float) -> Array:
    """Return log(1 - sqrt(noise / (variance + noise))), exact also where the variance is small beside the noise."""
    total = variance + noise
    return np.asarray(np.log(variance / total) - np.log1p(np.sqrt(noise / total)))
