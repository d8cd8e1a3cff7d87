"""What every drawing of a layout consists of, by layer: the three writers put the same things into their files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fin_optimizer.cutting.blank import Point
    from fin_optimizer.cutting.sheet import Layout, Placed

CUT, SCORE, DIMENSION, TEXT, SHEET = "CUT", "SCORE", "DIMENSION", "TEXT", "SHEET"
COLOURS = {SHEET: "#999999", CUT: "#ff0000", SCORE: "#0000ff", DIMENSION: "#008000", TEXT: "#000000"}
"""Red is cut and blue is scored, as laser cutters are set by custom."""
_LARGEST_LETTERS, _LETTER_ASPECT, _LINE = 3.5, 0.75, 1.5
_ARROW = 8.0
"""mm from the outline to its dimension line."""


@dataclass(frozen=True)
class Words:
    """A line of text, its middle in mm on the sheet, and the letters' height in mm."""

    text: str
    at: Point
    height: float


@dataclass(frozen=True)
class Measure:
    """A dimension line between two points, all mm on the sheet.

    Attributes:
        start: First point that is measured.
        end: Second one.
        base: A point on the dimension line.
        angle: 0 for a distance along x, 90 along y.
        text: In mm.
    """

    start: Point
    end: Point
    base: Point
    angle: float
    text: str

    @property
    def line(self) -> tuple[Point, Point]:
        """Ends of the dimension line."""
        if self.angle == 0.0:
            return (self.start[0], self.base[1]), (self.end[0], self.base[1])
        return (self.base[0], self.start[1]), (self.base[0], self.end[1])

    @property
    def middle(self) -> Point:
        """Where the text stands."""
        (x1, y1), (x2, y2) = self.line
        return 0.5 * (x1 + x2), 0.5 * (y1 + y2)


def outline(piece: Placed) -> list[Point]:
    """Return the corners of a closed outline on the sheet."""
    return [piece.point(corner) for corner in piece.blank.outline]


def holes(piece: Placed) -> list[Point]:
    """Return the holes' middles on the sheet."""
    return [piece.point(hole) for hole in piece.blank.holes]


def root_line(piece: Placed) -> tuple[Point, Point] | None:
    """Return the line to which the clamp's jaws reach and behind which the fin swims; None without a tab."""
    if not piece.blank.clamp.length:
        return None
    root = piece.blank.stations[0][1]
    return piece.point((0.0, -0.5 * root)), piece.point((0.0, 0.5 * root))


def words(piece: Placed) -> list[Words]:
    """Return the label's lines, as large as fits into the swimming part."""
    label = piece.blank.label
    if not label:
        return []
    least = min(height for _, height in piece.blank.stations)
    longest = max(map(len, label))
    letters = min(
        _LARGEST_LETTERS, 0.7 * least / (_LINE * len(label)), 0.9 * piece.blank.length / (_LETTER_ASPECT * longest)
    )
    top = 0.5 * _LINE * letters * (len(label) - 1)
    middle = 0.5 * piece.blank.length
    return [
        Words(text, piece.point((middle, top - _LINE * letters * line)), letters) for line, text in enumerate(label)
    ]


def measures(layout: Layout) -> Iterator[Measure]:
    """Yield the dimensions of a piece that lies alone; several have their sizes in their labels."""
    if len(layout.pieces) > 1:
        return
    (piece,) = layout.pieces
    body = piece.blank
    low = -0.5 * body.height - _ARROW
    spans = [(0.0, body.length), *([(-body.clamp.length, 0.0)] if body.clamp.length else [])]
    for start, end in spans:
        ends = piece.point((start, -0.5 * body.height)), piece.point((end, -0.5 * body.height))
        yield Measure(*ends, piece.point((start, low)), 0.0, f"{end - start:.4g}")
    (_, root), (_, tip) = body.stations[0], body.stations[-1]
    for x, height, side in ((-body.clamp.length, root, -_ARROW), (body.length, tip, _ARROW)):
        ends = piece.point((x, -0.5 * height)), piece.point((x, 0.5 * height))
        yield Measure(*ends, piece.point((x + side, 0.0)), 90.0, f"{height:.4g}")


ROOM_FOR_MEASURES = 2.0 * _ARROW
"""mm around a piece that lies alone."""
