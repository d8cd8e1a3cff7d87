"""The limits on every set-point and the command watchdog, densely around their edges."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_servo_driver.robot_file import ServoJoint
from fin_servo_driver.safety import CommandWatchdog, SetPointLimiter, within_angle, within_rate

JOINT = ServoJoint(
    channel=9, centre=1500, direction=-1, units_per_radian=1000, lowest=1300, highest=1800, sweep=0.4, rate=2.0
)
PERIOD = 0.02
TOLERANCE = 1e-12  # rounding of a few operations on numbers of the order of 1
NOT_FINITE = (math.nan, math.inf, -math.inf)


def limiter(joint: ServoJoint = JOINT) -> SetPointLimiter:
    return SetPointLimiter(joint, longest_elapsed=2 * PERIOD)


def moved_to(angle: float, joint: ServoJoint = JOINT) -> SetPointLimiter:
    result = limiter(joint)
    result.restart(angle)
    return result


@pytest.mark.parametrize("angle", NOT_FINITE)
def test_an_angle_that_is_not_finite_means_neutral(angle: float) -> None:
    assert within_angle(angle, 0.4) == 0.0
    assert moved_to(0.01).limit(angle, PERIOD).angle == 0.0


def test_an_angle_is_kept_inside_the_sweep_and_not_changed_inside() -> None:
    assert within_angle(0.4, 0.4) == 0.4
    assert within_angle(-0.4, 0.4) == -0.4
    assert within_angle(math.nextafter(0.4, 1.0), 0.4) == 0.4
    assert within_angle(math.nextafter(-0.4, -1.0), 0.4) == -0.4
    assert within_angle(0.1, 0.4) == 0.1
    assert within_angle(-0.1, 0.4) == -0.1
    assert within_angle(1e300, 0.4) == 0.4


def test_the_rate_bounds_a_step_by_the_time_that_has_passed() -> None:
    assert within_rate(1.0, 0.0, 2.0, 0.01, 0.04) == pytest.approx(0.02, abs=TOLERANCE)
    assert within_rate(-1.0, 0.0, 2.0, 0.01, 0.04) == pytest.approx(-0.02, abs=TOLERANCE)
    assert within_rate(1.0, 0.5, 2.0, 0.01, 0.04) == pytest.approx(0.52, abs=TOLERANCE)
    assert within_rate(-1.0, 0.5, 2.0, 0.01, 0.04) == pytest.approx(0.48, abs=TOLERANCE)
    assert within_rate(0.505, 0.5, 2.0, 0.01, 0.04) == 0.505


def test_a_long_pause_does_not_allow_a_jump() -> None:
    assert within_rate(1.0, 0.0, 2.0, 10.0, 0.04) == pytest.approx(0.08, abs=TOLERANCE)
    assert within_rate(1.0, 0.0, 2.0, 0.03, 0.04) == pytest.approx(0.06, abs=TOLERANCE)
    assert moved_to(0.0).limit(0.3, 100.0).angle == pytest.approx(2 * PERIOD * JOINT.rate, abs=TOLERANCE)


@pytest.mark.parametrize("elapsed", [0.0, -0.01, -1e9, *NOT_FINITE])
def test_no_time_allows_no_motion(elapsed: float) -> None:
    assert within_rate(1.0, 0.25, 2.0, elapsed, 0.04) == 0.25
    assert moved_to(0.25).limit(-0.3, elapsed).angle == 0.25


def test_the_smallest_time_allows_motion() -> None:
    assert within_rate(1.0, 0.0, 2.0, 1e-6, 0.04) == pytest.approx(2e-6, rel=1e-12)


def test_a_set_point_is_centre_minus_direction_times_scale_times_angle() -> None:
    assert moved_to(0.1).limit(0.1, PERIOD).position == 1600.0
    assert moved_to(-0.1).limit(-0.1, PERIOD).position == 1400.0
    reversed_joint = replace(JOINT, direction=1)
    assert moved_to(0.1, reversed_joint).limit(0.1, PERIOD).position == 1400.0
    other = replace(JOINT, centre=1450, units_per_radian=500)
    assert moved_to(0.2, other).limit(0.2, PERIOD).position == 1550.0


def test_the_range_of_the_servo_holds_and_the_angle_tells_the_truth() -> None:
    low = moved_to(-0.3).limit(-0.3, PERIOD)
    assert (low.position, low.limited) == (1300.0, True)
    assert low.angle == pytest.approx(-0.2, abs=TOLERANCE)
    high = moved_to(0.39).limit(0.39, PERIOD)
    assert (high.position, high.limited) == (1800.0, True)
    assert high.angle == pytest.approx(0.3, abs=TOLERANCE)
    mirrored = moved_to(0.39, replace(JOINT, direction=1)).limit(0.39, PERIOD)
    assert mirrored.position == 1300.0
    assert mirrored.angle == pytest.approx(0.2, abs=TOLERANCE)
    scaled = moved_to(0.39, replace(JOINT, units_per_radian=2000)).limit(0.39, PERIOD)
    assert scaled.position == 1800.0
    assert scaled.angle == pytest.approx(0.15, abs=TOLERANCE)


def test_a_set_point_at_the_very_edge_of_the_range_is_not_limited() -> None:
    joint = replace(JOINT, sweep=0.5)
    assert moved_to(-0.2, joint).limit(-0.2, PERIOD).limited is False
    assert moved_to(-0.2, joint).limit(-0.2, PERIOD).position == 1300.0


def test_what_a_limit_has_changed_is_said() -> None:
    assert moved_to(0.1).limit(0.1, PERIOD).limited is False
    assert moved_to(0.4).limit(0.5, PERIOD).limited is True
    assert moved_to(0.0).limit(0.3, PERIOD).limited is True
    assert moved_to(0.0).limit(math.nan, PERIOD).limited is True


def test_the_rate_counts_from_the_last_set_point_not_from_the_last_wish() -> None:
    subject = limiter()
    first, second = subject.limit(0.3, PERIOD), subject.limit(0.3, PERIOD)
    assert first.angle == pytest.approx(0.04, abs=TOLERANCE)
    assert second.angle == pytest.approx(0.08, abs=TOLERANCE)


def test_after_the_range_has_limited_the_rate_counts_from_there() -> None:
    subject = moved_to(-0.3)
    subject.limit(-0.3, PERIOD)
    assert subject.limit(0.0, PERIOD).angle == pytest.approx(-0.16, abs=TOLERANCE)


def test_a_restart_begins_where_the_tail_stands_or_at_neutral() -> None:
    assert limiter().limit(0.04, PERIOD).angle == pytest.approx(0.04, abs=TOLERANCE)
    assert moved_to(0.2).limit(0.24, PERIOD).angle == pytest.approx(0.24, abs=TOLERANCE)
    for angle in NOT_FINITE:
        assert moved_to(angle).limit(0.3, PERIOD).angle == pytest.approx(0.04, abs=TOLERANCE)


def test_a_start_beyond_the_sweep_comes_back_at_the_joints_rate_or_faster() -> None:
    """A servo found beyond its limits is led back inside; the range of its pulses holds from the first set-point on."""
    subject = moved_to(1.0)
    assert subject.limit(0.0, PERIOD).position <= JOINT.highest


any_float = st.floats(allow_nan=True, allow_infinity=True, allow_subnormal=True, width=64)


@given(st.lists(st.tuples(any_float, any_float), min_size=1, max_size=40), st.sampled_from([1, -1]))
def test_no_input_gets_past_a_limit(inputs: list[tuple[float, float]], direction: int) -> None:
    joint = replace(JOINT, direction=direction)
    subject = limiter(joint)
    last = 0.0
    for angle, elapsed in inputs:
        result = subject.limit(angle, elapsed)
        assert joint.lowest <= result.position <= joint.highest
        assert abs(result.angle) <= joint.sweep
        assert abs(result.angle - last) <= joint.rate * 2 * PERIOD + TOLERANCE
        last = result.angle


def test_a_dense_grid_around_every_edge_stays_inside() -> None:
    edges = [0.0, *(sign * value for sign in (1, -1) for value in (0.2, 0.3, 0.4, 5e-324, 1e308))]
    near = [math.nextafter(edge, way) for edge in edges for way in (-math.inf, math.inf)]
    angles = [*edges, *near, *np.linspace(-0.5, 0.5, 101), *NOT_FINITE]
    for start, angle in itertools.product(angles, angles):
        result = moved_to(within_angle(start, JOINT.sweep)).limit(angle, PERIOD)
        assert JOINT.lowest <= result.position <= JOINT.highest
        assert abs(result.angle) <= JOINT.sweep


# -- the command watchdog --------------------------------------------------------------------------------------------


def test_nobody_has_commanded_anything_at_the_start() -> None:
    assert CommandWatchdog().expired(0.0, 0.5)
    assert CommandWatchdog().expired(0.0, None)


def test_a_command_lasts_as_long_as_the_timeout() -> None:
    watchdog = CommandWatchdog()
    watchdog.feed(10.0)
    assert not watchdog.expired(10.0, 0.5)
    assert not watchdog.expired(10.5, 0.5)
    assert watchdog.expired(math.nextafter(10.5, 11.0), 0.5)


def test_an_expired_watchdog_stays_so_until_the_next_command() -> None:
    watchdog = CommandWatchdog()
    watchdog.feed(10.0)
    assert watchdog.expired(11.0, 0.5)
    assert watchdog.expired(10.1, 0.5)
    assert watchdog.expired(10.1, None)
    watchdog.feed(11.0)
    assert not watchdog.expired(11.1, 0.5)


def test_a_command_can_be_forgotten() -> None:
    watchdog = CommandWatchdog()
    watchdog.feed(10.0)
    watchdog.forget()
    assert watchdog.expired(10.0, 0.5)


@pytest.mark.parametrize("value", NOT_FINITE)
def test_a_time_that_is_not_finite_counts_as_no_command(value: float) -> None:
    for now, timeout in ((10.0, 0.5), (0.1, 0.5), (10.0, None)):
        watchdog = CommandWatchdog()
        watchdog.feed(10.0)
        watchdog.feed(value)
        assert watchdog.expired(now, timeout)


def test_nan_anywhere_counts_as_expired() -> None:
    for now, timeout in ((math.nan, 0.5), (10.0, math.nan)):
        watchdog = CommandWatchdog()
        watchdog.feed(10.0)
        assert watchdog.expired(now, timeout)


def test_without_a_timeout_a_command_lasts_for_ever() -> None:
    watchdog = CommandWatchdog()
    watchdog.feed(10.0)
    assert not watchdog.expired(1e9, None)
