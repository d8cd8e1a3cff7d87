"""The score exactly at its limits: the last sample that counts, the last value that is allowed, and known numbers."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

from fin_optimizer.score.mean_speed import (
    FASTEST,
    Measurement,
    MissingMeasurementError,
    NotThisSwimError,
    ScoreError,
    Window,
    check_swim,
    mean_power,
    recent_speed,
    score,
)
from support.processes import ROOT

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
ONE_SECOND = Window(START, START + SECOND)
TENTHS = np.arange(11) / 10


def at(*times: float) -> np.ndarray:
    """Return the stamps of times in s after the window's start."""
    return START + np.array([round(time * SECOND) for time in times], dtype=np.int64)


DAY = 86_400.0


@pytest.mark.parametrize(
    ("name", "least", "most", "unit"),
    [
        ("settle", 0.0, DAY, "s"),
        ("duration", 5e-324, DAY, "s"),
        ("block", 5e-324, DAY, "s"),
        ("largest_speed", 5e-324, FASTEST, "m/s"),
        ("largest_start_speed", 0.0, FASTEST, "m/s"),
    ],
)
def test_a_measurements_values_reach_from_limit_to_limit(name: str, least: float, most: float, unit: str) -> None:
    for value in (least, most):
        assert getattr(Measurement(**{name: value}), name) == value
    for value in (-1.0, math.nextafter(least, -1.0), math.nextafter(most, 1e9)):
        with pytest.raises(ValueError, match=rf"^{name} = .* {unit} is outside the allowed range .* {unit}$"):
            Measurement(**{name: value})


def test_a_bag_that_is_older_than_the_limits_gets_those_of_its_time() -> None:
    told = {"measurement.settle_s": "1", "measurement.duration_s": "2", "measurement.block_s": "0.5"}
    assert Measurement.from_metadata(told) == Measurement(1.0, 2.0, 0.5, largest_speed=30.0, largest_start_speed=0.005)
    for key in told:
        with pytest.raises(MissingMeasurementError, match=f"lack {key}: "):
            Measurement.from_metadata({other: value for other, value in told.items() if other != key})


def test_a_start_at_the_largest_start_speed_is_one_at_rest() -> None:
    assert Measurement(largest_start_speed=0.25).no_rest(-0.25) == ""
    assert Measurement(largest_start_speed=0.25).no_rest(0.26).startswith("the fish drifts at 26 cm/s")


def test_as_many_samples_as_needed_are_enough() -> None:
    enough = np.delete(TENTHS, 5)  # ten in a second
    assert score(at(*enough), enough, ONE_SECOND).samples == 10
    with pytest.raises(ScoreError, match=r"needed are at least 10 \(10 a second\)$"):
        score(at(*enough[1:]), enough[1:], ONE_SECOND)
    with pytest.raises(ScoreError, match=r"holds 1 of 1 velocity samples: needed are at least 2 "):
        score(at(0.01), np.ones(1), Window(START, START + SECOND // 20))


@pytest.mark.parametrize(
    ("times", "place"),
    [
        ((-0.2, -0.1, 0.0), ""),
        ((-0.2, -0.1), "; the last one lies 0.1 s before the window"),
        ((1.0, 1.1), ""),
        ((1.1, 1.2), "; the first one lies 0.1 s behind the window"),
        ((-0.1, 1.1), ""),
        ((), ""),
    ],
)
def test_samples_that_all_lie_beside_the_window_are_told_with_their_distance(
    times: tuple[float, ...], place: str
) -> None:
    with pytest.raises(ScoreError) as caught:
        score(at(*times), np.ones(len(times)), ONE_SECOND)
    assert caught.value.reason.endswith("needed are at least 10 (10 a second)" + place)


def test_the_largest_speed_itself_is_believed() -> None:
    assert score(at(*TENTHS), np.full(11, 0.5), ONE_SECOND, largest_speed=0.5).value == 0.5
    with pytest.raises(ScoreError, match=r"forward speed is 0\.5 m/s 0 s into the window, and 11 of 11"):
        score(at(*TENTHS), np.full(11, 0.5), ONE_SECOND, largest_speed=0.499)


@pytest.mark.parametrize("mean", ["speed", "power"])
@pytest.mark.parametrize(("before", "behind", "expected"), [(0.5, 0.5, 0.5), (0.6, 0.5, 0.50125), (0.5, 0.6, 0.49875)])
def test_neighbours_beyond_the_ends_count_up_to_half_a_second(
    mean: str, before: float, behind: float, expected: float
) -> None:
    """A speed of as many m/s as seconds have passed; without a neighbour its first 0.05 s are 0.05 m/s throughout."""
    times = np.array([-before, *(np.arange(10) / 10 + 0.05), 1.0 + behind])
    if mean == "speed":
        assert score(at(*times), times, ONE_SECOND).value == pytest.approx(expected, rel=1e-12)
    else:
        assert mean_power(at(*times), times, ONE_SECOND) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("times", "longest"),
    [
        ((0.3, 0.5, 0.55, 0.6, 0.65, 0.7, 0.71, 0.72, 0.73, 0.74), 0.2),
        ((0.3, 0.4, 0.42, 0.43, 0.44, 0.45, 0.46, 0.47, 0.5, 0.73), 0.23),
    ],
)
def test_the_longest_gap_is_one_between_samples(times: tuple[float, ...], longest: float) -> None:
    """Not one between a sample and an end of the window."""
    assert score(at(*times), np.ones(10), ONE_SECOND).longest_gap == pytest.approx(longest, rel=1e-12)


def test_the_spread_of_two_blocks_and_of_two_samples_a_block() -> None:
    """Of two means it is their difference over the root of two; the mean of a block is that of its two samples."""
    speed = np.where(TENTHS < 0.45, 0.0, 1.0)
    means = [0.1 * (0.0 * 4 + 0.5 + 0.0) / 0.5, 1.0]  # to 0.4 s nothing, then a ramp of 0.1 s
    spread = score(at(*TENTHS), speed, ONE_SECOND, block=0.5).spread
    assert spread == pytest.approx((means[1] - means[0]) / math.sqrt(2.0), rel=1e-12)
    in_turn = np.arange(11) % 2 + TENTHS
    between = (in_turn[1:] + in_turn[:-1]) / 2
    spread = score(at(*TENTHS), in_turn, ONE_SECOND, block=0.1).spread
    assert spread == pytest.approx(np.std(between, ddof=1), rel=1e-12)


def test_a_later_block_without_samples_leaves_no_spread() -> None:
    times = np.delete(np.arange(21) / 20, [10, 11, 12])
    speed = 0.1 * np.sin(times)
    assert math.isnan(score(at(*times), speed, ONE_SECOND, block=0.1).spread)
    assert score(at(*times), speed, ONE_SECOND, block=0.2).spread > 0.0


def test_arrays_of_another_shape_are_refused() -> None:
    with pytest.raises(ScoreError, match=r"int64\(2, 2\) and values float64\(2, 2\) of velocity must be"):
        score(at(0.0, 0.1, 0.2, 0.3).reshape(2, 2), np.ones((2, 2)), ONE_SECOND)


@pytest.mark.parametrize(("second", "what"), [(0.0, "repeats the one before"), (-0.25, "runs back by 0.25 s")])
def test_a_stamp_that_does_not_increase_is_named(second: float, what: str) -> None:
    for topic, mean in (("velocity", score), ("joint_states", mean_power)):
        with pytest.raises(ScoreError) as caught:
            mean(at(0.0, second, 0.5), np.ones(3), ONE_SECOND)
        assert caught.value.reason == f"{topic}'s stamp {at(second)[0]} ns of sample 1 {what}: stamps must increase"


# -- the servos' power -------------------------------------------------------------------------------------------------


def test_a_mean_power_wants_messages_over_the_whole_window() -> None:
    assert mean_power(at(*TENTHS), np.full(11, 3.0), ONE_SECOND) == 3.0
    with pytest.raises(ScoreError, match=r"^no joint_states for 0\.6 s from 0\.4 s into the window: allowed are 0\.5"):
        mean_power(at(0.0, 0.2, 0.4), np.ones(3), ONE_SECOND)
    with pytest.raises(ScoreError, match=r"^no joint_states for 1 s from 0 s into the window"):
        mean_power(at(), np.ones(0), ONE_SECOND)


@pytest.mark.parametrize(("place", "counts"), [(0, False), (1, True), (6, True), (11, True), (12, False)])
def test_a_power_that_is_not_told_is_missed_in_the_window_alone(place: int, *, counts: bool) -> None:
    power = np.full(13, 3.0)
    power[place] = np.nan
    stamps = at(*(np.arange(13) / 10 - 0.1))
    if counts:
        with pytest.raises(ScoreError, match="tell no power"):
            mean_power(stamps, power, ONE_SECOND)
    else:
        assert mean_power(stamps, power, ONE_SECOND) == 3.0


def test_a_power_beside_the_window_that_is_not_told_tells_nothing_at_its_end() -> None:
    times = np.arange(12) / 10 - 0.05
    for place in (0, 11):
        power = np.full(12, 3.0)
        power[place] = np.nan
        assert mean_power(at(*times), power, ONE_SECOND) == 3.0


# -- where a swim begins -----------------------------------------------------------------------------------------------

AT_ONCE = Measurement(settle=0.0, duration=1.0)


def drift(times: tuple[float, ...], speeds: tuple[float, ...]) -> str:
    """Return why a swim with these velocities, whose gait starts at 0 s, is refused; empty if it is not."""
    try:
        check_swim(at(*times), np.array(speeds), ONE_SECOND, AT_ONCE)
    except NotThisSwimError as error:
        return error.reason.partition(" before the gait")[0]
    return ""


def test_without_samples_before_a_swim_a_line_leads_back_to_its_start() -> None:
    """Of 4 cm/s at 20 ms and 5 cm/s at 30 ms to 2 cm/s; a first sample later than 50 ms tells nothing of the start."""
    assert drift((0.02, 0.03, 0.04), (0.04, 0.05, 0.0)) == "the fish drifts at 2 cm/s"
    assert drift((0.05, 0.06), (0.07, 0.08)) == "the fish drifts at 2 cm/s"
    assert drift((0.051, 0.06), (0.07, 0.08)) == ""
    assert drift((0.02,), (0.04,)) == ""
    assert drift((0.01, 0.02, 0.03), (math.nan, 0.04, 0.05)) == "the fish drifts at 2 cm/s"
    assert drift((), ()) == ""


def test_the_half_second_before_a_swim_tells_its_drift() -> None:
    """Up to the start itself; what is older or no number does not count."""
    assert drift((-0.5, -0.4, -0.2, 0.0, 0.1), (9.0, 0.01, math.nan, 0.03, 9.0)) == "the fish drifts at 2 cm/s"
    assert drift((-0.4, -0.3), (0.01, 0.03)) == "the fish drifts at 2 cm/s"
    assert drift((-0.5, 0.02, 0.03), (9.0, 0.04, 0.05)) == "the fish drifts at 2 cm/s"


def test_the_recent_speed_is_a_mean_up_to_the_last_sample() -> None:
    assert recent_speed(at(0.0, 0.2, 0.4, 0.7), np.array([9.0, 9.0, 2.0, 4.0])) == 3.0
    assert recent_speed(at(0.0, 0.25), np.array([1.0, 2.0])) == 1.5
    assert recent_speed(at(0.0, 0.249), np.array([1.0, 2.0])) is None


@pytest.mark.parametrize(
    ("first", "last", "refused"), [(-40, 50, False), (0, 50, False), (0, 51, True), (50, 100, False), (49, 100, True)]
)
def test_a_value_that_is_repeated_counts_from_the_start_to_the_end_of_the_swim(
    first: int, last: int, *, refused: bool
) -> None:
    """Of 100 samples a second; a fish at rest before its swim may have one speed, and nobody asks what comes after."""
    number = np.arange(-50, 161)
    speeds = np.where((number >= first) & ((number <= last) | (last == 100)), 0.001, 1e-6 * number)
    stamps = START + number * (SECOND // 100)
    if not refused:
        check_swim(stamps, speeds, ONE_SECOND, AT_ONCE)
        return
    with pytest.raises(ScoreError, match=rf"0\.001 m/s to the last bit for 0\.51 s from {first / 100:g} s into"):
        check_swim(stamps, speeds, ONE_SECOND, AT_ONCE)


def swum(speed: np.ndarray, rate: int = 50) -> tuple[np.ndarray, np.ndarray]:
    """Return the stamps from 1 s before a window of 10 s on, and a speed that a beat makes sway by 0.3 cm/s."""
    times = np.arange(-rate, 11 * rate) / rate
    swaying = np.interp(times, np.linspace(0.0, 10.0, speed.size), speed) + 0.003 * np.sin(4.0 * np.pi * times)
    return at(*times), np.where(times < 0.0, 0.0, swaying)


STEADY = np.full(101, 0.018)
WALL = np.where(np.arange(101) < 65, 0.018, 0.0003)
CARRIED = STEADY + np.where(abs(np.arange(101) - 50) < 5, 0.2, 0.0)


@pytest.mark.parametrize(
    ("speed", "says"),
    [
        (WALL, r"rests from 7 s .* on, having swum at 1\.8 cm/s"),
        (np.where(np.arange(101) < 75, 0.018, 0.0003), "rests from 8 s"),
        (CARRIED, r"moves at 1\d cm/s from [45] s .*1\.8 cm/s is its median"),
        (-CARRIED, r"moves at -1\d cm/s"),
        (STEADY + np.where(abs(np.arange(101) - 50) < 10, 0.06, 0.0), r"moves at 7"),
    ],
)
def test_a_swim_that_something_stops_or_carries_has_no_score(speed: np.ndarray, says: str) -> None:
    with pytest.raises(ScoreError, match=says):
        check_swim(*swum(speed), Window(START, START + 10 * SECOND), Measurement())


def test_of_the_measured_swims_those_that_lost_the_fish_have_no_score() -> None:
    """Seven of the third runs lost it, as tests/data/README.md says: they have forward speeds below -0.02 m/s."""
    lost, refused = set(), set()
    for path in sorted((ROOT / "tests/data").glob("tail_actuated_fish_*/*.csv")):
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        times = np.array([float(row["t"]) for row in rows])
        speed = np.array([float(row["v_forward"]) for row in rows])
        if "third" in path.parent.name and speed.min() < -0.02:
            lost.add(path.name)
        measurement = Measurement(duration=float(int(times[-1] - times[0])), block=1.0, largest_start_speed=0.005)
        window = measurement.window(int(at(0.0)[0]))
        stamps = at(*(times - times[0]))
        rest = at(*np.arange(-0.5, -0.01, 0.01))  # the measured swims begin somewhere on their way
        try:
            check_swim(np.concatenate((rest, stamps)), np.concatenate((0.0 * rest, speed)), window, measurement)
        except ScoreError:
            refused.add(path.name)
    assert len(lost) == 7
    assert refused == lost


def test_a_swim_that_is_stopped_before_its_window_has_no_score() -> None:
    window = Window(START + 4 * SECOND, START + 10 * SECOND)
    speed = np.where(np.arange(101) < 38, 0.018, 0.0003)
    with pytest.raises(ScoreError, match=r"rests from 4 s after the start of its gait on, having swum at 1\.8 cm/s"):
        check_swim(*swum(speed), window, Measurement(settle=4.0, duration=6.0))
    check_swim(*swum(speed), window, Measurement(settle=4.0, duration=6.0, largest_start_speed=0.01))


def test_a_stop_is_looked_for_in_the_whole_blocks_that_end_with_the_window_whenever_the_swim_began() -> None:
    """The first of them begins 0.4 s after the start, and of one swim there is no whole block."""
    begin = START + 3 * SECOND // 10
    stamps, speed = swum(np.where(np.arange(101) < 38, 0.018, 0.0003))
    stamps = stamps + begin - START
    window = Window(begin + 4 * SECOND, begin + 104 * SECOND // 10)
    with pytest.raises(ScoreError, match=r"rests from 4\.4 s after the start of its gait on, having swum at 1\.8 cm/s"):
        check_swim(stamps, speed, window, Measurement(settle=4.0, duration=6.4))
    check_swim(stamps, speed, Window(begin, begin + 4 * SECOND // 10), Measurement(settle=0.0, duration=0.4))


@pytest.mark.parametrize(
    "speed",
    [
        STEADY,
        -STEADY,
        np.where(np.arange(101) < 85, 0.018, 0.0003),  # for less than two blocks at the end
        0.0 * STEADY,
        0.3 * (1.0 - np.exp(-np.arange(101) / 20.0)),  # from rest, without settling
        np.where(np.arange(101) < 10, 0.014, 0.001),  # a first stroke of a fin that does not swim
        np.where(np.arange(101) < 50, 0.018, 0.008),
        STEADY + np.where(abs(np.arange(101) - 50) < 5, 0.02, 0.0),
    ],
)
def test_a_swim_that_only_changes_its_speed_has_one(speed: np.ndarray) -> None:
    check_swim(*swum(speed), Window(START, START + 10 * SECOND), Measurement())
