"""What the simulator says of a study's candidates; speeds once computed are kept beside the study."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.search.space import Choice
from fin_optimizer.study.simulated_curve import values_along
from fin_plant.whole_file import write_text

if TYPE_CHECKING:
    from pathlib import Path

    from fin_optimizer.goals import Measure
    from fin_optimizer.search.space import Scalar, Space
    from fin_sim.swim_result import Swim

Speeds = Callable[[Sequence[Mapping[str, Any]]], Sequence[float]]
"""Mean speeds of candidates in m/s, NaN where one cannot be."""

CACHE_FILE = "landscape.json"
DEFAULT_FISH = "its default fish"
"""How the fish is called that stands for one of which nobody has told its parameters."""
_POINTS, _ONLY = 25, 71
"""Points of a curve: of one among several, and where one parameter alone is searched."""
_SIDE = 33
"""Points of each side of a map."""
_MOST = 120
"""Candidates at most that are swum again to be compared."""


@dataclass
class KeptSpeeds:
    """A simulator's speeds, each computed once.

    Attributes:
        compute: Returns those of candidates in m/s, NaN where one cannot be.
        key: What they follow from: fish, gait and versions. Others are not used.
        known: By candidate.
    """

    compute: Speeds
    key: str
    known: dict[str, float | None] = field(default_factory=dict)

    def __call__(self, some: Sequence[Mapping[str, Any]]) -> list[float]:
        """Return the speeds of candidates in m/s, NaN where one cannot be."""
        names = [json.dumps(values, sort_keys=True) for values in some]
        missing = {name: values for name, values in zip(names, some, strict=True) if name not in self.known}
        for name, speed in zip(missing, self.compute(list(missing.values())), strict=True):
            self.known[name] = speed if math.isfinite(speed) else None
        found = [self.known[name] for name in names]
        return [math.nan if speed is None else speed for speed in found]

    def read(self, path: Path) -> None:
        """Take the speeds that lie in a file, if they are this simulator's; one that cannot be read is no loss."""
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["key"] == self.key:
                self.known.update({str(name): None if v is None else float(v) for name, v in content["speeds"].items()})
        except (OSError, ValueError, TypeError, LookupError, AttributeError):
            return

    def write(self, path: Path) -> None:
        """Keep the speeds in a file.

        Raises:
            OSError: The disk refuses.
        """
        text = json.dumps({"key": self.key, "speeds": self.known})
        write_text(path, text)


def key_of(*decides: object) -> str:
    """Return one text for all that decides a simulator's speeds."""
    return hashlib.sha256(json.dumps(decides, sort_keys=True, default=str).encode()).hexdigest()


@dataclass(frozen=True)
class Curve:
    """What the simulator says over one parameter, all else as the best has it.

    Attributes:
        values: Of the parameter.
        found: What is looked for in SI, NaN where a candidate cannot be.
    """

    values: Sequence[Scalar]
    found: Sequence[float]


@dataclass(frozen=True)
class Map:
    """What the simulator says over two parameters, all else as the best has it.

    Attributes:
        across: Values of the first parameter.
        up: Values of the second one.
        found: What is looked for in SI, a row a value of the second one.
    """

    across: Sequence[Scalar]
    up: Sequence[Scalar]
    found: Sequence[Sequence[float]]


@dataclass(frozen=True)
class Simulated:
    """What the simulator says of a study.

    Attributes:
        curves: By parameter.
        map: Where two parameters are ranges and no more are searched, None otherwise.
        again: The measure of candidates that have a score, in SI, by the candidate's number.
        film: Of the best candidate, see `film_of`; None if it cannot be swum.
        numbers: Of its swim: name and value in a laboratory's unit.
        is_the_plant: Whether the simulator swam the trials too.
        measure: What ``again`` is, and the curves and the map where there are any.
        trouble: Why it cannot swim the best candidate.
        swimmer: Which fish it swims, where that is not the study's own.
    """

    curves: Mapping[str, Curve]
    map: Map | None
    again: Mapping[int, float]
    film: Mapping[str, Any] | None
    numbers: Sequence[tuple[str, str]]
    is_the_plant: bool
    measure: Measure = MEASURES[MEAN_SPEED]
    trouble: str = ""
    swimmer: str = DEFAULT_FISH


def curves_through(space: Space, best: Mapping[str, Any], speeds: Speeds) -> dict[str, Curve]:
    """Return the simulator's curve over each parameter through a candidate."""
    points = _ONLY if len(space.dimensions) == 1 else _POINTS
    along = {dimension.name: values_along(dimension, points) for dimension in space.dimensions}
    return {
        name: Curve(values, list(speeds([{**best, name: value} for value in values]))) for name, values in along.items()
    }


def map_of(space: Space, best: Mapping[str, Any], speeds: Speeds) -> Map | None:
    """Return the simulator's map of a space of two ranges, None of another one."""
    if len(space.dimensions) != 2 or any(isinstance(d, Choice) for d in space.dimensions):  # noqa: PLR2004
        return None
    first, second = space.dimensions
    across, up = values_along(first, _SIDE), values_along(second, _SIDE)
    swum = speeds([{**best, first.name: x, second.name: y} for y in up for x in across])
    return Map(across, up, [swum[at : at + len(across)] for at in range(0, len(swum), len(across))])


def to_swim_again(scores: Mapping[int, float]) -> list[int]:
    """Return which candidates are swum again: all, or of many some of all ranks, the best among them."""
    ranked = sorted(scores, key=lambda number: scores[number])
    if len(ranked) <= _MOST:
        return ranked
    return [ranked[place] for place in np.linspace(0, len(ranked) - 1, _MOST).astype(int)]


def numbers_of(swim: Swim, settle: float) -> list[tuple[str, str]]:
    """Return the numbers of a swim with their units; those that it does not tell are left out.

    Args:
        swim: What was swum.
        settle: Time before what is scored, s.
    """
    counted = swim.time >= settle
    window = float(swim.time[counted][-1] - swim.time[counted][0])

    def over(values: Any) -> float:
        return float(np.trapezoid(values[counted], swim.time[counted])) / window

    def cost() -> float:
        speed = over(swim.surge)
        return over(swim.servo_power) / speed if speed > 0.0 else math.nan

    wanted: list[tuple[str, Callable[[], float], float, str]] = [
        ("mean speed, as scored", lambda: over(swim.surge), 1e-2, "cm/s"),
        ("steady speed", lambda: swim.steady_speed, 1e-2, "cm/s"),
        ("mean thrust", lambda: swim.mean_thrust, 1e-3, "mN"),
        ("mean servo power", lambda: swim.mean_servo_power, 1e-3, "mW"),
        ("energy per metre", cost, 1.0, "J/m"),
        ("Strouhal number", lambda: swim.strouhal_number, 1.0, ""),
        ("tip amplitude", lambda: swim.tip_amplitude, 1e-3, "mm"),
        ("efficiency", lambda: swim.efficiency, 1e-2, "%"),
        ("largest servo torque", lambda: swim.largest_servo_torque, 1e-3, "mN m"),
        ("tail beat", lambda: swim.frequency, 1.0, "Hz"),
    ]
    told = []
    for name, compute, factor, unit in wanted:
        try:
            value = compute()
        except (ArithmeticError, ValueError):  # a swim too short for a whole beat, a servo that delivers no power
            continue
        if math.isfinite(value):
            told.append((name, f"{value / factor:.4g} {unit}".rstrip()))
    return told
