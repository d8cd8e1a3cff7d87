"""The Gaussian process against its textbook formulas, its slopes against differences, and what a trial promises."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma, lognorm, multivariate_normal, norm

from fin_optimizer.search.gaussian_process import (
    GaussianProcess,
    Kernel,
    Likelihood,
    log_improvement,
    log_improvement_with_slope,
    log_met,
    log_met_with_slope,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

GROUPS = np.array([0, 1, 1, 2])
KERNEL = Kernel(np.array([0.4, 0.9, 2.0]), 1.7, 0.05)


def points(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).random((count, len(GROUPS)))


def scores(features: Array, noise: float = 0.1) -> Array:
    drawn = noise * np.random.default_rng(1).standard_normal(len(features))
    return np.asarray(np.sin(4.0 * features[:, 0]) + features[:, 1] * features[:, 3] + drawn)


def covariance(first: Array, second: Array, kernel: Kernel = KERNEL) -> Array:
    """Return the Matern covariance of any two points."""
    r = np.sqrt((((first[:, None, :] - second[None, :, :]) / kernel.lengths[GROUPS]) ** 2).sum(axis=2))
    return np.asarray(kernel.signal * (1 + math.sqrt(5) * r + 5 / 3 * r**2) * np.exp(-math.sqrt(5) * r))


def predicted(process: GaussianProcess, part: int) -> Callable[[Array], float]:
    """Return the mean (0) or the variance (1) as a function of one point."""
    return lambda point: float(process.predict(point[None, :])[part][0])


def slope_by_differences(function: Callable[[Array], float], at: Array, step: float = 1e-6) -> Array:
    steps = step * np.eye(len(at))
    return np.array([(function(at + each) - function(at - each)) / (2.0 * step) for each in steps])


def test_the_likelihood_is_the_scores_density_times_the_prior() -> None:
    features = points(12)
    measured = scores(features)
    matrix = covariance(features, features) + KERNEL.noise * np.eye(12)
    inverse = np.linalg.inv(matrix)
    mean = inverse.sum(axis=0) @ measured / inverse.sum()

    def prior(kernel: Kernel) -> float:
        """Densities by the logarithm of each number, so each times the number itself."""
        typical = math.exp(math.sqrt(2.0)) * math.sqrt(3.0)
        lengths = lognorm.logpdf(kernel.lengths, math.sqrt(3.0), scale=typical) + np.log(kernel.lengths)
        signal = gamma.logpdf(kernel.signal, 2.0)
        return float(lengths.sum() + signal + gamma.logpdf(kernel.noise, 1.1, scale=1.0 / 30.0))

    def expected(kernel: Kernel) -> float:
        matrix = covariance(features, features, kernel) + kernel.noise * np.eye(12)
        inverse = np.linalg.inv(matrix)
        mean = inverse.sum(axis=0) @ measured / inverse.sum()
        return float(multivariate_normal.logpdf(measured, np.full(12, mean), matrix)) + prior(kernel)

    other = Kernel(np.array([0.2, 1.5, 0.7]), 0.6, 0.2)
    likelihood = Likelihood(features, measured, GROUPS)
    found = [likelihood(each.logarithms)[0] for each in (KERNEL, other)]
    # Up to what does not depend on the kernel.
    assert found[1] - found[0] == pytest.approx(expected(KERNEL) - expected(other), abs=1e-9)
    assert mean != pytest.approx(measured.mean(), abs=1e-3), "the mean is estimated, not taken"


@pytest.mark.parametrize("noise", [1e-6, 0.05, 0.6])
def test_the_likelihoods_slope_is_its_differences(noise: float) -> None:
    features = points(15)
    likelihood = Likelihood(features, scores(features), GROUPS)
    at = Kernel(np.array([0.4, 0.9, 2.0]), 1.7, noise).logarithms
    slope = slope_by_differences(lambda each: likelihood(each)[0], at, 1e-5)
    assert likelihood(at)[1] == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_a_matrix_that_is_not_positive_in_floats_is_unlikely() -> None:
    same = np.tile(points(1), (40, 1))
    value, slope = Likelihood(same, np.zeros(40), GROUPS)(Kernel(np.ones(3), 100.0, 1e-40).logarithms)
    assert value > 1e20
    assert slope.tolist() == [0.0] * 5


def test_the_kernel_is_found_with_which_scores_were_drawn() -> None:
    random = np.random.default_rng(3)
    features = random.random((100, 4))
    true = Kernel(np.array([0.2, 5.0, 0.5]), 1.0, 0.01)
    matrix = covariance(features, features, true) + true.noise * np.eye(100)
    measured = np.linalg.cholesky(matrix) @ random.standard_normal(100)
    likelihood = Likelihood(features, measured, GROUPS)
    found = Kernel.of_logarithms(likelihood.best([likelihood.start], 50))
    assert found.lengths[[0, 2]] == pytest.approx(true.lengths[[0, 2]], rel=0.5)
    assert found.lengths[1] > 2.0, "what changes little has a long length"
    assert found.noise == pytest.approx(true.noise, rel=0.5)
    low, high = np.exp(np.array(likelihood.bounds)).T
    assert low == pytest.approx([1e-2, 1e-2, 1e-2, 1e-2, 1e-8])
    assert high == pytest.approx([1e2, 1e2, 1e2, 1e2, 1.0])
    assert np.exp(likelihood.start) == pytest.approx([0.5 * math.sqrt(3.0)] * 3 + [1.0, 1e-3])


def test_the_best_of_several_climbs_counts() -> None:
    features = points(25)
    likelihood = Likelihood(features, scores(features, 0.0), GROUPS)
    starts = [np.log([100.0, 100.0, 100.0, 0.01, 1.0]), likelihood.start]
    ends = [likelihood(likelihood.best([start], 3))[0] for start in starts]
    assert likelihood(likelihood.best(starts, 3))[0] == min(ends) < max(ends)


def test_a_prediction_is_the_textbooks() -> None:
    features, where = points(12), points(7, seed=5)
    measured = scores(features)
    inverse = np.linalg.inv(covariance(features, features) + KERNEL.noise * np.eye(12))
    there = covariance(where, features)
    mean = inverse.sum(axis=0) @ measured / inverse.sum()
    process = GaussianProcess(features, measured, GROUPS, KERNEL)
    found_mean, found_variance = process.predict(where)
    assert process.mean == pytest.approx(mean, rel=1e-10)
    assert found_mean == pytest.approx(mean + there @ inverse @ (measured - mean), rel=1e-9)
    unknown = 1.0 - there @ inverse.sum(axis=1)
    variance = KERNEL.signal - np.diag(there @ inverse @ there.T) + unknown**2 / inverse.sum()
    assert found_variance == pytest.approx(variance, rel=1e-8)


def test_a_prediction_and_its_slope_at_one_point_are_those_of_many() -> None:
    features, where = points(12), points(4, seed=5)
    process = GaussianProcess(features, scores(features), GROUPS, KERNEL)
    mean, variance = process.predict(where)
    for place, point in enumerate(where):
        one_mean, one_variance, mean_slope, variance_slope = process.predict_with_slope(point)
        assert [one_mean, one_variance] == pytest.approx([mean[place], variance[place]], rel=1e-9)
        for found, part in ((mean_slope, 0), (variance_slope, 1)):
            assert found == pytest.approx(slope_by_differences(predicted(process, part), point), rel=1e-4, abs=1e-6)


def test_without_noise_what_was_measured_is_known() -> None:
    features = points(10)
    measured = scores(features)
    mean, variance = GaussianProcess(features, measured, GROUPS, Kernel(KERNEL.lengths, 1.0, 1e-8)).predict(features)
    assert mean == pytest.approx(measured, abs=1e-5)
    assert (variance >= 0.0).all()
    assert variance == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("standard", [-30.0, -5.0, -1.001, -0.999, 0.0, 0.3, 4.0])
def test_the_improvement_is_the_integral_over_what_is_expected(standard: float) -> None:
    deviation, best, noise = 0.3, 2.0, 0.04
    mean = best + standard * deviation
    # The density's logarithm is taken out, so that the integral is not 0 in floats far from the best.
    scale = norm.logpdf(max(-standard, 0.0))
    integral, _ = quad(lambda z: (standard + z) * math.exp(norm.logpdf(z) - scale), -standard, -standard + 40.0)
    expected = math.log(deviation) + math.log(integral) + scale
    expected += math.log(1.0 - math.sqrt(noise / (deviation**2 + noise)))
    found = log_improvement(np.array([mean]), np.array([deviation**2]), best, noise)
    assert found[0] == pytest.approx(expected, rel=1e-7)


def test_far_below_the_best_the_improvement_still_has_an_order() -> None:
    standard = -np.array([10.0, 100.0, 999.0, 1001.0, 1e4, 1e6])
    found = log_improvement(standard, np.ones(6), 0.0, 0.0)
    # h(z) is phi(z) / z^2 there, up to its share 3 / z^2
    expected = norm.logpdf(standard) - 2.0 * np.log(-standard) + np.log1p(-3.0 / standard**2)
    assert found == pytest.approx(expected, rel=1e-4)
    # Beside the square of z what is left shows only by itself; both sides of where the series begins.
    left = (found - norm.logpdf(standard))[2:4]
    assert left == pytest.approx((expected - norm.logpdf(standard))[2:4], abs=1e-8)


def test_a_trial_where_all_is_known_promises_nothing() -> None:
    sure = log_improvement(np.array([1.0]), np.array([0.0]), 1.0, 1e-3)
    unsure = log_improvement(np.array([1.0]), np.array([1e-6]), 1.0, 1e-3)
    assert np.isfinite(sure[0])
    assert sure[0] < unsure[0] - 10.0
    assert log_improvement(np.array([1.0]), np.array([1e-6]), 1.0, 0.0)[0] > unsure[0], "of a swim without noise more"


@pytest.mark.parametrize("standard", [-2000.0, -50.0, -3.0, -0.5, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_improvements_slope_is_its_differences(standard: float, noise: float) -> None:
    best, variance = 1.0, 0.09
    mean = best + 0.3 * standard
    mean_slope, variance_slope = np.array([0.7, -0.2]), np.array([0.05, 0.3])
    value, slope = log_improvement_with_slope(mean, variance, mean_slope, variance_slope, best, noise)

    def along(place: Array) -> float:
        at = np.array([mean + mean_slope @ place]), np.array([variance + variance_slope @ place])
        return float(log_improvement(*at, best, noise)[0])

    assert value == along(np.zeros(2))
    assert slope == pytest.approx(slope_by_differences(along, np.zeros(2)), rel=1e-4)


def test_where_all_is_known_the_variance_has_no_slope() -> None:
    value, slope = log_improvement_with_slope(0.9, -1e-17, np.array([1.0]), np.array([1.0]), 1.0, 1e-6)
    assert value == log_improvement(np.array([0.9]), np.array([0.0]), 1.0, 1e-6)[0]
    # d log h / dz is |z| far below the best, z = -0.1 / 1e-7
    assert slope == pytest.approx(0.1 / 1e-14, rel=1e-4)


@pytest.mark.parametrize("mean", [-40.0, -1.0, 0.0, 0.3, 40.0])
def test_how_likely_a_limit_is_met_and_its_slope_are_those_of_the_normal_distribution(mean: float) -> None:
    variance, mean_slope, variance_slope = 0.25, np.array([0.7, -0.2]), np.array([0.05, 0.3])
    value, slope = log_met_with_slope(mean, variance, mean_slope, variance_slope)

    def along(place: Array) -> float:
        at = np.array([mean + mean_slope @ place]), np.array([variance + variance_slope @ place])
        return float(log_met(*at)[0])

    assert value == pytest.approx(norm.logcdf(-mean / 0.5), rel=1e-12)
    assert along(np.zeros(2)) == pytest.approx(value, rel=1e-12)
    assert slope == pytest.approx(slope_by_differences(along, np.zeros(2)), rel=1e-4, abs=1e-9)


def test_a_number_that_is_surely_known_meets_its_limit_or_does_not() -> None:
    still = np.zeros(2)
    assert log_met_with_slope(-1.0, 0.0, still, still)[0] == pytest.approx(0.0, abs=1e-12)
    assert log_met_with_slope(1.0, 0.0, still, still)[0] < -1e10
