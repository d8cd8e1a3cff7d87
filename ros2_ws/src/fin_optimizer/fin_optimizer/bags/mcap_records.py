"""The records of an MCAP file, also of one that a kill or a power cut left open: where it ends, and what is damaged."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING

from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Message
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from fin_optimizer.bags.integrity import MAGIC_SIZE, RECORD_HEAD
from fin_optimizer.bags.messages import BagError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mcap.records import McapRecord

DAMAGE = (
    McapError,
    CRCValidationError,
    ZstdError,
    RuntimeError,  # of lz4
    struct.error,
    UnicodeDecodeError,
    OverflowError,
    MemoryError,
)
"""What reading damaged bytes raises: lengths that are none, and texts and blocks that are not what they were."""
_COMPRESSION = b"\x04\0\0\0zstd"
"""How a chunk names its compression, behind its record's head, two times, a length and a check sum."""
_BEFORE_COMPRESSION = RECORD_HEAD.size + 3 * 8 + 4


def whole_records(content: bytes) -> tuple[int, int, bool]:
    """Return where a file's messages end and where its whole records end, in bytes, and whether it was closed.

    A power cut can leave zeros where data were not yet written, also inside the last chunk of a file that was not
    closed: its messages end before such a chunk, and otherwise with the last one, whatever its index looks like.
    """
    size = len(content)
    end = MAGIC_SIZE
    chunk = None
    with io.BytesIO(content) as file:
        while end + RECORD_HEAD.size <= size:
            file.seek(end)
            opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
            after = end + RECORD_HEAD.size + length
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


def goes_on(content: bytes, end: int) -> bool:
    """Whether whole chunks follow the end of what can be read: a kill takes away all that was written last."""
    place = content.find(_COMPRESSION, end)
    while place >= 0:
        head = place - _BEFORE_COMPRESSION
        if head >= end and content[head] == Opcode.CHUNK:
            after = head + RECORD_HEAD.size + RECORD_HEAD.unpack_from(content, head)[1]
            if after <= len(content) and _is_chunk(content[head:after]):
                return True
        place = content.find(_COMPRESSION, place + 1)
    return False


def _is_chunk(data: bytes) -> bool:
    """Whether a chunk is as it was written; one without messages never is."""
    records = StreamReader(io.BytesIO(data), skip_magic=True, validate_crcs=True).records
    try:
        return any(isinstance(record, Message) for record in records)
    except DAMAGE:
        return False


def records(path: Path, whole: bytes) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file up to its end or to where a kill cut it off.

    Args:
        path: Of the file, for errors.
        whole: Its plain bytes.

    Raises:
        BagError: Bytes inside it are damaged.
    """
    try:
        length, _, complete = whole_records(whole)
        content = io.BytesIO(whole[:length])
        try:
            yield from StreamReader(content, validate_crcs=True).records
        except EndOfFile:
            if complete or content.tell() < length:
                raise
    except DAMAGE as error:
        msg = f"bag {path} is damaged: {type(error).__name__} {error}; its messages cannot be trusted"
        raise BagError(msg) from error
