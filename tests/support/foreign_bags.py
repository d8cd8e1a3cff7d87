"""The trial of one of the optimiser's bags, as other programs write it: `rosbags`, and as ``ros2 bag record`` does."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING

import yaml
import zstandard
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from fin_optimizer.bags.messages import message_types
from fin_optimizer.bags.reader import read_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

# What `ros2 bag record` writes for a topic: over the network it learns no history and no depth.
FOREVER = {"sec": 9223372036, "nsec": 854775807}
RECORDED_QOS: Mapping[str, object] = {
    "history": "unknown",
    "depth": 0,
    "reliability": "reliable",
    "durability": "volatile",
    "deadline": FOREVER,
    "lifespan": FOREVER,
    "liveliness": "automatic",
    "liveliness_lease_duration": FOREVER,
    "avoid_ros_namespace_conventions": False,
}


def rosbags_bag(
    own: Path,
    path: Path,
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a bag again as `rosbags` does, with the trial's description in ``custom_data``."""
    bag = read_bag(own)
    writer = Writer(path, version=9, storage_plugin=storage)
    if compression is not CompressionMode.NONE:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    for key, value in bag.metadata.items():
        writer.set_custom_data(key, value)
    with writer:
        connections = {
            name: writer.add_connection(name, kind, typestore=message_types()) for name, kind in bag.topics.items()
        }
        for topic, stamp, data in bag.messages(*bag.topics):
            writer.write(connections[topic], stamp, data)
    return path


def plain_mcap(
    file: Path,
    topics: Mapping[str, str],
    messages: Sequence[tuple[str, int, bytes]],
    *,
    qos: str | None = None,
    squeeze: bool = False,
    encoding: str = "cdr",
    schema: tuple[str, bytes] = ("ros2msg", b"x"),
) -> Path:
    """Write an MCAP file without a word about the trial, its messages compressed each for itself if asked to."""
    file.parent.mkdir(parents=True, exist_ok=True)
    writer = McapWriter(str(file))
    writer.start(profile="ros2", library="another program")
    told = yaml.safe_dump([dict(RECORDED_QOS)]) if qos is None else qos
    channels = {}
    for name, kind in topics.items():
        number = writer.register_schema(kind, *schema)
        channels[name] = writer.register_channel(name, encoding, number, {"offered_qos_profiles": told})
    squeezed = zstandard.ZstdCompressor(write_content_size=False).compress if squeeze else bytes
    for topic, stamp, data in messages:
        writer.add_message(channels[topic], stamp, squeezed(data), stamp, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return file


def split(own: Path, path: Path, parts: int = 12) -> Path:
    """Write a bag again in several files, as ``ros2 bag record --max-bag-duration`` does, without metadata.yaml."""
    bag = read_bag(own)
    messages = list(bag.messages(*bag.topics))
    size = -(-len(messages) // parts)
    for part in range(parts):
        plain_mcap(path / f"{path.name}_{part}.mcap", bag.topics, messages[part * size : (part + 1) * size])
    return path


def one_by_one(own: Path, path: Path) -> Path:
    """Write a bag again with its messages compressed each for itself, without metadata.yaml."""
    bag = read_bag(own)
    plain_mcap(path / f"{path.name}_0.mcap", bag.topics, list(bag.messages(*bag.topics)), squeeze=True)
    return path


def named_without_msg(own: Path, path: Path) -> Path:
    """Write a bag again with types such as ``std_msgs/Header``, and without a quality of service."""
    bag = read_bag(own)
    kinds = {name: kind.replace("/msg/", "/") for name, kind in bag.topics.items()}
    plain_mcap(path / "swim.mcap", kinds, list(bag.messages(*bag.topics)), qos="")
    return path


def as_squeezed_file(own: Path, path: Path) -> Path:
    """Write a bag again as one compressed file, without metadata.yaml."""
    bag = read_bag(own)
    file = plain_mcap(path / "swim_0.mcap", bag.topics, list(bag.messages(*bag.topics)))
    (path / "swim_0.mcap.zstd").write_bytes(zstandard.ZstdCompressor().compress(file.read_bytes()))
    file.unlink()
    return path


def old_database(own: Path, path: Path) -> Path:
    """Write a bag again as the first releases of ROS 2 did: a SQLite file without quality of service."""
    bag = read_bag(own)
    path.mkdir()
    with sqlite3.connect(path / "swim_0.db3") as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        numbers = {name: number for number, name in enumerate(bag.topics)}
        for name, kind in bag.topics.items():
            database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", (numbers[name], name, kind))
        for topic, stamp, data in bag.messages(*bag.topics):
            database.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (numbers[topic], stamp, data)
            )
    database.close()
    return path


WRITERS: Mapping[str, Callable[[Path, Path], Path]] = {
    "rosbags, MCAP": rosbags_bag,
    "rosbags, MCAP, file compressed": lambda own, path: rosbags_bag(own, path, compression=CompressionMode.FILE),
    "rosbags, MCAP, messages compressed": lambda own, path: rosbags_bag(own, path, compression=CompressionMode.MESSAGE),
    "rosbags, SQLite": lambda own, path: rosbags_bag(own, path, StoragePlugin.SQLITE3),
    "rosbags, SQLite, file compressed": lambda own, path: rosbags_bag(
        own, path, StoragePlugin.SQLITE3, CompressionMode.FILE
    ),
    "rosbags, SQLite, messages compressed": lambda own, path: rosbags_bag(
        own, path, StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "twelve files": split,
    "messages compressed, no metadata.yaml": one_by_one,
    "file compressed, no metadata.yaml": as_squeezed_file,
    "types without msg, no quality of service": named_without_msg,
    "old SQLite": old_database,
}
