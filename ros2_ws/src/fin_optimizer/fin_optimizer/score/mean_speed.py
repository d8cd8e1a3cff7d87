"""The score of a trial: mean forward speed over the measuring window, or the reason why there is none.

The same function scores a trial while it runs and a bag years later. Both hand it the same stamps and the
same doubles, and its sums are correctly rounded whatever their order, so both get the same number to the last
digit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LONGEST_GAP = 0.5
"""s. Longest time without a sample, also at the window's ends: half a beat of a fish that beats at 1 Hz."""
MINIMUM_RATE = 10.0
"""Hz, as a mean over the window. A fish surges twice a beat; five samples a surge at 1 Hz do not alias it."""

FASTEST = 30.0
"""m/s. No swimmer is faster."""
REST = 0.5
"""s before a swim over which the mean forward speed tells whether it begins at rest: the noise of a tracker is
averaged out, and the gait has moved nothing yet."""
_STOPPED = 3.0
"""Times the speed of rest that a fish has swum at that is stopped, by the tank's wall for example."""
_CARRIED, _CARRIED_BY = 1.5, 0.015
"""Of the median and m/s: a block's mean that differs by more is not the fin's doing. Of 53 measured swims these rules
refuse the seven that lost the fish (tests/data/README.md), and no other."""
_AT_THE_START = 0.05
"""s. Where there is no sample before a swim, the first two tell its start if the first is not later than this."""

_KEYS = {
    "settle": "measurement.settle_s",
    "duration": "measurement.duration_s",
    "block": "measurement.block_s",
}
_LIMITS = {
    "largest_speed": "measurement.largest_speed_m_s",
    "largest_start_speed": "measurement.largest_start_speed_m_s",
}
_ENTRIES = {**_KEYS, **_LIMITS}
_OF_OLDER_BAGS = {"largest_speed": FASTEST}
"""What was allowed before bags said it."""
_FEWEST_BLOCKS, _FEWEST_AT_REST = 3, 2
"""Fewer tell no median, and nothing of a fish that rests for good."""
_MINIMUM_SAMPLES = 2  # an average over time needs an interval, a standard deviation two values


class ScoreError(ValueError):
    """The samples give no score; ``reason`` says which value broke which limit."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class NotThisSwimError(ScoreError):
    """What was recorded is not one swim from rest with the trial's fin, so it says nothing of the fin."""


class MissingMeasurementError(ScoreError):
    """Nothing says which part of the swim counts."""


@dataclass(frozen=True)
class Window:
    """Time over which a trial is scored, by header stamps in ns; both ends belong to it.

    Raises:
        ValueError: The window does not end after it starts.
    """

    start_ns: int
    end_ns: int

    def __post_init__(self) -> None:
        if self.end_ns <= self.start_ns:
            msg = f"window ends at {self.end_ns} ns, which must be after its start at {self.start_ns} ns"
            raise ValueError(msg)

    @property
    def duration(self) -> float:
        """Length in s."""
        return (self.end_ns - self.start_ns) / NANOSECONDS


@dataclass(frozen=True)
class Measurement:
    """What part of a swim is scored. It stands in the bag's metadata, so that the bag can be scored alone.

    Attributes:
        settle: Time in s between the start of the gait and the start of the window.
        duration: Length of the window in s.
        block: Length in s of the blocks whose means give the spread: a beat's period, where there is one.
        largest_speed: Forward speed in m/s, forwards or backwards, beyond which a velocity is not believed.
        largest_start_speed: Mean forward speed in m/s, either way, at which a swim still begins at rest.

    Raises:
        ValueError: A value outside its range.
    """

    settle: float = 0.0
    duration: float = 10.0
    block: float = 1.0
    largest_speed: float = 1.0
    largest_start_speed: float = 0.005

    def __post_init__(self) -> None:
        day = 86_400.0
        checks.number("settle", self.settle, 0.0, day, unit="s")
        checks.number("duration", self.duration, 0.0, day, unit="s", exclusive_minimum=True)
        checks.number("block", self.block, 0.0, day, unit="s", exclusive_minimum=True)
        checks.number("largest_speed", self.largest_speed, 0.0, FASTEST, unit="m/s", exclusive_minimum=True)
        checks.number("largest_start_speed", self.largest_start_speed, 0.0, FASTEST, unit="m/s")

    def window(self, swimming_since_ns: int) -> Window:
        """Return the window of a swim whose gait started at the plant's time ``swimming_since_ns``, in ns."""
        start = swimming_since_ns + round(self.settle * NANOSECONDS)
        return Window(start, start + round(self.duration * NANOSECONDS))

    def start_of(self, window: Window) -> int:
        """Return the plant's time in ns at which the gait of a swim with that window started."""
        return window.start_ns - round(self.settle * NANOSECONDS)

    def no_rest(self, speed: float) -> str:
        """Return why a swim that begins at this mean forward speed in m/s does not begin at rest, or empty."""
        if abs(speed) <= self.largest_start_speed:
            return ""
        return (
            f"the fish drifts at {100.0 * speed:.2g} cm/s before the gait starts, and a swim begins at rest, within "
            f"{100.0 * self.largest_start_speed:g} cm/s (measurement.largest_start_speed)"
        )

    def metadata(self) -> dict[str, str]:
        """Return the entries of a bag's metadata that :meth:`from_metadata` reads; no digit is lost."""
        return {key: repr(float(getattr(self, name))) for name, key in _ENTRIES.items()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Measurement:
        """Return the measurement that a bag's metadata describes.

        Raises:
            MissingMeasurementError: An entry is missing.
            ScoreError: One is no number or out of range.
        """
        missing = [key for key in _KEYS.values() if key not in metadata]
        if missing:
            msg = f"metadata lack {', '.join(missing)}: they do not say which part of the swim counts"
            raise MissingMeasurementError(msg)
        try:
            told = {name: float(metadata[key]) for name, key in _ENTRIES.items() if key in metadata}
            return cls(**{**_OF_OLDER_BAGS, **told})
        except ValueError as error:
            msg = f"metadata measurement.*: {error}"
            raise ScoreError(msg) from error


@dataclass(frozen=True)
class Score:
    """What a trial achieved.

    Attributes:
        value: Mean forward speed in m/s.
        samples: Number of samples in the window.
        spread: Standard deviation in m/s of the mean speeds of the window's whole blocks (n - 1 in the
            denominator); NaN where it is not defined, with fewer than two whole blocks or a block of fewer
            than two samples. With blocks of one beat the beat's own oscillation is not counted.
        longest_gap: Longest time in s between neighbouring samples of the window.
    """

    value: float
    samples: int
    spread: float
    longest_gap: float


def score(
    stamps_ns: NDArray[np.int64],
    forward_speed: NDArray[np.float64],
    window: Window,
    *,
    block: float = 1.0,
    largest_speed: float = FASTEST,
) -> Score:
    """Return the mean forward speed over the window.

    The mean is the time average over the whole window of the straight lines through the samples (trapezoidal
    rule): distance swum over time needed, which is what a laboratory reads off a ruler and a stop-watch. A plain
    mean of the samples would favour times at which a tracker delivered more of them, and count the samples at
    both ends twice as much as their share of the time. Where no sample lies on an end of the window, its
    neighbours on both sides give the speed there, or the nearest one if there is none beyond: a robot's samples
    fall anywhere, and from rest 10 ms less at the start are 0.1 % of a mean over 10 s.

    Args:
        stamps_ns: Header stamps in ns, shape (n,), strictly increasing. They may reach beyond the window.
        forward_speed: Speed in m/s along the body's x axis, shape (n,). Outside the window it may be NaN.
        window: What counts.
        block: Length in s of the blocks whose means give the spread.
        largest_speed: In m/s, either way; a velocity beyond it is not believed.

    Raises:
        ScoreError: Arrays that do not fit each other, stamps that repeat or run backwards, too few samples
            (MINIMUM_RATE), a gap longer than LONGEST_GAP, also at the window's ends, or a value that is not
            finite or beyond ``largest_speed``.
    """
    _check_order(stamps_ns, forward_speed)
    inside = (stamps_ns >= window.start_ns) & (stamps_ns <= window.end_ns)
    stamps, speed = stamps_ns[inside], forward_speed[inside]
    needed = max(_MINIMUM_SAMPLES, math.ceil(MINIMUM_RATE * window.duration))
    if stamps.size < needed:
        msg = (
            f"window of {window.duration:g} s holds {stamps.size} of {stamps_ns.size} velocity samples: "
            f"needed are at least {needed} ({MINIMUM_RATE:g} a second){_where(stamps_ns, window)}"
        )
        raise ScoreError(msg)
    longest_gap = _check_gaps(stamps, window)
    unusable = np.flatnonzero(~(np.abs(speed) <= largest_speed))  # written so that NaN is unusable too
    if unusable.size:
        first = int(unusable[0])
        msg = (
            f"forward speed is {speed[first]:g} m/s {_after(stamps[first], window)}, and {unusable.size} of "
            f"{speed.size} samples are not finite or beyond {largest_speed:g} m/s (measurement.largest_speed): all in "
            "the window must be usable, in m/s"
        )
        raise ScoreError(msg)
    near = _near(stamps_ns, forward_speed, window, largest_speed)
    value = _time_average(*near, window.start_ns, window.end_ns)
    return Score(value, int(stamps.size), _spread(*near, window, block), longest_gap)


def check_swim(
    stamps_ns: NDArray[np.int64], forward_speed: NDArray[np.float64], window: Window, measurement: Measurement
) -> None:
    """Refuse velocities that no fish swims, and a swim that does not begin at rest: a score of it would be another.

    Args:
        stamps_ns: Header stamps in ns, shape (n,), strictly increasing.
        forward_speed: Speed in m/s along the body's x axis, shape (n,).
        window: What counts.
        measurement: How it was measured.

    Raises:
        ScoreError: The same value to the last bit for longer than LONGEST_GAP, as of a tracker that lost the fish; or a
            fish that something stops or carries on its way.
        NotThisSwimError: A mean forward speed in the `REST` before the gait, or just after its start, that is none of
            rest.
    """
    start = measurement.start_of(window)
    before = _speed_before(stamps_ns, forward_speed, start)
    if reason := measurement.no_rest(before):
        raise NotThisSwimError(reason)
    if reason := _disturbed(stamps_ns, forward_speed, window, measurement):
        raise ScoreError(reason)
    inside = (stamps_ns >= start) & (stamps_ns <= window.end_ns)
    stamps, speed = stamps_ns[inside], forward_speed[inside]
    if not stamps.size:
        return
    edges = np.concatenate(([0], np.flatnonzero(np.diff(speed)) + 1, [stamps.size]))  # of runs of one value
    lengths = stamps[edges[1:] - 1] - stamps[edges[:-1]]
    longest = int(np.argmax(lengths))
    if lengths[longest] > LONGEST_GAP * NANOSECONDS:
        at = edges[longest]
        msg = (
            f"the velocity stays at {speed[at]!s} m/s to the last bit for {lengths[longest] / NANOSECONDS:.3g} s from "
            f"{_after(stamps[at], window)}: allowed are {LONGEST_GAP:g} s, a fish that swims never keeps a speed so "
            "exactly. Did the tracker lose it, or does it round its velocities?"
        )
        raise ScoreError(msg)


def _disturbed(
    stamps_ns: NDArray[np.int64], forward_speed: NDArray[np.float64], window: Window, measurement: Measurement
) -> str:
    """Return what a fish did that its fin does not do, or nothing: it came to rest for good, or moved in a burst."""
    block, rest = measurement.block, measurement.largest_start_speed
    start, length = measurement.start_of(window), round(block * NANOSECONDS)
    early = (window.end_ns - start) % length  # ns before the first of the whole blocks that end with the window
    if window.end_ns - start < length:
        return ""
    usable = _near(stamps_ns, forward_speed, Window(start, window.end_ns), measurement.largest_speed)
    means = np.abs(_block_means(*usable, Window(start + early, window.end_ns), block))
    moving = np.flatnonzero(means > rest)
    since = int(moving[-1]) + 1 if moving.size else len(means)
    if len(means) - since >= _FEWEST_AT_REST and means.max() >= _STOPPED * rest:
        return (
            f"the fish rests from {early / NANOSECONDS + since * block:.3g} s after the start of its gait on, having "
            f"swum at {100.0 * means.max():.2g} cm/s: is it at the tank's wall?"
        )
    means = _block_means(*usable, window, block)
    if len(means) < _FEWEST_BLOCKS:
        return ""
    median = float(np.median(means))
    most = int(np.argmax(np.abs(means - median)))
    if abs(means[most] - median) <= _CARRIED * abs(median) + _CARRIED_BY:
        return ""
    return (
        f"the fish moves at {100.0 * means[most]:.2g} cm/s from {most * block:.3g} s into the window on, for "
        f"{block:.3g} s, and {100.0 * median:.2g} cm/s is its median: did somebody move it, or "
        "the tracker follow something else?"
    )


def recent_speed(stamps_ns: NDArray[np.int64], forward_speed: NDArray[np.float64]) -> float | None:
    """Return the mean forward speed in m/s of the last `REST`, None while fewer samples than half of it are there."""
    if not stamps_ns.size or stamps_ns[-1] - stamps_ns[0] < REST / 2 * NANOSECONDS:
        return None
    return _speed_before(stamps_ns, forward_speed, int(stamps_ns[-1]))


def _speed_before(stamps: NDArray[np.int64], speed: NDArray[np.float64], start: int) -> float:
    """Return the mean forward speed in m/s before a start in ns, else that of the line back to it; 0 if unknown."""
    usable = np.isfinite(speed)
    before = usable & (stamps > start - round(REST * NANOSECONDS)) & (stamps <= start)
    if before.any():
        return math.fsum(speed[before].tolist()) / int(before.sum())
    after = np.flatnonzero(usable & (stamps > start))[:2]
    if after.size < _MINIMUM_SAMPLES or stamps[after[0]] - start > _AT_THE_START * NANOSECONDS:
        return 0.0
    (t1, t2), (v1, v2) = (stamps[after] - start).tolist(), speed[after].tolist()
    return float(v1 - (v2 - v1) * t1 / (t2 - t1))


def mean_power(stamps_ns: NDArray[np.int64], power: NDArray[np.float64], window: Window) -> float:
    """Return the mean over the window of the servos' power, in W; see `mean_value`."""
    nothing = "no power: effort or velocity of the tail's joints is missing or not finite"
    return mean_value(stamps_ns, power, window, "joint_states", nothing)


def mean_value(
    stamps_ns: NDArray[np.int64], values: NDArray[np.float64], window: Window, topic: str, nothing: str
) -> float:
    """Return the mean over the window of what a topic tells, in its unit; as `score` takes it of a speed.

    Args:
        stamps_ns: Header stamps in ns, shape (n,), strictly increasing.
        values: Shape (n,); finite inside the window.
        window: What counts.
        topic: For messages.
        nothing: What the topic's messages tell where a value is not finite, for messages.

    Raises:
        ScoreError: Arrays that do not fit each other, stamps that repeat or run backwards, a gap longer than
            LONGEST_GAP, or a value that is not finite.
    """
    _check_order(stamps_ns, values, topic)
    inside = (stamps_ns >= window.start_ns) & (stamps_ns <= window.end_ns)
    _check_gaps(stamps_ns[inside], window, topic)
    reach = round(LONGEST_GAP * NANOSECONDS)
    near = (stamps_ns >= window.start_ns - reach) & (stamps_ns <= window.end_ns + reach) & np.isfinite(values)
    if not np.isfinite(values[inside]).all():
        msg = f"{topic} tell {nothing}" if topic == "joint_states" else f"{topic} tells {nothing}"
        raise ScoreError(msg)
    return _time_average(stamps_ns[near], values[near], window.start_ns, window.end_ns)


def _check_order(stamps: NDArray[np.int64], speed: NDArray[np.float64], topic: str = "velocity") -> None:
    """Refuse arrays of other shapes or types than described, and stamps that do not increase."""
    if stamps.ndim != 1 or stamps.shape != speed.shape or not np.issubdtype(stamps.dtype, np.integer):
        got = f"stamps {stamps.dtype}{stamps.shape} and values {speed.dtype}{speed.shape}"
        msg = f"{got} of {topic} must be one integer stamp and one number a sample, both (n,)"
        raise ScoreError(msg)
    wrong = np.flatnonzero(np.diff(stamps) <= 0)
    if wrong.size:
        index = int(wrong[0])
        before, after = int(stamps[index]), int(stamps[index + 1])
        back = (before - after) / NANOSECONDS
        what = f"runs back by {back:g} s" if back else "repeats the one before"
        msg = f"{topic}'s stamp {after} ns of sample {index + 1} {what}: stamps must increase"
        raise ScoreError(msg)


def _check_gaps(stamps: NDArray[np.int64], window: Window, topic: str = "velocity") -> float:
    """Return the longest time between neighbouring samples in s; refuse one above the limit."""
    edges = np.concatenate(([window.start_ns], stamps, [window.end_ns]))
    gaps = np.diff(edges)
    longest = int(np.argmax(gaps))
    if gaps[longest] > LONGEST_GAP * NANOSECONDS:
        msg = (
            f"no {topic} for {gaps[longest] / NANOSECONDS:g} s from {_after(edges[longest], window)}: "
            f"allowed are {LONGEST_GAP:g} s"
        )
        raise ScoreError(msg)
    return float(gaps[1:-1].max(initial=0)) / NANOSECONDS


def _near(
    stamps: NDArray[np.int64], speed: NDArray[np.float64], window: Window, largest_speed: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the usable samples of the window and those beyond its ends that tell the speed at them."""
    reach = round(LONGEST_GAP * NANOSECONDS)
    near = (stamps >= window.start_ns - reach) & (stamps <= window.end_ns + reach) & (np.abs(speed) <= largest_speed)
    return stamps[near], speed[near]


def _where(stamps: NDArray[np.int64], window: Window) -> str:
    """Return where samples lie that are too few in the window, which tells of a clock that is none of the plant's."""
    if not stamps.size:
        return ""
    first, last = int(stamps[0]), int(stamps[-1])
    if last < window.start_ns:
        return f"; the last one lies {(window.start_ns - last) / NANOSECONDS:g} s before the window"
    if first > window.end_ns:
        return f"; the first one lies {(first - window.end_ns) / NANOSECONDS:g} s behind the window"
    return ""


def _after(stamp: np.int64, window: Window) -> str:
    return f"{(int(stamp) - window.start_ns) / NANOSECONDS:g} s into the window"


def _time_average(stamps: NDArray[np.int64], speed: NDArray[np.float64], start: int, end: int) -> float:
    """Return the mean over [start, end] (ns) of the lines through the samples; its sum is correctly rounded."""
    first, last = np.searchsorted(stamps, start, side="left"), np.searchsorted(stamps, end, side="right")
    time = np.concatenate(([0], stamps[first:last] - start, [end - start]))
    at_start, at_end = np.interp([0, end - start], stamps - start, speed)
    value = np.concatenate(([at_start], speed[first:last], [at_end]))
    areas = np.diff(time) * (value[1:] + value[:-1])
    return math.fsum(areas.tolist()) / (2 * (end - start))


def _spread(stamps: NDArray[np.int64], speed: NDArray[np.float64], window: Window, block: float) -> float:
    """Return the standard deviation of the means of the window's whole blocks in m/s, NaN where undefined."""
    means = _block_means(stamps, speed, window, block)
    if len(means) < _MINIMUM_SAMPLES:
        return math.nan
    centre = math.fsum(means.tolist()) / len(means)
    return math.sqrt(math.fsum((mean - centre) ** 2 for mean in means.tolist()) / (len(means) - 1))


def _block_means(
    stamps: NDArray[np.int64], speed: NDArray[np.float64], window: Window, block: float
) -> NDArray[np.float64]:
    """Return the means of the window's whole blocks of ``block`` s, in m/s; none where one has too few samples."""
    length = round(block * NANOSECONDS)
    edges = window.start_ns + length * np.arange((window.end_ns - window.start_ns) // length + 1)
    samples = np.searchsorted(stamps, edges[1:], side="right") - np.searchsorted(stamps, edges[:-1], side="left")
    if np.any(samples < _MINIMUM_SAMPLES):
        return np.empty(0)
    return np.array([_time_average(stamps, speed, a, b) for a, b in pairwise(edges.tolist())])
