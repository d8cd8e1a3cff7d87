"""Where a swim's model holds: how far a hinge may bend, how short a fin may be. The one place that says so.

Simulator, batch, node and score all ask here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fin_plant.fin import Fin

BENT_ANGLE = 0.5 * math.pi
"""Hinge angle in rad above which a swim is doubtful.

Beyond a right angle a link points back at the one ahead: the hinge's spring, linear in the angle, is the bending of a
sheet no more, and the flow over a link is disturbed by the one ahead of it.
"""
FOLDED_ANGLE = math.pi
"""Hinge angle in rad above which a swim is refused: the link would have passed through the one ahead of it."""
HINGE = "fin_hinge_"
"""How the names of the fin's passive joints begin in JointStates."""
LEAST_SLENDERNESS = 3.0
"""Length of a fin over its largest height below which strip theory is doubtful.

The water's mass pi/4 rho d^2 a length is that of a body whose height changes little over its own size (Lighthill,
*Journal of Fluid Mechanics* 9, 1960). The largest height counts, not the mean: it is the extent of the flow around a
section, and the force of a flaring fin arises where it is highest.
"""


class FoldedError(ArithmeticError):
    """A swim in which the fin folded: it has no result."""


def refuse_folded(angle: float) -> None:
    """Refuse a swim whose largest hinge angle was ``angle`` rad.

    Raises:
        FoldedError: It is above `FOLDED_ANGLE`.
    """
    if folded(angle):
        raise FoldedError(folded(angle))


def folded(angle: float) -> str:
    """Return why a swim whose largest hinge angle was ``angle`` rad is refused; empty if it is not."""
    if angle <= FOLDED_ANGLE:
        return ""
    return (
        f"a hinge of the fin bent by {math.degrees(angle):.0f} degrees, more than {math.degrees(FOLDED_ANGLE):.0f}: "
        "the fin would have passed through itself, and no figure of the swim means anything; use a stiffer or shorter "
        "fin, or a slower or smaller gait"
    )


def bent(angle: float) -> str:
    """Return what is doubtful in a swim whose largest hinge angle was ``angle`` rad; empty if nothing is."""
    if not BENT_ANGLE < angle <= FOLDED_ANGLE:
        return ""
    return (
        f"a hinge of the fin bent by {math.degrees(angle):.0f} degrees, more than {math.degrees(BENT_ANGLE):.0f}: "
        "beyond a right angle neither the spring's law nor the water's force is that of a sheet"
    )


def short(fin: Fin) -> str:
    """Return what is doubtful about a fin's proportions; empty if nothing is."""
    return short_tail(fin.length, fin.largest_height)


def short_tail(length: float, largest_height: float) -> str:
    """Return what is doubtful about a fin of ``length`` and ``largest_height`` in m; empty if nothing is."""
    if length >= LEAST_SLENDERNESS * largest_height * (1.0 - 1e-9):
        return ""
    return (
        f"the fin is {length:g} m long and up to {largest_height:g} m high: strip theory holds from "
        f"{LEAST_SLENDERNESS:g} heights of length on, a shorter fin's real force is smaller"
    )


def warnings(fin: Fin, largest_angle: float) -> list[str]:
    """Return what is doubtful in a swim of ``fin`` with this largest hinge angle in rad."""
    return [text for text in (bent(largest_angle), short(fin)) if text]


def largest_hinge_angle(names: Iterable[str], positions: Iterable[float]) -> float:
    """Return the largest angle in rad, either way, of the joints named ``fin_hinge_...``; 0 where there is none."""
    bends = (abs(angle) for name, angle in zip(names, positions, strict=False) if name.startswith(HINGE))
    return max(bends, default=0.0)
