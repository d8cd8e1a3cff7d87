"""Reads bags of trials, also those that a kill left open, without ROS."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.contents import contents_of, messages_of, plain_message
from fin_optimizer.bags.files import RecordedTopic, bag_files, information
from fin_optimizer.bags.integrity import check_information
from fin_optimizer.bags.messages import VELOCITY_TYPE, BagError, decode, velocity_samples
from fin_optimizer.bags.quality import offered

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray
    from rosbags.interfaces import Qos


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
        """Return what the publishers of a topic offered; see `fin_optimizer.bags.quality.offered`.

        Raises:
            BagError: No such topic.
        """
        return offered(self.qos[self.topic(name)])

    def messages(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield absolute topic, log time in ns and serialised message of the topics, in the order of their recording.

        Raises:
            BagError: No such topic, or damaged bytes.
        """
        wanted = {self.topic(name) for name in names}
        for file in self.files:
            for topic, log_time, data in messages_of(file):
                if topic in wanted:
                    yield topic, log_time, plain_message(file, topic, data)

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


def read_bag(path: Path) -> Bag:
    """Return the bag in a folder (or in a file), also one that a kill left open, and one of another program.

    Raises:
        BagError: There is no bag, or its bytes are damaged.
    """
    files = bag_files(path)
    contents = [contents_of(file) for file in files]
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
