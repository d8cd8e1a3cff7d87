"""One topic as a recorder listens to it: all at once, as bytes, with the quality of service that is offered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.type_support import check_is_valid_msg_type
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fin_optimizer.bags.messages import header_stamp, tells_plants_time
from fin_plant.discovery import ends_of, request, wanted
from fin_plant.stamps import NANOSECONDS
from fin_plant.topics import EVERY_MESSAGE, JOINT_STATES, PLANT_STATE, THRUST, VELOCITY, Topic

if TYPE_CHECKING:
    from collections import deque

    from rclpy.duration import Duration
    from rclpy.node import Node

    from fin_optimizer.trial.recorder import Extent

_KEPT = (VELOCITY.name, JOINT_STATES.name, PLANT_STATE.name, THRUST.name)
"""Topics that a score is made of, which it takes from memory."""
TAKEN_AT_ONCE = 500
"""Messages of one topic that are taken before its owner and other callbacks have their turn."""
ALL = 100_000
"""More messages than any queue of the middleware holds."""


class Subscription:
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


def bag_qos(qos: QoSProfile) -> Qos:
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
