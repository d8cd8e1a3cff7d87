"""The device loop on emulated devices: plug and replug, silence, garbage, stalls.

Loop and line have a clock of their own, on which time passes only where somebody waits: what is asserted to take so
long takes so long on any machine.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import PAPER_GAIT
from fin_plant.gait_follower import smooth_step
from fin_servo_driver import backends, device_loop, robot_file
from fin_servo_driver.device_loop import DeviceLoop
from fin_servo_driver.emulator import packets
from fin_servo_driver.emulator.devices import Device, Dynamixel, Firmata
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.line import LineLostError, LineStalledError, PortUnavailableError, WrongDeviceError
from fin_servo_driver.mailbox import Mailbox
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import Command, Phase, Settings
from support.wire import BrokenLine, OwnClock, Port

if TYPE_CHECKING:
    from collections.abc import Callable


RECOVERY = 0.5
"""s after a port is back within which the driver must be, too, on a line that carries everything at once."""
TICK = 0.02
"""s, the longest of all devices."""
LAST_LOOK = 0.08
"""s from the frame that shows a loss to the next turn but one."""
ALL = tuple(backends.BACKENDS)


class Rig:
    """A loop with what it needs, whose turns the test takes.

    Attributes:
        clock: Of the loop and of its line.
        asleep: s for which the machine has slept.
        port: The device's port, None on a line of the test's own.
    """

    def __init__(self, name: str, device: Device | None = None, line: BrokenLine | None = None) -> None:
        robot = robot_file.load(robot_file.find(name))
        self.clock = OwnClock()
        self.asleep = 1000.0
        backend = backends.make(robot, self.clock)
        self.motion: Motion = (
            RelayMotion(robot.relays, robot.timing, 1.0 / backend.rate)
            if robot.relays
            else ServoMotion(robot.servos, 1.0 / backend.rate)
        )
        if line is not None:
            line.sleep = self.clock.sleep
        self.port = Port(device or device_for(robot, lambda _: 0.0), self.clock)
        self.reports: list[str] = []
        self.loop = DeviceLoop(
            backend,
            self.motion,
            Settings(0.5, 0.2),
            self.port.open if line is None else lambda: line,
            "simulated://",
            self.reports.append,
            self.clock,
            lambda: self.asleep,
        )

    def gait(self) -> None:
        """Send the paper's gait."""
        self.loop.mailbox.put(Command(self.motion.allowed(PAPER_GAIT, 0.2617, 5.0), self.clock.now))

    def turn(self, *, gait: bool) -> None:
        """Take one turn, and let the time pass until the next is due."""
        if gait:
            self.gait()
        idle = self.loop.turn()
        assert idle is not None
        self.clock.sleep(max(idle, 1e-6))
        self.port.device.tick(self.clock.now)

    def run(self, seconds: float, *, gait: bool = False) -> None:
        """Take turns for so long."""
        end = self.clock.now + seconds
        while self.clock.now < end:
            self.turn(gait=gait)

    def until(self, condition: Callable[[], object], seconds: float, *, gait: bool = False) -> None:
        """Take turns until the condition holds, which it must within so many s of the rig's time."""
        end = self.clock.now + seconds
        while not condition():
            assert self.clock.now < end, self.loop.health
            self.turn(gait=gait)

    def arm(self) -> None:
        """Connect and arm."""
        self.loop.connect()
        self.loop.arm()
        self.turn(gait=False)
        assert self.loop.health.phase is Phase.SILENT

    def swim(self, seconds: float = 0.6) -> None:
        """Command the gait, at least until the device gives force."""
        self.until(self.driven, 1.0, gait=True)
        self.run(seconds, gait=True)

    def driven(self) -> bool:
        """Whether the device gives force to anything."""
        outputs = self.port.device.outputs.values()
        return any(value if isinstance(self.motion, RelayMotion) else value is not None for value in outputs)


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Rig:
    return Rig(getattr(request, "param", "firmata"))


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_moves_when_told_and_is_safe_after_the_end(rig: Rig) -> None:
    rig.arm()
    rig.run(1.0)
    assert not rig.driven()
    rig.swim()
    assert rig.loop.health.ticks >= int(0.6 / TICK)
    assert rig.loop.health.missed == rig.loop.health.dropped == 0
    rig.loop.end()
    assert rig.loop.turn() is None
    rig.loop.finish("the end")
    assert not rig.driven()
    assert (rig.loop.health.connected, rig.loop.health.reason) == (False, "the end")


def test_what_is_sent_is_the_gait_at_each_tick_once_its_ramp_is_over(rig: Rig) -> None:
    rig.arm()
    begin = rig.clock.now
    while rig.clock.now < begin + 3.0:
        rig.loop.mailbox.put(Command(PAPER_GAIT, rig.clock.now, begin))
        rig.turn(gait=False)
    samples = [sample for sample in rig.loop.samples if sample.time > begin + 0.5]
    times, angles = np.array([(sample.time - begin, sample.angles[0]) for sample in samples]).T
    assert len(times) > 120
    assert np.max(np.abs(angles - np.radians(15.0) * np.sin(2.0 * np.pi * 0.9 * times))) < 1e-9


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_is_silenced_by_a_cut(rig: Rig) -> None:
    rig.arm()
    rig.swim()
    rig.loop.cut()
    rig.turn(gait=False)
    assert not rig.driven()
    rig.run(1.0)
    assert not rig.driven()


@pytest.mark.parametrize("rig", ALL, indirect=True)
def test_every_device_is_silenced_when_the_commander_is(rig: Rig) -> None:
    rig.arm()
    rig.swim()
    commanded = rig.clock.now
    rig.until(lambda: rig.loop.health.phase is Phase.SILENT, 2.0)
    assert not rig.driven()
    assert rig.clock.now - commanded > 0.5 - 2 * TICK
    assert rig.loop.health.timeouts == 1


@pytest.mark.parametrize(
    ("rig", "within", "says"),
    [
        ("dynamixel", 0.3, "id 1 has fallen silent"),
        ("maestro", 0.6, "the device has fallen silent"),
        ("modbus", 1.1, "has fallen silent|did not"),
    ],
    indirect=["rig"],
)
def test_a_device_that_answers_is_missed_when_it_falls_silent(rig: Rig, within: float, says: str) -> None:
    rig.arm()
    rig.swim()
    rig.port.silent = True
    rig.until(lambda: not rig.loop.health.connected, within, gait=True)
    assert re.search(says, rig.loop.health.reason)
    rig.port.silent = False
    rig.until(lambda: rig.loop.health.connected, RECOVERY)


def test_a_dynamixel_reports_what_it_measures() -> None:
    rig = Rig("dynamixel")
    rig.arm()
    rig.until(lambda: rig.loop.health.voltage == 12.0, 1.1, gait=True)
    assert rig.loop.health.temperature == 35.0
    assert rig.loop.samples
    assert all(sample.measured for sample in rig.loop.samples)


def test_a_dynamixel_stops_by_its_bus_watchdog_when_its_driver_is_gone() -> None:
    bus = Dynamixel([1], lambda _: 2048.0)
    rig = Rig("dynamixel", bus)
    rig.arm()
    rig.swim()
    assert rig.driven()
    rig.clock.sleep(0.21)  # not a byte more
    bus.tick(rig.clock.now)
    assert bus.tables[1][98] == 0xFF


@pytest.mark.parametrize("rig", ["dynamixel", "maestro", "modbus"], indirect=True)
def test_a_device_that_keeps_its_power_over_a_replug_is_disabled_when_it_is_back(rig: Rig) -> None:
    rig.arm()
    rig.swim()
    rig.port.unplug(powered=True)
    rig.until(lambda: not rig.loop.health.connected, 2 * TICK, gait=True)
    rig.loop.cut()
    rig.port.plug()
    rig.until(lambda: rig.loop.health.connected, RECOVERY)
    assert not rig.driven()


@pytest.mark.parametrize(("name", "channel", "value"), [("maestro", 0, 1700.0), ("modbus", 0, 1.0), ("lcus", 1, 1.0)])
def test_what_a_killed_driver_has_left_on_ends_when_the_next_one_is_configured(
    name: str, channel: int, value: float
) -> None:
    rig = Rig(name)
    rig.port.device.outputs[channel] = value
    assert rig.driven()
    rig.loop.connect()
    assert not rig.driven()
    assert rig.loop.health.phase is Phase.DISARMED


@pytest.mark.parametrize("rig", ["dynamixel", "modbus"], indirect=True)
def test_a_cut_whose_frames_are_lost_is_repeated_until_the_device_has_taken_it(rig: Rig) -> None:
    rig.arm()
    rig.until(rig.driven, 1.0, gait=True)
    rig.port.silent = True
    rig.loop.cut()
    rig.turn(gait=False)
    assert any("while making the device safe" in text for text in rig.reports)
    assert rig.driven()
    rig.port.silent = False
    rig.until(lambda: not rig.driven(), 1.0)


@pytest.mark.parametrize("rig", ["firmata", "kmtronic", "lcus"], indirect=True)
def test_a_cut_whose_frames_get_lost_is_repeated_to_a_device_that_confirms_nothing(rig: Rig) -> None:
    rig.arm()
    rig.until(rig.driven, 1.0, gait=True)
    rig.port.drop_rate = 1.0
    rig.loop.cut()
    rig.turn(gait=False)
    assert rig.loop.health.phase is Phase.SILENT
    assert rig.driven()
    rig.port.drop_rate = 0.0
    rig.until(lambda: not rig.driven(), device_loop.REPEAT_SECONDS + TICK)


@pytest.mark.parametrize("rig", ["dynamixel", "maestro", "modbus"], indirect=True)
def test_what_was_confirmed_is_not_repeated(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.arm()
    rig.swim()
    rig.loop.cut()
    rig.turn(gait=False)
    assert not rig.driven()
    switched: list[object] = []
    monkeypatch.setattr(rig.loop._backend, "disable", switched.append)
    rig.run(5.0 * device_loop.REPEAT_SECONDS)
    assert switched == []


def test_a_board_that_starts_anew_by_itself_is_a_fault_and_waits_for_a_fresh_gait() -> None:
    class BrownOut(Firmata):
        restarts = False

        def feed(self, data: bytes, now: float) -> bytes:
            if self.restarts:
                self.restarts = False
                return self.opened(now)
            return super().feed(data, now)

    board = BrownOut()
    rig = Rig("firmata", board)
    rig.arm()
    rig.swim(1.2)
    board.restarts = True
    rig.until(lambda: not rig.loop.health.connected, 2 * TICK, gait=True)
    assert "started anew by itself" in rig.loop.health.reason
    rig.until(lambda: rig.loop.health.connected, RECOVERY)
    rig.run(1.0)
    assert not rig.driven()
    rig.swim()


def test_a_servo_outside_its_range_is_not_made_to_jump_into_it() -> None:
    robot = robot_file.load(robot_file.find("dynamixel"))
    beyond = 1.1 * max(abs(robot.servos[0].angle_at(end)) for end in (robot.servos[0].lowest, robot.servos[0].highest))
    angle = [beyond]
    rig = Rig("dynamixel", device_for(robot, lambda _: angle[0]))
    rig.arm()
    rig.until(lambda: "bring the tail inside by hand" in rig.loop.health.refusal, 2 * TICK, gait=True)
    rig.run(0.5, gait=True)
    assert not rig.driven()
    angle[0] = 0.1
    rig.until(rig.driven, 3 * TICK, gait=True)
    assert rig.loop.health.refusal == ""


def test_a_servo_that_does_not_tell_where_it_stands_is_not_started() -> None:
    class Mute(Dynamixel):
        def _execute(self, packet: packets.Packet) -> bytes:
            is_about_positions = packet.instruction == packets.SYNC_READ and packet.parameters[:1] == b"\x84"
            return b"" if is_about_positions else super()._execute(packet)

    rig = Rig("dynamixel", Mute([1], lambda _: 1600.0))
    rig.arm()
    rig.until(lambda: rig.loop.health.refusal, 0.4, gait=True)
    assert not rig.driven()


def test_replugs_recover_and_wait_for_a_fresh_gait(rig: Rig) -> None:
    rig.arm()
    rig.swim()
    for number in range(20):
        rig.port.unplug()
        rig.until(lambda: not rig.loop.health.connected, 2 * TICK, gait=True)
        rig.run(0.37 * number, gait=True)
        rig.port.plug()
        # A port whose file is not looked at is tried again ever more slowly.
        rig.until(lambda: rig.loop.health.connected, 5.1, gait=False)
        rig.run(0.1)
        assert not rig.driven()
        rig.swim(0.1)
    assert rig.loop.health.reconnects == 20


@pytest.mark.parametrize("rig", ["firmata", "lcus"], indirect=True)
def test_a_computer_that_slept_does_not_go_on_with_the_swim(rig: Rig) -> None:
    rig.arm()
    rig.swim()
    rig.asleep += 0.1  # within what two looks at two clocks may differ
    rig.run(0.1, gait=True)
    ticks = rig.loop.health.ticks
    assert rig.loop.health.reconnects == 0
    rig.asleep += 3600.0
    rig.gait()
    rig.turn(gait=False)
    rig.run(0.3)
    assert not rig.driven()
    assert rig.loop.health.ticks == ticks
    assert rig.loop.health.reconnects == 1, "so that the mark is owed"
    assert rig.loop.health.phase is Phase.SILENT
    assert "slept for 3600 s" in rig.reports[-1]


def test_garbage_from_the_device_changes_nothing() -> None:
    class Liar(Firmata):
        garbage = False
        random = np.random.default_rng(2)

        def feed(self, data: bytes, now: float) -> bytes:
            honest = super().feed(data, now)
            return self.random.bytes(200) if self.garbage else honest

    board = Liar()
    rig = Rig("firmata", board)
    rig.arm()
    board.garbage = True
    rig.run(2.2, gait=True)
    assert rig.loop.health.connected
    assert rig.loop.health.ticks > 100


def armed_on(line: BrokenLine) -> Rig:
    made = Rig("firmata", line=line)
    made.arm()
    return made


def test_a_device_that_is_wrong_leaves_no_open_port() -> None:
    line = BrokenLine()
    line.waiting = b""
    rig = Rig("firmata", line=line)
    with pytest.raises(WrongDeviceError, match="no Firmata banner within 5 s, not a byte came"):
        rig.loop.connect()
    assert line.closed


def test_a_line_that_is_behind_gets_no_more_set_points_and_is_lost_if_it_stays_so() -> None:
    line = BrokenLine(behind=True)
    rig = armed_on(line)
    begin = rig.clock.now
    rig.until(lambda: rig.loop.health.dropped > 3, 5 * TICK, gait=True)
    assert set(line.written) <= {0xF7, 0xFF, 0xF9}  # disabled at the start, and asked for a sign of life
    rig.until(lambda: not rig.loop.health.connected, 1.0, gait=True)
    assert rig.clock.now - begin == pytest.approx(device_loop.STALLED_SECONDS, abs=LAST_LOOK)
    assert "the line is behind" in rig.loop.health.reason
    assert line.closed


def test_a_line_that_stalls_for_half_a_second_is_lost() -> None:
    line = BrokenLine()
    rig = armed_on(line)
    rig.run(0.2, gait=True)
    failing_since = rig.clock.now
    line.failure = LineStalledError("took no bytes")
    rig.until(lambda: not rig.loop.health.connected, 1.0, gait=True)
    assert rig.clock.now - failing_since == pytest.approx(device_loop.STALLED_SECONDS, abs=LAST_LOOK)
    assert "took no bytes" in rig.loop.health.reason


def test_a_complaint_of_the_device_is_told_for_some_seconds_only() -> None:
    line = BrokenLine()
    rig = armed_on(line)
    line.failure, line.failures_left = LineStalledError("took no bytes"), 3
    rig.until(lambda: "took no bytes" in rig.loop.health.fault, 2 * TICK, gait=True)
    rig.run(4.9, gait=True)
    assert "took no bytes" in rig.loop.health.fault
    rig.run(0.3, gait=True)
    assert rig.loop.health.fault == ""
    assert rig.loop.health.connected


def test_a_tick_that_comes_late_is_counted_and_not_made_up_for() -> None:
    rig = armed_on(BrokenLine())
    rig.run(0.2, gait=True)
    rig.clock.sleep(10.5 * TICK)
    rig.loop.latenesses()
    sent = rig.loop.health.ticks
    rig.turn(gait=True)
    assert rig.loop.health.ticks == sent + 1
    assert rig.loop.health.missed == 10
    assert rig.loop.latenesses() == [pytest.approx(10.5 * TICK, abs=1e-5)]


def test_the_mailbox_holds_the_newest_command_once() -> None:
    mailbox = Mailbox()
    assert mailbox.take() is None
    first, second = Command(PAPER_GAIT, 1.0), Command(PAPER_GAIT, 2.0)
    mailbox.put(first)
    mailbox.put(second)
    assert mailbox.take() is second
    assert mailbox.take() is None


def test_an_absent_port_is_told_and_nothing_is_opened() -> None:
    rig = Rig("firmata")
    rig.port.unplug()
    with pytest.raises(PortUnavailableError, match="absent"):
        rig.loop.connect()


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
def test_a_start_that_fails_half_way_is_made_anew(lost: tuple[int, int]) -> None:
    bus = OneLost([1], lost)
    rig = Rig("dynamixel", bus)
    rig.arm()
    rig.run(0.5, gait=True)
    assert bus.has_lost_it
    assert rig.loop.health.ticks > 20
    assert (bus.tables[1][64], bus.tables[1][98]) == (1, 10)
    assert rig.loop.health.reconnects == 0


def test_a_pin_is_attached_though_the_first_attempt_was_lost() -> None:
    class OneStall(BrokenLine):
        stalls = True

        def write(self, data: bytes) -> None:
            if b"\xf0\x70" in data and self.stalls:
                self.stalls = False
                message = "took no bytes"
                raise LineStalledError(message)
            super().write(data)

    line = OneStall()
    rig = armed_on(line)
    rig.until(lambda: rig.loop.health.ticks > 3, 7 * TICK, gait=True)
    assert 0 < line.written.index(b"\xf4\x09\x04") < line.written.index(b"\xe9")


def test_a_start_that_failed_half_way_ends_without_a_jump_to_neutral() -> None:
    class Mute(BrokenLine):
        def write(self, data: bytes) -> None:
            if b"\xf0\x70" in data:
                message = "took no bytes"
                raise LineStalledError(message)
            super().write(data)

    line = Mute()
    rig = armed_on(line)
    rig.until(lambda: rig.loop.health.dropped > 1, 4 * TICK, gait=True)
    rig.loop.stop_tail()
    rig.until(lambda: rig.loop.health.phase is Phase.SILENT, 2 * TICK)
    rig.run(0.5)
    assert b"\xe9" not in line.written


def test_a_cut_takes_the_force_and_sends_no_set_point_after_it() -> None:
    line = BrokenLine()
    rig = armed_on(line)
    for _ in range(5):
        rig.run(5 * TICK, gait=True)
        sent = rig.loop.health.ticks
        rig.loop.cut()
        rig.turn(gait=False)
        assert rig.loop.health.phase is Phase.SILENT
        assert rig.loop.health.ticks == sent
        assert bytes(line.written[-2:]) == b"\xf7\xff"


def test_a_tail_is_said_to_follow_while_its_device_is_still_being_enabled(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, seen = armed_on(BrokenLine()), []
    monkeypatch.setattr(rig.loop._backend, "enable", lambda *_: seen.append(rig.loop.health))
    rig.run(5 * TICK, gait=True)
    assert [(health.phase, health.ticks) for health in seen] == [(Phase.FOLLOWING, 0)]
    assert rig.loop.health.ticks > 3


def test_servos_that_tell_late_where_they_stand_start_from_there_without_a_jump() -> None:
    goals: list[tuple[float, float]] = []

    class Late(Dynamixel):
        mute = True

        def _execute(self, packet: packets.Packet) -> bytes:
            answer = super()._execute(packet)
            goals.extend((rig.clock.now, goal) for goal in self.outputs.values() if goal is not None)
            return b"" if self.mute and packet.instruction == packets.SYNC_READ and is_armed else answer

    is_armed = False
    bus = Late([1], lambda _: 2048.0)
    rig = Rig("dynamixel", bus)
    rig.arm()
    is_armed = True
    gait, begin = rig.motion.allowed(PAPER_GAIT, 0.2617, 5.0), rig.clock.now
    while rig.clock.now < begin + 0.6:
        bus.mute = rig.clock.now < begin + 0.25  # the gait has almost reached its largest angle by then
        rig.loop.mailbox.put(Command(gait, rig.clock.now, begin))
        rig.turn(gait=False)
    times, angles = np.array([(at, rig.loop._backend.robot.servos[0].angle_at(goal)) for at, goal in goals]).T
    assert np.max(np.abs(angles)) > 0.05
    ramp = smooth_step((times - begin - 0.25) / 0.2)[0]
    assert np.all(np.abs(angles) <= gait.joints[0].amplitude * ramp + 0.01)


def test_what_ends_while_it_cannot_be_disabled_closes_its_port_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    line = BrokenLine()
    rig = armed_on(line)
    rig.run(0.2, gait=True)
    monkeypatch.setattr(rig.loop._backend, "disable", lambda _: 1 / 0)
    monkeypatch.setattr(line, "drain", lambda _: 1 / 0)
    rig.loop.finish("the end")
    assert line.closed
    assert (rig.loop.health.connected, rig.loop.health.reason) == (False, "the end")
    assert sum("ZeroDivisionError" in text for text in rig.reports) == 2


def test_a_port_that_fails_on_every_byte_is_lost_at_the_first() -> None:
    line = BrokenLine()
    rig = armed_on(line)
    line.failure = LineLostError("the cable is out")
    rig.turn(gait=True)
    assert not rig.loop.health.connected
    assert rig.loop.health.reason == "the cable is out"
