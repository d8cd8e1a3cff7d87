"""What a back end needs of a serial line, and what may go wrong on one. No port is opened here."""

from __future__ import annotations

from typing import Protocol


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


class Line(Protocol):
    """Bytes to and from a device. Both methods raise LineLostError once the device is gone."""

    def write(self, data: bytes) -> None:
        """Write all bytes, or raise LineStalledError after the write timeout."""

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s without a byte."""
