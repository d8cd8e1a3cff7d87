"""A serial line without a port: an emulated device at its other end, and the line's own clock."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from fin_servo_driver.port import FRAMES_WAITING

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.emulator.devices import Device

_BITS_A_BYTE = 10


class Clock(Protocol):
    """What a line and whoever speaks on it take for the time; the module `time` is one."""

    def monotonic(self) -> float:
        """Return the time in s."""

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""


class OwnClock:
    """A time that passes only where somebody waits: nothing on it depends on the machine.

    Attributes:
        now: s.
    """

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        """Return the time in s."""
        return self.now

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""
        self.now += max(0.0, seconds)


@dataclass(frozen=True)
class Written:
    """What was handed to the line at once.

    Attributes:
        at: s at which it was.
        data: The bytes.
    """

    at: float
    data: bytes


class Wire:
    """A line of `line.OpenLine`.

    Attributes:
        device: On its other end.
        log: What was handed over, in order.
        before: Called before anything is done on the line, with what it is: "write", "read" or "behind".
        outputs: Each change of what the device does, with the time at which the byte that made it was through.
    """

    def __init__(self, device: Device, baud: int = 0, clock: Clock = time) -> None:
        """Open it; 0 baud carry everything at once."""
        self.device = device
        self.log: list[Written] = []
        self.before: Callable[[str], object] = lambda _: None
        self.outputs: list[tuple[float, dict[int, float | None]]] = []
        self.lost: Exception | None = None
        self._clock = clock
        self._seconds_a_byte = _BITS_A_BYTE / baud if baud else 0.0
        self._going: deque[tuple[float, int]] = deque()
        self._coming: deque[tuple[float, int]] = deque()
        self._longest = 1
        now = clock.monotonic()
        self._comes(device.opened(now), now)

    def write(self, data: bytes) -> None:
        """Take bytes; each is through when those before it are."""
        self.before("write")
        if self.lost is not None:
            raise self.lost
        now = self._clock.monotonic()
        self._pass(now)
        self.log.append(Written(now, data))
        self._longest = max(self._longest, len(data))
        at = max(now, self._going[-1][0] if self._going else now)
        for byte in data:
            at += self._seconds_a_byte
            self._going.append((at, byte))
        self._pass(now)

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s."""
        self.before("read")
        if self.lost is not None:
            raise self.lost
        deadline = self._clock.monotonic() + timeout
        while True:
            now = self._clock.monotonic()
            self._pass(now)
            came = bytearray()
            while self._coming and self._coming[0][0] <= now:
                came.append(self._coming.popleft()[1])
            if came or now >= deadline:
                return bytes(came)
            events = [way[0][0] for way in (self._going, self._coming) if way]
            self._clock.sleep(min([*events, deadline]) - now)

    def _pass(self, now: float) -> None:
        """Let the device take what is through by ``now`` s."""
        while self._going and self._going[0][0] <= now:
            at, byte = self._going.popleft()
            before = dict(self.device.outputs)
            self._comes(self.device.feed(bytes((byte,)), at), at)
            if before != self.device.outputs:
                self.outputs.append((at, dict(self.device.outputs)))
        self.device.tick(now)

    def _comes(self, data: bytes, at: float) -> None:
        at = max(at, self._coming[-1][0] if self._coming else at)
        for byte in data:
            at += self._seconds_a_byte
            self._coming.append((at, byte))

    def is_behind(self) -> bool:
        """Whether too many bytes wait to go out."""
        self.before("behind")
        self._pass(self._clock.monotonic())
        return len(self._going) > FRAMES_WAITING * self._longest

    def drain(self, timeout: float) -> None:
        """Wait until everything is out, at most so many s."""
        left = self._going[-1][0] - self._clock.monotonic() if self._going else 0.0
        self._clock.sleep(min(max(left, 0.0), timeout))
        self._pass(self._clock.monotonic())

    def close(self) -> None:
        """Leave it."""
