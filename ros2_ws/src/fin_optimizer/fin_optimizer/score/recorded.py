"""A recorded swim: what its bag holds of it, and its score, equal to the live run's to the last digit."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from fin_optimizer.bags.messages import VELOCITY_TYPE, WRENCH_TYPE
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.goals import BETWEEN_CONSTRAINTS, MEAN_SPEED, MEASURES, YAW_RATE, Goals
from fin_optimizer.score.joints import JOINT_STATE_TYPE
from fin_optimizer.score.mean_speed import ScoreError
from fin_optimizer.score.swim import SwimRecord, score_swim
from fin_optimizer.words import SPEED, SPREAD
from fin_plant.plant_state import SERVO_TORQUE, THRUST

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.score.mean_speed import Score

_OBJECTIVE_KEY, _CONSTRAINTS_KEY = "study.objective", "study.constraints"
"""As fin_optimizer.study.settings writes them into a bag's metadata; that module needs Optuna."""
_STATE_TYPE = "diagnostic_msgs/msg/DiagnosticStatus"


def goals_of(metadata: Mapping[str, str]) -> Goals:
    """Return what the study of a bag is about, by its metadata; the mean speed where they do not say it.

    Raises:
        ScoreError: A newer version's study, about something that this one does not know.
    """
    constraints = metadata.get(_CONSTRAINTS_KEY, "")
    try:
        return Goals.of_objective(
            metadata.get(_OBJECTIVE_KEY, "speed"), constraints.split(BETWEEN_CONSTRAINTS) if constraints else ()
        )
    except ValueError as error:
        msg = f"metadata {_OBJECTIVE_KEY}, {_CONSTRAINTS_KEY}: {error}"
        raise ScoreError(msg) from error


def recorded_swim(bag: Bag, measured: Mapping[str, str], needs: Collection[str] = ()) -> SwimRecord:
    """Return what a bag holds of its swim.

    Args:
        bag: Of a trial, or of another program's swim.
        measured: Which part of the swim counts, if its metadata do not say so.
        needs: What it must have beside the forward speed, as `Measure.needs` names it.

    Raises:
        BagError: It lacks a topic, or is damaged.
    """
    states = [message for _, message in bag.decoded("plant_state", _STATE_TYPE)]
    told = any(topic.endswith("/joint_states") and kind == JOINT_STATE_TYPE for topic, kind in bag.topics.items())
    joints = bag.typed("joint_states", JOINT_STATE_TYPE) if SERVO_TORQUE in needs or told else None
    return SwimRecord(
        bag.velocity(),
        states,
        joints,
        {**measured, **bag.metadata},
        bag.typed("velocity", VELOCITY_TYPE) if YAW_RATE in needs else (),
        bag.typed("thrust", WRENCH_TYPE) if THRUST in needs else (),
    )


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
    return score_swim(recorded_swim(bag, measured))[0], bag


def achieved(bag: Bag, measured: Mapping[str, str] = MappingProxyType({})) -> dict[str, float]:
    """Return what a bag's trial achieved, by name and unit: all that its study is about, the mean speed in any case.

    Args:
        bag: The bag.
        measured: As for `score_bag`.

    Raises:
        BagError: It lacks a topic, or is damaged.
        ScoreError: Its samples give no score, or do not tell what its study is about.
    """
    goals = goals_of(bag.metadata)
    result, numbers = score_swim(recorded_swim(bag, measured, goals.needs), goals.asked)
    others = {MEASURES[name].column: value for name, value in numbers.items() if name != MEAN_SPEED}
    return {SPEED: result.value, SPREAD: result.spread, **others}
