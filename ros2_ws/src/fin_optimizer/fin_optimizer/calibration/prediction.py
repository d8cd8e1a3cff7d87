"""A swim predicted: its start is found from its first moments, the rest follows from the model alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.dynamics import HEADING, SURGE, SWAY, YAW_RATE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_optimizer.calibration.model import Tank
    from fin_optimizer.calibration.swims import Swim

    Array = NDArray[np.float64]

GIVEN = 1.0
"""s from which the start is found, unless told otherwise."""
# Noise of a sample: m/s, m/s, rad/s, rad, m. About what the best models leave over within a beat.
NOISE = {"forward": 0.005, "lateral": 0.008, "yaw_rate": 0.08, "heading": 0.05, "position": 0.006}
_START_SPREAD = np.array([0.03, 0.03, 0.5])  # around the mean speed given and none
_PHASES = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
_REACH = np.array([1e-3, 1e-3, 1e-2, 1e-2])  # steps of the derivatives
_ROUNDS, _ROUNDS_FROM_NEAR = 12, 4
_ATTEMPTS = 5
_LOST = 1e3  # residual of what could not be computed


@dataclass(frozen=True)
class Prediction:
    """What a model says of a swim, in the tank's frame, at the swim's own times.

    Attributes:
        start: Forward and sideways velocity, yaw rate and phase of the beat at time 0, shape (4,).
        forward: m/s, as the tracker would record it, (S,).
        lateral: m/s, of the tracked point, (S,).
        yaw_rate: rad/s, (S,).
        heading: rad, (S,).
        position: m, of the tracked point, (S, 2); starts anywhere where no position was recorded.
    """

    start: Array
    forward: Array
    lateral: Array
    yaw_rate: Array
    heading: Array
    position: Array


def _placed(tank: Tank, swim: Swim, start: Array, count: int, given: int) -> Prediction:
    """Return the first ``count`` samples of a swim, laid over its first ``given`` ones by heading and position."""
    motion = tank.swim(swim, start, swim.time[:count])
    turn = float(np.mean(swim.heading[:given] - motion[:given, HEADING]))
    heading = motion[:, HEADING] + turn
    ahead, sine, cosine = tank.model.ahead, math.sin(turn), math.cos(turn)
    x = cosine * motion[:, 0] - sine * motion[:, 1] + ahead * np.cos(heading)
    y = sine * motion[:, 0] + cosine * motion[:, 1] + ahead * np.sin(heading)
    position = np.stack((x, y), axis=1)
    if swim.position is not None:
        position += np.mean(swim.position[:given] - position[:given], axis=0)
    return Prediction(
        start,
        tank.model.speed_factor * motion[:, SURGE],
        motion[:, SWAY] + ahead * motion[:, YAW_RATE],
        motion[:, YAW_RATE],
        heading,
        position,
    )


def differences(swim: Swim, predicted: Prediction) -> dict[str, Array]:
    """Return predicted less recorded over the noise of a sample, by name, each of the prediction's length."""
    count = len(predicted.heading)
    result = {
        name: (getattr(predicted, name) - getattr(swim, name)[:count]) / NOISE[name]
        for name in ("forward", "lateral", "yaw_rate", "heading")
    }
    if swim.position is not None:
        apart = (predicted.position - swim.position[:count]) / NOISE["position"]
        result["x"], result["y"] = apart[:, 0], apart[:, 1]
    return {name: np.nan_to_num(each, nan=_LOST, posinf=_LOST, neginf=-_LOST) for name, each in result.items()}


def samples_given(swim: Swim, given: float) -> int:
    """Return how many samples a swim's first ``given`` seconds have, three at least."""
    return max(3, int(np.searchsorted(swim.time, given, side="right")))


class Start:
    """The start of one swim under a model: the least squares over its first moments, by Levenberg and Marquardt."""

    def __init__(self, swim: Swim, given: float = GIVEN) -> None:
        """Look at the first ``given`` s of a swim."""
        self.swim, self.given = swim, samples_given(swim, given)
        self._expected = np.array([float(np.mean(swim.forward[: self.given])), 0.0, 0.0])

    def residuals(self, tank: Tank, start: Array) -> Array:
        """Return what a start leaves over of the first moments, and of what is expected of a start."""
        placed = _placed(tank, self.swim, start, self.given, self.given)
        return np.concatenate([*differences(self.swim, placed).values(), (start[:3] - self._expected) / _START_SPREAD])

    def jacobian(self, tank: Tank, start: Array, residuals: Array) -> Array:
        """Return the derivatives of the residuals by the start, shape (R, 4)."""
        moved = [self.residuals(tank, start + reach) for reach in np.diag(_REACH)]
        return np.stack([(each - residuals) / reach for each, reach in zip(moved, _REACH, strict=True)], axis=1)

    def find(self, tank: Tank, near: Array | None = None) -> Array:
        """Return the best start, shape (4,); of those around, or from ``near``."""
        if near is not None:
            return self._descend(tank, near, _ROUNDS_FROM_NEAR)[0]
        swim, first = self.swim, slice(0, 3)
        seen = [float(np.mean(each[first])) for each in (swim.lateral, swim.yaw_rate)]
        guesses = [np.array([self._expected[0], *seen, phase]) for phase in _PHASES]
        return min((self._descend(tank, guess, _ROUNDS) for guess in guesses), key=lambda found: found[1])[0]

    def _descend(self, tank: Tank, start: Array, rounds: int) -> tuple[Array, float]:
        residuals = self.residuals(tank, start)
        cost, damping = float(residuals @ residuals), 1e-3
        for _ in range(rounds):
            jacobian = self.jacobian(tank, start, residuals)
            square, slope = jacobian.T @ jacobian, jacobian.T @ residuals
            for _ in range(_ATTEMPTS):
                damped = square + damping * np.diag(np.diag(square)) + 1e-9 * np.eye(4)
                step = -np.linalg.solve(damped, slope)
                tried = self.residuals(tank, start + step)
                if float(tried @ tried) < cost:
                    break
                damping *= 10.0
            else:
                break
            start, residuals, cost = start + step, tried, float(tried @ tried)
            damping = max(0.1 * damping, 1e-9)
            if np.all(np.abs(step) < 0.3 * _REACH):
                break
        return start, cost

    def follow(self, tank: Tank, start: Array) -> Prediction:
        """Return the whole swim from a start."""
        return _placed(tank, self.swim, start, len(self.swim.time), self.given)


def predict(tank: Tank, swim: Swim, given: float = GIVEN) -> Prediction:
    """Return what a model says of a swim of which it is shown the first ``given`` seconds.

    Raises:
        ValueError: The model cannot swim it: the computation breaks off.
    """
    start = Start(swim, given)
    found = start.follow(tank, start.find(tank))
    known = np.isfinite(found.forward)
    if not known.all():
        until = f"the computation breaks off {swim.time[int(np.argmin(known))]:.2f} s after its start"
        msg = f"{swim.name}: the fish cannot swim it, {until}: it is no fish of this kind, or a number of it is far off"
        raise ValueError(msg)
    return found
