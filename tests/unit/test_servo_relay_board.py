"""Relay boards on a line that loses frames: off goes first and is repeated, on waits for what was really sent."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_plant.gait import Gait, JointDrive
from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends.lcus import switch_frame
from fin_servo_driver.line import LineStalledError
from fin_servo_driver.relay import RelayMotion

DEAD_TIME = 0.05
JITTER = 1e-9
"""Rounding of the times, s."""
JOINTS = [{"left": 1, "right": 2}, {"left": 3, "right": 4}]
ALL_OFF = dict.fromkeys((1, 2, 3, 4), 0.0)


class Wire:
    """A line that takes no frame for the channels in ``deaf``."""

    def __init__(self) -> None:
        self.deaf: set[int] = set()
        self.written: list[tuple[int, bool]] = []

    def write(self, data: bytes) -> None:
        if data[1] in self.deaf:
            msg = f"channel {data[1]} took no bytes"
            raise LineStalledError(msg)
        assert data == switch_frame(data[1], on=bool(data[2]))
        self.written.append((data[1], bool(data[2])))

    def read(self, timeout: float) -> bytes:
        del timeout
        return b""

    def taken(self) -> list[tuple[int, bool]]:
        """Return what was written since the last call."""
        written, self.written = self.written, []
        return written


def board() -> backends.backend.Backend:
    timing = {"dead_time": DEAD_TIME}
    return backends.make(robot_file.parse({"device": "lcus", "joints": JOINTS, "timing": timing}))


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in s, which only the test lets pass."""
    clock = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    return clock


def test_one_relay_that_fails_does_not_keep_the_others_from_being_switched_off(now: list[float]) -> None:
    del now
    line, subject = Wire(), board()
    line.deaf = {1}
    with pytest.raises(LineStalledError, match="channel 1 took no bytes"):
        subject.disable(line)
    assert line.taken() == [(2, False), (3, False), (4, False)]
    with pytest.raises(LineStalledError):
        subject.send(line, ALL_OFF)
    assert line.taken() == []  # three are known to be off, the fourth still fails
    line.deaf = set()
    subject.send(line, ALL_OFF)
    assert line.taken() == [(1, False)]


def test_nothing_comes_on_in_a_step_in_which_something_could_not_be_switched_off(now: list[float]) -> None:
    line, subject = Wire(), board()
    subject.disable(line)
    now[0] += 1.0
    subject.send(line, {**ALL_OFF, 1: 1.0})
    line.taken()
    now[0] += 0.2
    line.deaf = {1}
    with pytest.raises(LineStalledError):
        subject.send(line, {**ALL_OFF, 2: 1.0, 3: 1.0})
    assert line.taken() == []
    line.deaf = set()
    subject.send(line, {**ALL_OFF, 2: 1.0, 3: 1.0})
    assert line.taken() == [(1, False), (3, True)]


def test_a_relay_comes_on_a_dead_time_after_its_partners_frame_whatever_was_dropped_between(now: list[float]) -> None:
    line, subject = Wire(), board()
    subject.disable(line)
    now[0] += 1.0
    subject.send(line, {**ALL_OFF, 1: 1.0})
    line.taken()
    now[0] += 0.2  # set-points were dropped here, and with them the rest between the sides
    subject.send(line, {**ALL_OFF, 2: 1.0})
    assert line.taken() == [(1, False)]
    now[0] += 0.9 * DEAD_TIME
    subject.send(line, {**ALL_OFF, 2: 1.0})
    assert line.taken() == []
    now[0] += 0.2 * DEAD_TIME
    subject.send(line, {**ALL_OFF, 2: 1.0})
    assert line.taken() == [(2, True)]


def test_the_first_relay_waits_a_dead_time_after_the_board_was_switched_off(now: list[float]) -> None:
    line, subject = Wire(), board()
    subject.send(line, {**ALL_OFF, 1: 1.0})  # what an earlier driver has left is not known
    assert (1, True) not in line.taken()
    now[0] += 1.1 * DEAD_TIME
    subject.send(line, {**ALL_OFF, 1: 1.0})
    assert line.taken() == [(1, True)]


class SlowBoard:
    """A board at the end of a slow line: frames queue in the port, and switch when their last byte has come."""

    def __init__(self, baud: int) -> None:
        self.switched: dict[int, list[tuple[float, bool]]] = {}
        self._seconds_a_byte = 10.0 / baud
        self._free_at = 0.0

    def write(self, data: bytes) -> None:
        self._free_at = max(self._free_at, time.monotonic()) + len(data) * self._seconds_a_byte
        channel, on = data[1], bool(data[2])
        record = self.switched.setdefault(channel, [])
        if on != (record[-1][1] if record else False):
            record.append((self._free_at, on))

    def read(self, timeout: float) -> bytes:
        del timeout
        return b""


@pytest.mark.parametrize("name", ["lcus", "kmtronic"])
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    baud=st.sampled_from([2400, 9600, 115200]),
    frequency=st.floats(0.3, 4.0),
    late=st.sampled_from([0.0, 0.003, 0.02, 0.06]),
)
def test_dead_time_and_shortest_on_time_hold_at_the_board_however_late_a_tick_is(
    name: str, seed: int, baud: int, frequency: float, late: float
) -> None:
    random = np.random.default_rng(seed)
    robot = robot_file.parse({"device": name, "baud": baud, "joints": JOINTS})
    subject, line, clock = backends.make(robot), SlowBoard(baud), [100.0]
    motion = RelayMotion(robot.relays, robot.timing, 0.01)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: clock[0])
        subject.disable(line)
        motion.restart(0.2, {})
        motion.command(Gait((JointDrive(0.2, frequency), JointDrive(0.2, frequency, 1.0))), clock[0])
        for _ in range(250):
            decided = motion.outputs(clock[0], 1.0)
            clock[0] += random.uniform(0.0, late)  # between the decision and the frame
            subject.send(line, decided)
            clock[0] = 0.01 * math.ceil(clock[0] / 0.01 + 1e-6)
    assert line.switched
    for record in line.switched.values():
        for (begin, on), (end, _) in itertools.pairwise(record):
            assert not on or end - begin >= robot.timing.shortest_on - JITTER
    for joint in robot.relays:
        changes = sorted((at, on, side) for side in joint.channels for at, on in line.switched.get(side, []))
        for (at, on, side), (later, comes_on, other) in itertools.pairwise(changes):
            assert not (on and comes_on), "both on"
            assert on or not comes_on or side == other or later - at >= robot.timing.dead_time - JITTER
