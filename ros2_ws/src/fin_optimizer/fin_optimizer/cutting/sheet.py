"""Several pieces on one sheet, in rows, all lying alike: a sheet need not be equally stiff along and across."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.cutting.blank import Blank, Point

LONGEST_EDGE = 5000.0
_ROUNDING = 1.0 + 1e-9
"""By which sums of lengths may be larger than a sheet that they fill."""


@dataclass(frozen=True)
class Placed:
    """A piece and where its root's middle lies on the sheet, mm from the sheet's lower left corner."""

    blank: Blank
    at: Point

    def point(self, point: Point) -> Point:
        """Return a point of the piece as one of the sheet."""
        return point[0] + self.at[0], point[1] + self.at[1]


@dataclass(frozen=True)
class Layout:
    """A sheet's size in mm, and what is cut from it."""

    width: float
    height: float
    pieces: tuple[Placed, ...]


def fitting(blanks: Sequence[Blank], gap: float) -> Layout:
    """Return the pieces one above another on a sheet that is just large enough, ``gap`` mm around each."""
    width = max(each.width for each in blanks) + 2.0 * gap
    height = sum(each.height for each in blanks) + gap * (len(blanks) + 1)
    return nested(blanks, (width, height), gap)


def nested(blanks: Sequence[Blank], sheet: tuple[float, float], gap: float) -> Layout:
    """Lay the pieces in rows on a sheet, the highest first, so that ``gap`` mm stay around each.

    Args:
        blanks: At least one.
        sheet: Its edges along the fins and across them, mm.
        gap: mm.

    Raises:
        ValueError: A piece is larger than the sheet, or not all have room.
    """
    width, height = (
        checks.number(f"sheet's {name}", edge, 1.0, LONGEST_EDGE, unit="mm")
        for name, edge in zip(("length", "width"), sheet, strict=True)
    )
    checks.number("gap", gap, 0.0, 100.0, unit="mm")
    for each in blanks:
        _refuse_larger(each, (width, height), gap)
    pieces: dict[int, Placed] = {}
    left, bottom, top = gap, gap, gap
    for number in sorted(range(len(blanks)), key=lambda n: (-blanks[n].height, n)):
        each = blanks[number]
        if left + each.width + gap > width * _ROUNDING:  # a new row
            left, bottom = gap, top
        if bottom + each.height + gap > height * _ROUNDING:
            continue
        pieces[number] = Placed(each, (left + each.clamp.length, bottom + 0.5 * each.height))
        left += each.width + gap
        top = max(top, bottom + each.height + gap)
    if len(pieces) < len(blanks):
        msg = (
            f"a sheet of {width:g} x {height:g} mm holds {len(pieces)} of the {len(blanks)} fins with {gap:g} mm "
            "around each, all lying alike: give a larger sheet or fewer fins"
        )
        raise ValueError(msg)
    return Layout(width, height, tuple(pieces[number] for number in sorted(pieces)))


def _refuse_larger(each: Blank, sheet: tuple[float, float], gap: float) -> None:
    needed = each.width + 2.0 * gap, each.height + 2.0 * gap
    if needed[0] <= sheet[0] * _ROUNDING and needed[1] <= sheet[1] * _ROUNDING:
        return
    turned = needed[0] <= sheet[1] and needed[1] <= sheet[0]
    advice = (
        f"turn the sheet: give {sheet[1]:g} x {sheet[0]:g} mm if it may lie so" if turned else "give a larger sheet"
    )
    name = f" ({each.label[0]})" if each.label else ""
    msg = (
        f"a piece of {each.width:g} x {each.height:g} mm{name} with {gap:g} mm around it needs {needed[0]:g} x "
        f"{needed[1]:g} mm and does not fit on a sheet of {sheet[0]:g} x {sheet[1]:g} mm: {advice}"
    )
    raise ValueError(msg)
