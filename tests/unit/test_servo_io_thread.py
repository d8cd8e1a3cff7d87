"""The I/O thread on this machine's clock, on real pseudo-terminals: its start, its end, a cut, leaks.

What the loop does that runs in it is tested in test_device_loop.py, on a clock of its own.
"""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import PAPER_GAIT
from fin_servo_driver import backends, robot_file
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.io_thread import IoThread
from fin_servo_driver.line import DeviceError
from fin_servo_driver.port import SerialLine
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import Command, Phase, Settings
from support.waiting import PATIENCE, wait_until
from support.wire import BrokenLine

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


def rig_of(name: str, folder: Path) -> Rig:
    robot = robot_file.load(robot_file.find(name))
    backend = backends.make(robot)
    motion: Motion
    motion = RelayMotion(robot.relays, robot.timing, 0.01) if robot.relays else ServoMotion(robot.servos, 0.02)
    port = PtyPort(device_for(robot, lambda _: 0.0), folder / "port")
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
        rig.thread.samples.clear()
        wait_until(lambda: len(rig.thread.samples) > 5, 1.0, "some ticks")
        assert not rig.driven()
        rig.repeat_until(rig.driven, 2.0, "motion after a fresh gait")
    assert rig.thread.health.reconnects >= 3  # one more where the machine has kept its board waiting
    wait_until(lambda: leaks() == before, PATIENCE, lambda: f"no more than {before}; there are {leaks()}")


def command(thread: IoThread) -> None:
    """Send the paper's gait; where a test is put aside, a single one would be stale before its first tick."""
    thread.mailbox.put(Command(PAPER_GAIT, time.monotonic()))
    time.sleep(0.001)


def has_sent(thread: IoThread, ticks: int) -> bool:
    return thread.health.ticks >= ticks


def start_armed(thread: IoThread) -> None:
    thread.start()
    thread.arm()
    assert thread.wait_for({Phase.SILENT}, PATIENCE)


def thread_on(line: BrokenLine, reports: list[str]) -> tuple[IoThread, Motion]:
    robot = robot_file.load(robot_file.find("firmata"))
    motion = ServoMotion(robot.servos, 0.02)
    backend = backends.make(robot)
    return IoThread(backend, motion, Settings(0.5, 0.2), lambda: line, "fake://", reports.append), motion


def test_an_unforeseen_failure_still_ends_disabled_where_the_tail_stands() -> None:
    line, reports = BrokenLine(), []  # type: ignore[var-annotated]
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


def fail_with(backend: Backend, monkeypatch: pytest.MonkeyPatch, *methods: str) -> None:
    """Let these methods of a back end raise something that nobody has foreseen."""

    def broken(*_: object) -> None:
        message = "unforeseen"
        raise IndexError(message)

    for method in methods:
        monkeypatch.setattr(backend, method, broken)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_back_end_that_cannot_send_any_more_is_disabled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    line, reports = BrokenLine(), []  # type: ignore[var-annotated]
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


def test_a_cut_takes_the_force_and_sends_no_set_point_after_it() -> None:
    line = BrokenLine()
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
    line = BrokenLine()
    thread, _ = thread_on(line, [])
    start_armed(thread)
    wait_until(lambda: thread.health.ticks > 3, 1.0, "set-points", lambda: command(thread))
    fail_with(thread._backend, monkeypatch, "send", "disable")
    monkeypatch.setattr(line, "drain", lambda _: 1 / 0)
    wait_until(lambda: not thread.alive, 2.0, "the end of the thread", lambda: command(thread))
    assert line.closed
    assert thread.health.connected is False


def test_closing_disables_also_where_the_thread_is_dead_and_has_left_the_line_open() -> None:
    line = BrokenLine()
    thread, _ = thread_on(line, [])
    thread.connect()
    line.written.clear()
    thread._thread = threading.Thread(target=lambda: None)
    thread._thread.start()
    thread._thread.join()
    thread.close()
    assert b"\xff" in line.written
    assert line.closed


def test_an_unforeseen_failure_at_the_start_leaves_no_open_port(monkeypatch: pytest.MonkeyPatch) -> None:
    line = BrokenLine()
    thread, _ = thread_on(line, [])
    fail_with(thread._backend, monkeypatch, "identify")
    with pytest.raises(IndexError):
        thread.start()
    assert line.closed
