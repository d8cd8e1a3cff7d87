"""What one file of a bag holds, MCAP or SQLite: its topics, its messages, and how far it is whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mcap.records import Channel, Message, Schema
from zstandard import ZstdError

from fin_optimizer.bags.files import RecordedTopic, mcap_content, plain, reading, sqlite_messages, sqlite_topics
from fin_optimizer.bags.integrity import MAGIC_SIZE, Findings
from fin_optimizer.bags.mcap_records import goes_on, records, whole_records
from fin_optimizer.bags.messages import BagError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path


@dataclass(frozen=True)
class Contents:
    """What one file of a bag holds; topics with the number of their messages."""

    topics: Sequence[tuple[RecordedTopic, int]]
    metadata: Mapping[str, str]
    complete: bool
    whole_bytes: int
    guarded: bool


def contents_of(file: Path) -> Contents:
    """Return what a file holds.

    Raises:
        BagError: It cannot be read, or is damaged.
    """
    content = _content(file)
    if content is None:
        with reading(file):
            return Contents(sqlite_topics(file), {}, complete=True, whole_bytes=file.stat().st_size, guarded=False)
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
    return Contents(topics, found.trial or {}, complete, length, guarded)


def _recorded(channel: Channel, schemas: Mapping[int, str]) -> RecordedTopic:
    qos = channel.metadata.get("offered_qos_profiles", "")
    return RecordedTopic(channel.topic, schemas.get(channel.schema_id, ""), channel.message_encoding, qos)


def messages_of(file: Path) -> Iterator[tuple[str, int, bytes]]:
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


def plain_message(file: Path, topic: str, data: bytes) -> bytes:
    """Return a message's bytes without the compression that some writers give each message.

    Raises:
        BagError: They are damaged.
    """
    try:
        return plain(data)
    except ZstdError as error:
        msg = f"bag {file} is damaged: a compressed message of {topic}: {error}; its messages cannot be trusted"
        raise BagError(msg) from error
