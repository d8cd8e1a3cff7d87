"""Calibration on emulated devices: no jump at the start where the servo measures, no force left at any end."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

import pytest

from fin_servo_driver import backends, robot_file
from fin_servo_driver.calibrate_servo import Calibration, Holder, calibrate, main
from fin_servo_driver.emulator.devices import Dynamixel, Firmata, Maestro
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.port import SerialLine
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


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
    port = PtyPort(Firmata(), tmp_path / "port")
    file = tmp_path / "robot.yaml"
    file.write_text(robot_file.find("firmata").read_text())
    before = file.read_text()

    def lines() -> Iterator[str]:
        yield from ("= 1600", "c", "= 1520", "l", "s")  # the firmware starts every servo with 1500 us
        assert file.read_text() == before
        yield from ("= 1400", "l", "s")

    monkeypatch.setattr(signal, "signal", lambda *_: None)  # this process keeps its own handlers
    monkeypatch.setattr(sys, "stdin", lines())
    assert main([str(file), "--port", str(port.path)]) == 0
    port.close()
    told = capsys.readouterr().out
    assert "not stored: joint 1: [lowest, highest] = [1520, 1800] us does not contain 1500 us" in told
    backends.make(robot_file.load(file))
    assert robot_file.load(file).servos[0].lowest == 1400.0


def test_a_servo_that_measures_is_led_to_its_centre_from_where_it_stands(tmp_path: Path) -> None:
    robot = robot_file.load(robot_file.find("dynamixel"))
    joint = robot.servos[0]
    bus = Logged(joint.channel, joint.centre - 300.0)
    port = PtyPort(bus, tmp_path / "port")
    backend, line = backends.make(robot), SerialLine(str(port.path), robot.baud)
    backend.identify(line)
    holder = Holder(backend, line, robot, Calibration(joint, joint.centre, backend.lowest, backend.highest))
    holder.start()
    wait_until(lambda: bus.outputs.get(joint.channel) == joint.centre, 5.0, "the centre")
    holder.close()
    line.close()
    port.close()
    assert abs(bus.goals[0] - (joint.centre - 300.0)) <= 4.0
    assert max(abs(b - a) for a, b in zip(bus.goals, bus.goals[1:], strict=False)) <= 4.0  # 300 a second, 100 a second
    assert bus.outputs[joint.channel] is None


def test_what_interrupts_the_very_start_lets_go_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = PtyPort(Maestro(), tmp_path / "port")
    robot = robot_file.load(robot_file.find("maestro"))

    def interrupted(_: object) -> None:
        wait_until(lambda: any(port.device.outputs.values()), 2.0, "a servo that is held")
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        calibrate(robot, 1, str(port.path), [])
    monkeypatch.undo()
    wait_until(lambda: not any(port.device.outputs.values()), 1.0, "a servo without force")
    port.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_lets_go_of_the_servo(tmp_path: Path, number: signal.Signals) -> None:
    port = PtyPort(Maestro(), tmp_path / "port")
    background_job = ["env", "--ignore-signal=INT"]
    program_itself = [sys.executable, "-m", "fin_servo_driver.calibrate_servo", str(robot_file.find("maestro"))]
    command = [*background_job, *program_itself]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [*command, "--port", str(port.path)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment
    ) as program:
        wait_until(lambda: any(port.device.outputs.values()), 10.0, "a servo that is held")
        program.send_signal(number)
        assert program.wait(10.0) == 128 + number
    wait_until(lambda: not any(port.device.outputs.values()), 1.0, "a servo without force")
    port.close()


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
