"""Serialised messages without ROS: their types, their header stamps, the velocities in them."""

from __future__ import annotations

import re
import struct
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
import yaml
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore
if TYPE_CHECKING:
    _Dumper = yaml.SafeDumper
else:  # libyaml's own where it is there: every trial writes two texts of some kilobytes, and it is ten times as fast
    _Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def without_name(reason: object, path: Path) -> str:
    """Return what is said of a bag for a line that has its name already: *it is empty* of *bag PATH is empty*."""
    return re.sub(rf"\A(bag )?{re.escape(str(path))} ", "it ", str(reason))


class BagError(RuntimeError):
    """A bag cannot be written or read; ``reason`` says which, why, and what to do."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class TwistStampedLike(Protocol):
    """The part of a decoded geometry_msgs/TwistStamped that a score needs."""

    header: Any
    twist: Any


@cache
def message_types() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def definition(type_name: str) -> bytes:
    """Return the text that defines a message type, with those that it contains, as MCAP stores it."""
    return message_types().generate_msgdef(type_name, ros_version=2)[0].encode()


@cache
def type_hash(type_name: str) -> str:
    """Return the hash by which ROS 2 knows a message type."""
    return message_types().hash_rihs01(type_name)


def is_known(type_name: str) -> bool:
    """Return whether ROS 2 Jazzy defines a message type."""
    return type_name in message_types().fielddefs


def has_header(type_name: str) -> bool:
    """Return whether messages of that type start with a std_msgs/Header."""
    fields = message_types().fielddefs[type_name][1]
    return bool(fields) and fields[0][1][1] == _HEADER_TYPE


def tells_plants_time(type_name: str) -> bool:
    """Return whether messages of that type have a header with the plant's time; health is stamped by each node."""
    return has_header(type_name) and type_name != HEALTH_TYPE


def header_stamp(data: bytes) -> int:
    """Return the header stamp in ns of a serialised message that starts with a std_msgs/Header.

    Raises:
        BagError: Fewer bytes than a header has.
    """
    if len(data) < _STAMP_END:
        msg = f"message of {len(data)} bytes is too short for a header, which needs {_STAMP_END}"
        raise BagError(msg)
    byte_order = _LITTLE_ENDIAN if data[1] & 1 else _BIG_ENDIAN
    seconds, nanoseconds = byte_order.unpack_from(data, 4)
    return int(seconds * NANOSECONDS + nanoseconds)


def shift_header(data: bytes, later: int) -> bytes:
    """Return a serialised message that starts with a std_msgs/Header, its stamp so many ns later.

    Raises:
        BagError: Fewer bytes than a header has.
    """
    seconds, nanoseconds = divmod(header_stamp(data) + later, NANOSECONDS)
    byte_order = _LITTLE_ENDIAN if data[1] & 1 else _BIG_ENDIAN
    return data[:4] + byte_order.pack(min(seconds, _LAST_SECOND), nanoseconds) + data[_STAMP_END:]


def decode(data: bytes, type_name: str) -> Any:
    """Return the message that serialised bytes hold.

    Raises:
        BagError: They hold no message of that type.
    """
    try:
        return message_types().deserialize_cdr(data, type_name)
    except SerdeError as error:
        msg = f"a message of {len(data)} bytes is no {type_name}: {error}"
        raise BagError(msg) from error


def velocity_samples(messages: Sequence[bytes]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and forward speeds in m/s, both (n,), of serialised TwistStamped."""
    stamps = np.fromiter(map(header_stamp, messages), dtype=np.int64, count=len(messages))
    twists = (cast("TwistStampedLike", decode(data, VELOCITY_TYPE)) for data in messages)
    speeds = np.fromiter((item.twist.linear.x for item in twists), dtype=np.float64, count=len(messages))
    return stamps, speeds


def yaw_rate_samples(messages: Sequence[bytes]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and yaw rates in rad/s, both (n,), of serialised TwistStamped."""
    stamps = np.fromiter(map(header_stamp, messages), dtype=np.int64, count=len(messages))
    twists = (cast("TwistStampedLike", decode(data, VELOCITY_TYPE)) for data in messages)
    return stamps, np.fromiter((item.twist.angular.z for item in twists), dtype=np.float64, count=len(messages))


VELOCITY_TYPE, WRENCH_TYPE = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/WrenchStamped"
HEALTH_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
_HEADER_TYPE = "std_msgs/msg/Header"
_STAMP_END = 12  # bytes: 4 of CDR encapsulation, 4 of seconds, 4 of nanoseconds
_LAST_SECOND = 2**31 - 1  # that a ROS time holds
_LITTLE_ENDIAN, _BIG_ENDIAN = struct.Struct("<iI"), struct.Struct(">iI")
