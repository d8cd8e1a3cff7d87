"""Where each link of a fish is: from its description, its pose and its joints' angles. Without ROS.

The one place for it: plants, the recorder of bags and viewers take their transforms and markers from here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self
from xml.etree import ElementTree as ET

from fin_plant.fish_model import BASE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

TANK = "tank"
FLOOR_DEPTH = 0.15
"""m below the fish at which a floor is drawn, so that one sees it move; nobody is told how deep the tank is."""
FLOOR = (3.0, 2.0, 0.002)
_FLOOR_COLOUR = (0.55, 0.65, 0.70, 0.35)
_NORM_TOLERANCE = 1e-3


class Pose(NamedTuple):
    """Where the body is in the tank: m, and its heading about z in rad."""

    x: float
    y: float
    z: float
    heading: float


class Transform(NamedTuple):
    """From a frame to one that is turned about its z axis: place in m, angle in rad."""

    parent: str
    child: str
    x: float
    y: float
    z: float
    angle: float


class Shape(NamedTuple):
    """A shape in the tank: ``sphere`` (an ellipsoid) or ``box``, its full axes in m, its colour with opacity."""

    kind: str
    pose: Pose
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]


@dataclass(frozen=True)
class _Joint:
    """A joint: name, frames, place of its child in its parent (m back along x), and its link's box, if it has one."""

    name: str
    parent: str
    child: str
    x: float
    middle: float
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]


@dataclass(frozen=True)
class Frames:
    """A fish's links, as `fin_plant.fish_model.urdf` describes them.

    Attributes:
        body: Full axes of the body in m.
        colour: Of the body.
        joints: From the head to the tail.
        prefix: Before the name of each frame but the tank's, where several fish swim.
    """

    body: tuple[float, float, float]
    colour: tuple[float, float, float, float]
    joints: tuple[_Joint, ...]
    prefix: str = ""

    @classmethod
    def from_urdf(cls, text: str, prefix: str = "") -> Self:
        """Read the description of a fish.

        Raises:
            ValueError: It is no URDF, or not that of a chain which begins at ``base_link``.
        """
        try:
            robot = ET.fromstring(text)  # noqa: S314  (a plant's own; expat refuses what blows up)
            colours = {m.attrib["name"]: _floats(m[0].attrib["rgba"]) for m in robot.findall("material")}
            visuals = {
                link.attrib["name"]: [_visual(each, colours) for each in link.findall("visual")]
                for link in robot.findall("link")
            }
            boxes = visuals[BASE]
            extents = [abs(middle) + 0.5 * size[0] for middle, size, _ in boxes]
            widest = [max(size[axis] for _, size, _ in boxes) for axis in (1, 2)]
            joints = tuple(_joint(each, visuals) for each in robot.findall("joint"))
            body = (2.0 * max(extents), *widest)
            return cls(body, boxes[0][2], joints, prefix)
        except (ET.ParseError, LookupError, TypeError, ValueError, AttributeError) as error:
            msg = f"robot_description is not that of a fish ({type(error).__name__}: {error})"
            raise ValueError(msg) from error

    def angles(self, joints: Mapping[str, float]) -> list[float]:
        """Return the angle in rad of each joint, from those known by name; one that is not told is straight."""
        return [joints.get(joint.name, 0.0) for joint in self.joints]

    def transforms(self, pose: Pose, angles: Sequence[float]) -> list[Transform]:
        """Return the transforms ``tank`` to ``base_link`` and on along the tail.

        Args:
            pose: Of the body.
            angles: rad, one a joint.
        """
        chain = [Transform(TANK, f"{self.prefix}{BASE}", *pose)]
        for joint, angle in zip(self.joints, angles, strict=True):
            chain.append(
                Transform(f"{self.prefix}{joint.parent}", f"{self.prefix}{joint.child}", joint.x, 0.0, 0.0, angle)
            )
        return chain

    def shapes(self, pose: Pose, angles: Sequence[float]) -> list[Shape]:
        """Return floor, body and links in the tank, in this order; arguments as for `transforms`."""
        floor = Pose(0.0, 0.0, -FLOOR_DEPTH, 0.0)
        found = [Shape("box", floor, FLOOR, _FLOOR_COLOUR), Shape("sphere", pose, self.body, self.colour)]
        x, y, z, heading = pose
        for joint, angle in zip(self.joints, angles, strict=True):
            x, y = x + joint.x * math.cos(heading), y + joint.x * math.sin(heading)
            heading += angle
            middle = Pose(x + joint.middle * math.cos(heading), y + joint.middle * math.sin(heading), z, heading)
            found.append(Shape("box", middle, joint.size, joint.colour))
        return found


def heading_of(x: float, y: float, z: float, w: float) -> float:
    """Return the heading in rad of an orientation: of a quaternion, or of a tracker that puts the angle into its z."""
    if x == y == w == 0.0 and abs(abs(z) - 1.0) > _NORM_TOLERANCE:
        return z
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def frame_prefix(namespace: str, default: str) -> str:
    """Return what the frames of a fish in this namespace begin with; nothing in the default one."""
    return "" if namespace == default else f"{namespace.strip('/')}/"


def _floats(text: str) -> tuple[Any, ...]:
    return tuple(map(float, text.split()))


def _visual(element: ET.Element, colours: Mapping[str, tuple[float, ...]]) -> tuple[float, Any, Any]:
    """Return middle along x, axes and colour of a box."""
    (box,) = element.findall("geometry/box")
    (origin,) = element.findall("origin")
    (material,) = element.findall("material")
    return _floats(origin.attrib["xyz"])[0], _floats(box.attrib["size"]), colours[material.attrib["name"]]


def _joint(element: ET.Element, visuals: Mapping[str, Sequence[tuple[float, Any, Any]]]) -> _Joint:
    parent, child, origin = (element.find(name) for name in ("parent", "child", "origin"))
    if parent is None or child is None or origin is None:
        msg = f"joint {element.get('name')} lacks its parent, its child or its origin"
        raise ValueError(msg)
    name = child.attrib["link"]
    ((middle, size, colour),) = visuals[name]
    x = _floats(origin.attrib["xyz"])[0]
    return _Joint(element.attrib["name"], parent.attrib["link"], name, x, middle, size, colour)
