"""The logic of relay tails, exhaustively on a grid: never both on, dead time, on-times."""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import Gait, JointDrive
from fin_plant.gait_follower import GaitFollower
from fin_servo_driver.relay import HIGHEST_FREQUENCY, LEFT, OFF, RIGHT, RelayMotion, RelaySwitch
from fin_servo_driver.robot_file import RelayJoint, RelayTiming
from fin_servo_driver.tail import Command, Phase, Settings, Tail

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

PERIOD = 0.01
STROKE = math.radians(15.0)
TIMING = RelayTiming()
JITTER = 1e-9
"""Rounding of the times, s."""


def run_all(
    gaits: Sequence[JointDrive], seconds: float, timing: RelayTiming = TIMING, jitter: float = 0.0
) -> list[list[tuple[float, int]]]:
    """Return for each gait the changes of level as (time, level), and the end, of a joint of its own."""
    joints = [RelayJoint(2 * number, 2 * number + 1, STROKE) for number in range(len(gaits))]
    motion = RelayMotion(joints, timing, PERIOD)
    motion.restart(0.5, {})
    motion.command(motion.allowed(Gait(tuple(gaits)), STROKE, 5.0), 0.0)
    random = np.random.default_rng(3)
    changes: list[list[tuple[float, int]]] = [[] for _ in gaits]
    levels, now = [OFF] * len(gaits), 0.0
    while now < seconds:
        outputs = motion.outputs(now, 1.0)
        for number, joint in enumerate(joints):
            left, right = outputs[joint.left], outputs[joint.right]
            assert not (left and right), "both on"
            new = int(right - left)
            if new != levels[number]:
                changes[number].append((now, new))
                levels[number] = new
        now += PERIOD * (1.0 + jitter * random.random()) if jitter else PERIOD
    return [[*record, (now, level)] for record, level in zip(changes, levels, strict=True)]


def run(gait: JointDrive, seconds: float) -> list[tuple[float, int]]:
    """Return the changes of level of one joint as (time, level), and the end."""
    return run_all([gait], seconds)[0]


def check(changes: list[tuple[float, int]], timing: RelayTiming, tick: float) -> None:
    """Check every rule on a record of changes."""
    last_side, off_since = OFF, -math.inf
    for (begin, level), (end, following) in itertools.pairwise(changes):
        if level == OFF:
            off_since = begin
            continue
        if last_side not in {OFF, level}:
            assert begin - off_since >= timing.dead_time - JITTER
        last_side = level
        assert end - begin <= timing.longest_on + tick + JITTER
        if (end, following) != changes[-1]:
            assert following == OFF, "from one side straight to the other"
            assert end - begin >= timing.shortest_on - JITTER


MOST_JOINTS = 20
FREQUENCIES = (0.02, 0.1, 0.24, 0.5, 0.9, 1.7, 2.5, 3.3, 4.1, 5.0)
"""Hz."""
GRID = list(
    itertools.product(
        np.linspace(0.0, 1.5, 7),  # amplitude, of the stroke
        np.linspace(-1.5, 1.5, 7),  # bias, of the stroke
        np.linspace(-math.pi, math.pi, 5),  # phase, rad
    )
)


def gaits(frequency: float, every: int = 1, first: int = 0) -> Iterator[list[JointDrive]]:
    """Yield the gaits of the grid at a frequency in Hz, or one of so many, in parts that one tail can have."""
    chosen = [
        JointDrive(float(a) * STROKE, frequency, float(phase), float(b) * STROKE) for a, b, phase in GRID[first::every]
    ]
    for place in range(0, len(chosen), MOST_JOINTS):
        yield chosen[place : place + MOST_JOINTS]


# Every thirteenth gait of the grid has each amplitude, bias and phase, and at another frequency other ones together.
@pytest.mark.parametrize(
    ("dead_time", "every"),
    [(0.03, 13), *(pytest.param(dead_time, 1, marks=pytest.mark.long) for dead_time in (0.02, 0.03, 0.05))],
)
def test_every_rule_holds_on_the_whole_grid(dead_time: float, every: int) -> None:
    timing = RelayTiming(dead_time=dead_time)
    for number, frequency in enumerate(FREQUENCIES):
        seconds = min(max(3.0, 2.2 / frequency), 12.0)
        for part in gaits(frequency, every, first=number % every):
            for changes in run_all(part, seconds, timing):
                check(changes, timing, 0.0)


def test_the_rules_hold_when_the_ticks_are_late() -> None:
    for frequency in FREQUENCIES:
        for part in gaits(frequency, every=11):
            for changes in run_all(part, 3.0, jitter=2.0):
                check(changes, TIMING, 3 * PERIOD)


@pytest.mark.parametrize("frequency", [2.0, 2.5])
def test_the_robots_relays_are_asked_at_each_tick_for_what_the_simulated_ones_do(
    frequency: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where amplitude and bias fill a half beat the last digit of a quotient decides at each change of side."""
    asked: list[int] = []
    monkeypatch.setattr(RelaySwitch, "step", lambda _, wanted, __: asked.append(wanted))
    ticks = [PERIOD * number for number in range(200)]
    joints = [RelayJoint(0, 1, math.radians(12.0)), RelayJoint(2, 3, STROKE)]
    for part, side in itertools.product((0.1, 0.25, 0.3, 0.75, 1.0), (-1.0, 1.0)):
        full = [JointDrive(part * j.stroke, frequency, bias=side * (j.stroke - part * j.stroke)) for j in joints]
        motion, simulated = RelayMotion(joints, TIMING, PERIOD), GaitFollower(2, 0.2)
        motion.restart(0.2, {})
        for tail in (motion, simulated):
            tail.command(Gait(tuple(full)), 0.0)
        asked.clear()
        for now in ticks:
            motion.outputs(now, 1.0)
        for index, joint in enumerate(joints):
            assert asked[index::2] == simulated.levels(ticks, joint.stroke)[:, index].tolist(), part


@pytest.mark.parametrize("amplitude", [0.3, 0.6, 0.9])
def test_the_duty_is_that_of_the_formula(amplitude: float) -> None:
    changes = run(JointDrive(amplitude * STROKE, 0.5), 60.5)
    on = sum(end - begin for (begin, level), (end, _) in itertools.pairwise(changes) if level == RIGHT and begin > 0.5)
    expected = 2.0 * math.asin(amplitude) / (2.0 * math.pi)
    assert on / 60.0 == pytest.approx(expected, abs=0.012)  # a tick of each window


def test_the_window_is_centred_on_the_peak() -> None:
    changes = [(now, level) for now, level in run(JointDrive(0.7 * STROKE, 0.5), 20.0) if now > 2.0]
    for (begin, level), (end, _) in itertools.pairwise(changes[:-1]):
        if level == RIGHT:
            assert ((begin + end) / 2.0) % 2.0 == pytest.approx(0.5, abs=PERIOD)
        if level == LEFT:
            assert ((begin + end) / 2.0) % 2.0 == pytest.approx(1.5, abs=PERIOD)


def test_a_bias_makes_one_side_longer() -> None:
    changes = run(JointDrive(0.5 * STROKE, 0.5, 0.0, 0.3 * STROKE), 40.0)
    times = {
        side: sum(end - begin for (begin, level), (end, _) in itertools.pairwise(changes) if level == side)
        for side in (LEFT, RIGHT)
    }
    assert times[RIGHT] > 2.0 * times[LEFT] > 0.0


def test_no_amplitude_means_off() -> None:
    assert run(JointDrive(0.0, 1.0), 5.0)[:-1] == []


def test_a_side_is_never_switched_with_no_duty() -> None:
    records = run_all([JointDrive(0.5 * STROKE, 0.5, 0.0, side * 0.5 * STROKE) for side in (1.0, -1.0)], 20.0)
    assert [{level for _, level in record[:-1]} for record in records] == [{OFF, RIGHT}, {OFF, LEFT}]


def test_a_coil_that_is_held_is_released_and_stays_so_until_it_is_wanted_anew() -> None:
    switch = RelaySwitch(TIMING, PERIOD)
    times = np.arange(0.0, 5.0, PERIOD)
    levels = [switch.step(LEFT, float(now)) for now in times]
    on = [float(now) for now, level in zip(times, levels, strict=True) if level == LEFT]
    assert on[-1] + PERIOD - on[0] <= TIMING.longest_on + JITTER
    assert on[-1] + PERIOD - on[0] >= TIMING.longest_on - 2 * PERIOD
    assert switch.step(OFF, 5.0) == OFF
    assert switch.step(LEFT, 5.01) == LEFT


def test_operations_are_counted_on_each_side() -> None:
    motion = RelayMotion([RelayJoint(3, 5, STROKE)], TIMING, PERIOD)
    motion.restart(0.1, {})
    motion.command(Gait((JointDrive(0.8 * STROKE, 1.0),)), 0.0)
    for now in np.arange(0.0, 10.0, PERIOD):
        motion.outputs(float(now), 1.0)
    assert motion.operations == {3: 10, 5: 10}


def test_a_tail_that_is_stopped_has_all_off_at_once() -> None:
    motion = RelayMotion([RelayJoint(1, 2, STROKE)], TIMING, PERIOD)
    motion.restart(0.0, {})
    motion.command(Gait((JointDrive(STROKE, 0.5),)), 0.0)
    assert any(motion.outputs(now, 1.0)[2] for now in (0.4, 0.41))
    assert motion.outputs(0.42, 0.999) == {1: 0.0, 2: 0.0} == motion.neutral()


def test_a_stop_that_comes_after_the_tick_looked_at_the_clock_is_carried_out() -> None:
    motion = RelayMotion([RelayJoint(1, 2, STROKE)], TIMING, PERIOD)
    tail = Tail(motion, Settings(0.5, 0.5))
    tail.arm(0.0)
    tail.command(Command(Gait((JointDrive(STROKE, 1.0),)), 1.0), {})
    assert tail.tick(1.0) is not None
    tail.stop(1.0101)
    assert tail.tick(1.01) is None
    assert tail.phase is Phase.SILENT


def test_after_a_release_the_dead_time_holds() -> None:
    switch = RelaySwitch(TIMING, PERIOD)
    assert switch.step(LEFT, 0.0) == LEFT
    switch.release(0.01)
    assert switch.step(RIGHT, 0.02) == OFF
    assert switch.step(RIGHT, 0.01 + TIMING.dead_time) == RIGHT


def test_a_frequency_that_relays_cannot_follow_is_refused() -> None:
    motion = RelayMotion([RelayJoint(1, 2, STROKE)], TIMING, PERIOD)
    with pytest.raises(ValueError, match=r"gait frequency = 5.01 Hz is more than relays follow, at most 5 Hz"):
        motion.allowed(Gait((JointDrive(0.1, HIGHEST_FREQUENCY + 0.01),)), STROKE, 20.0)


@pytest.mark.parametrize(
    ("dead_time", "shortest_on", "highest"), [(0.1, 0.15, 2.0), (1.0, 1.0, 0.25), (0.02, 0.01, 5.0)]
)
def test_slow_relays_lower_the_highest_frequency(dead_time: float, shortest_on: float, highest: float) -> None:
    timing = RelayTiming(dead_time=dead_time, shortest_on=shortest_on)
    motion = RelayMotion([RelayJoint(1, 2, STROKE)], timing, PERIOD)
    assert motion.allowed(Gait((JointDrive(0.1, highest),)), STROKE, 20.0).joints[0].frequency == highest
    too_high = Gait((JointDrive(0.1, 1.01 * highest),))
    says = f"at most {highest:g} Hz"
    if highest < HIGHEST_FREQUENCY:
        says += f": half a beat must hold timing.dead_time = {dead_time:g} s and timing.shortest_on = {shortest_on:g} s"
    with pytest.raises(ValueError, match=re.escape(says)):
        motion.allowed(too_high, STROKE, 20.0)


@pytest.mark.parametrize("phase", [math.pi, 100.0 * math.pi, 2.0, -1e6])
def test_a_new_phase_adds_no_operations_of_the_relays(phase: float) -> None:
    motion = RelayMotion([RelayJoint(1, 2, STROKE)], TIMING, PERIOD)
    motion.restart(0.5, {})
    motion.command(Gait((JointDrive(0.2, 1.0),)), 0.0)
    for now in np.arange(0.0, 13.0, PERIOD):
        if now == pytest.approx(3.0):
            before = dict(motion.operations)
            motion.command(Gait((JointDrive(0.2, 1.0, phase),)), float(now))
        motion.outputs(float(now), 1.0)
    for channel, count in motion.operations.items():
        assert 8 <= count - before[channel] <= 11
