"""The fish as it swims, for the page: ten times a second the newest message of each of its streams is taken.

They belong to a node that no executor spins: nothing of Python runs for the messages that are not taken.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import Marker

from fin_bringup.page.fish_shape import Piece, Shape, Speedometer, from_joints, from_pieces
from fin_optimizer.parameters import SIMULATOR
from fin_plant import topics
from fin_plant.fin import node_table
from fin_plant.messages import nanoseconds_of

if TYPE_CHECKING:
    from geometry_msgs.msg import Pose, PoseStamped
    from rclpy.subscription import Subscription

_NEWEST = QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1)
_MARKED, _MEASURED = (topics.MARKERS,), (topics.POSE, topics.JOINT_STATES, topics.VELOCITY)
"""What a simulated fish is seen by, ten times a second however fast it swims, and what a robot is."""
UNMARKED = 2.0
"""s after which a fish that tells where it is has no markers; they are not always the first that is discovered."""
_FISH = node_table("fin_sim", SIMULATOR)
_PEDUNCLE_LINK = 0.04
"""m. A robot does not tell how long its links are; its picture is not to scale."""
_FIN_RED = 0.9
"""Of the colour of a marker that is part of the fin; what a servo moves alone is grey."""


class FishStreams:
    """What is heard of a fish; only the newest message of each stream, and only when it is wanted."""

    def __init__(self, namespace: str) -> None:
        """Make the node; rclpy must be initialised. Nothing is listened to before `attend`."""
        self._node = Node("page_streams", namespace=namespace)
        self._taken: dict[str, Subscription] = {}
        self._newest: dict[str, Any] = {}
        self._speed = Speedometer()
        self._since = 0
        self._unmarked_since: float | None = None

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()

    def begin(self, stamp: int) -> None:
        """Note that the plant's state begins anew at ``stamp`` ns: the fish may have been put somewhere."""
        self._since = stamp
        self._speed.forget()

    def attend(self, now: float, *, listen: bool) -> None:
        """Listen to what there is at ``now`` s, or to nothing."""
        wanted = {topic.name: topic for topic in self._streams(now)} if listen else {}
        for name in self._taken.keys() - wanted.keys():
            self._node.destroy_subscription(self._taken.pop(name))
            self._newest.pop(name, None)
        for name in wanted.keys() - self._taken.keys():
            topic = wanted[name]
            self._taken[name] = self._node.create_subscription(topic.type, name, lambda _: None, _NEWEST)

    def _streams(self, now: float) -> tuple[topics.Topic[Any], ...]:
        """Return what a fish is seen by: its markers, or what tells where it is if it has none."""
        if any(map(self._published, _MARKED)) or not any(map(self._published, _MEASURED)):
            self._unmarked_since = None
            return _MARKED
        if self._unmarked_since is None:
            self._unmarked_since = now
        return _MEASURED if now - self._unmarked_since >= UNMARKED else _MARKED

    def _published(self, topic: topics.Topic[Any]) -> bool:
        return self._node.count_publishers(self._node.resolve_topic_name(topic.name)) > 0

    def frame(self, fin: Any) -> dict[str, Any] | None:
        """Return the fish as pages are told of it; None where nothing new has come."""
        came = Counter(self._take())
        if not came:
            return None
        shape = self._marked() if topics.MARKERS.name in self._taken else self._measured(fin)
        if shape is None or shape.stamp < self._since:
            return None
        speed = self._speed.speed(shape)
        if topics.MARKERS.name not in self._taken:
            newest = self._newest.get(topics.VELOCITY.name) if came[topics.VELOCITY.name] else None
            speed = float(newest.twist.linear.x) if newest is not None else None
        if speed is not None and not math.isfinite(speed):
            speed = None
        return {"kind": "frame", "time": shape.stamp / 1e9, "speed": speed, **shape.told()}

    def _take(self) -> list[str]:
        came = []
        for name, subscription in self._taken.items():
            with subscription.handle:
                while (taken := subscription.handle.take_message(subscription.msg_type, False)) is not None:  # noqa: FBT003  (not raw; a C++ function)
                    self._newest[name] = taken[0]
                    came.append(name)
        return came

    def _marked(self) -> Shape | None:
        """Return the fish as its markers show it: links come after the body, before it comes the floor of the tank."""
        markers = self._newest[topics.MARKERS.name].markers
        body = next((place for place, marker in enumerate(markers) if marker.type == Marker.SPHERE), None)
        if body is None:
            return None
        head, *links = (_piece(each.pose, each.scale.x, each.scale.y) for each in markers[body:])
        driven = sum(1 for marker in markers[body + 1 :] if marker.color.r < _FIN_RED)
        shape = from_pieces(nanoseconds_of(markers[body].header.stamp), head, links, driven)
        return shape if shape.is_finite else None

    def _measured(self, fin: Any) -> Shape | None:
        pose: PoseStamped | None = self._newest.get(topics.POSE.name)
        joints = self._newest.get(topics.JOINT_STATES.name)
        angles = [float(angle) for angle in joints.position] if joints is not None else []
        headers = [message.header.stamp for message in (pose, joints) if message is not None]
        if not headers:
            return None
        length, width, offset = (float(_FISH[f"body.{name}"].default) for name in ("length", "width", "tail_offset"))  # type: ignore[arg-type]
        body = Piece(0.0, 0.0, 0.0, length, width) if pose is None else _piece(pose.pose, length, width)
        if not all(map(math.isfinite, (body.x, body.y, body.heading, *angles))):
            return None
        try:
            fin_length = float(fin.get("fin.length", ""))
        except ValueError:
            fin_length = float(_FISH["fin.length"].default)  # type: ignore[arg-type]
        lengths = [*[_PEDUNCLE_LINK] * (len(angles) - 1), fin_length]
        return from_joints(max(map(nanoseconds_of, headers)), body, offset, lengths, angles or [0.0])


def _piece(pose: Pose, length: float, width: float) -> Piece:
    turn = pose.orientation
    heading = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))
    return Piece(float(pose.position.x), float(pose.position.y), heading, float(length), float(width))
