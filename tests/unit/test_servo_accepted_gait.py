"""What becomes of a gait that was accepted: followed, stopped by itself, never started, or at its end."""

from __future__ import annotations

import pytest

from fin_plant.gait import PAPER_GAIT, Gait
from fin_servo_driver.accepted_gait import TAKE_SECONDS, AcceptedGait, End, not_started
from fin_servo_driver.health import Health
from fin_servo_driver.tail import Phase

STILL = Gait.from_rows([[0.0, 0.9, 0.0, 0.0]])
SILENT, FOLLOWING, STOPPING = (
    Health(phase=phase, still=phase is Phase.SILENT) for phase in (Phase.SILENT, Phase.FOLLOWING, Phase.STOPPING)
)


def test_a_gait_counts_from_its_first_message_until_another_one_comes() -> None:
    accepted = AcceptedGait()
    assert [accepted.command(PAPER_GAIT, now).since for now in (1.0, 1.2)] == [1.0, 1.0]
    assert accepted.moves
    assert accepted.command(STILL, 1.4).since == 1.4
    assert not accepted.moves


def test_a_tail_that_follows_and_falls_silent_has_stopped() -> None:
    accepted = AcceptedGait()
    assert accepted.ended(SILENT, 0.0) is None
    accepted.command(PAPER_GAIT, 1.0)
    assert [accepted.ended(health, 1.1) for health in (SILENT, FOLLOWING, STOPPING)] == [None, None, None]
    assert accepted.ended(SILENT, 1.1) is End.STOPPED
    accepted.forget()
    assert accepted.ended(SILENT, 9.0) is None


@pytest.mark.parametrize(("late", "end"), [(-1e-6, None), (1e-6, End.NOT_STARTED)])
def test_a_tail_that_does_not_follow_in_time_has_not_started(late: float, end: End | None) -> None:
    accepted = AcceptedGait()
    accepted.command(PAPER_GAIT, 1.0)
    accepted.command(PAPER_GAIT, 1.2)
    assert accepted.ended(SILENT, 1.0 + TAKE_SECONDS + late) is end


@pytest.mark.parametrize(
    ("gait", "late", "timeout", "fell"),
    [
        (PAPER_GAIT, 0.5, 0.5, False),
        (PAPER_GAIT, 0.51, 0.5, True),
        (PAPER_GAIT, float("nan"), 0.5, True),
        (PAPER_GAIT, 3600.0, None, False),
        (STILL, 3600.0, 0.5, False),
    ],
)
def test_a_gait_that_comes_too_late_does_not_go_on_with_the_one_before(
    gait: Gait, late: float, timeout: float | None, fell: bool
) -> None:
    accepted = AcceptedGait()
    assert not accepted.fell_silent(9.0, timeout)
    accepted.command(gait, 0.8)
    accepted.command(gait, 1.0)
    assert accepted.fell_silent(1.0 + late, timeout) is fell
    accepted.forget()
    assert not accepted.fell_silent(1.0 + late, timeout)


def test_the_end_of_a_gait_is_there_when_the_tail_stands_by_a_command_of_that_end() -> None:
    accepted = AcceptedGait()
    assert not accepted.stands(SILENT)
    accepted.command(PAPER_GAIT, 1.0)
    assert not accepted.stands(Health(still=True, commanded=1.0))
    accepted.command(STILL, 2.0)
    assert not accepted.stands(Health(still=True, commanded=1.0)), "the tail has not been given it yet"
    assert not accepted.stands(Health(still=False, commanded=2.0))
    assert accepted.stands(Health(still=True, commanded=2.0))


def test_why_a_tail_has_not_started_is_said_as_far_as_it_is_known() -> None:
    assert (
        not_started(Health(fault="id 1: overload")) == "the tail did not start within 0.3 s of its gait: id 1: overload"
    )
    assert "by the device's answers or by a busy computer" in not_started(Health())
