"""A tail follows any sequence of gaits without a jump, and no change makes it much faster than they are."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fin_plant.gait import PAPER_GAIT, Gait, JointDrive
from fin_plant.gait_follower import LARGEST_SPEED_UP, LONGEST_RAMP, GaitFollower
from support.drives import drives

RAMP = 0.5


def ramp(t: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.clip(t / RAMP, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


@given(drives)
def test_from_neutral_the_drive_is_the_ramped_sinusoid(drive: JointDrive) -> None:
    follower = GaitFollower(1, RAMP, as_asked=True)
    follower.command(Gait((drive,)), 0.0)
    t = np.linspace(0.0, 3.0, 200)
    expected = ramp(t) * (drive.bias + drive.amplitude * np.sin(2 * math.pi * drive.frequency * t + drive.phase))
    assert follower.motion(t)[:, 0, 0] == pytest.approx(expected, abs=1e-12)


@settings(max_examples=60)
@given(st.lists(st.tuples(drives, st.floats(0.0, 2.0)), min_size=1, max_size=5))
def test_rate_and_acceleration_are_the_angles_derivatives_through_any_changes(
    changes: list[tuple[JointDrive, float]],
) -> None:
    follower, now, step = GaitFollower(1, RAMP), 0.0, 1e-4
    pieces = []
    for drive, wait in [*changes, (changes[0][0], 1.0)]:
        times = now + step * np.arange(round(wait / step) + 1, dtype=np.float64)
        pieces.append((times, follower.motion(times)[:, 0]))
        now = float(times[-1])
        follower.command(Gait((drive,)), now)
    times = np.concatenate([piece[0][:-1] for piece in pieces])
    motion = np.concatenate([piece[1][:-1] for piece in pieces])
    if len(times) < 3:
        return
    for column in (0, 1):
        slope = (motion[2:, column] - motion[:-2, column]) / (times[2:] - times[:-2])
        # Central differences miss by the third derivative times step^2 / 6, and by half a jump of it at a change.
        largest = np.abs(motion[:, 2]).max() + 1.0
        assert np.abs(slope - motion[1:-1, column + 1]).max() < 1e-2 * largest


def test_a_gait_that_arrives_during_a_ramp_waits_and_the_last_one_counts() -> None:
    follower = GaitFollower(1, RAMP)
    first, second, third = (Gait((JointDrive(amplitude, 1.0),)) for amplitude in (0.1, 0.2, 0.3))
    follower.command(first, 0.0)
    follower.command(second, 0.1)
    follower.command(third, 0.2)
    alone = GaitFollower(1, RAMP)
    alone.command(first, 0.0)
    early = np.linspace(0.2, RAMP, 20)
    assert follower.motion(early) == pytest.approx(alone.motion(early))
    late = np.linspace(2.0, 4.0, 4000)
    assert np.abs(follower.motion(late)[:, 0, 0]).max() == pytest.approx(0.3, rel=1e-4)


def test_a_repeated_gait_changes_nothing() -> None:
    follower, once = GaitFollower(1, RAMP), GaitFollower(1, RAMP)
    once.command(PAPER_GAIT, 0.0)
    for time in np.arange(0.0, 5.0, 0.25):
        follower.command(PAPER_GAIT, float(time))
    t = np.linspace(4.8, 6.0, 100)
    assert np.array_equal(follower.motion(t), once.motion(t))


def test_another_ramp_time_counts_from_the_next_change_on_and_moves_nothing() -> None:
    follower, same = GaitFollower(1, RAMP), GaitFollower(1, RAMP)
    for tail in (follower, same):
        tail.command(PAPER_GAIT, 0.0)
    follower.set_ramp_time(2.0)
    t = np.linspace(0.2, 5.0, 50)
    assert np.array_equal(follower.motion(t), same.motion(t))
    follower.stop(5.0)
    assert follower.motion([6.9])[0, 0, 0] != 0.0
    assert follower.motion([7.0])[0, 0, 0] == 0.0


def test_after_stop_the_tail_rests_at_neutral() -> None:
    follower = GaitFollower(2, RAMP)
    follower.command(Gait((JointDrive(0.2, 1.0, 0.3, 0.1), JointDrive(0.1, 2.0))), 0.0)
    assert follower.moves
    follower.stop(2.0)
    assert not follower.moves
    assert np.array_equal(follower.motion([2.0 + RAMP, 10.0]), np.zeros((2, 2, 3)))


def test_a_gait_with_other_joints_than_the_tail_is_refused() -> None:
    with pytest.raises(ValueError, match="2 rows, the tail has 1 driven joint"):
        GaitFollower(1, RAMP).command(Gait((JointDrive(0.1, 1.0),) * 2), 0.0)


def paper(phase: float = 0.0, frequency: float = 0.9, amplitude: float = 0.26, bias: float = 0.0) -> Gait:
    return Gait((JointDrive(amplitude, frequency, phase, bias),))


@pytest.mark.parametrize("turns", [1, -1, 3, 50, 10_000_000])
def test_a_phase_that_differs_by_whole_turns_changes_nothing(turns: int) -> None:
    tail, same = GaitFollower(1, RAMP), GaitFollower(1, RAMP)
    for follower in (tail, same):
        follower.command(paper(0.4), 0.0)
    tail.command(paper(0.4 + turns * 2.0 * math.pi), 3.0)
    t = np.linspace(3.0, 5.0, 500)
    assert np.array_equal(tail.motion(t), same.motion(t))


@pytest.mark.parametrize("phase", [math.pi, -math.pi, 3.1, -3.1, math.pi / 2.0, 1e9, -7.0])
def test_a_new_phase_is_reached_without_a_whip(phase: float) -> None:
    tail = GaitFollower(1, RAMP)
    tail.command(paper(), 0.0)
    tail.command(paper(phase), 3.0)
    t = np.linspace(3.0, 6.0, 6001)
    motion = tail.motion(t)[:, 0]
    assert np.abs(motion[:, 1]).max() <= LARGEST_SPEED_UP * 0.26 * 2.0 * math.pi * 0.9
    after = t > 3.0 + tail.ramp_time
    wanted = 0.26 * np.sin(2.0 * math.pi * 0.9 * t[after] + phase)
    assert motion[after, 0] == pytest.approx(wanted, abs=1e-6)


# From a twentieth of a hertz on a beat can start within the longest ramp; a larger shift than amplitude is no beat.
beating = st.builds(
    lambda amplitude, frequency, phase, lean: JointDrive(amplitude, frequency, phase, lean * amplitude),
    amplitude=st.floats(0.01, 1.0),
    frequency=st.floats(0.2, 8.0),
    phase=st.floats(-1e3, 1e3),
    lean=st.floats(-0.5, 0.5),
)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.one_of(beating, st.just(None)), st.floats(0.0, 1.5), st.floats(0.0, 2.0)), max_size=5),
    beating,
)
def test_no_change_makes_the_tail_much_faster_than_the_faster_of_the_two_gaits(
    changes: list[tuple[JointDrive | None, float, float]], last: JointDrive
) -> None:
    """Any values, at any moment, with any ramp, however short; None stops the tail."""
    tail, now, step = GaitFollower(1, 0.0), 0.0, 1e-3
    largest = 0.0
    for drive, wait, ramp_time in [*changes, (last, 2.0 * LONGEST_RAMP, 0.0)]:
        tail.set_ramp_time(ramp_time)
        if drive is None:
            tail.stop(now)
        else:
            tail.command(Gait((drive,)), now)
        # Which two gaits a change is between: the one under way until then, and those that may be next.
        gaits = [transition.target for transition in tail._transitions]
        own = max(2.0 * math.pi * rows[0, 0] * rows[0, 1] for rows in gaits)
        largest = max(largest, own)
        times = now + step * np.arange(round(wait / step) + 1, dtype=np.float64)
        angles = tail.motion(times)[:, 0, 0]
        assert np.abs(np.diff(angles)).max(initial=0.0) <= LARGEST_SPEED_UP * largest * step * (1.0 + 1e-3)
        now = float(times[-1])
        if now > tail._transitions[-1].end:
            largest = own if len(gaits) == 1 else 2.0 * math.pi * tail.target[0, 0] * tail.target[0, 1]
    settled = now - 1.0 + np.linspace(0.0, 1.0, 400)
    rate = 2.0 * math.pi * last.amplitude * last.frequency
    assert np.abs(tail.motion(settled)[:, 0, 1]).max() <= rate * (1.0 + 1e-9)


def test_a_ramp_that_is_long_enough_stays_as_asked() -> None:
    tail = GaitFollower(1, RAMP)
    for gait in (paper(), paper(0.5), paper(0.5, frequency=1.8), paper(0.5, amplitude=0.1), paper(0.5, bias=0.05)):
        tail.command(gait, tail._transitions[-1].end if tail.moves else 0.0)
        assert tail.ramp_time == RAMP
    tail.stop(20.0)
    assert tail.ramp_time == RAMP
    still = GaitFollower(1, RAMP)  # turns like a rudder: there is no beat to compare with
    still.command(Gait((JointDrive(0.0, 0.0, bias=0.3),)), 0.0)
    assert still.ramp_time == RAMP


def test_a_ramp_of_no_time_is_lengthened_unless_the_swim_is_computed_with_it() -> None:
    tail, asked = GaitFollower(1, 0.0), GaitFollower(1, 0.0, as_asked=True)
    for follower in (tail, asked):
        follower.command(paper(math.pi / 2.0), 0.0)
    assert asked.motion([0.0])[0, 0, 0] == pytest.approx(0.26)
    assert tail.motion([0.0])[0, 0, 0] == 0.0
    assert 0.1 < tail.ramp_time < 1.0


def test_a_change_of_frequency_alone_keeps_the_beat_that_is_there_halfway() -> None:
    tail = GaitFollower(1, RAMP)
    tail.command(paper(), 0.0)
    tail.command(paper(frequency=1.8), 3.0)
    t = np.linspace(4.0, 6.0, 300)
    halfway = 2.0 * math.pi * 0.9 * (3.0 + RAMP / 2.0)
    wanted = 0.26 * np.sin(halfway + 2.0 * math.pi * 1.8 * (t - 3.0 - RAMP / 2.0))
    assert tail.motion(t)[:, 0, 0] == pytest.approx(wanted, abs=1e-9)


def test_a_relay_wave_changes_its_phase_without_another_stroke() -> None:
    tail = GaitFollower(1, RAMP)
    tail.command(paper(), 0.0)
    tail.command(paper(100.0 * math.pi + 2.0), 3.0)
    levels = tail.levels(np.linspace(3.0, 6.0, 6001), 0.26)[:, 0]
    strokes = np.count_nonzero((levels[1:] != 0.0) & (levels[1:] != levels[:-1]))
    assert strokes <= 2 * 0.9 * 3.0 + 2
