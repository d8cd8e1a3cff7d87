"""The arguments that shape a study, as they are typed: ``name:=value``.

Apart from ``plant``, ``namespace``, ``params``, ``live`` and ``rviz`` they are the parameters of the nodes, so their
meaning, unit and range stand in the nodes' parameter tables only.
"""

from __future__ import annotations

import difflib
import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_bringup.plants import PLANTS, plant_named
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fin_plant.parameters import Parameter, ParameterTable, Value

NAMESPACE = "/fish"
PARAMS, LIVE, RVIZ = "params", "live", "rviz"

# A study in the simulator should not take as long as one in a tank.
STUDY_DEFAULTS: dict[str, Value] = {"speed": 0.0}
# Swims faster than real time keep their commander busy, and a silent one harms no simulated fish.
SIMULATOR_DEFAULTS: dict[str, Value] = {"command_timeout": 5.0}


@dataclass(frozen=True)
class Argument:
    """An argument of a study."""

    name: str
    default: str
    description: str


def arguments(plant: str = "") -> list[Argument]:
    """Return every argument of a study with this plant, or with any; the commonest first."""
    plants = [plant_named(plant)] if plant else list(PLANTS.values())
    parameters = dict(OPTIMIZER_PARAMETERS)
    for node in (node for nodes_of_plant in plants for node in nodes_of_plant):
        parameters |= {name: parameter for name, parameter in node.table.items() if name not in parameters}
    own = [
        Argument("plant", "sim", f"What swims: {', '.join(PLANTS)}."),
        Argument("namespace", NAMESPACE, "Namespace of the fish; several can swim side by side."),
        Argument(PARAMS, "", "Parameter file of the nodes, YAML; what is given beside it counts more."),
        Argument(LIVE, "false", "Serve the graph to Foxglove and Lichtblick, at ws://localhost:8765."),
        Argument(RVIZ, "false", "Show the fish in RViz, where that is installed."),
    ]
    return own + [_argument(parameter) for parameter in parameters.values()]


def _names(plant: str = "") -> list[str]:
    return [argument.name for argument in arguments(plant)]


def _argument(parameter: Parameter) -> Argument:
    default = "" if parameter.name == "repeats" else STUDY_DEFAULTS.get(parameter.name, parameter.default)
    allowed = ", ".join(parameter.choices)
    if not allowed and parameter.kind in {"double", "integer"}:
        allowed = checks.describe_range(parameter.minimum, parameter.maximum, parameter.unit)
    text = f"{parameter.description} {allowed}".strip()
    text += " Empty: 3 on a robot, else 1." if parameter.name == "repeats" else ""
    if parameter.name in SIMULATOR_DEFAULTS:
        text += f" In the simulator {SIMULATOR_DEFAULTS[parameter.name]} unless given."
    return Argument(parameter.name, default if isinstance(default, str) else json.dumps(default), text)


def misspelt(given: Iterable[str], plant: str) -> list[str]:
    """Return a text for each name that is no argument of a study with this plant, but nearly one.

    For a launch file that includes the study's: a name that is far from all may be its own.
    """
    known, every = _names(plant), _names()
    near = {name: difflib.get_close_matches(name, known, n=1, cutoff=0.8) for name in given if name not in every}
    return [f"{name}:= is no argument of a study: did you mean {found[0]}?" for name, found in near.items() if found]


def refuse_unknown(names: Iterable[str], plant: str) -> None:
    """Refuse what is no argument of a study with this plant.

    Raises:
        ValueError: A name that is none; the message says with which plant it is one, or offers the nearest names.
    """
    known = _names(plant)
    for name in names:
        if name in known:
            continue
        others = [other for other in PLANTS if name in _names(other)]
        near = difflib.get_close_matches(name, known, n=3)
        if others:
            hint = f"it is one with plant:={' or plant:='.join(others)}"
        elif near:
            hint = f"did you mean {' or '.join(near)}?"
        else:
            hint = "--help (of `ros2 launch`: --show-args) lists them"
        msg = f"{name}:= is no argument of a study with plant:={plant}: {hint}"
        raise ValueError(msg)


def words_of(text: str) -> list[str]:
    """Return the texts of a list like ``[a, b]``."""
    return [word for word in re.split(r"[\[\],\s]+", text) if word]


def _texts_of(text: str) -> list[str]:
    """Return the texts of a list like ``[mean_speed >= 2 cm/s, power <= 0.5 W]``, quoted or not, commas between."""
    words = (word.strip() for word in text.strip().removeprefix("[").removesuffix("]").split(","))
    return [word.strip("\"'") for word in words if word]


def parameters_of(table: ParameterTable, given: Mapping[str, str]) -> dict[str, Value]:
    """Return the parameters of this table that differ from the node's defaults."""
    defaults = {**STUDY_DEFAULTS, **(SIMULATOR_DEFAULTS if "speed" in table else {})}
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
            return parameter.check(_texts_of(text))
        if parameter.kind == "double_array" and text.strip().startswith("["):
            return parameter.check([checks.read_number(word) for word in words_of(text)])
        # JSON's numbers and truth values, and what people write for numbers besides: 1e9, .5
        value = json.loads(text.lower()) if parameter.kind != "double" else checks.read_number(text)
    except ValueError:
        value = text
    return parameter.check(value)
