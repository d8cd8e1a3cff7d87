"""A whole swim: where it starts, its score, and what else is asked of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.bags.messages import decode, header_stamp
from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.score.joints import JOINT_STATE_TYPE, joint_columns
from fin_optimizer.score.mean_speed import (
    Measurement,
    NotThisSwimError,
    Score,
    ScoreError,
    Window,
    check_swim,
    score,
)
from fin_optimizer.score.measured import DRIVEN_PREFIX, Figures
from fin_plant import validity
from fin_plant.plant_state import SERVO_TORQUE, THRUST, State
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.goals import Measure
    from fin_optimizer.score.joints import Joints

_STAMP_KEY = "stamp_ns"  # as fin_plant.messages writes it; that module needs ROS, which a bag does not
_FIN_PREFIX = "fin."


def start_of_swim(states: Iterable[Any], metadata: Mapping[str, str]) -> int:
    """Return the plant's time in ns at which the gait of a trial started.

    Args:
        states: All messages of its ``plant_state``.
        metadata: Of its bag; the entries ``fin.*`` tell which fin it is about.

    Raises:
        ScoreError: The plant started to swim never, more than once, with another fin, or did not say when.
    """
    fin = {name: value for name, value in metadata.items() if name.startswith(_FIN_PREFIX)}
    starts = set()
    for message in states:
        if message.message != State.SWIMMING:
            continue
        said = {item.key: item.value for item in message.values}
        if differs := [name for name in fin if said.get(name, fin[name]) != fin[name]]:
            words = ", ".join(f"{name} = {said[name]} instead of {fin[name]}" for name in differs)
            msg = f"the fish swam with {words}: it is another fin's swim"
            raise NotThisSwimError(msg)
        try:
            starts.add(int(said.get(_STAMP_KEY, "")))
        except ValueError:
            stamp = said.get(_STAMP_KEY)
            msg = f"plant_state SWIMMING has {_STAMP_KEY} = {stamp!r}, needed is the plant's time in ns at its start"
            raise ScoreError(msg) from None
    if len(starts) != 1:
        what = "the bag holds more than one swim" if starts else "no swim begins in the bag"
        msg = f"plant_state tells {len(starts)} starts of a swim, needed is one: {what}"
        raise NotThisSwimError(msg)
    return starts.pop()


def tail_angle(message: bytes) -> float:
    """Return the largest angle in rad of the driven joints in a serialised JointState; 0 without any."""
    joints = decode(message, JOINT_STATE_TYPE)
    pairs = zip(joints.name, joints.position, strict=False)
    return max((abs(float(angle)) for name, angle in pairs if name.startswith(DRIVEN_PREFIX)), default=0.0)


@dataclass(frozen=True)
class SwimRecord:
    """What was recorded of a swim, by a recorder or in a bag: all that its score is made of.

    Attributes:
        velocity: Header stamps in ns and forward speeds in m/s, both (n,).
        states: Messages of ``plant_state``, decoded.
        joint_states: Serialised messages; None where nobody recorded any.
        metadata: Of the bag: which part of the swim counts (`Measurement.metadata`), and which fin it is about.
        velocity_messages: Those that ``velocity`` was read from, serialised, where more than the speed is asked for.
        thrust: Serialised messages, where anything of them is asked for.
    """

    velocity: tuple[NDArray[np.int64], NDArray[np.float64]]
    states: Iterable[Any]
    joint_states: Sequence[bytes] | None
    metadata: Mapping[str, str]
    velocity_messages: Sequence[bytes] = ()
    thrust: Sequence[bytes] = ()


def score_swim(record: SwimRecord, asked: Iterable[Measure] = ()) -> tuple[Score, dict[str, float]]:
    """Return the score of a swim and what was asked for, of a trial that has just ended as of its bag.

    The second are measures by name in SI, the mean speed always among them; NaN where the swim has none of it, as
    energy per metre without headway (`why_none`).

    Args:
        record: Of the whole swim.
        asked: What is asked for beside the mean speed.

    Raises:
        ScoreError: The samples give no score, or do not tell what is asked for; they end before the window does; the
            fin folded; or they are those of no swim from rest.
    """
    start = start_of_swim(record.states, record.metadata)
    measurement = Measurement.from_metadata(record.metadata)
    window = measurement.window(start)
    joints = joint_columns(record.joint_states or ())
    refuse_folded(joints)
    scored = score(*record.velocity, window, block=measurement.block, largest_speed=measurement.largest_speed)
    check_swim(*record.velocity, window, measurement)
    wanted = {MEAN_SPEED: MEASURES[MEAN_SPEED], **{each.name: each for each in asked}}.values()
    figures = Figures(
        scored, record.velocity, record.velocity_messages, joints, record.thrust, window, measurement.block
    )
    measured = figures.of(wanted)
    _check_reaches_end(record.velocity[0], window, "velocity")
    needs = {need for each in wanted for need in each.needs}
    if SERVO_TORQUE in needs:
        _check_reaches_end(np.concatenate([each.stamps for each in joints]), window, "joint_states")
    if THRUST in needs:
        _check_reaches_end(np.array([header_stamp(record.thrust[-1])]), window, "thrust")
    return scored, measured


def refuse_folded(joints: Sequence[Joints]) -> None:
    """Refuse a swim whose joints tell of a fin that folded; a robot's tell of no hinge.

    Raises:
        ScoreError: A hinge bent further than a fin can.
    """
    bends = (validity.largest_hinge_angle(each.names, np.abs(each.position).max(axis=0)) for each in joints)
    if reason := validity.folded(max(bends, default=0.0)):
        raise ScoreError(reason)


def _check_reaches_end(stamps: NDArray[np.int64], window: Window, topic: str) -> None:
    """Look whether a topic's messages go on to the window's end, as those of a trial do before it is scored.

    Args:
        stamps: Header stamps in ns, shape (n,), of those that gave a mean over the window: there are some.
        window: What counts.
        topic: For the message.

    Raises:
        ScoreError: They do not: the rest was lost, in a kill for example, and a score without it is another one.
    """
    newest = int(stamps.max())
    if newest < window.end_ns:
        missing = (window.end_ns - newest) / NANOSECONDS
        msg = f"{topic} ends {missing:.3g} s before the window does: the rest of the swim was not recorded, or was lost"
        raise ScoreError(msg)
