"""The velocity estimate: its gain, delay and noise as stated, and what it does with bad poses."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_servo_driver.pose_checks import Limits, Refusal, heading_of
from fin_servo_driver.velocity_estimate import (
    BANDWIDTH_TIMES_WINDOW,
    Settings,
    Velocity,
    VelocityEstimator,
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
    assert f"{ahead:.3f} s ahead of this computer's clock, largest_lead is 0.05 s: synchronise" in estimator.silent


@pytest.mark.parametrize("ahead", [0.05, 0.0, -0.03, -0.2])
def test_poses_of_now_and_a_little_before_are_used(ahead: float) -> None:
    estimator, velocities = received(ahead)
    assert len(velocities) > 9.5 * RATE
    assert (estimator.refused["from the future"], estimator.silent) == (0, "")


@pytest.mark.parametrize("behind", [0.21, 1.0, 5.0, 37.0, 1.7e9])
def test_poses_of_a_clock_that_is_behind_are_refused_with_the_offset(behind: float) -> None:
    estimator, velocities = received(-behind)
    assert velocities == []
    assert estimator.refused["late"] == len(poses(straight))
    assert f"{behind:.3f} s behind this computer's clock, largest_age is 0.2 s" in estimator.impossible
    assert ("does not count from 1970" if behind > 1e9 else "chrony") in estimator.impossible


def test_a_clock_that_drifts_is_refused_from_the_limit_on() -> None:
    estimator = VelocityEstimator(SETTINGS)
    used = [
        stamp
        for stamp, *pose in poses(lambda t: (0.03 * t, 0.0, 0.0), 10.0)
        if estimator.add(stamp, *pose, now=START + round((stamp - START) * 1.05)) is not None
    ]
    assert 4.0 <= (used[-1] - START) / SECOND <= 5.0  # 0.2 s behind after 4 s, seen within one


def test_poses_that_a_busy_receiver_takes_late_are_used() -> None:
    estimator = VelocityEstimator(SETTINGS)
    period = round(0.7 * SECOND)  # it is away for so long, again and again, then takes all that waits
    found = [estimator.add(s, *pose, now=START + -(-(s - START) // period) * period) for s, *pose in poses(straight)]
    assert len([velocity for velocity in found if velocity is not None]) > 9 * RATE


def test_a_zero_stamp_is_called_that() -> None:
    estimator = VelocityEstimator(SETTINGS)
    for _, *pose in poses(straight):
        assert estimator.add(0, *pose, now=START) is None
    assert {reason: count for reason, count in estimator.refused.items() if count} == {"zero stamp": 500}
    assert "its stamp is 0" in estimator.impossible


def test_stamps_that_do_not_advance_are_told_from_poses_that_came_twice() -> None:
    estimator = VelocityEstimator(SETTINGS)
    for _, *pose in poses(straight):
        assert estimator.add(START, *pose, now=START) is None
    assert estimator.refused["same stamp"] == 499
    assert estimator.refused["twice"] == 0
    assert "another pose came with the same stamp" in estimator.impossible


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
        Limits(**{name: value})


def swum(path: Iterable[Pose], swimming_since: float | None = 0.0) -> tuple[VelocityEstimator, list[float], float]:
    """Let a driven fish be seen; return the estimator, the times of its velocities in s, and their mean forward."""
    estimator = VelocityEstimator(SETTINGS)
    if swimming_since is not None:
        estimator.plant_says(swims=True, since=START + round(swimming_since * SECOND))
    found = [velocity for pose in path if (velocity := estimator.add(*pose, now=pose[0])) is not None]
    times = [(velocity.stamp - START) / SECOND for velocity in found]
    return estimator, times, float(np.mean([velocity.forward for velocity in found])) if found else math.nan


def longest_gap(times: list[float]) -> float:
    return float(np.max(np.diff(times)))


def surging(times: NDArray[np.float64]) -> tuple[object, object, object]:
    return 0.03 * times + 0.0005 * np.sin(11.0 * times), 0.002 * np.sin(5.6 * times), 0.1 * np.sin(5.6 * times)


def frozen(begin: float, end: float) -> list[Pose]:
    path = poses(surging)
    first = next(pose for pose in path if pose[0] >= START + begin * SECOND)
    return [(p[0], *first[1:]) if first[0] <= p[0] < START + end * SECOND else p for p in path]


@pytest.mark.parametrize("swimming_since", [0.0, 2.0, None])
@pytest.mark.parametrize("seconds", [0.5, 3.0])
def test_the_last_pose_of_a_lost_fish_counts_as_none(seconds: float, swimming_since: float | None) -> None:
    estimator, times, mean = swum(frozen(4.0, 4.0 + seconds), swimming_since)
    assert longest_gap(times) > seconds
    assert "equal to the last bit" in estimator.impossible
    assert estimator.refused["equal"] == pytest.approx((seconds - 0.1) * RATE, abs=2)
    assert mean == pytest.approx(0.03, rel=0.01)


def test_a_fish_that_is_lost_before_it_starts_is_not_at_rest_for_long() -> None:
    estimator, times, _ = swum(frozen(0.0, 3.0), 1.0)
    assert longest_gap(times) > 0.5
    assert max(time for time in times if time < 3.0) < 1.5
    assert "equal to the last bit" in estimator.impossible


@pytest.mark.parametrize("longest", [0.06, 0.1])
def test_a_camera_slower_than_its_tracker_is_no_lost_fish(longest: float) -> None:
    path = poses(surging)
    held = [(pose[0], *path[i - i % round(longest * RATE)][1:]) for i, pose in enumerate(path)]
    estimator, times, mean = swum(held)
    assert estimator.refused["equal"] == 0
    assert len(times) > 0.9 * len(path)
    assert mean == pytest.approx(0.03, rel=0.01)


def test_a_tracker_that_rounds_sees_a_fish_at_rest_and_then_its_swim() -> None:
    from_rest = poses(lambda t: (0.02 * np.maximum(t - 3.0, 0.0), 0.0, 0.1 * np.sin(5.6 * np.maximum(t - 3.0, 0.0))))
    rounded = [(s, round(x, 3), round(y, 3), math.radians(round(math.degrees(h)))) for s, x, y, h in from_rest]
    estimator = VelocityEstimator(SETTINGS)
    estimator.plant_says(swims=False, since=START)
    found = []
    for pose in rounded:
        if pose[0] == START + 3 * SECOND:
            assert "equal to the last bit" in estimator.note
            assert estimator.impossible == ""
            estimator.plant_says(swims=True, since=pose[0])
        found.append(estimator.add(*pose, now=pose[0]))
    velocities = [velocity for velocity in found if velocity is not None]
    assert longest_gap([v.stamp / SECOND for v in velocities]) < 0.5
    assert all(v.forward == pytest.approx(0.0, abs=1e-12) for v in velocities if v.stamp < START + 2.8 * SECOND)
    assert np.mean([v.forward for v in velocities if v.stamp > START + 3.2 * SECOND]) == pytest.approx(0.02, rel=0.05)


def changed(begin: float, end: float, change: Callable[[Pose], Pose]) -> list[Pose]:
    return [change(p) if START + begin * SECOND <= p[0] < START + end * SECOND else p for p in poses(surging)]


# What happens, and what is said of it: none of it can be a fish, and none may become a score.
JUMPS = [
    (lambda p: (p[0], p[1], p[2], p[3] + math.pi), r"its heading differs by 1\d\d degrees"),
    (lambda p: (p[0], p[1], p[2], p[3] - 2.0), r"its heading differs by 1\d\d degrees"),
    (lambda p: (p[0], p[1] + 0.3, p[2], p[3]), "0.3.. m from the one"),
    (lambda p: (p[0], p[1], p[2] - 0.1, p[3]), "0.1.. m from the one"),
    (lambda p: (p[0], 0.0, 0.0, 0.0), "m from the one"),
    (lambda p: (p[0], 100.0 * p[1], 100.0 * p[2], p[3]), "m from the one"),
    (lambda p: (p[0], 1e3 * p[1], 1e3 * p[2], p[3]), "largest_position is 50 m|m from the one"),
]


@pytest.mark.parametrize("end", [6.0, 100.0])
@pytest.mark.parametrize(("change", "said"), JUMPS)
def test_a_track_that_jumps_is_named_and_no_score_can_go_over_it(
    change: Callable[[Pose], Pose], said: str, end: float
) -> None:
    path = changed(4.0, end, change)
    estimator, times, _ = swum(path)
    assert longest_gap([*times, path[-1][0] / SECOND - START / SECOND]) > 0.9
    assert not [time for time in times if 4.0 < time < 4.5]
    estimator, *_ = swum(pose for pose in path if pose[0] < START + 4.5 * SECOND)
    assert re.search(said, estimator.impossible)


@pytest.mark.parametrize("missing", [0.08, 0.3, 0.7])
@pytest.mark.parametrize(("change", "said"), JUMPS[:4])
def test_a_jump_behind_a_gap_is_a_jump(change: Callable[[Pose], Pose], said: str, missing: float) -> None:
    path = [p for p in changed(4.0, 100.0, change) if not START + 4 * SECOND <= p[0] < START + (4 + missing) * SECOND]
    estimator, times, _ = swum(path)
    assert longest_gap(times) > 0.9
    estimator, *_ = swum(pose for pose in path if pose[0] < START + 4.9 * SECOND)
    assert re.search(said, estimator.impossible)


def test_another_frame_is_another_track() -> None:
    estimator = VelocityEstimator(SETTINGS)
    for stamp, *pose in poses(straight):
        if START + 4 * SECOND <= stamp < START + 4.5 * SECOND:
            assert estimator.add(stamp, *pose, frame="camera") is None
            assert "its frame is 'camera', that of the poses before was 'tank'" in estimator.impossible
        else:
            estimator.add(stamp, *pose, frame="tank")
    assert estimator.refused["jump"] == 25


@pytest.mark.parametrize("unit", [100.0, 1000.0])
@pytest.mark.parametrize("speed", [0.002, 0.0179, 0.05])
def test_positions_in_centimetres_and_millimetres_give_no_velocity(unit: float, speed: float) -> None:
    random = np.random.default_rng(5)
    noisy = [
        (s, unit * (x + random.normal(0, 3e-4)), unit * (y + random.normal(0, 3e-4)), h)
        for s, x, y, h in poses(lambda t: (0.1 + speed * t, 0.05, 0.1 * np.sin(5.6 * t)), 4.0)
    ]
    estimator, times, _ = swum(noisy)
    assert len(times) < 0.02 * len(noisy)
    assert estimator.impossible


@pytest.mark.parametrize("end", [6.0, 100.0])
@pytest.mark.parametrize("step", [0.025, 0.04, 0.06])
def test_a_jump_that_time_would_make_possible_stays_one(step: float, end: float) -> None:
    path = changed(4.0, end, lambda p: (p[0], p[1] + step, p[2], p[3]))
    estimator, times, _ = swum(path)
    assert longest_gap(times) > 0.9
    assert "m from the one" in estimator.impossible
    turned = changed(4.0, end, lambda p: (p[0], p[1], p[2], p[3] + 1.0))
    assert longest_gap(swum(turned)[1]) > 0.9


@pytest.mark.parametrize("speed", [0.03, 0.4])
def test_single_strays_near_the_fish_silence_nobody(speed: float) -> None:
    path = poses(lambda t: (speed * t + 0.0005 * np.sin(11.0 * t), 0.002 * np.sin(5.6 * t), 0.1 * np.sin(5.6 * t)))
    strays = [(s, x, y + 0.04 * (i % 20 == 10), h) for i, (s, x, y, h) in enumerate(path)]
    estimator, times, mean = swum(strays)
    assert estimator.refused["jump"] > 15
    assert longest_gap(times) < 0.1
    assert mean == pytest.approx(speed, rel=0.01)


@pytest.mark.parametrize(("column", "name"), [(1, "x"), (2, "y"), (3, "heading")])
def test_one_coordinate_that_stands_is_named(column: int, name: str) -> None:
    course = poses(lambda t: (0.02 * t, 0.02 * t + 0.002 * np.sin(5.6 * t), math.pi / 4.0 + 0.1 * np.sin(5.6 * t)))
    held = []
    for i, pose in enumerate(course):
        coordinates = [*pose[1:]]
        if i >= 200:
            coordinates[column - 1] = course[200][column]
        x, y, heading = coordinates
        held.append((pose[0], x, y, heading))
    estimator, times, _ = swum(held)
    assert f"{name} has been equal to the last bit for" in estimator.impossible
    assert max(times) < 5.1
    estimator, *_ = swum(held, None)
    assert not estimator.refused["equal"]  # of a fish that nobody drives no more is known


@pytest.mark.parametrize("jitter", [0.0, 2e-4])
@pytest.mark.parametrize("speed", [0.005, 0.03])
def test_a_straight_line_through_an_occlusion_is_no_swim(speed: float, jitter: float) -> None:
    random = np.random.default_rng(2)
    course = poses(lambda t: (speed * t, 0.002 * np.sin(5.6 * t), 0.1 * np.sin(5.6 * t)))
    noisy = [(s, x + random.normal(0, 3e-4), y + random.normal(0, 3e-4), h) for s, x, y, h in course]
    lost, late = noisy[200], random.uniform(0.0, jitter, len(noisy))
    predicted = [
        (s, lost[1] + speed * ((s - lost[0]) / SECOND + late[i]), lost[2], lost[3]) if 200 <= i < 350 else (s, x, y, h)
        for i, (s, x, y, h) in enumerate(noisy)
    ]
    estimator, times, _ = swum(predicted)
    assert longest_gap(times) > 2.0
    estimator, *_ = swum(predicted[:300])
    assert "on a straight line" in estimator.impossible
    estimator, times, mean = swum(noisy)
    assert not estimator.impossible
    assert mean == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize(("step", "speed"), [(0.005, 0.018), (0.01, 0.018), (0.005, 0.2), (0.003, 0.01)])
def test_positions_in_steps_that_no_line_can_be_seen_in_are_refused(step: float, speed: float) -> None:
    course = poses(lambda t: (speed * t, 0.002 * np.sin(5.6 * t), 0.1 * np.sin(5.6 * t)))
    estimator, times, _ = swum((s, round(x / step) * step, round(y / step) * step, h) for s, x, y, h in course)
    assert longest_gap([0.0, *times, 10.0]) > 0.9
    assert estimator.refused["coarse"] + estimator.refused["equal"] > 100


def test_pictures_that_come_twice_of_a_fast_fish_are_not_coarse() -> None:
    random = np.random.default_rng(3)
    course = poses(
        lambda t: (0.1 * t + random.normal(0.0, 3e-4, t.shape), 0.002 * np.sin(25.0 * t), np.sin(9.0 * t) / 9)
    )
    estimator, times, mean = swum((s, *course[i - i % 2][1:]) for i, (s, *_) in enumerate(course))
    assert longest_gap(times) < 0.1
    assert mean == pytest.approx(0.1, rel=0.01)
    assert estimator.impossible == ""


@pytest.mark.parametrize("off", [0.5, -0.6, 0.9])
def test_a_fish_that_goes_straight_on_beside_its_heading_is_not_believed(off: float) -> None:
    course = poses(surging)
    estimator, times, _ = swum((s, x, y, h + off) for s, x, y, h in course)
    assert max(times) < 5.0
    assert "it does not turn" in estimator.impossible or "for 2 s" in estimator.impossible
    circle = poses(lambda t: (0.2 * np.sin(0.15 * t), 0.2 * (1.0 - np.cos(0.15 * t)), 0.15 * t + 0.5))
    assert longest_gap(swum(circle)[1]) < 0.1  # a turning fish slips


MIRRORED = {
    "y the other way round": (lambda x, y, h: (x, -y, h)),
    "heading the other way round": (lambda x, y, h: (x, y, -h)),
    "head and tail swapped from the start": (lambda x, y, h: (x, y, h + math.pi)),
    "heading turned by a right angle": (lambda x, y, h: (x, y, h + math.pi / 2.0)),
}


@pytest.mark.parametrize("heading", [1.0, -2.3, 2.5])
@pytest.mark.parametrize("mirror", MIRRORED.values(), ids=MIRRORED.keys())
def test_a_fish_that_swims_sideways_or_backwards_is_not_believed(
    mirror: Callable[[float, float, float], tuple[float, float, float]], heading: float
) -> None:
    cosine, sine = math.cos(heading), math.sin(heading)
    straight_on = poses(surging, 5.0)
    course: list[Pose] = [(s, x * cosine - y * sine, x * sine + y * cosine, h + heading) for s, x, y, h in straight_on]
    estimator, times, _ = swum((s, *mirror(x, y, h)) for s, x, y, h in course)
    assert max(times) < 3.0
    assert "for 2 s the fish has moved at 0.0" in estimator.impossible
    estimator, times, mean = swum(course)
    assert mean == pytest.approx(0.03, rel=0.01)
    assert estimator.impossible == ""


@pytest.mark.parametrize("arrival", ["stall", "batch", "uniform"])
def test_stamps_of_the_arrival_over_a_bursty_network_do_not_change_the_mean(arrival: str) -> None:
    random = np.random.default_rng(1)
    taken = np.arange(0.0, 30.0, 0.01)
    x = 0.03 * taken + 0.0005 * np.sin(11.3 * taken) + random.normal(0, 2e-4, taken.size)
    if arrival == "batch":
        come = (np.floor(taken / 0.05) + 1) * 0.05
    elif arrival == "uniform":
        come = taken + random.uniform(0.0, 0.06, taken.size)
    else:
        stalls = np.sort(random.uniform(0.0, 30.0, 90))
        come = taken.copy()
        for stall in stalls:
            come[(taken > stall) & (taken < stall + 0.06)] = stall + 0.06
    come = np.maximum.accumulate(come + 3e-6 * np.arange(come.size))
    path = [(START + round(c * SECOND), float(p), 0.0, 0.0) for c, p in zip(come, x, strict=True)]
    found = estimate(path)
    stamps = np.array([(v.stamp - START) / SECOND for v in found])
    mean = np.trapezoid([v.forward for v in found], stamps) / (stamps[-1] - stamps[0])
    assert mean == pytest.approx(0.03, rel=0.005)


any_number = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(st.integers(0, 2 * SECOND), any_number, any_number, any_number), max_size=60))
def test_no_input_gives_an_exception_or_a_number_that_is_not_finite(given_poses: list[Pose]) -> None:
    with np.errstate(all="ignore"):
        for velocity in estimate(given_poses):
            assert all(map(math.isfinite, (velocity.forward, velocity.left, velocity.yaw_rate)))


@pytest.mark.parametrize("heading", np.linspace(-3.1, 3.1, 13))
@pytest.mark.parametrize("sign", [1.0, -1.0, 1.004])
def test_a_heading_comes_back_from_a_quaternion(heading: float, sign: float) -> None:
    quaternion = (0.0, 0.0, sign * math.sin(heading / 2), sign * math.cos(heading / 2))
    assert heading_of(quaternion, Limits()) == pytest.approx(heading, abs=1e-12)


@pytest.mark.parametrize(
    ("quaternion", "said"),
    [
        ((0.0, 0.0, 0.0, 0.0), "norm 0, which must be 1: it was never filled in"),
        ((math.nan, 0.0, 0.0, 1.0), "its orientation is (nan"),
        ((math.inf, 0.0, 0.0, 1.0), "its orientation is (inf"),
        ((0.0, 0.0, 0.3, 0.0), "norm 0.3"),
        ((0.0, 0.0, 0.3, 1.0), "norm 1.04"),
        ((0.0, 0.0, 90.0, 0.0), "norm 90"),
        ((0.0, math.sin(0.6), 0.0, math.cos(0.6)), "tilted out of the plane by 69 degrees"),
        ((math.sin(0.2), 0.0, 0.0, math.cos(0.2)), "tilted out of the plane by 23 degrees"),
        ((1.0, 0.0, 0.0, 0.0), "tilted out of the plane by 180 degrees"),
    ],
)
def test_a_quaternion_of_no_fish_in_the_plane_tells_no_heading(
    quaternion: tuple[float, float, float, float], said: str
) -> None:
    refusal = heading_of(quaternion, Limits())
    assert isinstance(refusal, Refusal)
    assert said in refusal.text


@pytest.mark.parametrize("window", [0.0, -1.0, math.nan, 100.0])
def test_a_window_that_cannot_be_is_refused(window: float) -> None:
    with pytest.raises(ValueError, match="window"):
        Settings(window=window)
