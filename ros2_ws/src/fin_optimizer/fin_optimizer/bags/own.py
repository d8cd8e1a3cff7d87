"""The bags that the optimiser recorded itself: which they are, which file is theirs, and whether they were closed."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING

from mcap.exceptions import EndOfFile
from mcap.records import Header
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from fin_optimizer.bags.files import bag_files, reading
from fin_optimizer.bags.integrity import MAGIC_SIZE
from fin_optimizer.bags.mcap_records import DAMAGE
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.writer import LIBRARY

if TYPE_CHECKING:
    from pathlib import Path

_LONGEST_HEADER = 1024  # bytes from the file's beginning; ROS 2 and the optimiser write some sixty


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
