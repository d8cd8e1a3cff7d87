"""Stamps of monotonic times, also where the process is put aside between two readings of the clocks."""

from __future__ import annotations

import time

import pytest

from fin_servo_driver import wall_clock

ROUNDING = 1_000_000
"""ns that the closest of five pairs of readings, or a clock that is slewed meanwhile, may be off."""


def test_a_stamp_is_the_wall_clocks_time_of_that_moment() -> None:
    before = time.time_ns()
    now = time.monotonic()
    after = time.time_ns()  # much later where the process was put aside
    assert before - ROUNDING < wall_clock.stamp_of(now) < after + ROUNDING
    assert wall_clock.stamp_of(now + 1.0) - wall_clock.stamp_of(now) == pytest.approx(1e9, abs=2 * ROUNDING)


def test_the_closest_pair_of_readings_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process is put aside for 5 ms in every reading of the pair but one."""
    clock, waits = 0, iter([5_000_000, 5_000_000, 1_000, 5_000_000, 5_000_000])

    def monotonic() -> int:
        return clock

    def wall() -> int:
        nonlocal clock
        read = 1_000_000_000 + clock
        clock += next(waits)
        return read

    monkeypatch.setattr(time, "monotonic_ns", monotonic)
    monkeypatch.setattr(time, "time_ns", wall)
    assert wall_clock.stamp_of(0.0) == pytest.approx(1_000_000_000, abs=1_000)
