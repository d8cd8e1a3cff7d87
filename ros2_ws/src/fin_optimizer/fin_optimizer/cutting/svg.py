"""A layout as SVG whose width and height are in mm."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from fin_optimizer.cutting.layers import (
    COLOURS,
    CUT,
    DIMENSION,
    SCORE,
    SHEET,
    TEXT,
    holes,
    measures,
    outline,
    root_line,
    words,
)

if TYPE_CHECKING:
    from pathlib import Path

    from fin_optimizer.cutting.blank import Point
    from fin_optimizer.cutting.sheet import Layout

_NAMESPACE = "http://www.w3.org/2000/svg"
_HAIRLINE = 0.1
"""mm; laser cutters take the thinnest lines as paths to follow."""
_DIGITS = 2.5
"""mm, height of a dimension's digits."""
_CAPITALS = 0.72
"""Height of capital letters over the font's size, of common sans-serif fonts."""
_DECIMALS = 4


class _Drawing:
    """An SVG in which one unit is 1 mm, with a group for each layer; points have y upwards, as the layout's."""

    def __init__(self, width: float, height: float) -> None:
        ET.register_namespace("", _NAMESPACE)
        self._height = height
        size = {"width": f"{_text(width)}mm", "height": f"{_text(height)}mm"}
        self._root = ET.Element(_tag("svg"), {**size, "viewBox": f"0 0 {_text(width)} {_text(height)}"})
        self._groups = {
            layer: ET.SubElement(
                self._root,
                _tag("g"),
                {"id": layer, "fill": "none", "stroke": colour, "stroke-width": _text(_HAIRLINE)},
            )
            for layer, colour in COLOURS.items()
        }

    def _add(self, layer: str, kind: str, **attributes: float | str) -> ET.Element:
        texts = {name: each if isinstance(each, str) else _text(each) for name, each in attributes.items()}
        return ET.SubElement(self._groups[layer], _tag(kind), texts)

    def polygon(self, layer: str, points: list[Point]) -> None:
        self._add(layer, "polygon", points=" ".join(f"{_text(x)},{_text(self._height - y)}" for x, y in points))

    def circle(self, layer: str, middle: Point, radius: float) -> None:
        self._add(layer, "circle", cx=middle[0], cy=self._height - middle[1], r=radius)

    def line(self, layer: str, start: Point, end: Point) -> None:
        self._add(layer, "line", x1=start[0], y1=self._height - start[1], x2=end[0], y2=self._height - end[1])

    def words(self, layer: str, text: str, middle: Point, height: float) -> None:
        x, y = middle[0], self._height - middle[1] + 0.5 * height
        style = {"font-family": "sans-serif", "font-size": _text(height / _CAPITALS), "text-anchor": "middle"}
        self._add(layer, "text", x=x, y=y, fill=COLOURS[layer], stroke="none", **style).text = text

    def save(self, path: Path) -> None:
        ET.indent(self._root)
        ET.ElementTree(self._root).write(path, encoding="utf-8", xml_declaration=True)


def _tag(kind: str) -> str:
    return f"{{{_NAMESPACE}}}{kind}"


def _text(value: float) -> str:
    return f"{round(value, _DECIMALS):.{_DECIMALS}f}".rstrip("0").rstrip(".")


def write_svg(path: Path, layout: Layout) -> None:
    """Write the layout as SVG, with the layers of `fin_optimizer.cutting.layers` as groups.

    Raises:
        OSError: The file cannot be written.
    """
    drawing = _Drawing(layout.width, layout.height)
    if len(layout.pieces) > 1:
        drawing.polygon(SHEET, [(0, 0), (layout.width, 0), (layout.width, layout.height), (0, layout.height)])
    for piece in layout.pieces:
        drawing.polygon(CUT, outline(piece))
        for hole in holes(piece):
            drawing.circle(CUT, hole, 0.5 * piece.blank.clamp.hole_diameter)
        if line := root_line(piece):
            drawing.line(SCORE, *line)
        for each in words(piece):
            drawing.words(TEXT, each.text, each.at, each.height)
    for measure in measures(layout):
        drawing.line(DIMENSION, *measure.line)
        for point, end in zip((measure.start, measure.end), measure.line, strict=True):
            drawing.line(DIMENSION, point, end)
        x, y = measure.middle
        beside = (x, y + 0.5 * _DIGITS + 1.0) if measure.angle == 0.0 else (x + _DIGITS, y)
        drawing.words(DIMENSION, measure.text, beside, _DIGITS)
    drawing.save(path)
