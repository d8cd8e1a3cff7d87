"""How values are shown: in the units and words of a laboratory."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.search.names import AMPLITUDE, FREQUENCY, drive_place, height_place, parameter

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

MODULUS = "fin.young_modulus"
_DEGREE = math.pi / 180.0
# Symbol or word, factor to SI and unit in which a laboratory speaks of a parameter.
_SHOWN_AS = {
    MODULUS: ("E", 1e9, "GPa"),
    "fin.length": ("length", 1e-2, "cm"),
    "fin.height": ("height", 1e-2, "cm"),
    "fin.tip_height": ("tip height", 1e-2, "cm"),
    "fin.thickness": ("thickness", 1e-3, "mm"),
    "fin.profile_height": ("profile", 1e-2, "cm"),
    FREQUENCY: ("frequency", 1.0, "Hz"),
    AMPLITUDE: ("amplitude", _DEGREE, "deg"),
}
CM = 1e-2

SPEED, SPREAD = MEASURES[MEAN_SPEED].column, "spread [m/s]"
"""Heads of tables that programs read, for what a trial achieved."""


def trial_name(number: int) -> str:
    """Return what people call a trial everywhere, by its number from 0 as in its bag's name: ``trial 0007``."""
    return f"trial {number:04d}"


def show_values(values: Mapping[str, Any]) -> str:
    """Return a candidate in a laboratory's units, for example ``E 1.234 GPa``."""
    shown = []
    for name, value in values.items():
        word, factor, unit = in_words(name)
        shown.append(f"{word} {value}" if isinstance(value, str) else f"{word} {value / factor:.4g} {unit}".rstrip())
    return ", ".join(shown)


def in_words(name: str) -> tuple[str, float, str]:
    """Return what people call a parameter, the factor from SI to the unit in which it is told, and that."""
    if (place := height_place(name)) is not None:
        return f"height {place + 1}", CM, "cm"
    if (drive := drive_place(name)) is not None:
        joint, column = drive
        return f"joint {joint + 1} {column}", *((1.0, "Hz") if column == "frequency" else (_DEGREE, "deg"))
    return _SHOWN_AS.get(name, (name, 1.0, _si_unit(name)))


def show_number(value: object, factor: float = 1.0) -> str:
    """Return a value in its unit with four digits; several, like a profile's heights, joined by dashes."""
    if isinstance(value, list | tuple):
        return "-".join(show_number(each, factor) for each in value)
    return f"{value / factor:#.4g}" if isinstance(value, float) else str(value)


def show_speed(speed: float) -> str:
    """Return a speed given in m/s as cm/s with four digits, for example ``2.661 cm/s``."""
    return f"{speed / CM:#.4g} cm/s"


def near(folder: Path) -> str:
    """Return the folder as seen from the current directory, where that is shorter."""
    return min(str(folder), os.path.relpath(folder), key=len)


def with_unit(name: str) -> str:
    """Return a parameter's name with its SI unit, for the head of a table that programs read."""
    unit = _si_unit(name)
    return f"{name} [{unit}]" if unit else name


def _si_unit(name: str) -> str:
    """Return the SI unit of a parameter of a fin or a gait; empty for one without, or another name."""
    known = parameter(name)
    return known.unit if known is not None else ""
