"""The one list of nodes that make a study, with the parameters that its arguments give them.

`launch/study.launch.py` starts the list on a machine with the launch system, `bringup` without it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fin_bringup.plants import plant_named
from fin_bringup.study_arguments import LIVE, NAMESPACE, PARAMS, RVIZ, parameters_of, refuse_unknown, words_of
from fin_optimizer.gait_parameters import gait_from_parameters
from fin_optimizer.goals import VELOCITY, YAW_RATE, Goals
from fin_optimizer.parameters import NAMESPACE_PATTERN, OPTIMIZER, OPTIMIZER_PARAMETERS, SIMULATOR
from fin_optimizer.study.journal import StudyError
from fin_plant import yaml_file
from fin_plant.checks import counted
from fin_plant.parameters import dotted, load_table
from fin_plant.paths import given_path
from fin_plant.plant_state import SERVO_TORQUE, THRUST
from fin_servo_driver import robot_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from fin_plant.parameters import Value

LAYOUTS = Path(__file__).parent / "layouts"
"""Views of the fish for RViz, Foxglove and Lichtblick, PlotJuggler."""
_OWN = frozenset({"plant", "namespace", PARAMS, LIVE, RVIZ})
"""Arguments that are no parameters."""
# Of several simulated fish the first one's time is the graph's.
_LATER_FISH: dict[str, Value] = {"publish_clock": False}
# The paper swam each fin of its robot three times; a simulated swim repeats but for its last digits. Empty asks so.
_REPEATS = {"robot": "3"}
_EXAMPLE = str(load_table("fin_servo_driver", "rehearsal_parameters.yaml")["robot_file"].default)
"""Robot file of a rehearsal that gives none."""


_TELLS = {"sim": (SERVO_TORQUE, THRUST)}
"""What a kind of plant tells beside the velocity."""
_GOALS = ("objective", "constraints")


@dataclass(frozen=True)
class NodeSpec:
    """A node to start.

    Attributes:
        package: The package of its executable.
        executable: As `ros2 run` names it.
        name: Of the node.
        namespace: Of the node, with its leading slash.
        parameters: Those that differ from the node's own defaults.
        words: Words of its command line that are not for ROS.
    """

    package: str
    executable: str
    name: str
    namespace: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    words: tuple[str, ...] = ()

    def ros_arguments(self) -> list[str]:
        """Return the command line that gives the node its name, namespace and parameters."""
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:={self.namespace}"]
        for name, value in self.parameters.items():
            arguments += ["-p", f"{name}:={json.dumps(value)}"]
        return arguments


def nodes(given: Mapping[str, str]) -> tuple[NodeSpec, ...]:
    """Return the nodes of a study, the plant first and the optimiser last.

    Args:
        given: Arguments by name, values as on a command line; those left out have their defaults.

    Raises:
        ValueError: An unknown argument (the message offers the nearest names) or a value that is refused.
    """
    kind = given.get("plant", "sim")
    plant = plant_named(kind)
    namespace = given.get("namespace", NAMESPACE)
    if not NAMESPACE_PATTERN.fullmatch(namespace):
        msg = f"namespace:={namespace} must be like {NAMESPACE} or /tank_a/fish: a slash, then letters, digits and _"
        raise ValueError(msg)
    names = [OPTIMIZER, *(node.name for node in plant)]
    values = _of_file(given.get(PARAMS, ""), names, namespace)
    values |= {name: text for name, text in given.items() if name not in _OWN}
    if not values.get("repeats"):
        values["repeats"] = _REPEATS.get(kind, "1")
    refuse_unknown(values, kind)
    values = {**_of_its_time(values.get("study_folder", "")), **values}
    optimizer = NodeSpec("fin_optimizer", OPTIMIZER, OPTIMIZER, namespace, parameters_of(OPTIMIZER_PARAMETERS, values))
    asked: Any = [optimizer.parameters.get(name, OPTIMIZER_PARAMETERS[name].default) for name in _GOALS]
    told = {VELOCITY, YAW_RATE, *_TELLS.get(kind, ())}
    if refusal := Goals.of_objective(*asked).cannot_be_told(told, f"plant:={kind}"):
        raise ValueError(refusal)
    fish = cast("list[str]", optimizer.parameters.get("plants", [])) or [namespace]
    robots = _robots(values, len(fish)) if kind == "robot" else [{}] * len(fish)
    specs = []
    for number, (each, own) in enumerate(zip(fish, robots, strict=True)):
        for node in plant:
            chosen = {**parameters_of(node.table, values | own), **node.fixed}
            if number:
                chosen |= {name: value for name, value in _LATER_FISH.items() if name in node.table}
            specs.append(NodeSpec(node.package, node.name, node.name, each, chosen))
    return (*specs, optimizer)


def viewers(given: Mapping[str, str]) -> tuple[NodeSpec, ...]:
    """Return what shows the fish beside a study or a plant; its end ends nothing else.

    Raises:
        ValueError: ``live:=`` or ``rviz:=`` is neither true nor false.
    """
    namespace = given.get("namespace", NAMESPACE)
    wanted = {name: _truth(name, given.get(name, "false")) for name in (LIVE, RVIZ)}
    specs = (
        NodeSpec("fin_bringup", "live", "live", namespace),
        NodeSpec("rviz2", "rviz2", "rviz", namespace, words=("-d", str(LAYOUTS / "fish.rviz"))),
    )
    return tuple(spec for name, spec in zip((LIVE, RVIZ), specs, strict=True) if wanted[name])


def _truth(name: str, text: str) -> bool:
    if text.lower() not in {"true", "false"}:
        msg = f"{name}:={text} must be true or false"
        raise ValueError(msg)
    return text.lower() == "true"


def _of_file(path: str, names: Sequence[str], namespace: str) -> dict[str, str]:
    """Return what a parameter file gives to nodes of these names, as arguments; nothing without a file.

    Raises:
        ValueError: The file cannot be read or understood, or gives one parameter two values.
    """
    if not path:
        return {}
    try:
        content = yaml_file.read(given_path(path))
    except (OSError, ValueError) as error:
        msg = f"{PARAMS}:={path} is refused: {getattr(error, 'strerror', None) or error}"
        raise ValueError(msg) from error
    found: dict[str, str] = {}
    for key, part in content.items() if isinstance(content, dict) else [("", None)]:
        if not isinstance(part, dict) or not isinstance(part.get("ros__parameters"), dict):
            msg = f"{PARAMS}:={path} is refused: {key!r} needs ros__parameters below it, as `ros2 param dump` writes it"
            raise ValueError(msg)
        mine = [f"{start}{name}" for name in names for start in ("", "/", "/**/", f"{namespace}/")]
        if key not in {"/**", *mine}:
            continue
        for name, value in dotted(part["ros__parameters"]):
            text = value if isinstance(value, str) else json.dumps(value)
            if found.setdefault(name, text) != text:
                msg = f"{PARAMS}:={path} gives {name} two values, {found[name]} and {text}: leave one"
                raise ValueError(msg)
    return found


def _of_its_time(study_folder: str) -> dict[str, str]:
    """Return the arguments that a study was begun with by default, where the defaults are others today."""
    if not study_folder:
        return {}
    folder = given_path(study_folder)
    if not folder.is_dir():
        return {}
    from fin_optimizer.study.records import earlier_defaults  # noqa: PLC0415 - a new study need not wait for Optuna

    try:
        there = earlier_defaults(folder)
    except (OSError, StudyError):
        return {}  # the optimiser says what is wrong with it
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in there.items()}


def check_tails(specs: Iterable[NodeSpec]) -> None:
    """Read each robot file, and compare the driven joints of gait and fish, before anything is started.

    Args:
        specs: The nodes of a study, the optimiser last.

    Raises:
        ValueError: A robot file that is not there or is refused, a gait that cannot be, or another number of driven
            joints than the fish has.
    """
    *plants, optimizer = specs
    gait = gait_from_parameters(OPTIMIZER_PARAMETERS.checked(optimizer.parameters))
    for spec in plants:
        for whose, joints in _driven_joints(spec).items():
            if joints != len(gait.joints):
                msg = (
                    f"the gait has {counted(len(gait.joints), 'driven joint')}, {whose} {joints}: "
                    "give as many in gait.preset and "
                    "gait.driven_joints, or in gait.joints.amplitude"
                )
                raise ValueError(msg)


def _driven_joints(spec: NodeSpec) -> dict[str, int]:
    """Return how many driven joints a node's parameters tell, by whose they are; empty for a node without a tail.

    Raises:
        ValueError: There is no such robot file, something in it is refused, or it is not that of the hidden fish.
    """
    found: dict[str, int] = {}
    links = len(cast("list[float]", spec.parameters.get("peduncle.length", [])))
    if name := spec.parameters.get("robot_file", _EXAMPLE if spec.name == "rehearsal" else ""):
        found[f"robot_file:={name}"] = servos = len(robot_file.load(robot_file.find(str(name))).joints)
        if spec.name == "rehearsal" and servos != links + 1:
            msg = (
                f"robot_file:={name} has {counted(servos, 'driven joint')}, the hidden fish "
                f"{links + 1}: give peduncle.length and the "
                f"other peduncle.* one value for each joint before the fin's, or another robot_file"
            )
            raise ValueError(msg)
    if spec.name == SIMULATOR:
        found["the simulated fish, by its peduncle.length,"] = links + 1
    return found


def _robots(values: Mapping[str, str], count: int) -> list[dict[str, str]]:
    """Return what the arguments say of each robot alone.

    Raises:
        ValueError: There is no robot file, or two robots would share one or a port.
    """
    given = values.get("robot_file", "")
    files = words_of(given) if count > 1 else [given]
    advice = "give one for each, in their order, like robot_file:=[a.yaml,b.yaml]"
    if not any(files):
        msg = (
            "plant:=robot needs robot_file:=my_robot.yaml: copy an example from fin_servo_driver/config, write your "
            "port into it, and calibrate each servo (docs/robot.md)"
        )
        raise ValueError(msg)
    if len(files) != count:
        msg = f"robot_file:={given} names {len(files)} robot files for the {count} fish of plants: {advice}"
        raise ValueError(msg)
    if twice := next((file for file in files if files.count(file) > 1), ""):
        msg = f"robot_file:={given} names {twice} twice, but two drivers cannot share a port: {advice}"
        raise ValueError(msg)
    if count > 1 and (port := values.get("port", "")):
        msg = f"port:={port} cannot be the port of {count} robots: leave it out, and give each one's in its robot file"
        raise ValueError(msg)
    return [{"robot_file": file} for file in files]
