"""Calibration on emulated devices: no jump at the start where the servo measures, no force left at any end."""

from __future__ import annotations

import itertools
import os
import pty
import random
import signal
import stat
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_servo_driver import backends, calibrate_servo, robot_file
from fin_servo_driver.calibrate_servo import calibrate, main
from fin_servo_driver.calibration import Calibration
from fin_servo_driver.emulator.devices import Dynamixel, Firmata, Maestro
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.line import DeviceError, Stop, StoppableLine
from fin_servo_driver.servo_holder import UNITS_A_SECOND, Holder, Ramp
from support.waiting import PATIENCE, wait_until
from support.wire import OwnClock, Wire

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from fin_servo_driver.line import Line


class Logged(Dynamixel):
    """A bus that keeps its goals."""

    def __init__(self, servo: int, stands: float) -> None:
        super().__init__([servo], lambda _: stands)
        self.goals: list[float] = []

    def _write(self, servo: int, address: int, data: bytes) -> int:
        error = super()._write(servo, address, data)
        self.goals += [self.outputs[servo] or 0.0] if address == 116 else []
        return error


def test_what_the_driver_would_refuse_is_not_stored_and_told_and_can_be_mended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(calibrate_servo, "SerialLine", lambda *_: Wire(Firmata()))
    file = tmp_path / "robot.yaml"
    file.write_text(robot_file.find("firmata").read_text())
    before = file.read_text()

    def lines() -> Iterator[str]:
        yield from ("= 1600", "c", "= 1520", "l", "s")  # the firmware starts every servo with 1500 us
        assert file.read_text() == before
        yield from ("= 1400", "l", "s")

    monkeypatch.setattr(signal, "signal", lambda *_: None)  # this process keeps its own handlers
    monkeypatch.setattr(sys, "stdin", lines())
    assert main([str(file)]) == 0
    told = capsys.readouterr().out
    assert "not stored: joint 1: [lowest, highest] = [1520, 1800] us does not contain 1500 us" in told
    backends.make(robot_file.load(file))
    assert robot_file.load(file).servos[0].lowest == 1400.0


def test_a_servo_that_measures_is_led_to_its_centre_from_where_it_stands() -> None:
    robot, clock, stop = robot_file.load(robot_file.find("dynamixel")), OwnClock(), Stop()
    joint = robot.servos[0]
    bus = Logged(joint.channel, joint.centre - 300.0)
    backend, line = backends.make(robot, clock), StoppableLine(Wire(bus, robot.baud, clock), stop)
    backend.identify(line)
    calibration = Calibration(joint, joint.centre, backend.lowest, backend.highest)
    holder = Holder(backend, line, robot, calibration, stop, lambda _: None, clock)
    holder.enable()
    begin = clock.now
    while bus.outputs[joint.channel] != joint.centre:
        assert clock.now < begin + 2.0
        clock.sleep(1.0 / backend.rate)
        holder.step()
    assert clock.now - begin == pytest.approx(300.0 / UNITS_A_SECOND, abs=0.1)
    holder.close()
    longest = 2.0 * UNITS_A_SECOND / backend.rate + 1.0  # of two periods, however late the thread is, and rounded
    assert abs(bus.goals[0] - (joint.centre - 300.0)) <= longest
    assert max(abs(b - a) for a, b in itertools.pairwise(bus.goals)) <= longest
    assert bus.outputs[joint.channel] is None


def test_what_interrupts_the_very_start_lets_go_too(monkeypatch: pytest.MonkeyPatch) -> None:
    device = Maestro()
    monkeypatch.setattr(calibrate_servo, "SerialLine", lambda *_: Wire(device))

    def interrupted(_: object) -> None:
        assert any(device.outputs.values()), "a servo that is held"
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        calibrate(robot_file.load(robot_file.find("maestro")), 1, "", [])
    monkeypatch.undo()
    assert not any(device.outputs.values())


class Program:
    """The program with a Maestro on a pseudo-terminal; started again where the machine kept the device's answers.

    Attributes:
        said: What it has written.
    """

    def __init__(self, device: Maestro, folder: Path, *, stdin: int = subprocess.DEVNULL, warning: float = 2.0) -> None:
        self.port = PtyPort(device, folder / "port", keep=True)
        self.device = device
        self.said = folder / "said"
        slow = folder / "robot.yaml"  # so that nobody misses it on its way
        slow.write_text(robot_file.find("maestro").read_text().replace("rate: 6.0", "rate: 0.05"))
        program = f"from fin_servo_driver import calibrate_servo as c; c._WARNING_SECONDS = {warning}; exit(c.main())"
        self._command = [sys.executable, "-c", program, str(slow), "--port", str(self.port.path)]
        self._stdin = stdin
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        with self.said.open("wb") as output:
            return subprocess.Popen(
                ["env", "--ignore-signal=INT", *self._command],  # as a shell starts a job in the background
                stdin=self._stdin,
                stdout=output,
                stderr=output,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            )

    def wait_until(self, condition: Callable[[], object], what: str) -> None:
        def holds() -> bool:
            if self.process.poll() == 1 and b"answers" in self.said.read_bytes():
                self._end()
                self.process = self._start()
            return bool(condition())

        wait_until(holds, PATIENCE, lambda: f"{what}: {self.said.read_text()}")

    @property
    def is_held(self) -> bool:
        """Whether the servo has force."""
        return any(self.device.outputs.values())

    def _end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()

    def close(self) -> bytes:
        """End everything; return what the device was told."""
        self._end()
        frames = bytes(self.port.received)
        self.port.close()
        return frames


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGQUIT])
def test_a_signal_lets_go_of_the_servo(tmp_path: Path, number: signal.Signals) -> None:
    program = Program(Maestro(), tmp_path, stdin=subprocess.PIPE)
    program.wait_until(lambda: program.is_held, "a servo that is held")
    program.process.send_signal(number)
    assert program.process.wait(PATIENCE) == 128 + number
    wait_until(lambda: not program.is_held, PATIENCE, "a servo without force")
    program.close()


def test_storing_keeps_the_links_and_rights_of_the_file(tmp_path: Path) -> None:
    file, link = tmp_path / "elsewhere" / "fish.yaml", tmp_path / "robot.yaml"
    file.parent.mkdir()
    file.write_text(robot_file.find("firmata").read_text())
    file.chmod(0o664)
    link.symlink_to(file)
    robot_file.save(robot_file.load(link), link)
    assert link.is_symlink()
    assert stat.S_IMODE(file.stat().st_mode) == 0o664
    assert "Written by calibrate_servo" in file.read_text()
    assert [path.name for path in file.parent.iterdir()] == ["fish.yaml"]


@given(
    steps=st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 4095.0)), max_size=30),
    rate=st.floats(1.0, 5000.0),
)
def test_no_step_of_the_ramp_is_longer_than_the_rate_allows_since_the_last_frame_was_out(
    steps: list[tuple[float, float]], rate: float
) -> None:
    ramp, now, longest = Ramp({3: rate}, 0.04), 0.0, 0.04
    ramp.restart({3: 1500.0}, now)
    at = 1500.0
    for elapsed, wanted in steps:
        now += elapsed
        position = ramp.step({3: wanted}, now)[3]
        assert abs(position - at) <= rate * min(elapsed, longest) + 1e-6
        assert min(at, wanted) <= position <= max(at, wanted)
        at = position
        ramp.sent(now)


@pytest.mark.parametrize(
    ("name", "rate"), [("maestro", 6.0), ("maestro", 0.3), ("firmata", 6.0), ("dynamixel", 6.0), ("dynamixel", 0.25)]
)
def test_set_points_on_the_wire_keep_the_slow_rate_or_the_joint_s_own(
    name: str, rate: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the start, to a new place, on turning round half-way, and when leaving half-way, by a thread that is late."""
    text = robot_file.find(name).read_text()
    (tmp_path / "robot.yaml").write_text(text.replace("rate: 6.0", f"rate: {rate}"))
    robot = robot_file.load(tmp_path / "robot.yaml")
    joint = robot.servos[0]
    assert joint.rate == rate
    unit_rate = min(300.0, rate * joint.units_per_radian)
    clock, stop, late = OwnClock(), Stop(), random.Random(7)  # noqa: S311 - no secret
    backend, device = backends.make(robot, clock), device_for(robot, lambda _: 0.05)
    line = StoppableLine(wire := Wire(device, 0, clock), stop)
    calibration = Calibration(joint, joint.centre, backend.lowest, backend.highest)
    holder = Holder(backend, line, robot, calibration, stop, lambda _: None, clock)
    targets: list[tuple[float, float]] = []
    send, enable = backend.send, backend.enable

    def noted_send(line: Line, outputs: dict[int, float]) -> None:
        send(line, outputs)
        targets.append((wire.log[-1].at, outputs[joint.channel]))

    def noted_enable(line: Line, neutral: dict[int, float]) -> None:
        enable(line, neutral)
        targets.append((wire.log[-1].at, neutral[joint.channel]))

    monkeypatch.setattr(backend, "send", noted_send)
    monkeypatch.setattr(backend, "enable", noted_enable)

    def lead(until: Callable[[float], bool]) -> None:
        begin = clock.now
        while not until(targets[-1][1]):
            assert clock.now - begin < 4.0 + 200.0 / unit_rate
            clock.sleep((1.0 + 2.0 * late.random() ** 4) / backend.rate)
            holder.step()

    backend.identify(line)
    backend.disable(line)
    holder.enable()
    lead(lambda target: target == joint.centre)
    calibration.obey(f"= {joint.centre + 40.0}")
    lead(lambda target: target == joint.centre + 40.0)
    calibration.obey(f"= {joint.centre - 100.0}")
    lead(lambda target: target < joint.centre + 30.0)
    calibration.obey(f"= {joint.centre + 100.0}")
    lead(lambda target: target > joint.centre + 40.0)
    holder.close()
    assert not any(device.outputs.values())
    assert len(targets) > 10
    for (before, a), (after, b) in itertools.pairwise(targets):
        assert abs(b - a) <= unit_rate * (after - before) + 1e-6


def test_beyond_the_robot_file_s_range_only_after_a_yes_to_both_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_file.load(robot_file.find("firmata"))
    joint = robot.servos[0]
    device = Firmata()
    monkeypatch.setattr(calibrate_servo, "SerialLine", lambda *_: Wire(device))
    highest = [0.0]

    def lines() -> Iterator[str]:
        for command, target in (
            ("= 1820", None),  # asked, and then something else: nothing moves
            ("= 1510", 1510.0),
            ("y", 1510.0),  # no question is open
            ("= 1820", 1510.0),
            ("nonsense", 1510.0),
            ("y", 1510.0),
            ("= 1790", 1790.0),
            ("+ 15", 1790.0),
            ("y", 1805.0),
            ("h", 1805.0),
            ("= 1700", 1700.0),
            ("= 1805", 1805.0),  # measured since: inside
            ("= 1806", 1805.0),
            ("q", 1805.0),
        ):
            yield command
            if target is not None:
                wait_until(lambda t=target: device.outputs.get(joint.channel) == t, 60.0, f"{target} after {command}")  # type: ignore[misc]
            highest[0] = max(highest[0], device.outputs.get(joint.channel) or 0.0)

    calibrate(robot, 1, "", lines())
    assert highest[0] == 1805.0


def test_the_question_beyond_the_range_names_both_numbers_and_changes_nothing() -> None:
    joint = robot_file.load(robot_file.find("maestro")).servos[0]
    subject = Calibration(joint, joint.centre, 64.0, 3280.0)
    asked = subject.obey("= 1900")
    assert "1900 is beyond highest = 1800" in asked
    assert subject.position == joint.centre
    assert "1100 is beyond lowest = 1200" in subject.obey("- 400")
    assert subject.obey("y").startswith("at 1100:")
    with pytest.raises(ValueError, match="y only answers a question"):
        subject.obey("y")


@pytest.mark.parametrize("when", ["before force", "on the way", "holding"])
def test_ctrl_c_at_a_terminal_ends_the_motion_takes_the_force_away_and_moves_nothing_after(
    when: str, tmp_path: Path
) -> None:
    terminal, own = pty.openpty()
    program = Program(Maestro(), tmp_path, stdin=own, warning=2.0 * PATIENCE if when == "before force" else 0.5)
    program.wait_until(lambda: b"HANDS OFF" in program.said.read_bytes(), "the warning")
    assert b"JUMP to their centres, joint 1 to 1500 us" in program.said.read_bytes()
    if when != "before force":
        program.wait_until(lambda: program.is_held, "a servo that is held")
    if when == "on the way":
        os.write(terminal, b"= 1800\n")
        program.wait_until(lambda: (program.device.outputs.get(0) or 0.0) > 1510.0, "motion")
    program.process.send_signal(signal.SIGINT)
    program.process.send_signal(signal.SIGINT)  # a nervous hand
    assert program.process.wait(PATIENCE) == 130
    os.close(terminal)
    os.close(own)
    wait_until(lambda: not program.is_held, PATIENCE, "a servo without force")
    frames = program.close()
    off = frames.rfind(b"\x84\x00\x00\x00")
    assert off >= 0
    assert b"\x84" not in frames[off + 4 :]
    assert b"\x84\x00\x20\x38" not in frames, "1800 us, where it was not yet"
    said = program.said.read_bytes()
    assert b"Traceback" not in said
    assert b"nothing stored" in said
    assert (b"\x84\x00\x70\x2e" in frames) == (when != "before force")  # 1500 us


def test_a_servo_that_cannot_be_held_any_more_is_let_go_while_the_person_thinks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = robot_file.load(robot_file.find("maestro"))
    device = Maestro()
    monkeypatch.setattr(calibrate_servo, "SerialLine", lambda *_: Wire(device))

    def lines() -> Iterator[str]:
        wait_until(lambda: any(device.outputs.values()), 60.0, "a servo that is held")
        device.outputs[0] = 1700.0  # as after a start anew: it stands where nobody has sent it
        wait_until(lambda: not any(device.outputs.values()), 60.0, "a servo without force")
        yield "+"

    with pytest.raises(DeviceError, match="where nobody has sent it"):
        calibrate(robot, 1, "", lines())
    assert "the servo is let go" in capsys.readouterr().out
