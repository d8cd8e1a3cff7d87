"""Bags of trials: rosbag2 bags in MCAP that survive a kill, without ROS. `fin_optimizer.bags.reader` reads them.

A bag is a folder ``<name>/`` with ``<name>_0.mcap`` and ``metadata.yaml`` (version 9), as ``ros2 bag`` writes
and plays it. The usual writers keep up to 1 MiB in memory, which is a whole trial; this one puts each second
on the disk. What describes the trial (design, seed, versions) stands at the start of the MCAP file, where a
kill cannot take it away, and in the ``custom_data`` of ``metadata.yaml``.

A message is logged at its own header stamp, and one without a header, or whose stamp cannot be believed, at the newest
stamp that the plant had reached; the latter are counted. Messages stand in the file in the order of these times, but
for one that comes later than `LONGEST_WAIT`: who reads by the index, as players and viewers do, has them in order.
So a swim that ran fifty times faster than real time is played
back at the fish's own pace, and a sender whose clock is not set makes no bag of 56 years.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections import deque
from contextlib import contextmanager, suppress
from heapq import heapify, heappop, heapreplace
from importlib.metadata import version
from typing import TYPE_CHECKING, Self

from mcap.writer import CompressionType, Writer

from fin_optimizer.bags.disk_space import shortage
from fin_optimizer.bags.log_time import LogTime
from fin_optimizer.bags.messages import BagError, definition, header_stamp, is_known, tells_plants_time, type_hash
from fin_optimizer.bags.metadata import UNUSABLE_STAMPS, BagSummary, BagTopic, as_yaml, bag_information, qos_text
from fin_optimizer.checksums import CHECK_SUM, sum_of_texts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import IO


CHUNK_SIZE = 32 * 1024
"""Bytes of a chunk before compression: about 0.4 s of a swim in real time."""
FLUSH_PERIOD = 0.375
"""s of wall time between two flushes: on a busy machine too, a kill or a power cut takes away less than 1 s."""
LONGEST_WAIT = 0.2
"""s of wall time that a message waits for earlier ones of other topics, at most, before a flush writes it."""
TRIAL_RECORD = "trial"
"""Name of the MCAP metadata record that describes the trial."""
TRIAL_SUM = "trial_check_sum"
"""Name of the MCAP metadata record with the check sum of that one, which guards it while the bag is not closed."""
LIBRARY = "fin_optimizer"
"""What the header of a bag's MCAP file begins its library with: the program that wrote it."""
WITH_SUMS = f"{LIBRARY} with check sums"
"""The same, since the trial record, the data and the summary have check sums; see `fin_optimizer.bags.integrity`."""


def lock(file: IO[bytes]) -> None:
    """Keep other processes off a bag until its file is closed; a file system without locks has to do without.

    Raises:
        BlockingIOError: Another process records the bag, or repairs it.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        pass


class BagWriter:
    """Writes one bag; use it in a ``with`` statement, which closes it readable on every way out.

    Its file is locked meanwhile, so that nobody repairs it.

    Args:
        path: Folder of the bag, made here. Its parents are made where missing.
        topics: What will be recorded.
        metadata: What describes the trial. Numbers as ``repr`` writes them keep all their digits.
        newest_stamp_ns: Time in ns that the plant had reached before, for messages without a header that come
            before the first one with a header.
        minimum_free: Bytes that must stay free on the disk, looked at now and at each flush.
        file_name: Of its MCAP file; as rosbag2 names it if left out.
        clock: Time in s, by which it is flushed.
        wall_clock: Time in ns since the epoch, for a bag in which no message tells any.
        derived: Gives topic and bytes of the messages that a message leads to, by its topic, log time and bytes; they
            are written behind it.

    Raises:
        BagError: The folder exists, cannot be made, a message type is not known, or the disk is too full.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[BagTopic],
        metadata: Mapping[str, str],
        *,
        newest_stamp_ns: int | None = None,
        minimum_free: float = 0.0,
        file_name: str = "",
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], int] = time.time_ns,
        derived: Callable[[str, int, bytes], Iterable[tuple[str, bytes]]] | None = None,
    ) -> None:
        self._derived = derived
        self._clock, self._wall_clock = clock, wall_clock
        self.path = path
        self._file_name = file_name or f"{path.name}_0.mcap"
        self._minimum_free = minimum_free
        self._topics = {topic.name: topic for topic in topics}
        self._metadata = dict(metadata)
        self._time = LogTime(newest_stamp_ns)
        self._held: list[tuple[str, bytes]] = []
        self._waiting: dict[str, deque[tuple[int, bytes, float]]] = {topic.name: deque() for topic in topics}
        self._streams: set[str] = set()
        self._summary: BagSummary | None = None
        self._failure: str | None = None
        self._counts = dict.fromkeys(self._topics, 0)
        self._earliest: int | None = None
        self._latest = 0
        self._with_header = {topic.name: self._known_type(topic) for topic in topics}
        self._check_free()
        with self._failing("make"):
            path.mkdir(parents=True)
            self._file = (path / self._file_name).open("xb")
        self._mcap = Writer(self._file, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._flushed_at = self._clock()
        try:
            with self._failing("write"):
                lock(self._file)
                self._channels = self._start()
        except BagError:
            self._undo()
            raise

    @staticmethod
    def _known_type(topic: BagTopic) -> bool:
        if not is_known(topic.type_name):
            msg = f"topic {topic.name} has the type {topic.type_name}, which ROS 2 Jazzy does not define"
            raise BagError(msg)
        return tells_plants_time(topic.type_name)

    def _check_free(self) -> None:
        if self._failure is None and (missing := shortage(self.path, self._minimum_free)):
            self._failure = f"bag {self.path} cannot be written: {missing}"
            raise BagError(self._failure)

    def _undo(self) -> None:
        """Remove the bag that could not be started, so that its name is free again."""
        self._release()
        with suppress(OSError):
            (self.path / self._file_name).unlink()
            self.path.rmdir()

    def _start(self) -> dict[str, int]:
        """Write header, trial, schemas and channels; return the channels' numbers by topic."""
        self._mcap.start(profile="ros2", library=f"{WITH_SUMS}, mcap {version('mcap')}")
        self._mcap.add_metadata(TRIAL_RECORD, self._metadata)
        self._mcap.add_metadata(TRIAL_SUM, {CHECK_SUM: sum_of_texts(self._metadata)})
        schemas: dict[str, int] = {}
        channels = {}
        for topic in self._topics.values():
            if topic.type_name not in schemas:
                text = definition(topic.type_name)
                schemas[topic.type_name] = self._mcap.register_schema(topic.type_name, "ros2msg", text)
            channel_metadata = {
                "offered_qos_profiles": qos_text(topic.qos),
                "topic_type_hash": type_hash(topic.type_name),
            }
            schema = schemas[topic.type_name]
            channels[topic.name] = self._mcap.register_channel(topic.name, "cdr", schema, channel_metadata)
        self._to_disk()
        _sync_folder(self.path)
        _sync_folder(self.path.parent)
        return channels

    def write(self, topic: str, data: bytes) -> None:
        """Append a serialised message of a topic, named absolutely.

        Raises:
            BagError: Unknown topic, closed bag, message too short for its header, or the disk refuses.
        """
        if topic not in self._channels:
            msg = f"topic {topic} is not recorded in {self.path}: recorded are {', '.join(self._topics)}"
            raise BagError(msg)
        if self._summary is not None:
            msg = f"bag {self.path} is closed: {topic} came too late"
            raise BagError(msg)
        if self._failure is not None:
            raise BagError(self._failure)
        with_header = self._with_header[topic]
        stamp = self._time.of(topic, header_stamp(data) if with_header else None)
        if stamp is None:
            self._held.append((topic, data))
            return
        self._release_held(stamp)
        self._wait(topic, data, stamp)
        if with_header:
            self._streams.add(topic)
        self.flush_if_due()

    def copy(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Append a message of another bag at the log time that it has there.

        Raises:
            BagError: The disk refuses.
        """
        with self._failing("write"):
            self._add(topic, data, log_time_ns)

    def _release_held(self, stamp: int) -> None:
        """Let the messages without a header wait their turn that came before the plant's time was known."""
        held, self._held = self._held, []
        for topic, data in held:
            self._wait(topic, data, stamp)

    def _wait(self, topic: str, data: bytes, stamp: int) -> None:
        self._waiting[topic].append((stamp, data, self._clock()))

    def _merge(self, *, whole: bool) -> None:
        """Write what waits in the order of time, each topic in its own order.

        Streams come in slices, one behind the other. Unless the whole is asked for, a message waits for the streams
        that may still bring an earlier one, but no longer than `LONGEST_WAIT`.
        """
        queues = self._waiting
        rank = {topic: number for number, topic in enumerate(queues)}
        heads = [(queue[0][0], rank[topic], topic) for topic, queue in queues.items() if queue]
        heapify(heads)
        lacking = {topic for topic in self._streams if not queues[topic]}
        oldest = self._clock() - LONGEST_WAIT
        while heads:
            stamp, number, topic = heads[0]
            queue = queues[topic]
            if lacking and not whole and queue[0][2] > oldest:
                return
            _, data, _ = queue.popleft()
            self._add(topic, data, stamp)
            if queue:
                heapreplace(heads, (queue[0][0], number, topic))
            else:
                heappop(heads)
                lacking |= {topic} & self._streams

    def _add(self, topic: str, data: bytes, stamp: int) -> None:
        self._earliest = stamp if self._earliest is None else min(stamp, self._earliest)
        self._latest = max(stamp, self._latest)
        self._mcap.add_message(self._channels[topic], stamp, data, stamp, self._counts[topic])
        self._counts[topic] += 1
        if self._derived is not None:
            for name, message in self._derived(topic, stamp, data):
                self._mcap.add_message(self._channels[name], stamp, message, stamp, self._counts[name])
                self._counts[name] += 1

    def flush_if_due(self) -> None:
        """Put everything on the disk if FLUSH_PERIOD has passed since the last time.

        Raises:
            BagError: The disk refuses.
        """
        if self._clock() - self._flushed_at >= FLUSH_PERIOD:
            self._flush(whole=False)

    def flush(self) -> None:
        """Put everything written so far on the disk, as a whole chunk.

        Raises:
            BagError: The disk refuses.
        """
        self._flush(whole=True)

    def _flush(self, *, whole: bool) -> None:
        self._check_free()
        with self._failing("write"):
            self._merge(whole=whole)
            self._to_disk()

    def _to_disk(self) -> None:
        self._mcap.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._file.fileno())
        self._flushed_at = self._clock()

    def close(self) -> BagSummary:
        """Write index and ``metadata.yaml``; a second call only says the same again.

        Raises:
            BagError: The disk refuses, or did before. The bag is then closed, but has no index: what is on the
                disk can be read by :func:`read_bag`.
        """
        if self._summary is None:
            try:
                with self._failing("close"):
                    self._summary = self._finish()
            finally:
                self._release()
        return self._summary

    def _finish(self) -> BagSummary:
        """Write what is still to write and return what the bag holds."""
        # Without any stamp the bag's own moment is the best that is known.
        self._release_held(self._wall_clock() if self._time.newest is None else self._time.newest)
        self._merge(whole=True)
        start = self._latest if self._earliest is None else self._earliest
        duration, stamps = self._latest - start, self._time
        summary = BagSummary(
            self.path, dict(self._counts), start, duration, dict(stamps.unusable), dict(stamps.first_unusable)
        )
        information = bag_information(summary, self._topics.values(), self._file_name, self._metadata)
        if summary.unusable_stamps:
            unusable = {topic: str(count) for topic, count in summary.unusable_stamps.items()}
            self._mcap.add_metadata(UNUSABLE_STAMPS, unusable)
        self._mcap.add_metadata("rosbag2", {"serialized_metadata": as_yaml(information)})
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        os.fsync(self._file.fileno())
        _write_whole(self.path / "metadata.yaml", as_yaml({"rosbag2_bagfile_information": information}))
        return summary

    def _release(self) -> None:
        """Give the file back; what it could not put on the disk was reported before."""
        with suppress(OSError):
            self._file.close()

    @contextmanager
    def _failing(self, verb: str) -> Iterator[None]:
        """Turn what the operating system refuses into a BagError that names the bag.

        After a failure nobody knows how much of a record is on the disk, so nothing is written behind it.
        """
        if self._failure is not None:
            raise BagError(self._failure)
        try:
            yield
        except FileExistsError as error:
            msg = f"bag {self.path} exists already and is not overwritten: choose another name or move it"
            raise BagError(msg) from error
        except OSError as error:
            count = sum(self._counts.values())
            self._failure = f"cannot {verb} bag {self.path}: {error.strerror or error} (after {count} messages)"
            raise BagError(self._failure) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _write_whole(path: Path, text: str) -> None:
    """Write a file so that a power cut leaves the whole of it or nothing."""
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    _sync_folder(path.parent)


def _sync_folder(path: Path) -> None:
    """Put a folder's entries on the disk: without it a power cut can lose a file that was written well."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
