"""Whether a tracked fish moves where it points: if not, its heading or its axes are not those of its positions.

Nothing here knows ROS.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

_NANO = 1e-9
_SPEED = 0.01
"""m/s; any current moves a slower fish."""


@dataclass(frozen=True)
class Rule:
    """How a fish may move.

    Attributes:
        span: s over which its motion is averaged.
        angle: rad, less than a right one; largest angle to its heading.
        drift: m/s; sideways velocity that is allowed beside it.
        turn_rate: rad/s, either way; a fish that turns as fast may move otherwise.
    """

    span: float
    angle: float
    drift: float = 0.0
    turn_rate: float = math.inf


RULES = (
    Rule(span=2.0, angle=math.radians(40.0)),
    Rule(span=4.0, angle=math.radians(20.0), drift=2e-3, turn_rate=0.08),
)
"""Two beats at 1 Hz average the tail's sway. Fish that turn slip by 30 degrees at most, and none breaks the second rule
(tests/data/tail_actuated_fish_*, without the runs that lost the fish); no beat of 10 degrees is taken for a turn."""


class Course:
    """Follows the mean motion of a fish over a time."""

    def __init__(self, rule: Rule) -> None:
        """Begin without a velocity."""
        self._rule = rule
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._velocities: deque[tuple[int, float, float, float]] = deque()
        self._sums = [0.0, 0.0, 0.0]

    def add(self, stamp: int, *velocity: float) -> str:
        """Take a velocity; return what is wrong with those of the last `span`, or nothing.

        Args:
            stamp: ns, later than all before.
            velocity: Forward and left in m/s, and the turning rate in rad/s.
        """
        forward, left, turn_rate = velocity
        self._velocities.append((stamp, forward, left, turn_rate))
        self._sums = [total + value for total, value in zip(self._sums, velocity, strict=True)]
        if (stamp - self._velocities[0][0]) * _NANO < self._rule.span:
            return ""
        forward, left, turn_rate = (total / len(self._velocities) for total in self._sums)
        while (stamp - self._velocities[0][0]) * _NANO >= self._rule.span:
            _, *oldest = self._velocities.popleft()
            self._sums = [total - value for total, value in zip(self._sums, oldest, strict=True)]
        return self._complaint(forward, left, turn_rate)

    def _complaint(self, forward: float, left: float, turn_rate: float) -> str:
        rule, speed = self._rule, math.hypot(forward, left)
        if speed < _SPEED or abs(turn_rate) >= rule.turn_rate:
            return ""
        if forward > 0.0 and abs(left) <= math.tan(rule.angle) * forward + rule.drift:
            return ""
        angle = math.degrees(math.atan2(left, forward))
        straight = "" if math.isinf(rule.turn_rate) else "it does not turn, and "
        return (
            f"{straight}for {rule.span:g} s the fish has moved at {speed:.3g} m/s, {angle:.0f} degrees to the left of "
            "where it points: do the tracker's heading and axes (x forward, y left, z up) belong to its positions?"
        )
