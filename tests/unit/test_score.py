"""The score of a trial: the right mean, or a reason instead of a number that the samples do not carry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.score.mean_speed import (
    FASTEST,
    LONGEST_GAP,
    MINIMUM_RATE,
    Measurement,
    ScoreError,
    Window,
    check_swim,
    recent_speed,
    score,
)

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TEN_SECONDS = Window(START, START + 10 * SECOND)
EVEN = START + np.arange(1001) * (SECOND // 100)  # 100 Hz, both ends of the window included


def speed_of(stamps: np.ndarray) -> np.ndarray:
    """Return a speed that starts from rest and oscillates as a beating fish does."""
    time = (stamps - START) / SECOND
    return 0.1 * np.tanh(time) + 0.01 * np.sin(2 * np.pi * 1.8 * time)


def test_the_mean_of_a_speed_is_distance_over_time() -> None:
    result = score(EVEN, speed_of(EVEN), TEN_SECONDS)
    distance = 0.1 * math.log(math.cosh(10.0)) + 0.01 / (2 * np.pi * 1.8) * (1 - math.cos(2 * np.pi * 18.0))
    # The trapezoidal rule's error stays below step^2 / 12 * max|u''| = 1.1e-5 m/s, and mostly cancels.
    assert result.value == pytest.approx(distance / 10.0, abs=2e-6)
    assert result.samples == 1001
    assert result.longest_gap == 0.01


def test_even_sampling_gives_the_plain_mean_with_half_weights_at_the_ends() -> None:
    speed = speed_of(EVEN)
    plain = (math.fsum(speed) - 0.5 * (speed[0] + speed[-1])) / 1000
    assert score(EVEN, speed, TEN_SECONDS).value == pytest.approx(plain, rel=1e-14)  # some roundings


def test_uneven_sampling_does_not_favour_the_times_with_more_samples() -> None:
    fast, slow = (
        np.arange(0, 5 * SECOND, SECOND // 1000),
        np.arange(5 * SECOND, 10 * SECOND + 1, SECOND // 20),
    )
    stamps = START + np.concatenate((fast, slow))
    rising = (stamps - START) / (10 * SECOND)
    assert score(stamps, rising, TEN_SECONDS).value == pytest.approx(0.5, rel=1e-12)  # roundings
    assert rising.mean() < 0.3  # what a plain mean would make of it


def test_samples_outside_the_window_do_not_count() -> None:
    around = START + np.arange(-500, 1501) * (SECOND // 100)
    speed = speed_of(around)
    speed[:500], speed[1501:] = np.nan, 7.0  # the samples on both ends of the window make these irrelevant
    assert score(around, speed, TEN_SECONDS) == score(EVEN, speed_of(EVEN), TEN_SECONDS)


@given(
    intervals=st.lists(st.integers(1, int(LONGEST_GAP * SECOND / 5)), min_size=150, max_size=300),
    level=st.floats(-FASTEST, FASTEST),
)
def test_a_constant_speed_scores_itself_however_it_is_sampled(intervals: list[int], level: float) -> None:
    stamps = START + np.cumsum(intervals)
    window = Window(int(stamps[0]), int(stamps[-1]))
    speed = np.full(stamps.size, level)
    assert score(stamps, speed, window).value == pytest.approx(level, rel=1e-14, abs=1e-300)  # some roundings


@given(
    speed=st.lists(st.floats(-FASTEST, FASTEST), min_size=101, max_size=101),
    offset=st.integers(0, 2**62),
)
def test_the_score_depends_neither_on_the_epoch_nor_exceeds_the_samples(speed: list[float], offset: int) -> None:
    steps = np.arange(101) * (SECOND // 20)
    values = np.array(speed)
    early = score(steps, values, Window(0, 5 * SECOND))
    late = score(offset + steps, values, Window(offset, offset + 5 * SECOND))
    assert early == late or (math.isnan(early.spread) and math.isnan(late.spread))
    slack = 1e-12 * FASTEST  # roundings
    assert min(speed) - slack <= early.value <= max(speed) + slack


@given(phase=st.integers(1, SECOND // 100 - 1))
def test_a_window_that_starts_between_two_samples_is_averaged_as_a_whole(phase: int) -> None:
    stamps = EVEN[0] - phase + np.arange(1010) * (SECOND // 100)
    rising = (stamps - START) / (10 * SECOND)
    result = score(stamps, rising, TEN_SECONDS)
    assert result.value == pytest.approx(0.5, rel=1e-12)  # roundings; without the ends it would be up to 5e-4 off
    assert result.samples == 1000


@pytest.mark.parametrize("beyond", [math.nan, 1e9], ids=["not finite", "impossible"])
def test_an_end_without_usable_neighbour_beyond_takes_the_nearest_sample(beyond: float) -> None:
    stamps = START + SECOND // 200 + np.arange(-1, 1001) * (SECOND // 100)
    rising = (stamps - START) / (10 * SECOND)
    lost = rising.copy()
    lost[0] = lost[-1] = beyond
    expected = score(stamps[1:-1], rising[1:-1], TEN_SECONDS)
    assert score(stamps, lost, TEN_SECONDS) == expected
    assert expected.value == pytest.approx(0.5, rel=1e-12)  # what both ends miss is equal here


def test_the_mean_of_the_blocks_is_the_score() -> None:
    blocks = [Window(START + k * SECOND, START + (k + 1) * SECOND) for k in range(10)]
    means = [score(EVEN, speed_of(EVEN), block).value for block in blocks]
    whole = score(EVEN, speed_of(EVEN), TEN_SECONDS, block=1.0)
    assert np.mean(means) == pytest.approx(whole.value, rel=1e-14)  # some roundings
    assert np.std(means, ddof=1) == pytest.approx(whole.spread, rel=1e-12)


def test_swapping_the_sum_of_the_samples_around_changes_no_digit() -> None:
    speed = speed_of(EVEN)
    mirrored = (2 * START + 10 * SECOND) - EVEN[::-1]
    there, back = score(EVEN, speed, TEN_SECONDS), score(mirrored, speed[::-1], TEN_SECONDS)
    assert there.value == back.value


def test_the_spread_is_that_of_the_beats_means_not_of_the_beat() -> None:
    time = (EVEN - START) / SECOND
    oscillating = 0.2 + 0.1 * np.sin(2 * np.pi * time)
    assert score(EVEN, oscillating, TEN_SECONDS, block=1.0).spread < 1e-15
    stepping = np.floor(np.minimum(time, 9.5)) % 2  # blocks of about 0 and 1 m/s in turn
    assert score(EVEN, stepping, TEN_SECONDS, block=2.0).spread < 0.01
    expected = np.std([0.005, 0.995] * 5, ddof=1)  # the edge sample belongs to both blocks
    assert score(EVEN, stepping, TEN_SECONDS, block=1.0).spread == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("block", [6.0, 10.1, 1e-3])
def test_the_spread_is_nan_where_it_is_not_defined(block: float) -> None:
    assert math.isnan(score(EVEN, speed_of(EVEN), TEN_SECONDS, block=block).spread)


@given(first=st.integers(0, 949), length=st.integers(1, 51))
def test_a_gap_is_refused_exactly_when_it_is_longer_than_the_limit(first: int, length: int) -> None:
    kept = np.ones(1001, dtype=bool)
    kept[first : first + length] = False
    # Inside, n lost samples leave n + 1 intervals of 10 ms; at the window's start n of them.
    gap = (length + (1 if first else 0)) * 0.01
    if gap > LONGEST_GAP + 1e-9:
        with pytest.raises(
            ScoreError, match=r"no velocity for 0\.5\d* s from .* s into the window: allowed are 0\.5 s"
        ):
            score(EVEN[kept], speed_of(EVEN)[kept], TEN_SECONDS)
    else:
        assert score(EVEN[kept], speed_of(EVEN)[kept], TEN_SECONDS).samples == 1001 - length


@pytest.mark.parametrize("kept", [slice(60, None), slice(None, -60)], ids=["late", "early"])
def test_samples_that_start_late_or_end_early_are_refused(kept: slice) -> None:
    with pytest.raises(ScoreError, match=r"no velocity for 0\.6 s from (0|9\.4) s into the window"):
        score(EVEN[kept], speed_of(EVEN)[kept], TEN_SECONDS)


@given(index=st.integers(0, 1000), value=st.sampled_from([math.nan, math.inf, -math.inf, 31.0, -1e300]))
def test_a_value_that_is_not_finite_or_not_possible_is_refused(index: int, value: float) -> None:
    speed = speed_of(EVEN)
    speed[index] = value
    with pytest.raises(ScoreError, match=r"forward speed is .* m/s .* s into the window, and 1 of 1001"):
        score(EVEN, speed, TEN_SECONDS)


@given(index=st.integers(0, 999), back=st.integers(0, SECOND))
def test_stamps_that_repeat_or_run_back_are_refused(index: int, back: int) -> None:
    stamps = EVEN.copy()
    stamps[index + 1] = stamps[index] - back
    with pytest.raises(ScoreError, match=rf"of sample {index + 1} (repeats|runs back)"):
        score(stamps, speed_of(EVEN), TEN_SECONDS)


def test_too_few_samples_are_refused_with_the_number_needed() -> None:
    sparse = EVEN[:: round(100 / MINIMUM_RATE) + 1]
    with pytest.raises(ScoreError, match=r"window of 10 s holds 91 of 91 velocity samples: needed are at least 100"):
        score(sparse, speed_of(sparse), TEN_SECONDS)
    with pytest.raises(ScoreError, match="holds 0 of 0"):
        score(np.array([], dtype=np.int64), np.array([]), TEN_SECONDS)
    with pytest.raises(ScoreError, match="holds 0 of 1001"):
        score(EVEN, speed_of(EVEN), Window(0, 1))


def test_arrays_that_do_not_fit_each_other_are_refused() -> None:
    with pytest.raises(ScoreError, match=r"int64\(1001,\) and values float64\(1000,\)"):
        score(EVEN, speed_of(EVEN)[1:], TEN_SECONDS)
    with pytest.raises(ScoreError, match="integer stamp"):
        score(EVEN.astype(float), speed_of(EVEN), TEN_SECONDS)


def test_a_window_must_end_after_it_starts() -> None:
    with pytest.raises(ValueError, match="must be after its start"):
        Window(5, 5)


@given(
    settle=st.floats(0, 86_400),
    duration=st.floats(1e-3, 86_400),
    block=st.floats(1e-3, 86_400),
)
def test_a_measurement_survives_the_metadata_to_the_last_digit(settle: float, duration: float, block: float) -> None:
    measurement = Measurement(settle, duration, block)
    assert Measurement.from_metadata({"other": "x"} | measurement.metadata()) == measurement


def test_the_window_starts_after_settling_and_lasts_the_duration() -> None:
    assert Measurement(settle=2.5, duration=10.0).window(START) == Window(
        START + 5 * SECOND // 2, START + 25 * SECOND // 2
    )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"measurement.settle_s": "-1"}, r"settle = -1 s is outside .* \[0, 86400\] s"),
        ({"measurement.duration_s": "nan"}, "duration = nan s is outside"),
        ({"measurement.duration_s": "ten"}, "could not convert string to float: 'ten'"),
    ],
)
def test_metadata_out_of_range_give_no_measurement(change: dict[str, str], reason: str) -> None:
    with pytest.raises(ScoreError, match=reason):
        Measurement.from_metadata(Measurement().metadata() | change)


def test_metadata_without_a_measurement_say_what_is_missing() -> None:
    with pytest.raises(ScoreError, match=r"lack measurement\.settle_s, measurement\.duration_s, measurement\.block_s"):
        Measurement.from_metadata({})


# -- velocities of a swim that is none ---------------------------------------------------------------------------------

MEASURED = Measurement(settle=2.0, duration=8.0)
SWIM = np.arange(-50, 1001) * (SECOND // 100) + START  # with half a second before the gait, which starts at START
WINDOW = MEASURED.window(START)


def swim_from(speed: float) -> np.ndarray:
    """Return the forward speed of a swim from a start speed, which dies away within a second."""
    time = np.maximum((SWIM - START) / SECOND, 0.0)
    return 0.05 * np.tanh(time) ** 2 + speed * np.exp(-time) + 1e-9 * np.sin(SWIM / 1e7)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_swim_from_rest_is_one(noise: float) -> None:
    """Noise of 1 cm/s, as the differences of a tracker's poses have it, is no drift."""
    random = np.random.default_rng(3)
    check_swim(SWIM, swim_from(0.0) + noise * random.standard_normal(SWIM.size), WINDOW, MEASURED)


@pytest.mark.parametrize("speed", [0.012, -0.012])
@pytest.mark.parametrize("first", [0, 51], ids=["with samples before the start", "without"])
def test_a_swim_that_does_not_begin_at_rest_has_no_score(speed: float, first: int) -> None:
    with pytest.raises(ScoreError, match=f"drifts at {100.0 * speed:g} cm/s before the gait starts.*within 0.5 cm/s"):
        check_swim(SWIM[first:], swim_from(speed)[first:], WINDOW, MEASURED)
    check_swim(SWIM, swim_from(speed), WINDOW, replace(MEASURED, largest_start_speed=0.02))


@pytest.mark.parametrize(("begin", "length", "refused"), [(300, 50, False), (300, 51, True), (949, 100, True)])
@pytest.mark.parametrize("value", [0.02, 0.0, -0.01])
def test_a_velocity_that_is_repeated_to_the_last_bit_is_none(
    value: float, begin: int, length: int, *, refused: bool
) -> None:
    """As of a tracker that lost the fish; up to half a second, as of samples that are missing."""
    speed = swim_from(0.0)
    speed[50 + begin : 50 + begin + length + 1] = value
    if not refused:
        check_swim(SWIM, speed, WINDOW, MEASURED)
        return
    with pytest.raises(ScoreError, match=f"stays at {value} m/s to the last bit for .* s from .* into the window"):
        check_swim(SWIM, speed, WINDOW, MEASURED)


def test_a_velocity_in_another_unit_is_not_believed() -> None:
    speed = 1000.0 * np.maximum(speed_of(EVEN), 0.0) + 0.5
    with pytest.raises(ScoreError, match=r"beyond 1 m/s \(measurement.largest_speed\)"):
        score(EVEN, speed, TEN_SECONDS, largest_speed=Measurement().largest_speed)


@pytest.mark.parametrize(("offset", "words"), [(-37, "the last one lies 27 s before"), (50, "the first one lies 40 s")])
def test_samples_of_another_clock_are_told_with_their_place(offset: int, words: str) -> None:
    with pytest.raises(ScoreError, match=f"{words}.* the window"):
        score(EVEN + offset * SECOND, speed_of(EVEN), TEN_SECONDS)


def test_the_recent_speed_is_known_after_a_quarter_of_a_second() -> None:
    assert recent_speed(SWIM[:0], np.zeros(0)) is None
    assert recent_speed(SWIM[:25], np.full(25, 0.01)) is None
    assert recent_speed(SWIM[:26], np.full(26, 0.01)) == pytest.approx(0.01)
    assert recent_speed(SWIM[:200], np.repeat([9.0, 0.01], [150, 50])) == pytest.approx(0.01)
