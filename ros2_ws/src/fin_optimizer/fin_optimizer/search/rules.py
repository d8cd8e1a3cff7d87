"""What a plant is sent for a candidate, and why a candidate cannot be: pure functions of what is searched."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Self

from fin_optimizer.gait_parameters import gait_from_parameters
from fin_optimizer.search import names
from fin_optimizer.search.conditions import Condition
from fin_optimizer.search.space import Space, generator
from fin_optimizer.search.stock import SETS, Sheet
from fin_optimizer.search.ties import TIP_OVER_ROOT, VOLUME, Tie, area_of
from fin_plant.fin import AREA, Fin
from fin_plant.gait import COLUMNS, Gait
from fin_sim.rigid_fin import rigid_fin_load

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from fin_plant.parameters import Value

_SAMPLES = 2000
"""Candidates that are drawn before a space is said to hold none; one of which 1 in 500 can be is missed once in 55."""
MASS, LARGEST_HEIGHT = "fin.mass", "fin.largest_height"
SERVO_RATE, SERVO_TORQUE, SERVO_POWER = "servo.rate", "servo.torque", "servo.power"
DERIVED = {
    AREA: "m^2",
    VOLUME: "m^3",
    TIP_OVER_ROOT: "",
    MASS: "kg",
    LARGEST_HEIGHT: "m",
    SERVO_RATE: "rad/s",
    SERVO_TORQUE: "N m",
    SERVO_POWER: "W",
}
"""What conditions may name beside the plant's parameters, and its unit."""


def condition_units(heights: int, joints: int) -> dict[str, str]:
    """Return the unit of every name that a condition may use, for so many points of a profile and driven joints."""
    numbers = names.searchable(heights, joints)
    return {n: entry.unit for n, entry in numbers.items() if entry.kind in {"double", "integer"}} | DERIVED


def gait_of(parameters: Mapping[str, Any]) -> Gait:
    """Return the gait that parameters describe: that of the whole tail, single numbers of joints in place of its.

    Raises:
        ValueError: A gait that is refused.
    """
    rows = gait_from_parameters(parameters).rows()
    for name, value in parameters.items():
        if (place := names.drive_place(name)) is not None:
            rows[place[0], COLUMNS.index(place[1])] = value
    return Gait.from_rows(rows)


@dataclass(frozen=True)
class Rules:
    """What follows from the values that are searched, and what it must meet.

    Attributes:
        stock: Sheets by name; empty where material and thickness are not drawn together.
        ties: In the order in which they are solved.
        conditions: What every fin and gait must meet.
    """

    stock: Mapping[str, Sheet] = field(default_factory=dict)
    ties: tuple[Tie, ...] = ()
    conditions: tuple[Condition, ...] = ()

    def sent(self, start: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Value]:
        """Return all parameters of the fin and of the gait for a candidate; nothing is checked.

        Args:
            start: Those that the search starts from; searched ones may be missing.
            values: The candidate.
        """
        result: dict[str, Any] = dict(start)
        if names.STOCK in values:
            frequency = gait_of({**start, **values}).joints[-1].frequency
            result |= self.stock[values[names.STOCK]].parameters(frequency)
        heights = list(result.get(names.HEIGHTS, ()))
        for name, value in values.items():
            place = names.height_place(name)
            if place is not None:
                heights[place] = value
            elif name != names.STOCK:
                result[name] = value
        result[names.HEIGHTS] = heights
        for tie in self.ties:
            result = tie.solved(result)
        return result

    def refusal(self, start: Mapping[str, Any], values: Mapping[str, Any]) -> tuple[str, str]:
        """Return what a candidate does not meet, and why, with its numbers; empty texts if it can be."""
        try:
            parameters = self.sent(start, values)
            fin, gait = Fin.from_parameters(parameters), gait_of(parameters)
        except (ArithmeticError, ValueError) as error:
            rule = f"the ties {', '.join(tie.name for tie in self.ties)}" if self.ties else "what a fin can be"
            return rule, str(error)
        if names.STOCK in values:
            too_small = self.stock[values[names.STOCK]].refusal(fin.length, fin.largest_height)
            if too_small:
                return "the sheets' sizes", too_small
        numbers = _numbers(parameters, fin, gait) if self.conditions else {}
        if any(name in {SERVO_TORQUE, SERVO_POWER} for condition in self.conditions for name in condition.names):
            drive = gait.joints[-1]  # the one that carries the fin
            load = rigid_fin_load(fin, drive.amplitude, drive.frequency)
            numbers |= {SERVO_TORQUE: load.torque, SERVO_POWER: load.power}
        for condition in self.conditions:
            if why := condition.refusal(numbers):
                return f"the condition {condition.text}", why
        return "", ""

    def judge(self, start: Mapping[str, Any], values: Mapping[str, Any]) -> str:
        """Return why a candidate cannot be, or an empty text."""
        return self.refusal(start, values)[1]

    def applied_to(self, space: Space, start: Mapping[str, Any]) -> Space:
        """Return the space of those candidates that can be.

        Raises:
            ValueError: None is found; the message says what stands in the way, and how often.
        """
        random, met = generator(0, 0), defaultdict[str, list[str]](list)
        for _ in range(_SAMPLES):
            rule, why = self.refusal(start, space.drawn(random))
            if not rule:
                many = partial(can_be, space, self, dict(start)) if is_plain(self) else None
                return Space(space.dimensions, partial(self.judge, dict(start)), many)
            met[rule].append(why)
        told = (f"{len(whys)} fail {rule} ({whys[-1]})" for rule, whys in sorted(met.items(), key=_count))
        msg = f"of {_SAMPLES} candidates drawn from the space none can be: {'; '.join(told)}"
        raise ValueError(msg)

    def flat(self) -> dict[str, object]:
        """Return everything by a name that a reader knows."""
        return {
            **{f"sheet {name}": sheet.told for name, sheet in self.stock.items()},
            **{f"tie {tie.name}": tie.told for tie in self.ties},
            **({"conditions": "; ".join(each.text for each in self.conditions)} if self.conditions else {}),
        }

    def written(self) -> dict[str, object]:
        """Return what `from_written` reads."""
        return {
            "stock": [asdict(sheet) for sheet in self.stock.values()],
            "ties": [asdict(tie) for tie in self.ties],
            "conditions": [condition.text for condition in self.conditions],
        }

    @classmethod
    def from_written(cls, content: Mapping[str, Any], heights: int, joints: int = 1) -> Self:
        """Return the rules of a study's settings.

        Raises:
            TypeError: Others than there are.
            ValueError: A condition that cannot be read.
        """
        units = condition_units(heights, joints)
        sheets = [Sheet(**{**entry, "size": tuple(entry["size"])}) for entry in content["stock"]]
        return cls(
            {each.name: each for each in sheets},
            tuple(Tie(**entry) for entry in content["ties"]),
            tuple(Condition.parse(text, units) for text in content["conditions"]),
        )

    @property
    def given(self) -> frozenset[str]:
        """The plant's parameters that the stock gives."""
        return frozenset(SETS) if self.stock else frozenset()


def is_plain(rules: Rules) -> bool:
    """Return whether all that follows from a candidate, and all that it must meet, can be computed for many at once."""
    conditions = rules.conditions
    return not rules.stock and all(each.is_arithmetic and not set(each.names) & set(DERIVED) for each in conditions)


def can_be(space: Space, rules: Rules, start: Mapping[str, Any], numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows of candidates can be, shape (candidates,), where the rules are plain."""
    from fin_optimizer.search.many import columns_of  # noqa: PLC0415  (loads the batch, which a study does not need)

    return columns_of(space, rules, start, numbers).met(rules.conditions)


def _count(entry: tuple[str, list[str]]) -> int:
    return -len(entry[1])


def _numbers(parameters: Mapping[str, Any], fin: Fin, gait: Gait) -> dict[str, float]:
    """Return every number that a condition may name, in SI."""
    found = {name: float(value) for name, value in parameters.items() if isinstance(value, int | float)}
    heights = parameters[names.HEIGHTS]
    found |= {names.height(place): float(each) for place, each in enumerate(heights, start=1)}
    for joint, row in enumerate(gait.rows(), start=1):
        found |= {names.drive(joint, column): float(value) for column, value in zip(COLUMNS, row, strict=True)}
    area = float(area_of(parameters))
    return found | {
        AREA: area,
        VOLUME: area * fin.thickness,
        TIP_OVER_ROOT: fin.tip_height / fin.height,
        MASS: fin.density * area * fin.thickness,
        LARGEST_HEIGHT: fin.largest_height,
        # The peak rate of A sin(2 pi f t): the fastest of the tail's servos.
        SERVO_RATE: max(2.0 * math.pi * joint.frequency * joint.amplitude for joint in gait.joints),
    }
