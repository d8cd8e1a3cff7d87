"""A layout as DXF in mm, for laser, plotter and CAM."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.cutting.layers import (
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

    from fin_optimizer.cutting.sheet import Layout

_COLOURS = {CUT: 1, SCORE: 5, DIMENSION: 3, TEXT: 7, SHEET: 8}
"""AutoCAD's numbers of red, blue, green, black and grey."""
_MILLIMETRES, _METRIC = 4, 1
_TEXT_HEIGHT = 2.5


def write_dxf(path: Path, layout: Layout) -> None:
    """Write the layout as DXF R2010, with the layers of `fin_optimizer.cutting.layers`.

    Raises:
        OSError: The file cannot be written.
    """
    from ezdxf import filemanagement  # noqa: PLC0415  (a third of a second, which only a drawing spends)
    from ezdxf.enums import TextEntityAlignment  # noqa: PLC0415

    document = filemanagement.new("R2010", setup=True)
    document.header["$INSUNITS"] = _MILLIMETRES
    document.header["$MEASUREMENT"] = _METRIC
    for name, colour in _COLOURS.items():
        document.layers.add(name, color=colour)
    space = document.modelspace()
    if len(layout.pieces) > 1:
        corners = [(0.0, 0.0), (layout.width, 0.0), (layout.width, layout.height), (0.0, layout.height)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": SHEET})
    for piece in layout.pieces:
        space.add_lwpolyline(outline(piece), close=True, dxfattribs={"layer": CUT})
        for hole in holes(piece):
            space.add_circle(hole, 0.5 * piece.blank.clamp.hole_diameter, dxfattribs={"layer": CUT})
        if line := root_line(piece):
            space.add_line(*line, dxfattribs={"layer": SCORE})
        for each in words(piece):
            text = space.add_text(each.text, height=each.height, dxfattribs={"layer": TEXT})
            text.set_placement(each.at, align=TextEntityAlignment.MIDDLE_CENTER)
    style = {"dimtxt": _TEXT_HEIGHT, "dimasz": _TEXT_HEIGHT, "dimlfac": 1.0, "dimscale": 1.0}
    for measure in measures(layout):
        space.add_linear_dim(
            base=measure.base,
            p1=measure.start,
            p2=measure.end,
            angle=measure.angle,
            text=measure.text,
            dimstyle="EZDXF",
            override=style,
            dxfattribs={"layer": DIMENSION},
        ).render()
    document.saveas(path)
