"""Serialised JointStates as columns of numbers. Those of one plant are alike, so they are read all at once."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.bags.messages import decode, header_stamp

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
_LITTLE_ENDIAN = b"\x00\x01"
_ENCAPSULATION = 4  # bytes, from whose end on everything is aligned (OMG CDR 1.1, section 9.3.1.1)
_STAMP_END = 12
_COUNT = struct.Struct("<I")


@dataclass(frozen=True)
class Joints:
    """What n messages tell of the same joints.

    Attributes:
        stamps: Header stamps in ns, shape (n,).
        names: Of the joints.
        position: In rad, shape (n, number told), like the others.
        velocity: In rad/s.
        effort: In N m.
    """

    stamps: NDArray[np.int64]
    names: Sequence[str]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]


def joint_columns(messages: Sequence[bytes]) -> list[Joints]:
    """Return what serialised JointStates tell, in their order: one entry if all are alike, else one a message.

    Raises:
        BagError: One is no JointState.
    """
    if not messages:
        return []
    first = decode(messages[0], JOINT_STATE_TYPE)
    alike = _read_alike(messages, first)
    return [alike] if alike is not None else [_decoded(data) for data in messages]


def _decoded(data: bytes) -> Joints:
    message = decode(data, JOINT_STATE_TYPE)
    numbers = (np.array([told], dtype=np.float64) for told in (message.position, message.velocity, message.effort))
    return Joints(np.array([header_stamp(data)], dtype=np.int64), tuple(message.name), *numbers)


def _read_alike(messages: Sequence[bytes], first: Any) -> Joints | None:
    """Return what the messages tell if they differ from the first in nothing but stamp and numbers, else None."""
    length = len(messages[0])
    places = _places(messages[0], first)
    if places is None or any(len(data) != length for data in messages):
        return None
    block = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(len(messages), length)
    same = np.ones(length, dtype=bool)
    same[_ENCAPSULATION:_STAMP_END] = False
    for place in places:
        same[place] = False
    if not (block[:, same] == block[0, same]).all():
        return None
    stamps = np.fromiter(map(header_stamp, messages), dtype=np.int64, count=len(messages))
    numbers = (np.ascontiguousarray(block[:, place]).view("<f8").astype(np.float64) for place in places)
    return Joints(stamps, tuple(first.name), *numbers)


def _places(data: bytes, message: Any) -> list[slice] | None:
    """Return where position, velocity and effort stand in a serialised message; None if that is not plain."""
    if data[:2] != _LITTLE_ENDIAN:
        return None
    texts = [message.header.frame_id, *message.name]
    at = _STAMP_END
    for index, text in enumerate(texts):
        at = _aligned(at, 4) + _COUNT.size + len(text.encode()) + 1
        if index == 0:  # of the names comes their number first
            at = _aligned(at, 4) + _COUNT.size
    places = []
    for told in (message.position, message.velocity, message.effort):
        at = _aligned(at, 4) + _COUNT.size
        start = _aligned(at, 8) if len(told) else at
        at = start + 8 * len(told)
        if data[start:at] != np.asarray(told, dtype="<f8").tobytes():
            return None
        places.append(slice(start, at))
    return places if len(data) - at < _COUNT.size else None


def _aligned(at: int, size: int) -> int:
    return at + (_ENCAPSULATION - at) % size
