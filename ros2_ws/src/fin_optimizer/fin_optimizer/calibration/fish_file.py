"""The fitted fish as a ROS parameter file: the simulator's part under ``/**``, drive and tracker beside it.

The simulator, ``swim`` and a study take the file as they take any of their parameter files; what no simulator has
stands under a node's name that is none of theirs, ``calibration``, and ``predict`` reads it there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from fin_optimizer.calibration.model import Knots, Model
from fin_optimizer.calibration.settings import AMPLITUDE_FACTOR, OWN
from fin_plant import checks, text_file, yaml_file
from fin_plant.fin import node_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.calibration.fit import Fit
    from fin_plant.parameters import Value

_SIMULATOR, _OWN, _PARAMETERS = "/**", "calibration", "ros__parameters"
_KNOTS = {"bias": "drive.knots", "amplitude_factor": AMPLITUDE_FACTOR, "frequency": "drive.frequency"}
_KNOT_RANGES = {"bias": (-math.pi, math.pi), "amplitude_factor": (0.0, 10.0), "frequency": (0.0, 100.0)}
_FITTED = "fitted."
_FACTOR_ERROR = "drive.amplitude_factor_error"
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
    factors = [place for place, name in enumerate(found.names) if name.startswith(AMPLITUDE_FACTOR)]
    factor_errors = [0.5 * float(found.high[place] - found.low[place]) for place in factors]
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
        *([f"    {_FACTOR_ERROR}: {_text(factor_errors)} # one standard error, the same"] if factors else []),
        f"    {_KNOTS['frequency']}: {_text(list(model.knots.frequency))} # Hz, the same",
        *(
            f"    {_FITTED}{name}: [{low:.3g}, {high:.3g}] # one standard error either way"
            for name, low, high in zip(found.names, found.low, found.high, strict=True)
            if not name.startswith(AMPLITUDE_FACTOR)
        ),
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
        known = (*OWN, *_KNOTS.values(), _FACTOR_ERROR)
        if unknown := [name for name in own if name not in known and not name.startswith(_FITTED)]:
            msg = f"{_OWN} has no parameter {unknown[0]}: there are {', '.join(known)}"
            raise ValueError(msg)
        return Model(fish, {name: _number(own, name, none) for name, (none, _) in OWN.items()}, _knots(own))


def read_errors(path: Path) -> dict[str, tuple[float, float]]:
    """Return low and high of what a file of `fish_file` says was fitted, by name; nothing of another file.

    The amplitude factor is that without bias.

    Raises:
        ValueError: It cannot be read, or one is no pair of numbers; the message names the file.
    """
    result = {}
    with text_file.named(path):
        content: Any = yaml_file.read(path)
        own = _parameters(checks.mapping("it", content), _OWN)
        if _FACTOR_ERROR in own:
            knots, errors = _knots(own), _numbers(_FACTOR_ERROR, own[_FACTOR_ERROR], 0.0, math.inf)
            if len(errors) != len(knots.bias):
                msg = f"{_FACTOR_ERROR} must have an error for each of {_KNOTS['bias']}"
                raise ValueError(msg)
            factor, error = knots.at(0.0)[0], float(np.interp(0.0, knots.bias, errors))
            result[AMPLITUDE_FACTOR] = (factor - error, factor + error)
        for name, pair in own.items():
            if name.startswith(_FITTED):
                result[name.removeprefix(_FITTED)] = _pair(name, pair)
    return result


def _pair(name: str, given: object) -> tuple[float, float]:
    numbers = _numbers(name, given, -math.inf, math.inf)
    if len(numbers) != 2:  # noqa: PLR2004
        msg = f"{name} = {given!r} must be [low, high]"
        raise ValueError(msg)
    return numbers[0], numbers[1]


def _parameters(content: Mapping[str, Any], node: str) -> dict[str, Any]:
    entry = checks.mapping(node, content.get(node) or {})
    return checks.mapping(f"{_PARAMETERS} of {node}", entry.get(_PARAMETERS) or {})


def _numbers(name: str, given: object, minimum: float, maximum: float) -> tuple[float, ...]:
    if not isinstance(given, list):
        msg = f"{name} = {given!r} must be a list of numbers"
        raise ValueError(msg)
    return tuple(checks.number(name, each, minimum, maximum) for each in given)


def _number(own: Mapping[str, object], name: str, default: float) -> float:
    return checks.number(name, cast("float", own.get(name, default)))


def _knots(own: Mapping[str, object]) -> Knots:
    columns = {key: own.get(name) for key, name in _KNOTS.items()}
    if not any(columns.values()):
        return Knots((0.0,), (1.0,), (0.0,))
    numbers = {key: _numbers(_KNOTS[key], column, *_KNOT_RANGES[key]) for key, column in columns.items()}
    if len({len(each) for each in numbers.values()}) != 1 or list(numbers["bias"]) != sorted(set(numbers["bias"])):
        msg = f"{', '.join(_KNOTS.values())} must be lists of one length, {_KNOTS['bias']} rising"
        raise ValueError(msg)
    return Knots(**numbers)
