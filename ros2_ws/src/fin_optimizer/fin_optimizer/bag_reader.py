"""Reads bags of trials, also those that a kill left open, without ROS."""

from __future__ import annotations

import io
import os
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from zstandard import ZstdError

from fin_optimizer.bag import TRIAL_RECORD, VELOCITY_TYPE, BagError, decode, velocity_samples

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy as np
    from mcap.records import McapRecord
    from numpy.typing import NDArray
    from rosbags.interfaces import Qos

_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, UnicodeDecodeError)
"""What reading damaged bytes raises."""
MAGIC_SIZE = 8
_RECORD_HEAD = struct.Struct("<BQ")  # an MCAP record's opcode and length


@dataclass(frozen=True)
class Bag:
    """A bag on the disk; its messages are read when asked for.

    Attributes:
        path: The MCAP file.
        metadata: What describes the trial.
        topics: Message type by absolute topic name.
        qos: What the publishers offered, as YAML, by absolute topic name; see `offered`.
        counts: Number of messages by absolute topic name.
        complete: Whether it was closed. If not, the last moments before a kill are missing.
        whole_bytes: Length of the file up to where a kill or a power cut took the rest.
    """

    path: Path
    metadata: Mapping[str, str]
    topics: Mapping[str, str]
    qos: Mapping[str, str]
    counts: Mapping[str, int]
    complete: bool
    whole_bytes: int

    def topic(self, name: str) -> str:
        """Return the absolute name of the topic that is called ``name`` or ends with ``/name``.

        Raises:
            BagError: There is none, or there are several.
        """
        found = [topic for topic in self.topics if topic == name or topic.endswith(f"/{name}")]
        if len(found) != 1:
            known = ", ".join(found or self.topics) or "none at all"
            msg = f"bag {self.path} has {len(found)} topics {name!r}, needed is one: it has {known}"
            raise BagError(msg)
        return found[0]

    def offered(self, name: str) -> Qos:
        """Return what the publisher of a topic offered.

        Raises:
            BagError: No such topic, or the bag does not say.
        """
        topic = self.topic(name)
        try:
            return parse_qos(self.qos[topic])[0]
        except (ReaderError, LookupError, TypeError) as error:
            msg = f"bag {self.path} does not tell the quality of service of {topic}: {error}"
            raise BagError(msg) from error

    def messages(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield absolute topic, log time in ns and serialised message of the topics, in the order of their recording.

        Raises:
            BagError: No such topic, or damaged bytes.
        """
        wanted = {self.topic(name) for name in names}
        channels: dict[int, str] = {}
        for record in _records(self.path):
            if isinstance(record, Channel) and record.topic in wanted:
                channels[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id in channels:
                yield channels[record.channel_id], record.log_time, record.data

    def decoded(self, name: str) -> Iterator[tuple[int, Any]]:
        """Yield log time in ns and decoded message of one topic.

        Raises:
            BagError: No such topic, or damaged bytes.
        """
        type_name = self.topics[self.topic(name)]
        for _, log_time, data in self.messages(name):
            yield log_time, decode(data, type_name)

    def velocity(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return header stamps in ns and forward speeds in m/s of ``velocity``, both (n,).

        Raises:
            BagError: No such topic, another type, or damaged bytes.
        """
        name = self.topic("velocity")
        if self.topics[name] != VELOCITY_TYPE:
            msg = f"topic {name} of bag {self.path} is {self.topics[name]}, needed is {VELOCITY_TYPE}"
            raise BagError(msg)
        return velocity_samples([data for _, _, data in self.messages(name)])


def read_bag(path: Path) -> Bag:
    """Return the bag in a folder (or an MCAP file), also one that a kill left open.

    Raises:
        BagError: There is no bag, or its bytes are damaged.
    """
    file = mcap_file(path)
    metadata: dict[str, str] = {}
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    counts: dict[int, int] = {}
    for record in _records(file):
        if isinstance(record, Message):
            counts[record.channel_id] += 1
        elif isinstance(record, Metadata) and record.name == TRIAL_RECORD:
            metadata = record.metadata
        elif isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            if record.schema_id not in schemas:
                msg = f"bag {file}: topic {record.topic} has no message type: ROS 2 did not record it"
                raise BagError(msg)
            channels[record.id] = record
            counts.setdefault(record.id, 0)
    _, length, complete = _whole_records(file)
    return Bag(
        path=file,
        metadata=metadata,
        topics={channel.topic: schemas[channel.schema_id] for channel in channels.values()},
        qos={channel.topic: channel.metadata.get("offered_qos_profiles", "") for channel in channels.values()},
        counts={channel.topic: counts[number] for number, channel in channels.items()},
        complete=complete,
        whole_bytes=length,
    )


def bag_metadata(path: Path) -> dict[str, str]:
    """Return what describes the trial of a bag.

    Raises:
        BagError: There is no bag, or its bytes are damaged.
    """
    for record in _records(mcap_file(path)):
        if isinstance(record, Metadata) and record.name == TRIAL_RECORD:
            return record.metadata
    return {}


def read_velocity(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and forward speeds in m/s of a bag's ``velocity``, both (n,).

    Raises:
        BagError: There is no bag or no such topic, or its bytes are damaged.
    """
    return read_bag(path).velocity()


def mcap_file(path: Path) -> Path:
    """Return the one MCAP file that a path means."""
    if path.is_file():
        return path
    files = sorted(path.glob("*.mcap")) if path.is_dir() else []
    if len(files) != 1:
        what = f"{len(files)} MCAP files" if path.is_dir() else "neither folder nor file"
        msg = f"{path} is no bag of a trial: it is {what}; give the folder that holds one .mcap file"
        raise BagError(msg)
    return files[0]


def is_closed(path: Path) -> bool:
    """Return whether the bag in a folder was closed: its file has its end, and ``metadata.yaml`` is there.

    Raises:
        BagError: There is no bag, or it cannot be read.
    """
    file = mcap_file(path)
    try:
        return file.with_name("metadata.yaml").exists() and _ends_as_closed(file)
    except OSError as error:
        msg = f"cannot read bag {path}: {error.strerror or error}"
        raise BagError(msg) from error


def _ends_as_closed(file: Path) -> bool:
    """Look at the last bytes alone: a study has thousands of bags."""
    with file.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - MAGIC_SIZE))
        return size > 2 * MAGIC_SIZE and stream.read() == MCAP0_MAGIC


def _check_begun(path: Path) -> None:
    if path.stat().st_size <= MAGIC_SIZE:
        msg = f"bag {path} is empty: it was cut off before anything was written"
        raise BagError(msg)


def _whole_records(path: Path) -> tuple[int, int, bool]:
    """Return where a file's messages end and where its whole records end, in bytes, and whether it was closed.

    A power cut can leave zeros where data were not yet written, also inside the last chunk of a file that was not
    closed: its messages end before such a chunk, and otherwise with the last one, whatever its index looks like.
    """
    size = path.stat().st_size
    end = MAGIC_SIZE
    chunk = None
    with path.open("rb") as file:
        while end + _RECORD_HEAD.size <= size:
            file.seek(end)
            opcode, length = _RECORD_HEAD.unpack(file.read(_RECORD_HEAD.size))
            after = end + _RECORD_HEAD.size + length
            if opcode == 0 or after > size:
                break
            if opcode == Opcode.CHUNK:
                chunk = end, after
            end = after
            file.seek(end)
            if opcode == Opcode.FOOTER and file.read(MAGIC_SIZE) == MCAP0_MAGIC:
                return end + MAGIC_SIZE, end + MAGIC_SIZE, True
        if chunk is None:
            return end, end, False
        file.seek(chunk[0])
        if _is_chunk(file.read(chunk[1] - chunk[0])):
            return chunk[1], end, False
    return chunk[0], chunk[0], False


def _is_chunk(data: bytes) -> bool:
    """Whether a chunk is as it was written; one without messages never is."""
    records = StreamReader(io.BytesIO(data), skip_magic=True, validate_crcs=True).records
    try:
        return any(isinstance(record, Message) for record in records)
    except _DAMAGE:
        return False


def _records(path: Path) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file up to its end or to where a kill cut it off.

    Raises:
        BagError: The file cannot be read, or bytes inside it are damaged.
    """
    try:
        _check_begun(path)
        length, _, complete = _whole_records(path)
        with path.open("rb") as file:
            content = io.BytesIO(file.read(length))
        try:
            yield from StreamReader(content, validate_crcs=True).records
        except EndOfFile:
            if complete or content.tell() < length:
                raise
    except OSError as error:
        msg = f"cannot read bag {path}: {error.strerror or error}"
        raise BagError(msg) from error
    except _DAMAGE as error:
        msg = f"bag {path} is damaged: {type(error).__name__} {error}; its messages cannot be trusted"
        raise BagError(msg) from error
