"""Poses of a driven fish that a tracker gives without seeing it, or sees in steps that are too coarse.

A camera's noise and a tail that beats change every coordinate with each picture. The last pose once more, one
coordinate that stands, a straight line, and steps that no velocity can be seen in are no pictures of a swim.
Nothing here knows ROS.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import takewhile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fin_servo_driver.pose_checks import Limits, Pose

COORDINATES = ("x", "y", "heading")

_NANO = 1e-9
_FIRST_MOVE = 0.5
"""s after the start of a swim in which a resting fish may still be where it was: half a beat at 1 Hz."""
_POSITION_EQUAL = 5.0
"""Times `longest_equal` that the position alone may stay equal: a rounded one changes more seldom than the heading."""
_ONE_EQUAL = 10.0
"""The same for one coordinate alone: a fish may swim along an axis of its tank."""
_LINE = 5.0
"""The same for poses on a straight line."""
_LINE_WIDTH, _LINE_TURN = 1e-5, 3e-4
"""m and rad: a tail that beats with 0.1 Hz or faster moves the fish farther from a line of 0.5 s, as does any noise."""
_FEWEST_IN_A_LINE = 8
_LINE_PART = 0.8
"""Part of that time that the poses on it must span."""
_KEPT = 20.0
"""The same for which poses are kept, to look whether a tracker rounds."""
_STILL_PART = 0.25
"""Part of the pictures in which a coordinate does not change, from which on a tracker may round it."""
_WHOLE = 0.02
"""How far multiples of one step may be from whole ones."""


class LostFish:
    """Looks whether poses can be those of a fish that is seen.

    Attributes:
        equal_for: s for which the newest poses have been equal to the last bit.
        equal_since: Stamp in ns of the first of them.
    """

    def __init__(self, limits: Limits, coarsest: float) -> None:
        """Begin without a pose.

        Args:
            limits: What a camera can do.
            coarsest: m; the largest step of rounded positions in which a velocity is seen.
        """
        self._limits = limits
        self._coarsest = coarsest
        self._swims: bool | None = None
        self._swims_since = 0
        self.forget()

    def forget(self) -> None:
        """Begin anew with the next pose."""
        self._newest: deque[Pose] = deque()
        self._changes: deque[tuple[float, ...]] = deque()
        self._still = dict.fromkeys(COORDINATES, 0)
        self._since = dict.fromkeys(COORDINATES, 0)
        self._place_since = 0
        self.equal_since = 0
        self.equal_for = 0.0

    def plant_says(self, *, swims: bool, since: int) -> None:
        """Take whether the fish is driven, and since when by the plant's clock in ns: a resting one may stand still."""
        self._swims, self._swims_since = swims, since

    @property
    def stands_still(self) -> bool:
        """Whether poses are equal for longer than a camera's can be in a swim."""
        return self.equal_for > self._limits.longest_equal

    def standstill(self) -> str:
        """Return what is known of poses that are equal to the last bit."""
        return (
            f"poses have been equal to the last bit for {self.equal_for:.2f} s: a tracker that has lost the fish and "
            "repeats its last pose, or one that rounds"
        )

    def complaint(self, pose: Pose) -> tuple[str, str] | None:
        """Take a pose; return the reason and the text of what no fish does that is seen, or None.

        One that is older than others is not looked at. Without a word of the plant only poses that are equal are
        complained about: more is known of a driven fish alone.
        """
        if self._newest and pose.stamp <= self._newest[-1].stamp:
            return None
        self._take(pose)
        limits = self._limits
        if self.stands_still and not self._may_stand(pose.stamp, self.equal_since, limits.longest_equal):
            return "equal", f"{self.standstill()}; longest_equal is {limits.longest_equal:g} s in a swim"
        longest = _POSITION_EQUAL * limits.longest_equal
        if not self._may_stand(pose.stamp, self._place_since, longest):
            still = (pose.stamp - self._place_since) * _NANO
            return "equal", f"positions have been equal to the last bit for {still:.2f} s, {longest:g} s may be"
        if not self._swims:
            return None
        return self._on_a_line() or self._one_stands(pose.stamp) or self._coarse()

    def _take(self, pose: Pose) -> None:
        last = self._newest[-1] if self._newest else None
        for name in COORDINATES:
            if last is None or getattr(pose, name) != getattr(last, name):
                self._since[name] = pose.stamp
        self._place_since = max(self._since["x"], self._since["y"])
        self.equal_since = max(self._since.values())
        self.equal_for = (pose.stamp - self.equal_since) * _NANO
        if last is not None:
            self._changes.append(tuple(abs(getattr(pose, name) - getattr(last, name)) for name in COORDINATES))
            self._count_still(self._changes[-1], 1)
        self._newest.append(pose)
        while (pose.stamp - self._newest[0].stamp) * _NANO > _KEPT * self._limits.longest_equal:
            self._newest.popleft()
            self._count_still(self._changes.popleft(), -1)

    def _count_still(self, changes: tuple[float, ...], number: int) -> None:
        for name, change in zip(COORDINATES, changes, strict=True):
            self._still[name] += number * (change == 0.0)

    def _is_rounded(self, name: str) -> bool:
        """Whether a coordinate changes so seldom that the tracker may round it."""
        return self._still[name] >= _STILL_PART * len(self._changes)

    def _may_stand(self, stamp: int, since: int, longest: float) -> bool:
        """Whether poses may be equal from one stamp to another: a fish that nobody drives may lie still for ever."""
        if self._swims is False:
            return True
        begin = since
        if self._swims and since <= self._swims_since:
            begin, longest = self._swims_since, max(longest, _FIRST_MOVE)
        return (stamp - begin) * _NANO <= longest

    def _one_stands(self, stamp: int) -> tuple[str, str] | None:
        longest = _ONE_EQUAL * self._limits.longest_equal
        for name, since in self._since.items():
            if self._may_stand(stamp, since, longest) or any(map(self._is_rounded, set(COORDINATES) - {name})):
                continue
            still = (stamp - max(since, self._swims_since)) * _NANO
            return "equal", (
                f"{name} has been equal to the last bit for {still:.2f} s of a swim, {longest:g} s may be: does the "
                "tracker see the fish, and measure it in the axes x forward, y left, z up?"
            )
        return None

    def _on_a_line(self) -> tuple[str, str] | None:
        last = self._newest[-1]
        begin = max(last.stamp - round(_LINE * self._limits.longest_equal / _NANO), self._moves_since)
        line = list(takewhile(lambda pose: pose.stamp >= begin, reversed(self._newest)))
        span = (last.stamp - line[-1].stamp) * _NANO if line else 0.0
        if len(line) < _FEWEST_IN_A_LINE or span < _LINE_PART * _LINE * self._limits.longest_equal:
            return None
        if not all(_near(line[-1], last, pose) for pose in line):
            return None
        return "predicted", (
            f"poses have been on a straight line for {span:.2f} s, to {1e3 * _LINE_WIDTH:g} mm: no fish that beats its "
            "tail swims so; does the tracker go on by itself where it does not see the fish?"
        )

    @property
    def _moves_since(self) -> int:
        """Stamp in ns from which on a driven fish moves."""
        return self._swims_since + round(_FIRST_MOVE / _NANO)

    def _coarse(self) -> tuple[str, str] | None:
        if not (self._is_rounded("x") and self._is_rounded("y")):
            return None
        moved = [change for x, y, _ in self._changes for change in (x, y) if change > 0.0]
        if not moved or (step := min(moved)) <= (1.0 + _WHOLE) * self._coarsest:
            return None
        if any(abs(change / step - round(change / step)) > _WHOLE for change in moved):
            return None
        return "coarse", (
            f"positions come in steps of {1e3 * step:.2g} mm, in which no velocity is seen: position_floor is "
            f"{1e3 * self._coarsest:g} mm; does the tracker round them?"
        )


def _near(first: Pose, last: Pose, pose: Pose) -> bool:
    """Whether a pose is on the straight line from one pose to another."""
    part = (pose.stamp - first.stamp) / (last.stamp - first.stamp)
    away = math.hypot(
        pose.x - first.x - part * (last.x - first.x),
        pose.y - first.y - part * (last.y - first.y),
    )
    turn = math.remainder(last.heading - first.heading, 2.0 * math.pi)
    turned = math.remainder(pose.heading - first.heading, 2.0 * math.pi)
    return away <= _LINE_WIDTH and abs(math.remainder(turned - part * turn, 2.0 * math.pi)) <= _LINE_TURN
