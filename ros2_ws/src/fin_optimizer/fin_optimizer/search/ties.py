"""Ties: what follows from a candidate because something else is held fixed, its side area for example."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fin_plant.fin import AREA, scaled_to_area
from fin_plant.parameters import Parameter
from fin_plant.units import in_range

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

VOLUME, TIP_OVER_ROOT = "fin.volume", "fin.tip_over_root"
_KINDS = {
    TIP_OVER_ROOT: Parameter(TIP_OVER_ROOT, "double", 1.0, "Height at the tip over that at the root.", "", 0.0, 100.0),
    AREA: Parameter(AREA, "double", 2e-3, "Side area of the fin.", "m^2", 1e-5, 0.25),
    VOLUME: Parameter(VOLUME, "double", 4e-7, "Volume of the fin's sheet.", "m^3", 1e-10, 5e-3),
}
"""What can be held fixed, in the order in which it is solved."""
_WAYS = {TIP_OVER_ROOT: ("tip",), AREA: ("heights", "length"), VOLUME: ("thickness", "heights", "length")}
"""What may follow, the most natural one first."""
_SOLVED = {
    "tip": ("fin.tip_height",),
    "heights": ("fin.height", "fin.tip_height", "fin.profile_height"),
    "length": ("fin.length",),
    "thickness": ("fin.thickness",),
}
_FIXED = "fixed"


@dataclass(frozen=True)
class Tie:
    """Something that every fin of the study has alike.

    Attributes:
        name: What is held: ``fin.area``, ``fin.volume`` or ``fin.tip_over_root``.
        value: In SI.
        by: What follows from it: all heights alike, the length, the thickness, or the height at the tip.
    """

    name: str
    value: float
    by: str

    def solved(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fin's parameters with what follows, or those of many fins as arrays; nothing is checked."""
        if self.name == TIP_OVER_ROOT:
            return {**parameters, "fin.tip_height": self.value * parameters["fin.height"]}
        if self.by == "thickness":
            return {**parameters, "fin.thickness": self.value / area_of(parameters)}
        area = self.value if self.name == AREA else self.value / parameters["fin.thickness"]
        if self.by == "heights":
            return scaled_to_area(parameters, area)
        return {**parameters, "fin.length": parameters["fin.length"] * area / area_of(parameters)}

    @property
    def told(self) -> str:
        """It in a line."""
        return f"{self.value!r} {_KINDS[self.name].unit}".rstrip() + f", the {self.by} following"


def area_of(parameters: Mapping[str, Any]) -> Any:
    """Return the side area in m^2 of the fin with these parameters; of many fins where a value is an array."""
    return parameters["fin.height"] / scaled_to_area(parameters, 1.0)["fin.height"]


def ties(given: object, searched: Collection[str], start: Mapping[str, Any]) -> tuple[Tie, ...]:
    """Return the ties that a file asks for, in the order in which they are solved.

    Args:
        given: A mapping of what is held to its value, to ``fixed`` for that of the fin that the search starts from, or
            to ``{value: ..., by: ...}``.
        searched: Names of what is searched, and of what the stock gives.
        start: Parameters of the fin that the search starts from.

    Raises:
        ValueError: An unknown tie, or one that leaves nothing to follow.
    """
    if not isinstance(given, dict) or not set(given) <= set(_KINDS):
        wrong = f": {', '.join(sorted(set(given) - set(_KINDS)))} is none" if isinstance(given, dict) else ""
        msg = f"ties must be a mapping of {', '.join(_KINDS)} to what they are held at{wrong}"
        raise ValueError(msg)
    found: list[Tie] = []
    for name in (name for name in _KINDS if name in given):
        found.append(_tie(name, given[name], searched, [tie.by for tie in found], start))
    return tuple(found)


def _tie(name: str, entry: object, searched: Collection[str], before: Sequence[str], start: Mapping[str, Any]) -> Tie:
    entries = entry if isinstance(entry, dict) else {"value": entry}
    if not {"value"} <= set(entries) <= {"value", "by"}:
        msg = f"tie {name} = {entry!r} must be a value, {_FIXED}, or a mapping with value and by"
        raise ValueError(msg)
    free = [way for way in _WAYS[name] if way not in before and not _set_by(way, searched)]
    by = entries.get("by", free[0] if free else None)
    if by is None:
        known = ", ".join(each for way in _WAYS[name] for each in _set_by(way, searched))
        msg = f"tie {name} leaves nothing that could follow from it, {' or '.join(_WAYS[name])} ({known}): free one"
        raise ValueError(msg)
    if by not in _WAYS[name]:
        msg = f"tie {name}: by = {by!r} is not known: choose one of {', '.join(_WAYS[name])}"
        raise ValueError(msg)
    # Heights that are searched are a shape, which a tie may scale if it is told to.
    if by in before or (by != "heights" and _set_by(by, searched)):
        msg = f"tie {name} sets the {by}, which is searched, drawn from the stock or set by another tie: keep one"
        raise ValueError(msg)
    return Tie(name, _value(name, entries["value"], start), str(by))


def _set_by(way: str, searched: Collection[str]) -> list[str]:
    """Return what is searched of that which a tie would set in this way."""
    return [name for name in searched if name.partition("[")[0] in _SOLVED[way]]


def _value(name: str, given: object, start: Mapping[str, Any]) -> float:
    if given != _FIXED:
        return in_range(f"tie {name}", given, _KINDS[name])
    if name == TIP_OVER_ROOT:
        return float(start["fin.tip_height"] / start["fin.height"])
    area = float(area_of(start))
    return area if name == AREA else area * float(start["fin.thickness"])
