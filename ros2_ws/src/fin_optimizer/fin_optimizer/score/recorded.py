"""A recorded swim: what its bag holds of it, and its score, equal to the live run's to the last digit."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.joints import JOINT_STATE_TYPE
from fin_optimizer.score.swim import SwimRecord, score_swim
from fin_optimizer.words import ENERGY_PER_METRE, SPEED, SPREAD

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.score.mean_speed import Score

_OBJECTIVE_KEY, _OBJECTIVE_WITH_COST = "study.objective", "speed_and_cost_of_transport"
"""As fin_optimizer.study.settings writes them into a bag's metadata; that module needs Optuna."""
_STATE_TYPE = "diagnostic_msgs/msg/DiagnosticStatus"


def recorded_swim(bag: Bag, measured: Mapping[str, str], *, with_cost: bool) -> SwimRecord:
    """Return what a bag holds of its swim.

    Args:
        bag: Of a trial, or of another program's swim.
        measured: Which part of the swim counts, if its metadata do not say so.
        with_cost: Whether it must have joint states.

    Raises:
        BagError: It lacks a topic, or is damaged.
    """
    states = [message for _, message in bag.decoded("plant_state", _STATE_TYPE)]
    told = any(topic.endswith("/joint_states") and kind == JOINT_STATE_TYPE for topic, kind in bag.topics.items())
    joints = bag.typed("joint_states", JOINT_STATE_TYPE) if with_cost or told else None
    return SwimRecord(bag.velocity(), states, joints, {**measured, **bag.metadata})


def score_bag(path: Path, measured: Mapping[str, str] = MappingProxyType({})) -> tuple[Score, Bag]:
    """Return the score of a recorded trial, and its bag.

    Args:
        path: The bag.
        measured: Entries of `Measurement.metadata` for a bag whose own metadata lack them: one of another program.

    Raises:
        BagError: There is no bag, it lacks a topic, or it is damaged.
        ScoreError: Its samples give no score.
    """
    bag = read_bag(path)
    return score_swim(recorded_swim(bag, measured, with_cost=False), with_cost=False)[0], bag


def achieved(bag: Bag, measured: Mapping[str, str] = MappingProxyType({})) -> dict[str, float]:
    """Return what a bag's trial achieved, by name and unit: its energy per metre where its study is about that.

    Args:
        bag: The bag.
        measured: As for `score_bag`.

    Raises:
        BagError: It lacks a topic, or is damaged.
        ScoreError: Its samples give no score.
    """
    with_cost = bag.metadata.get(_OBJECTIVE_KEY) == _OBJECTIVE_WITH_COST
    result, cost = score_swim(recorded_swim(bag, measured, with_cost=with_cost), with_cost=with_cost)
    numbers = {SPEED: result.value, SPREAD: result.spread}
    if with_cost:
        numbers[ENERGY_PER_METRE] = math.nan if cost is None else cost
    return numbers
