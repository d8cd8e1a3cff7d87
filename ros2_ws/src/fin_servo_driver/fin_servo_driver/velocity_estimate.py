"""Velocity of a tracked fish from its poses: causal, with a stated delay and bandwidth. Nothing here knows ROS.

A straight line is fitted to the poses of the last W seconds. Its slope is the velocity in the middle of the window, so
the estimate bears the mean time of its poses: it comes W/2 later than the newest pose, but is no late copy. Of an
oscillation of frequency f it passes 3 (sin x - x cos x) / x^3 with x = pi f W (Savitzky & Golay, Analytical Chemistry
36, 1964, for least squares and evenly spaced poses): half of the power at f = 0.578 / W. A mean is passed unchanged.

Stamps that jitter, as those of poses stamped on arrival do, make a slope by least squares smaller (errors in the
variable), and one with the poses' ranks as instrument (Durbin, Review of the International Statistical Institute 22,
1954) larger by about as much. So the slope is the mean of both, which are the same for evenly spaced poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_servo_driver.course import RULES, Course
from fin_servo_driver.pose_checks import Clocks, Limits, Pose, Refusal, Track

if TYPE_CHECKING:
    from numpy.typing import NDArray

BANDWIDTH_TIMES_WINDOW = 0.578
"""-3 dB frequency times W: the x that solves 3 (sin x - x cos x) / x^3 = 1 / sqrt(2), over pi."""
_FEWEST = 5
_SPAN = 0.75
"""Part of the window that the poses must span."""
_LONGEST_GAP = 0.4
"""Part of the window that may be without a pose."""
_MOST_OUTLIERS = 0.25
"""Part of the poses that may be set aside; Theil and Sen's slopes stand up to 0.29."""
_DEVIATIONS = 4.0
_CEILING = 5.0
_MAD_TO_SIGMA = 1.4826
_OLD_IN_A_ROW = 10
"""Poses older than the window that, coming in a row, mean that the tracker's clock was set back."""
_NANO = 1e-9
REASONS = (
    "not finite",
    "twice",
    "same stamp",
    "zero stamp",
    "too old",
    "late",
    "from the future",
    "outlier",
    "far away",
    "orientation",
    "jump",
    "equal",
    "several trackers",
    "predicted",
    "coarse",
    "impossible velocity",
)
_HARMLESS = ("twice", "outlier", "too old")
"""What happens to single poses of a good tracker on a network."""
_TWICE = Refusal("twice", "it came twice")
_SAME_STAMP = Refusal("same stamp", "another pose came with the same stamp: do the tracker's stamps advance with each?")


@dataclass(frozen=True)
class Settings:
    """How the estimate is made.

    Attributes:
        window: W, s.
        position_floor: m; a pose nearer than this to the line is no outlier, however well the others lie, and one
            farther than five times this is, however badly they lie.
        heading_floor: The same for the heading, rad.
        limits: What a fish and a camera can do.

    Raises:
        ValueError: A value out of range.
    """

    window: float = 0.25
    position_floor: float = 2e-3
    heading_floor: float = 0.05
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        checks.number("window", self.window, 0.02, 10.0, unit="s")
        checks.number("position_floor", self.position_floor, 0.0, 1.0, unit="m", exclusive_minimum=True)
        checks.number("heading_floor", self.heading_floor, 0.0, 1.0, unit="rad", exclusive_minimum=True)

    @property
    def delay(self) -> float:
        """Time in s from what an estimate is for to the newest pose in it."""
        return self.window / 2.0

    @property
    def bandwidth(self) -> float:
        """Frequency in Hz at which half of the power is passed."""
        return BANDWIDTH_TIMES_WINDOW / self.window


@dataclass(frozen=True)
class Velocity:
    """An estimate.

    Attributes:
        stamp: Time that it is for, ns.
        forward: m/s, along the fish.
        left: m/s.
        yaw_rate: rad/s.
    """

    stamp: int
    forward: float
    left: float
    yaw_rate: float


class VelocityEstimator:
    """Takes poses in any order, returns velocities in rising order of time.

    Attributes:
        refused: Poses that were not used, by reason.
        silent: Why the last pose led to no velocity; empty if it did.
        impossible: What the poses did last that neither a fish nor a camera can do, since somebody emptied it.
    """

    def __init__(self, settings: Settings) -> None:
        """Start without poses."""
        self.settings = settings
        self.refused = dict.fromkeys(REASONS, 0)
        self.silent = "no pose yet"
        self.impossible = ""
        self._window_ns = round(settings.window / _NANO)
        self._clocks = Clocks(settings.limits)
        self._track = Track(
            settings.limits,
            coarsest=settings.position_floor,
            position_slack=_CEILING * settings.position_floor,
            heading_slack=_CEILING * settings.heading_floor,
            longest_gap=_LONGEST_GAP * settings.window,
        )
        self._stamps: list[int] = []
        self._poses: list[tuple[float, float, float]] = []
        self._courses = [Course(rule) for rule in RULES]
        self._course_stamp: int | None = None
        self._old_in_a_row = 0
        self._last_stamp: int | None = None

    @property
    def age(self) -> float:
        """Age of the newest pose when it came, s; 0.0 where nobody tells when poses come."""
        return self._clocks.age

    @property
    def note(self) -> str:
        """What is remarkable of poses that are used, or empty."""
        if not self._track.lost_fish.stands_still:
            return ""
        return f"{self._track.lost_fish.standstill()}; taken for a fish at rest, and refused as soon as it is driven"

    def plant_says(self, *, swims: bool, since: int) -> None:
        """Take whether the fish is driven, and since when by the plant's clock in ns; see `Track`."""
        self._track.lost_fish.plant_says(swims=swims, since=since)

    def add(
        self, stamp: int, x: float, y: float, heading: float, *, now: int | None = None, frame: str = ""
    ) -> Velocity | None:
        """Take a pose; return the velocity if this pose is the newest and the window has what it takes.

        Args:
            stamp: ns, of the picture.
            x: m, in the tank.
            y: m, in the tank.
            heading: rad, any multiple of a turn.
            now: Time in ns by the receiver's clock, from which the tracker's may differ; None if that does not matter.
            frame: Name of the frame.
        """
        if refusal := self._refusal_of_stamp(stamp, now):
            self.refuse(refusal)
            return None
        if not self._insert(Pose(stamp, x, y, heading, frame)):
            return None
        self._forget(stamp - self._window_ns)
        estimate = self._estimate()
        if estimate is None or (self._last_stamp is not None and estimate.stamp <= self._last_stamp):
            return None
        self._last_stamp = estimate.stamp
        return None if self._is_impossible(estimate) else estimate

    def refuse(self, refusal: Refusal) -> None:
        """Count a pose that is not used, and say why."""
        self.refused[refusal.reason] += 1
        self.silent = f"a pose was refused: {refusal.text}"
        if refusal.reason not in _HARMLESS:
            self.impossible = self.silent

    def _refusal_of_stamp(self, stamp: int, now: int | None) -> Refusal | None:
        if now is None:
            return None
        if stamp == 0:
            return Refusal("zero stamp", "its stamp is 0: the tracker does not say when it saw the fish")
        return self._clocks.refusal(stamp, now)

    def _insert(self, pose: Pose) -> bool:
        """Put a pose in its place; return whether it is the newest."""
        if not all(map(math.isfinite, (pose.x, pose.y, pose.heading))):
            self.refuse(Refusal("not finite", f"it is at ({pose.x:g}, {pose.y:g}) m, heading {pose.heading:g} rad"))
            return False
        if self._is_too_old(pose.stamp):
            return False
        place = len(self._stamps)
        while place and self._stamps[place - 1] > pose.stamp:
            place -= 1
        values = pose.x, pose.y, pose.heading
        if place and self._stamps[place - 1] == pose.stamp:
            self.refuse(_TWICE if values == self._poses[place - 1] else _SAME_STAMP)
            return False
        if refusal := self._track.refusal(pose):
            if refusal.reason == "equal":
                self._forget_after(self._track.lost_fish.equal_since)
            self.refuse(refusal)
            return False
        self._stamps.insert(place, pose.stamp)
        self._poses.insert(place, values)
        return place == len(self._stamps) - 1

    def _is_too_old(self, stamp: int) -> bool:
        """Whether a pose came after its window; if only such ones come, the clock was set back: begin anew."""
        if not self._stamps or stamp >= self._stamps[-1] - self._window_ns:
            self._old_in_a_row = 0
            return False
        self._old_in_a_row += 1
        back = (self._stamps[-1] - stamp) * _NANO
        if self._old_in_a_row < _OLD_IN_A_ROW:
            self.refuse(Refusal("too old", f"its stamp is {back:.3f} s before that of one that came earlier"))
            return True
        self.impossible = f"the stamps of {_OLD_IN_A_ROW} poses in a row were some {back:.3f} s back: clock set back?"
        self._stamps, self._poses, self._last_stamp = [], [], None
        self._old_in_a_row = 0
        self._track.forget()
        return False

    def _is_impossible(self, estimate: Velocity) -> bool:
        """Look at what the poses, each possible, amount to."""
        limits = self.settings.limits
        speed = math.hypot(estimate.forward, estimate.left)
        if speed > limits.largest_speed:
            text = f"the fish moves at {speed:.3g} m/s, largest_speed is {limits.largest_speed:g} m/s: positions in m?"
        elif abs(estimate.yaw_rate) > limits.largest_turn_rate:
            text = f"it turns at {estimate.yaw_rate:.3g} rad/s, largest_turn_rate is {limits.largest_turn_rate:g} rad/s"
        else:
            text = self._off_course(estimate)
        if text:
            self.refused["impossible velocity"] += 1
            self.silent = self.impossible = f"a velocity was refused: {text}"
        return bool(text)

    def _off_course(self, estimate: Velocity) -> str:
        """Return what is wrong with a fish that has moved sideways or backwards for long, or nothing."""
        last, self._course_stamp = self._course_stamp, estimate.stamp
        complaints = []
        for course in self._courses:
            if last is not None and not 0 < estimate.stamp - last < self._window_ns:
                course.clear()
            complaints.append(course.add(estimate.stamp, estimate.forward, estimate.left, estimate.yaw_rate))
        return next(filter(None, complaints), "")

    def _forget(self, before: int) -> None:
        while self._stamps and self._stamps[0] < before:
            del self._stamps[0], self._poses[0]

    def _forget_after(self, stamp: int) -> None:
        """Take back poses that turn out to be copies of an earlier one."""
        while self._stamps and self._stamps[-1] > stamp:
            del self._stamps[-1], self._poses[-1]

    def _estimate(self) -> Velocity | None:
        """Return the velocity of the window, or None, with `silent` saying why."""
        stamps = np.array(self._stamps, dtype=np.int64)
        times = (stamps - stamps[-1]) * _NANO
        self.silent = self._missing(times)
        if self.silent:
            return None
        poses = np.array(self._poses)
        poses[:, 2] = np.unwrap(poses[:, 2])
        good = self._inliers(times, poses)
        if np.count_nonzero(~good) > _MOST_OUTLIERS * len(good):
            self.silent = (
                f"{np.count_nonzero(~good)} of {len(good)} poses do not fit together: {_scatter(times, poses)}"
            )
            return None
        self.silent = self._missing(times[good])
        if self.silent:
            return None
        if not good[-1]:
            self.refused["outlier"] += 1
        times, poses = times[good], poses[good]
        middle = float(np.mean(times))
        offset, rank = times - middle, np.arange(len(times)) - (len(times) - 1) / 2.0
        slope = (offset @ poses / float(offset @ offset) + rank @ poses / float(rank @ offset)) / 2.0
        heading = float(np.mean(poses[:, 2]))
        cosine, sine = math.cos(heading), math.sin(heading)
        return Velocity(
            stamp=int(stamps[-1]) + round(middle / _NANO),
            forward=float(slope[0] * cosine + slope[1] * sine),
            left=float(slope[1] * cosine - slope[0] * sine),
            yaw_rate=float(slope[2]),
        )

    def _missing(self, times: NDArray[np.float64]) -> str:
        """Return what the poses at these times (rising, s) lack for an estimate, or an empty text."""
        window = self.settings.window
        if len(times) < _FEWEST:
            return f"{len(times)} poses within {window:g} s, needed are {_FEWEST}"
        span, gap = float(times[-1] - times[0]), float(np.max(np.diff(times)))
        if span < _SPAN * window:
            return f"the poses span {span:.3f} s, needed are {_SPAN * window:.3f} s"
        if gap > _LONGEST_GAP * window:
            return f"no pose for {gap:.3f} s, at most {_LONGEST_GAP * window:.3f} s may be without"
        return ""

    def _inliers(self, times: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which poses, shape (n, 3), lie on the line of the others (Theil 1950, Sen 1968), shape (n,)."""
        first, second = np.triu_indices(len(times), 1)
        slopes = np.median((poses[second] - poses[first]) / (times[second] - times[first])[:, None], axis=0)
        residuals = poses - slopes * times[:, None]
        residuals = np.abs(residuals - np.median(residuals, axis=0))
        spread = _DEVIATIONS * _MAD_TO_SIGMA * np.median(residuals, axis=0)
        floors = np.array([self.settings.position_floor, self.settings.position_floor, self.settings.heading_floor])
        allowed = np.clip(spread, floors, _CEILING * floors)
        return np.asarray(np.all(residuals <= allowed, axis=1))


def _scatter(times: NDArray[np.float64], poses: NDArray[np.float64]) -> str:
    """Return how poses, shape (n, 3), scatter around their line."""
    line = np.polynomial.polynomial.polyfit(times, poses, 1)
    rest = np.sqrt(np.mean((poses - line[0] - np.outer(times, line[1])) ** 2, axis=0))
    place, heading = math.hypot(rest[0], rest[1]), math.degrees(rest[2])
    return f"they scatter by {place:.2g} m and {heading:.2g} degrees around a straight line"
