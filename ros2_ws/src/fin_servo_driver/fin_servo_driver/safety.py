"""The limits that every set-point passes, and the watchdog on its commander. Nothing here knows ROS or a port.

Order of the limits: finite first, then angle, then rate, then the servo's own range. NaN passes comparisons, `min`,
`max` and `numpy.clip` unseen, so it is looked for before anything is compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fin_servo_driver.robot_file import ServoJoint


@dataclass(frozen=True)
class SetPoint:
    """What is sent to one servo.

    Attributes:
        angle: Of the joint from its centre, rad.
        position: Of the servo, in its own unit (us of pulse, ticks).
        limited: Whether a limit changed what was asked for.
    """

    angle: float
    position: float
    limited: bool


class SetPointLimiter:
    """Keeps the set-points of one joint inside its limits, whatever is asked for."""

    def __init__(self, joint: ServoJoint, longest_elapsed: float) -> None:
        """Start at neutral.

        Args:
            joint: Calibration and limits of the joint.
            longest_elapsed: s that count for the rate limit at most: a driver that was held up must not make good
                in one jump what it has missed.
        """
        self._joint = joint
        self._longest_elapsed = longest_elapsed
        self._last = 0.0

    def restart(self, angle: float) -> None:
        """Begin anew from ``angle`` rad, where the tail stands; neutral if that is not known (not finite)."""
        self._last = angle if math.isfinite(angle) else 0.0

    def limit(self, angle: float, elapsed: float) -> SetPoint:
        """Return the set-point nearest to ``angle`` rad that is allowed ``elapsed`` s after the last one."""
        allowed = within_angle(angle, self._joint.sweep)
        allowed = within_rate(allowed, self._last, self._joint.rate, elapsed, self._longest_elapsed)
        position = self._joint.position_at(allowed)
        inside = min(max(position, self._joint.lowest), self._joint.highest)
        if inside != position:
            allowed = self._joint.angle_at(inside)
        self._last = allowed
        return SetPoint(allowed, inside, limited=allowed != angle)


def within_angle(angle: float, sweep: float) -> float:
    """Return the angle inside [-sweep, sweep]; an angle that is not finite becomes neutral, 0."""
    if not math.isfinite(angle):
        return 0.0
    return min(max(angle, -sweep), sweep)


def within_rate(angle: float, last: float, rate: float, elapsed: float, longest_elapsed: float) -> float:
    """Return the angle nearest to ``angle`` that a joint reaches from ``last`` in ``elapsed`` s at ``rate`` rad/s.

    An elapsed time that is not finite or not positive allows no motion.
    """
    if not math.isfinite(elapsed) or elapsed <= 0.0:
        return last
    reach = rate * min(elapsed, longest_elapsed)
    return min(max(angle, last - reach), last + reach)


class CommandWatchdog:
    """Says whether the commander is alive. Latched: once expired, only the next accepted command revives it."""

    def __init__(self) -> None:
        """Start expired: nobody has commanded anything yet."""
        self._fed: float | None = None

    def feed(self, time: float) -> None:
        """Note an accepted command received at ``time`` s; a rejected one must not come here."""
        self._fed = time if math.isfinite(time) else None

    def forget(self) -> None:
        """Expire now."""
        self._fed = None

    def expired(self, now: float, timeout: float | None) -> bool:
        """Whether no command was accepted within the last ``timeout`` s; None waits for ever, once fed.

        The comparison is written so that a NaN anywhere counts as expired.
        """
        if self._fed is None:
            return True
        if timeout is None:
            return False
        if not now - self._fed <= timeout:
            self.forget()
            return True
        return False
