"""Whether a plant swims the gait that is asked for, from what it says. Without ROS."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fin_plant.checks import counted
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
    """Return why a plant, by what it has told of its tail, would not swim the gait as it is, and what to do; or ""."""
    if state is None:
        return ""
    joints = len(asked.joints)
    if state.driven_joints not in {0, joints}:
        return (
            f"the study's gait has {counted(joints, 'driven joint')}, the plant {state.driven_joints}: "
            "give as many in gait.*, or the "
            f"plant {joints} (a robot by its robot_file, a simulated fish by one link less in peduncle.length)"
        )
    if not set(LIMITS) <= set(state.details):
        return ""
    sweep, frequency = (float(state.details[name]) for name in LIMITS)
    cut = asked.limited(sweep, frequency, state.joint_limits)
    if cut.same_as(asked, _ROUNDING):
        return ""
    limits = f"limits.sweep = {sweep:g} rad, limits.frequency = {frequency:g} Hz"
    own = [
        f"joint {number} by itself {each.sweep:.4g} rad"
        + (f" and {each.rate:.4g} rad/s" if each.rate < math.inf else "")
        for number, each in enumerate(state.joint_limits, start=1)
        if cut.joints[number - 1] != asked.joints[number - 1]
    ]
    return (
        f"the plant's limits ({'; '.join([limits, *own])}) would cut the gait: {_differences(asked, cut)}. Ask for a "
        "gait within them, or change them"
    )


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
