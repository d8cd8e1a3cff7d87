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

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.type_support import check_is_valid_msg_type
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fin_optimizer.bags.messages import BagError, decode, header_stamp, tells_plants_time, velocity_samples
from fin_optimizer.bags.metadata import BagSummary, BagTopic
from fin_optimizer.bags.model_messages import ModelMessages
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.score.mean_speed import LONGEST_GAP, ScoreError
from fin_optimizer.score.swim import SwimRecord, start_of_swim
from fin_plant.discovery import ends_of, request, wanted
from fin_plant.frames import frame_prefix
from fin_plant.stamps import NANOSECONDS
from fin_plant.topics import (
    EVERY_MESSAGE,
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
    from rclpy.duration import Duration
    from rclpy.node import Node

    from fin_optimizer.score.mean_speed import Measurement

TAIL = round(LONGEST_GAP * NANOSECONDS)
"""ns of the plant's time behind the window that a bag still holds: a score may need a sample so far beyond it."""
_LONGEST_OVERRUN = 600 * NANOSECONDS
_BY_TRUST = (JOINT_STATES.name, VELOCITY.name, POSE.name)
_KEPT = (VELOCITY.name, JOINT_STATES.name, PLANT_STATE.name, THRUST.name)
"""Topics that a score is made of, which it takes from memory."""
WRITE_PERIOD = 0.02
"""s between two visits of the writing thread; messages wait in memory no longer."""
TAKEN_AT_ONCE = 500
"""Messages of one topic that `listen` takes before its owner and other callbacks have their turn."""
ALL = 100_000
"""More messages than any queue of the middleware holds."""
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
            topic.name: _Subscription(node, topic, self._queue, self._extent, namespace) for topic in topics
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
            BagTopic(subscription.name, subscription.topic.type_name, _bag_qos(subscription.offered))
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

    def _subscription_to(self, topic: Topic[Any]) -> _Subscription:
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


class _Subscription:
    """Listens to one topic; ``queue`` gets its messages while a bag is open."""

    def __init__(
        self, node: Node, topic: Topic[Any], queue: deque[tuple[str, bytes]], extent: Extent, namespace: str
    ) -> None:
        self._extent = extent
        self._node = node
        self.topic = topic
        self._asked = request((), wanted(topic))
        self.with_header = tells_plants_time(topic.type_name)
        self.received = 0
        self.last: bytes | None = None
        self.kept: list[bytes] = []
        self._queue = queue
        self._recording = False
        check_is_valid_msg_type(topic.type)
        self._handle = self._subscription(topic.name_in(namespace))
        with self._handle:
            self.name = str(self._handle.get_topic_name())

    def _subscription(self, name: str) -> Any:
        """Return what Node.create_subscription makes, without the part that puts it into the node's executor."""
        qos = _with_policies(EVERY_MESSAGE, *self._asked).get_c_qos_profile()
        with self._node.handle:
            return rclpy_implementation.Subscription(self._node.handle, self.topic.type, name, qos)

    @property
    def offered(self) -> QoSProfile:
        """What all publishers offer, as far as it is known."""
        return _with_policies(self.topic.qos, *self._asked)

    def adapt(self, *, records: bool) -> None:
        """Ask for what all publishers offer, if that is another thing than before.

        Args:
            records: Whether a bag is open: then nothing is changed but what could not be heard otherwise.
        """
        reliable, latched = request(ends_of(self._node.get_publishers_info_by_topic(self.name)), wanted(self.topic))
        if records:
            reliable, latched = reliable and self._asked[0], latched and self._asked[1]
        if (reliable, latched) != self._asked:
            self.take_waiting(ALL)
            self._handle.destroy_when_not_in_use()
            self._asked = reliable, latched
            self._handle = self._subscription(self.name)

    @property
    def publishers(self) -> int:
        """Number of publishers that the topic is matched with."""
        with self._handle:
            return int(self._handle.get_publisher_count())

    def destroy(self) -> None:
        """Stop listening."""
        self._handle.destroy_when_not_in_use()

    @property
    def _latched(self) -> bool:
        return bool(self.topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    def start(self) -> None:
        """Record from now on, beginning with what a latched topic said last."""
        self.kept = []
        self._recording = True
        if self._latched and self.last is not None:
            self._record(self.last)

    def stop(self) -> None:
        """Record no longer."""
        self._recording = False

    def take_waiting(self, limit: int = TAKEN_AT_ONCE) -> int:
        """Take messages that have arrived; return their number."""
        raw = True
        with self._handle:
            for count in range(limit):
                taken = self._handle.take_message(self.topic.type, raw)
                if taken is None:
                    return count
                self.received += 1
                self.last = taken[0]
                if self._recording:
                    self._record(self.last)
        return limit

    def _record(self, data: bytes) -> None:
        if self.topic is PLANT_STATE:
            self._extent.note(data)
        elif self.with_header and self._extent.is_over(header_stamp(data)):
            return
        self._queue.append((self.name, data))
        if self.topic.name in _KEPT:
            self.kept.append(data)


def _with_policies(qos: QoSProfile, reliable: bool, latched: bool) -> QoSProfile:
    """Return a quality of service with these policies."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        history=qos.history,
        depth=qos.depth,
    )


def _bag_qos(qos: QoSProfile) -> Qos:
    """Return a quality of service as bags hold it."""
    return Qos(
        QosHistory[qos.history.name],
        qos.depth,
        QosReliability[qos.reliability.name],
        QosDurability[qos.durability.name],
        _bag_time(qos.deadline),
        _bag_time(qos.lifespan),
        QosLiveliness[qos.liveliness.name],
        _bag_time(qos.liveliness_lease_duration),
        qos.avoid_ros_namespace_conventions,
    )


def _bag_time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, NANOSECONDS))
