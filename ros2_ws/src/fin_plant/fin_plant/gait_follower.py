"""How a tail follows a sequence of gaits: from one to the next without a jump, and never much faster than they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_plant.gait import MAXIMUM_JOINTS, Gait, require_rows, same_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

LARGEST_SPEED_UP = 1.5
"""Most that the rate of a joint may be in a change of gait, over the larger of the two gaits' own peak rates."""
LONGEST_RAMP = 10.0
"""s that a change may be lengthened to, so that a tail that hardly beats gets to its new gait at all."""
_SHORTEST_RAMP = 0.01
_NO_BEAT = 1e-6
"""rad/s below which a joint stands: it moves no servo by a step in a day."""
_TURNING_RATE = 2.0
"""rad/s at most for a joint that turns from one place to another, without a beat before or after."""


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
    argument: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    bias: NDArray[np.float64],
    limit: float | NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the wave of a tail that knows left (1), off (0) and right (-1) only, as relays drive it.

    The on-windows are centred on the strokes' peaks; their widths are 2 asin((amplitude + bias) / limit) on the left
    and 2 asin((amplitude - bias) / limit) on the right, the fractions kept in [0, 1]: amplitude becomes duty, bias
    becomes asymmetry.

    Args:
        argument: The sine's argument 2 pi f t + phase, rad, any shape.
        amplitude: rad, same shape.
        bias: rad, same shape.
        limit: Angle at which a stroke fills its half beat, rad, above 0; one for all, or of each joint.
    """
    sine = np.sin(argument)
    left, right = (np.clip((amplitude + side * bias) / limit, 0.0, 1.0) for side in (1.0, -1.0))
    is_left, is_right = sine > np.sqrt(1.0 - left**2), -sine > np.sqrt(1.0 - right**2)
    wave: NDArray[np.float64] = is_left.astype(float) - is_right.astype(float)
    return wave


@dataclass(frozen=True)
class _Transition:
    """From one set of drives to the next: the one beat fades out while the other fades in, by the smooth step.

    So every value may change at once: phases need no way round the circle, and nothing beats faster than the faster of
    the two but for the fading itself, whose rate falls with the ramp's length. All arrays have shape (joints, ...).

    Attributes:
        start: s.
        ramp_time: s.
        source: Drives before, rows (joints, 4).
        target: Drives after, rows (joints, 4).
        source_angle: The whole argument of the source's sine at ``start``, its phase included.
        target_angle: That of the target's sine.
    """

    start: float
    ramp_time: float
    source: NDArray[np.float64]
    target: NDArray[np.float64]
    source_angle: NDArray[np.float64]
    target_angle: NDArray[np.float64]

    @property
    def end(self) -> float:
        return self.start + self.ramp_time

    def target_angle_at(self, time: float) -> NDArray[np.float64]:
        """Return the argument of the target's sine at ``time`` s."""
        if math.isinf(self.start):
            return self.target_angle
        return self.target_angle + 2.0 * math.pi * self.target[:, 1] * (time - self.start)

    def beat(self, times: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Return the beat as a rotating pointer, and the bias, each with two derivatives, shape (3, times, joints).

        The joint's angle is the bias and the pointer's imaginary part.
        """
        elapsed = (times - self.start)[:, None]
        if self.ramp_time > 0.0:
            fade = smooth_step(elapsed / self.ramp_time)[:3]
            fade = fade / np.array([1.0, self.ramp_time, self.ramp_time**2])[:, None, None]
        else:
            fade = np.stack((np.ones_like(elapsed), np.zeros_like(elapsed), np.zeros_like(elapsed)))
        value, slope, curvature = fade
        pointers = []
        for rows, angle in ((self.source, self.source_angle), (self.target, self.target_angle)):
            turning = 2.0j * math.pi * rows[:, 1]
            pointer = rows[:, 0] * np.exp(1j * angle + turning * elapsed)
            pointers.append((pointer, turning * pointer, turning**2 * pointer))
        old, new = pointers
        beat = np.stack(
            (
                (1.0 - value) * old[0] + value * new[0],
                (1.0 - value) * old[1] + value * new[1] + slope * (new[0] - old[0]),
                (1.0 - value) * old[2]
                + value * new[2]
                + 2.0 * slope * (new[1] - old[1])
                + curvature * (new[0] - old[0]),
            )
        )
        before, after = self.source[:, 3], self.target[:, 3]
        bias = fade * (after - before)
        bias[0] += before
        return beat, bias

    def excess(self) -> float:
        """Return the highest rate over what `LARGEST_SPEED_UP` allows, at whatever point of its beat the change is."""
        own = 2.0 * math.pi * np.maximum(self.source[:, 0] * self.source[:, 1], self.target[:, 0] * self.target[:, 1])
        allowed = np.where(own > _NO_BEAT, LARGEST_SPEED_UP * own, _TURNING_RATE)
        # The two beats come into and out of step so many times: each time has to be seen.
        turns = np.abs(self.source[:, 1] - self.target[:, 1]).max() * self.ramp_time
        count = min(64 + int(32.0 * turns), 4096)
        beat, bias = self.beat(self.start + self.ramp_time * np.linspace(0.0, 1.0, count))
        return float(np.max((np.abs(beat[1]) + np.abs(bias[1])).max(axis=0) / allowed))


class GaitFollower:
    """What a tail does under a sequence of gaits: starts, stops and changes are ramped and continuous.

    The angle, its rate and its acceleration are continuous functions of time. A gait that arrives during a ramp
    waits for the ramp's end; of several the last one counts. From neutral, joint j moves as
    ramp(t) (bias + amplitude sin(2 pi frequency t + phase)) with t from the start. A change of frequency alone lets
    the beat go on with the phase that it has halfway through the ramp.

    Whatever changes, and whenever, no joint gets faster than `LARGEST_SPEED_UP` times the larger of the two gaits' own
    peak rates, 2 pi frequency amplitude: a ramp that is too short for that is lengthened, to `LONGEST_RAMP` at most.
    """

    def __init__(self, joints: int, ramp_time: float, *, as_asked: bool = False) -> None:
        """Start at neutral.

        Args:
            joints: Number of driven joints.
            ramp_time: Duration of a change in s.
            as_asked: Lengthen no ramp, and change at once, with a jump, where it is 0: for a swim that is computed
                from rest, where no tail can be hurt and the ramp is part of the question.
        """
        self._as_asked = as_asked
        self.set_ramp_time(ramp_time)
        neutral = np.zeros((checks.whole_number("driven joints", joints, 1, MAXIMUM_JOINTS), 4))
        self._transitions = [_Transition(-math.inf, 0.0, neutral, neutral, np.zeros(joints), np.zeros(joints))]

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
    def ramp_time(self) -> float:
        """Duration in s of the last change, lengthened where it had to be."""
        return self._transitions[-1].ramp_time

    @property
    def moves(self) -> bool:
        """Whether a gait other than neutral is under way or awaited."""
        return Gait.from_rows(self.target).moves

    def is_still(self, time: float) -> bool:
        """Return whether neither a gait nor the ramp of the last one's end moves anything at ``time`` s."""
        return not self.moves and time >= self._transitions[-1].end

    def command(self, gait: Gait, time: float) -> None:
        """Follow ``gait`` from ``time`` s on, or from the end of the ramp under way.

        Raises:
            ValueError: The gait has another number of joints.
        """
        require_rows(gait, self.joints)
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
        last = self._transitions[-1]
        if same_rows(last.target, target):
            return
        start = max(time, last.end)
        ramp_time = self._ramp_time if self._as_asked else max(self._ramp_time, _SHORTEST_RAMP)
        transition = _transition(last, target, start, ramp_time)
        while not self._as_asked and ramp_time < LONGEST_RAMP and (excess := transition.excess()) > 1.0:
            # The fading's own rate goes down in proportion, the beat's share of the rate does not.
            ramp_time = min(ramp_time * min(max(excess, 1.05), 2.0), LONGEST_RAMP)
            transition = _transition(last, target, start, ramp_time)
        self._transitions.append(transition)

    def waves(
        self, times: Sequence[float] | NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the sine's argument, its amplitude and the bias, rad, each of shape (times, joints)."""
        at = np.asarray(times, dtype=float)
        result = np.zeros((3, len(at), self.joints))
        for transition in self._transitions:
            chosen = at >= transition.start
            if math.isfinite(transition.start) and chosen.any():
                beat, bias = transition.beat(at[chosen])
                result[:, chosen] = np.angle(beat[0]), np.abs(beat[0]), bias[0]
        return result[0], result[1], result[2]

    def levels(
        self, times: Sequence[float] | NDArray[np.float64], limit: float | NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the gait as a `three_level` wave, shape (times, joints); ``limit`` in rad as there."""
        return three_level(*self.waves(times), limit)

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
                beat, bias = transition.beat(at[chosen])
                result[chosen] = np.moveaxis(bias + beat.imag, 0, 2)
        return result


def _transition(last: _Transition, target: NDArray[np.float64], start: float, ramp_time: float) -> _Transition:
    """Return the change from what ``last`` led to, its phases as `GaitFollower` says."""
    source, angle = last.target, last.target_angle_at(start)
    turn = math.pi * ramp_time  # of a beat at 1 Hz in half the ramp
    shift = turn * (source[:, 1] - target[:, 1]) + target[:, 2] - source[:, 2]
    # A joint that stands still takes the new gait from the phase's own zero.
    target_angle = np.where(source[:, 0] == 0.0, target[:, 2], angle + shift)
    return _Transition(start, ramp_time, source, target, angle, target_angle)
