"""Velocity of a tracked fish from its poses: causal, with a stated delay and bandwidth. Nothing here knows ROS.

A straight line is fitted by least squares to the poses of the last W seconds. Its slope is the velocity in the middle
of the window, so the estimate bears the mean time of its poses: it comes W/2 later than the newest pose, but is no
late copy. Of an oscillation of frequency f it passes 3 (sin x - x cos x) / x^3 with x = pi f W (Savitzky & Golay,
Analytical Chemistry 36, 1964, for evenly spaced poses): half of the power at f = 0.578 / W. A mean is passed unchanged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks

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


@dataclass(frozen=True)
class Settings:
    """How the estimate is made.

    Attributes:
        window: W, s.
        position_floor: m; a pose nearer than this to the line is no outlier, however well the others lie, and one
            farther than five times this is, however badly they lie.
        heading_floor: The same for the heading, rad.
        largest_lead: s; a pose whose stamp is farther ahead of the receiver's clock is refused.
        largest_age: s; a pose that is older when it comes is used, but counted as late.

    Raises:
        ValueError: A value out of range.
    """

    window: float = 0.25
    position_floor: float = 2e-3
    heading_floor: float = 0.05
    largest_lead: float = 0.05
    largest_age: float = 0.2

    def __post_init__(self) -> None:
        checks.number("window", self.window, 0.02, 10.0, unit="s")
        checks.number("position_floor", self.position_floor, 0.0, 1.0, unit="m", exclusive_minimum=True)
        checks.number("heading_floor", self.heading_floor, 0.0, 1.0, unit="rad", exclusive_minimum=True)
        checks.number("largest_lead", self.largest_lead, 0.0, 1.0, unit="s")
        checks.number("largest_age", self.largest_age, 1e-3, 60.0, unit="s")

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
        late: Poses that were older than `Settings.largest_age` when they came.
        age: Of the newest pose when it came, s; 0.0 where nobody tells when poses come.
    """

    def __init__(self, settings: Settings) -> None:
        """Start without poses."""
        self.settings = settings
        self.refused = {"not finite": 0, "twice": 0, "too old": 0, "outlier": 0, "from the future": 0}
        self.silent = "no pose yet"
        self.late = 0
        self.age = 0.0
        self._window_ns = round(settings.window / _NANO)
        self._stamps: list[int] = []
        self._poses: list[tuple[float, float, float]] = []
        self._old_in_a_row = 0
        self._last_stamp: int | None = None

    def add(self, stamp: int, x: float, y: float, heading: float, *, now: int | None = None) -> Velocity | None:
        """Take a pose; return the velocity if this pose is the newest and the window has what it takes.

        Args:
            stamp: ns, of the picture.
            x: m, in the tank.
            y: m, in the tank.
            heading: rad, any multiple of a turn.
            now: Time in ns by the receiver's clock, from which the tracker's may differ; None if that does not matter.
        """
        if now is not None and self._is_from_the_future(stamp, now):
            return None
        newest = self._insert(stamp, (x, y, heading))
        if not newest:
            return None
        self._forget(stamp - self._window_ns)
        estimate = self._estimate()
        if estimate is None or (self._last_stamp is not None and estimate.stamp <= self._last_stamp):
            return None
        self._last_stamp = estimate.stamp
        return estimate

    def _is_from_the_future(self, stamp: int, now: int) -> bool:
        """Look at the clocks: velocities with wrong stamps would be scored over another window than the swim's."""
        self.age = (now - stamp) * _NANO
        self.late += self.age > self.settings.largest_age
        if -self.age <= self.settings.largest_lead:
            return False
        self._refuse("from the future")
        self.silent = (
            f"a pose was refused: its stamp is {-self.age:.3f} s ahead of this computer's clock, allowed are "
            f"{self.settings.largest_lead:g} s: synchronise the tracker's clock with this one (chrony)"
        )
        return True

    def _insert(self, stamp: int, pose: tuple[float, float, float]) -> bool:
        """Put a pose in its place; return whether it is the newest."""
        if not all(map(math.isfinite, pose)):
            return self._refuse("not finite")
        if self._stamps and stamp < self._stamps[-1] - self._window_ns:
            self._old_in_a_row += 1
            if self._old_in_a_row < _OLD_IN_A_ROW:
                return self._refuse("too old")
            self._stamps, self._poses, self._last_stamp = [], [], None
        self._old_in_a_row = 0
        place = len(self._stamps)
        while place and self._stamps[place - 1] > stamp:
            place -= 1
        if place and self._stamps[place - 1] == stamp:
            return self._refuse("twice")
        self._stamps.insert(place, stamp)
        self._poses.insert(place, pose)
        return place == len(self._stamps) - 1

    def _refuse(self, reason: str) -> bool:
        self.refused[reason] += 1
        self.silent = f"a pose was refused: {reason}"
        return False

    def _forget(self, before: int) -> None:
        while self._stamps and self._stamps[0] < before:
            del self._stamps[0], self._poses[0]

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
            self.silent = f"{np.count_nonzero(~good)} of {len(good)} poses do not fit together"
            return None
        self.silent = self._missing(times[good])
        if self.silent:
            return None
        if not good[-1]:
            self.refused["outlier"] += 1
        times, poses = times[good], poses[good]
        middle = float(np.mean(times))
        offset = times - middle
        slope = offset @ poses / float(offset @ offset)
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


def heading_of(x: float, y: float, z: float, w: float) -> float:
    """Return the heading in rad of a quaternion of any length; NaN for one of no length."""
    norm = x * x + y * y + z * z + w * w
    if not norm > 1e-6:  # noqa: PLR2004 - a message that was never filled in
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
