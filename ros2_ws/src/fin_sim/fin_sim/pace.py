"""The pace of a swim: how many samples are due by the wall clock."""

from __future__ import annotations

import time

SLICE = 25
"""Samples computed and published between two looks at the callbacks: short enough that a service is answered within
some milliseconds, long enough that waiting for the listeners costs little."""
_LARGEST_LAG = 0.25
"""s. More than this behind real time is given up, so that a machine that was asleep does not race to catch up."""


class Pace:
    """How many samples are due by the wall clock."""

    def __init__(self, sample_time: float) -> None:
        self._sample_time = sample_time
        self._speed = 1.0
        self._start = time.monotonic()
        self._done = 0

    def set_speed(self, speed: float) -> None:
        """Run at ``speed`` fish seconds a second from now on; 0 is as fast as possible."""
        if speed != self._speed:
            self._speed, self._start, self._done = speed, time.monotonic(), 0

    def due(self) -> int:
        """Return the number of samples to compute now, at most a slice."""
        if self._speed == 0.0:
            return SLICE
        behind = (time.monotonic() - self._start) * self._speed / self._sample_time - self._done
        if behind * self._sample_time > _LARGEST_LAG * max(self._speed, 1.0):
            self._start, self._done, behind = time.monotonic() - self._sample_time / self._speed, 0, 1.0
        return min(max(int(behind), 0), SLICE)

    def advance(self, samples: int) -> None:
        """Note that so many samples were computed."""
        self._done += samples

    def wait(self) -> float:
        """Return the seconds until the next sample is due."""
        if self._speed == 0.0:
            return 0.0
        return max(0.0, self._start + (self._done + 1) * self._sample_time / self._speed - time.monotonic())
