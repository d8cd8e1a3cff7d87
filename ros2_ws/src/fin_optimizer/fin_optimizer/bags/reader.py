"""Reads bags of trials, also those that a kill left open, without ROS."""

from __future__ import annotations

import io
import os
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mcap.exceptions import EndOfFile
from mcap.records import Channel, Header, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from zstandard import ZstdError

from fin_optimizer.bags.files import (
    RecordedTopic,
    bag_files,
    information,
    mcap_content,
    plain,
    reading,
    sqlite_messages,
    sqlite_topics,
)
from fin_optimizer.bags.integrity import MAGIC_SIZE, Findings, check_information
from fin_optimizer.bags.mcap_records import DAMAGE, goes_on, records, whole_records
from fin_optimizer.bags.messages import VELOCITY_TYPE, BagError, decode, velocity_samples
from fin_optimizer.bags.writer import LIBRARY

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

_LONGEST_HEADER = 1024  # bytes from the file's beginning; ROS 2 and the optimiser write some sixty


@dataclass(frozen=True)
class Bag:
    """A bag on the disk; its messages are read when asked for.

    Attributes:
        path: Its first file.
        files: All of its files, in the order of their recording.
        metadata: What describes the trial.
        topics: Message type by absolute topic name.
        qos: What the publishers offered, as YAML, by absolute topic name; see `offered`.
        counts: Number of messages by absolute topic name.
        left_out: Why the messages of a topic cannot be read, by absolute name of those topics.
        complete: Whether it was closed. If not, the last moments before a kill are missing.
        whole_bytes: Length of the last file up to where a kill or a power cut took the rest.
        guarded: Whether check sums guard all that a score needs, see `fin_optimizer.bags.integrity`.
    """

    path: Path
    files: tuple[Path, ...]
    metadata: Mapping[str, str]
    topics: Mapping[str, str]
    qos: Mapping[str, str]
    counts: Mapping[str, int]
    left_out: Mapping[str, str]
    complete: bool
    whole_bytes: int
    guarded: bool

    @property
    def name(self) -> Path:
        """Its folder as `read_bag` found it, or its file where the folder holds others too."""
        return self.path.parent if _is_alone(self.files) else self.path

    def topic(self, name: str) -> str:
        """Return the absolute name of the topic that is called ``name`` or ends with ``/name``.

        Raises:
            BagError: There is none, there are several, or it cannot be read.
        """
        found = [topic for topic in self.topics if topic == name or topic.endswith(f"/{name}")]
        if len(found) != 1:
            known = ", ".join(found or self.topics) or "none at all"
            unreadable = "".join(f"; {topic} is left out: {why}" for topic, why in self.left_out.items())
            msg = f"bag {self.path} has {len(found)} topics {name!r}, needed is one: it has {known}{unreadable}"
            raise BagError(msg)
        return found[0]

    def offered(self, name: str) -> Qos:
        """Return what the publishers of a topic offered, where it is not told what suits every listener.

        Of several offers that differ the stronger one is taken, with which every listener can be content.

        Raises:
            BagError: No such topic.
        """
        topic = self.topic(name)
        try:
            return _strongest(parse_qos(self.qos[topic]))
        except (ReaderError, LookupError, TypeError, ValueError, AttributeError):
            return _NOT_TOLD

    def messages(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield absolute topic, log time in ns and serialised message of the topics, in the order of their recording.

        Raises:
            BagError: No such topic, or damaged bytes.
        """
        wanted = {self.topic(name) for name in names}
        for file in self.files:
            for topic, log_time, data in _messages(file):
                if topic in wanted:
                    yield topic, log_time, _plain_message(file, topic, data)

    def decoded(self, name: str, type_name: str | None = None) -> Iterator[tuple[int, Any]]:
        """Yield log time in ns and decoded message of one topic, which must have the given type.

        Raises:
            BagError: No such topic, another type, or damaged bytes.
        """
        kind = self._type_of(name, type_name)
        for _, log_time, data in self.messages(name):
            yield log_time, decode(data, kind)

    def typed(self, name: str, type_name: str) -> list[bytes]:
        """Return the serialised messages of one topic, which must have the given type.

        Raises:
            BagError: No such topic, another type, or damaged bytes.
        """
        self._type_of(name, type_name)
        return [data for _, _, data in self.messages(name)]

    def velocity(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return header stamps in ns and forward speeds in m/s of ``velocity``, both (n,).

        Raises:
            BagError: No such topic, another type, or damaged bytes.
        """
        return velocity_samples(self.typed("velocity", VELOCITY_TYPE))

    def _type_of(self, name: str, needed: str | None) -> str:
        topic = self.topic(name)
        if needed not in {None, self.topics[topic]}:
            msg = f"topic {topic} of bag {self.path} is {self.topics[topic]}, needed is {needed}"
            raise BagError(msg)
        return self.topics[topic]


_NO_TIME = QosTime(0, 0)
_USUAL_DEPTH = 1000  # as a plant offers it: room for all that a fast player has on its way
_NOT_TOLD = Qos(
    QosHistory.KEEP_LAST,
    _USUAL_DEPTH,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    _NO_TIME,
    _NO_TIME,
    QosLiveliness.AUTOMATIC,
    _NO_TIME,
    avoid_ros_namespace_conventions=False,
)


def _strongest(offers: Sequence[Qos]) -> Qos:
    """Return one offer for several; a recorder learns no history over the network, so most bags lack it."""
    if not offers:
        return _NOT_TOLD
    offer = offers[0]
    weak = all(item.reliability is QosReliability.BEST_EFFORT for item in offers)
    latched = any(item.durability is QosDurability.TRANSIENT_LOCAL for item in offers)
    offer = offer._replace(
        reliability=QosReliability.BEST_EFFORT if weak else QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
    )
    depth = max(item.depth for item in offers)
    if any(item.history is QosHistory.KEEP_ALL for item in offers):
        return offer._replace(history=QosHistory.KEEP_ALL)
    return offer._replace(history=QosHistory.KEEP_LAST, depth=depth if depth > 0 else _USUAL_DEPTH)


def read_bag(path: Path) -> Bag:
    """Return the bag in a folder (or in a file), also one that a kill left open, and one of another program.

    Raises:
        BagError: There is no bag, or its bytes are damaged.
    """
    files = bag_files(path)
    contents = [_contents(file) for file in files]
    for file, content in zip(files[:-1], contents[:-1], strict=True):
        if not content.complete:
            msg = f"bag {file} is cut off, and the recording goes on in {files[-1].name}: what was between is missing"
            raise BagError(msg)
    topics: dict[str, str] = {}
    left_out: dict[str, str] = {}
    qos: dict[str, str] = {}
    counts: dict[str, int] = {}
    for content in contents:
        for topic, count in content.topics:
            if why := _unreadable(topic, topics):
                left_out[topic.name] = why
                continue
            topics[topic.name] = _full_type(topic.type_name)
            qos[topic.name] = qos.get(topic.name) or topic.qos
            counts[topic.name] = counts.get(topic.name, 0) + count
    readable = topics.keys() - left_out.keys()
    if left_out and not readable:
        msg = f"bag {files[0]}: {'; '.join(f'topic {topic} {why}' for topic, why in left_out.items())}"
        raise BagError(msg)
    said = information(files[0].parent)
    told = next((content.metadata for content in contents if content.metadata), None)
    complete = all(content.complete for content in contents)
    if tuple(said.files) == tuple(file.name for file in files):
        held = Counter[str]()
        for topic, count in (item for content in contents for item in content.topics):
            held[topic.name] += count
        check_information(files[0], said, held, told, complete=complete)
    return Bag(
        path=files[0],
        files=files,
        metadata=dict(said.custom_data) if told is None else told,
        topics={name: kind for name, kind in topics.items() if name in readable},
        qos=qos,
        counts={name: count for name, count in counts.items() if name in readable},
        left_out=left_out,
        complete=complete,
        whole_bytes=contents[-1].whole_bytes,
        guarded=all(content.guarded for content in contents),
    )


def _unreadable(topic: RecordedTopic, known: Mapping[str, str]) -> str:
    """Return why the messages of a topic cannot be read, or an empty text."""
    if not topic.type_name:
        return "has no message type: ROS 2 did not record it"
    if topic.encoding != "cdr":
        return f"is serialised as {topic.encoding!r}, needed is 'cdr'"
    before = known.get(topic.name, "")
    if before and before != _full_type(topic.type_name):
        return f"has two message types, {before} and {topic.type_name}"
    return ""


def _full_type(name: str) -> str:
    """Return a message type with the part that some writers leave out: ``std_msgs/msg/Header``."""
    package, _, rest = name.partition("/")
    return name if not rest or "/" in rest else f"{package}/msg/{rest}"


def _is_alone(files: tuple[Path, ...]) -> bool:
    try:
        return bag_files(files[0].parent) == files
    except BagError:
        return False


def _plain_message(file: Path, topic: str, data: bytes) -> bytes:
    try:
        return plain(data)
    except ZstdError as error:
        msg = f"bag {file} is damaged: a compressed message of {topic}: {error}; its messages cannot be trusted"
        raise BagError(msg) from error


@dataclass(frozen=True)
class _Contents:
    """What one file of a bag holds; topics with the number of their messages."""

    topics: Sequence[tuple[RecordedTopic, int]]
    metadata: Mapping[str, str]
    complete: bool
    whole_bytes: int
    guarded: bool


def _contents(file: Path) -> _Contents:
    content = _content(file)
    if content is None:
        with reading(file):
            return _Contents(sqlite_topics(file), {}, complete=True, whole_bytes=file.stat().st_size, guarded=False)
    found = Findings(file)
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in records(file, content):
        if isinstance(record, Message) and record.channel_id not in channels:
            msg = f"bag {file} is damaged: a message of channel {record.channel_id}, which is not described"
            raise BagError(msg)
        found.note(record)
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record
    topics = [(_recorded(channel, schemas), found.counts[number]) for number, channel in channels.items()]
    _, length, complete = whole_records(content)
    if not complete and goes_on(content, length):
        msg = f"bag {file} is damaged at byte {length}, and goes on behind that; its messages cannot be trusted"
        raise BagError(msg)
    guarded = found.check(content[:length], complete=complete)
    return _Contents(topics, found.trial or {}, complete, length, guarded)


def _recorded(channel: Channel, schemas: Mapping[int, str]) -> RecordedTopic:
    qos = channel.metadata.get("offered_qos_profiles", "")
    return RecordedTopic(channel.topic, schemas.get(channel.schema_id, ""), channel.message_encoding, qos)


def _messages(file: Path) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, log time in ns and recorded bytes of a file's messages.

    Raises:
        BagError: It cannot be read, or is damaged.
    """
    content = _content(file)
    if content is None:
        with reading(file):
            yield from sqlite_messages(file)
        return
    channels: dict[int, str] = {}
    for record in records(file, content):
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            yield channels[record.channel_id], record.log_time, record.data


def _content(file: Path) -> bytes | None:
    """Return the plain bytes of an MCAP file, None for a SQLite file.

    Raises:
        BagError: It is neither, damaged, or cannot be read.
    """
    try:
        with reading(file):
            content = mcap_content(file)
    except ZstdError as error:
        msg = f"bag {file} is damaged: {error}; its messages cannot be trusted"
        raise BagError(msg) from error
    if content is not None and len(content) <= MAGIC_SIZE:
        msg = f"bag {file} is empty: it was cut off before anything was written"
        raise BagError(msg)
    return content


def bag_metadata(path: Path) -> dict[str, str]:
    """Return what describes the trial of a bag.

    Raises:
        BagError: There is no bag, or its bytes are damaged.
    """
    return dict(read_bag(path).metadata)


def read_velocity(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and forward speeds in m/s of a bag's ``velocity``, both (n,).

    Raises:
        BagError: There is no bag or no such topic, or its bytes are damaged.
    """
    return read_bag(path).velocity()


def mcap_file(path: Path) -> Path:
    """Return the one MCAP file that a path means, as the optimiser records them.

    Raises:
        BagError: There is no bag, or one of another program.
    """
    files = bag_files(path)
    count = len(list(path.glob("*.mcap"))) if path.is_dir() else 1
    if len(files) > 1 or count != 1:
        msg = f"bag {path} is {count} MCAP files among {len(files)}, and one is needed"
        raise BagError(msg)
    return files[0]


def is_own(path: Path) -> bool:
    """Return whether the optimiser recorded a bag; one that was cut off before it could say so counts.

    Raises:
        BagError: There is no bag, or it cannot be read.
    """
    files = bag_files(path)
    if len(files) > 1 or files[0].suffix != ".mcap":
        return False
    with reading(path), files[0].open("rb") as file:
        begin = io.BytesIO(file.read(_LONGEST_HEADER))
    if len(begin.getvalue()) <= MAGIC_SIZE:
        return True
    try:
        first = next(iter(StreamReader(begin).records))
    except EndOfFile:
        return True
    except DAMAGE:
        return False
    return isinstance(first, Header) and first.library.startswith(LIBRARY)


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
