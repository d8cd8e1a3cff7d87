"""A swimmer of one's own from a YAML file: ellipses, outlines and fins, and how their joints move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_plant import checks, yaml_file
from fin_sim.ideal_2d.elastic import Joint
from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import Section, ellipse, fin, joined_ellipse, outline
from fin_sim.ideal_2d.stroke import JointAngle

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_KEYS = {"density", "period", "strokes", "links"}
_SHAPES = ("ellipse", "outline", "fin")
_LINK_KEYS = {*_SHAPES, "name", "nodes", "mass", "inertia", "joined_to", "at", "own", "angle", "spring"}
_FIN_NODES, _JOINED_BODY_NODES = 24, 128
_SAME = 1e-9
MOST_LINKS, MOST_STROKES = 12, 200


@dataclass(frozen=True)
class Spring:
    """A joint that nothing drives.

    Attributes:
        stiffness: N m/rad per metre of depth.
        damping: N m s/rad per metre of depth.
        rest: Angle without torque, rad.
    """

    stiffness: float
    damping: float = 0.0
    rest: float = 0.0


@dataclass(frozen=True)
class Swimmer:
    """What a file describes.

    Attributes:
        linkage: What swims.
        names: Of its members.
        joints: Angle or spring of each joint.
        period: Of a stroke, s.
        strokes: How many are swum from rest, where a joint has a spring.
    """

    linkage: Linkage
    names: tuple[str, ...]
    joints: tuple[JointAngle | Spring, ...]
    period: float
    strokes: int

    @property
    def is_driven(self) -> bool:
        """Whether every joint's angle is prescribed."""
        return all(isinstance(joint, JointAngle) for joint in self.joints)

    def moving_joints(self) -> list[Joint]:
        """Return the joints as `elastic.move` takes them; at time 0 springs are at rest, driven joints start at once.

        The drive begins with a ramp over the first stroke, so that nothing jumps.
        """
        joints = []
        for joint in self.joints:
            if isinstance(joint, Spring):
                joints.append(Joint(None, joint.stiffness, joint.damping, joint.rest, joint.rest))
            else:
                joints.append(Joint(lambda time, angle=joint: self._ramped(angle, time)))  # type: ignore[misc]
        return joints

    def _ramped(self, angle: JointAngle, time: float) -> tuple[float, float]:
        turn = 2.0 * math.pi * time / self.period
        values, slopes = angle.at(np.array([turn]))
        x = min(max(time / self.period, 0.0), 1.0)
        ramp, rise = x**3 * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) ** 2 / self.period
        rate = float(slopes[0]) * 2.0 * math.pi / self.period
        return ramp * float(values[0]), ramp * rate + rise * float(values[0])


def read_swimmer(path: Path) -> Swimmer:
    """Return the swimmer of a file.

    Raises:
        ValueError: Something in it that cannot be; the message names file, link and key.
        OSError: The file cannot be read.
    """
    try:
        return swimmer_from(yaml_file.read(path))
    except ValueError as error:
        msg = str(error) if str(error).startswith(str(path)) else f"{path}: {error}"
        raise ValueError(msg) from error


def swimmer_from(content: Any) -> Swimmer:
    """Return the swimmer that a file's content describes.

    Raises:
        ValueError: See `read_swimmer`.
    """
    values = _mapping("the file", content, _KEYS)
    density = _number(values, "density", 1000.0, positive=True)
    period = _number(values, "period", 1.0, positive=True)
    strokes = checks.whole_number("strokes", values.get("strokes", 10), 1, MOST_STROKES)
    links = values.get("links")
    if not isinstance(links, list) or not 2 <= len(links) <= MOST_LINKS:  # noqa: PLR2004
        msg = f"links must be a list of 2 to {MOST_LINKS} links, from the one whose axes count to those joined to it"
        raise ValueError(msg)
    given = [_mapping(f"link {number}", link, _LINK_KEYS) for number, link in enumerate(links, start=1)]
    names = [str(link.get("name", number)) for number, link in enumerate(given, start=1)]
    if len(set(names)) < len(names):
        msg = f"links are named {', '.join(names)}: give each its own name"
        raise ValueError(msg)
    plans = [_plan(index, link, given, names) for index, link in enumerate(given)]
    members = []
    joints: list[JointAngle | Spring] = []
    for index, (link, plan) in enumerate(zip(given, plans, strict=True)):
        try:
            members.append(_member(link, plan, plans, density, index))
            if index > 0:
                joints.append(_joint(link))
        except ValueError as error:
            msg = f"link {names[index]}: {error}"
            raise ValueError(msg) from error
    if not any(isinstance(joint, JointAngle) and joint.waves for joint in joints):
        msg = "no joint has an angle with waves: nothing moves; give one at least"
        raise ValueError(msg)
    return Swimmer(Linkage(members, density), tuple(names), tuple(joints), period, strokes)


@dataclass(frozen=True)
class _Plan:
    """Where a link is joined, and how: parent's index, place in its axes and in the link's own, whether they touch."""

    shape: str
    parent: int
    at: complex
    own: complex
    sealed: bool


def _plan(index: int, link: Mapping[str, Any], given: list[dict[str, Any]], names: list[str]) -> _Plan:
    where = f"link {names[index]}"
    shapes = [name for name in _SHAPES if name in link]
    if len(shapes) != 1:
        msg = f"{where} has {' and '.join(shapes) or 'no shape'}: give it one of ellipse, outline and fin"
        raise ValueError(msg)
    if index == 0:
        for key in ("joined_to", "at", "own", "angle", "spring"):
            if key in link:
                msg = f"{where} is the first, it has no joint: leave out {key}"
                raise ValueError(msg)
        return _Plan(shapes[0], -1, 0j, 0j, sealed=False)
    parent = index - 1
    if "joined_to" in link:
        name = str(link["joined_to"])
        if name not in names[:index]:
            msg = f"{where} is joined_to {name}: it must be a link before it, {', '.join(names[:index])}"
            raise ValueError(msg)
        parent = names.index(name)
    rear = _rear(given[parent])
    at = _point(link, "at", where, rear)
    own = _point(link, "own", where, 0j if shapes[0] == "fin" else None)
    touches = shapes[0] == "fin" and abs(own) <= _SAME and rear is not None and abs(at - rear) <= _SAME
    return _Plan(shapes[0], parent, at, own, touches)


def _rear(link: Mapping[str, Any]) -> complex | None:
    """Return the rear end of a fin or an ellipse, where a fin is joined unless the file says otherwise."""
    if isinstance(link.get("fin"), int | float):
        return complex(-float(link["fin"]))
    axes = link.get("ellipse")
    if isinstance(axes, list) and axes and isinstance(axes[0], int | float):
        return complex(-float(axes[0]))
    return None


def _section(link: Mapping[str, Any], plan: _Plan, *, followed: bool) -> Section:
    if plan.shape == "outline" and "nodes" in link:
        msg = "an outline's points are its nodes: leave out nodes, and give more points"
        raise ValueError(msg)
    nodes = checks.whole_number("nodes", link["nodes"], 8, 2000) if "nodes" in link else 0
    if plan.shape == "fin":
        length = _number(link, "fin", None, positive=True)
        return fin(length, nodes or _FIN_NODES, front_joined=plan.sealed, rear_joined=followed)
    if plan.shape == "outline":
        points = link["outline"]
        if not isinstance(points, list) or not all(_is_point(point) for point in points):
            msg = "outline must be a list of points [x, y], m"
            raise ValueError(msg)
        return outline([(float(x), float(y)) for x, y in points])
    axes = link["ellipse"]
    if not _is_point(axes):
        msg = f"ellipse = {axes} must be its two semi-axes [along x, along y], m"
        raise ValueError(msg)
    a, b = float(axes[0]), float(axes[1])
    return joined_ellipse(a, b, nodes or _JOINED_BODY_NODES) if followed else ellipse(a, b, 2 * (nodes // 2))


def _member(link: Mapping[str, Any], plan: _Plan, plans: list[_Plan], density: float, index: int) -> Member:
    followers = [other for other in plans if other.parent == index and other.sealed]
    if len(followers) > 1:
        msg = "two fins begin at its rear end: join one of them a little apart, with at"
        raise ValueError(msg)
    section = _section(link, plan, followed=bool(followers))
    mass = _number(link, "mass", density * section.area)
    share = mass / section.area if section.area else 0.0
    about = section.second_moment if section.area else 0.0
    length = abs(section.ends[1]) if section.is_fin else 0.0
    inertia = _number(link, "inertia", share * about if section.area else mass * length**2 / 12.0)
    return Member(
        section=section,
        mass=mass,
        inertia=inertia,
        centre=section.centroid,
        joint=plan.own,
        parent=plan.parent,
        parent_joint=plan.at,
        sealed=plan.sealed,
    )


def _joint(link: Mapping[str, Any]) -> JointAngle | Spring:
    if ("angle" in link) == ("spring" in link):
        msg = "its joint needs either angle, how it moves, or spring"
        raise ValueError(msg)
    if "spring" in link:
        spring = _mapping("spring", link["spring"], {"stiffness", "damping", "rest"})
        rest = checks.number("rest", spring.get("rest", 0.0), -math.pi, math.pi, unit="rad")
        return Spring(_number(spring, "stiffness", None, positive=True), _number(spring, "damping", 0.0), rest)
    angle = _mapping("angle", link["angle"], {"offset", "amplitude", "phase", "harmonics"})
    waves: list[tuple[int, float, float]] = []
    if "phase" in angle and "amplitude" not in angle:
        msg = "angle has a phase without an amplitude: give both"
        raise ValueError(msg)
    if "amplitude" in angle:
        waves.append((1, *_wave(angle)))
    harmonics = angle.get("harmonics", [])
    if not isinstance(harmonics, list):
        msg = f"harmonics = {harmonics} must be a list of {{order, amplitude, phase}}"
        raise ValueError(msg)
    for wave in harmonics:
        given = _mapping("harmonics", wave, {"order", "amplitude", "phase"})
        waves.append((checks.whole_number("order", given.get("order"), 1, 20), *_wave(given)))
    return JointAngle(checks.number("offset", angle.get("offset", 0.0), -math.pi, math.pi, unit="rad"), tuple(waves))


def _wave(values: Mapping[str, Any]) -> tuple[float, float]:
    if "amplitude" not in values:
        msg = "a wave has no amplitude: give it one, rad"
        raise ValueError(msg)
    amplitude = checks.number("amplitude", values["amplitude"], -math.pi, math.pi, unit="rad")
    return amplitude, checks.number("phase", values.get("phase", 0.0), unit="rad")


def _mapping(name: str, value: Any, known: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict):
        msg = f"{name} must be a mapping of {', '.join(sorted(known))}"
        raise ValueError(msg)
    for key in value:
        if key not in known:
            msg = f"{name} has the unknown key {key}: known are {', '.join(sorted(known))}"
            raise ValueError(msg)
    return value


def _number(values: Mapping[str, Any], name: str, default: float | None, *, positive: bool = False) -> float:
    value = values.get(name, default)
    if value is None:
        msg = f"{name} is missing: give it a number"
        raise ValueError(msg)
    return checks.number(name, value, 0.0, exclusive_minimum=positive)


def _is_point(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 2  # noqa: PLR2004
        and all(isinstance(item, int | float) and not isinstance(item, bool) for item in value)
        and all(map(math.isfinite, value))
    )


def _point(link: Mapping[str, Any], key: str, where: str, default: complex | None) -> complex:
    value = link.get(key)
    if value is None and default is not None:
        return default
    if not _is_point(value) or value is None:
        axes = "its parent's axes" if key == "at" else "its own axes"
        msg = f"{where}: {key} = {value} must be [x, y], m, where its joint is in {axes}"
        raise ValueError(msg)
    return complex(float(value[0]), float(value[1]))
