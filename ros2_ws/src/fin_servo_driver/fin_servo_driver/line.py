"""What a back end needs of a serial line, and what may go wrong on one. No port is opened here."""

from __future__ import annotations

import threading
from typing import Protocol

_LOOK = 0.002
"""s. A wait for bytes looks so often whether it has been stopped."""


class DeviceError(Exception):
    """Something is wrong with the device or the way to it; the text says what, and what to do."""


class PortUnavailableError(DeviceError):
    """The port cannot be opened: absent, busy or not permitted."""


class WrongDeviceError(DeviceError):
    """The device on the port does not answer as the configured one would."""


class LineLostError(DeviceError):
    """The device was unplugged, or its port has failed."""


class LineStalledError(DeviceError):
    """The line took no bytes within the write timeout; the frame is lost, the line is still there."""


class StopAskedError(DeviceError):
    """Somebody has asked for a stop: whatever was under way on the line ends here, and nothing more is written."""


class Line(Protocol):
    """Bytes to and from a device.

    Both methods raise LineLostError once the device is gone, and StopAskedError once a stop was asked for.
    """

    def write(self, data: bytes) -> None:
        """Write all bytes, or raise LineStalledError after the write timeout."""

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s without a byte."""


class OpenLine(Line, Protocol):
    """A line as the port offers it."""

    def is_behind(self) -> bool:
        """Whether too many bytes wait to go out."""

    def discard(self) -> None:
        """Take back what still waits to go out; of what is under way a part may be left, cut anywhere."""

    def drain(self, timeout: float) -> None:
        """Wait until everything is out, at most so many s."""

    def close(self) -> None:
        """Close it."""


class Stop:
    """Asked for by any thread, a signal's handler too; ends what another thread is doing on its line.

    Attributes:
        asked: Whether a stop was asked for and nobody has begun to carry it out.
        writing: Held while a frame is handed to the port.
    """

    def __init__(self) -> None:
        self.asked = False
        # A signal's handler may interrupt the very thread that writes: the lock must let that thread in again.
        self.writing = threading.RLock()

    def ask(self) -> None:
        """Let every `StoppableLine` refuse from now on; returns once no frame is on its way into the port."""
        self.asked = True
        with self.writing:
            return

    def begin(self) -> None:
        """Note that it is being carried out: lines work again."""
        self.asked = False

    def check(self) -> None:
        """Go on only if no stop was asked for.

        Raises:
            StopAskedError: One was.
        """
        if self.asked:
            msg = "a stop was asked for"
            raise StopAskedError(msg)


class StoppableLine:
    """A line on which everything ends at once when a stop is asked for, a wait for an answer too.

    Attributes:
        raw: The same line for who carries the stop out.
    """

    def __init__(self, raw: OpenLine, stop: Stop) -> None:
        self.raw = raw
        self._stop = stop

    def write(self, data: bytes) -> None:
        """Write all bytes, or none after a stop."""
        with self._stop.writing:
            self._stop.check()
            self.raw.write(data)

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s."""
        left = timeout
        while True:
            self._stop.check()
            data = self.raw.read(min(left, _LOOK))
            left -= _LOOK
            if data or left <= 0.0:
                return data

    def is_behind(self) -> bool:
        """Whether too many bytes wait to go out."""
        return self.raw.is_behind()
