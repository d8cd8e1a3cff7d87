"""What the driver takes for the time: this machine's clock, or another one that is handed in."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock that does not go back; the module `time` is one."""

    def monotonic(self) -> float:
        """Return the time in s."""

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""


def seconds_asleep() -> float:
    """Return for how many s this machine has slept since it was started: the monotonic clock stands meanwhile."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
