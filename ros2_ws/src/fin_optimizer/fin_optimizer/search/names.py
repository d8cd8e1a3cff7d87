"""What a study may search, by name: parameters of the fin and of the gait, as their tables have them."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.gait import COLUMNS

if TYPE_CHECKING:
    from fin_plant.parameters import Parameter

STOCK = "stock"
"""Name of the choice among a table of sheets."""
AMPLITUDE, FREQUENCY = "gait.amplitude", "gait.frequency"
WHOLE = {AMPLITUDE: "amplitude", FREQUENCY: "frequency", "gait.lag": "phase", "gait.bias": "bias"}
"""What stands for the whole tail, and the column of a gait that it gives each joint a value in; the values of single
joints are ``gait.joint_1.amplitude`` and so on."""
HEIGHTS = "fin.profile_height"
_HEIGHT = re.compile(r"fin\.profile_height\[(\d+)\]")
_DRIVE = re.compile(rf"gait\.joint_(\d+)\.({'|'.join(COLUMNS)})")


def height(place: int) -> str:
    """Return the name of a height of the fin's profile, from 1 at the root's side."""
    return f"{HEIGHTS}[{place}]"


def height_place(name: str) -> int | None:
    """Return which height of the profile a name means, from 0; None for another name."""
    found = _HEIGHT.fullmatch(name)
    return int(found[1]) - 1 if found else None


def drive(joint: int, column: str) -> str:
    """Return the name of one number of a driven joint, joints counted from 1 at the head."""
    return f"gait.joint_{joint}.{column}"


def drive_place(name: str) -> tuple[int, str] | None:
    """Return the joint, from 0, and the column of the gait that a name means; None for another name."""
    found = _DRIVE.fullmatch(name)
    return (int(found[1]) - 1, found[2]) if found else None


@cache
def parameter(name: str) -> Parameter | None:
    """Return what the tables say of a name; None for one that is neither the fin's nor the gait's."""
    if height_place(name) is not None:
        return replace(FIN_PARAMETERS[HEIGHTS], name=name, kind="double", default=0.0)
    if (place := drive_place(name)) is not None:
        joint, column = place
        description = f"{column.capitalize()} of driven joint {joint + 1}."
        return replace(OPTIMIZER_PARAMETERS[f"gait.joints.{column}"], name=name, kind="double", description=description)
    if name in WHOLE:
        return OPTIMIZER_PARAMETERS[name]
    return FIN_PARAMETERS.get(name)


def searchable(heights: int, joints: int) -> dict[str, Parameter]:
    """Return every parameter that can be searched, by name.

    Args:
        heights: Points of the fin's profile between root and tip.
        joints: Driven joints of the tail.
    """
    names = [name for name, entry in FIN_PARAMETERS.items() if not entry.kind.endswith("array")]
    names += [height(place) for place in range(1, heights + 1)]
    names += [name for name in WHOLE if name != "gait.lag" or joints > 1]
    names += [drive(joint, column) for joint in range(1, joints + 1) for column in COLUMNS]
    return {name: entry for name in names if (entry := parameter(name)) is not None}
