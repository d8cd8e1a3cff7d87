"""The I/O thread on emulated devices: plug and replug, silence, garbage, stalls, leaks."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import PAPER_GAIT, smooth_step
from fin_servo_driver import backends, io_thread, robot_file
from fin_servo_driver.emulator import packets
from fin_servo_driver.emulator.devices import Device, Dynamixel, Firmata
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.io_thread import IoThread, Mailbox
from fin_servo_driver.line import DeviceError, LineLostError, LineStalledError, WrongDeviceError
from fin_servo_driver.port import SerialLine
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import Command, Phase, Settings
from support.waiting import PATIENCE, wait_until
from support.wire import OwnClock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from fin_servo_driver.backends.backend import Backend

RECOVERY = 2.0
"""s after a port is back within which the driver must be, too."""
ALL = tuple(backends.BACKENDS)


@dataclass
class Rig:
    """An emulated device and the thread that drives it."""

    port: PtyPort
    thread: IoThread
    motion: Motion
    reports: list[str]

    def start(self) -> None:
        """Open the port, again where the device's answers come too late: both share the processor."""

        def is_started() -> bool:
            with contextlib.suppress(DeviceError):
                self.thread.start()
            return self.thread.alive

        wait_until(is_started, PATIENCE, lambda: f"the device: {self.reports}")

    def gait(self) -> None:
        """Send the paper's gait."""
        self.thread.mailbox.put(Command(self.motion.allowed(PAPER_GAIT, 0.2617, 5.0), time.monotonic()))

    def repeat_until(self, condition: Callable[[], object], timeout: float, what: str) -> None:
        """Send the gait again and again until the condition holds."""

        def send() -> None:
            self.gait()
            time.sleep(0.02)

        wait_until(condition, timeout, lambda: f"{what}: {self.thread.health}", send)

    def driven(self) -> bool:
        """Whether the device gives force to anything."""
        relays = isinstance(self.motion, RelayMotion)
        return any(value if relays else value is not None for value in self.port.device.outputs.values())


def rig_of(name: str, folder: Path, device: Device | None = None) -> Rig:
    robot = robot_file.load(robot_file.find(name))
    backend = backends.make(robot)
    motion: Motion
    motion = RelayMotion(robot.relays, robot.timing, 0.01) if robot.relays else ServoMotion(robot.servos, 0.02)
    port = PtyPort(device or device_for(robot, lambda _: 0.0), folder / "port")
    reports: list[str] = []
    thread = IoThread(
        backend,
        motion,
        Settings(0.5, 0.2),
        lambda: SerialLine(str(port.path), robot.baud),
        str(port.path),
        reports.append,
    )
    return Rig(port, thread, motion, reports)


@pytest.fixture
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    made = rig_of(getattr(request, "param", "firmata"), tmp_path)
    made.start()
    yield made
    made.thread.close()
    made.port.close()


def arm(rig: Rig) -> None:
    rig.thread.arm()
    assert rig.thread.wait_for({Phase.SILENT}, PATIENCE)


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_moves_when_told_and_is_safe_after_the_end(rig: Rig) -> None:
    arm(rig)
    assert not rig.driven()
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.repeat_until(lambda: rig.thread.health.ticks > 30, 3.0, "set-points")
    rig.thread.close()
    wait_until(lambda: not rig.driven(), 1.0, "silence")


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_is_silenced_by_a_cut(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.thread.cut()
    wait_until(lambda: not rig.driven(), 0.5, "silence")


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_is_silenced_when_the_commander_is(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    wait_until(lambda: not rig.driven() and rig.thread.health.phase is Phase.SILENT, 2.0, "silence")
    assert rig.thread.health.timeouts >= 1  # one more where this test was put aside while it commanded


@pytest.mark.parametrize("rig", ["dynamixel", "maestro", "modbus"], indirect=True)
def test_a_device_that_answers_is_missed_when_it_falls_silent(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.port.silent = True
    rig.repeat_until(lambda: not rig.thread.health.connected, 6.0, "loss")
    assert "silent" in rig.thread.health.reason or "did not" in rig.thread.health.reason
    rig.port.silent = False
    wait_until(lambda: rig.thread.health.connected, 8.0, "reconnection")


def test_a_dynamixel_reports_what_it_measures(tmp_path: Path) -> None:
    made = rig_of("dynamixel", tmp_path)
    made.start()
    arm(made)
    made.repeat_until(lambda: made.thread.health.voltage == 12.0, 4.0, "voltage")
    assert made.thread.health.temperature == 35.0
    # On a machine that is busy enough an answer comes too late now and then; then the sample says so.
    measured = [sample.measured for sample in made.thread.samples]
    assert sum(measured) > len(measured) / 2
    made.thread.close()
    made.port.close()


def test_a_dynamixel_stops_by_its_bus_watchdog_when_its_driver_is_gone(tmp_path: Path) -> None:
    made = rig_of("dynamixel", tmp_path)
    made.start()
    arm(made)
    made.repeat_until(lambda: abs((made.port.device.outputs.get(1) or 2048.0) - 2048.0) > 50.0, 3.0, "stroke")
    line = made.thread._line
    made.thread._line = None  # as a kill would leave it: not a byte more
    assert line is not None
    wait_until(lambda: made.port.device.tables[1][98] == 0xFF, 1.0, "trip of the watchdog")  # type: ignore[attr-defined]
    line.raw.close()
    made.thread.close()
    made.port.close()


@pytest.mark.parametrize("rig", ["dynamixel", "maestro", "modbus"], indirect=True)
def test_a_device_that_keeps_its_power_over_a_replug_is_disabled_when_it_is_back(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.port.unplug(powered=True)
    rig.repeat_until(lambda: not rig.thread.health.connected, 2.0, "loss")
    rig.thread.cut()
    rig.port.plug()
    wait_until(lambda: rig.thread.health.connected, RECOVERY, "reconnection")
    assert not rig.driven()


@pytest.mark.parametrize(("name", "channel", "value"), [("maestro", 0, 1700.0), ("modbus", 0, 1.0), ("lcus", 1, 1.0)])
def test_what_a_killed_driver_has_left_on_ends_when_the_next_one_is_configured(
    tmp_path: Path, name: str, channel: int, value: float
) -> None:
    made = rig_of(name, tmp_path)
    made.port.device.outputs[channel] = value
    assert made.driven()
    made.start()
    wait_until(lambda: not made.driven(), 1.0, "silence")
    assert made.thread.health.phase is Phase.DISARMED
    made.thread.close()
    made.port.close()


@pytest.mark.parametrize("rig", ["dynamixel", "modbus"], indirect=True)
def test_a_cut_whose_frames_are_lost_is_repeated_until_the_device_has_taken_it(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.port.silent = True
    rig.thread.cut()
    wait_until(lambda: any("while making the device safe" in text for text in rig.reports), 3.0, "a failed cut")
    assert rig.driven()
    rig.port.silent = False
    wait_until(lambda: not rig.driven(), 3.0, "silence")


def test_a_board_that_starts_anew_by_itself_is_a_fault_and_waits_for_a_fresh_gait(tmp_path: Path) -> None:
    class BrownOut(Firmata):
        restarts = False

        def feed(self, data: bytes, now: float) -> bytes:
            if self.restarts:
                self.restarts = False
                return self.opened(now)
            return super().feed(data, now)

    board = BrownOut()
    made = rig_of("firmata", tmp_path, board)
    made.start()
    arm(made)
    made.repeat_until(lambda: made.thread.health.ticks > 60, 3.0, "more than a second of set-points")
    board.restarts = True
    made.repeat_until(lambda: not made.thread.health.connected, 1.0, "loss")
    assert "started anew by itself" in made.thread.health.reason
    wait_until(lambda: made.thread.health.connected, RECOVERY, "reconnection")
    assert not made.driven()
    made.repeat_until(made.driven, 2.0, "motion after a fresh gait")
    made.thread.close()
    made.port.close()


def test_a_servo_outside_its_range_is_not_made_to_jump_into_it(tmp_path: Path) -> None:
    robot = robot_file.load(robot_file.find("dynamixel"))
    beyond = 1.1 * max(abs(robot.servos[0].angle_at(end)) for end in (robot.servos[0].lowest, robot.servos[0].highest))
    angle = [beyond]
    made = rig_of("dynamixel", tmp_path, device_for(robot, lambda _: angle[0]))
    made.start()
    arm(made)
    made.repeat_until(lambda: "bring the tail inside by hand" in made.thread.health.refusal, 2.0, "refusal")
    assert not made.driven()
    angle[0] = 0.1
    made.repeat_until(made.driven, 2.0, "motion")
    assert made.thread.health.refusal == ""
    made.thread.close()
    made.port.close()


def test_a_servo_that_does_not_tell_where_it_stands_is_not_started(tmp_path: Path) -> None:
    class Mute(Dynamixel):
        mute = True

        def feed(self, data: bytes, now: float) -> bytes:
            asks_positions = b"\x82\x84\x00\x04\x00" in data  # a sync read of the present positions
            return b"" if self.mute and asks_positions else super().feed(data, now)

    robot = robot_file.load(robot_file.find("dynamixel"))
    bus = Mute([joint.channel for joint in robot.servos], lambda _: 1600.0)
    made = rig_of("dynamixel", tmp_path, bus)
    made.start()
    arm(made)
    made.repeat_until(lambda: made.thread.health.refusal, 0.4, "refusal")
    assert not made.driven()
    made.thread.close()
    made.port.close()


def test_a_complaint_of_the_device_is_told_for_some_seconds_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(io_thread, "_FAULT_SHOWN", 0.2)
    line, told = Broken(), set[str]()
    thread, _ = thread_on(line, [])
    publish = thread._publish_health

    def publish_and_note() -> None:
        publish()
        told.add(thread.health.fault)

    monkeypatch.setattr(thread, "_publish_health", publish_and_note)
    start_armed(thread)
    line.failure, line.failures_left = LineStalledError("took no bytes"), 3
    wait_until(lambda: "took no bytes" in told, 1.0, "complaint", lambda: command(thread))
    wait_until(lambda: thread.health.fault == "", 2.0, "the end of the complaint")
    assert thread.health.connected
    thread.close()


def leaks() -> tuple[int, int]:
    """Return how many threads and open files this process has."""
    return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.long
def test_a_hundred_replugs_under_a_running_gait(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    before, recoveries = leaks(), []
    random = np.random.default_rng(1)
    for number in range(100):
        rig.port.unplug()
        rig.repeat_until(lambda: not rig.thread.health.connected, 2.0, "loss")
        away = float(random.choice([0.0, 0.05, 0.3, 1.0]))
        gone = time.monotonic()
        while time.monotonic() < gone + away:
            rig.gait()
            time.sleep(0.02)
        rig.port.plug()
        back = time.monotonic()
        # Nobody commands anything after the port is back, so nothing may move.
        wait_until(lambda: rig.thread.health.connected, RECOVERY, f"reconnection {number}")
        recoveries.append(time.monotonic() - back)
        sent = rig.thread.health.ticks
        time.sleep(0.06)
        assert not rig.driven()
        assert rig.thread.health.ticks == sent
        rig.repeat_until(rig.driven, 2.0, "motion after a fresh gait")
    assert rig.thread.health.reconnects == 100
    assert leaks() == before
    print(f"recovered within {max(recoveries):.2f} s, median {np.median(recoveries):.2f} s")  # noqa: T201


def test_replugs_recover_and_wait_for_a_fresh_gait(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    before = leaks()
    for _ in range(3):
        rig.port.unplug()
        rig.repeat_until(lambda: not rig.thread.health.connected, 2.0, "loss")
        rig.port.plug()
        wait_until(lambda: rig.thread.health.connected, RECOVERY, "reconnection")
        time.sleep(0.1)
        assert not rig.driven()
        rig.repeat_until(rig.driven, 2.0, "motion after a fresh gait")
    assert rig.thread.health.reconnects == 3
    assert leaks() == before


class Liar(Firmata):
    """A board that answers with garbage."""

    def __init__(self) -> None:
        super().__init__()
        self.garbage = False
        self._random = np.random.default_rng(2)

    def feed(self, data: bytes, now: float) -> bytes:
        honest = super().feed(data, now)
        return self._random.bytes(200) if self.garbage else honest


def test_garbage_from_the_device_changes_nothing(tmp_path: Path) -> None:
    board = Liar()
    made = rig_of("firmata", tmp_path, board)
    made.start()
    arm(made)

    def a_hundred_set_points_go_out() -> bool:
        board.garbage = False
        wait_until(lambda: made.thread.health.connected, PATIENCE, "connection")
        board.garbage = True
        goal = made.thread.health.ticks + 100
        made.repeat_until(
            lambda: made.thread.health.ticks > goal or not made.thread.health.connected, 5.0, "set-points"
        )
        return made.thread.health.connected

    # A line that was stalled by the machine alone is lost too, and garbage is no device to come back to.
    wait_until(a_hundred_set_points_go_out, PATIENCE, "set-points")
    assert made.thread.alive
    made.thread.close()
    made.port.close()


class Broken:
    """A line that fails as told."""

    def __init__(self, failure: DeviceError | None = None, *, behind: bool = False) -> None:
        self.failure = failure
        self.failures_left = 1_000_000
        self.behind = behind
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
        del timeout
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


class Clock(OwnClock):
    """One on which the test has its turn whenever the I/O thread waits for its next tick."""

    def sleep(self, seconds: float, /) -> None:
        super().sleep(seconds)
        time.sleep(0.001)


def command(thread: IoThread, now: float | None = None) -> None:
    """Send the paper's gait; where a test is put aside, a single one would be stale before its first tick."""
    thread.mailbox.put(Command(PAPER_GAIT, time.monotonic() if now is None else now))
    time.sleep(0.001)


def has_sent(thread: IoThread, ticks: int) -> bool:
    return thread.health.ticks >= ticks


def start_armed(thread: IoThread) -> None:
    thread.start()
    thread.arm()
    assert thread.wait_for({Phase.SILENT}, PATIENCE)


def thread_on(line: Broken, reports: list[str]) -> tuple[IoThread, Motion]:
    robot = robot_file.load(robot_file.find("firmata"))
    motion = ServoMotion(robot.servos, 0.02)
    backend = backends.make(robot)
    return IoThread(backend, motion, Settings(0.5, 0.2), lambda: line, "fake://", reports.append), motion


def test_a_line_that_is_behind_gets_no_more_set_points_and_is_lost_if_it_stays_so() -> None:
    line = Broken(behind=True)
    thread, motion = thread_on(line, [])
    start_armed(thread)
    wait_until(lambda: thread.health.dropped > 3, 2.0, "dropped set-points", lambda: command(thread))
    assert set(line.written) <= {0xF7, 0xFF, 0xF9}  # disabled at the start, and asked for a sign of life
    wait_until(lambda: not thread.health.connected, 2.0, "loss", lambda: command(thread))
    assert "the line is behind" in thread.health.reason
    thread.close()
    assert line.closed
    assert motion.joints == 1


def test_a_line_that_stalls_for_half_a_second_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    losses: list[tuple[float, str]] = []
    line = Broken()
    thread, _ = thread_on(line, [])
    thread._report = lambda text: losses.append((clock.monotonic(), text))
    monkeypatch.setattr(io_thread, "time", clock)
    monkeypatch.setattr(thread, "_sleep", clock.sleep)
    start_armed(thread)
    failing_since = clock.monotonic()
    line.failure = LineStalledError("took no bytes")
    wait_until(lambda: losses, 3.0, "loss", lambda: command(thread, clock.monotonic()))
    lost_at, reason = losses[0]
    assert io_thread.STALLED_SECONDS - 0.1 < lost_at - failing_since < io_thread.STALLED_SECONDS + 0.1
    assert "took no bytes" in reason
    line.failure = None
    thread.close()


def test_a_device_that_is_wrong_leaves_no_thread_and_no_open_port() -> None:
    line = Broken(LineLostError("gone"))
    line.waiting = b""
    thread, _ = thread_on(line, [])
    with pytest.raises((WrongDeviceError, LineLostError)):
        thread.start()
    assert line.closed
    assert not thread.alive
    thread.close()


def test_an_unforeseen_failure_still_ends_disabled_where_the_tail_stands(recwarn: pytest.WarningsRecorder) -> None:
    del recwarn
    line, reports = Broken(), []  # type: ignore[var-annotated]
    thread, motion = thread_on(line, reports)
    start_armed(thread)
    wait_until(lambda: thread.health.ticks > 3, 1.0, "set-points", lambda: command(thread))
    hook, threading.excepthook = threading.excepthook, lambda _: None
    try:
        motion.outputs = lambda *_: 1 / 0  # type: ignore[method-assign, assignment]
        sent = thread.health.ticks
        wait_until(lambda: not thread.alive, 2.0, "the end of the thread", lambda: command(thread))
    finally:
        threading.excepthook = hook
    assert bytes(line.written[-2:]) == b"\xf7\xff"  # the reset, and no set-point before it
    assert thread.health.ticks - sent <= 1
    assert line.closed
    assert thread.health.connected is False
    assert any("ZeroDivisionError" in report for report in reports)


def test_the_mailbox_holds_the_newest_command_once() -> None:
    mailbox = Mailbox()
    assert mailbox.take() is None
    first, second = Command(PAPER_GAIT, 1.0), Command(PAPER_GAIT, 2.0)
    mailbox.put(first)
    mailbox.put(second)
    assert mailbox.take() is second
    assert mailbox.take() is None


class OneLost(Dynamixel):
    """A bus on which one instruction is lost: the first write of this value to this address."""

    def __init__(self, servos: list[int], lost: tuple[int, int]) -> None:
        super().__init__(servos, lambda _: 2048.0)
        self._to_lose: tuple[int, int] | None = lost

    @property
    def has_lost_it(self) -> bool:
        """Whether it is lost already."""
        return self._to_lose is None

    def _execute(self, packet: packets.Packet) -> bytes:
        data = packet.parameters
        written = int.from_bytes(data[:2], "little"), *data[2:3]
        if packet.instruction == packets.WRITE and written == self._to_lose:
            self._to_lose = None
            return b""
        return super()._execute(packet)


@pytest.mark.parametrize("lost", [(64, 1), (98, 10)])
def test_a_start_that_fails_half_way_is_made_anew(tmp_path: Path, lost: tuple[int, int]) -> None:
    servo = robot_file.load(robot_file.find("dynamixel")).servos[0].channel
    bus = OneLost([servo], lost)
    made = rig_of("dynamixel", tmp_path, bus)
    made.start()
    arm(made)
    made.repeat_until(lambda: bus.has_lost_it, 1.0, "loss of the packet")
    made.repeat_until(lambda: made.thread.health.ticks > 20, 1.0, "set-points")
    assert (bus.tables[servo][64], bus.tables[servo][98]) == (1, 10)
    assert made.thread.health.reconnects == 0
    made.thread.close()
    made.port.close()


def test_a_pin_is_attached_though_the_first_attempt_was_lost() -> None:
    class OneStall(Broken):
        stalls = True

        def write(self, data: bytes) -> None:
            if b"\xf0\x70" in data and self.stalls:
                self.stalls = False
                message = "took no bytes"
                raise LineStalledError(message)
            super().write(data)

    line = OneStall()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    wait_until(
        lambda: thread.health.ticks > 3,
        1.0,
        "set-points",
        lambda: command(thread),
    )
    assert 0 < line.written.index(b"\xf4\x09\x04") < line.written.index(b"\xe9")
    thread.close()


def test_a_start_that_failed_half_way_ends_without_a_jump_to_neutral() -> None:
    class Mute(Broken):
        def write(self, data: bytes) -> None:
            if b"\xf0\x70" in data:
                message = "took no bytes"
                raise LineStalledError(message)
            super().write(data)

    line = Mute()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    wait_until(lambda: thread.health.dropped > 1, 1.0, "failed starts", lambda: command(thread))
    thread.stop_tail()
    assert thread.wait_for({Phase.SILENT}, PATIENCE)
    thread.close()
    assert b"\xe9" not in line.written


def fail_with(backend: Backend, monkeypatch: pytest.MonkeyPatch, *methods: str) -> None:
    """Let these methods of a back end raise something that nobody has foreseen."""

    def broken(*_: object) -> None:
        message = "unforeseen"
        raise IndexError(message)

    for method in methods:
        monkeypatch.setattr(backend, method, broken)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_back_end_that_cannot_send_any_more_is_disabled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    line, reports = Broken(), []  # type: ignore[var-annotated]
    thread, _ = thread_on(line, reports)
    start_armed(thread)
    wait_until(lambda: thread.health.ticks > 3, 1.0, "set-points", lambda: command(thread))
    disabled = len(line.written)
    fail_with(thread._backend, monkeypatch, "send")
    wait_until(lambda: not thread.alive, 2.0, "the end of the thread", lambda: command(thread))
    assert b"\xff" in line.written[disabled:]
    assert line.closed
    assert (thread.health.connected, thread.health.phase) == (False, Phase.DISARMED)
    assert "unforeseen" in thread.health.reason


def test_a_cut_takes_the_force_and_sends_no_set_point_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    del monkeypatch
    line = Broken()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    for _ in range(5):
        goal = thread.health.ticks + 4
        wait_until(partial(has_sent, thread, goal), 2.0, "set-points", lambda: command(thread))
        thread.cut()
        ticks = thread.health.ticks
        assert thread.wait_for({Phase.SILENT}, PATIENCE)
        assert thread.health.ticks - ticks <= 1, "a set-point whose frame was on its way"
        assert bytes(line.written[-2:]) == b"\xf7\xff"
    thread.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_whatever_fails_at_the_end_the_port_is_closed_and_the_health_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Broken()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    wait_until(lambda: thread.health.ticks > 3, 1.0, "set-points", lambda: command(thread))
    fail_with(thread._backend, monkeypatch, "send", "disable")
    monkeypatch.setattr(line, "drain", lambda _: 1 / 0)
    wait_until(lambda: not thread.alive, 2.0, "the end of the thread", lambda: command(thread))
    assert line.closed
    assert thread.health.connected is False


def test_closing_disables_also_where_the_thread_is_dead_and_has_left_the_line_open() -> None:
    line = Broken()
    thread, _ = thread_on(line, [])
    thread._connect()
    line.written.clear()
    thread._thread = threading.Thread(target=lambda: None)
    thread._thread.start()
    thread._thread.join()
    thread.close()
    assert b"\xff" in line.written
    assert line.closed


def test_an_unforeseen_failure_at_the_start_leaves_no_open_port(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Broken()
    thread, _ = thread_on(line, [])
    fail_with(thread._backend, monkeypatch, "identify")
    with pytest.raises(IndexError):
        thread.start()
    assert line.closed


@pytest.mark.parametrize("rig", ["firmata", "kmtronic", "lcus"], indirect=True)
def test_a_cut_whose_frames_get_lost_is_repeated_to_a_device_that_confirms_nothing(rig: Rig) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.repeat_until(rig.driven, 3.0, "force")
    rig.port.drop_rate = 1.0
    rig.thread.cut()
    assert rig.thread.wait_for({Phase.SILENT}, PATIENCE)
    wait_until(lambda: rig.thread._line is not None and not rig.thread._asked, 1.0, "the cut")
    time.sleep(0.02)  # the noise on the line that swallows the frames
    assert rig.driven()
    rig.port.drop_rate = 0.0
    wait_until(lambda: not rig.driven(), 1.0, "silence")


@pytest.mark.parametrize("rig", ["dynamixel", "maestro", "modbus"], indirect=True)
def test_what_was_confirmed_is_not_repeated(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    arm(rig)
    rig.repeat_until(rig.driven, 3.0, "motion")
    rig.thread.cut()
    wait_until(lambda: not rig.driven() and rig.thread.health.phase is Phase.SILENT, 1.0, "silence")
    switched: list[object] = []
    monkeypatch.setattr(rig.thread._backend, "disable", switched.append)
    begin = time.monotonic()
    wait_until(lambda: time.monotonic() - begin > 2.0 * io_thread.REPEAT_SECONDS, 3.0, "two repetitions")
    assert switched == []
    monkeypatch.undo()


def test_a_tail_is_said_to_follow_while_its_device_is_still_being_enabled(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Broken()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    is_enabled = threading.Event()
    monkeypatch.setattr(thread._backend, "enable", lambda *_: is_enabled.wait())
    try:
        wait_until(lambda: thread.health.phase is Phase.FOLLOWING, 1.0, "the phase", lambda: command(thread))
        assert thread.health.ticks == 0
    finally:
        is_enabled.set()
    wait_until(lambda: thread.health.ticks > 3, 1.0, "set-points")
    thread.close()


def test_servos_that_tell_late_where_they_stand_start_from_there_without_a_jump(tmp_path: Path) -> None:
    class Late(Dynamixel):
        mute = False

        def __init__(self, servo: int) -> None:
            super().__init__([servo], lambda _: 2048.0)
            self.goals: list[tuple[float, float]] = []

        def _execute(self, packet: packets.Packet) -> bytes:
            answer = super()._execute(packet)
            self.goals += [(time.monotonic(), goal) for goal in self.outputs.values() if goal is not None]
            return b"" if self.mute and packet.instruction == packets.SYNC_READ else answer

    servo = robot_file.load(robot_file.find("dynamixel")).servos[0]
    bus = Late(servo.channel)
    made = rig_of("dynamixel", tmp_path, bus)
    made.start()
    arm(made)
    bus.mute = True
    wait_until(lambda: not made.thread._feedback.positions, 1.0, "silence about the position")
    begin = tells_since = time.monotonic()
    gait = made.motion.allowed(PAPER_GAIT, 0.2617, 5.0)

    def has_moved() -> bool:
        goals = [goal for _, goal in list(bus.goals)]
        return made.thread.health.ticks >= 30 and max(abs(servo.angle_at(goal)) for goal in goals) > 0.05

    while not has_moved():
        now = time.monotonic()
        assert now - begin < PATIENCE, made.thread.health
        if bus.mute and now - begin > 0.25:  # the gait has almost reached its largest angle
            tells_since = now
            bus.mute = False
        made.thread.mailbox.put(Command(gait, now, begin))
        time.sleep(0.02)
    made.thread.close()
    made.port.close()
    times, goals = np.array(bus.goals).T
    angles = np.abs([servo.angle_at(goal) for goal in goals])
    ramp = smooth_step((times - tells_since) / 0.2)[0]
    assert np.all(angles <= gait.joints[0].amplitude * ramp + 0.01)
