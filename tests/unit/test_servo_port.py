"""Opening a port: every way in which it fails says what to do; when to try again; lines that do not take bytes."""

from __future__ import annotations

import errno
import grp
import os
import pty
import termios
import tty
from typing import TYPE_CHECKING

import pytest
import serial

from fin_servo_driver import port
from fin_servo_driver.line import LineLostError, LineStalledError, PortUnavailableError
from fin_servo_driver.port import BackOff, SerialLine, explain, name_warning

if TYPE_CHECKING:
    from collections.abc import Iterator
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
    with pytest.raises(PortUnavailableError, match="cannot be opened"):
        SerialLine("telepathy://fish", 57600)


def test_a_port_is_for_one_program(ends: tuple[int, str]) -> None:
    first = SerialLine(ends[1], 57600)
    with pytest.raises(PortUnavailableError, match="is busy"):
        SerialLine(ends[1], 57600)
    first.close()
    SerialLine(ends[1], 57600).close()


def test_a_loop_is_a_line_too() -> None:
    line = SerialLine("loop://", 57600)
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
