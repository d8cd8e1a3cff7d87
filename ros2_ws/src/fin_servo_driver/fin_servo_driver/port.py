"""The serial port: opened for us alone, bounded in time, with errors that say what to do."""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import re
import select
import stat
import termios
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import serial

from fin_servo_driver.line import LineLostError, LineStalledError, PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Collection

WRITE_TIMEOUT = 0.05
"""s. Three set-points of a pulse servo: a line that takes none for so long is not worth waiting for."""
FRAMES_WAITING = 2
"""Frames that may wait in the port's buffer; more are set-points of the past."""
_GONE = (OSError, termios.error)
"""What pyserial raises when a port has vanished. The second is no OSError, and comes out of pyserial as it is."""
SCHEMES = ("alt", "hwgrep", "loop", "rfc2217", "socket", "spy")
"""Of pyserial's URLs: a port may be one only where whoever started the program has allowed its scheme by name."""
_ON_A_DEVICE = ("alt", "spy")
"""Schemes whose URLs hold the path of a device, which is checked like any other."""
_DRIVERS = Path("/proc/tty/drivers")
_SERIAL_DRIVERS = ("serial", "pty:slave")
"""As the kernel calls what serial ports and pseudo-terminals are, against consoles and the like."""
_NAME_THAT_CHANGES = re.compile(r"/dev/tty(USB|ACM)\d+")


class SerialLine:
    """A line of `line.Line` on a serial port or a pseudo-terminal."""

    def __init__(self, port: str, baud: int, schemes: Collection[str] = ()) -> None:
        """Open the port.

        Args:
            port: Its absolute path, or a URL of pyserial.
            baud: Bits a second.
            schemes: The URL schemes of `SCHEMES` that are allowed; see `require_port`.

        Raises:
            PortUnavailableError: It is no serial port, absent, busy or not permitted; the message says what to do.
        """
        self.port = port
        self._longest_frame = 1
        require_port(port, schemes)
        try:
            self._is_url = "://" in port
            self._serial = serial.serial_for_url(port, do_not_open=True) if self._is_url else serial.Serial()
            self._serial.port = port
            self._serial.baudrate = baud
            self._serial.exclusive = True
            self._serial.timeout = 0.0
            self._serial.write_timeout = WRITE_TIMEOUT
            self._serial.open()
        except (*_GONE, ValueError) as error:
            raise PortUnavailableError(explain(port, error)) from error
        # A USB adapter by FTDI otherwise keeps what it has received for 16 ms.
        with contextlib.suppress(ValueError, NotImplementedError, OSError, AttributeError):
            self._serial.set_low_latency_mode(True)

    def write(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            LineStalledError: The port took no bytes for `WRITE_TIMEOUT`.
            LineLostError: The port is gone.
        """
        self._longest_frame = max(self._longest_frame, len(data))
        try:
            taken = self._taken(data)
        except _GONE as error:
            raise LineLostError(self._lost(error)) from error
        if not taken:
            msg = f"{self.port} took no bytes for {WRITE_TIMEOUT:g} s: is the device's buffer full, or flow control on?"
            raise LineStalledError(msg)

    def _taken(self, data: bytes) -> bool:
        """Write; return whether all bytes were taken in time.

        Of a device not by pyserial, which calls a frame late that the port has taken whole, if it looks at the clock
        late itself, or if the port has no room for more.
        """
        if self._is_url:
            try:
                self._serial.write(data)
            except serial.SerialTimeoutException:
                return False
            return True
        end = time.monotonic() + WRITE_TIMEOUT
        device, rest = self._serial.fileno(), memoryview(data)
        while rest:
            # First asked, then timed: a port with room takes its bytes however late this process is.
            _, ready, _ = select.select([], [device], [], max(0.0, end - time.monotonic()))
            if not ready:
                return False
            with contextlib.suppress(BlockingIOError):
                rest = rest[os.write(device, rest) :]
        return True

    def read(self, timeout: float) -> bytes:
        """Return what has come, as soon as anything has; empty after ``timeout`` s.

        Raises:
            LineLostError: The port is gone.
        """
        try:
            waiting = self._serial.in_waiting
            if waiting or timeout <= 0.0:
                return self._serial.read(waiting) if waiting else b""
            self._serial.timeout = timeout
            return self._serial.read(1) + self._serial.read(self._serial.in_waiting)
        except _GONE as error:
            raise LineLostError(self._lost(error)) from error

    def is_behind(self) -> bool:
        """Whether so many bytes wait to go out that another set-point would be late.

        Raises:
            LineLostError: The port is gone.
        """
        try:
            return bool(self._serial.out_waiting > FRAMES_WAITING * self._longest_frame)
        except (AttributeError, NotImplementedError):
            return False  # sockets and the like do not know
        except _GONE as error:
            raise LineLostError(self._lost(error)) from error

    def discard(self) -> None:
        """Take back what still waits to go out; a frame may be cut."""
        with contextlib.suppress(*_GONE, AttributeError, NotImplementedError):
            self._serial.reset_output_buffer()

    def drain(self, timeout: float) -> None:
        """Wait until everything is out, at most ``timeout`` s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            try:
                if not self._serial.out_waiting:
                    return
            except (*_GONE, AttributeError, NotImplementedError):
                return
            time.sleep(0.001)

    def close(self) -> None:
        """Close the port. One that is gone already is no error here; bytes that it does not take are given up."""
        with contextlib.suppress(*_GONE, LineLostError):
            if self.is_behind():
                self._serial.reset_output_buffer()  # the kernel would wait for them for half a minute
        with contextlib.suppress(*_GONE):
            self._serial.close()

    def _lost(self, error: Exception) -> str:
        return f"{self.port} was lost ({_text(error)}): is the cable in, and has the device power?"


def require_port(port: str, schemes: Collection[str] = ()) -> None:
    """Refuse what is no serial port.

    Whoever is on the graph may name a port, and to open one may do harm: URLs of pyserial overwrite files and call
    other computers, a file would be written into, a pipe waited for. A path that is not there, or must not be looked
    at, passes: to open it says so.

    Args:
        port: Path or URL.
        schemes: The URL schemes that are allowed.

    Raises:
        PortUnavailableError: It is refused; the message says why.
    """
    scheme, is_url, _ = port.partition("://")
    if is_url:
        if scheme.lower() not in schemes:
            known = f": a URL of {scheme.lower()} needs port_schemes:=[{scheme.lower()}] at the start"
            _refuse(port, f"ports are the absolute paths of devices{known if scheme.lower() in SCHEMES else ''}")
        parts = urlsplit(port)
        if "file" in parse_qs(parts.query, keep_blank_values=True):
            _refuse(port, "no port may name a file to write; without file= its bytes are shown on the terminal")
        if scheme.lower() not in _ON_A_DEVICE:
            return
        port = parts.netloc + parts.path
    path = Path(port)
    if not path.is_absolute() or "\0" in port:
        _refuse(port, "ports are absolute paths of devices, like /dev/serial/by-id/...")
    try:
        status = path.stat()  # of what a link leads to
    except OSError:
        return
    if not stat.S_ISCHR(status.st_mode):
        kind = next((name for is_it, name in _KINDS if is_it(status.st_mode)), "no device")
        _refuse(port, f"it is {kind}, and no serial device")
    if not _is_serial(status.st_rdev):
        _refuse(port, "it is a device, but no serial port and no pseudo-terminal")


_KINDS = (
    (stat.S_ISREG, "a file"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISBLK, "a disk"),
)


def _refuse(port: str, reason: str) -> None:
    msg = f"port {port!r} is refused: {reason}. {available()}"
    raise PortUnavailableError(msg)


def _is_serial(device: int) -> bool:
    """Whether the kernel lists a device number among its serial ports and pseudo-terminals; yes if it has no list."""
    try:
        lines = _DRIVERS.read_text(encoding="ascii").splitlines()
    except OSError:
        return True
    for line in lines:
        *_, major, minors, kind = line.split()
        first, _, last = minors.partition("-")
        if int(major) == os.major(device) and int(first) <= os.minor(device) <= int(last or first):
            return kind in _SERIAL_DRIVERS
    return False


def explain(port: str, error: Exception) -> str:
    """Return why a port could not be opened, and what to do."""
    number = getattr(error, "errno", None)
    text = _text(error)
    path = Path(port)
    if number in {errno.ENOENT, errno.ENXIO, errno.ENODEV} or "No such file" in text:
        return f"port {port} is absent: is the device plugged in? {available()}"
    if number == errno.EACCES or "Permission denied" in text:
        return f"port {port} is not permitted to you: {_permission_advice(path)}"
    if number in {errno.EBUSY, errno.EWOULDBLOCK} or "exclusively lock" in text:
        return f"port {port} is busy: close the other program that uses it (`fuser {port}` names it)"
    return f"port {port} cannot be opened: {text}. {available()}"


def _text(error: Exception) -> str:
    return str(error.args[1]) if isinstance(error, termios.error) else str(error)


def _permission_advice(path: Path) -> str:
    try:
        status = path.stat()
        group = grp.getgrgid(status.st_gid).gr_name
    except (OSError, KeyError):
        return "ask the owner of the file for read and write access"
    if not status.st_mode & stat.S_IWGRP:
        return f"its group {group} may not write either; `sudo chmod g+rw {path}`, or mend the udev rule"
    return f"it belongs to the group {group}; `sudo usermod -aG {group} $USER`, then log in anew"


def available() -> str:
    """Return the ports of this machine as a sentence; those by id first, since their names stay."""
    folder = Path("/dev/serial/by-id")
    found = sorted(map(str, folder.iterdir())) if folder.is_dir() else []
    if not found:
        found = sorted(str(path) for path in Path("/dev").glob("tty[UA][SC][BM]*"))
    return f"There is {', '.join(found)}." if found else "No serial device is plugged in."


def name_warning(port: str) -> str:
    """Return a warning for a port's name that may be another device's tomorrow, or an empty text."""
    if _NAME_THAT_CHANGES.fullmatch(port):
        return f"port {port} may be another device after a replug: use its name in /dev/serial/by-id"
    return ""


def is_present(port: str) -> bool:
    """Whether the port's file is there; a URL always counts as there."""
    return "://" in port or os.path.exists(port)  # noqa: PTH110 - a string that may be no path at all


class BackOff:
    """When to try to reconnect: after 0.2 s, then ever more slowly up to 5 s, and at once when the port comes back."""

    shortest = 0.2
    longest = 5.0

    def __init__(self) -> None:
        self._wait = self.shortest
        self._next = 0.0
        self._was_present = True

    def restart(self, now: float) -> None:
        """Begin anew at ``now`` s."""
        self._wait = self.shortest
        self._next = now + self.shortest
        self._was_present = True

    def due(self, now: float, *, present: bool) -> bool:
        """Whether to try now; a port that has just come back is tried at once."""
        appeared = present and not self._was_present
        self._was_present = present
        if appeared:
            self._wait = self.shortest
        return present and (appeared or now >= self._next)

    def failed(self, now: float) -> None:
        """Wait longer before the next try."""
        self._next = now + self._wait
        self._wait = min(2.0 * self._wait, self.longest)
