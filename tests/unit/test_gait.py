"""Gaits are validated once, and a tail follows any sequence of them without a jump."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fin_plant.gait import PAPER_GAIT, Gait, GaitFollower, JointDrive

RAMP = 0.5

drives = st.builds(
    JointDrive,
    amplitude=st.floats(0.0, 1.0),
    frequency=st.floats(0.0, 5.0),
    phase=st.floats(-3.0, 3.0),
    bias=st.floats(-0.5, 0.5),
)


def ramp(t: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.clip(t / RAMP, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


@given(drives)
def test_from_neutral_the_drive_is_the_ramped_sinusoid(drive: JointDrive) -> None:
    follower = GaitFollower(1, RAMP)
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
    with pytest.raises(ValueError, match="2 rows, the tail has 1 driven joints"):
        GaitFollower(1, RAMP).command(Gait((JointDrive(0.1, 1.0),) * 2), 0.0)


@given(drives, st.floats(0.0, 1.5), st.floats(0.01, 5.0))
def test_a_limited_drive_stays_within_the_sweep_and_keeps_its_bias_first(
    drive: JointDrive, sweep: float, frequency: float
) -> None:
    limited = drive.limited(sweep, frequency)
    assert abs(limited.bias) + limited.amplitude <= sweep * (1 + 1e-12)
    assert limited.frequency <= frequency
    if abs(drive.bias) + drive.amplitude <= sweep and drive.frequency <= frequency:
        assert Gait((limited,)).rows() == pytest.approx(Gait((drive,)).rows(), abs=1e-12)


@pytest.mark.parametrize("column", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e6])
def test_a_value_that_cannot_be_is_refused_with_joint_and_column(column: int, value: float) -> None:
    row = [0.1, 1.0, 0.0, 0.0]
    row[column] = value
    with pytest.raises(ValueError, match=r"joint 2: gait (amplitude|frequency|phase|bias) = "):
        Gait.from_rows([[0.1, 1.0, 0.0, 0.0], row])


@pytest.mark.parametrize("rows", [[], [[0.1, 1.0]], [0.1, 1.0, 0.0, 0.0]])
def test_rows_of_another_shape_are_refused(rows: object) -> None:
    with pytest.raises(ValueError, match=r"gait has shape|driven joints"):
        Gait.from_rows(rows)  # type: ignore[arg-type]
