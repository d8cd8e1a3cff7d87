"""From a gait to what each servo is sent, evaluated at the moment of sending."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fin_plant.gait import Gait, GaitFollower, smooth_step
from fin_servo_driver.safety import SetPointLimiter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_servo_driver.robot_file import ServoJoint

_LATE_PERIODS = 3.0
"""A gait that is later than this when its first set-point is sent is ramped from then on."""

Outputs = dict[int, float]
"""What is sent to each channel: a position in the device's unit, or 1 and 0 for a relay on and off."""


class Motion(Protocol):
    """A tail that follows gaits: servos or relays.

    Attributes:
        angles: Of the joints as last sent, rad.
        limited: How many set-points a limit has changed.
        stop_time: s in which the tail returns to neutral when its commander is gone.
    """

    angles: list[float]
    limited: int
    stop_time: float

    @property
    def joints(self) -> int:
        """Number of driven joints."""

    def allowed(self, gait: Gait, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait inside the limits (rad, Hz), or raise ValueError for one that cannot be driven at all."""

    def restart(self, ramp_time: float, measured: Mapping[int, float]) -> None:
        """Begin anew from neutral, or from the positions measured on the channels."""

    def command(self, gait: Gait, time: float) -> None:
        """Follow a gait from ``time`` s on."""

    def outputs(self, now: float, scale: float) -> Outputs:
        """Return what to send at ``now`` s; ``scale`` goes from 1 to 0 while the tail is stopped."""

    def neutral(self) -> Outputs:
        """Return what straightens the tail."""

    def release(self, now: float) -> None:
        """Note that the device was disabled at ``now`` s."""


class ServoMotion:
    """A tail of servos."""

    def __init__(self, joints: Sequence[ServoJoint], period: float, stop_time: float = 0.4) -> None:
        """Start at neutral.

        Args:
            joints: Calibration and limits, from the head to the tail.
            period: s between two set-points.
            stop_time: s in which the tail returns to neutral when its commander is gone; a joint whose rate does not
                allow that gets twice the time of its way.
        """
        self.angles = [0.0] * len(joints)
        self.limited = 0
        self.stop_time = max(stop_time, *(2.0 * joint.reachable / joint.rate for joint in joints))
        self._joints = tuple(joints)
        self._period = period
        self._limiters = [SetPointLimiter(joint, 2.0 * period) for joint in joints]
        self._follower = GaitFollower(len(joints), 0.0)
        self._late_start = -math.inf
        self._since: float | None = None
        self._last: float | None = None

    @property
    def joints(self) -> int:
        """Number of driven joints."""
        return len(self._joints)

    def allowed(self, gait: Gait, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait inside every joint's limits: angle, range of the servo, frequency, and rate.

        Where the rate is the limit the amplitude gives way, so that the beat keeps its frequency.

        Raises:
            ValueError: Another number of rows than the tail has joints.
        """
        require_rows(gait, self.joints)
        drives = []
        for drive, joint in zip(gait.joints, self._joints, strict=True):
            inside = drive.limited(min(sweep, joint.reachable), highest_frequency)
            peak_rate = 2.0 * math.pi * inside.frequency
            if inside.amplitude * peak_rate > joint.rate:
                inside = replace(inside, amplitude=joint.rate / peak_rate)
            drives.append(inside)
        return Gait(tuple(drives))

    def restart(self, ramp_time: float, measured: Mapping[int, float]) -> None:
        """Begin anew from neutral, or from where the servos say that they stand."""
        self._follower = GaitFollower(len(self._joints), ramp_time)
        self._late_start = -math.inf
        self._since = self._last = None
        for index, (limiter, joint) in enumerate(zip(self._limiters, self._joints, strict=True)):
            known = joint.channel in measured
            self.angles[index] = joint.angle_at(measured[joint.channel]) if known else 0.0
            limiter.restart(self.angles[index])

    def command(self, gait: Gait, time: float) -> None:
        """Follow a gait from ``time`` s on."""
        self._since = time if self._since is None else self._since
        self._follower.command(gait, time)

    def outputs(self, now: float, scale: float) -> Outputs:
        """Return the position of each channel at ``now`` s."""
        if self._last is None and self._since is not None and now - self._since > _LATE_PERIODS * self._period:
            self._late_start = now
        elapsed = self._period if self._last is None else now - self._last
        self._last = now
        wanted = self._late_ramp(now) * self._follower.motion([now])[0, :, 0]
        result: Outputs = {}
        for index, (limiter, joint) in enumerate(zip(self._limiters, self._joints, strict=True)):
            set_point = limiter.limit(scale * float(wanted[index]), elapsed)
            self.limited += set_point.limited
            self.angles[index] = set_point.angle
            result[joint.channel] = set_point.position
        return result

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


def require_rows(gait: Gait, joints: int) -> None:
    """Refuse a gait with another number of rows than the tail has joints.

    Raises:
        ValueError: It has.
    """
    if len(gait.joints) != joints:
        msg = f"gait has {len(gait.joints)} rows, the tail has {joints} driven joints: send one row a joint"
        raise ValueError(msg)
