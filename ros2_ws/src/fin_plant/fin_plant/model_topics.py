"""What viewers need, published by a plant: the fish's description, its frames, its shapes and its path.

`tf2_msgs` is not among the wheels of ROS 2: without it there are no frames on ``/tf``, and markers and path show the
fish all the same. Nothing is computed for a topic to which nobody listens.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # a machine with the wheels only
    TFMessage = None

from fin_plant import topics
from fin_plant.frames import TANK, Frames, Pose, frame_prefix
from fin_plant.messages import time_message
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from builtin_interfaces.msg import Time
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from fin_plant.frames import Shape, Transform

_FRAMES_PERIOD, _MARKERS_PERIOD, _PATH_PERIOD = 0.02, 0.1, 0.5
"""s of the wall clock between two messages, at least."""
PATH_STEP = NANOSECONDS // 5
"""ns of the plant's time between two points of a path."""
LONGEST_PATH = 3000
"""Points: ten minutes."""
_LIFETIME = Duration(sec=1)
"""Of a marker: a link that is gone, of a longer fin before, vanishes."""
_KINDS = {"sphere": Marker.SPHERE, "box": Marker.CUBE}


class ModelTopics:
    """Publishes what a viewer needs of one fish.

    Attributes:
        frames: Of the description told last; None before.
    """

    def __init__(self, node: Node) -> None:
        """Offer the topics, ``/tf`` only where its type is installed."""
        self.frames: Frames | None = None
        self._prefix = frame_prefix(node.get_namespace(), topics.NAMESPACE)
        self._markers, self._path = (
            node.create_publisher(topic.type, topic.name, topic.qos) for topic in (topics.MARKERS, topics.PATH)
        )
        self._tf: Publisher | None = None
        if TFMessage is not None:
            self._tf = node.create_publisher(TFMessage, topics.TF, topics.STREAM)
        self._points: deque[tuple[int, Pose]] = deque(maxlen=LONGEST_PATH)
        self._frames_due = self._markers_due = self._path_due = -math.inf

    def restart(self) -> None:
        """Begin the path anew."""
        self._points.clear()

    @property
    def heard(self) -> bool:
        """Whether anybody listens to what is computed from joints."""
        return bool(self._markers.get_subscription_count() or (self._tf and self._tf.get_subscription_count()))

    def take_description(self, text: str) -> None:
        """Show the fish of this description from now on.

        Raises:
            ValueError: It is not that of a fish.
        """
        self.frames = Frames.from_urdf(text, self._prefix)

    def tell(self, stamp: int, pose: Pose, joints: Mapping[str, float]) -> None:
        """Publish what is due.

        Args:
            stamp: Of the plant, in ns.
            pose: Of the body.
            joints: Angles by name, rad.
        """
        if not self._points or abs(stamp - self._points[-1][0]) >= PATH_STEP:
            self._points.append((stamp, pose))
        now = time.monotonic()
        if now >= self._path_due and self._path.get_subscription_count():
            self._path_due = now + _PATH_PERIOD
            self._path.publish(path_message(self._points))
        frames = self.frames
        if frames is None or (now < self._frames_due and now < self._markers_due):
            return
        if now >= self._frames_due:
            self._frames_due = now + _FRAMES_PERIOD
            if self._tf is not None and self._tf.get_subscription_count():
                transforms = frames.transforms(pose, frames.angles(joints))
                stamp_message = time_message(stamp)
                self._tf.publish(TFMessage(transforms=[_transform(stamp_message, each) for each in transforms]))
        if now >= self._markers_due:
            self._markers_due = now + _MARKERS_PERIOD
            if self._markers.get_subscription_count():
                self._markers.publish(markers_message(time_message(stamp), frames.shapes(pose, frames.angles(joints))))


class DescriptionTopic:
    """Publishes a plant's description when it has changed."""

    def __init__(self, node: Node) -> None:
        topic = topics.ROBOT_DESCRIPTION
        self._publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self._told = ""

    def tell(self, text: str) -> None:
        """Publish a description, unless it was the last one."""
        if text != self._told:
            self._told = text
            self._publisher.publish(String(data=text))


def path_message(points: Sequence[tuple[int, Pose]]) -> Path:
    """Return the message of a path: stamps in ns and poses."""
    message = Path()
    message.header.frame_id = TANK
    message.poses = [PoseStamped(pose=_pose(pose)) for _, pose in points]
    for each, (stamp, _) in zip(message.poses, points, strict=True):
        each.header.frame_id, each.header.stamp = TANK, time_message(stamp)
    if points:
        message.header.stamp = time_message(points[-1][0])
    return message


def markers_message(stamp: Time, shapes: Sequence[Shape]) -> MarkerArray:
    """Return the message of shapes at a time."""
    return MarkerArray(markers=[_marker(stamp, number, shape) for number, shape in enumerate(shapes)])


def _marker(stamp: Time, number: int, shape: Shape) -> Marker:
    red, green, blue, opacity = shape.colour
    marker = Marker(ns="fish", id=number, type=_KINDS[shape.kind], action=Marker.ADD, pose=_pose(shape.pose))
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=opacity)
    marker.lifetime = _LIFETIME
    marker.header.frame_id, marker.header.stamp = TANK, stamp
    marker.scale.x, marker.scale.y, marker.scale.z = shape.size
    return marker


def _pose(pose: Pose) -> PoseMessage:
    message = PoseMessage()
    place, turn = message.position, message.orientation
    place.x, place.y, place.z = pose.x, pose.y, pose.z
    turn.z, turn.w = math.sin(pose.heading / 2.0), math.cos(pose.heading / 2.0)
    return message


def _transform(stamp: Time, transform: Transform) -> TransformStamped:
    message = TransformStamped(child_frame_id=transform.child)
    message.header.frame_id, message.header.stamp = transform.parent, stamp
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = transform.x, transform.y, transform.z
    turn.z, turn.w = math.sin(transform.angle / 2.0), math.cos(transform.angle / 2.0)
    return message
