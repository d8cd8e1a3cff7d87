"""What a bag says of itself, compared with what it holds, so that a changed or lost byte gives no other number.

A bag of the optimiser is guarded as a whole once it is closed: MCAP's check sums of data and summary cover each byte.
While it is open, each chunk has its own, the trial record has one of ours, and messages are numbered. Bags of older
versions and of other programs have fewer of these; whatever they have is compared.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Header, Message, Metadata, Statistics

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.writer import LIBRARY, TRIAL_RECORD, TRIAL_SUM, WITH_SUMS
from fin_optimizer.checksums import CHECK_SUM, sum_of_texts

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mcap.records import McapRecord

    from fin_optimizer.bags.files import Information

MAGIC_SIZE = 8
RECORD_HEAD = struct.Struct("<BQ")  # an MCAP record's opcode and length
_FOOTER_SIZE = RECORD_HEAD.size + 20
_CRC_SIZE = 4
_CHUNK_CRC = struct.Struct("<24xI")  # behind a chunk's first and last time and its length
UNGUARDED = "recorded without check sums, by an older version or another program: a changed byte may go unnoticed"


@dataclass
class Findings:
    """What is met while the records of one MCAP file are read, for `check`.

    Attributes:
        path: The file, for errors.
        trial: The trial record, None without one.
        counts: Number of messages by channel.
    """

    path: Path
    trial: Mapping[str, str] | None = None
    counts: Counter[int] = field(default_factory=Counter)
    _library: str = ""
    _trial_sum: str | None = None
    _first: int | None = None
    _last: int = 0
    _statistics: Statistics | None = None
    _data_end: DataEnd | None = None
    _footer: Footer | None = None

    def note(self, record: McapRecord) -> None:
        """Take in a record.

        Raises:
            BagError: A message is missing before this one, or was there already.
        """
        if isinstance(record, Message):
            self._note_message(record)
        elif isinstance(record, Header):
            self._library = record.library
        elif isinstance(record, Metadata) and record.name == TRIAL_RECORD:
            self.trial = record.metadata
        elif isinstance(record, Metadata) and record.name == TRIAL_SUM:
            self._trial_sum = record.metadata.get(CHECK_SUM, "")
        elif isinstance(record, Statistics):
            self._statistics = record
        elif isinstance(record, DataEnd):
            self._data_end = record
        elif isinstance(record, Footer):
            self._footer = record

    def _note_message(self, message: Message) -> None:
        if self._is_own and message.sequence != self.counts[message.channel_id]:
            self._refuse(
                f"message {message.sequence} of channel {message.channel_id} follows "
                f"{self.counts[message.channel_id]} others"
            )
        self.counts[message.channel_id] += 1
        self._first = message.log_time if self._first is None else min(self._first, message.log_time)
        self._last = max(self._last, message.log_time)

    @property
    def _is_own(self) -> bool:
        return self._library.startswith(LIBRARY)

    def check(self, content: bytes, *, complete: bool) -> bool:
        """Compare what was read with what the file says of itself; return whether check sums guard all of it.

        Args:
            content: The whole file.
            complete: Whether it was closed.

        Raises:
            BagError: It says something else, or its check sums do not fit.
        """
        with_sums = self._library.startswith(WITH_SUMS)
        if self._is_own and self.trial is None and any(self.counts.values()):
            self._refuse("it has messages, but no trial record")
        told = self._trial_sum
        if told is not None and self.trial is not None and told != sum_of_texts(self.trial):
            self._refuse("the check sum of the trial record does not fit it")
        if with_sums and self.trial is not None and told is None:
            self._refuse("the trial record has lost its check sum")
        if complete:
            self._check_summary(content)
            self._check_statistics()
            if with_sums and not (self._data_end is not None and self._data_end.data_section_crc):
                self._refuse("it has lost the check sum of its data")
        return told is not None if self._is_own else _chunks_have_sums(content)

    def _check_summary(self, content: bytes) -> None:
        footer = self._footer
        if footer is None or not footer.summary_crc:
            if self._library.startswith(WITH_SUMS):
                self._refuse("it has lost the check sum of its summary")
            return
        end = len(content) - MAGIC_SIZE - _CRC_SIZE
        start = footer.summary_start or len(content) - MAGIC_SIZE - _FOOTER_SIZE
        if zlib.crc32(content[start:end]) != footer.summary_crc:
            self._refuse("the check sum of its summary does not fit")

    def _check_statistics(self) -> None:
        said = self._statistics
        if said is None:
            if self._library.startswith(WITH_SUMS):
                self._refuse("it has lost its statistics")
            return
        counted = {channel: count for channel, count in self.counts.items() if count}
        told = {channel: count for channel, count in said.channel_message_counts.items() if count}
        if said.message_count != self.counts.total() or (told and told != counted):
            self._refuse(f"it says that it has {said.message_count} messages and holds {self.counts.total()}")
        times = (said.message_start_time, said.message_end_time)
        if self._first is not None and times != (self._first, self._last):
            self._refuse(f"it says that it lasts from {times[0]} to {times[1]} ns, and does not")

    def _refuse(self, what: str) -> NoReturn:
        msg = f"bag {self.path} is damaged: {what}; its messages cannot be trusted, restore it from a copy"
        raise BagError(msg)


def _chunks_have_sums(content: bytes) -> bool:
    """Return whether each chunk of an MCAP file, and so each message, has a check sum."""
    place, found = MAGIC_SIZE, False
    while place + RECORD_HEAD.size + _CHUNK_CRC.size <= len(content):
        opcode, length = RECORD_HEAD.unpack_from(content, place)
        place += RECORD_HEAD.size
        if opcode == Opcode.MESSAGE or (opcode == Opcode.CHUNK and not _CHUNK_CRC.unpack_from(content, place)[0]):
            return False
        found |= opcode == Opcode.CHUNK
        place += length
    return found


def check_information(
    path: Path, said: Information, counts: Mapping[str, int], trial: Mapping[str, str] | None, *, complete: bool
) -> None:
    """Compare what ``metadata.yaml`` says with what the bag's files hold.

    Args:
        path: The bag, for errors.
        said: What it says; nothing where there is none.
        counts: Number of messages by topic in the files, also of those that cannot be read.
        trial: The trial record, None without one.
        complete: Whether the files have their ends.

    Raises:
        BagError: It says something else.
    """
    held = sum(counts.values())
    if said.message_count is not None and said.message_count != held:
        cut = "" if complete else "it was cut after it was closed: "
        msg = (
            f"bag {path} is not what it was: {cut}metadata.yaml tells of {said.message_count} messages, and it holds "
            f"{held}. Restore it from a copy; if the bag is right, delete metadata.yaml"
        )
        raise BagError(msg)
    differs = [name for name, count in said.counts if counts.get(name, 0) != count]
    custom = dict(said.custom_data)
    if custom and trial:
        differs += [name for name, text in trial.items() if custom.get(name) != text]
    if differs:
        msg = (
            f"bag {path} is not what it was: metadata.yaml and the bag differ in {', '.join(sorted(differs))}. Restore "
            "it from a copy; if the bag is right, delete metadata.yaml"
        )
        raise BagError(msg)
