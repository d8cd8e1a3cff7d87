"""A serial line without a port: an emulated device at its other end, and the line's own clock."""

from __future__ import annotations

import random
import re
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_servo_driver.line import LineLostError, PortUnavailableError
from fin_servo_driver.port import FRAMES_WAITING

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.clock import Clock
    from fin_servo_driver.emulator.devices import Device
    from fin_servo_driver.line import DeviceError

_BITS_A_BYTE = 10


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
        at: s at which it was, or, on its way, s at which its last byte is through.
        data: The bytes.
    """

    at: float
    data: bytes


class Wire:
    """A line of `line.OpenLine`.

    Attributes:
        device: On its other end.
        opened: s at which it was.
        log: What was handed over, in order.
        lost: What is raised from now on, as if the cable was out.
        touched: Called after each write, and before each read.
        outputs: Each change of what the device does, with the time at which the byte that made it was through.
    """

    def __init__(self, device: Device | _Distant, baud: int = 0, clock: Clock = time) -> None:
        """Open it; 0 baud carry everything at once."""
        self.device = device
        self.log: list[Written] = []
        self.touched: Callable[[], object] = lambda: None
        self.outputs: list[tuple[float, dict[int, float | None]]] = []
        self.lost: Exception | None = None
        self._clock = clock
        self._seconds_a_byte = _BITS_A_BYTE / baud if baud else 0.0
        self._going: deque[Written] = deque()
        self._coming: deque[Written] = deque()
        self._longest = 1
        now = clock.monotonic()
        self.opened = now
        self._comes(device.opened(now), now)
        self.outputs.append((now, dict(device.outputs)))

    def write(self, data: bytes) -> None:
        """Take bytes; each is through when those before it are."""
        if self.lost is not None:
            raise self.lost
        now = self._clock.monotonic()
        self._pass(now)
        self.log.append(Written(now, data))
        self._longest = max(self._longest, len(data))
        begin = max(now, self._going[-1].at if self._going else now)
        self._going.append(Written(begin + len(data) * self._seconds_a_byte, data))
        self._pass(now)
        self.touched()

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s."""
        self.touched()
        if self.lost is not None:
            raise self.lost
        deadline = self._clock.monotonic() + timeout
        while True:
            now = self._clock.monotonic()
            self._pass(now)
            came = b""
            while self._coming and self._coming[0].at <= now:
                came += self._coming.popleft().data
            if came or now >= deadline:
                return came
            events = [way[0].at for way in (self._going, self._coming) if way]
            self._clock.sleep(min([*events, deadline]) - now)

    def _pass(self, now: float) -> None:
        """Let the device take what is through by ``now`` s."""
        while self._going and self._going[0].at <= now:
            self._take(self._going.popleft())
        self.device.tick(now)

    def _take(self, frame: Written) -> None:
        before = dict(self.device.outputs)
        if answer := self.device.feed(frame.data, frame.at):
            self._comes(answer, frame.at)
        if before != self.device.outputs:
            self.outputs.append((frame.at, dict(self.device.outputs)))

    def _comes(self, data: bytes, at: float) -> None:
        begin = max(at, self._coming[-1].at if self._coming else at)
        self._coming.append(Written(begin + len(data) * self._seconds_a_byte, data))

    def discard(self) -> None:
        """Take back what has not gone out; a frame of which some bytes have is cut."""
        now = self._clock.monotonic()
        self._pass(now)
        if self._going and self._seconds_a_byte:
            cut = self._going[0]
            left = min(len(cut.data), int((cut.at - now) / self._seconds_a_byte))  # the byte under way goes out whole
            self._going = deque([Written(cut.at - left * self._seconds_a_byte, cut.data[: len(cut.data) - left])])

    def is_behind(self) -> bool:
        """Whether too many bytes wait to go out."""
        now = self._clock.monotonic()
        self._pass(now)
        waiting = (self._going[-1].at - now) / self._seconds_a_byte if self._going and self._seconds_a_byte else 0.0
        return waiting > FRAMES_WAITING * self._longest

    def drain(self, timeout: float) -> None:
        """Wait until everything is out, at most so many s."""
        left = self._going[-1].at - self._clock.monotonic() if self._going else 0.0
        self._clock.sleep(min(max(left, 0.0), timeout))
        self._pass(self._clock.monotonic())

    def close(self) -> None:
        """Leave it."""


class Port:
    """A port on a clock of its own, which may be pulled out; `open` gives a new `Wire` to the same device each time.

    Attributes:
        device: At its other end.
        silent: Whether the device hears nothing and says nothing.
        drop_rate: Part of the bytes that are lost on the way, each way.
    """

    def __init__(self, device: Device, clock: Clock, baud: int = 0) -> None:
        """Plug the device in."""
        self.device = device
        self.silent = False
        self.drop_rate = 0.0
        self._clock = clock
        self._baud = baud
        self._wire: Wire | None = None
        self._is_there = True
        self._random = random.Random(1)  # noqa: S311 - the bytes that are lost are the same in each run

    def open(self) -> Wire:
        """Open it.

        Raises:
            PortUnavailableError: It is pulled out.
        """
        if not self._is_there:
            msg = "the port is absent"
            raise PortUnavailableError(msg)
        self._wire = Wire(_Distant(self), self._baud, self._clock)
        return self._wire

    def unplug(self, *, powered: bool = False) -> None:
        """Pull it out; the device loses its power, unless it has its own."""
        self._is_there = False
        if self._wire is not None:
            self._wire.lost = LineLostError("the port is gone")
        if not powered:
            self.device.lose_power()

    def plug(self) -> None:
        """Plug it in again."""
        self._is_there = True

    def left_of(self, data: bytes) -> bytes:
        """Return what gets through."""
        if self.silent:
            return b""
        return bytes(byte for byte in data if self._random.random() >= self.drop_rate)


class _Distant:
    """The device as what gets through the port lets it appear."""

    def __init__(self, port: Port) -> None:
        self._port = port

    @property
    def outputs(self) -> dict[int, float | None]:
        """What the device does."""
        return self._port.device.outputs

    def opened(self, now: float) -> bytes:
        """Return what it says first."""
        return self._port.left_of(self._port.device.opened(now))

    def feed(self, data: bytes, now: float) -> bytes:
        """Let it hear; return what it answers."""
        heard = self._port.left_of(data)
        return self._port.left_of(self._port.device.feed(heard, now)) if heard else b""

    def tick(self, now: float) -> None:
        """Let it notice that time passes."""
        self._port.device.tick(now)


class BrokenLine:
    """A line that fails as told."""

    def __init__(
        self, failure: DeviceError | None = None, *, behind: bool = False, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self.failure = failure
        self.failures_left = 1_000_000
        self.behind = behind
        self.sleep = sleep
        self.written = bytearray()
        self.closed = False
        self.waiting = b"\xf9\x02\x05"  # the banner of a board that does nothing but tell its pins

    def write(self, data: bytes) -> None:
        if self.failure is not None and self.failures_left > 0:
            self.failures_left -= 1
            raise self.failure
        for pin in re.findall(rb"\xf0\x6d(.)\xf7", data, re.DOTALL):
            self.waiting += b"\xf0\x6e" + pin + b"\xf7"
        self.written += re.sub(rb"\xf0\x6d.\xf7", b"", data, flags=re.DOTALL)

    def read(self, timeout: float) -> bytes:
        if not self.waiting:
            self.sleep(timeout)
        data, self.waiting = self.waiting, b""
        return data

    def is_behind(self) -> bool:
        return self.behind

    def discard(self) -> None:
        """Nothing waits."""

    def drain(self, timeout: float) -> None:
        del timeout

    def close(self) -> None:
        self.closed = True
