"""Dynamixel servos on a real line: bytes take their time, answers come late, servos let go by themselves."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
import serial

from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends.backend import Feedback
from fin_servo_driver.backends.dynamixel import Dynamixel as Backend
from fin_servo_driver.emulator.devices import Dynamixel as Servos
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.line import LineLostError, LineStalledError, WrongDeviceError
from fin_servo_driver.port import SerialLine
from support.waiting import wait_until
from support.wire import OwnClock

if TYPE_CHECKING:
    from pathlib import Path

    from fin_servo_driver.backends.backend import Backend as AnyBackend
    from fin_servo_driver.robot_file import Robot

CENTRE = 2048.0
FAST = 1_000_000
BITS_A_BYTE = 10
ASK_POSITIONS = b"\x82\x84\x00\x04\x00"
ASK_VOLTAGE_AND_TEMPERATURE = b"\x82\x90\x00\x03\x00"
WRITE_WATCHDOG = b"\x03\x62\x00\x0a"
TURN_OF_HEALTH = 2.5
"""s within which everything is asked for twice."""


def robot(joints: int, baud: int = FAST) -> Robot:
    example = robot_file.load(robot_file.find("dynamixel"))
    ids = range(1, joints + 1)
    return replace(example, baud=baud, joints=tuple(replace(example.servos[0], channel=servo) for servo in ids))


def servos(joints: int) -> Servos:
    return Servos(list(range(1, joints + 1)), lambda _: CENTRE)


@pytest.fixture(autouse=True)
def clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let time pass only where somebody waits, in every test but those with a real port, which need a folder for it."""
    if "tmp_path" not in request.fixturenames:
        clock = OwnClock()
        monkeypatch.setattr(time, "monotonic", clock.monotonic)
        monkeypatch.setattr(time, "sleep", clock.sleep)


class Bus:
    """A line to servos without a port. A packet takes it some time; see `OwnClock`.

    Attributes:
        hold_back: The answer to a question with these bytes comes together with the next answer.
        silent: Whether nothing is answered.
    """

    def __init__(self, device: Servos) -> None:
        self.device = device
        self.hold_back = b""
        self.silent = False
        self._held = self._waiting = b""

    def write(self, data: bytes) -> None:
        time.sleep(0.0005)
        now = time.monotonic()
        self.device.tick(now)
        if self.silent:
            return
        answer = self.device.feed(data, now)
        if self.hold_back and self.hold_back in data:
            self._held, self.hold_back = answer, b""
        elif answer:
            self._waiting, self._held = self._waiting + self._held + answer, b""

    def read(self, timeout: float) -> bytes:
        if not self._waiting:
            time.sleep(timeout)
        data, self._waiting = self._waiting, b""
        return data


class SlowBus(Bus):
    """A line on which bytes take their time, one way after the other; what it answers arrives byte by byte."""

    def __init__(self, device: Servos, baud: int, delay: float) -> None:
        super().__init__(device)
        self._byte = BITS_A_BYTE / baud
        self._delay = delay
        self._free_at = 0.0
        self._under_way: deque[tuple[float, int]] = deque()

    def write(self, data: bytes) -> None:
        self._free_at = max(self._free_at, time.monotonic()) + len(data) * self._byte
        self.device.tick(self._free_at)
        if answer := self.device.feed(data, self._free_at):
            self._free_at += self._delay
            for byte in answer:
                self._free_at += self._byte
                self._under_way.append((self._free_at, byte))

    def read(self, timeout: float) -> bytes:
        until = time.monotonic() + timeout
        next_at = self._under_way[0][0] if self._under_way else until
        time.sleep(max(0.0, min(next_at, until) - time.monotonic()))
        arrived = bytearray()
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            arrived.append(self._under_way.popleft()[1])
        return bytes(arrived)


def started(bus: Bus, joints: int = 1) -> Backend:
    backend = backends.make(robot(joints))
    assert isinstance(backend, Backend)
    backend.identify(bus)
    backend.disable(bus)
    backend.enable(bus, {})
    return backend


def tick(backend: AnyBackend, bus: Bus) -> Feedback:
    time.sleep(0.01)
    backend.send(bus, dict.fromkeys(bus.device.tables, CENTRE))
    return backend.read(bus)


# -- time that bytes take ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("baud", "joints", "rate"),
    [(57600, 1, 50.0), (57600, 2, 50.0), (115200, 1, 100.0), (115200, 4, 50.0), (FAST, 1, 100.0), (FAST, 6, 100.0)],
)
def test_the_rate_is_what_the_line_allows(baud: int, joints: int, rate: float) -> None:
    assert backends.make(robot(joints, baud)).rate == rate


def test_a_file_without_a_baud_rate_is_for_a_servo_as_it_is_bought() -> None:
    assert backends.make(robot(1, 0)).rate == 50.0


@pytest.mark.parametrize(("baud", "joints", "needed"), [(57600, 3, 115200), (9600, 1, 57600), (115200, 20, 1_000_000)])
def test_a_line_that_is_too_slow_is_refused_with_the_baud_rate_that_is_needed(
    baud: int, joints: int, needed: int
) -> None:
    with pytest.raises(ValueError, match=f"baud: {needed}") as refusal:
        backends.make(robot(joints, baud))
    assert f"{baud} baud" in str(refusal.value)


@pytest.mark.parametrize(
    ("baud", "joints"),
    [(57600, 1), (57600, 2), (115200, 1), (115200, 3), (115200, 4), (FAST, 1), (FAST, 3), (FAST, 20)],
)
def test_positions_come_back_over_a_line_whose_bytes_take_their_time(baud: int, joints: int) -> None:
    """With the return delay of 0.5 ms that each servo has when it is bought, and 1 ms for the USB adapter."""
    bus = SlowBus(servos(joints), baud, delay=0.001 + 0.0005 * joints)
    backend = backends.make(robot(joints, baud))
    backend.identify(bus)
    backend.enable(bus, {})
    centres = dict.fromkeys(range(1, joints + 1), CENTRE)
    due, seen = time.monotonic(), list[Feedback]()
    for _ in range(round(4.0 * backend.rate)):
        backend.send(bus, centres)
        seen.append(backend.read(bus))
        due += 1.0 / backend.rate
        assert time.monotonic() <= due, "the next tick would be late"
        time.sleep(due - time.monotonic())
    asked = [feedback.positions_asked for feedback in seen]
    assert all(feedback.positions == centres for feedback in seen if feedback.positions_asked)
    assert asked.count(False) <= 13
    assert (False, False) not in itertools.pairwise(asked), "one question, then positions again"
    assert len([feedback for feedback in seen if feedback.voltage == 12.0]) in {3, 4}


def test_a_servo_that_lets_go_on_a_line_with_no_time_for_two_questions_is_a_loss() -> None:
    bus = SlowBus(servos(2), 57600, delay=0.002)
    backend = backends.make(robot(2, 57600))
    backend.identify(bus)
    backend.enable(bus, {})
    bus.device.reboot(2)
    begin = time.monotonic()
    with pytest.raises(LineLostError, match="id 2 has let go: it has started anew"):
        wait_until(lambda: False, TURN_OF_HEALTH, "loss", lambda: tick(backend, bus))
    assert time.monotonic() - begin < 1.2


def test_positions_come_back_from_a_port(tmp_path: Path) -> None:
    port = PtyPort(servos(2), tmp_path / "port", baud=57600, delay=0.002)
    backend, line = backends.make(robot(2, 57600)), SerialLine(str(port.path), 57600)
    seen: list[Feedback] = []

    def tick_once() -> None:
        with contextlib.suppress(LineLostError, LineStalledError, WrongDeviceError):  # on a busy machine
            if not seen:
                backend.identify(line)
                backend.enable(line, {})
            backend.send(line, {1: CENTRE, 2: CENTRE})
            seen.append(backend.read(line))
            return
        seen.clear()

    wait_until(lambda: any(f.positions == {1: CENTRE, 2: CENTRE} for f in seen), 60.0, "positions", tick_once)
    line.close()
    port.close()


def test_a_port_that_can_is_asked_to_hand_bytes_on_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _, low: asked.append(low))
    port = PtyPort(servos(1), tmp_path / "port")
    SerialLine(str(port.path), FAST).close()
    SerialLine("loop://", FAST, ["loop"]).close()  # has no such mode
    port.close()
    assert asked == [True]


# -- answers that belong to other questions ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "late", [pytest.param(ASK_VOLTAGE_AND_TEMPERATURE, id="a reading"), pytest.param(ASK_POSITIONS, id="positions")]
)
def test_a_late_answer_is_never_taken_for_that_to_another_question(late: bytes) -> None:
    bus = Bus(servos(1))
    backend = started(bus)
    seen: list[Feedback] = []
    end = time.monotonic() + TURN_OF_HEALTH
    while time.monotonic() < end:
        if len(seen) % 5 == 0:
            bus.hold_back = late
        feedback = tick(backend, bus)
        seen.append(feedback)
        assert feedback.positions in ({}, {1: CENTRE})
        assert feedback.voltage in {None, 12.0}
        assert feedback.temperature in {None, 35.0}
    assert {1: CENTRE} in [feedback.positions for feedback in seen]


def test_a_late_confirmation_of_a_write_is_no_position() -> None:
    bus = Bus(servos(1))
    backend = started(bus)
    bus.hold_back = WRITE_WATCHDOG
    with pytest.raises(LineStalledError, match="id 1 did not take 10 at address 98"):
        backend.enable(bus, {})
    assert tick(backend, bus).positions == {1: CENTRE}


def test_answers_that_come_in_another_order_are_told_apart() -> None:
    bus = Bus(Servos([1, 2, 3], lambda servo: 1000.0 * servo))
    backend = started(bus, 3)
    assert tick(backend, bus).positions == {1: 1000.0, 2: 2000.0, 3: 3000.0}


@pytest.mark.parametrize("stands", [10_000.0, -5_000.0, -(2.0**31)])
def test_a_position_outside_a_turn_is_no_measurement(stands: float) -> None:
    bus = Bus(Servos([1], lambda _: stands))
    backend = started(bus)
    backend.disable(bus)
    feedback = backend.read(bus)
    assert feedback.positions == {}
    assert "id 1" in feedback.fault
    assert "outside a turn" in feedback.fault


# -- servos that let go ------------------------------------------------------------------------------------------------


def tripped(bus: Bus) -> bool:
    bus.device.tick(time.monotonic())
    return bus.device.tables[1][98] == 0xFF


def test_a_tripped_watchdog_holds_the_servo_until_it_is_cleared() -> None:
    bus = Bus(servos(1))
    backend = started(bus)
    backend.send(bus, {1: 2100.0})
    assert bus.device.outputs == {1: 2100.0}
    wait_until(lambda: tripped(bus), 1.0, "trip")
    assert bus.device.outputs == {1: CENTRE}
    backend.send(bus, {1: 2100.0})
    assert bus.device.outputs == {1: CENTRE}
    backend.enable(bus, {})
    backend.send(bus, {1: 2100.0})
    assert bus.device.outputs == {1: 2100.0}


def test_servos_that_fall_silent_under_force_are_lost_before_their_watchdogs_trip() -> None:
    bus = Bus(servos(2))
    backend = started(bus, 2)
    tick(backend, bus)
    begin, bus.silent = time.monotonic(), True
    with pytest.raises(LineLostError, match="fallen silent"):
        wait_until(lambda: False, 1.0, "loss", lambda: tick(backend, bus))
    assert time.monotonic() - begin < 0.2


def test_one_silent_servo_of_two_is_lost_too() -> None:
    bus = Bus(servos(2))
    backend = started(bus, 2)
    del bus.device.tables[2]
    with pytest.raises(LineLostError, match="id 2 has fallen silent"):
        wait_until(lambda: False, 1.0, "loss", lambda: tick(backend, bus))


def test_servos_that_answer_again_after_their_watchdogs_time_are_lost() -> None:
    bus = Bus(servos(1))
    backend = started(bus)
    tick(backend, bus)
    wait_until(lambda: tripped(bus), 1.0, "trip")
    with pytest.raises(LineLostError, match="fallen silent"):
        tick(backend, bus)


def test_without_force_a_pause_is_no_loss() -> None:
    bus = Bus(servos(1))
    backend = started(bus)
    wait_until(lambda: tripped(bus), 1.0, "trip")
    backend.disable(bus)
    bus.device.reboot(1)
    end = time.monotonic() + TURN_OF_HEALTH
    while time.monotonic() < end:
        assert backend.read(bus).positions == {1: CENTRE}


def trip(device: Servos) -> None:
    device.tables[2][98] = 0xFF


@pytest.mark.parametrize(
    ("happens", "says"),
    [
        pytest.param(lambda device: device.reboot(2), "id 2 has let go: it has started anew", id="restart"),
        pytest.param(lambda device: device.shut_down(2, 1 << 5), "id 2 has let go: overload", id="overload"),
        pytest.param(trip, "id 2 stands still: its bus watchdog has tripped", id="watchdog"),
    ],
)
def test_a_servo_that_lets_go_by_itself_is_a_loss(happens: object, says: str) -> None:
    bus = Bus(servos(2))
    backend = started(bus, 2)
    tick(backend, bus)
    assert callable(happens)
    happens(bus.device)
    with pytest.raises(LineLostError, match=says):
        wait_until(lambda: False, TURN_OF_HEALTH, "loss", lambda: tick(backend, bus))


def test_health_is_that_of_the_worst_servo() -> None:
    bus = Bus(servos(2))
    backend = started(bus, 2)
    bus.device.tables[2][144:147] = (108).to_bytes(2, "little") + bytes((66,))
    bus.device.tables[1][70] = 1 << 2
    seen: list[Feedback] = []
    wait_until(
        lambda: any(f.voltage for f in seen) and any(f.fault for f in seen),
        TURN_OF_HEALTH,
        "health",
        lambda: seen.append(tick(backend, bus)),
    )
    assert {(f.voltage, f.temperature) for f in seen if f.voltage} == {(10.8, 66.0)}
    assert {f.fault for f in seen if f.fault} == {"id 1: overheating"}
