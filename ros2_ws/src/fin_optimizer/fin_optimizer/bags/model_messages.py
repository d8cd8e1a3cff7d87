"""What a 3-D view needs, computed into a bag from what was recorded: frames, shapes and path. Without ROS.

A live graph need not carry them for that: not every machine has the type of ``/tf``, and a fish that swims faster than
real time would have to publish them for nobody. Here each is made from the pose, the angles and the description that
the bag holds, a few of them a second of the plant's time.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fin_optimizer.bags.messages import BagError, decode, message_types
from fin_optimizer.bags.metadata import BagTopic
from fin_plant.frames import TANK, Frames, Pose, heading_of
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

FRAMES_PERIOD = NANOSECONDS // 25
MARKERS_PERIOD = NANOSECONDS // 10
PATH_PERIOD = 2 * NANOSECONDS
"""ns of the plant's time between two messages; a viewer draws the frames between two in between."""
PATH_STEP = NANOSECONDS // 5
TF, MARKERS, PATH = "/tf", "markers", "path"
DESCRIPTION, POSE, JOINT_STATES = "robot_description", "pose", "joint_states"
_STAMP_MARK = (0x5EED5EED, 0x2BADCAFE)
_LIFETIME = 1
"""s for which a marker is shown without another one."""
_KINDS = {"sphere": 2, "box": 1}
_NO_TIME = QosTime(0, 0)
_TYPES = {
    TF: "tf2_msgs/msg/TFMessage",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    PATH: "nav_msgs/msg/Path",
    DESCRIPTION: "std_msgs/msg/String",
    POSE: "geometry_msgs/msg/PoseStamped",
    JOINT_STATES: "sensor_msgs/msg/JointState",
}
_PLACE = struct.Struct("<7d")


def quality(*, latched: bool = False) -> Qos:
    """Return what a publisher of these topics offers."""
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    depth = 1 if latched else 1000
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        _NO_TIME,
        _NO_TIME,
        QosLiveliness.AUTOMATIC,
        _NO_TIME,
        avoid_ros_namespace_conventions=False,
    )


class ModelMessages:
    """Makes what a 3-D view needs of one fish, while its messages come in the order of their time.

    Attributes:
        topics: What it makes.
    """

    def __init__(self, namespace: str, prefix: str = "") -> None:
        """Know the fish by its namespace, absolute.

        Args:
            namespace: Of its topics.
            prefix: Before the names of its frames.
        """
        self._inputs = {f"{namespace}/{name}": name for name in (DESCRIPTION, POSE, JOINT_STATES)}
        self._markers, self._path = f"{namespace}/{MARKERS}", f"{namespace}/{PATH}"
        self.topics = tuple(
            BagTopic(name, _TYPES[kind], quality())
            for name, kind in ((TF, TF), (self._markers, MARKERS), (self._path, PATH))
        )
        self._prefix = prefix
        self._frames: Frames | None = None
        self._joints = _Joints()
        self._points: list[tuple[int, Pose]] = []
        self._last: dict[str, int] = {}
        self._templates: dict[str, _Template] = {}

    def take(self, topic: str, stamp: int, data: bytes) -> Iterator[tuple[str, bytes]]:
        """Take a message in, and yield topic and bytes of those that it leads to.

        Args:
            topic: Absolute name.
            stamp: Of the message, in ns.
            data: Serialised.
        """
        kind = self._inputs.get(topic)
        if kind == JOINT_STATES:
            self._joints.newest = data
        elif kind == DESCRIPTION:
            self._describe(data)
        elif kind == POSE:
            yield from self._at(stamp, data)

    def _describe(self, data: bytes) -> None:
        """Show the fish of this description from now on; one that is none shows nothing."""
        try:
            self._frames = Frames.from_urdf(decode(data, _TYPES[DESCRIPTION]).data, self._prefix)
        except (BagError, ValueError):
            self._frames = None
            return
        frames = self._frames
        rest, angles = Pose(0.0, 0.0, 0.0, 0.0), frames.angles({})
        self._templates = {TF: _frames_template(frames, rest, angles), MARKERS: _shapes_template(frames, rest, angles)}

    def _at(self, stamp: int, data: bytes) -> Iterator[tuple[str, bytes]]:
        due = [
            name
            for name, period in ((TF, FRAMES_PERIOD), (MARKERS, MARKERS_PERIOD), (PATH, PATH_PERIOD))
            if abs(stamp - self._last.get(name, stamp - period)) >= period
        ]
        wants_point = not self._points or abs(stamp - self._points[-1][0]) >= PATH_STEP
        if not due and not wants_point:
            return
        x, y, z, *turn = _PLACE.unpack_from(data, len(data) - _PLACE.size)
        pose = Pose(x, y, z, heading_of(*turn))
        if not all(map(math.isfinite, pose)):
            return
        if wants_point:
            self._points.append((stamp, pose))
        self._last |= dict.fromkeys(due, stamp)
        if PATH in due:
            yield self._path, _path(self._points)
        frames = self._frames
        if frames is None:
            return
        angles = frames.angles(self._joints.angles())
        if TF in due:
            moved = frames.transforms(pose, angles)
            numbers = [*moved[0][2:5]]
            for each in moved:
                numbers += math.sin(0.5 * each.angle), math.cos(0.5 * each.angle)
            yield TF, self._templates[TF].fill(stamp, numbers)
        if MARKERS in due:
            numbers = []
            for shape in frames.shapes(pose, angles)[1:]:
                half = 0.5 * shape.pose.heading
                numbers += *shape.pose[:3], math.sin(half), math.cos(half)
            yield self._markers, self._templates[MARKERS].fill(stamp, numbers)


class _Joints:
    """The newest angles, read from the bytes by the place that they had in a message of that length before."""

    def __init__(self) -> None:
        self.newest = b""
        self._length = self._offset = 0
        self._names: list[str] = []

    def angles(self) -> dict[str, float]:
        """Return the angles in rad by joint; none before the first message."""
        if not self.newest:
            return {}
        if len(self.newest) != self._length or not self._offset:
            message = decode(self.newest, _TYPES[JOINT_STATES])
            self._names, found = list(message.name), np.asarray(message.position, dtype="<f8").tobytes()
            first = self.newest.find(found) if found else -1
            # Elsewhere than once: which of them the angles are is told by the whole message alone.
            unique = first >= 0 and self.newest.find(found, first + 1) < 0
            self._length, self._offset = (len(self.newest), first) if unique else (0, 0)
            return dict(zip(self._names, map(float, message.position), strict=False))
        return dict(
            zip(self._names, struct.unpack_from(f"<{len(self._names)}d", self.newest, self._offset), strict=True)
        )


class _Template:
    """Serialised messages of one kind that differ in their stamps and in some numbers."""

    def __init__(self, type_name: str, numbers: int, build: Callable[[Any, Sequence[float]], Any]) -> None:
        """Learn where the numbers lie: each mark must stand in the message once.

        Args:
            type_name: Of the message.
            numbers: How many of type float64 it takes.
            build: Makes the message from a stamp and so many numbers.
        """
        marks = (-1.234567890123e-200 * (1.0 + np.arange(numbers))).tolist()
        stamp = _type("builtin_interfaces/msg/Time")(*_STAMP_MARK)
        self._pattern = bytes(message_types().serialize_cdr(build(stamp, marks), type_name))
        self._places = [self._pattern.index(struct.pack("<d", mark)) for mark in marks]
        mark, self._stamps = struct.pack("<iI", *_STAMP_MARK), []
        place = self._pattern.find(mark)
        while place >= 0:
            self._stamps.append(place)
            place = self._pattern.find(mark, place + 1)

    def fill(self, stamp: int, numbers: Sequence[float]) -> bytes:
        """Return the message of a stamp in ns and of numbers."""
        message = bytearray(self._pattern)
        time = divmod(stamp, NANOSECONDS)
        for place in self._stamps:
            struct.pack_into("<iI", message, place, *time)
        for place, number in zip(self._places, numbers, strict=True):
            struct.pack_into("<d", message, place, number)
        return bytes(message)


def _type(name: str) -> Any:
    return message_types().types[name]


def _header(stamp: Any, frame: str) -> Any:
    return _type("std_msgs/msg/Header")(stamp, frame)


def _turned(z: float, w: float) -> Any:
    return _type("geometry_msgs/msg/Quaternion")(0.0, 0.0, z, w)


def _pose(x: float, y: float, z: float, sine: float, cosine: float) -> Any:
    return _type("geometry_msgs/msg/Pose")(_type("geometry_msgs/msg/Point")(x, y, z), _turned(sine, cosine))


def _frames_template(frames: Frames, rest: Pose, angles: Sequence[float]) -> _Template:
    moved = frames.transforms(rest, angles)

    def build(stamp: Any, numbers: Sequence[float]) -> Any:
        turns = [_turned(*numbers[3 + 2 * n : 5 + 2 * n]) for n in range(len(moved))]
        places = [tuple(numbers[:3]), *((each.x, each.y, each.z) for each in moved[1:])]
        vector, stamped = _type("geometry_msgs/msg/Vector3"), _type("geometry_msgs/msg/TransformStamped")
        return _type(_TYPES[TF])(
            [
                stamped(
                    _header(stamp, each.parent),
                    each.child,
                    _type("geometry_msgs/msg/Transform")(vector(*place), turn),
                )
                for each, place, turn in zip(moved, places, turns, strict=True)
            ]
        )

    return _Template(_TYPES[TF], 3 + 2 * len(moved), build)


def _shapes_template(frames: Frames, rest: Pose, angles: Sequence[float]) -> _Template:
    floor, *moved = frames.shapes(rest, angles)
    colour, vector = _type("std_msgs/msg/ColorRGBA"), _type("geometry_msgs/msg/Vector3")
    duration, picture = _type("builtin_interfaces/msg/Duration"), _type("sensor_msgs/msg/CompressedImage")

    def build(stamp: Any, numbers: Sequence[float]) -> Any:
        poses = [_pose(0.0, 0.0, floor.pose.z, 0.0, 1.0)]
        poses += [_pose(*numbers[5 * n : 5 * n + 5]) for n in range(len(moved))]
        return _type(_TYPES[MARKERS])(
            [
                _type("visualization_msgs/msg/Marker")(
                    header=_header(stamp, TANK),
                    ns="fish",
                    id=number,
                    type=_KINDS[shape.kind],
                    action=0,
                    pose=pose,
                    scale=vector(*shape.size),
                    color=colour(*shape.colour),
                    lifetime=duration(_LIFETIME, 0),
                    frame_locked=False,
                    points=[],
                    colors=[],
                    texture_resource="",
                    texture=picture(_header(_type("builtin_interfaces/msg/Time")(0, 0), ""), "", np.zeros(0, np.uint8)),
                    uv_coordinates=[],
                    text="",
                    mesh_resource="",
                    mesh_file=_type("visualization_msgs/msg/MeshFile")("", np.zeros(0, np.uint8)),
                    mesh_use_embedded_materials=False,
                )
                for number, (shape, pose) in enumerate(zip([floor, *moved], poses, strict=True))
            ]
        )

    return _Template(_TYPES[MARKERS], 5 * len(moved), build)


def _path(points: Sequence[tuple[int, Pose]]) -> bytes:
    time = _type("builtin_interfaces/msg/Time")
    stamped = _type("geometry_msgs/msg/PoseStamped")
    poses = [
        stamped(
            _header(time(*divmod(stamp, NANOSECONDS)), TANK),
            _pose(*pose[:3], math.sin(0.5 * pose.heading), math.cos(0.5 * pose.heading)),
        )
        for stamp, pose in points
    ]
    message = _type(_TYPES[PATH])(_header(time(*divmod(points[-1][0], NANOSECONDS)), TANK), poses)
    return bytes(message_types().serialize_cdr(message, _TYPES[PATH]))
