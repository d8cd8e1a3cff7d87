"""The robot's one YAML file: device, port, and each joint's channel, calibration and limits."""

from __future__ import annotations

import math
import os
import shutil
import tempfile
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from fin_plant import checks, text_file, yaml_file
from fin_plant.gait import MAXIMUM_JOINTS
from fin_plant.paths import config_folder, given_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_LARGEST_SWEEP = math.pi / 2.0
_LARGEST_RATE = 100.0
_TOP_KEYS = ("device", "port", "baud", "options", "timing", "joints")


@dataclass(frozen=True)
class ServoJoint:
    """A joint moved by a servo.

    Attributes:
        channel: Pin, channel or id on the device.
        centre: Position of the servo at which the joint is straight, in the device's unit (us of pulse, ticks).
        direction: 1 if a larger position turns the tail to the left, else -1. Angles are positive to the right, as
            REP 103 has it for a link that points to the rear.
        units_per_radian: Change of position for a change of angle.
        lowest: Smallest position that is ever sent.
        highest: Largest position that is ever sent.
        sweep: Largest angle from the centre, rad.
        rate: Largest rate, rad/s.

    Raises:
        ValueError: A value out of range, or a centre outside [lowest, highest].
    """

    channel: int
    centre: float
    direction: int
    units_per_radian: float
    lowest: float
    highest: float
    sweep: float = math.radians(15.0)
    rate: float = 6.0

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "channel", checks.whole_number("channel", self.channel))
        set_(self, "direction", checks.whole_number("direction", self.direction, -1, 1))
        if self.direction == 0:
            msg = "direction = 0 must be 1 (a larger position turns the tail left) or -1"
            raise ValueError(msg)
        for name in ("centre", "lowest", "highest"):
            set_(self, name, checks.number(name, getattr(self, name), 0.0))
        for name, largest, unit in (
            ("units_per_radian", 1e6, "1/rad"),
            ("sweep", _LARGEST_SWEEP, "rad"),
            ("rate", _LARGEST_RATE, "rad/s"),
        ):
            value = checks.number(name, getattr(self, name), 0.0, largest, unit=unit, exclusive_minimum=True)
            set_(self, name, value)
        if not self.lowest < self.centre < self.highest:
            msg = (
                f"centre = {self.centre:g} must lie between lowest = {self.lowest:g} and highest = {self.highest:g}: "
                "run calibrate_servo, or mend the three numbers"
            )
            raise ValueError(msg)

    @property
    def reachable(self) -> float:
        """Largest angle in rad that sweep and range of the servo allow to both sides."""
        room = min(self.highest - self.centre, self.centre - self.lowest)
        return min(self.sweep, room / self.units_per_radian)

    def angle_at(self, position: float) -> float:
        """Return the joint's angle in rad at a servo's position."""
        return self.direction * (self.centre - position) / self.units_per_radian

    def position_at(self, angle: float) -> float:
        """Return the servo's position at a joint's angle in rad, whether the servo reaches it or not."""
        return self.centre - self.direction * self.units_per_radian * angle

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of the device that the joint uses."""
        return (self.channel,)


@dataclass(frozen=True)
class RelayJoint:
    """A joint pulled to either side by a relay.

    Attributes:
        left: Channel of the relay that pulls the tail to the left.
        right: Channel of the relay that pulls it to the right (positive angle).
        stroke: Angle of the full stroke, rad: a gait of this amplitude switches with full duty.

    Raises:
        ValueError: A value out of range, or one relay for both sides.
    """

    left: int
    right: int
    stroke: float = math.radians(15.0)

    def __post_init__(self) -> None:
        for name in ("left", "right"):
            object.__setattr__(self, name, checks.whole_number(name, getattr(self, name)))
        stroke = checks.number("stroke", self.stroke, 0.0, _LARGEST_SWEEP, unit="rad", exclusive_minimum=True)
        object.__setattr__(self, "stroke", stroke)

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of the device that the joint uses."""
        return (self.left, self.right)


@dataclass(frozen=True)
class RelayTiming:
    """What the relays and coils stand.

    Attributes:
        dead_time: s in which both sides are off before the other one comes on.
        shortest_on: s that a relay stays on at least.
        longest_on: s that a relay stays on at most; a coil that is held heats up.
        rated_operations: After so many operations of one relay the diagnostics warn.

    Raises:
        ValueError: A value out of range.
    """

    dead_time: float = 0.03
    shortest_on: float = 0.05
    longest_on: float = 2.0
    rated_operations: int = 100_000

    def __post_init__(self) -> None:
        checks.number("timing.dead_time", self.dead_time, 0.02, 1.0, unit="s", advice="relays release within 20 ms")
        checks.number("timing.shortest_on", self.shortest_on, 0.01, 1.0, unit="s")
        checks.number("timing.longest_on", self.longest_on, self.shortest_on, 60.0, unit="s")
        checks.whole_number("timing.rated_operations", self.rated_operations, 1)


Joint = ServoJoint | RelayJoint


@dataclass(frozen=True)
class Robot:
    """What the YAML file says.

    Attributes:
        device: Name of the back end.
        port: Path or URL of the serial port.
        baud: Bits a second; 0 takes the back end's own.
        joints: From the head to the tail; all servos or all relays.
        timing: Of relays.
        options: The back end's own settings, by name.

    Raises:
        ValueError: No joint, too many, two kinds of them, or a channel used twice.
    """

    device: str
    port: str
    baud: int
    joints: tuple[Joint, ...]
    timing: RelayTiming = field(default_factory=RelayTiming)
    options: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks.whole_number("number of joints", len(self.joints), 1, MAXIMUM_JOINTS)
        if len({type(joint) for joint in self.joints}) > 1:
            msg = "joints mixes servos (channel, centre, ...) and relays (left, right): use one kind on one device"
            raise ValueError(msg)
        used: dict[int, int] = {}
        for number, joint in enumerate(self.joints, start=1):
            for channel in joint.channels:
                if channel in used:
                    msg = f"channel {channel} is used by joint {used[channel]} and joint {number}: give each its own"
                    raise ValueError(msg)
                used[channel] = number

    @property
    def servos(self) -> tuple[ServoJoint, ...]:
        """The joints with servos; empty for a relay tail."""
        return tuple(joint for joint in self.joints if isinstance(joint, ServoJoint))

    @property
    def relays(self) -> tuple[RelayJoint, ...]:
        """The joints with relays; empty for a servo tail."""
        return tuple(joint for joint in self.joints if isinstance(joint, RelayJoint))


def examples() -> list[str]:
    """Return the names of the example files that come with the package."""
    return sorted(path.stem for path in config_folder("fin_servo_driver").glob("*.yaml"))


def find(name: str) -> Path:
    """Return the path of a robot file: one of the user's, or an example by its bare name.

    Raises:
        ValueError: No name, or there is no such file.
    """
    known = ", ".join(examples())
    if not name:
        msg = f"robot_file is empty: give the path of your robot's YAML file, or an example to start from ({known})"
        raise ValueError(msg)
    if name in examples():
        return config_folder("fin_servo_driver") / f"{name}.yaml"
    path = given_path(name)
    if not path.is_file():
        msg = f"robot_file = {name}: there is no such file, and no example of that name ({known})"
        raise ValueError(msg)
    return path


def load(path: Path) -> Robot:
    """Read a robot's YAML file.

    Raises:
        ValueError: It cannot be read, or something in it is refused; the message names file and key.
    """
    with text_file.named(path):
        return parse(yaml_file.read(path))


def parse(content: object) -> Robot:
    """Return the robot that the content of a YAML file describes.

    Raises:
        ValueError: A key is missing or unknown, or a value is refused.
    """
    top = _mapping("robot file", content, required=("device", "joints"), allowed=_TOP_KEYS)
    entries = top["joints"]
    if not isinstance(entries, list):
        msg = f"joints must be a list with one entry a driven joint, got {type(entries).__name__}"
        raise ValueError(msg)
    joints = []
    for number, entry in enumerate(entries, start=1):
        try:
            joints.append(_joint(entry))
        except ValueError as error:
            msg = f"joint {number}: {error}"
            raise ValueError(msg) from None
    timing = _mapping("timing", top.get("timing", {}), allowed=tuple(item.name for item in fields(RelayTiming)))
    for key, advice in (("device", "name the back end"), ("port", "give the device's path, or leave the line out")):
        if not isinstance(top.get(key, ""), str):
            got = "nothing" if top[key] is None else repr(top[key])
            msg = f"{key} must be a text, got {got}: {advice}"
            raise ValueError(msg)
    return Robot(
        device=top["device"],
        port=top.get("port", ""),
        baud=checks.whole_number("baud", top.get("baud", 0), 0, 10_000_000),
        joints=tuple(joints),
        timing=RelayTiming(**timing),
        options=_mapping("options", top.get("options", {})),
    )


def _joint(entry: object) -> Joint:
    names = list(entry) if isinstance(entry, dict) else []
    kind: type[Joint] = RelayJoint if "left" in names or "right" in names else ServoJoint
    defaults = {"sweep", "rate", "stroke"}
    allowed = tuple(item.name for item in fields(kind))
    required = tuple(name for name in allowed if name not in defaults)
    return kind(**_mapping("it", entry, required=required, allowed=allowed))


def _mapping(
    what: str, content: object, required: tuple[str, ...] = (), allowed: tuple[str, ...] | None = None
) -> dict[str, Any]:
    if not isinstance(content, dict):
        msg = f"{what} must be names with values, got {type(content).__name__}"
        raise ValueError(msg)
    missing = [name for name in required if name not in content]
    if missing:
        msg = f"{what} lacks {', '.join(missing)}"
        raise ValueError(msg)
    unknown = [str(name) for name in content if allowed is not None and name not in allowed]
    if allowed is not None and unknown:
        msg = f"{what} has unknown {', '.join(unknown)}: known are {', '.join(allowed)}"
        raise ValueError(msg)
    return {str(name): value for name, value in content.items()}


def with_joint(robot: Robot, number: int, joint: ServoJoint) -> Robot:
    """Return the robot with joint ``number`` (from 1) replaced."""
    joints = [*robot.joints]
    joints[number - 1] = joint
    return replace(robot, joints=tuple(joints))


def save(robot: Robot, path: Path) -> None:
    """Write a robot's YAML file whole or not at all: a power cut leaves the old file or the new one.

    Raises:
        OSError: It cannot be written.
    """
    content: dict[str, object] = {"device": robot.device, "port": robot.port, "baud": robot.baud}
    if robot.options:
        content["options"] = dict(robot.options)
    if robot.relays:
        content["timing"] = dict(_items(robot.timing))
    content["joints"] = [dict(_items(joint)) for joint in robot.joints]
    text = "# Written by calibrate_servo. Angles in rad, rates in rad/s, positions in the device's unit.\n"
    text += yaml.safe_dump(content, sort_keys=False)
    target = path.resolve()  # a link stays a link
    with tempfile.NamedTemporaryFile("w", dir=target.parent, prefix=path.name, delete=False, encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    if target.exists():
        shutil.copymode(target, file.name)
    Path(file.name).replace(target)


def _items(value: Joint | RelayTiming) -> Iterator[tuple[str, object]]:
    for item in fields(value):
        yield item.name, getattr(value, item.name)
