"""The pace of a swim: how many samples are due by the wall clock, and the plant's time, which stamps them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

_NANOSECONDS = 1e9
SLICE = 25
"""Samples computed and published between two looks at the callbacks: short enough that a service is answered within
some milliseconds, long enough that waiting for the listeners costs little."""
_LARGEST_LAG = 0.25
"""s. More than this behind real time is given up, so that a machine that was asleep does not race to catch up."""


class Pace:
    """How many samples are due by the wall clock, and which time they have.

    Attributes:
        stamp: Plant's time in ns: of the last sample, or of a state that has begun since.
    """

    def __init__(
        self,
        sample_time: float,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Begin now, in real time.

        Args:
            sample_time: Plant's time between two samples, s.
            clock: Does not go back; s.
            wall_clock: ns since 1970.
        """
        self.stamp = wall_clock()
        self._sample_time = sample_time
        self._clock = clock
        self._wall_clock = wall_clock
        self._speed = 1.0
        self._begin()

    def _begin(self, samples: float = 0.0) -> None:
        """Count from now on; so many samples are due already."""
        self._start, self._done = self._clock() - (samples * self._sample_time / self._speed if samples else 0.0), 0

    def set_speed(self, speed: float) -> None:
        """Run at ``speed`` fish seconds a second from now on; 0 is as fast as possible."""
        if speed != self._speed:
            self._speed = speed
            self._begin()

    def begin_state(self, *, now: bool) -> int:
        """Return the time at which another state begins, in ns; each has its own, so that listeners tell them apart.

        Args:
            now: Begin at the wall clock's time, unless the plant's is ahead, so that what was late is not late for
                ever. What was due before is not computed any more: it would lead ahead of the wall clock.
        """
        self.stamp += 1
        if now:
            self.stamp = max(self.stamp, self._wall_clock())
            self._begin()
        return self.stamp

    def due(self) -> int:
        """Return the number of samples to compute now, at most a slice."""
        if self._speed == 0.0:
            return SLICE
        behind = (self._clock() - self._start) * self._speed / self._sample_time - self._done
        if behind * self._sample_time > _LARGEST_LAG * max(self._speed, 1.0):
            self._begin(samples=1.0)
            behind = 1.0
        return min(max(int(behind), 0), SLICE)

    def advance(self, samples: int) -> None:
        """Note that so many samples were computed."""
        self._done += samples

    def stamps(self, samples: int) -> NDArray[np.int64]:
        """Return the time of each of the next samples in ns, shape (samples,)."""
        return self.stamp + np.round(self._sample_time * _NANOSECONDS * np.arange(1, samples + 1)).astype(np.int64)

    def wait(self) -> float:
        """Return the seconds until the next sample is due."""
        if self._speed == 0.0:
            return 0.0
        return max(0.0, self._start + (self._done + 1) * self._sample_time / self._speed - self._clock())
