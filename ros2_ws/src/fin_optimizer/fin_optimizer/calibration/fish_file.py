"""The fitted fish as a ROS parameter file: the simulator's part under ``/**``, drive and tracker beside it.

The simulator, ``swim`` and a study take the file as they take any of their parameter files; what no simulator has
stands under a node's name that is none of theirs, ``calibration``, and ``predict`` reads it there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from fin_optimizer.calibration.model import Knots, Model
from fin_optimizer.calibration.settings import OWN
from fin_plant import checks, text_file, yaml_file
from fin_plant.fin import node_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.calibration.fit import Fit
    from fin_plant.parameters import Value

_SIMULATOR, _OWN, _PARAMETERS = "/**", "calibration", "ros__parameters"
_KNOTS = {"bias": "drive.knots", "amplitude_factor": "drive.amplitude_factor", "frequency": "drive.frequency"}
_FITTED = "fitted."
_ROOMS = ("body.", "water.", "fin.", "reactive")


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}"
        mantissa, _, exponent = text.partition("e")
        mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
        return f"{mantissa}e{exponent}" if exponent else mantissa
    if isinstance(value, list):
        return f"[{', '.join(_text(each) for each in value)}]"
    return str(value)


def fish_file(found: Fit, swims: Sequence[str], command: str) -> str:
    """Return the file's text.

    Args:
        found: The fitted fish.
        swims: Names of the swims it was fitted to.
        command: That made it.
    """
    errors = {
        name: f" # fitted: {low:.3g} to {high:.3g}, one standard error"
        for name, low, high in zip(found.names, found.low, found.high, strict=True)
    }
    model = found.model
    lines = [
        f"# Fitted to {checks.counted(len(swims), 'swim')} by: {command}",
        *(f"# Note: {doubt}." for doubt in found.doubts),
        f"{_SIMULATOR}:",
        f"  {_PARAMETERS}:",
        *(
            f"    {name}: {_text(value)}{errors.get(name, '')}"
            for name, value in model.fish.items()
            if name.startswith(_ROOMS)
        ),
        f"{_OWN}:",
        f"  {_PARAMETERS}:",
        *(f"    {name}: {_text(value)}{errors.get(name, '')}" for name, value in model.own.items()),
        f"    {_KNOTS['bias']}: {_text(list(model.knots.bias))} # rad, commanded",
        f"    {_KNOTS['amplitude_factor']}: {_text(list(model.knots.amplitude_factor))} # at each of them",
        f"    {_KNOTS['frequency']}: {_text(list(model.knots.frequency))} # Hz, the same",
        *(
            f"    {_FITTED}{name}: [{low:.3g}, {high:.3g}] # one standard error either way"
            for name, low, high in zip(found.names, found.low, found.high, strict=True)
            if not name.startswith(_KNOTS["amplitude_factor"])
        ),
        *(f"    # {name}{errors[name]}" for name in found.names if name.startswith(_KNOTS["amplitude_factor"])),
    ]
    return "\n".join(lines) + "\n"


def read_fish(path: Path) -> Model:
    """Return the model of a file that `fish_file` made, or of a simulator's parameter file: an ideal drive.

    Raises:
        ValueError: It cannot be read, is none, or a number in it is refused; the message names the file.
    """
    with text_file.named(path):
        content: Any = yaml_file.read(path)
        if not isinstance(content, dict) or not isinstance(content.get(_SIMULATOR), dict):
            msg = f"it has no entry {_SIMULATOR} with {_PARAMETERS}: give the file that calibrate wrote"
            raise ValueError(msg)
        table = node_table("fin_sim", "simulator")
        fish = table.checked(_parameters(content, _SIMULATOR))
        own = _parameters(content, _OWN)
        return Model(fish, {name: _number(own, name, none) for name, (none, _) in OWN.items()}, _knots(own))


def read_errors(path: Path) -> dict[str, tuple[float, float]]:
    """Return low and high of what a file of `fish_file` says was fitted, by name; nothing of another file.

    Raises:
        ValueError: One is no pair of numbers.
        OSError: It cannot be read.
    """
    content: Any = yaml_file.read(path)
    result = {}
    for name, pair in _parameters(checks.mapping(str(path), content), _OWN).items():
        if name.startswith(_FITTED):
            if not isinstance(pair, list) or len(pair) != 2:  # noqa: PLR2004
                msg = f"{path}: {name} = {pair!r} must be [low, high]"
                raise ValueError(msg)
            low, high = (checks.number(f"{path}: {name}", each) for each in pair)
            result[name.removeprefix(_FITTED)] = (low, high)
    return result


def _parameters(content: Mapping[str, Any], node: str) -> dict[str, Any]:
    entry = checks.mapping(node, content.get(node) or {})
    return checks.mapping(f"{_PARAMETERS} of {node}", entry.get(_PARAMETERS) or {})


def _number(own: Mapping[str, object], name: str, default: float) -> float:
    return checks.number(name, cast("float", own.get(name, default)))


def _knots(own: Mapping[str, object]) -> Knots:
    columns = {key: own.get(name) for key, name in _KNOTS.items()}
    if not any(columns.values()):
        return Knots((0.0,), (1.0,), (0.0,))
    limits = {"bias": math.pi, "amplitude_factor": 10.0, "frequency": 100.0}
    numbers = {
        key: tuple(
            checks.number(_KNOTS[key], each, -limits[key], limits[key]) for each in cast("list[float]", column or [])
        )
        for key, column in columns.items()
    }
    if len({len(each) for each in numbers.values()}) != 1 or list(numbers["bias"]) != sorted(set(numbers["bias"])):
        msg = f"{', '.join(_KNOTS.values())} must be lists of one length, {_KNOTS['bias']} rising"
        raise ValueError(msg)
    return Knots(**numbers)
