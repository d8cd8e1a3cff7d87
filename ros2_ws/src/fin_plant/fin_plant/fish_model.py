"""What a fish looks like: a URDF of body, peduncle and fin, for viewers. Without ROS.

Names and signs are those of ``joint_states``: ``tail_joint_1`` and on for the driven joints, ``fin_hinge_1`` and on
for the hinges of a fin that is computed. A real fin tells no angles of its hinges: it is one fixed link.
Frames follow REP 103: `base_link` lies in the middle of the body, x forward, y left, z up; the frame of a link of the
tail lies in its joint, and the link extends backwards from there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from fin_plant import checks
from fin_plant.validity import HINGE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_plant.fin import Fin

BASE = "base_link"
DRIVEN = "tail_joint_"
"""What the names of the driven joints begin with; their numbers count from 1, from the head to the tail."""
_SLICES = 12
"""Boxes that stand for the ellipsoid of the body: a URDF has none."""
_SHEET = 0.002
"""m; thinner sheets would not be seen."""
_DRIVEN_WIDTH = 0.012
"""m; about the width of a servo's horn and the hull around it."""
_FULL_TURN = math.pi
COLOURS = {"body": (0.16, 0.35, 0.54, 1.0), "peduncle": (0.35, 0.35, 0.38, 1.0), "fin": (0.93, 0.55, 0.14, 1.0)}
"""Red, green, blue and opacity of the materials."""


@dataclass(frozen=True)
class BodyShape:
    """Full axes of the ellipsoid of the body and the way from its middle back to the first joint, m.

    The defaults are the simulator's: of a robot no file tells its hull.
    """

    length: float = 0.14
    width: float = 0.045
    height: float = 0.06
    tail_offset: float = 0.07

    def __post_init__(self) -> None:
        for name in ("length", "width", "height"):
            checks.number(f"body.{name}", getattr(self, name), 0.0, unit="m", exclusive_minimum=True)
        checks.number("body.tail_offset", self.tail_offset, 0.0, unit="m")


@dataclass(frozen=True)
class LinkShape:
    """A link of the tail as it is drawn.

    Attributes:
        joint: Name of the joint at its front end; without a name it is fixed to the link before.
        length: m.
        height: Mean height, m.
        material: One of `COLOURS`.

    Raises:
        ValueError: A length or a height of 0, which cannot be shown.
    """

    joint: str
    length: float
    height: float
    material: str = "fin"

    def __post_init__(self) -> None:
        for name in ("length", "height"):
            value = getattr(self, name)
            advice = "a link without it cannot be shown"
            checks.number(f"{name} of a link of the tail", value, 0.0, unit="m", exclusive_minimum=True, advice=advice)


_PEDUNCLE = (0.03, 0.045)
"""Length and height in m of a driven link of which nothing but its joint is known."""


def joint_names(driven: Sequence[bool]) -> list[str]:
    """Return the names of a computed tail's joints from the head to the tail, for each of which it says if driven."""
    count = sum(driven)
    tail = [f"{DRIVEN}{number}" for number in range(1, count + 1)]
    return tail + [f"{HINGE}{number}" for number in range(1, len(driven) - count + 1)]


def hinge_links(lengths: Sequence[float], heights: Sequence[float], driven: Sequence[bool]) -> tuple[LinkShape, ...]:
    """Return the tail of a computed fish, of which each link has a joint.

    Args:
        lengths: Of the links from the head to the tail, m.
        heights: Their mean heights, m.
        driven: Whether the joint of each is driven; those come first. The last of them is the fin's own first.
    """
    materials = ["peduncle"] * (sum(driven) - 1)
    materials += ["fin"] * (len(lengths) - len(materials))
    names = joint_names(driven)
    return tuple(map(LinkShape, names, lengths, heights, materials))


def robot_links(fin: Fin, driven_joints: int) -> tuple[LinkShape, ...]:
    """Return the tail of a robot: a link a driven joint, the last of which bears the fin.

    Args:
        fin: The fin.
        driven_joints: How many, 1 or more.
    """
    names = [f"{DRIVEN}{number}" for number in range(1, driven_joints + 1)]
    peduncle = tuple(LinkShape(name, *_PEDUNCLE, "peduncle") for name in names[:-1])
    return (*peduncle, LinkShape(names[-1], fin.length, fin.area / fin.length))


def urdf(body: BodyShape, links: Sequence[LinkShape], name: str = "fish") -> str:
    """Return the description of a fish as URDF, with the links ``base_link``, ``tail_link_1`` and on.

    Args:
        body: The body.
        links: The tail's, from the head to the tail; lengths in m.
        name: Of the robot in the description.
    """
    robot = ET.Element("robot", name=name)
    for material, colour in COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=material), "color", rgba=_numbers(*colour))
    base = ET.SubElement(robot, "link", name=BASE)
    thickness = body.length / _SLICES
    for index in range(_SLICES):
        middle = (index + 0.5) * thickness - 0.5 * body.length
        share = math.sqrt(1.0 - (2.0 * middle / body.length) ** 2)
        _box(base, middle, (thickness, share * body.width, share * body.height), "body")
    parent, place = BASE, -body.tail_offset
    for number, link in enumerate(links, start=1):
        child = f"tail_link_{number}"
        element = ET.SubElement(robot, "link", name=child)
        width = _DRIVEN_WIDTH if link.material == "peduncle" else _SHEET
        _box(element, -0.5 * link.length, (link.length, width, link.height), link.material)
        kind = "revolute" if link.joint else "fixed"
        joint = ET.SubElement(robot, "joint", name=link.joint or f"{child}_fixed", type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "origin", xyz=_numbers(place, 0.0, 0.0), rpy="0 0 0")
        if link.joint:
            ET.SubElement(joint, "axis", xyz="0 0 1")
            limits = {"lower": -_FULL_TURN, "upper": _FULL_TURN, "effort": 0.0, "velocity": 0.0}
            ET.SubElement(joint, "limit", {key: f"{value:.6g}" for key, value in limits.items()})
        parent, place = child, -link.length
    ET.indent(robot, " ")
    return ET.tostring(robot, encoding="unicode", xml_declaration=True)


def _box(link: ET.Element, x: float, size: tuple[float, float, float], material: str) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_numbers(x, 0.0, 0.0), rpy="0 0 0")
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_numbers(*size))
    ET.SubElement(visual, "material", name=material)


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.6g}" for value in values)
