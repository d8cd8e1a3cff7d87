"""The pace of a swim and the plant's time, with clocks that are handed in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from fin_sim.pace import SLICE, Pace

SAMPLE_TIME = 0.01


@dataclass
class Machine:
    """Its clocks, which go on when a test says so; the wall clock can be set."""

    seconds: float = 100.0
    set_by: float = 0.0

    def monotonic(self) -> float:
        return self.seconds

    def wall(self) -> int:
        return round((1.7e9 + self.seconds + self.set_by) * 1e9)

    def pace(self) -> Pace:
        return Pace(SAMPLE_TIME, self.monotonic, self.wall)


def swim(pace: Pace) -> int:
    """Compute what is due, as the simulator does; return how many samples that were."""
    samples = pace.due()
    if samples:
        pace.advance(samples)
        pace.stamp = int(pace.stamps(samples)[-1])
    return samples


@pytest.mark.parametrize("stall", [0.0, 0.1, 0.236, 0.249, 0.3, 5.0])
def test_what_was_due_before_a_state_that_begins_now_is_not_swum_after_it(stall: float) -> None:
    """A kernel that compiles for 0.236 s, or a reset on a machine that was busy for as long."""
    machine = Machine()
    pace = machine.pace()
    machine.seconds += stall
    assert pace.begin_state(now=True) == pytest.approx(machine.wall(), abs=1)
    assert swim(pace) == 0
    assert pace.stamp <= machine.wall() + 1
    for _ in range(200):
        machine.seconds += SAMPLE_TIME
        swim(pace)
        assert -SAMPLE_TIME - 1e-4 < (pace.stamp - machine.wall()) / 1e9 < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_in_real_time_no_stall_makes_the_plants_time_go_ahead_of_the_wall_clock(seed: int) -> None:
    random = np.random.default_rng(seed)
    machine = Machine()
    pace = machine.pace()
    last = pace.stamp
    for number in range(5_000):
        machine.seconds += float(random.exponential(random.choice([0.001, 0.01, 0.2])))
        if number % 50 == 0:
            pace.begin_state(now=bool(random.integers(2)))
        assert 0 <= swim(pace) <= SLICE
        assert last <= pace.stamp <= machine.wall() + number
        last = pace.stamp


def test_every_state_has_a_time_of_its_own_though_the_wall_clock_was_set_back() -> None:
    machine = Machine()
    pace = machine.pace()
    begun = [pace.begin_state(now=True)]
    machine.set_by = -3600.0
    begun += [pace.begin_state(now=now) for now in (True, False, True)]
    assert np.all(np.diff(begun) == 1)


def test_a_speed_counts_from_its_change_and_what_a_sleep_has_cost_is_given_up() -> None:
    machine = Machine()
    pace = machine.pace()
    pace.set_speed(4.0)
    machine.seconds += 0.0501
    assert swim(pace) == 20
    machine.seconds += 30.0
    assert swim(pace) == 1
    assert swim(pace) == 0
    pace.set_speed(0.0)
    assert (swim(pace), pace.wait()) == (SLICE, 0.0)
    pace.set_speed(1.0)
    assert swim(pace) == 0
    assert pace.wait() == pytest.approx(SAMPLE_TIME)
