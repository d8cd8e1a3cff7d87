"""The one list of nodes that make a study, and the arguments that shape it.

`launch/study.launch.py` starts the list on a machine with the launch system, `bringup` without it. Arguments are
given as in launch, ``name:=value``. Apart from ``plant`` and ``namespace`` they are the parameters of the nodes, so
their meaning, unit and range stand in the nodes' parameter tables only.
"""

from __future__ import annotations

import difflib
import json
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from fin_optimizer.parameters import (
    NAMESPACE_PATTERN,
    OPTIMIZER,
    OPTIMIZER_PARAMETERS,
    SIMULATOR,
)
from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS, node_table
from fin_plant.parameters import ParameterTable, load_table
from fin_servo_driver import robot_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fin_plant.parameters import Parameter, Value

NAMESPACE = "/fish"

# A study in the simulator should not take as long as one in a tank.
_STUDY_DEFAULTS: dict[str, Value] = {"speed": 0.0}
# Swims faster than real time keep their commander busy, and a silent one harms no simulated fish.
_SIMULATOR_DEFAULTS: dict[str, Value] = {"command_timeout": 5.0}
# Of several simulated fish the first one's time is the graph's.
_LATER_FISH: dict[str, Value] = {"publish_clock": False}
# The paper swam each fin of its robot three times; a simulated swim repeats but for its last digits. Empty asks so.
_REPEATS = {"robot": "3"}


def _without_fin(table: ParameterTable) -> ParameterTable:
    """Return a plant's parameters, the fin excepted: that is the optimiser's to choose."""
    return ParameterTable({name: entry for name, entry in table.items() if name not in FIN_PARAMETERS})


PLANT_LIMITS = _without_fin(PLANT_PARAMETERS)
SIMULATOR_PARAMETERS = _without_fin(node_table("fin_sim", SIMULATOR))


@dataclass(frozen=True)
class NodeSpec:
    """A node to start.

    Attributes:
        package: The package of its executable.
        executable: As `ros2 run` names it.
        name: Of the node.
        namespace: Of the node, with its leading slash.
        parameters: Those that differ from the node's own defaults.
    """

    package: str
    executable: str
    name: str
    namespace: str
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def ros_arguments(self) -> list[str]:
        """Return the command line that gives the node its name, namespace and parameters."""
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:={self.namespace}"]
        for name, value in self.parameters.items():
            arguments += ["-p", f"{name}:={json.dumps(value)}"]
        return arguments


@dataclass(frozen=True)
class Argument:
    """An argument of a study."""

    name: str
    default: str
    description: str


@dataclass(frozen=True)
class _PlantNode:
    """A node of a plant, the parameters of it that are a study's arguments, and those that the kind of plant fixes."""

    package: str
    name: str
    table: ParameterTable
    fixed: Mapping[str, Value] = field(default_factory=dict)


_DRIVER_PARAMETERS = load_table("fin_servo_driver", "servo_driver_parameters.yaml")
# What the driver takes on the robot alone: the rehearsal's operator tells it the port of the emulated device.
_ROBOT_ONLY = ("robot_file", "port", "watchdog.disabled_knowingly")
_ROBOT = ParameterTable({**{n: _DRIVER_PARAMETERS[n] for n in _ROBOT_ONLY}, **PLANT_LIMITS})
_ESTIMATOR = _PlantNode(
    "fin_servo_driver", "velocity_estimator", load_table("fin_servo_driver", "velocity_estimator_parameters.yaml")
)
_PLANTS = {
    "sim": (_PlantNode("fin_sim", SIMULATOR, SIMULATOR_PARAMETERS),),
    "robot": (_PlantNode("fin_servo_driver", "servo_driver", _ROBOT), _ESTIMATOR),
    # The emulated device comes first and so ends last: the driver's neutral must still find it.
    "rehearsal": (
        _PlantNode("fin_servo_driver", "rehearsal", load_table("fin_servo_driver", "rehearsal_parameters.yaml")),
        _PlantNode("fin_servo_driver", "servo_driver", PLANT_LIMITS, {"plant": "rehearsal"}),
        _ESTIMATOR,
    ),
}


def arguments(plant: str = "") -> list[Argument]:
    """Return every argument of a study with this plant, or with any; the commonest first."""
    plants = [_plant(plant)] if plant else list(_PLANTS.values())
    parameters = dict(OPTIMIZER_PARAMETERS)
    for node in (node for nodes_of_plant in plants for node in nodes_of_plant):
        parameters |= {name: parameter for name, parameter in node.table.items() if name not in parameters}
    own = [
        Argument("plant", "sim", f"What swims: {', '.join(_PLANTS)}."),
        Argument("namespace", NAMESPACE, "Namespace of the fish; several can swim side by side."),
    ]
    return own + [_argument(parameter) for parameter in parameters.values()]


def _names(plant: str = "") -> list[str]:
    return [argument.name for argument in arguments(plant)]


def _argument(parameter: Parameter) -> Argument:
    default = "" if parameter.name == "repeats" else _STUDY_DEFAULTS.get(parameter.name, parameter.default)
    allowed = ", ".join(parameter.choices)
    if not allowed and parameter.kind in {"double", "integer"}:
        allowed = checks.describe_range(parameter.minimum, parameter.maximum, parameter.unit)
    text = f"{parameter.description} {allowed}".strip()
    text += " Empty: 3 on a robot, else 1." if parameter.name == "repeats" else ""
    if parameter.name in _SIMULATOR_DEFAULTS:
        text += f" In the simulator {_SIMULATOR_DEFAULTS[parameter.name]} unless given."
    return Argument(parameter.name, default if isinstance(default, str) else json.dumps(default), text)


def _plant(plant: str) -> tuple[_PlantNode, ...]:
    if plant not in _PLANTS:
        msg = f"plant:={plant} is not known: use plant:={' or plant:='.join(_PLANTS)}"
        raise ValueError(msg)
    return _PLANTS[plant]


def nodes(given: Mapping[str, str]) -> tuple[NodeSpec, ...]:
    """Return the nodes of a study, the plant first and the optimiser last.

    Args:
        given: Arguments by name, values as on a command line; those left out have their defaults.

    Raises:
        ValueError: An unknown argument (the message offers the nearest names) or a value that is refused.
    """
    kind = given.get("plant", "sim")
    plant = _plant(kind)
    namespace = given.get("namespace", NAMESPACE)
    if not NAMESPACE_PATTERN.fullmatch(namespace):
        msg = f"namespace:={namespace} must be like {NAMESPACE} or /tank_a/fish: a slash, then letters, digits and _"
        raise ValueError(msg)
    values = {name: text for name, text in given.items() if name not in {"plant", "namespace"}}
    if not values.get("repeats"):
        values["repeats"] = _REPEATS.get(kind, "1")
    refuse_unknown(values, kind)
    optimizer = NodeSpec("fin_optimizer", OPTIMIZER, OPTIMIZER, namespace, _parameters(OPTIMIZER_PARAMETERS, values))
    if kind != "sim" and "objective" in optimizer.parameters:
        msg = f"objective:={values['objective']} needs a plant that tells its servos' torques, and of all only sim does"
        raise ValueError(msg)
    fish = cast("list[str]", optimizer.parameters.get("plants", [])) or [namespace]
    robots = _robots(values, len(fish)) if kind == "robot" else [{}] * len(fish)
    specs = []
    for number, (each, own) in enumerate(zip(fish, robots, strict=True)):
        for node in plant:
            chosen = {**_parameters(node.table, values | own), **node.fixed}
            if number:
                chosen |= {name: value for name, value in _LATER_FISH.items() if name in node.table}
            specs.append(NodeSpec(node.package, node.name, node.name, each, chosen))
    return (*specs, optimizer)


def check_robot_files(specs: Iterable[NodeSpec]) -> None:
    """Read the robot file of each node that is to get one, before anything is started.

    Raises:
        ValueError: There is no such file, or something in it is refused.
    """
    for spec in specs:
        if name := spec.parameters.get("robot_file"):
            robot_file.load(robot_file.find(str(name)))


def misspelt(given: Iterable[str], plant: str) -> list[str]:
    """Return a text for each name that is no argument of a study with this plant, but nearly one.

    For a launch file that includes the study's: a name that is far from all may be its own.
    """
    known, every = _names(plant), _names()
    near = {name: difflib.get_close_matches(name, known, n=1, cutoff=0.8) for name in given if name not in every}
    return [f"{name}:= is no argument of a study: did you mean {found[0]}?" for name, found in near.items() if found]


def _robots(values: Mapping[str, str], count: int) -> list[dict[str, str]]:
    """Return what the arguments say of each robot alone.

    Raises:
        ValueError: There is no robot file, or two robots would share one or a port.
    """
    given = values.get("robot_file", "")
    files = _words(given) if count > 1 else [given]
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


def _words(text: str) -> list[str]:
    """Return the texts of a list like ``[a, b]``."""
    return [word for word in re.split(r"[\[\],\s]+", text) if word]


def refuse_unknown(names: Iterable[str], plant: str) -> None:
    """Refuse what is no argument of a study with this plant.

    Raises:
        ValueError: A name that is none; the message says with which plant it is one, or offers the nearest names.
    """
    known = _names(plant)
    for name in names:
        if name in known:
            continue
        others = [other for other in _PLANTS if name in _names(other)]
        near = difflib.get_close_matches(name, known, n=3)
        if others:
            hint = f"it is one with plant:={' or plant:='.join(others)}"
        elif near:
            hint = f"did you mean {' or '.join(near)}?"
        else:
            hint = "--help (of `ros2 launch`: --show-args) lists them"
        msg = f"{name}:= is no argument of a study with plant:={plant}: {hint}"
        raise ValueError(msg)


def _parameters(table: ParameterTable, given: Mapping[str, str]) -> dict[str, Value]:
    """Return the parameters of this table that differ from the node's defaults."""
    defaults = {**_STUDY_DEFAULTS, **(_SIMULATOR_DEFAULTS if "speed" in table else {})}
    chosen = {name: value for name, value in defaults.items() if name in table}
    chosen |= {name: _value(table[name], text) for name, text in given.items() if name in table}
    return {name: value for name, value in chosen.items() if value != table[name].default}


def _value(parameter: Parameter, text: str) -> Value:
    """Return a command line's text as the parameter's value.

    Raises:
        ValueError: It is none, or it is out of range.
    """
    if parameter.kind == "string":
        return parameter.check(text)
    try:
        if parameter.kind == "string_array":
            return parameter.check(_words(text))
        # JSON's numbers and truth values, and what people write for numbers besides: 1e9, .5
        value = json.loads(text.lower()) if parameter.kind != "double" else checks.read_number(text)
    except ValueError:
        value = text
    return parameter.check(value)
