"""Values of parameters as a person gives them: words of the command line, and a node's parameter file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fin_plant import checks, yaml_file
from fin_plant.fin import PLANT_PARAMETERS
from fin_plant.parameters import ParameterTable, dotted
from fin_sim.swim import SIMULATOR_PARAMETERS
from fin_sim.swim_command.plan import PARAMETERS

if TYPE_CHECKING:
    from pathlib import Path

    from fin_plant.parameters import Parameter, Value

# What a node's parameter file says of the run, and the option that says it here.
_RUN_PARAMETERS = {"reactive": "reactive", "step": "step", "drive.ramp_time": "ramp_time"}
# Parameters that ROS gives every node.
_EVERY_NODES = ("use_sim_time", "qos_overrides.", "start_type_description_service")


def given_value(parameter: Parameter, given: object) -> Value:
    """Return what the command line or a file gives for a parameter, in the parameter's type.

    A number may be a text: the command line knows nothing else, and YAML 1.1 takes 2.0e9 for one where ROS does not.
    """

    def number(item: object) -> object:
        return checks.read_number(item) if isinstance(item, str) else item

    try:
        if parameter.kind == "double_array":
            parts = [part for part in given.split(",") if part.strip()] if isinstance(given, str) else given
            given = [number(part) for part in parts] if isinstance(parts, list) else parts
        elif parameter.kind in {"double", "integer"}:
            given = number(given)
    except ValueError:
        allowed = checks.describe_range(parameter.minimum, parameter.maximum, parameter.unit)
        kind = "whole number" if parameter.kind == "integer" else "number"
        msg = f"{parameter.name} = {given!r} must be a {kind}: allowed is {allowed}"
        raise ValueError(msg) from None
    return parameter.check(given)


def _is_simulators(node: str) -> bool:
    """Return whether the entry of a ROS parameter file counts for the simulator: named so, or all nodes' (``/**``)."""
    name = node.rsplit("/", 1)[-1]
    return name == "simulator" or "*" in name


def _mapping_in(name: str, entry: object, part: str) -> dict[str, Any]:
    return checks.mapping(f"{part} of {name}", checks.mapping(name, entry).get(part))


def read_parameter_file(path: Path) -> tuple[dict[str, Value], dict[str, Value]]:
    """Return what a ROS parameter file says of fin, fish and servo, and of the run; the rest is the node's alone."""
    try:
        nodes = {
            name: dict(dotted(_mapping_in(name, entry, "ros__parameters")))
            for name, entry in checks.mapping("it", yaml_file.read(path)).items()
        }
        chosen = [entry for name, entry in nodes.items() if _is_simulators(name)]
    except ValueError as error:
        msg = f"{path} is not a ROS parameter file (node: ros__parameters: name: value): {error}"
        raise ValueError(msg) from None
    if not chosen:
        msg = f"{path} has parameters of {', '.join(nodes)} only: name its entry simulator or /**"
        raise ValueError(msg)
    known = ParameterTable({**PLANT_PARAMETERS, **SIMULATOR_PARAMETERS})
    flat = {name: value for entry in chosen for name, value in entry.items() if not name.startswith(_EVERY_NODES)}
    try:
        checked = {name: given_value(known.require(name), value) for name, value in flat.items()}
    except ValueError as error:
        msg = f"{path}: {error}"
        raise ValueError(msg) from None
    values = {name: value for name, value in checked.items() if name in PARAMETERS}
    return values, {option: checked[name] for name, option in _RUN_PARAMETERS.items() if name in checked}
