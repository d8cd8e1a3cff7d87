"""The gait, a sinusoid for each driven joint, and how a tail follows it without a jump."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

COLUMNS = ("amplitude", "frequency", "phase", "bias")
MAXIMUM_JOINTS = 20
# A phase is a position on the circle and a bias an angle of a hinge: a larger number is a mistake of unit.
_LARGEST_ANGLE = math.pi
_LARGEST_PHASE = 1000.0
_LARGEST_FREQUENCY = 100.0


@dataclass(frozen=True)
class JointDrive:
    """Drive of one joint: angle = bias + amplitude sin(2 pi frequency t + phase).

    Attributes:
        amplitude: rad, 0 to pi.
        frequency: Hz, 0 to 100.
        phase: rad.
        bias: rad, -pi to pi.

    Raises:
        ValueError: A value that is not finite or outside its range.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        limits = {
            "amplitude": (0.0, _LARGEST_ANGLE, "rad"),
            "frequency": (0.0, _LARGEST_FREQUENCY, "Hz"),
            "phase": (-_LARGEST_PHASE, _LARGEST_PHASE, "rad"),
            "bias": (-_LARGEST_ANGLE, _LARGEST_ANGLE, "rad"),
        }
        for name, (low, high, unit) in limits.items():
            value = checks.number(f"gait {name}", getattr(self, name), low, high, unit=unit)
            object.__setattr__(self, name, value)

    def limited(self, sweep: float, highest_frequency: float) -> JointDrive:
        """Return the drive with |bias| + amplitude at most ``sweep`` rad; the bias is kept before the amplitude."""
        bias = min(max(self.bias, -sweep), sweep)
        return replace(
            self,
            amplitude=min(self.amplitude, sweep - abs(bias)),
            frequency=min(self.frequency, highest_frequency),
            bias=bias,
        )

    @property
    def moves(self) -> bool:
        """Whether the joint is driven away from neutral."""
        return self.bias != 0.0 or self.amplitude > 0.0


@dataclass(frozen=True)
class Gait:
    """Drives of the tail's driven joints, from the head to the tail.

    Raises:
        ValueError: No joint, or more than a chain can have.
    """

    joints: tuple[JointDrive, ...]

    def __post_init__(self) -> None:
        checks.whole_number("number of driven joints", len(self.joints), 1, MAXIMUM_JOINTS)

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> Gait:
        """Build a gait from an array (joints, 4) with the columns amplitude, frequency, phase, bias.

        Raises:
            ValueError: Another shape, or a value that is refused; the message names joint and column.
        """
        table = np.asarray(rows, dtype=float)
        if table.ndim != 2 or table.shape[1] != len(COLUMNS):  # noqa: PLR2004
            msg = f"gait has shape {table.shape}: needed is one row a driven joint, columns {', '.join(COLUMNS)}"
            raise ValueError(msg)
        joints = []
        for index, row in enumerate(table, start=1):
            try:
                joints.append(JointDrive(*map(float, row)))
            except ValueError as error:
                msg = f"joint {index}: {error}"
                raise ValueError(msg) from None
        return cls(tuple(joints))

    def rows(self) -> NDArray[np.float64]:
        """Return the gait as an array (joints, 4) with the columns of ``COLUMNS``."""
        return np.array([[getattr(joint, name) for name in COLUMNS] for joint in self.joints])

    def limited(self, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait with every joint inside the limits (rad, Hz)."""
        return Gait(tuple(joint.limited(sweep, highest_frequency) for joint in self.joints))

    @property
    def moves(self) -> bool:
        """Whether any joint is driven away from neutral."""
        return any(joint.moves for joint in self.joints)


def carangiform(amplitude: float, frequency: float) -> Gait:
    """Return the paper's gait: one driven joint, amplitude in rad and frequency in Hz."""
    return Gait((JointDrive(amplitude, frequency),))


# Amplitude relative to the tail joint's, and phase behind the joint in front, rad: the reference swims with two
# driven joints use 8 and 14 degrees, 0.9 rad apart. Three joints rise evenly to the same end.
_SUB_CARANGIFORM_AMPLITUDES = {2: (0.57, 1.0), 3: (0.3, 0.65, 1.0)}
_SUB_CARANGIFORM_LAG = 0.9


def sub_carangiform(amplitude: float, frequency: float, joints: int = 2, lag: float = _SUB_CARANGIFORM_LAG) -> Gait:
    """Return the gait of a tail with a peduncle: amplitude rises and phase lags from joint to joint towards the tail.

    Args:
        amplitude: Of the last joint, the fin's, in rad.
        frequency: Hz.
        joints: Driven joints, 2 or 3.
        lag: Phase of a joint behind the one in front of it, rad.

    Raises:
        ValueError: Another number of joints, or a drive that is refused.
    """
    checks.whole_number("driven joints of a sub-carangiform gait", joints, 2, 3)
    rising = _SUB_CARANGIFORM_AMPLITUDES[joints]
    return Gait(tuple(JointDrive(part * amplitude, frequency, phase=-lag * index) for index, part in enumerate(rising)))


def gait_preset(name: str, joints: int, amplitude: float, frequency: float) -> Gait:
    """Return the named gait, ``carangiform`` or ``sub_carangiform``, for a tail with so many driven joints.

    Raises:
        ValueError: An unknown name, or a gait that does not fit that tail.
    """
    checks.choice("gait", name, ("carangiform", "sub_carangiform"))
    if name == "sub_carangiform":
        return sub_carangiform(amplitude, frequency, joints)
    if joints != 1:
        msg = f"a carangiform tail has 1 driven joint, this one has {joints}: choose the gait sub_carangiform"
        raise ValueError(msg)
    return carangiform(amplitude, frequency)


PAPER_GAIT = carangiform(math.radians(15.0), 0.9)
"""Drive of the paper fin: 15 degrees either way (both papers) at 0.9 Hz (Clark et al. 2012)."""


def smooth_step(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return value, first and second derivative and integral from 0 of x^3 (10 - 15 x + 6 x^2), x clipped to [0, 1].

    Args:
        x: Any shape.

    Returns:
        Shape (4, ...): value, d/dx, d2/dx2, integral (which goes on growing with x beyond 1).
    """
    inside = np.clip(x, 0.0, 1.0)
    square = inside * inside
    value = square * inside * (10.0 + inside * (6.0 * inside - 15.0))
    slope = 30.0 * square * (1.0 - inside) ** 2
    curvature = 60.0 * inside * (1.0 - inside) * (1.0 - 2.0 * inside)
    integral = square * square * (2.5 + inside * (inside - 3.0)) + np.maximum(x - 1.0, 0.0)
    return np.stack((value, slope, curvature, integral))


def three_level(
    argument: NDArray[np.float64], amplitude: NDArray[np.float64], bias: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """Return the wave of a tail that knows left (1), off (0) and right (-1) only, as relays drive it.

    The on-windows are centred on the strokes' peaks; their widths are 2 asin((amplitude + bias) / limit) on the left
    and 2 asin((amplitude - bias) / limit) on the right, the fractions kept in [0, 1]: amplitude becomes duty, bias
    becomes asymmetry.

    Args:
        argument: The sine's argument 2 pi f t + phase, rad, any shape.
        amplitude: rad, same shape.
        bias: rad, same shape.
        limit: Angle at which a stroke fills its half beat, rad, above 0.
    """
    sine = np.sin(argument)
    left, right = (np.clip((amplitude + side * bias) / limit, 0.0, 1.0) for side in (1.0, -1.0))
    is_left, is_right = sine > np.sqrt(1.0 - left**2), -sine > np.sqrt(1.0 - right**2)
    wave: NDArray[np.float64] = is_left.astype(float) - is_right.astype(float)
    return wave


@dataclass(frozen=True)
class _Transition:
    """From one set of drives to the next: every parameter follows the smooth step, the phase angle stays continuous.

    All arrays have shape (joints,). ``angle`` is the sine's whole argument at ``start``, its phase included.
    """

    start: float
    ramp_time: float
    source: NDArray[np.float64]
    target: NDArray[np.float64]
    angle: NDArray[np.float64]

    @property
    def end(self) -> float:
        return self.start + self.ramp_time

    def sample(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return motion (times, joints, 3), angle and its first two derivatives, and the sine's argument."""
        elapsed = times - self.start
        if self.ramp_time > 0.0:
            value, slope, curvature, integral = smooth_step(elapsed / self.ramp_time)
            slope, curvature = slope / self.ramp_time, curvature / self.ramp_time**2
            integral = integral * self.ramp_time
        else:
            value, slope, curvature = np.ones_like(elapsed), np.zeros_like(elapsed), np.zeros_like(elapsed)
            integral = elapsed
        change = self.target - self.source
        value, slope, curvature = value[:, None, None], slope[:, None, None], curvature[:, None, None]
        now, rate, bend = self.source + change * value, change * slope, change * curvature
        amplitude, frequency, _, bias = np.moveaxis(now, 2, 0)
        amplitude_rate, frequency_rate, phase_rate, bias_rate = np.moveaxis(rate, 2, 0)
        amplitude_bend, _, phase_bend, bias_bend = np.moveaxis(bend, 2, 0)
        turns = self.source[:, 1] * elapsed[:, None] + change[:, 1] * integral[:, None]
        argument = self.angle + 2.0 * math.pi * turns + change[:, 2] * value[:, :, 0]
        speed = 2.0 * math.pi * frequency + phase_rate
        speed_rate = 2.0 * math.pi * frequency_rate + phase_bend
        sine, cosine = np.sin(argument), np.cos(argument)
        motion = np.stack(
            (
                bias + amplitude * sine,
                bias_rate + amplitude_rate * sine + amplitude * speed * cosine,
                bias_bend
                + (amplitude_bend - amplitude * speed**2) * sine
                + (2.0 * amplitude_rate * speed + amplitude * speed_rate) * cosine,
            ),
            axis=-1,
        )
        return motion, argument


class GaitFollower:
    """What a tail does under a sequence of gaits: starts, stops and changes are ramped and continuous.

    The angle, its rate and its acceleration are continuous functions of time. A gait that arrives during a ramp
    waits for the ramp's end; of several the last one counts. From neutral, joint j moves as
    ramp(t) (bias + amplitude sin(2 pi frequency t + phase)) with t from the start.
    """

    def __init__(self, joints: int, ramp_time: float) -> None:
        """Start at neutral.

        Args:
            joints: Number of driven joints.
            ramp_time: Duration of a change in s; 0 changes at once, with a jump.
        """
        self.set_ramp_time(ramp_time)
        neutral = np.zeros((checks.whole_number("driven joints", joints, 1, MAXIMUM_JOINTS), 4))
        self._transitions = [_Transition(-math.inf, 0.0, neutral, neutral, np.zeros(joints))]

    def set_ramp_time(self, ramp_time: float) -> None:
        """Take ``ramp_time`` s for every change from the next one on; a ramp under way ends as it began.

        Raises:
            ValueError: A time below 0 or not finite.
        """
        self._ramp_time = checks.number("ramp_time", ramp_time, 0.0, unit="s")

    @property
    def joints(self) -> int:
        """Number of driven joints."""
        return len(self._transitions[0].target)

    @property
    def target(self) -> NDArray[np.float64]:
        """Rows (joints, 4) of the gait under way or awaited."""
        return self._transitions[-1].target.copy()

    @property
    def moves(self) -> bool:
        """Whether a gait other than neutral is under way or awaited."""
        return Gait.from_rows(self.target).moves

    def command(self, gait: Gait, time: float) -> None:
        """Follow ``gait`` from ``time`` s on, or from the end of the ramp under way.

        Raises:
            ValueError: The gait has another number of joints.
        """
        if len(gait.joints) != self.joints:
            msg = f"gait has {len(gait.joints)} rows, the tail has {self.joints} driven joints: send one row a joint"
            raise ValueError(msg)
        self._change(gait.rows(), time)

    def stop(self, time: float) -> None:
        """Return to neutral from ``time`` s on, or from the end of the ramp under way."""
        neutral = self.target
        neutral[:, [0, 3]] = 0.0
        self._change(neutral, time)

    def _change(self, target: NDArray[np.float64], time: float) -> None:
        current = self._current(time)
        if self._transitions[-1] is not current:  # a later change waits already: this one takes its place
            self._transitions.pop()
        self._transitions = self._transitions[-1:]
        if np.array_equal(self._transitions[-1].target, target):
            return
        last = self._transitions[-1]
        start = max(time, last.end)
        if math.isinf(last.start):
            source, angle = last.target.copy(), np.zeros(len(target))
        else:
            source, angle = last.target.copy(), last.sample(np.array([start]))[1][0]
        # A joint that stands still takes frequency and phase of the new gait at once, from the phase's own zero.
        resting = source[:, 0] == 0.0
        source[resting, 1:3] = target[resting, 1:3]
        angle = np.where(resting, target[:, 2], angle)
        self._transitions.append(_Transition(start, self._ramp_time, source, target, angle))

    def levels(self, times: Sequence[float] | NDArray[np.float64], limit: float) -> NDArray[np.float64]:
        """Return the gait as a `three_level` wave, shape (times, joints); ``limit`` in rad as there."""
        at = np.asarray(times, dtype=float)
        result = np.zeros((len(at), self.joints))
        for transition in self._transitions:
            chosen = at >= transition.start
            if math.isfinite(transition.start) and chosen.any():
                elapsed = at[chosen] - transition.start
                done = smooth_step(elapsed / transition.ramp_time)[0] if transition.ramp_time else np.ones_like(elapsed)
                now = transition.source + (transition.target - transition.source) * done[:, None, None]
                argument = transition.sample(at[chosen])[1]
                result[chosen] = three_level(argument, now[:, :, 0], now[:, :, 3], limit)
        return result

    def _current(self, time: float) -> _Transition:
        begun = [transition for transition in self._transitions if transition.start <= time]
        return begun[-1] if begun else self._transitions[0]

    def motion(self, times: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the joints' motion at ``times`` s, none of them before the last change of gait but one.

        Returns:
            Shape (times, joints, 3): angle in rad, rate in rad/s, acceleration in rad/s^2.
        """
        at = np.asarray(times, dtype=float)
        result = np.zeros((len(at), self.joints, 3))
        for transition in self._transitions:
            chosen = at >= transition.start
            if math.isfinite(transition.start) and chosen.any():
                result[chosen] = transition.sample(at[chosen])[0]
        return result
