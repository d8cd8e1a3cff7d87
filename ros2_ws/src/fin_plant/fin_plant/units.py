"""Quantities as people write them, a number and its unit: ``96 mm``, ``1180 kg/m^3``; in SI inside."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from fin_plant.parameters import Parameter

Powers = tuple[int, int, int]
"""Of metre, kilogram and second. A radian is 1."""

PLAIN: Powers = (0, 0, 0)
_BASE = ("m", "kg", "s")
_UNITS: dict[str, tuple[float, Powers]] = {
    "m": (1.0, (1, 0, 0)),
    "cm": (1e-2, (1, 0, 0)),
    "mm": (1e-3, (1, 0, 0)),
    "um": (1e-6, (1, 0, 0)),
    "kg": (1.0, (0, 1, 0)),
    "g": (1e-3, (0, 1, 0)),
    "mg": (1e-6, (0, 1, 0)),
    "s": (1.0, (0, 0, 1)),
    "ms": (1e-3, (0, 0, 1)),
    "Hz": (1.0, (0, 0, -1)),
    "rad": (1.0, PLAIN),
    "deg": (math.pi / 180.0, PLAIN),
    "N": (1.0, (1, 1, -2)),
    "mN": (1e-3, (1, 1, -2)),
    "Pa": (1.0, (-1, 1, -2)),
    "kPa": (1e3, (-1, 1, -2)),
    "MPa": (1e6, (-1, 1, -2)),
    "GPa": (1e9, (-1, 1, -2)),
    "J": (1.0, (2, 1, -2)),
    "W": (1.0, (2, 1, -3)),
    "mW": (1e-3, (2, 1, -3)),
}
_UNIT = rf"(?:{'|'.join(sorted(_UNITS, key=len, reverse=True))})(?![\w.])(?:\^-?\d+)?"
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
UNIT_PATTERN = rf"{_UNIT}(?:(?:\s*[*/]\s*|\s+){_UNIT})*"
QUANTITY = re.compile(rf"(?<![\w.])({_NUMBER})\s*({UNIT_PATTERN})")
"""A number and its unit in a longer text."""
_TERM = re.compile(r"\s*([*/]?)\s*([A-Za-z]+)(?:\^(-?\d+))?")


def unit_of(text: str) -> tuple[float, Powers]:
    """Return a unit's factor to SI, and its powers; an empty text is the unit of a plain number.

    Raises:
        ValueError: A unit that is not known.
    """
    factor, powers, at = 1.0, PLAIN, 0
    while at < len(text.rstrip()):
        found = _TERM.match(text, at)
        if found is None or found[2] not in _UNITS:
            msg = f"unit {text!r} is not known: write it with {', '.join(_UNITS)}, for example kg/m^3"
            raise ValueError(msg)
        each, of_each = _UNITS[found[2]]
        power = int(found[3] or 1) * (-1 if found[1] == "/" else 1)
        factor *= each**power
        powers = combined(powers, of_each, power)
        at = found.end()
    return factor, powers


def combined(one: Powers, other: Powers, power: int = 1) -> Powers:
    """Return the powers of one unit times another to a power."""
    return (one[0] + power * other[0], one[1] + power * other[1], one[2] + power * other[2])


def si_unit(powers: Powers) -> str:
    """Return the SI unit of these powers, for example ``kg m^-3``; empty for a plain number."""
    return " ".join(n if p == 1 else f"{n}^{p}" for n, p in zip(_BASE, powers, strict=True) if p)


def quantity(name: str, given: object, unit: str) -> float:
    """Return in SI what is written as a number, which is in SI, or as a text with its unit.

    Args:
        name: What it is, for messages.
        given: For example 0.08 or ``80 mm``.
        unit: Its SI unit.

    Raises:
        ValueError: It is no number, or its unit is of another kind.
    """
    if not isinstance(given, str):
        return checks.number(name, given, unit=unit)  # type: ignore[arg-type]
    found = re.fullmatch(rf"\s*(-?{_NUMBER})\s*({UNIT_PATTERN})?\s*", given)
    if found is None:
        msg = f"{name} = {given!r} is no number with a unit: write for example {_example(unit)}"
        raise ValueError(msg)
    if found[2] is None:
        return float(found[1])
    factor, powers = unit_of(found[2])
    if powers != unit_of(unit)[1]:
        msg = f"{name} = {given!r} has another kind of unit: it is in {unit or 'no unit'}, for example {_example(unit)}"
        raise ValueError(msg)
    value = float(found[1]) * factor
    # 80 mm is 0.08 m to the last bit, as for who writes it in metres; degrees have no such short number.
    return value if powers == PLAIN else float(f"{value:.15g}")


def _example(unit: str) -> str:
    return {"m": "80 mm or 0.08", "Pa": "1.2 GPa or 1.2e9"}.get(unit, f"1 {unit}".strip())


def in_range(name: str, given: object, parameter: Parameter) -> float:
    """Return in SI what is given for a parameter, which its table's range holds.

    Raises:
        ValueError: It is no such quantity or is outside; the message says with which unit it would be inside.
    """
    value = quantity(name, given, parameter.unit)
    try:
        return checks.number(name, value, parameter.minimum, parameter.maximum, unit=parameter.unit)
    except ValueError as error:
        slip = _slip(value, parameter) if not isinstance(given, str) else ""
        msg = f"{error}{slip}"
        raise ValueError(msg) from None


def _slip(value: float, parameter: Parameter) -> str:
    """Return with which units a number would be inside the range that it was found outside of, as a hint."""
    powers = unit_of(parameter.unit)[1]
    fitting = [
        f"{value:g} {name} ({value * factor:g} {parameter.unit})"
        for name, (factor, of_unit) in _UNITS.items()
        if of_unit == powers and factor != 1.0 and parameter.minimum <= value * factor <= parameter.maximum
    ]
    return f"; a number without a unit is in {parameter.unit}: is it {' or '.join(fitting)}?" if fitting else ""
