"""The velocity estimate: its gain, delay and noise as stated, and what it does with bad poses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_servo_driver.velocity_estimate import (
    BANDWIDTH_TIMES_WINDOW,
    Settings,
    Velocity,
    VelocityEstimator,
    heading_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

START = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
RATE = 50.0
SETTINGS = Settings()
Pose = tuple[int, float, float, float]
Path = "Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], ...]]"


def poses(path: Callable[[NDArray[np.float64]], tuple[object, object, object]], seconds: float = 10.0) -> list[Pose]:
    times = np.arange(0.0, seconds, 1.0 / RATE)
    x, y, heading = (np.broadcast_to(np.asarray(part, dtype=float), times.shape) for part in path(times))
    stamps = START + np.round(times * SECOND).astype(np.int64)
    return [(int(s), float(a), float(b), float(c)) for s, a, b, c in zip(stamps, x, y, heading, strict=True)]


def estimate(given_poses: Iterable[Pose], settings: Settings = SETTINGS) -> list[Velocity]:
    estimator = VelocityEstimator(settings)
    found = [estimator.add(*pose) for pose in given_poses]
    return [velocity for velocity in found if velocity is not None]


def straight(times: NDArray[np.float64]) -> tuple[object, object, object]:
    return 0.03 * times, 0.01 * times, 0.0


def test_a_straight_swim_is_measured_exactly() -> None:
    result = estimate(poses(straight))
    assert len(result) > 9.5 * RATE
    for velocity in result:
        assert velocity.forward == pytest.approx(0.03, abs=1e-9)
        assert velocity.left == pytest.approx(0.01, abs=1e-9)
        assert velocity.yaw_rate == pytest.approx(0.0, abs=1e-9)


def test_velocities_are_in_the_fishs_own_frame() -> None:
    turned = math.radians(120.0)
    result = estimate(poses(lambda t: (0.05 * math.cos(turned) * t, 0.05 * math.sin(turned) * t, turned)))
    assert result[-1].forward == pytest.approx(0.05, abs=1e-9)
    assert result[-1].left == pytest.approx(0.0, abs=1e-9)


def test_a_circle_through_all_headings_has_a_steady_rate() -> None:
    rate, radius = 1.0, 0.2
    result = estimate(poses(lambda t: (radius * np.sin(rate * t), -radius * np.cos(rate * t), rate * t), 20.0))
    wrapped = [
        (s, x, y, math.remainder(h, 2 * math.pi))
        for s, x, y, h in poses(lambda t: (radius * np.sin(rate * t), -radius * np.cos(rate * t), rate * t), 20.0)
    ]
    for velocity in (*result, *estimate(wrapped)):
        assert velocity.yaw_rate == pytest.approx(rate, abs=1e-6)
        assert velocity.forward == pytest.approx(rate * radius, rel=0.003)  # 1 - x^2 / 10 of the gain, x = W / 2
        assert abs(velocity.left) < 1e-6


def gain(frequency: float, window: float) -> float:
    x = math.pi * frequency * window
    return 3.0 * (math.sin(x) - x * math.cos(x)) / x**3


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0, 3.0, 5.0])
def test_an_oscillation_is_passed_in_time_and_with_the_stated_gain(frequency: float) -> None:
    speed, omega = 0.02, 2.0 * math.pi * frequency
    result = estimate(poses(lambda t: (0.03 * t + speed / omega * np.sin(omega * t), 0.0, 0.0)))
    times = np.array([(velocity.stamp - START) / SECOND for velocity in result])
    forward = np.array([velocity.forward for velocity in result]) - 0.03
    basis = np.stack((np.cos(omega * times), np.sin(omega * times)), axis=1)
    (in_time, behind), *_ = np.linalg.lstsq(basis, forward, rcond=None)
    assert in_time / speed == pytest.approx(gain(frequency, SETTINGS.window), abs=0.05)  # the formula is for many poses
    assert abs(behind / speed) < 0.01


def test_the_stated_bandwidth_halves_the_power() -> None:
    assert gain(BANDWIDTH_TIMES_WINDOW, 1.0) == pytest.approx(math.sqrt(0.5), abs=1e-3)
    assert SETTINGS.bandwidth == pytest.approx(2.31, abs=0.01)


def test_the_stated_delay_is_that_of_the_newest_pose() -> None:
    estimator = VelocityEstimator(SETTINGS)
    for pose in poses(straight):
        velocity = estimator.add(*pose)
        if velocity is not None and pose[0] > START + 0.3 * SECOND:  # the window is full
            assert (pose[0] - velocity.stamp) / SECOND == pytest.approx(SETTINGS.delay, abs=0.5 / RATE)


def test_the_mean_speed_of_a_noisy_swim_is_right() -> None:
    random = np.random.default_rng(7)
    noisy = [
        (s, x + random.normal(0, 3e-4), y + random.normal(0, 3e-4), h + random.normal(0, 0.01))
        for s, x, y, h in poses(lambda t: (0.03 * t, 0.0, 0.0), 20.0)
    ]
    forward = [velocity.forward for velocity in estimate(noisy)]
    assert np.mean(forward) == pytest.approx(0.03, abs=1e-4)
    assert np.std(forward) < 3e-3


def test_dropouts_of_single_pictures_are_bridged() -> None:
    random = np.random.default_rng(1)
    kept = [pose for pose in poses(straight, 20.0) if random.random() > 0.2]
    result = estimate(kept)
    assert len(result) > 0.7 * len(kept)
    assert all(abs(velocity.forward - 0.03) < 1e-9 for velocity in result)


def test_nothing_is_reported_while_poses_are_missing() -> None:
    gap = [pose for pose in poses(straight) if not 4.0 <= (pose[0] - START) / SECOND < 5.0]
    stamps = [(velocity.stamp - START) / SECOND for velocity in estimate(gap)]
    assert not [stamp for stamp in stamps if 4.0 < stamp < 5.0]
    assert [stamp for stamp in stamps if stamp > 5.0]


def test_duplicates_change_nothing() -> None:
    once = poses(straight)
    twice = [pose for pose in once for _ in range(2)]
    assert estimate(twice) == estimate(once)


def test_poses_out_of_order_are_put_in_their_place() -> None:
    random = np.random.default_rng(2)
    path = poses(lambda t: (0.03 * t + 0.001 * np.sin(6 * t), 0.0, 0.1 * np.sin(5 * t)))
    shuffled = [path[i] for i in np.argsort(np.arange(len(path)) + random.uniform(-1.6, 1.6, len(path)))]
    truth = {velocity.stamp: velocity for velocity in estimate(path)}
    result = estimate(shuffled)
    stamps = [velocity.stamp for velocity in result]
    assert stamps == sorted(set(stamps))
    assert len(result) > 0.4 * len(path)
    for velocity in result:
        if velocity.stamp in truth:
            assert velocity.forward == pytest.approx(truth[velocity.stamp].forward, abs=1e-6)


def test_outliers_are_set_aside() -> None:
    random = np.random.default_rng(3)
    bad = [
        (s, x + random.choice([-1, 1]) * random.uniform(0.02, 1.0), y, h) if random.random() < 0.05 else (s, x, y, h)
        for s, x, y, h in poses(straight, 20.0)
    ]
    result = estimate(bad)
    assert len(result) > 0.9 * len(bad)
    assert max(abs(velocity.forward - 0.03) for velocity in result) < 1e-6


def test_a_fish_that_is_carried_away_is_reported_again_once_it_swims() -> None:
    moved = [(s, x + (1.0 if s > START + 5 * SECOND else 0.0), y, h) for s, x, y, h in poses(straight)]
    result = estimate(moved)
    assert all(abs(velocity.forward - 0.03) < 1e-6 for velocity in result)
    assert result[-1].stamp > START + 9 * SECOND


def test_poses_that_do_not_fit_together_give_no_velocity() -> None:
    random = np.random.default_rng(4)
    noise = [(s, float(random.uniform(-1, 1)), float(random.uniform(-1, 1)), h) for s, _, _, h in poses(straight)]
    assert len(estimate(noise)) < 0.3 * len(noise)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_not_finite_is_skipped(value: float) -> None:
    path = poses(straight)
    for index in range(10, len(path), 17):
        stamp, x, y, heading = path[index]
        path[index] = [(stamp, value, y, heading), (stamp, x, value, heading), (stamp, x, y, value)][index % 3]
    result = estimate(path)
    assert len(result) > 0.8 * len(path)
    assert all(abs(velocity.forward - 0.03) < 1e-9 for velocity in result)


def test_a_clock_that_is_set_back_starts_anew() -> None:
    path = poses(straight)
    back = [(s - 3600 * SECOND, x, y, h) for s, x, y, h in path]
    estimator = VelocityEstimator(SETTINGS)
    first = [velocity for pose in path if (velocity := estimator.add(*pose)) is not None]
    second = [velocity for pose in back if (velocity := estimator.add(*pose)) is not None]
    assert len(second) > 0.9 * len(first)
    assert estimator.refused["too old"] == 9


def test_one_stamp_from_the_future_does_not_silence_it_for_ever() -> None:
    path = poses(straight)
    path[100] = (path[100][0] + 3600 * SECOND, *path[100][1:])
    assert len(estimate(path)) > 0.9 * len(path)


def received(ahead: float, settings: Settings = SETTINGS) -> tuple[VelocityEstimator, list[Velocity]]:
    """Let poses arrive whose stamps are so many seconds ahead of the receiver's clock."""
    estimator = VelocityEstimator(settings)
    found = [estimator.add(*pose, now=pose[0] - round(ahead * SECOND)) for pose in poses(straight)]
    return estimator, [velocity for velocity in found if velocity is not None]


@pytest.mark.parametrize("ahead", [0.0501, 1.0, 3600.0])
def test_poses_from_the_receivers_future_are_refused_and_counted(ahead: float) -> None:
    estimator, velocities = received(ahead)
    assert velocities == []
    assert estimator.refused["from the future"] == len(poses(straight))
    assert f"{ahead:.3f} s ahead of this computer's clock, allowed are 0.05 s: synchronise" in estimator.silent


@pytest.mark.parametrize("ahead", [0.05, 0.0, -0.03, -3600.0])
def test_poses_of_now_and_before_are_used(ahead: float) -> None:
    estimator, velocities = received(ahead)
    assert len(velocities) > 9.5 * RATE
    assert (estimator.refused["from the future"], estimator.silent) == (0, "")


@pytest.mark.parametrize(("ahead", "late"), [(-0.19, 0), (-0.21, 500), (-1.0, 500), (0.0, 0)])
def test_poses_that_come_late_are_counted(ahead: float, late: int) -> None:
    estimator, velocities = received(ahead)
    assert velocities
    assert estimator.late == late
    assert estimator.age == pytest.approx(-ahead)


def test_one_pose_from_the_future_among_good_ones_changes_nothing_else() -> None:
    estimator = VelocityEstimator(SETTINGS)
    found = []
    for index, pose in enumerate(poses(straight)):
        if index == 100:
            estimator.add(pose[0] + 3600 * SECOND, *pose[1:], now=pose[0])
        found.append(estimator.add(*pose, now=pose[0]))
    assert [velocity for velocity in found if velocity is not None] == estimate(poses(straight))


@pytest.mark.parametrize(("name", "value"), [("largest_lead", -0.1), ("largest_lead", 2.0), ("largest_age", 0.0)])
def test_a_bound_on_the_clocks_that_cannot_be_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Settings(**{name: value})


def test_a_fish_at_rest_has_velocity_zero() -> None:
    for velocity in estimate(poses(lambda _: (0.1, 0.2, 0.3))):
        assert velocity.forward == pytest.approx(0.0, abs=1e-12)


any_number = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(st.integers(0, 2 * SECOND), any_number, any_number, any_number), max_size=60))
def test_no_input_gives_an_exception_or_a_number_that_is_not_finite(given_poses: list[Pose]) -> None:
    with np.errstate(all="ignore"):
        for velocity in estimate(given_poses):
            assert all(map(math.isfinite, (velocity.forward, velocity.left, velocity.yaw_rate)))


@pytest.mark.parametrize("heading", np.linspace(-3.1, 3.1, 13))
@pytest.mark.parametrize("norm", [1.0, 0.5, 7.0])
def test_a_heading_comes_back_from_a_quaternion_of_any_length(heading: float, norm: float) -> None:
    quaternion = (0.0, 0.0, norm * math.sin(heading / 2), norm * math.cos(heading / 2))
    assert heading_of(*quaternion) == pytest.approx(heading, abs=1e-12)


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)])
def test_a_quaternion_without_length_has_no_heading(quaternion: tuple[float, float, float, float]) -> None:
    assert math.isnan(heading_of(*quaternion))


@pytest.mark.parametrize("window", [0.0, -1.0, math.nan, 100.0])
def test_a_window_that_cannot_be_is_refused(window: float) -> None:
    with pytest.raises(ValueError, match="window"):
        Settings(window=window)
