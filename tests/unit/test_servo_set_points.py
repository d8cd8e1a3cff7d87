"""From gaits to positions, and the tail's state machine with its watchdog: the rules of safety, one by one."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, carangiform
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.robot_file import RelayJoint, RelayTiming, ServoJoint
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import LONGEST_STOP, Command, Phase, Settings, Tail

RATE = 50.0
PERIOD = 1.0 / RATE
JOINT = ServoJoint(
    channel=9, centre=1500, direction=-1, units_per_radian=573, lowest=1200, highest=1800, sweep=0.27, rate=6.0
)
STILL = carangiform(0.0, 0.9)
TIMEOUT = 0.5
NEUTRAL = {9: 1500.0}


def motion() -> ServoMotion:
    return ServoMotion([JOINT], PERIOD)


def armed(timeout: float | None = TIMEOUT, subject: Motion | None = None, ramp_time: float = 0.5) -> Tail:
    tail = Tail(subject or motion(), Settings(timeout, ramp_time))
    tail.arm(0.0)
    return tail


def drive(tail: Tail, start: float, end: float, gait: Gait | None = PAPER_GAIT) -> list[tuple[float, float | None]]:
    """Tick from start to end s, with the gait sent at 4 Hz if there is one; return times and positions of channel 9."""
    record = []
    for number in range(round((end - start) * RATE)):
        now = start + number * PERIOD
        if gait is not None and number % 12 == 0:
            tail.command(Command(gait, now), {})
        outputs = tail.tick(now)
        record.append((now, None if outputs is None else outputs[9]))
    return record


def positions(record: list[tuple[float, float | None]]) -> list[float]:
    return [position for _, position in record if position is not None]


# -- what is sent ----------------------------------------------------------------------------------------------------


def test_the_sinusoid_is_evaluated_at_the_moment_of_sending() -> None:
    tail = armed(None)
    tail.command(Command(PAPER_GAIT, 1.0), {})
    times = np.cumsum(np.random.default_rng(1).uniform(0.005, 0.035, 200)) + 1.0
    for now in times:
        outputs = tail.tick(float(now))
        assert outputs is not None
        if now > 1.5:
            angle = math.radians(15.0) * math.sin(2.0 * math.pi * 0.9 * (now - 1.0))
            assert outputs[9] == pytest.approx(1500.0 + 573.0 * angle, abs=1e-6)


def test_a_change_of_frequency_and_amplitude_is_continuous_and_ramped() -> None:
    tail = armed()
    record = drive(tail, 0.0, 3.0)
    record += drive(tail, 3.0, 6.0, carangiform(0.1, 2.3))
    record += drive(tail, 6.0, 8.0, STILL)
    steps = np.abs(np.diff(positions(record)))
    fastest = 573.0 * 2.0 * math.pi * max(0.9 * math.radians(15.0), 2.3 * 0.1)
    assert np.max(steps) < 1.6 * fastest * PERIOD  # while both change the rate is at most the two's sum
    assert positions(record)[-1] == 1500.0


@pytest.mark.parametrize(
    ("asked", "applied"),
    [
        (JointDrive(0.1, 0.9), JointDrive(0.1, 0.9)),
        (JointDrive(1.0, 0.9), JointDrive(0.2, 0.9)),
        (JointDrive(0.2, 0.9, 0.3, 0.1), JointDrive(0.1, 0.9, 0.3, 0.1)),
        (JointDrive(0.1, 30.0), JointDrive(0.1, 5.0)),
        (JointDrive(0.0, 0.9, 0.0, -3.0), JointDrive(0.0, 0.9, 0.0, -0.2)),
    ],
)
def test_a_gait_is_limited_before_it_is_followed(asked: JointDrive, applied: JointDrive) -> None:
    result = motion().allowed(Gait((asked,)), sweep=0.2, highest_frequency=5.0).joints[0]
    assert result.amplitude == pytest.approx(applied.amplitude, abs=1e-12)
    assert (result.frequency, result.phase, result.bias) == (applied.frequency, applied.phase, applied.bias)


def test_where_the_rate_is_the_limit_the_amplitude_gives_way() -> None:
    result = motion().allowed(carangiform(0.25, 5.0), sweep=0.27, highest_frequency=5.0).joints[0]
    assert result.frequency == 5.0
    assert result.amplitude * 2.0 * math.pi * 5.0 == pytest.approx(JOINT.rate)


def test_the_range_of_the_servo_limits_the_gait_too() -> None:
    narrow = ServoMotion([ServoJoint(9, 1500, 1, 573, 1450, 1800)], PERIOD)
    assert narrow.allowed(PAPER_GAIT, 0.26, 5.0).joints[0].amplitude == pytest.approx(50 / 573)


def test_a_gait_with_another_number_of_rows_is_refused() -> None:
    with pytest.raises(ValueError, match="gait has 2 rows, the tail has 1 driven joint"):
        motion().allowed(Gait((JointDrive(0.1, 1.0),) * 2), 0.2, 5.0)


def test_two_joints_keep_their_lag() -> None:
    joints = [ServoJoint(2, 1500, 1, 573, 1200, 1800), ServoJoint(3, 1480, -1, 600, 1200, 1800)]
    subject = ServoMotion(joints, PERIOD)
    subject.restart(0.0, {})
    subject.command(Gait((JointDrive(0.1, 1.0), JointDrive(0.2, 1.0, -0.5))), 0.0)
    for now in np.arange(0.0, 2.0, PERIOD):
        outputs = subject.outputs(float(now), 1.0)
    assert outputs[2] == pytest.approx(1500 - 573 * 0.1 * math.sin(2 * math.pi * now))
    assert outputs[3] == pytest.approx(1480 + 600 * 0.2 * math.sin(2 * math.pi * now - 0.5))


def test_a_start_with_measured_positions_leads_from_there_at_the_joints_rate() -> None:
    tail = armed()
    tail.command(Command(PAPER_GAIT, 1.0), {9: 1650.0})
    outputs = tail.tick(1.0)
    assert outputs is not None
    assert outputs[9] == pytest.approx(1650.0 - 573.0 * JOINT.rate * PERIOD)


# -- silent until armed, and the four tests of a stale command -------------------------------------------------------


def test_nothing_is_sent_before_it_is_armed() -> None:
    tail = Tail(motion(), Settings(TIMEOUT, 0.5))
    assert all(position is None for _, position in drive(tail, 0.0, 2.0))
    assert tail.phase is Phase.DISARMED


def test_an_armed_tail_is_silent_until_the_first_gait() -> None:
    tail = armed()
    assert all(position is None for _, position in drive(tail, 0.0, 1.0, None))
    assert tail.phase is Phase.SILENT


def test_a_command_times_out_to_neutral_and_then_silence() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    record = drive(tail, 2.31, 4.0, None)
    last = max(now for now, position in record if position is not None)
    assert 2.28 + TIMEOUT < last < 2.31 + TIMEOUT + 0.4 + 2 * PERIOD
    sent = positions(record)
    assert sent[-5:] == [1500.0] * 5  # held there for a tenth of a second
    assert np.max(np.abs(np.diff(sent))) <= 573 * JOINT.rate * PERIOD + 1e-9
    assert tail.timeouts == 1


def test_after_a_timeout_only_a_fresh_gait_moves_the_tail_and_from_neutral() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    drive(tail, 2.31, 4.0, None)
    assert all(position is None for _, position in drive(tail, 4.0, 5.0, None))
    again = positions(drive(tail, 5.0, 5.5))
    assert again[0] == 1500.0
    assert abs(again[1] - 1500.0) < 1.0


def test_a_disarm_leads_to_neutral_and_then_nothing_moves_it() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    tail.disarm(2.31)
    sent = positions(drive(tail, 2.31, 4.0))
    assert sent[-1] == 1500.0
    assert len(sent) <= 0.4 * RATE + 1
    assert tail.phase is Phase.DISARMED
    assert all(position is None for _, position in drive(tail, 4.0, 5.0))


def test_a_disarm_at_rest_is_at_once() -> None:
    tail = armed()
    tail.disarm(1.0)
    assert tail.phase is Phase.DISARMED


def test_no_output_is_nan_at_the_start_or_ever() -> None:
    for start in (0.0, -1.0, 1e9, 1e-300):
        tail = armed()
        tail.command(Command(PAPER_GAIT, start), {9: math.nan})
        outputs = tail.tick(start)
        if outputs is not None:
            assert math.isfinite(outputs[9])


def test_the_timeout_is_off_only_where_the_settings_say_none() -> None:
    forever, default = armed(None), armed()
    for tail in (forever, default):
        tail.command(Command(PAPER_GAIT, 0.0), {})
        drive(tail, 0.0, 60.0, None)
    assert forever.phase is Phase.FOLLOWING
    assert default.phase is Phase.SILENT


def test_a_cut_silences_at_once_and_what_was_sent_before_counts_no_more() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    tail.cut(2.31)
    assert tail.tick(2.32) is None
    assert not tail.command(Command(PAPER_GAIT, 2.30), {})
    assert tail.tick(2.34) is None
    assert tail.command(Command(PAPER_GAIT, 2.36), {})
    assert tail.tick(2.36) == NEUTRAL


def test_a_gait_received_before_somebody_asked_for_something_counts_no_more() -> None:
    tail = armed()
    waiting_in_the_mailbox = Command(PAPER_GAIT, 1.00)
    tail.refuse_before(1.01)
    tail.stop(1.02)
    assert not tail.command(waiting_in_the_mailbox, {})
    assert tail.tick(1.02) is None
    # One that came after it, though before the request was carried out, does.
    assert tail.command(Command(PAPER_GAIT, 1.015), {})


def test_a_gait_starts_when_it_was_first_received_though_its_repetition_took_its_place() -> None:
    tail, alone = armed(None), armed(None)
    tail.command(Command(PAPER_GAIT, 1.004, since=1.0), {})
    alone.command(Command(PAPER_GAIT, 1.0), {})
    for now in np.arange(1.01, 3.0, PERIOD):
        assert tail.tick(now) == alone.tick(now)


def test_what_repeats_a_gait_of_before_a_cut_starts_it_anew() -> None:
    tail = armed(None)
    drive(tail, 0.0, 2.31)
    tail.cut(2.31)
    assert tail.command(Command(PAPER_GAIT, 2.36, since=0.0), {})
    assert tail.tick(2.36) == NEUTRAL


@pytest.mark.parametrize("late", [0.1, 0.29, 0.8])
def test_a_gait_that_starts_late_starts_from_rest_and_keeps_its_phase(late: float) -> None:
    tail = armed(None)
    tail.command(Command(PAPER_GAIT, late, since=0.0), {})
    times = np.arange(late, 3.0, PERIOD)
    way = positions([(now, outputs[9]) for now in times if (outputs := tail.tick(now)) is not None])
    assert way[0] == 1500.0
    fastest = 573.0 * math.radians(15.0) * 2.0 * math.pi * 0.9
    assert np.max(np.abs(np.diff(way))) < 1.6 * fastest * PERIOD
    assert np.max(np.abs(np.diff(way[:3]))) < 0.1 * fastest * PERIOD
    settled = times > late + 0.5
    angles = math.radians(15.0) * np.sin(2.0 * math.pi * 0.9 * times[settled])
    assert np.array(way)[settled] == pytest.approx(1500.0 + 573.0 * angles, abs=1e-6)


def test_a_gait_without_a_ramp_starts_no_faster_than_it_beats_also_late() -> None:
    tail = armed(None, ramp_time=0.0)
    tail.command(Command(carangiform(0.1, 1.0), 0.25, since=0.0), {})
    way = [1500.0, *positions(drive(tail, 0.25, 2.0, None))]
    assert max(np.abs(np.diff(way))) <= 1.5 * 573.0 * 0.1 * 2.0 * math.pi * PERIOD


def test_a_slow_joint_is_led_to_neutral_at_its_own_rate() -> None:
    slow = ServoMotion([replace(JOINT, rate=0.3)], PERIOD)
    tail = armed(None, subject=slow)
    tail.command(Command(Gait((JointDrive(0.0, 0.9, 0.0, math.radians(15.0)),)), 1.0), {})
    standing = positions(drive(tail, 1.0, 4.0, None))[-1]
    assert standing == pytest.approx(1650.0, abs=0.1)
    tail.stop(4.0)
    way = positions(drive(tail, 4.0, 4.0 + slow.stop_time, None))
    assert max(np.abs(np.diff([standing, *way]))) <= 573.0 * 0.3 * PERIOD * 1.001
    assert way[-1] == pytest.approx(1500.0, abs=0.1)
    # At neutral the rate holds a sweep's way (0.5236 rad at 6 rad/s here) beside the fade of 0.3 s and 0.1 s of hold.
    reachable = motion()._joints[0].reachable
    assert motion().stop_time == pytest.approx(0.3 + reachable / motion()._joints[0].rate + 0.1)


@given(
    start=st.floats(-0.5, 0.5),
    rate=st.floats(0.2, 12.0),
    amplitude=st.floats(0.0, 0.26),
    bias=st.floats(-0.2, 0.2),
    frequency=st.floats(0.1, 3.0),
    ticks=st.integers(1, 150),
)
def test_from_wherever_the_tail_starts_every_step_to_rest_keeps_the_rate(
    start: float, rate: float, amplitude: float, bias: float, frequency: float, ticks: int
) -> None:
    joint = replace(JOINT, rate=rate)
    subject = ServoMotion([joint], PERIOD)
    tail = armed(None, subject=subject)
    standing = min(max(joint.centre + joint.units_per_radian * start, joint.lowest), joint.highest)
    gait = subject.allowed(Gait((JointDrive(amplitude, frequency, 0.0, bias),)), math.radians(15.0), 10.0)
    tail.command(Command(gait, 0.0), {joint.channel: standing})
    stop_at = ticks * PERIOD
    way = positions(drive(tail, 0.0, stop_at, None))
    tail.stop(stop_at)
    way += positions(drive(tail, stop_at, stop_at + LONGEST_STOP + 1.0, None))
    steps = np.abs(np.diff([standing, *way]))
    assert np.all(steps <= joint.units_per_radian * rate * PERIOD * 1.001 + 1e-6)
    assert tail.phase is Phase.SILENT


def test_a_gait_during_the_stop_is_not_followed() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    tail.stop(2.31)
    assert not tail.command(Command(PAPER_GAIT, 2.4), {})
    record = drive(tail, 2.4, 2.8)
    assert positions(record)[-1] == 1500.0


def test_a_cut_during_a_disarm_disarms() -> None:
    tail = armed()
    drive(tail, 0.0, 2.31)
    tail.disarm(2.31)
    tail.cut(2.4)
    assert tail.phase is Phase.DISARMED
    tail.arm(2.5)
    assert str(tail.phase) == str(Phase.SILENT)


def test_arming_twice_changes_nothing() -> None:
    tail = armed()
    drive(tail, 0.0, 1.0)
    tail.arm(1.0)
    assert tail.phase is Phase.FOLLOWING


def test_a_still_gait_holds_neutral_until_it_times_out() -> None:
    tail = armed()
    assert set(positions(drive(tail, 0.0, 1.0, STILL))) == {1500.0}
    drive(tail, 1.0, 3.0, None)
    assert tail.phase is Phase.SILENT


def still_from(tail: Tail, start: float, sampled: list[tuple[float, float | None]]) -> float:
    """Send a still gait until the tail is said to stand; return the time, with the samples in between added."""
    for number in range(round(3.0 * RATE)):
        now = start + number * PERIOD
        sampled += drive(tail, now, now + PERIOD, STILL)
        if tail.is_still(now):
            return now
    pytest.fail("the tail was never said to stand")


@pytest.mark.parametrize("beaten", [0.1, 0.3, 1.0, 1.4])
def test_after_its_gaits_end_a_tail_stands_when_it_was_held_at_neutral_and_not_before(beaten: float) -> None:
    tail = armed()
    assert tail.is_still(0.0)
    drive(tail, 0.0, beaten)
    assert not tail.is_still(beaten)
    record: list[tuple[float, float | None]] = []
    end = still_from(tail, beaten, record)
    held = [position for time, position in record if time > end - 0.1]
    assert set(held) == {1500.0}
    assert len(held) >= 5
    drive(tail, end + PERIOD, end + 1.0)
    assert not tail.is_still(end + 1.0)


def test_a_tail_that_is_stopped_stands_when_it_falls_silent() -> None:
    tail = armed()
    drive(tail, 0.0, 1.0)
    tail.stop(1.0)
    while tail.phase is Phase.STOPPING:
        assert not tail.is_still(1.0)
        drive(tail, 1.0, 3.0, None)
    assert tail.is_still(3.0)


def test_relays_stand_when_the_last_stroke_of_the_ramp_is_over() -> None:
    tail = armed(None, RelayMotion([RelayJoint(1, 2)], RelayTiming(), 0.01))
    on_after_end = []
    end = math.inf
    for number in range(400):
        now = 0.01 * number
        if number in {0, 100}:
            tail.command(Command(PAPER_GAIT if number == 0 else STILL, now), {})
        outputs = tail.tick(now)
        assert outputs is not None
        end = min(end, now) if number > 100 and tail.is_still(now) else end
        if now >= end:
            on_after_end.append(any(outputs.values()))
    assert 1.0 < end < 2.5
    assert not any(on_after_end)


gaits = st.builds(
    carangiform, st.floats(0.0, math.pi, allow_subnormal=True), st.floats(0.0, 100.0, allow_subnormal=True)
)
events = st.one_of(gaits, st.sampled_from(["arm", "disarm", "stop", "cut"]))
gaps = st.floats(0.0, 2.0, allow_subnormal=True)


@settings(max_examples=300)
@given(st.lists(st.tuples(gaps, events), max_size=30), st.booleans())
def test_no_sequence_of_events_leaves_the_limits(sequence: list[tuple[float, Gait | str]], relays: bool) -> None:
    subject: Motion = RelayMotion([RelayJoint(1, 2)], RelayTiming(), 0.01) if relays else motion()
    tail = Tail(subject, Settings(TIMEOUT, 0.2))
    now = 0.0
    for gap, event in sequence:
        for _ in range(3):
            now += gap / 3
            outputs = tail.tick(now)
            assert outputs is None or tail.phase in {Phase.FOLLOWING, Phase.STOPPING}
            if outputs and relays:
                assert sorted(outputs.values()) in ([0.0, 0.0], [0.0, 1.0])
            elif outputs:
                assert JOINT.lowest <= outputs[9] <= JOINT.highest
        if isinstance(event, str):
            getattr(tail, event)(now)
        elif event.joints[0].frequency <= 5.0:
            tail.command(Command(subject.allowed(event, 0.26, 5.0), now), {})


def test_the_phases_are_all_reached_by_these_tests() -> None:
    tail = armed()
    seen = {Tail(motion(), Settings(TIMEOUT, 0.5)).phase, tail.phase}
    drive(tail, 0.0, 1.0)
    seen.add(tail.phase)
    tail.stop(1.0)
    seen.add(tail.phase)
    assert seen == set(Phase)
    assert len(list(itertools.pairwise(seen))) == 3
