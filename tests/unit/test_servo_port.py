"""Opening a port: every way in which it fails says what to do; when to try again; lines that do not take bytes."""

from __future__ import annotations

import errno
import grp
import os
import pty
import socket
import termios
import time
import tty
from typing import TYPE_CHECKING

import pytest
import serial

from fin_servo_driver import port
from fin_servo_driver.emulator.devices import Firmata
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.line import LineLostError, LineStalledError, PortUnavailableError
from fin_servo_driver.port import BackOff, SerialLine, explain, name_warning

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path


@pytest.fixture
def ends() -> Iterator[tuple[int, str]]:
    """A pty: its master's descriptor and its slave's name."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    yield master, name
    try:
        os.close(master)
    except OSError:
        return


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.ENOENT, "is absent: is the device plugged in?"),
        (errno.ENXIO, "is absent"),
        (errno.EBUSY, "is busy: close the other program that uses it"),
        (errno.EIO, "cannot be opened"),
    ],
)
def test_a_failure_says_what_to_do(number: int, says: str) -> None:
    assert says in explain("/dev/ttyACM9", OSError(number, os.strerror(number)))


def test_a_missing_permission_names_the_group(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.touch()
    path.chmod(0o660)
    group = grp.getgrgid(path.stat().st_gid).gr_name
    said = explain(str(path), PermissionError(errno.EACCES, "Permission denied"))
    assert f"it belongs to the group {group}; `sudo usermod -aG {group} $USER`" in said
    path.chmod(0o600)
    assert "may not write either" in explain(str(path), PermissionError(errno.EACCES, "Permission denied"))
    assert "ask the owner" in explain(str(tmp_path / "gone"), PermissionError(errno.EACCES, "Permission denied"))


def test_an_absent_port_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(PortUnavailableError, match="is absent"):
        SerialLine(str(tmp_path / "none"), 57600)


def test_an_unknown_url_cannot_be_opened() -> None:
    with pytest.raises(PortUnavailableError, match="is refused: ports are the absolute paths of devices"):
        SerialLine("telepathy://fish", 57600)


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """A server on this computer that nobody may call."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.0)
        yield server


@pytest.mark.parametrize("scheme", [*port.SCHEMES, "SPY", "Socket", "cp2110", "file", "http"])
def test_a_url_is_no_port(scheme: str, tmp_path: Path, listener: socket.socket, ends: tuple[int, str]) -> None:
    victim = tmp_path / "notes"
    victim.write_text("kept")
    host = f"127.0.0.1:{listener.getsockname()[1]}"
    for rest in (f"{ends[1]}?file={victim}", host, str(victim), f"{victim}?file={victim}", ""):
        with pytest.raises(PortUnavailableError, match=r"is refused: ports are the absolute paths of devices"):
            SerialLine(f"{scheme}://{rest}", 57600)
    assert victim.read_text() == "kept"
    with pytest.raises(BlockingIOError):
        listener.accept()


def test_a_scheme_that_was_allowed_opens_and_no_other_does(listener: socket.socket) -> None:
    url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
    line = SerialLine(url, 57600, ["socket"])
    listener.accept()[0].close()
    line.close()
    with pytest.raises(PortUnavailableError, match=r"needs port_schemes:=\[socket\] at the start"):
        SerialLine(url, 57600, ["loop", "spy"])


@pytest.mark.parametrize("file", ["file=", "file=%2e/notes&file=x", "all&file"])
def test_no_port_names_a_file_even_where_its_scheme_is_allowed(file: str, ends: tuple[int, str]) -> None:
    with pytest.raises(PortUnavailableError, match="no port may name a file to write"):
        SerialLine(f"spy://{ends[1]}?{file}", 57600, port.SCHEMES)
    SerialLine(f"spy://{ends[1]}", 57600, ["spy"]).close()


@pytest.mark.parametrize("scheme", ["", "spy://", "alt://"])
@pytest.mark.parametrize("kind", ["a file", "a folder", "a pipe", "a socket"])
@pytest.mark.parametrize("linked", [False, True])
def test_what_is_no_device_is_neither_opened_nor_changed(scheme: str, kind: str, linked: bool, tmp_path: Path) -> None:
    path = tmp_path / "port"
    with socket.socket(socket.AF_UNIX) as server:
        make: dict[str, Callable[[], object]] = {
            "a file": lambda: path.write_text("kept"),
            "a folder": path.mkdir,
            "a pipe": lambda: os.mkfifo(path),
            "a socket": lambda: server.bind(str(path)),
        }
        make[kind]()
        name = path
        if linked:
            name = tmp_path / "link"
            name.symlink_to(path)
        with pytest.raises(PortUnavailableError, match=f"it is {kind}, and no serial device"):
            SerialLine(f"{scheme}{name}", 57600, port.SCHEMES)
    assert not path.is_file() or path.read_text() == "kept"


@pytest.mark.parametrize("path", ["/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/tty", "/dev/ptmx"])
def test_a_device_that_is_no_serial_port_is_refused(path: str) -> None:
    with pytest.raises(PortUnavailableError, match="no serial port and no pseudo-terminal"):
        SerialLine(path, 57600)


def test_kernels_serial_drivers_are_told_by_their_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drivers = tmp_path / "drivers"  # as a desktop with two adapters lists them
    drivers.write_text(
        "/dev/tty             /dev/tty        5       0 system:/dev/tty\n"
        "usbserial            /dev/ttyUSB   188 0-511 serial\n"
        "acm                  /dev/ttyACM   166 0-255 serial\n"
        "serial               /dev/ttyS       4 64-95 serial\n"
        "pty_slave            /dev/pts      136 0-1048575 pty:slave\n"
        "unknown              /dev/tty        4 1-63 console\n"
    )
    monkeypatch.setattr(port, "_DRIVERS", drivers)
    assert all(port._is_serial(os.makedev(*number)) for number in ((188, 0), (166, 3), (4, 64), (136, 70)))
    assert not any(port._is_serial(os.makedev(*number)) for number in ((4, 1), (5, 0), (1, 3), (10, 130)))


@pytest.mark.parametrize("path", ["ttyUSB0", "./port", "../dev/ttyUSB0", "~/port", "", " /dev/ttyUSB0", "/dev/tty\0"])
def test_a_port_is_an_absolute_path(path: str) -> None:
    with pytest.raises(PortUnavailableError, match="ports are absolute paths of devices"):
        SerialLine(path, 57600)


def test_a_port_is_for_one_program(ends: tuple[int, str]) -> None:
    first = SerialLine(ends[1], 57600)
    with pytest.raises(PortUnavailableError, match="is busy"):
        SerialLine(ends[1], 57600)
    first.close()
    SerialLine(ends[1], 57600).close()


def test_a_loop_is_a_line_too() -> None:
    line = SerialLine("loop://", 57600, ["loop"])
    line.write(b"abc")
    assert line.read(0.1) == b"abc"
    assert line.read(0.0) == b""
    assert line.is_behind() is False
    line.close()


def test_bytes_go_both_ways_on_a_pty(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1], 57600)
    line.write(b"\xe9\x5c\x0b")
    assert os.read(ends[0], 10) == b"\xe9\x5c\x0b"
    os.write(ends[0], b"\xf9\x02\x05")
    assert line.read(1.0) == b"\xf9\x02\x05"
    line.close()


def test_a_frame_that_the_port_has_taken_is_not_late_because_its_writer_is(
    ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write

    def slow(descriptor: int, data: bytes) -> int:
        taken = write(descriptor, data)
        time.sleep(2.0 * port.WRITE_TIMEOUT)  # as a process that gets no processor
        return taken

    monkeypatch.setattr("os.write", slow)
    line = SerialLine(ends[1], 57600)
    line.write(b"\xe9\x5c\x0b")
    monkeypatch.undo()
    assert os.read(ends[0], 10) == b"\xe9\x5c\x0b"
    line.close()


def test_a_port_that_takes_no_more_bytes_is_stalled(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1], 57600)
    with pytest.raises(LineStalledError, match=r"took no bytes for 0\.05 s"):
        line.write(bytes(100_000))  # more than a pseudo-terminal holds
    line.close()


def test_an_unplugged_port_is_lost_in_every_call(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1], 57600)
    os.close(ends[0])
    for call in (lambda: line.write(b"x"), lambda: line.read(0.0), lambda: line.read(0.01)):
        with pytest.raises(LineLostError, match="is the cable in"):
            call()
    line.drain(0.1)
    line.close()


@pytest.mark.parametrize("function", ["tcsetattr", "tcflush"])
def test_a_port_that_vanishes_while_it_is_opened_cannot_be_opened(
    ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch, function: str
) -> None:
    def vanished(*_: object) -> None:
        raise termios.error(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(termios, function, vanished)
    with pytest.raises(PortUnavailableError, match="cannot be opened: Input/output error"):
        SerialLine(ends[1], 57600)
    monkeypatch.undo()
    SerialLine(ends[1], 57600).close()


def test_a_port_that_vanishes_later_is_lost_and_can_be_closed(
    ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def vanished(*_: object) -> None:
        raise termios.error(errno.EIO, os.strerror(errno.EIO))

    line = SerialLine(ends[1], 57600)
    line.write(b"123")
    monkeypatch.setattr(serial.Serial, "out_waiting", 1000)
    monkeypatch.setattr(serial.Serial, "_reconfigure_port", vanished)
    monkeypatch.setattr(termios, "tcflush", vanished)
    with pytest.raises(LineLostError, match="Input/output error"):
        line.read(0.01)
    line.close()
    monkeypatch.undo()
    SerialLine(ends[1], 57600).close()


def test_a_line_that_takes_nothing_stalls_within_the_timeout(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1], 57600)
    with pytest.raises(LineStalledError, match=r"took no bytes for 0\.05 s"):
        line.write(bytes(200_000))  # a pty takes some thousand before it is full
    line.close()


def test_more_than_two_frames_waiting_are_a_line_that_is_behind(
    ends: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = SerialLine(ends[1], 57600)
    line.write(b"123")
    for waiting, behind in ((0, False), (6, False), (7, True)):
        monkeypatch.setattr(serial.Serial, "out_waiting", waiting)
        assert line.is_behind() is behind
    line.close()


def test_a_name_that_may_be_another_device_tomorrow_is_warned_of() -> None:
    assert "use its name in /dev/serial/by-id" in name_warning("/dev/ttyUSB0")
    assert "by-id" in name_warning("/dev/ttyACM12")
    assert name_warning("/dev/serial/by-id/usb-Arduino") == ""
    assert name_warning("/dev/pts/3") == ""


def test_the_back_off_grows_from_a_fifth_of_a_second_to_five() -> None:
    back_off, now, waits = BackOff(), 100.0, []
    back_off.restart(now)
    for _ in range(8):
        begin = now
        while not back_off.due(now, present=True):
            now += 0.01
        waits.append(now - begin)
        back_off.failed(now)
    assert waits == pytest.approx([0.2, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0], abs=0.02)


def test_a_port_that_comes_back_is_tried_at_once() -> None:
    back_off = BackOff()
    back_off.restart(0.0)
    for now in (1.0, 2.0, 4.0, 8.0):
        assert back_off.due(now, present=True)
        back_off.failed(now)
        assert not back_off.due(now + 0.01, present=False)
    assert back_off.due(8.02, present=True)


def test_an_absent_port_is_not_tried() -> None:
    back_off = BackOff()
    back_off.restart(0.0)
    assert not back_off.due(100.0, present=False)


def test_presence_follows_the_file(tmp_path: Path) -> None:
    path = tmp_path / "port"
    assert not port.is_present(str(path))
    path.touch()
    assert port.is_present(str(path))
    assert port.is_present("socket://robot:4000")


def test_an_emulated_port_takes_no_files_place(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.write_text("kept")
    with pytest.raises(FileExistsError, match="is no link"):
        PtyPort(Firmata(), path)
    assert path.read_text() == "kept"
