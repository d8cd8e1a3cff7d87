"""What the driver takes for the time: this machine's clock, or another one that is handed in."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """A clock that does not go back; the module `time` is one."""

    def monotonic(self) -> float:
        """Return the time in s."""

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""
