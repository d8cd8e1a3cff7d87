"""The balance of angular momentum: it holds with the distributed force, and misses by a known moment at the tip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fin_plant.gait import Gait, JointDrive
from fin_sim.angular_momentum import angular_momentum_budget
from fin_sim.fish import Fish, Link, Water
from fin_sim.swim import Swim, swim
from support.paper_fish import BODY
from support.paper_fish import FIN as PAPER_FIN

FIN = replace(PAPER_FIN, tip_height=0.035)
TURN = Gait((JointDrive(math.radians(15.0), 0.9, 0.0, math.radians(10.0)),))


def turning(reactive: str, water: Water = Water(1000.0, 1.0)) -> Swim:  # noqa: B008  (frozen)
    return swim(FIN, Fish(BODY, water), TURN, 10.0, reactive=reactive, sample_time=2.5e-3)  # type: ignore[arg-type]


def imbalance(result: Swim, *, with_spurious: bool = False) -> float:
    """Return what the moments do not account for, over the sum of their sizes over time."""
    budget = angular_momentum_budget(result)
    moments = budget.wake + budget.resistive + budget.body + with_spurious * budget.spurious
    given = result.duration * result.mean_between(moments, 0.0, result.duration)
    size = sum(np.trapezoid(np.abs(each), result.time) for each in (budget.wake, budget.resistive, budget.body))
    return float((budget.stored[-1] - budget.stored[0] - given) / size)


def test_angular_momentum_balances_with_the_distributed_force() -> None:
    assert abs(imbalance(turning("distributed"))) < 1e-5


def test_angular_momentum_balances_in_a_current_and_with_a_coefficient_by_amplitude() -> None:
    assert abs(imbalance(turning("distributed", Water(1000.0, 1.0, 8.0, 0.02, -0.03)))) < 1e-5


def test_the_force_at_the_tip_turns_the_fish_by_a_moment_from_nowhere() -> None:
    result = turning("tip")
    assert abs(imbalance(result)) > 1e-3
    assert abs(imbalance(result, with_spurious=True)) < 1e-5


def test_that_moment_changes_the_turning_rate_by_some_percent() -> None:
    tip, distributed = turning("tip").turning_rate, turning("distributed").turning_rate
    assert 0.02 < abs(tip / distributed - 1.0) < 0.15


def test_a_peduncle_balances_too() -> None:
    gait = Gait((JointDrive(0.1, 0.9, 0.0, 0.1), JointDrive(0.2, 0.9, -1.0)))
    fish = Fish(BODY, Water(1000.0, 1.0), (Link(0.03, 0.04, 0.03, 0.5),))
    assert abs(imbalance(swim(FIN, fish, gait, 6.0, sample_time=2.5e-3))) < 1e-5


def test_a_held_body_is_refused() -> None:
    with pytest.raises(ValueError, match="clamp = 'fixed'"):
        angular_momentum_budget(swim(FIN, Fish(BODY, Water(1000.0, 1.0)), TURN, 2.0, clamp="fixed"))
