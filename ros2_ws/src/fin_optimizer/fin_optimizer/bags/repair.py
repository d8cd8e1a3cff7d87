"""Closes bags that a kill or a power cut left open.

A repaired bag is written beside the original, read again and compared message by message; only then it takes the
original's place. Whatever happens before leaves the original as it was.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING

from fin_optimizer.bags.files import bags_in
from fin_optimizer.bags.integrity import MAGIC_SIZE
from fin_optimizer.bags.messages import BagError, without_name
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.own import is_closed, is_own, mcap_file
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter, lock

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from fin_optimizer.bags.reader import Bag

_WORK_FOLDER = ".repair"


@dataclass(frozen=True)
class Repair:
    """What came of a bag that was not closed.

    Attributes:
        path: Folder of the bag.
        counts: Messages by topic that the repaired bag holds; empty if it could not be repaired.
        lost: Bytes at the end of the original that could not be read any more.
        failure: Why it could not be repaired, or empty. The original is then as it was.
        empty: Nothing had been written to it yet, so it was removed.
        recorded: Another process is writing it, so it was left alone.
    """

    path: Path
    counts: Mapping[str, int]
    lost: int
    failure: str = ""
    empty: bool = False
    recorded: bool = False

    def __str__(self) -> str:
        """Say what came of it."""
        if self.recorded:
            return f"bag {self.path.name} is being recorded, left alone"
        if self.empty:
            return f"bag {self.path.name} was left open before anything was written to it: removed"
        if self.failure:
            return f"bag {self.path} cannot be repaired: {without_name(self.failure, self.path)}"
        counts = ", ".join(f"{count} {topic}" for topic, count in self.counts.items() if count) or "none"
        cut = f"; its last {self.lost} bytes could not be read" if self.lost else ""
        return f"bag {self.path.name} was left open: repaired with all messages in it ({counts}){cut}"


def repair_bag(path: Path) -> Repair | None:
    """Close a bag that was left open; return what came of it, None if there was nothing to do.

    Args:
        path: Folder of the bag, or its MCAP file.
    """
    try:
        if path.is_file() or not is_own(path):
            return _left_alone(path)
        return None if is_closed(path) else _closed(path)
    except BlockingIOError:
        return Repair(path, {}, 0, recorded=True)
    except BagError as error:
        return Repair(path, {}, 0, str(error))
    except OSError as error:
        return Repair(path, {}, 0, error.strerror or str(error))


def _closed(path: Path) -> Repair:
    with mcap_file(path).open("r+b") as file:  # a network's file system locks only what can be written
        lock(file)
        if _holds_nothing(path):
            shutil.rmtree(path)
            return Repair(path, {}, 0, empty=True)
        return _repaired(path, read_bag(path))


def _left_alone(path: Path) -> Repair | None:
    """Only look at a bag that is not the optimiser's, or that is no folder of its own."""
    if read_bag(path).complete:
        return None
    if is_own(path):
        return Repair(path, {}, 0, "it is a file; give its folder, which must hold this bag alone")
    return Repair(path, {}, 0, "another program recorded it and did not close it; `ros2 bag reindex` mends such bags")


def _holds_nothing(path: Path) -> bool:
    """Whether the bag was killed between the making of its file and the first byte behind the file's magic."""
    names = {entry.name for entry in path.iterdir()}
    file = mcap_file(path)
    return names == {file.name} and file.stat().st_size <= MAGIC_SIZE


def _repaired(path: Path, original: Bag) -> Repair:
    copy = path / _WORK_FOLDER
    shutil.rmtree(copy, ignore_errors=True)  # an earlier repair that was itself cut short
    if not original.metadata and not any(original.counts.values()):
        msg = f"bag {path} was cut off before anything was written: delete it"
        raise BagError(msg)
    topics = [BagTopic(name, type_name, original.offered(name)) for name, type_name in original.topics.items()]
    try:
        with BagWriter(copy, topics, original.metadata, file_name=original.path.name) as writer:
            for message in original.messages(*original.topics):
                writer.copy(message[0], message[2], message[1])
        _verify(original, read_bag(copy))
        size = original.path.stat().st_size
        # The bag first: if the next line is never reached, metadata.yaml is missing and the repair is made again.
        mcap_file(copy).replace(original.path)
        (copy / "metadata.yaml").replace(path / "metadata.yaml")
    finally:
        shutil.rmtree(copy, ignore_errors=True)
    return Repair(path, original.counts, size - original.whole_bytes)


def _verify(original: Bag, copy: Bag) -> None:
    """Compare two bags message by message.

    Raises:
        BagError: They differ.
    """
    same = copy.complete and (copy.metadata, copy.topics, copy.qos) == (
        original.metadata,
        original.topics,
        original.qos,
    )
    pairs = zip_longest(original.messages(*original.topics), copy.messages(*copy.topics))
    if not same or any(before != after for before, after in pairs):
        msg = f"the repaired copy of {original.path} differs from it: the original is kept, look at the disk"
        raise BagError(msg)


def repair_bags(path: Path, *, or_nothing: bool = False) -> list[Repair]:
    """Repair every bag of a study or of a folder of bags that was left open; return what came of those.

    Raises:
        BagError: There is no bag at all, and ``or_nothing`` does not allow for it.
    """
    if or_nothing and not any(path.glob("bags/*/*.mcap")):
        return []
    return [repair for bag in bags_in(path) if (repair := repair_bag(bag)) is not None]
