"""Records a plant's topics to bags, one bag a trial, without losing or delaying a message.

The recorder takes what has arrived whenever its owner calls `listen`, all at once and as serialised bytes: faster than
real time a plant sends tens of thousands of messages a second, and an executor's own work for each single one would be
ten times as much. A thread compresses them, writes them and waits for the disk.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import BagError, decode, header_stamp, velocity_samples
from fin_optimizer.bags.metadata import BagSummary, BagTopic
from fin_optimizer.bags.model_messages import ModelMessages
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.score.mean_speed import LONGEST_GAP, ScoreError
from fin_optimizer.score.swim import SwimRecord, start_of_swim
from fin_optimizer.trial.subscription import ALL, Subscription, bag_qos
from fin_plant.frames import frame_prefix
from fin_plant.stamps import NANOSECONDS
from fin_plant.topics import (
    JOINT_STATES,
    NAMESPACE,
    PLANT_STATE,
    POSE,
    RECORDED_TOPICS,
    THRUST,
    VELOCITY,
    Topic,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray
    from rclpy.node import Node

    from fin_optimizer.score.mean_speed import Measurement

TAIL = round(LONGEST_GAP * NANOSECONDS)
"""ns of the plant's time behind the window that a bag still holds: a score may need a sample so far beyond it."""
_LONGEST_OVERRUN = 600 * NANOSECONDS
_BY_TRUST = (JOINT_STATES.name, VELOCITY.name, POSE.name)
WRITE_PERIOD = 0.02
"""s between two visits of the writing thread; messages wait in memory no longer."""
_LOOK_PERIOD = 0.2
"""s between two looks at what the publishers offer."""
LONGEST_PAUSE = 0.1
"""s between two calls of `listen`, at most: what waits longer than its queue is deep holds a fast plant back."""


class Recorder:
    """Listens to a plant's topics from the start, and writes what it hears while a bag is open.

    It asks for what all publishers of a topic offer, as rosbag2 does: a reliable listener hears nothing of a tracker
    that offers best effort, as many do.

    Call it from one thread, and `listen` every `LONGEST_PAUSE` or more often. No executor has a part in it.

    Args:
        node: Node that subscribes.
        topics: What to record.
        namespace: Of the fish, to which the topics' names are relative; empty for the node's own.
        minimum_free: Bytes that must stay free on the disk of a bag.
        clock: Time in s.
        wall_clock: Time in ns since the epoch, for a bag in which no message tells any.
    """

    def __init__(
        self,
        node: Node,
        topics: Sequence[Topic[Any]] = RECORDED_TOPICS,
        *,
        namespace: str = "",
        minimum_free: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._clock, self._wall_clock = clock, wall_clock
        self._minimum_free = minimum_free
        self._namespace = namespace or node.get_namespace()
        self._queue: deque[tuple[str, bytes]] = deque()
        self._extent = Extent()
        self._subscriptions = {
            topic.name: Subscription(node, topic, self._queue, self._extent, namespace) for topic in topics
        }
        # What the plant says of itself is taken before its streams, so that the end of a swim is known before it comes.
        self._turns = sorted(
            self._subscriptions.values(), key=lambda subscription: subscription.topic is not PLANT_STATE
        )
        self._closing = threading.Event()
        self._job: Future[BagSummary] | None = None
        self._look_due = 0.0

    def listen(self) -> int:
        """Take what has arrived; return the number of messages."""
        if self._job is None:
            self._ask_for_what_is_offered()
        return sum(subscription.take_waiting() for subscription in self._turns)

    def unmatched(self, required: Iterable[Topic[Any]]) -> list[str]:
        """Return the names of those topics that have no publisher yet."""
        self._ask_for_what_is_offered()
        return [topic.name for topic in required if not self._subscription_to(topic).publishers]

    def _ask_for_what_is_offered(self) -> None:
        """Look, not too often, whether a publisher offers less than is asked for; in a swim nothing more is asked."""
        now = self._clock()
        if now >= self._look_due:
            self._look_due = now + _LOOK_PERIOD
            for subscription in self._turns:
                subscription.adapt(records=self._job is not None)

    def received(self, topic: Topic[Any]) -> int:
        """Return how many messages of a topic have come since the recorder began to listen."""
        return self._subscription_to(topic).received

    def newest(self, topic: Topic[Any]) -> bytes | None:
        """Return the last message of a topic, serialised; None before the first one."""
        return self._subscription_to(topic).last

    def newest_stamp(self, topic: Topic[Any] = VELOCITY) -> int | None:
        """Return the header stamp in ns of the last message of a topic; None before the first one.

        Raises:
            ValueError: The topic's messages have no header, or it is not recorded.
        """
        subscription = self._subscription_to(topic)
        if not subscription.with_header:
            msg = f"messages of {topic.name} ({topic.type_name}) have no header, so they have no stamp"
            raise ValueError(msg)
        return None if subscription.last is None else header_stamp(subscription.last)

    @property
    def failure(self) -> str | None:
        """Why the open bag can no longer be written; None while all is well."""
        if self._job is None or not self._job.done():
            return None
        error = self._job.exception()
        return None if error is None else str(error)

    def open(self, path: Path, metadata: Mapping[str, str], measurement: Measurement | None = None) -> None:
        """Start a bag. What latched topics said before stands at its beginning.

        Args:
            path: Folder of the bag, which must not exist.
            metadata: What describes the trial.
            measurement: Which part of a swim counts; streams are recorded until `TAIL` after it. Until `close` if None.

        Raises:
            BagError: A bag is open, the folder exists, or the disk refuses.
        """
        if self._job is not None:
            msg = f"cannot open bag {path}: the recorder still writes another one, close it first"
            raise BagError(msg)
        subscriptions = self._subscriptions.values()
        for subscription in subscriptions:
            subscription.take_waiting(ALL)
        topics = [
            BagTopic(subscription.name, subscription.topic.type_name, bag_qos(subscription.offered))
            for subscription in subscriptions
        ]
        model = ModelMessages(self._namespace, frame_prefix(self._namespace, NAMESPACE))
        writer = BagWriter(
            path,
            [*topics, *model.topics],
            metadata,
            derived=model.take,
            newest_stamp_ns=self._plants_time(),
            minimum_free=self._minimum_free,
            clock=self._clock,
            wall_clock=self._wall_clock,
        )
        self._queue.clear()
        self._closing.clear()
        self._extent.begin(measurement)
        for subscription in subscriptions:
            subscription.start()
        self._job = Future()
        threading.Thread(target=self._write, args=(writer, self._job), name="recorder").start()

    def _plants_time(self) -> int | None:
        """Return the newest stamp in ns of the topic that tells the plant's time best: a tracker has its own clock."""
        for name in _BY_TRUST:
            subscription = self._subscriptions.get(name)
            if (
                subscription is not None
                and subscription.last is not None
                and (stamp := header_stamp(subscription.last)) > 0
            ):
                return stamp
        return None

    def velocity_samples(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return header stamps in ns and forward speeds in m/s, both (n,), of the bag opened last.

        They are read from the bytes that are in the bag, so they are what the bag gives.
        """
        return velocity_samples(self.messages(VELOCITY))

    def swim(self, metadata: Mapping[str, str]) -> SwimRecord:
        """Return what the bag opened last holds of its swim, from the bytes that are in it.

        Args:
            metadata: Of that bag.
        """
        states = [decode(data, PLANT_STATE.type_name) for data in self.messages(PLANT_STATE)]
        joints, velocities, thrust = (self.messages(topic) for topic in (JOINT_STATES, VELOCITY, THRUST))
        return SwimRecord(self.velocity_samples(), states, joints, metadata, velocities, thrust)

    def messages(self, topic: Topic[Any]) -> Sequence[bytes]:
        """Return the serialised messages of the bag opened last, of one that a score is made of."""
        return self._subscription_to(topic).kept

    def close(self) -> BagSummary:
        """End the bag with every message that has arrived, and return what it holds.

        Raises:
            BagError: No bag is open, or a write failed. The recorder can open the next bag all the same.
        """
        if self._job is None:
            msg = "no bag is open"
            raise BagError(msg)
        for subscription in self._turns:
            subscription.take_waiting(ALL)
            subscription.stop()
        self._closing.set()
        job, self._job = self._job, None
        try:
            return job.result()
        finally:
            self._queue.clear()

    def destroy(self) -> None:
        """Close an open bag and stop listening.

        Raises:
            BagError: A write failed.
        """
        try:
            if self._job is not None:
                self.close()
        finally:
            for subscription in self._subscriptions.values():
                subscription.destroy()

    def _subscription_to(self, topic: Topic[Any]) -> Subscription:
        if topic.name not in self._subscriptions:
            msg = f"topic {topic.name} is not recorded: recorded are {', '.join(self._subscriptions)}"
            raise ValueError(msg)
        return self._subscriptions[topic.name]

    def _write(self, writer: BagWriter, job: Future[BagSummary]) -> None:
        """Write a bag and tell the job how it ended (in the recorder's thread)."""
        try:
            job.set_result(self._write_until_closed(writer))
        except Exception as error:  # noqa: BLE001  (whatever it is, close() raises it)
            job.set_exception(error)

    def _write_until_closed(self, writer: BagWriter) -> BagSummary:
        """Write what the callbacks put aside until the recorder closes."""
        with writer:
            closing = False
            while not closing:
                # Python ends only after this thread: a program that forgot to close must not wait for ever.
                closing = self._closing.wait(WRITE_PERIOD) or not threading.main_thread().is_alive()
                while self._queue:
                    writer.write(*self._queue.popleft())
                writer.flush_if_due()
        return writer.close()


class Extent:
    """Until when the streams of a swim are recorded. A plant that runs fast goes on for long before it is stopped."""

    def __init__(self) -> None:
        self._measurement: Measurement | None = None
        self._end: int | None = None

    def begin(self, measurement: Measurement | None) -> None:
        """Begin a bag, of a swim of which that part counts."""
        self._measurement, self._end = measurement, None

    def note(self, state: bytes) -> None:
        """Learn from a serialised plant_state when the swim has begun."""
        if self._measurement is None or self._end is not None:
            return
        with suppress(BagError, ScoreError):  # said again when the swim is scored, with its reason
            start = start_of_swim([decode(state, PLANT_STATE.type_name)], {})
            self._end = self._measurement.window(start).end_ns + TAIL

    def is_over(self, stamp: int) -> bool:
        """Return whether a stamp in ns lies behind the end. One far behind it is no plant's that merely went on."""
        return self._end is not None and 0 < stamp - self._end < _LONGEST_OVERRUN
