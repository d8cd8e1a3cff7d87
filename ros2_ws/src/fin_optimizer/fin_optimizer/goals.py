"""What a study can look for in a swim, by name: one table of measures, goals among them, and constraints on them.

*Steady* figures are means over the last whole beats of the measuring window: three, or as many as it has. The others
are over the whole window.
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fin_plant import checks
from fin_plant.plant_state import SERVO_TORQUE, THRUST
from fin_plant.units import quantity

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    Measured = Mapping[str, float | NDArray[np.float64]]
    """What swims achieved in SI, by measure: one number each, or an array of a value a swim."""

VELOCITY, YAW_RATE = "velocity", "yaw rate in velocity"
"""What is told of every fish; of `SERVO_TORQUE` and `THRUST` a plant says itself whether it tells them."""
MEAN_SPEED, ENERGY_PER_METRE = "mean_speed", "energy_per_metre"
MORE, LESS = 1, -1
"""Which way a measure is good."""


@dataclass(frozen=True)
class Measure:
    """What can be said of a swim, as a number.

    Attributes:
        name: As parameters, files and tables have it.
        unit: SI; empty for a plain number.
        direction: What a value is multiplied with so that more is better: `MORE` or `LESS`.
        words: What people call it.
        meaning: How it is computed, as a sentence.
        needs: What a plant must tell: some of `VELOCITY`, `YAW_RATE`, `SERVO_TORQUE`, `THRUST`.
        shown_in: Unit in which people are told it, and its factor to SI.
        minimum: Smallest value that a constraint may ask for, in ``unit``.
        maximum: Largest one.
        example: A value with its unit, as one writes it.
    """

    name: str
    unit: str
    direction: int
    words: str
    meaning: str
    needs: tuple[str, ...]
    shown_in: tuple[str, float]
    minimum: float
    maximum: float
    example: str

    @property
    def column(self) -> str:
        """Head of its column in tables that programs read."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    @property
    def label(self) -> str:
        """Label of an axis in SI."""
        words = "mean forward speed" if self.name == MEAN_SPEED else self.words
        return f"{words} ({self.unit})" if self.unit else words

    @property
    def axis(self) -> str:
        """Label of an axis in the unit of a laboratory."""
        words = "mean forward speed" if self.name == MEAN_SPEED else self.words
        return f"{words} ({self.shown_in[0]})"

    def told(self, value: float) -> str:
        """Return a value with what people call it, for example ``thrust 12.34 mN``."""
        return f"{self.words} {self.shown(value)}"

    def shown(self, value: float) -> str:
        """Return a value in the unit of a laboratory with four digits, for example ``2.661 cm/s``."""
        unit, factor = self.shown_in
        return f"{value / factor:#.4g} {unit}".rstrip()


def _table(*measures: Measure) -> dict[str, Measure]:
    return {measure.name: measure for measure in measures}


MEASURES = _table(
    Measure(
        MEAN_SPEED,
        "m/s",
        MORE,
        "speed",
        "Mean forward speed over the window: the distance swum over the time needed.",
        (VELOCITY,),
        ("cm/s", 1e-2),
        -10.0,
        10.0,
        "2 cm/s",
    ),
    Measure(
        "steady_speed",
        "m/s",
        MORE,
        "steady speed",
        "Mean forward speed over the last whole beats of the window.",
        (VELOCITY,),
        ("cm/s", 1e-2),
        -10.0,
        10.0,
        "2 cm/s",
    ),
    Measure(
        ENERGY_PER_METRE,
        "J/m",
        LESS,
        "energy per metre",
        "The servos' mean mechanical power over the mean speed, both over the window; a swim without headway has none.",
        (VELOCITY, SERVO_TORQUE),
        ("J/m", 1.0),
        0.0,
        1e6,
        "3 J/m",
    ),
    Measure(
        "power",
        "W",
        LESS,
        "power",
        "The servos' mean mechanical power at their shafts over the window.",
        (SERVO_TORQUE,),
        ("mW", 1e-3),
        -1e4,
        1e4,
        "0.5 W",
    ),
    Measure(
        "efficiency",
        "",
        MORE,
        "efficiency",
        "Steady thrust times steady speed over the servos' steady mechanical power (Froude efficiency).",
        (VELOCITY, SERVO_TORQUE, THRUST),
        ("%", 1e-2),
        -1.0,
        1.0,
        "30 %",
    ),
    Measure(
        "thrust",
        "N",
        MORE,
        "thrust",
        "Mean forward force of the water on the tail over the last whole beats.",
        (THRUST,),
        ("mN", 1e-3),
        -1e3,
        1e3,
        "20 mN",
    ),
    Measure(
        "turning_rate",
        "rad/s",
        MORE,
        "turning rate",
        "Mean yaw rate over the last whole beats, either way.",
        (VELOCITY, YAW_RATE),
        ("deg/s", math.pi / 180.0),
        0.0,
        100.0,
        "10 deg/s",
    ),
    Measure(
        "turning_radius",
        "m",
        LESS,
        "turning radius",
        "Steady speed, forwards or backwards, over the turning rate.",
        (VELOCITY, YAW_RATE),
        ("cm", 1e-2),
        0.0,
        1e4,
        "30 cm",
    ),
    Measure(
        "servo_torque",
        "N m",
        LESS,
        "servo's largest torque",
        "Largest torque of any servo in the window, either way.",
        (SERVO_TORQUE,),
        ("N m", 1.0),
        0.0,
        1e3,
        "0.2 N m",
    ),
)
"""Every measure, by name. Nothing of it is written anywhere else."""

OF_OBJECTIVE = {"speed": (MEAN_SPEED,), "speed_and_cost_of_transport": (MEAN_SPEED, ENERGY_PER_METRE)}
"""Goals that the parameter ``objective`` is short for."""


def measure(name: str) -> Measure:
    """Return a measure by its name.

    Raises:
        ValueError: There is none of that name; the nearest ones are offered.
    """
    if name in MEASURES:
        return MEASURES[name]
    near = difflib.get_close_matches(name, MEASURES, n=2)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(MEASURES)}"
    msg = f"{name!r} is no measure of a swim: {hint}"
    raise ValueError(msg)


BETWEEN_CONSTRAINTS = "; "
"""Stands between constraints where they are told in one text."""
_CONSTRAINT = re.compile(r"\s*(\w+)\s*(<=|>=)\s*(.*?)\s*")
_PERCENT = re.compile(r"(.*?)\s*%")


@dataclass(frozen=True)
class Constraint:
    """A limit on a measure.

    Attributes:
        measure: What is limited.
        at_least: Whether the limit is the least allowed; otherwise the most.
        limit: In the measure's SI unit.
        text: As it was written.
    """

    measure: Measure
    at_least: bool
    limit: float
    text: str

    @classmethod
    def parse(cls, text: str) -> Constraint:
        """Read a constraint like ``mean_speed >= 2 cm/s``.

        Raises:
            ValueError: It is none, or its limit has another kind of unit, none, or a value that no swim has.
        """
        found = _CONSTRAINT.fullmatch(text)
        if found is None:
            msg = f"constraint {text!r} cannot be read: write it like mean_speed >= 2 cm/s, or power <= 0.5 W"
            raise ValueError(msg)
        try:
            of = measure(found[1])
            return cls(of, found[2] == ">=", _limit(of, found[3]), " ".join(text.split()))
        except ValueError as error:
            msg = f"constraint {text!r}: {error}"
            raise ValueError(msg) from None

    def excess(self, value: Any) -> Any:
        """Return by how much a value, or each of an array, misses the limit, as a share of it; 0 or less if it is met.

        Of a limit of 0 the amount itself, in SI.
        """
        missing = self.limit - value if self.at_least else value - self.limit
        return missing / (abs(self.limit) or 1.0)

    def missed(self, value: float) -> str:
        """Return in words that a value misses the limit, or an empty text."""
        return f"{self.text} is missed: {self.measure.shown(value)}" if self.excess(value) > 0.0 else ""


def _limit(of: Measure, text: str) -> float:
    percent = _PERCENT.fullmatch(text) if not of.unit else None
    value = quantity(of.name, percent[1] if percent else text, of.unit) * (0.01 if percent else 1.0)
    if of.unit and value != 0.0 and re.fullmatch(r"[-+.\deE]+", text):
        msg = f"its limit {text} has no unit: write for example {of.example}"
        raise ValueError(msg)
    return checks.number(f"limit of {of.name}", value, of.minimum, of.maximum, unit=of.unit)


@dataclass(frozen=True)
class Goals:
    """What a study looks for.

    Attributes:
        measures: What is to be good, one or several; of several none comes before another (a Pareto front).
        constraints: What a fin must meet beside: one that misses any is worse than one that meets all, and of two that
            miss some the one that misses less is the better.

    Raises:
        ValueError: No goal, one twice, or constraints that nothing can meet together.
    """

    measures: tuple[Measure, ...] = (MEASURES[MEAN_SPEED],)
    constraints: tuple[Constraint, ...] = ()

    def __post_init__(self) -> None:
        names = [goal.name for goal in self.measures]
        if not names or len(set(names)) < len(names):
            msg = f"a study needs one goal or several, each once, got {names}"
            raise ValueError(msg)
        for number, one in enumerate(self.constraints):
            for other in self.constraints[:number]:
                _check_pair(other, one)

    @classmethod
    def of(cls, names: Iterable[str], constraints: Iterable[str] = ()) -> Goals:
        """Return the goals that names and texts stand for; see `Constraint.parse`.

        Raises:
            ValueError: A name or a text that is refused.
        """
        return cls(tuple(map(measure, names)), tuple(map(Constraint.parse, constraints)))

    @classmethod
    def of_objective(cls, objective: str, constraints: Iterable[str] = ()) -> Goals:
        """Return the goals of the parameter ``objective``: one of `OF_OBJECTIVE`, or measures with commas between.

        Raises:
            ValueError: A name or a text that is refused.
        """
        names = OF_OBJECTIVE.get(objective) or [name.strip() for name in objective.split(",")]
        return cls.of(names, constraints)

    @property
    def objective(self) -> str:
        """What `of_objective` reads; those that older versions know are written as these do."""
        names = tuple(goal.name for goal in self.measures)
        return next((short for short, meant in OF_OBJECTIVE.items() if meant == names), ", ".join(names))

    @property
    def asked(self) -> tuple[Measure, ...]:
        """All measures that are asked for, each once: the mean speed, which every swim has, goals and constraints."""
        limited = [constraint.measure for constraint in self.constraints]
        return tuple(dict.fromkeys([MEASURES[MEAN_SPEED], *self.measures, *limited]))

    @property
    def needs(self) -> frozenset[str]:
        """What a plant must tell."""
        return frozenset(need for each in self.asked for need in each.needs)

    def cannot_be_told(self, told: Iterable[str], plant: str) -> str:
        """Return which measures a plant cannot tell that tells no more than ``told``, and why; or an empty text."""
        known = set(told)
        lacking = {each.name: [need for need in each.needs if need not in known] for each in self.asked}
        said = [f"{name} needs {' and '.join(needs)}" for name, needs in lacking.items() if needs]
        if not said:
            return ""
        able = [each.name for each in MEASURES.values() if known.issuperset(each.needs)]
        return f"{plant} cannot tell what the study is about: {'; '.join(said)}. It can tell {', '.join(able)}"

    def objectives(self, measured: Measured) -> tuple[Any, ...]:
        """Return what is to be good, more of each being better, of a swim or of many; shape as of ``measured``."""
        return tuple(goal.direction * measured[goal.name] for goal in self.measures)

    def excesses(self, measured: Measured) -> tuple[Any, ...]:
        """Return by how much each constraint is missed, 0 or less where it is met; shape as of ``measured``."""
        return tuple(each.excess(measured[each.measure.name]) for each in self.constraints)

    def shown(self, measured: Mapping[str, float]) -> str:
        """Return in words how good a swim was: the value of every goal, in the order of the goals."""
        return ", ".join(goal.shown(measured[goal.name]) for goal in self.measures)

    def missed(self, measured: Mapping[str, float]) -> list[str]:
        """Return in words which constraints a swim misses."""
        said = (each.missed(measured[each.measure.name]) for each in self.constraints)
        return [text for text in said if text]


def _check_pair(one: Constraint, other: Constraint) -> None:
    if one.measure is not other.measure:
        return
    if one.at_least == other.at_least:
        msg = f"constraints {one.text!r} and {other.text!r} limit the same: keep the one that is meant"
        raise ValueError(msg)
    least, most = (one, other) if one.at_least else (other, one)
    if least.limit >= most.limit:
        msg = f"constraints {least.text!r} and {most.text!r} contradict each other: no swim meets both"
        raise ValueError(msg)
