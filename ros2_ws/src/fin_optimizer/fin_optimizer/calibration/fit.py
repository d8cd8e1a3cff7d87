"""The fish that fits recorded swims best, and how sure that is.

Whole swims are predicted from starts that their own first second decides, and what is left over is made small: forward
and sideways speed and the heading as means over a beat, yaw rate and position sample by sample. Every swim has a start
of its own, so that the derivatives come in blocks, one a swim: how the start follows a parameter is known from the
start's own least squares (Golub & Pereyra, SIAM Journal on Numerical Analysis 10, 1973), and one swim more gives a
column.

Residuals of one swim belong together, so the errors come from the spread between swims (sandwich of Huber, clustered:
Liang & Zeger, Biometrika 73, 1986), with what the prior leaves open added. The loss forgives a prior that the swims
contradict as it forgives an outlier: such a prior makes the errors hardly smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.optimize import least_squares

from fin_optimizer.calibration.model import Tank, model_of
from fin_optimizer.calibration.prediction import GIVEN, Start, differences
from fin_optimizer.calibration.settings import AMPLITUDE_FACTOR, GAIN_LEFT, GAIN_RIGHT
from fin_optimizer.calibration.swims import FEWEST_SWIMS
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.calibration.model import Model
    from fin_optimizer.calibration.prediction import Prediction
    from fin_optimizer.calibration.settings import Settings
    from fin_optimizer.calibration.swims import Swim

    Array = NDArray[np.float64]

STARTS = 4
"""Fits from other places; the best counts."""
_ROUNDS = 12
_FIRST_ROUNDS = 5
_REACH, _PART_OF_SPREAD = 1e-3, 0.05
"""Step of a derivative by a coordinate, and the part of its spread and of its range that a step is at most."""
_LOSS: Final = "soft_l1"
# Independent values of a kind that one swim holds: its residuals are correlated over two or three seconds.
_VALUES_OF_A_SWIM = 3.4
_BEAT_NOISE = {"forward": 0.4}  # of a mean over a beat over that of a sample
_FACTORS = (0.5, 1.5)
_POORLY_KNOWN, _TOGETHER = 0.7, 0.9
_FAR = 3.0
"""Spreads from a prior beyond which the swims contradict it."""


@dataclass(frozen=True)
class Fit:
    """A calibrated fish.

    Attributes:
        model: The fish, its drive and its tracker.
        names: Of what was fitted; the amplitude factors at their biases last.
        values: Shape (P,).
        low: Values one standard error below, (P,); beyond its bound where a parameter lies near it.
        high: Values one standard error above, likewise, (P,).
        correlations: Of the errors, (P, P).
        cost: Half the robust sum of squares, the prior's included.
        doubts: What the data cannot tell, in sentences.
    """

    model: Model
    names: tuple[str, ...]
    values: Array
    low: Array
    high: Array
    correlations: Array
    cost: float
    doubts: tuple[str, ...]


class _Whole:
    """One swim's part in the sum of squares."""

    def __init__(self, swim: Swim) -> None:
        self.start = Start(swim, GIVEN)
        self.swim = swim
        self.near: Array | None = None
        time = swim.time
        share = np.gradient(time)
        window = (np.abs(time[:, None] - time[None, :]) < 0.5 / swim.frequency) * share[None, :]
        self._beat = window / window.sum(axis=1, keepdims=True)
        self._weight = math.sqrt(_VALUES_OF_A_SWIM / len(time))

    def weighted(self, predicted: Prediction) -> Array:
        apart = differences(self.swim, predicted)
        for name in ("forward", "lateral", "heading"):
            apart[name] = self._beat @ apart[name] / _BEAT_NOISE.get(name, 1.0)
        return self._weight * np.concatenate(list(apart.values()))

    def residuals(self, tank: Tank) -> Array:
        """Return the residuals under a model; the start that they begin from is kept."""
        self.near = self.start.find(tank, self.near)
        return self.weighted(self.start.follow(tank, self.near))

    def columns(self, tank: Tank, moved: Sequence[tuple[int, float, Tank]], count: int) -> Array:
        """Return the derivatives by the coordinates, shape (R, count).

        Args:
            tank: Where they are taken.
            moved: The coordinates that matter to this swim: place, step, and the tank after that step.
            count: Of all coordinates.
        """
        near = self.start.find(tank) if self.near is None else self.near
        left = self.start.residuals(tank, near)
        by_start = self.start.jacobian(tank, near, left)
        answer = np.linalg.pinv(by_start)
        here = self.weighted(self.start.follow(tank, near))
        result = np.zeros((len(here), count))
        for column, step, other in moved:
            follow = near - answer @ (self.start.residuals(other, near) - left)
            result[:, column] = (self.weighted(self.start.follow(other, follow)) - here) / step
        return result


def _loss_slope(left: Array) -> Array:
    """Return the derivative of half the loss soft_l1, sqrt(1 + r^2) - 1, by each residual r."""
    result: Array = left * (1.0 + left**2) ** -0.5
    return result


def _loss_curvature(left: Array) -> Array:
    """Return the second derivative of half the loss soft_l1 by each residual: 1 of a small one, 0 of an outlier."""
    result: Array = (1.0 + left**2) ** -1.5
    return result


class _Problem:
    """Residuals and derivatives of all swims by the coordinates of what is fitted."""

    def __init__(self, swims: Sequence[Swim], settings: Settings) -> None:
        self.settings = settings
        self.wholes = [_Whole(swim) for swim in swims]
        self.biases = tuple(sorted({swim.bias for swim in swims}))
        self.frequencies = tuple(
            float(np.median([swim.frequency for swim in swims if swim.bias == bias])) for bias in self.biases
        )
        fitted = settings.fitted
        factors = len(self.biases) if settings.factor_spread else 0
        self.names = (*(each.name for each in fitted), *(self._factor_name(bias) for bias in self.biases[:factors]))
        self.prior: Array = np.array([each.coordinate(each.prior) for each in fitted] + [1.0] * factors)
        self.spread: Array = np.array([each.spread for each in fitted] + [settings.factor_spread or 1.0] * factors)
        self.low: Array = np.array([each.coordinate(each.low) for each in fitted] + [_FACTORS[0]] * factors)
        self.high: Array = np.array([each.coordinate(each.high) for each in fitted] + [_FACTORS[1]] * factors)
        self.step = np.minimum(_REACH, _PART_OF_SPREAD * np.minimum(self.spread, self.high - self.low))
        rough = np.zeros((max(factors - 1, 0), len(self.prior)))
        for row in range(len(rough)):
            rough[row, len(fitted) + row : len(fitted) + row + 2] = -1.0, 1.0
        self.belief = np.vstack((np.diag(1.0 / self.spread), rough / settings.factor_roughness))

    @staticmethod
    def _factor_name(bias: float) -> str:
        return f"{AMPLITUDE_FACTOR}({math.degrees(bias):+.4g} deg)"

    def model(self, coordinates: Array) -> Model:
        return model_of(self.settings, coordinates, self.biases, self.frequencies)

    def _beliefs(self, coordinates: Array) -> Array:
        result: Array = self.belief @ (coordinates - self.prior)
        return result

    def residuals(self, coordinates: Array) -> Array:
        tank = Tank(self.model(coordinates))
        return np.concatenate([*(whole.residuals(tank) for whole in self.wholes), self._beliefs(coordinates)])

    def _matters(self, column: int, swim: Swim) -> bool:
        fitted = self.settings.fitted
        if column >= len(fitted):
            return self.biases[column - len(fitted)] == swim.bias
        one_side = {GAIN_RIGHT: swim.bias > 0.0, GAIN_LEFT: swim.bias < 0.0}
        return one_side.get(fitted[column].name, True)

    def blocks(self, coordinates: Array) -> list[Array]:
        """Return each swim's derivatives, shape (R, P)."""
        count = len(coordinates)
        tank = Tank(self.model(coordinates))
        # Towards the inside, since a value does not pass its bound.
        steps = np.where(coordinates + self.step > self.high, -self.step, self.step).tolist()
        moved = [(i, step, Tank(self.model(coordinates + step * np.eye(count)[i]))) for i, step in enumerate(steps)]
        return [
            whole.columns(tank, [each for each in moved if self._matters(each[0], whole.swim)], count)
            for whole in self.wholes
        ]

    def jacobian(self, coordinates: Array) -> Array:
        return np.vstack([*self.blocks(coordinates), self.belief])

    def forget_starts(self) -> None:
        """Look for every swim's start anew, on both sides of the beat."""
        for whole in self.wholes:
            whole.near = None

    def errors(self, coordinates: Array) -> Array:
        """Return the covariance of the coordinates, shape (P, P)."""
        tank = Tank(self.model(coordinates))
        square, between = np.zeros((2, len(coordinates), len(coordinates)))
        blocks = self.blocks(coordinates)
        for whole, block in zip(self.wholes, blocks, strict=True):
            left = whole.residuals(tank)
            square += block.T @ (_loss_curvature(left)[:, None] * block)
            slope = block.T @ _loss_slope(left)
            between += np.outer(slope, slope)
        count = len(blocks)
        belief = self.belief.T @ (_loss_curvature(self._beliefs(coordinates))[:, None] * self.belief)
        bread = np.linalg.inv(square + belief)
        result: Array = bread @ (between * count / (count - 1) + belief) @ bread
        return result


def _doubts(problem: _Problem, coordinates: Array, deviations: Array, correlations: Array) -> list[str]:
    said = []
    far = np.abs(coordinates - problem.prior) / problem.spread
    if told := [f"{name} ({off:.1f})" for name, off in zip(problem.names, far.tolist(), strict=True) if off > _FAR]:
        text = f"further than {_FAR:g} spreads from their priors lie {', '.join(told)}: either the priors are wrong"
        said.append(f"{text}, or these stand for something that the model lacks")
    for index, each in enumerate(problem.settings.fitted):
        share = deviations[index] / each.spread
        if share > _POORLY_KNOWN and far[index] <= _FAR:
            text = f"{each.name} is hardly told by these swims: its error is {share:.0%} of the spread believed before"
            said.append(f"{text}; measure it otherwise, or take it as assumed")
        at = coordinates[index]
        if min(at - problem.low[index], problem.high[index] - at) < 1e-3 * (problem.high[index] - problem.low[index]):
            said.append(f"{each.name} lies at its bound {each.value(float(at)):g}: widen the bounds, or fix it")
    for row in range(len(problem.settings.fitted)):
        for column in range(row):
            if abs(together := correlations[row, column]) > _TOGETHER:
                pair = f"{problem.names[column]} and {problem.names[row]}"
                said.append(f"{pair} cannot be told apart (correlation {together:+.2f}): fix one of them")
    said.append(
        "the scale of all masses and forces together cannot be told by any swim: what a scale and a ruler gave, mass "
        "and tail size, sets it; nor can a servo's lag be told from the start of the beat and the amplitude factor"
    )
    return said


def fit(
    swims: Sequence[Swim],
    settings: Settings,
    seed: int = 0,
    starts: int = STARTS,
    told: Callable[[str], object] = lambda _: None,
) -> Fit:
    """Return the fish that fits swims best.

    Args:
        swims: Three or more, each checked.
        settings: What is fitted.
        seed: Of the starts' places.
        starts: Fits from places drawn around the prior; the first begins at the prior itself.
        told: Is given a line on each start.

    Raises:
        ValueError: Too few swims, nothing to fit, or numbers that the simulator refuses.
    """
    problem = _problem(swims, settings)
    random = np.random.default_rng(seed)
    found = []
    for number in range(starts):
        place = problem.prior + (0.5 * random.standard_normal(len(problem.prior)) * problem.spread if number else 0.0)
        problem.forget_starts()
        found.append(_descend(problem, np.clip(place, problem.low + 1e-9, problem.high - 1e-9), _FIRST_ROUNDS))
        told(f"start {number + 1} of {starts}: cost {found[-1][1]:.2f} after {_FIRST_ROUNDS} steps")
    problem.forget_starts()
    best, cost = _descend(problem, min(found, key=lambda each: each[1])[0], _ROUNDS)
    told(f"the best of them, followed to its end: cost {cost:.2f}")
    return _concluded(problem, best, cost)


def _problem(swims: Sequence[Swim], settings: Settings) -> _Problem:
    if len(swims) < FEWEST_SWIMS:
        given = checks.counted(len(swims), "swim")
        needed = f"needed are {FEWEST_SWIMS}, better 9, of two amplitudes and biases to both sides"
        msg = f"{given} cannot tell a fish: {needed}"
        raise ValueError(msg)
    problem = _Problem(swims, settings)
    if not problem.names:
        msg = "nothing is left to fit: every parameter is fixed"
        raise ValueError(msg)
    return problem


def refit(swims: Sequence[Swim], settings: Settings, near: Fit) -> Fit:
    """Return the fish that fits other swims best, from one that is near: where swims are left out.

    Raises:
        ValueError: As for `fit`.
    """
    problem = _problem(swims, settings)
    known = dict(zip(near.names, near.values, strict=True))
    by_name = {each.name: each for each in settings.fitted}
    place = [
        by_name[name].coordinate(float(known[name])) if name in by_name else float(known[name])
        for name in problem.names
    ]
    best, cost = _descend(problem, np.clip(place, problem.low + 1e-9, problem.high - 1e-9), _ROUNDS)
    return _concluded(problem, best, cost)


def _descend(problem: _Problem, place: Array, rounds: int) -> tuple[Array, float]:
    result = least_squares(
        problem.residuals,
        place,
        jac=problem.jacobian,
        bounds=(problem.low, problem.high),
        x_scale=problem.spread,
        loss=_LOSS,
        max_nfev=rounds,
        ftol=1e-5,
        xtol=1e-5,
    )
    return result.x, float(result.cost)


def _concluded(problem: _Problem, best: Array, cost: float) -> Fit:
    covariance = problem.errors(best)
    deviations = np.sqrt(np.diag(covariance))
    correlations = covariance / np.outer(deviations, deviations)
    fitted = problem.settings.fitted
    values, low, high = (
        np.array([each.unbounded(at) for each, at in zip(fitted, place, strict=False)] + place[len(fitted) :])
        for place in (best.tolist(), (best - deviations).tolist(), (best + deviations).tolist())
    )
    doubts = tuple(_doubts(problem, best, deviations, correlations))
    return Fit(problem.model(best), problem.names, values, low, high, correlations, cost, doubts)
