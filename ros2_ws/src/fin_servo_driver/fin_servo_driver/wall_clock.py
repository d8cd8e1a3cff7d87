"""Stamps for what was timed by the monotonic clock."""

from __future__ import annotations

import time

_TRIES = 5


def stamp_of(monotonic: float) -> int:
    """Return the wall clock's time in ns at ``monotonic`` s of the monotonic clock.

    The two clocks cannot be read at once. Of several readings the closest pair counts, so that a process which is put
    aside between the two does not stamp milliseconds off.
    """
    best, offset = 1 << 62, 0
    for _ in range(_TRIES):
        before = time.monotonic_ns()
        wall = time.time_ns()
        gap = time.monotonic_ns() - before
        if gap < best:
            best, offset = gap, wall - before - gap // 2
    return round(monotonic * 1e9) + offset
