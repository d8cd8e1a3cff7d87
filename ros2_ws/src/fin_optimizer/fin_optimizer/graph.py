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

from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS
from fin_plant.parameters import ParameterTable, load_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fin_plant.parameters import Parameter, Value

NAMESPACE = "/fish"
OPTIMIZER = "optimizer"
OPTIMIZER_PARAMETERS = ParameterTable({**load_table("fin_optimizer", "optimizer_parameters.yaml"), **FIN_PARAMETERS})
"""The optimiser's own parameters and the fin that its search starts from."""

SIMULATOR = "simulator"
_PLANT_LIMITS = ParameterTable({n: p for n, p in PLANT_PARAMETERS.items() if n not in FIN_PARAMETERS})
# A study in the simulator should not take as long as one in a tank.
_STUDY_DEFAULTS: dict[str, Value] = {"speed": 0.0}
NAMESPACE_PATTERN = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


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
class _PlantKind:
    """How a kind of plant is started: node and the parameters that are its own."""

    package: str
    executable: str
    name: str
    table: ParameterTable


SIMULATOR_PARAMETERS = ParameterTable({**load_table("fin_sim", "simulator_parameters.yaml"), **_PLANT_LIMITS})
"""The simulator's own parameters, the fin excepted: that is the optimiser's to choose."""

_PLANTS = {"sim": _PlantKind("fin_sim", SIMULATOR, SIMULATOR, SIMULATOR_PARAMETERS)}
# Announced in the contract, so asking for one is no mistake of the user's.
_PLANTS_TO_COME = ("robot", "rehearsal")


def arguments(plant: str = "sim") -> list[Argument]:
    """Return every argument of a study with this plant, the commonest first."""
    own = [
        Argument("plant", "sim", f"What swims: {', '.join(_PLANTS)}."),
        Argument("namespace", NAMESPACE, "Namespace of the fish; several can swim side by side."),
    ]
    return own + [_argument(p) for p in (*OPTIMIZER_PARAMETERS.values(), *_kind(plant).table.values())]


def _argument(parameter: Parameter) -> Argument:
    default = _STUDY_DEFAULTS.get(parameter.name, parameter.default)
    allowed = ", ".join(parameter.choices)
    if not allowed and parameter.kind in {"double", "integer"}:
        allowed = checks.describe_range(parameter.minimum, parameter.maximum, parameter.unit)
    text = f"{parameter.description} {allowed}".strip()
    return Argument(parameter.name, default if isinstance(default, str) else json.dumps(default), text)


def _kind(plant: str) -> _PlantKind:
    if plant in _PLANTS:
        return _PLANTS[plant]
    if plant in _PLANTS_TO_COME:
        msg = f"plant:={plant} is not part of this version: use plant:={' or plant:='.join(_PLANTS)}"
    else:
        msg = f"plant:={plant} is not known: use plant:={' or plant:='.join(_PLANTS)}"
    raise ValueError(msg)


def nodes(given: Mapping[str, str]) -> tuple[NodeSpec, ...]:
    """Return the nodes of a study, the plant first and the optimiser last.

    Args:
        given: Arguments by name, values as on a command line; those left out have their defaults.

    Raises:
        ValueError: An unknown argument (the message offers the nearest names) or a value that is refused.
    """
    kind = _kind(given.get("plant", "sim"))
    namespace = given.get("namespace", NAMESPACE)
    if not NAMESPACE_PATTERN.fullmatch(namespace):
        msg = f"namespace:={namespace} must be like {NAMESPACE} or /tank_a/fish: a slash, then letters, digits and _"
        raise ValueError(msg)
    values = {name: text for name, text in given.items() if name not in {"plant", "namespace"}}
    _refuse_unknown(values, (*OPTIMIZER_PARAMETERS, *kind.table))
    optimizer = NodeSpec("fin_optimizer", OPTIMIZER, OPTIMIZER, namespace, _parameters(OPTIMIZER_PARAMETERS, values))
    plant = _parameters(kind.table, values)
    fish = cast("list[str]", optimizer.parameters.get("plants", [])) or [namespace]
    return (*(NodeSpec(kind.package, kind.executable, kind.name, each, plant) for each in fish), optimizer)


def _refuse_unknown(names: Iterable[str], known: Iterable[str]) -> None:
    known = ("plant", "namespace", *known)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3)
            hint = f"did you mean {' or '.join(near)}?" if near else f"there is {', '.join(known)}"
            msg = f"{name}:= is no argument of a study: {hint}"
            raise ValueError(msg)


def _parameters(table: ParameterTable, given: Mapping[str, str]) -> dict[str, Value]:
    """Return the parameters of this table that differ from the node's defaults."""
    chosen = {**{n: v for n, v in _STUDY_DEFAULTS.items() if n in table}}
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
            return parameter.check([word for word in re.split(r"[\[\],\s]+", text) if word])
        # JSON's numbers and truth values, and what people write for numbers besides: 1e9, .5
        value = json.loads(text.lower()) if parameter.kind != "double" else float(text)
    except ValueError:
        value = text
    return parameter.check(value)
