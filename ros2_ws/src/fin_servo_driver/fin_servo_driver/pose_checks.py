"""Poses that neither a fish nor a camera can give: they are refused and named, because no average mends them.

Scatter is the estimator's business. Here is looked at what scatter does not show: the clocks, the unit, the plane, a
track that jumps to another place, another object or the other end of the fish, and a picture that stands still.
Nothing here knows ROS.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_servo_driver.lost_fish import LostFish

if TYPE_CHECKING:
    from collections.abc import Sequence

_NANO = 1e-9
_EPOCH_DIFFERS = 3e7
"""s, a year: an offset beyond it is no clock that runs wrong but one that counts from another moment."""
_NORM_TOLERANCE = 10e-3
"""Difference from 1 of a quaternion's norm that tf2 allows."""
_CLOCK_SPAN = 1.0
"""s of receipts among which the youngest pose tells the clocks' offset: a busy computer delays some, not all."""


@dataclass(frozen=True)
class Limits:
    """What a fish and a camera can do.

    Attributes:
        largest_lead: s; how far a stamp may be ahead of the receiver's clock.
        largest_age: s; how old a pose may be when it comes.
        largest_position: m; how far from the frame's origin.
        largest_tilt: rad; angle between the body's z axis and the frame's.
        largest_speed: m/s.
        largest_turn_rate: rad/s.
        longest_equal: s; how long poses may be equal to the last bit in a swim.
        jump_silence: s without a velocity after a jump.

    Raises:
        ValueError: A value out of range.
    """

    largest_lead: float = 0.05
    largest_age: float = 0.2
    largest_position: float = 50.0
    largest_tilt: float = 0.35
    largest_speed: float = 0.5
    largest_turn_rate: float = 10.0
    longest_equal: float = 0.1
    jump_silence: float = 1.0

    def __post_init__(self) -> None:
        checks.number("largest_lead", self.largest_lead, 0.0, 1.0, unit="s")
        checks.number("largest_age", self.largest_age, 1e-3, 60.0, unit="s")
        checks.number("largest_position", self.largest_position, 0.1, 1e7, unit="m")
        checks.number("largest_tilt", self.largest_tilt, 0.01, math.pi, unit="rad")
        checks.number("largest_speed", self.largest_speed, 1e-3, 30.0, unit="m/s")
        checks.number("largest_turn_rate", self.largest_turn_rate, 0.1, 1000.0, unit="rad/s")
        checks.number("longest_equal", self.longest_equal, 0.02, 10.0, unit="s")
        checks.number("jump_silence", self.jump_silence, 0.6, 60.0, unit="s")


@dataclass(frozen=True)
class Pose:
    """A pose in the plane.

    Attributes:
        stamp: ns, of the picture.
        x: m.
        y: m.
        heading: rad, any multiple of a turn.
        frame: In which it is.
    """

    stamp: int
    x: float
    y: float
    heading: float
    frame: str = ""


@dataclass(frozen=True)
class Refusal:
    """Why a pose is not used.

    Attributes:
        reason: Under which it is counted.
        text: What is wrong with it, with numbers.
    """

    reason: str
    text: str


class Clocks:
    """Compares the stamps with the receiver's clock: a velocity with a wrong stamp counts for another time."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._ages: deque[tuple[int, float]] = deque()
        self.age = 0.0

    def refusal(self, stamp: int, now: int) -> Refusal | None:
        """Return what is wrong with a stamp at its receipt, both in ns."""
        self.age = (now - stamp) * _NANO
        if -self.age > self._limits.largest_lead:
            return self._offset("from the future", "ahead of", -self.age, "largest_lead", self._limits.largest_lead)
        self._ages.append((now, self.age))
        while not 0 <= now - self._ages[0][0] <= _CLOCK_SPAN / _NANO:
            self._ages.popleft()
        youngest = min(age for _, age in self._ages)
        if youngest > self._limits.largest_age:
            return self._offset("late", "behind", youngest, "largest_age", self._limits.largest_age)
        return None

    @staticmethod
    def _offset(reason: str, where: str, offset: float, name: str, limit: float) -> Refusal:
        advice = "synchronise the tracker's clock with this one (chrony)"
        if offset > _EPOCH_DIFFERS:
            advice = "the tracker's clock does not count from 1970, as this one does: stamps since its start?"
        elif reason == "late":
            advice += f"; if its pictures take that long, raise {name}"
        return Refusal(
            reason, f"its stamp is {offset:.3f} s {where} this computer's clock, {name} is {limit:g} s: {advice}"
        )


class Track:
    """Follows one fish: a pose must be reachable from the one before.

    Attributes:
        lost_fish: Whether it is seen.
    """

    def __init__(
        self, limits: Limits, *, coarsest: float, position_slack: float, heading_slack: float, longest_gap: float
    ) -> None:
        """Begin without a pose.

        Args:
            limits: What a fish can do.
            coarsest: m; the largest step of rounded positions in which a velocity is seen.
            position_slack: m that noise may add between two poses.
            heading_slack: The same for the heading, rad.
            longest_gap: s between two poses for which a fish may be followed; after a longer one no more is allowed.
        """
        self._limits = limits
        self._slack = position_slack, heading_slack
        self._longest_gap = longest_gap
        self.lost_fish = LostFish(limits, coarsest)
        self.forget()

    def forget(self) -> None:
        """Begin anew with the next pose."""
        self._last: Pose | None = None
        self._stray: Pose | None = None
        self.lost_fish.forget()

    @property
    def last(self) -> Pose | None:
        """The last pose that was not refused."""
        return self._last

    def refusal(self, pose: Pose) -> Refusal | None:
        """Return why a pose cannot be the tracked fish's; take it if it can."""
        last = self._last
        if not max(abs(pose.x), abs(pose.y)) <= self._limits.largest_position:
            return Refusal(
                "far away",
                f"it is at ({pose.x:g}, {pose.y:g}) m, largest_position is {self._limits.largest_position:g} m: "
                "are positions in m?",
            )
        complaint = self.lost_fish.complaint(pose)
        if last is not None and (jump := self._jump(last, pose)):
            if pose.stamp - last.stamp < self._limits.jump_silence / _NANO:
                self._stray = pose
                return jump
            self._last = None
        if complaint:
            return Refusal(*complaint)
        if self._last is None or pose.stamp > self._last.stamp:
            self._last, self._stray = pose, None
        return None

    def _jump(self, last: Pose, pose: Pose) -> Refusal | None:
        apart = abs(pose.stamp - last.stamp) * _NANO
        followed = min(apart, self._longest_gap)
        if pose.frame != last.frame:
            return Refusal("jump", f"its frame is '{pose.frame}', that of the poses before was '{last.frame}'")
        way, turn = _ways(last, pose)
        position_slack, heading_slack = self._slack
        if self._is_stray(last, pose):
            followed = 0.0
        far = way - position_slack > self._limits.largest_speed * followed
        turned = turn - heading_slack > self._limits.largest_turn_rate * followed
        if turned and turn / heading_slack > way / position_slack:
            return Refusal(
                "jump",
                f"its heading differs by {math.degrees(turn):.0f} degrees from the one {apart:.3f} s before, "
                f"largest_turn_rate is {self._limits.largest_turn_rate:g} rad/s: no fish turns so fast; head and tail "
                "swapped?",
            )
        if far or turned:
            return Refusal(
                "jump",
                f"it is {way:.3f} m from the one {apart:.3f} s before, largest_speed is {self._limits.largest_speed:g} "
                "m/s: another object, or positions that are not in m?",
            )
        return None

    def _is_stray(self, last: Pose, pose: Pose) -> bool:
        """Whether a pose is nearer to the last one that jumped than to the fish.

        It belongs to the same jump then: the time for which a jump lasts makes no way to where it went.
        """
        if self._stray is None or self._stray.frame != pose.frame:
            return False
        to_stray, to_last = (
            sum(way / slack for way, slack in zip(_ways(one, pose), self._slack, strict=True))
            for one in (self._stray, last)
        )
        return to_stray < to_last


def _ways(one: Pose, other: Pose) -> tuple[float, float]:
    """Return how far two poses are apart, in m and in rad."""
    turn = abs(math.remainder(other.heading - one.heading, 2.0 * math.pi))
    return math.hypot(other.x - one.x, other.y - one.y), turn


def heading_of(quaternion: Sequence[float], limits: Limits) -> float | Refusal:
    """Return the heading in rad of a quaternion x, y, z, w, or why it tells none."""
    x, y, z, w = quaternion
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not math.isfinite(norm):
        return Refusal("not finite", f"its orientation is ({x:g}, {y:g}, {z:g}, {w:g})")
    if abs(norm - 1.0) > _NORM_TOLERANCE:
        never = "it was never filled in" if norm == 0.0 else "Euler angles? `orientation:=yaw` takes a heading in z"
        return Refusal("orientation", f"its quaternion has the norm {norm:.3g}, which must be 1: {never}")
    tilt = math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y) / (norm * norm))))
    if tilt > limits.largest_tilt:
        return Refusal(
            "orientation",
            f"it is tilted out of the plane by {math.degrees(tilt):.0f} degrees, largest_tilt is "
            f"{math.degrees(limits.largest_tilt):.0f} degrees: does the z axis of its frame point up?",
        )
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
