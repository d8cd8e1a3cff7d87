"""Bags of invented swims, as the optimiser records them."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fin_optimizer.bags.messages import message_types
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.score.mean_speed import Measurement

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 100


def quality(durability: QosDurability = QosDurability.VOLATILE) -> Qos:
    """Return what a plant offers."""
    none = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST,
        1000,
        QosReliability.RELIABLE,
        durability,
        none,
        none,
        QosLiveliness.AUTOMATIC,
        none,
        avoid_ros_namespace_conventions=False,
    )


VELOCITY = BagTopic("/fish/velocity", "geometry_msgs/msg/TwistStamped", quality())
STATE = BagTopic("/fish/plant_state", "diagnostic_msgs/msg/DiagnosticStatus", quality(QosDurability.TRANSIENT_LOCAL))
JOINTS = BagTopic("/fish/joint_states", "sensor_msgs/msg/JointState", quality())
GAIT = BagTopic("/fish/gait", "std_msgs/msg/Float64MultiArray", quality())


def velocity(stamp: int, forward: float) -> bytes:
    """Return a serialised TwistStamped."""
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), "base_link")
    vector = types["geometry_msgs/msg/Vector3"]
    twist = types["geometry_msgs/msg/Twist"](vector(forward, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    message = types[VELOCITY.type_name](header, twist)
    return bytes(message_types().serialize_cdr(message, VELOCITY.type_name))


def joint_states(stamp: int, torque: float, rate: float) -> bytes:
    """Return a serialised JointState of a tail with one servo."""
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), "")
    numbers = (np.array([value]) for value in (0.1, rate, torque))
    message = types[JOINTS.type_name](header, ["tail_joint_1"], *numbers)
    return bytes(message_types().serialize_cdr(message, JOINTS.type_name))


def state(name: str, stamp: int, **details: str) -> bytes:
    """Return a serialised plant_state; two underscores in a detail's name stand for its dot."""
    types = message_types().types
    said = {"stamp_ns": str(stamp), **{name.replace("__", "."): value for name, value in details.items()}}
    values = [types["diagnostic_msgs/msg/KeyValue"](key, value) for key, value in said.items()]
    status = types[STATE.type_name](0, "plant_state", name, "simulator", values)
    return bytes(message_types().serialize_cdr(status, STATE.type_name))


def gait(amplitude: float = 0.3) -> bytes:
    """Return a serialised gait without layout."""
    types = message_types().types
    message = types[GAIT.type_name](types["std_msgs/msg/MultiArrayLayout"]([], 0), np.array([amplitude, 1.0, 0.0, 0.0]))
    return bytes(message_types().serialize_cdr(message, GAIT.type_name))


def write_swim(path: Path, duration: float = 2.0, metadata: Mapping[str, str] = MappingProxyType({})) -> Path:
    """Write the bag of a whole trial from rest, 100 velocities a second, some chunks long; return its folder."""
    told = {"trial.number": "7", **Measurement(duration=duration).metadata(), **metadata}
    with BagWriter(path, (VELOCITY, STATE, GAIT), told) as writer:
        writer.write(STATE.name, state("READY", START - SECOND))
        writer.write(STATE.name, state("SWIMMING", START))
        writer.write(GAIT.name, gait())
        for index in range(round(duration * 100) + 1):
            speed = 0.15 * math.tanh(index / 20) + 0.01 * math.sin(index)
            writer.write(VELOCITY.name, velocity(START + index * STEP, speed))
            if index % 20 == 0:
                writer.flush()
        writer.write(STATE.name, state("READY", START + round(duration * SECOND)))
    return path
