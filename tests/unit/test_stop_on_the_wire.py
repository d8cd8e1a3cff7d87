"""The emergency stop as the device sees it: fired between any two frames and in any wait, on the line's own clock."""

from __future__ import annotations

import contextlib
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import Gait, JointDrive
from fin_servo_driver import backends, device_loop, robot_file
from fin_servo_driver.backends import backend as backend_module
from fin_servo_driver.backends import firmata, modbus
from fin_servo_driver.backends.backend import BITS_A_BYTE
from fin_servo_driver.device_loop import DeviceLoop
from fin_servo_driver.emulator.devices import Modbus
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.line import LineLostError, StopAskedError
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.robot_file import RelayJoint
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import Command, Phase, Settings
from support.wire import OwnClock, Wire

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from fin_servo_driver.emulator.devices import Device
    from fin_servo_driver.robot_file import Robot

FORCE_OFF_WITHIN = 0.02
"""s after a stop."""
WATCHED = 0.15
"""s after a stop in which nothing may move."""
Act = tuple[float, "Callable[[], object]"]
"""What happens, and when: s from the beginning."""


def robot_with(name: str, joints: int) -> Robot:
    """Return an example's robot with so many joints, on channels in a row."""
    robot = robot_file.load(robot_file.find(name))
    if robot.relays:
        first = robot.relays[0].left
        made = tuple(
            replace(robot.relays[0], left=first + 2 * index, right=first + 2 * index + 1) for index in range(joints)
        )
        return replace(robot, joints=made)
    channel = robot.servos[0].channel if joints == 1 else max(robot.servos[0].channel - 7, 0)
    options = dict(robot.options) | ({"model": 18} if name == "maestro" and joints > 1 else {})
    servos = tuple(replace(robot.servos[0], channel=channel + index) for index in range(joints))
    return replace(robot, joints=servos, options=options)


@dataclass
class Scene:
    """A driver on a line with its own clock, and all that it goes through, with a stop at one moment of it.

    Attributes:
        stop_at: The number of the moment, of all writes, reads and sleeps; None for none.
        moments: What the driver was doing at each moment.
        stopped: s at which the stop was asked for.
        frames_before: Frames that were handed over by then.
    """

    robot: Robot
    stop_at: int | None = None
    moments: list[str] = field(default_factory=list)
    stopped: float | None = None
    wires: list[Wire] = field(default_factory=list)
    frames_before: int = 0

    def __post_init__(self) -> None:
        self.clock = OwnClock()
        self.device: Device = device_for(self.robot, lambda _: 0.0)
        self.device.outputs = self.held()  # an earlier driver may have left it so
        for table in getattr(self.device, "tables", {}).values():
            table[64] = True
        backend = backends.make(self.robot, self.clock)
        if hasattr(backend, "_random"):
            backend._random = random.Random(1)  # noqa: S311 - the moments are the same in each run
        self._baud = self.robot.baud or backend.baud
        self.motion: Motion
        if self.robot.relays:
            self.motion = RelayMotion(self.robot.relays, self.robot.timing, 1.0 / backend.rate)
        else:
            self.motion = ServoMotion(self.robot.servos, 1.0 / backend.rate)
        self.loop = DeviceLoop(
            backend, self.motion, Settings(0.5, 0.1), self.open, "fake://", lambda _: None, self.clock
        )
        self.doing = "identifying"
        self.begin = self.clock.now
        drives = (JointDrive(0.2, 2.0, 0.3 * index, 0.0) for index in range(len(self.robot.joints)))
        self.gait = self.motion.allowed(Gait(tuple(drives)), 0.2617, 5.0)
        self.script = self.acts()
        self.next_act: Act | None = next(self.script)

    def open(self) -> Wire:
        wire = Wire(self.device, self._baud, self.clock)
        wire.touched = self.moment
        self.wires.append(wire)
        return wire

    def moment(self) -> None:
        number = len(self.moments)
        is_enabling = self.loop._force is device_loop._Force.UNSURE and self.loop._tail.phase is Phase.FOLLOWING
        self.moments.append("enabling" if is_enabling else self.doing)
        if number == self.stop_at:
            self.stopped = self.clock.now
            self.frames_before = sum(len(wire.log) for wire in self.wires)
            self.loop.cut()

    def acts(self) -> Iterator[Act]:
        """Yield what happens, with its time."""

        def act(doing: str, work: Callable[[], object]) -> Callable[[], object]:
            def done() -> None:
                self.doing = doing
                work()

            return done

        at = 0.0

        def swim(until: float) -> Iterator[Act]:
            nonlocal at
            while at < until:
                yield at, act("swimming", lambda: self.loop.mailbox.put(Command(self.gait, self.clock.now)))
                at += 0.1

        yield 0.02, act("armed", self.loop.arm)
        at = 0.05
        yield from swim(0.35)
        yield 0.35, act("leading to neutral", self.loop.stop_tail)
        yield 0.9, act("settled", lambda: None)
        at = 0.95
        yield from swim(1.1)
        yield 1.1, act("reconnecting", self.lose)
        yield 1.5, self.loop.end

    def lose(self) -> None:
        self.wires[-1].lost = LineLostError("the cable is out")

    def sleep(self, seconds: float) -> None:
        """Let the driver sleep: what is to happen happens."""
        until = self.clock.now + seconds
        self.moment()
        while not self.loop._stop.asked and self.clock.now < until:
            if self.stopped is not None:
                self.clock.sleep(until - self.clock.now)
                if self.clock.now > self.line_there() + WATCHED:
                    self.loop.end()
                return
            if self.next_act is None or self.begin + self.next_act[0] > until:
                self.clock.sleep(until - self.clock.now)
                return
            self.clock.sleep(self.begin + self.next_act[0] - self.clock.now)
            self.next_act[1]()
            self.next_act = next(self.script, None)
            if self.loop.is_asked or self.loop._is_ending:
                return

    def play(self) -> None:
        with contextlib.suppress(StopAskedError):
            self.loop.connect()
        self.begin = self.clock.now
        if self.loop._line is not None:
            while (idle := self.loop.turn()) is not None:
                self.sleep(idle)
            self.loop.finish("the scene has ended")
        else:
            self.clock.sleep(WATCHED)
            self.wires[-1]._pass(self.clock.now)

    def held(self) -> dict[int, float | None]:
        """Return outputs of a device under force, somewhere."""
        if self.robot.servos:
            return {joint.channel: 1777.0 for joint in self.robot.servos}
        return {channel: float(channel == joint.left) for joint in self.robot.relays for channel in joint.channels}

    def line_there(self) -> float:
        """Return when the stop was asked for, s, or when the port was there again after it."""
        assert self.stopped is not None
        return float("inf") if self.wires[-1].lost else max(self.stopped, self.wires[-1].opened)

    def has_force(self, outputs: dict[int, float | None]) -> bool:
        """Whether anything is under force."""
        return any(value if self.robot.relays else value is not None for value in outputs.values())

    def force_until(self) -> float:
        """Return how long in s after the stop, or after the port was there again, anything was under force."""
        assert self.stopped is not None
        stopped = self.line_there()
        changes = [(0.0, {}), *(change for wire in self.wires for change in wire.outputs)]
        last = 0.0
        for (_, outputs), (end, _) in zip(changes, [*changes[1:], (float("inf"), {})], strict=True):
            if self.has_force(outputs) and end > stopped:
                last = end - stopped
        return last

    def moving_frames(self) -> list[str]:
        """Return the frames after the stop that would move or enable something on another such device."""
        frames = [written for wire in self.wires for written in wire.log][self.frames_before :]
        return [frame.data.hex(" ") for frame in frames if self.would_move(frame.data)]

    def would_move(self, data: bytes) -> bool:
        """Whether a frame does anything else to a device under force, or to one at rest, than to take force away."""
        at_rest, held = (device_for(self.robot, lambda _: 0.0) for _ in range(2))
        held.outputs, before = self.held(), self.held()
        for device in (at_rest, held):
            for table in getattr(device, "tables", {}).values():
                table[64] = device is held
            device.feed(data, 0.0)
        changed = {channel: value for channel, value in held.outputs.items() if value != before.get(channel)}
        return self.has_force(at_rest.outputs) or any(changed.values())


def played(robot: Robot, stop_at: int | None) -> Scene:
    scene = Scene(robot, stop_at)
    scene.play()
    return scene


CASES = [
    ("dynamixel", 1),
    ("dynamixel", 9),
    ("firmata", 1),
    ("firmata", 9),
    ("maestro", 1),
    ("maestro", 9),
    ("modbus", 1),
    ("modbus", 4),
    ("lcus", 1),
    ("lcus", 8),
    ("kmtronic", 1),
    ("kmtronic", 4),
]


STATES = {"identifying", "enabling", "swimming", "leading to neutral", "settled", "reconnecting"}


def force_off_within(robot: Robot, state: str) -> float:
    """Return how long in s force may last after a stop, or after the port has come back where it was not there.

    Boards that take one relay a frame need so many frames as relays may be on, and those that may be on their way.
    """
    frame = {"lcus": 4, "kmtronic": 3}.get(robot.device, 0) * BITS_A_BYTE / 9600
    may_be_on = len(robot.joints) * (2 if state in {"identifying", "reconnecting"} else 1)
    return max(FORCE_OFF_WITHIN, (may_be_on + backend_module.FRAMES_WAITING + 1) * frame)


def require_stopped(name: str, joints: int, of_each_state: int) -> float:
    """Stop at so many moments of each state, the first and the last among them; return the longest force in s."""
    longest = 0.0
    robot = robot_with(name, joints)
    moments = played(robot, None).moments
    assert set(moments) >= STATES
    for state in STATES:
        numbers = [number for number, doing in enumerate(moments) if doing == state]
        chosen = np.unique(np.linspace(0, len(numbers) - 1, of_each_state).round().astype(int))
        for number in (numbers[index] for index in chosen):
            scene = played(robot, number)
            assert scene.moving_frames() == [], (state, number)
            assert scene.force_until() <= force_off_within(robot, state), (state, number)
            longest = max(longest, scene.force_until())
    return longest


@pytest.mark.parametrize(("name", "joints"), CASES)
def test_a_stop_in_any_state_takes_the_force_at_once_and_nothing_moves_after(name: str, joints: int) -> None:
    require_stopped(name, joints, 3)


@pytest.mark.long
@pytest.mark.parametrize(("name", "joints"), CASES)
def test_a_stop_at_very_many_moments_takes_the_force_at_once_and_nothing_moves_after(name: str, joints: int) -> None:
    longest = require_stopped(name, joints, 15)
    print(f"{name} with {joints} joints: force for {1000.0 * longest:.1f} ms after a stop at most")  # noqa: T201


@pytest.mark.parametrize(("name", "joints"), CASES)
def test_the_scene_that_is_stopped_is_one_in_which_the_tail_swims_and_comes_to_rest(name: str, joints: int) -> None:
    scene = played(robot_with(name, joints), None)
    first, second = scene.wires
    for wire in (first, second):
        assert not scene.has_force(wire.outputs[-1][1]) or wire is first  # the cable was out
    under_force = [outputs for _, outputs in first.outputs if scene.has_force(outputs)]
    assert len({tuple(outputs.values()) for outputs in under_force}) > (3 if scene.robot.servos else 0)
    assert any(scene.would_move(written.data) for written in first.log)


def test_a_firmata_frame_may_be_cut_anywhere_before_the_reset() -> None:
    robot = robot_with("firmata", 3)
    backend, wire = backends.make(robot), Wire(device_for(robot, lambda _: 0.0))
    neutral = {joint.channel: joint.centre for joint in robot.servos}
    backend.enable(wire, neutral)
    backend.send(wire, dict.fromkeys(neutral, 1555.0))
    stream = b"".join(written.data for written in wire.log) + firmata.ask_pin(3)
    for end in range(len(stream) + 1):
        device = device_for(robot, lambda _: 0.0)
        device.feed(stream[:end], 0.0)
        cut = Wire(device)
        device.outputs[9] = 1700.0
        backend.disable(cut)
        assert not any(device.outputs.values()), end
        backend.enable(cut, neutral)
        assert device.outputs == neutral, end


def test_what_waits_in_the_port_is_taken_back_from_a_board_that_stands_it() -> None:
    clock = OwnClock()
    robot = robot_with("firmata", 9)
    backend, wire = backends.make(robot), Wire(device_for(robot, lambda _: 0.0), 57600, clock)
    backend.enable(wire, {joint.channel: joint.centre for joint in robot.servos})
    clock.sleep(0.005)
    wire.discard()
    backend.disable(wire)
    wire.drain(1.0)
    assert clock.now < 1000.0 + 0.006
    assert not any(wire.device.outputs.values())


def test_a_modbus_board_is_told_in_one_frame_and_one_that_refuses_it_was_found_out_before() -> None:
    robot = robot_with("modbus", 4)
    for refuses in (False, True):
        device = modbus_device()
        device.refuses_several = refuses
        backend, wire = backends.make(robot), Wire(device)
        backend.disable(wire)
        device.outputs = dict.fromkeys(device.outputs, 1.0)
        before = len(wire.log)
        backend.disable(wire)
        assert not any(device.outputs.values())
        functions = [written.data[1] for written in wire.log[before:]]
        assert [function for function in functions if function != 0x01] == ([0x05] * 8 if refuses else [0x0F])
        assert functions[-1] == 0x01  # what the board says of its coils is what confirms it


def test_relays_that_are_no_joint_s_stay_as_they_are() -> None:
    robot = robot_with("modbus", 1)
    robot = replace(robot, joints=(RelayJoint(0, 1), RelayJoint(3, 4)))
    device = modbus_device()
    device.outputs[2] = device.outputs[1] = 1.0
    backends.make(robot).disable(Wire(device))
    assert device.outputs[2] == 1.0
    assert sum(value or 0.0 for value in device.outputs.values()) == 1.0


def test_runs_of_neighbours() -> None:
    assert modbus.runs_of([4, 0, 1, 3, 9]) == [(0, 2), (3, 2), (9, 1)]


def modbus_device() -> Modbus:
    """Return a board with eight relays."""
    return Modbus(1)
