"""What is fitted: parameters by name, each with its bounds and what was known of it before, from a YAML file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

from fin_plant import checks, text_file, yaml_file
from fin_plant.fin import node_table

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from fin_plant.parameters import Value

AMPLITUDE_FACTOR = "drive.amplitude_factor"
GAIN_LEFT, GAIN_RIGHT, OFFSET = "drive.bias_gain_left", "drive.bias_gain_right", "drive.bias_offset"
AHEAD, SPEED_FACTOR = "tracker.ahead", "tracker.speed_factor"
STIFFNESS_FACTOR = "material.stiffness_factor"
OWN = {
    GAIN_LEFT: (1.0, "true over commanded bias to the left (below 0)"),
    GAIN_RIGHT: (1.0, "true over commanded bias to the right (above 0)"),
    OFFSET: (0.0, "true bias where none is commanded, rad"),
    AHEAD: (0.0, "tracked point ahead of the centre of mass, m"),
    SPEED_FACTOR: (1.0, "forward speed as recorded over the true one"),
    STIFFNESS_FACTOR: (1.0, "Young's modulus of the sheets over the nominal one"),
}
"""Parameters of drive, tracker and sheets, which no simulator has: the value that stands for none, and the meaning."""
_FITTABLE_ROOMS = ("body.", "water.", "fin.")
Scale = Literal["log", "linear"]


@dataclass(frozen=True)
class Fitted:
    """A parameter that is fitted.

    Attributes:
        name: A parameter of the simulator, or one of `OWN`.
        low: Least value.
        high: Largest value.
        prior: What it was thought to be; the first start.
        spread: Standard deviation of that belief: of the logarithm for scale ``log``.
        scale: ``log`` for what may be off by factors.

    Raises:
        ValueError: Bounds in the wrong order, a prior outside them, a spread that is not positive.
    """

    name: str
    low: float
    high: float
    prior: float
    spread: float
    scale: Scale

    def __post_init__(self) -> None:
        if not self.low < self.high:
            msg = f"{self.name}: range [{self.low:g}, {self.high:g}] is empty: give the lower bound first"
            raise ValueError(msg)
        checks.number(f"{self.name}: prior", self.prior, self.low, self.high, advice="move the prior or its bounds")
        checks.number(f"{self.name}: spread", self.spread, 0.0, exclusive_minimum=True)
        if self.scale == "log" and self.low <= 0.0:
            msg = f"{self.name}: range begins at {self.low:g}, scale log needs more than 0: use scale linear"
            raise ValueError(msg)

    def coordinate(self, value: float) -> float:
        """Return the value on the scale on which it is fitted."""
        return math.log(value) if self.scale == "log" else value

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate, within the bounds."""
        return min(max(self.unbounded(coordinate), self.low), self.high)

    def unbounded(self, coordinate: float) -> float:
        """Return the value of a coordinate, wherever it lies."""
        return math.exp(coordinate) if self.scale == "log" else coordinate


@dataclass(frozen=True)
class Settings:
    """What a calibration starts from.

    Attributes:
        fish: Parameters of the simulator as ruler and scale gave them, complete.
        stated_frequency: Tail beats that were asked for, Hz; 0 where it is not told.
        fitted: What is fitted, in order.
        fixed: Of `OWN`, what is known, by name.
        factor_spread: Of the amplitude factor at each bias around 1; 0 fits none.
        factor_roughness: Of the difference between the factors at neighbouring biases.
    """

    fish: Mapping[str, Value]
    stated_frequency: float
    fitted: tuple[Fitted, ...]
    fixed: Mapping[str, float]
    factor_spread: float = 0.03
    factor_roughness: float = 0.02

    def with_fixed(self, values: Mapping[str, float]) -> Settings:
        """Return the settings with these parameters known, by a ruler or a scale, and no longer fitted.

        Raises:
            ValueError: An unknown parameter, or a value that it refuses.
        """
        table = node_table("fin_sim", "simulator")
        fish, fixed, factor = dict(self.fish), dict(self.fixed), self.factor_spread
        for name, value in values.items():
            if name == AMPLITUDE_FACTOR:
                checks.number(name, value, 1.0, 1.0, advice="it can be held at 1 only")
                factor = 0.0
            elif name in OWN:
                fixed[name] = checks.number(name, value)
            else:
                fish[name] = table.require(name).check(value)
        fitted = tuple(each for each in self.fitted if each.name not in values)
        return replace(self, fish=fish, fixed=fixed, fitted=fitted, factor_spread=factor)


_KEYS = {"fish", "stated_frequency", "parameters"}
_PARAMETER_KEYS = {"prior", "spread", "range", "scale"}
_FACTOR_KEYS = {"spread", "roughness"}


def _fitted(name: str, entry: object) -> Fitted:
    if not isinstance(entry, dict) or entry.keys() != _PARAMETER_KEYS:
        msg = f"{name} needs {', '.join(sorted(_PARAMETER_KEYS))}, it has {entry!r}"
        raise ValueError(msg)
    if name not in OWN:
        parameter = node_table("fin_sim", "simulator").require(name)
        if not name.startswith(_FITTABLE_ROOMS) or parameter.kind != "double":
            msg = f"{name} cannot be fitted: what can be are numbers of body, water and fin, and {', '.join(OWN)}"
            raise ValueError(msg)
    bounds = entry["range"]
    if not isinstance(bounds, list) or len(bounds) != 2:  # noqa: PLR2004
        msg = f"{name}: range = {bounds!r} must be [least, largest]"
        raise ValueError(msg)
    low, high = (checks.number(f"{name}: range", each) for each in bounds)
    checks.choice(f"{name}: scale", entry["scale"], ("log", "linear"))
    prior, spread = (checks.number(f"{name}: {key}", entry[key]) for key in ("prior", "spread"))
    return Fitted(name, low, high, prior, spread, cast("Scale", entry["scale"]))


def read_settings(path: Path) -> Settings:
    """Return the settings of a YAML file with ``fish``, ``stated_frequency`` and ``parameters``.

    Raises:
        ValueError: It cannot be read, or something in it is unknown, missing or out of range; the message names it.
    """
    with text_file.named(path):
        content: Any = yaml_file.read(path)
        if not isinstance(content, dict) or not content.keys() <= _KEYS or "parameters" not in content:
            msg = f"it needs parameters, and may have {', '.join(sorted(_KEYS - {'parameters'}))}: nothing else"
            raise ValueError(msg)
        fish = node_table("fin_sim", "simulator").checked(checks.mapping("fish", content.get("fish") or {}))
        frequency = checks.number("stated_frequency", content.get("stated_frequency", 0.0), 0.0, 100.0, unit="Hz")
        entries = dict(checks.mapping("parameters", content["parameters"]))
        factor = entries.pop(AMPLITUDE_FACTOR, None)
        settings = Settings(fish, frequency, tuple(_fitted(*item) for item in entries.items()), {}, factor_spread=0.0)
        if factor is None:
            return settings
        if not isinstance(factor, dict) or factor.keys() != _FACTOR_KEYS:
            msg = f"{AMPLITUDE_FACTOR} needs spread and roughness, it has {factor!r}"
            raise ValueError(msg)
        spread, rough = (
            checks.number(f"{AMPLITUDE_FACTOR}: {key}", factor[key], 0.0, 1.0, exclusive_minimum=True)
            for key in ("spread", "roughness")
        )
        return replace(settings, factor_spread=spread, factor_roughness=rough)
