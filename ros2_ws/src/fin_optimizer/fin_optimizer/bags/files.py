"""Which files make a bag, and what is in them: the optimiser's bags and those of other programs.

``ros2 bag record`` writes MCAP or SQLite, in one file or in several, and compresses files or messages if asked to.
"""

from __future__ import annotations

import io
import re
import sqlite3
import tempfile
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

import yaml
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdDecompressor

from fin_optimizer.bags.messages import BagError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

METADATA_FILE = "metadata.yaml"
_STORAGES = (".mcap", ".db3")
_COMPRESSED = ".zstd"
_SQLITE_MAGIC = b"SQLite format 3\0"
_ROS1_MAGIC = b"#ROSBAG"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""Of a compressed file, and of a compressed message: one that is not begins with a zero byte."""


class RecordedTopic(NamedTuple):
    """A topic as a bag's file describes it; ``qos`` is YAML, or empty where nothing is told."""

    name: str
    type_name: str
    encoding: str
    qos: str


@dataclass(frozen=True)
class Information:
    """What ``metadata.yaml`` says, as far as it can be read.

    Attributes:
        files: Names of the bag's files in the order of their recording.
        custom_data: What the one who recorded added.
        message_count: Of all topics, None where it is not said.
        counts: Number of messages by topic.
    """

    files: Sequence[str] = ()
    custom_data: tuple[tuple[str, str], ...] = ()
    message_count: int | None = None
    counts: tuple[tuple[str, int], ...] = ()


def bag_files(path: Path) -> tuple[Path, ...]:
    """Return the files of the one bag that a path means, in the order of their recording.

    Raises:
        BagError: There is no bag, a file of it is missing, there are several bags, or the folder cannot be read.
    """
    with reading(path):
        if path.is_file():
            return (path,)
        if not path.is_dir():
            msg = f"{path} is no bag of a trial: it is neither folder nor file; give the folder of a bag"
            raise BagError(msg)
        found = _storage_files(path)
        named = information(path).files
        if missing := [name for name in named if not (path / name).exists()]:
            if len(found) < len(named):
                msg = f"bag {path} is not whole: {METADATA_FILE} names {', '.join(missing)}, which is missing"
                raise BagError(msg)
        elif named:
            return tuple(path / name for name in named)
    if not found:
        msg = f"{path} is no bag of a trial: it holds no .mcap or .db3 file; give the folder of a bag"
        raise BagError(msg)
    if not named and len({_recording(file) for file in found}) > 1:
        msg = f"{path} holds several bags: give one of {', '.join(file.name for file in found)}"
        raise BagError(msg)
    return tuple(found)


def bags_in(path: Path) -> Iterator[Path]:
    """Yield the bags that a path means, in the order of their names: one bag, a folder of bags, or a study.

    Raises:
        BagError: There is none, or a folder cannot be read.
    """
    with reading(path):
        loose = _storage_files(path) if path.is_dir() else []
        if path.is_file() or (path / METADATA_FILE).exists():
            found = [path]
        elif loose:
            found = [path] if len({_recording(file) for file in loose}) == 1 else loose
        else:
            below = path / "bags" if (path / "bags").is_dir() else path
            found = sorted(folder for folder in _folders(below) if _is_bag(folder))
    if not found:
        msg = f"{path} holds no bag: give the folder of a bag, of bags, or of a study"
        raise BagError(msg)
    yield from found


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what the operating system refuses into a BagError that names the bag."""
    try:
        yield
    except OSError as error:
        msg = f"cannot read bag {path}: {error.strerror or error}"
        raise BagError(msg) from error


def _folders(path: Path) -> list[Path]:
    return [entry for entry in path.iterdir() if entry.is_dir()] if path.is_dir() else []


def _is_bag(folder: Path) -> bool:
    try:
        return bool(_storage_files(folder)) or (folder / METADATA_FILE).exists()
    except OSError:
        return True  # whoever opens it is told why it cannot be read


def _storage_files(folder: Path) -> list[Path]:
    """Return the files in a folder that may hold messages, in the order of their numbers."""
    files = [f for f in folder.iterdir() if f.name.removesuffix(_COMPRESSED).endswith(_STORAGES)]
    return sorted(files, key=lambda f: [int(part) if part.isdigit() else 0 for part in re.split(r"(\d+)", f.name)])


def _recording(file: Path) -> str:
    """Return the name that the files of one recording have in common: ``swim`` of ``swim_0.mcap``."""
    return re.sub(r"_\d+$", "", Path(file.name.removesuffix(_COMPRESSED)).stem)


def information(folder: Path) -> Information:
    """Return what a folder's ``metadata.yaml`` says; nothing without one, or with one that cannot be understood."""
    try:
        content = yaml.load((folder / METADATA_FILE).read_bytes(), _Loader)  # noqa: S506  (a safe loader)
        said = content["rosbag2_bagfile_information"]
        names = [Path(str(name)).name for name in said.get("relative_file_paths") or ()]
        custom = {str(key): str(value) for key, value in (said.get("custom_data") or {}).items()}
        topics = said.get("topics_with_message_count") or ()
        counts = {str(topic["topic_metadata"]["name"]): int(topic["message_count"]) for topic in topics}
        total = None if said.get("message_count") is None else int(said["message_count"])
    except (OSError, yaml.YAMLError, LookupError, TypeError, ValueError, AttributeError):
        return Information()
    return Information(tuple(names), tuple(custom.items()), total, tuple(counts.items()))


if TYPE_CHECKING:
    _Loader = yaml.SafeLoader
else:
    _Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def plain(data: bytes) -> bytes:
    """Return a file's or a message's bytes, decompressed if they were compressed.

    Raises:
        ZstdError: They are damaged.
    """
    if not data.startswith(_ZSTD_MAGIC):
        return data
    with ZstdDecompressor().stream_reader(io.BytesIO(data), read_across_frames=True) as reader:
        return reader.read()


def mcap_content(file: Path) -> bytes | None:
    """Return the plain bytes of a bag's file if it is MCAP, None if it is SQLite.

    Raises:
        BagError: It is neither.
        OSError: It cannot be read.
        ZstdError: Its compressed bytes are damaged.
    """
    if _begins_as_sqlite(file):
        return None
    content = plain(file.read_bytes())
    if content.startswith(_SQLITE_MAGIC):
        return None
    if content.startswith(_ROS1_MAGIC):
        msg = f"{file} is a bag of ROS 1: convert it, for example with rosbags-convert"
        raise BagError(msg)
    if not content.startswith(MCAP0_MAGIC) and not file.name.removesuffix(_COMPRESSED).endswith(".mcap"):
        msg = f"{file} is no bag: it is {'neither MCAP nor SQLite' if content else 'empty'}"
        raise BagError(msg)
    return content


def _begins_as_sqlite(file: Path) -> bool:
    with file.open("rb") as stream:
        return stream.read(len(_SQLITE_MAGIC)) == _SQLITE_MAGIC


@contextmanager
def _database(file: Path) -> Iterator[sqlite3.Connection]:
    """Open a SQLite file, also a compressed one, to read it.

    Raises:
        BagError: It is damaged, or no bag.
    """
    with tempfile.TemporaryDirectory() as folder:
        opened = file
        if not _begins_as_sqlite(file):
            opened = Path(folder) / "bag.db3"
            opened.write_bytes(plain(file.read_bytes()))
        # What a recorder that was killed has not yet moved into the file stands beside it.
        is_whole = not opened.with_name(opened.name + "-wal").exists()
        address = f"file:{quote(str(opened.absolute()))}?{'immutable=1' if is_whole else 'mode=ro'}"
        try:
            with closing(sqlite3.connect(address, uri=True)) as connection:
                yield connection
        except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
            msg = f"bag {file} is damaged, or no bag: {error}"
            raise BagError(msg) from error


def sqlite_topics(file: Path) -> list[tuple[RecordedTopic, int]]:
    """Return the topics of a SQLite file and the number of their messages.

    Raises:
        BagError: It is damaged, or no bag.
    """
    with _database(file) as database:
        columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"  # which the oldest bags lack
        rows = database.execute(
            f"SELECT name, type, serialization_format, {qos}, count(messages.id) FROM topics "  # noqa: S608
            "LEFT JOIN messages ON topics.id = messages.topic_id GROUP BY topics.id ORDER BY topics.id"
        )
        return [(RecordedTopic(*map(str, row[:4])), int(row[4])) for row in rows]


def sqlite_messages(file: Path) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, log time in ns and bytes of the messages of a SQLite file, in the order of their time.

    Raises:
        BagError: It is damaged, or no bag.
    """
    with _database(file) as database:
        for topic, log_time, data in database.execute(
            "SELECT topics.name, messages.timestamp, messages.data FROM messages "
            "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id"
        ):
            if not isinstance(log_time, int) or not isinstance(data, bytes):
                msg = f"bag {file} is damaged: a message of {topic} at {log_time!r} is no message"
                raise BagError(msg)
            yield str(topic), log_time, data
