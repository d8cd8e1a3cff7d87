"""The numbers, or words, that vary from swim to swim, and the swims that come of them."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from fin_plant import checks
from fin_sim.swim_command.plan import GAIT_NUMBERS, PARAMETERS, SwimPlan

_MOST_SWIMS = 10_000


@dataclass(frozen=True)
class Axis:
    """One number, or word, that varies, and the values that it takes."""

    name: str
    values: tuple[Any, ...]

    @property
    def of_words(self) -> bool:
        """Whether it is a word that varies."""
        return isinstance(self.values[0], str)

    @property
    def unit(self) -> str:
        """Unit of the values, empty for a number that has none."""
        return GAIT_NUMBERS[self.name] if self.name in GAIT_NUMBERS else PARAMETERS[self.name].unit


def parse_axis(text: str) -> Axis:
    """Return the axis of ``NAME=FIRST:LAST:COUNT``, ``NAME=FIRST:LAST:COUNT:log`` or ``NAME=VALUE,VALUE,...``.

    What has a choice of words takes the last form.

    Raises:
        ValueError: Another form, or a name that cannot vary.
    """
    name, _, rule = text.partition("=")
    if name not in GAIT_NUMBERS:
        if name not in PARAMETERS:
            near = difflib.get_close_matches(name, (*PARAMETERS, *GAIT_NUMBERS), n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            msg = (
                f"{name or repr(text)} is not a parameter that can vary: {hint}{', '.join(GAIT_NUMBERS)} can, and "
                "the numbers that `swim --help` lists last"
            )
            raise ValueError(msg)
        parameter = PARAMETERS[name]
        if parameter.choices:
            return Axis(name, tuple(parameter.check(word.strip()) for word in rule.split(",")))
        if parameter.kind not in {"double", "integer"}:
            msg = f"vary {name}: it is no number; vary one that is"
            raise ValueError(msg)
    try:
        values = _spaced(rule.split(":")) if ":" in rule else tuple(map(checks.read_number, rule.split(",")))
    except ValueError as error:
        msg = f"vary {text!r} must read {name}=FIRST:LAST:COUNT[:log] or {name}=VALUE,VALUE,...: {error}"
        raise ValueError(msg) from None
    return Axis(name, values)


def _spaced(parts: list[str]) -> tuple[float, ...]:
    logarithmic = parts[3:] == ["log"]
    if len(parts) != 3 and not logarithmic:  # noqa: PLR2004
        msg = "three numbers, and log or nothing"
        raise ValueError(msg)
    first, last = (
        checks.number(f"{end} value", checks.read_number(part))
        for end, part in zip(("first", "last"), parts, strict=False)
    )
    count = checks.whole_number("count", checks.read_number(parts[2]), 2, _MOST_SWIMS)
    if logarithmic and min(first, last) <= 0.0:
        msg = "a logarithmic range needs values above 0"
        raise ValueError(msg)
    spaced = np.geomspace(first, last, count) if logarithmic else np.linspace(first, last, count)
    return tuple(map(float, spaced))


def varied_plans(plan: SwimPlan, axes: list[Axis]) -> list[tuple[tuple[float | str, ...], SwimPlan]]:
    """Return the swims of a variation and their numbers, the first axis varying slowest; every plan is checked.

    Raises:
        ValueError: More than two axes, one twice, too many swims, or a value that is refused.
    """
    if len(axes) > 2 or len({axis.name for axis in axes}) < len(axes):  # noqa: PLR2004
        msg = f"vary {', '.join(axis.name for axis in axes)}: one or two different numbers can vary"
        raise ValueError(msg)
    checks.whole_number("number of swims", math.prod(len(axis.values) for axis in axes), 1, _MOST_SWIMS)
    result = []
    for numbers in product(*(axis.values for axis in axes)):
        changed = plan
        for axis, number in zip(axes, numbers, strict=True):
            changed = changed.changed(axis.name, number)
        changed.check()
        result.append((numbers, changed))
    return result
