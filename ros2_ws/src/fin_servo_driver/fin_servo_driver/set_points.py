"""From a gait to what each servo is sent, evaluated at the moment of sending."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fin_plant.gait import JointLimits
from fin_plant.gait_follower import GaitFollower, smooth_step
from fin_servo_driver.safety import SetPointLimiter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_plant.gait import Gait
    from fin_servo_driver.robot_file import ServoJoint

_LATE_PERIODS = 3.0
"""A gait that is later than this when its first set-point is sent is ramped from then on."""
_SENDING = 1.05
"""A set-point is computed a little before it is sent. Where that takes long the rate holds between the frames as they
are sent, to this factor, and not only between the moments for which they were computed."""
_SHORTEST_FADE = 0.3
"""s in which a gait fades where the joints' rates allow it."""
_FADE_FOR_WAY = 1.5
"""The gait of a tail that needs longer than that to neutral fades in so many times the time of its way."""
_HOLD = 0.1
"""s at neutral before the force is taken away: five pulses, in which a hobby servo turns 30 degrees and more."""

Outputs = dict[int, float]
"""What is sent to each channel: a position in the device's unit, or 1 and 0 for a relay on and off."""


class Motion(Protocol):
    """A tail that follows gaits: servos or relays.

    Attributes:
        angles: Of the joints as last sent, rad.
        limited: How many set-points a limit has changed.
        hold_time: s for which a tail that is led to rest stays at neutral.
    """

    angles: list[float]
    limited: int
    hold_time: float

    @property
    def fade_time(self) -> float:
        """Time in s in which the gait fades from where the tail stands now."""

    @property
    def stop_time(self) -> float:
        """Time in s within which the tail is led to rest from where it stands; ticks that are late come on top."""

    @property
    def at_neutral(self) -> bool:
        """Whether neutral was the last that was sent."""

    @property
    def joints(self) -> int:
        """Number of driven joints."""

    @property
    def limits(self) -> tuple[JointLimits, ...]:
        """What each driven joint can do, from the head to the tail."""

    def is_still(self, now: float) -> bool:
        """Return whether the gait's end has faded at ``now`` s, and neutral was the last that was sent."""

    def allowed(self, gait: Gait, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait inside the limits (rad, Hz), or raise ValueError for one that cannot be driven at all."""

    def restart(self, ramp_time: float, measured: Mapping[int, float]) -> None:
        """Begin anew from neutral, or from the positions measured on the channels."""

    def command(self, gait: Gait, time: float) -> None:
        """Follow a gait from ``time`` s on."""

    def outputs(self, now: float, scale: float) -> Outputs:
        """Return what to send at ``now`` s; ``scale`` goes from 1 to 0 while the tail is stopped."""

    def sent(self, at: float) -> None:
        """Note that the last outputs were sent by ``at`` s."""

    def not_sent(self) -> None:
        """Note that the last outputs were not sent: the tail still stands where it stood before."""

    def stand_at(self, measured: Mapping[int, float]) -> None:
        """Note where the servos stand, by the positions measured on the channels; neutral where none is."""

    def neutral(self) -> Outputs:
        """Return what straightens the tail."""

    def release(self, now: float) -> None:
        """Note that the device was disabled at ``now`` s."""


class ServoMotion:
    """A tail of servos."""

    hold_time = _HOLD

    def __init__(self, joints: Sequence[ServoJoint], period: float) -> None:
        """Start at neutral.

        Args:
            joints: Calibration and limits, from the head to the tail.
            period: s between two set-points.
        """
        self.angles = [0.0] * len(joints)
        self.limited = 0
        self._joints = tuple(joints)
        self._period = period
        self._limiters = [SetPointLimiter(joint, 2.0 * period) for joint in joints]
        self._follower = GaitFollower(len(joints), 0.0)
        self._late_start = -math.inf
        self._since: float | None = None
        self._last: float | None = None
        self._sent_at = -math.inf
        self._before: tuple[list[float], float | None] = (list(self.angles), None)

    @property
    def joints(self) -> int:
        """Number of driven joints."""
        return len(self._joints)

    @property
    def limits(self) -> tuple[JointLimits, ...]:
        """What each driven joint can do, from the head to the tail."""
        return tuple(JointLimits(joint.reachable, joint.rate) for joint in self._joints)

    @property
    def _way(self) -> float:
        """Time in s that the tail needs to neutral from where it stands, each joint at its rate."""
        pairs = zip(self.angles, self._joints, strict=True)
        return max(abs(angle) / joint.rate for angle, joint in pairs)

    @property
    def fade_time(self) -> float:
        """Time in s in which the gait fades from where the tail stands now."""
        return max(_SHORTEST_FADE, _FADE_FOR_WAY * self._way)

    @property
    def stop_time(self) -> float:
        """Time in s within which the tail is led to rest from where it stands, wherever the fading gait pulls it to."""
        farthest = max(joint.reachable / joint.rate for joint in self._joints)
        return self.fade_time + max(self._way, farthest) + self.hold_time

    @property
    def at_neutral(self) -> bool:
        """Whether neutral was the last that was sent."""
        return not any(self.angles)

    def is_still(self, now: float) -> bool:
        """Return whether the gait's end has faded at ``now`` s, and neutral was the last that was sent."""
        return self._follower.is_still(now) and self.at_neutral

    def allowed(self, gait: Gait, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait inside every joint's limits: angle, range of the servo, frequency, and rate.

        Where the rate is the limit the amplitude gives way, so that the beat keeps its frequency.

        Raises:
            ValueError: Another number of rows than the tail has joints.
        """
        return gait.limited(sweep, highest_frequency, self.limits)

    def restart(self, ramp_time: float, measured: Mapping[int, float]) -> None:
        """Begin anew from neutral, or from where the servos say that they stand."""
        self._follower = GaitFollower(len(self._joints), ramp_time)
        self._late_start = -math.inf
        self._since = self._last = None
        self.stand_at(measured)

    def stand_at(self, measured: Mapping[int, float]) -> None:
        """Note where the servos stand, by the positions measured on the channels; neutral where none is."""
        for index, (limiter, joint) in enumerate(zip(self._limiters, self._joints, strict=True)):
            angle = joint.angle_at(measured.get(joint.channel, joint.centre))
            self.angles[index] = angle if math.isfinite(angle) else 0.0
            limiter.restart(self.angles[index])

    def command(self, gait: Gait, time: float) -> None:
        """Follow a gait from ``time`` s on."""
        self._since = time if self._since is None else self._since
        self._follower.command(gait, time)

    def outputs(self, now: float, scale: float) -> Outputs:
        """Return the position of each channel at ``now`` s."""
        if self._last is None and self._since is not None and now - self._since > _LATE_PERIODS * self._period:
            self._late_start = now
        elapsed = self._period if self._last is None else min(now - self._last, _SENDING * (now - self._sent_at))
        self._before = (list(self.angles), self._last)
        self._last = now
        wanted = self._late_ramp(now) * self._follower.motion([now])[0, :, 0]
        result: Outputs = {}
        for index, (limiter, joint) in enumerate(zip(self._limiters, self._joints, strict=True)):
            set_point = limiter.limit(scale * float(wanted[index]), elapsed)
            self.limited += set_point.limited
            self.angles[index] = set_point.angle
            result[joint.channel] = set_point.position
        return result

    def sent(self, at: float) -> None:
        """Note that the last outputs were sent by ``at`` s."""
        self._sent_at = at

    def not_sent(self) -> None:
        """Note that the last outputs were not sent: the tail still stands where it stood before."""
        angles, self._last = self._before
        self.angles[:] = angles
        for limiter, angle in zip(self._limiters, angles, strict=True):
            limiter.restart(angle)

    def _late_ramp(self, now: float) -> float:
        """Return a factor from 0 to 1: the tail starts late from rest, and the gait keeps the phase it has by then."""
        elapsed, ramp_time = now - self._late_start, self._follower.ramp_time
        return float(smooth_step(np.array(elapsed / ramp_time))[0]) if elapsed < ramp_time else 1.0

    def neutral(self) -> Outputs:
        """Return the centres."""
        return {joint.channel: joint.centre for joint in self._joints}

    def release(self, now: float) -> None:
        """Note that the servos hold no angle any more."""
        del now
        self.angles = [0.0] * len(self._joints)
