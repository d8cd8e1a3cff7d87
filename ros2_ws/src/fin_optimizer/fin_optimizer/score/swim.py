"""A whole swim: where it starts, what its servos spend, and its score."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.bags.messages import decode, header_stamp
from fin_optimizer.score.mean_speed import (
    Measurement,
    NotThisSwimError,
    Score,
    ScoreError,
    Window,
    check_swim,
    mean_power,
    score,
)
from fin_plant import validity
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    _Scored = tuple[Path, Mapping[str, float], Mapping[str, str]]
    """A bag, what its trial achieved by name and unit, and its metadata."""


_STAMP_KEY = "stamp_ns"  # as fin_plant.messages writes it; that module needs ROS, which a bag does not


_FIN = "fin."


JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"


_DRIVEN = "tail_joint"
"""What the names of the driven joints start with; the fin's own hinges are springs and take no power from a servo."""


def start_of_swim(states: Iterable[Any], metadata: Mapping[str, str]) -> int:
    """Return the plant's time in ns at which the gait of a trial started.

    Args:
        states: All messages of its ``plant_state``.
        metadata: Of its bag; the entries ``fin.*`` tell which fin it is about.

    Raises:
        ScoreError: The plant started to swim never, more than once, with another fin, or did not say when.
    """
    fin = {name: value for name, value in metadata.items() if name.startswith(_FIN)}
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


def power_samples(messages: Sequence[bytes]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and the tail servos' mechanical power in W, both (n,), of serialised JointStates.

    The power is NaN where a message does not tell it.
    """
    stamps = np.fromiter(map(header_stamp, messages), dtype=np.int64, count=len(messages))
    power = np.fromiter((_power(decode(data, JOINT_STATE_TYPE)) for data in messages), np.float64, len(messages))
    return stamps, power


def tail_angle(message: bytes) -> float:
    """Return the largest angle in rad of the driven joints in a serialised JointState; 0 without any."""
    joints = decode(message, JOINT_STATE_TYPE)
    pairs = zip(joints.name, joints.position, strict=False)
    return max((abs(float(angle)) for name, angle in pairs if name.startswith(_DRIVEN)), default=0.0)


def refuse_folded(messages: Iterable[bytes]) -> None:
    """Refuse a swim whose JointStates tell of a fin that folded; a robot's tell of no hinge.

    Raises:
        ScoreError: A hinge bent further than a fin can.
    """
    bends = (validity.largest_hinge_angle(joints.name, joints.position) for joints in _decoded_joints(messages))
    reason = validity.folded(max(bends, default=0.0))
    if reason:
        raise ScoreError(reason)


def _decoded_joints(messages: Iterable[bytes]) -> Iterator[Any]:
    """Decode JointStates as long as they tell of hinges."""
    for data in messages:
        joints = decode(data, JOINT_STATE_TYPE)
        if not any(name.startswith(validity.HINGE) for name in joints.name):
            return
        yield joints


def _power(joints: Any) -> float:
    driven = [index for index, name in enumerate(joints.name) if name.startswith(_DRIVEN)]
    if not driven or len(joints.effort) != len(joints.name) or len(joints.velocity) != len(joints.name):
        return float("nan")
    return float(sum(joints.effort[index] * joints.velocity[index] for index in driven))


def scored_swim(
    velocity: tuple[NDArray[np.int64], NDArray[np.float64]],
    joint_states: Sequence[bytes] | None,
    window: Window,
    measurement: Measurement,
) -> tuple[Score, float | None]:
    """Return the score of a swim and its energy per metre in J/m.

    The cost is the servos' mean mechanical power over the mean speed: energy for a metre of way. None without
    headway, where there is no such thing, and where it is not asked for.

    Args:
        velocity: Header stamps in ns and forward speeds in m/s, both (n,).
        joint_states: Serialised messages, None if the energy per metre is not asked for.
        window: What counts.
        measurement: How it was measured.

    Raises:
        ScoreError: The samples give no score, or no power; or they are those of no swim from rest.
    """
    scored = score(*velocity, window, block=measurement.block, largest_speed=measurement.largest_speed)
    check_swim(*velocity, window, measurement)
    if joint_states is None:
        return scored, None
    power = mean_power(*power_samples(joint_states), window)
    return scored, power / scored.value if scored.value > 0.0 else None
