"""Whether a plant swims the gait that is asked for, from what it says. Without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_plant.gait import COLUMNS
from fin_plant.plant_state import LIMITS

if TYPE_CHECKING:
    from fin_plant.gait import Gait
    from fin_plant.plant_state import PlantState

_ROUNDING = 1e-4
"""Relative difference of two numbers that are meant to be one: people write 0.2618 rad for 15 degrees."""


def other_gait(applied: Gait, asked: Gait) -> str:
    """Return why a plant that moves its tail swims another gait than the one asked for, or an empty text."""
    if applied.same_as(asked, _ROUNDING):
        return ""
    return f"the plant swims another gait than the one asked for: {_differences(asked, applied)}"


def cut_gait(state: PlantState | None, asked: Gait) -> str:
    """Return what the limits that a plant has told would make of the gait, or an empty text."""
    details = state.details if state is not None else {}
    if not set(LIMITS) <= set(details):
        return ""
    sweep, frequency = (float(details[name]) for name in LIMITS)
    cut = asked.limited(sweep, frequency)
    if cut.same_as(asked, _ROUNDING):
        return ""
    limits = f"limits.sweep = {sweep:g} rad, limits.frequency = {frequency:g} Hz"
    return f"the plant's limits ({limits}) would cut the gait: {_differences(asked, cut)}"


def _differences(asked: Gait, swum: Gait) -> str:
    """Return each number of a gait that is another one, asked and swum."""
    if len(asked.joints) != len(swum.joints):
        return f"{len(asked.joints)} driven joints asked, {len(swum.joints)} swum"
    units = dict(zip(COLUMNS, ("rad", "Hz", "rad", "rad"), strict=True))
    pairs = [
        f"joint {number}: {name} {getattr(one, name):g} {unit} asked, {getattr(other, name):g} {unit} swum"
        for number, (one, other) in enumerate(zip(asked.joints, swum.joints, strict=True), start=1)
        for name, unit in units.items()
        if getattr(one, name) != getattr(other, name)
    ]
    return "; ".join(pairs)
