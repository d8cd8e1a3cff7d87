"""A layout as PDF at 1:1 on A4 or A3, to be printed and cut along, with a line of 100 mm to check the printer by."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.cutting.layers import COLOURS, CUT, DIMENSION, SCORE, SHEET, TEXT, holes, measures, outline, words
from fin_optimizer.cutting.layers import root_line as root_line_of
from fin_plant.figures import empty_figure, own_style

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from fin_optimizer.cutting.layers import Measure
    from fin_optimizer.cutting.sheet import Layout

PAPERS = {"A4": (210.0, 297.0), "A3": (297.0, 420.0)}
"""ISO 216, mm."""
MARGIN = 10.0
"""mm of the paper's edge that a printer may leave white."""
CONTROL = 100.0
"""mm"""
_FOOT = 16.0
"""mm at the page's foot for the control line and its words."""
_INCH = 25.4
_POINT = _INCH / 72.0
_HAIRLINE = 0.25


def paper_for(layout: Layout) -> tuple[str, float, float]:
    """Return name, width and height in mm of the smallest page that holds the layout and the control line.

    Raises:
        ValueError: It is larger than A3.
    """
    for name, (short, long) in PAPERS.items():
        for width, height in ((short, long), (long, short)):
            if layout.width <= width - 2.0 * MARGIN and layout.height <= height - 2.0 * MARGIN - _FOOT:
                return name, width, height
    msg = (
        f"a layout of {layout.width:g} x {layout.height:g} mm does not fit on a page of A3 at 1:1: write DXF or SVG, "
        "which have no page, or fewer fins"
    )
    raise ValueError(msg)


@own_style(pdf_fonttype=42)
def write_pdf(path: Path, layout: Layout) -> None:
    """Write the layout as PDF, one unit of its axes 1 mm of the page: print it at 100 %, not fitted to the page.

    Raises:
        OSError: The file cannot be written.
        ValueError: It is larger than A3.
    """
    name, width, height = paper_for(layout)
    figure = empty_figure(width / _INCH, height / _INCH)
    figure.set_layout_engine("none")
    figure.patch.set_visible(False)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    # The page's own corner is the origin; the layout stands in the middle above the foot.
    left = 0.5 * (width - layout.width)
    bottom = MARGIN + _FOOT + 0.5 * (height - 2.0 * MARGIN - _FOOT - layout.height)
    axes.set_xlim(-left, width - left)
    axes.set_ylim(-bottom, height - bottom)
    _pieces(axes, layout)
    for measure in measures(layout):
        _dimension(axes, measure)
    _control_line(axes, 0.5 * (width - CONTROL) - left, MARGIN + 8.0 - bottom, name)
    # bbox_inches="tight" would change the page, and with it the scale at which a printer fits it.
    figure.savefig(path, format="pdf", bbox_inches=None)


def _pieces(axes: Axes, layout: Layout) -> None:
    from matplotlib.patches import Circle, Polygon, Rectangle  # noqa: PLC0415  (half a second)

    if len(layout.pieces) > 1:
        axes.add_patch(
            Rectangle((0, 0), layout.width, layout.height, fill=False, edgecolor=COLOURS[SHEET], linewidth=_HAIRLINE)
        )
    for piece in layout.pieces:
        style = {"fill": False, "edgecolor": COLOURS[CUT], "linewidth": _HAIRLINE}
        axes.add_patch(Polygon(outline(piece), closed=True, **style))
        for hole in holes(piece):
            axes.add_patch(Circle(hole, 0.5 * piece.blank.clamp.hole_diameter, **style))
        if line := root_line_of(piece):
            axes.plot(*zip(*line, strict=True), color=COLOURS[SCORE], linewidth=_HAIRLINE)
        for each in words(piece):
            axes.text(
                *each.at,
                each.text,
                ha="center",
                va="center",
                fontsize=each.height / (0.72 * _POINT),
                color=COLOURS[TEXT],
            )


def _dimension(axes: Axes, measure: Measure) -> None:
    """Draw a dimension line with its two extension lines."""
    colour = COLOURS[DIMENSION]
    ends = measure.line
    axes.annotate(
        "",
        xy=ends[0],
        xytext=ends[1],
        arrowprops={"arrowstyle": "<|-|>", "color": colour, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0},
    )
    for point, end in zip((measure.start, measure.end), ends, strict=True):
        axes.plot((point[0], end[0]), (point[1], end[1]), color=colour, linewidth=_HAIRLINE)
    axes.text(
        *measure.middle,
        measure.text,
        ha="center",
        va="center",
        rotation=measure.angle,
        fontsize=8,
        color=colour,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
    )


def _control_line(axes: Axes, x: float, y: float, paper: str) -> None:
    axes.plot((x, x + CONTROL), (y, y), color="black", linewidth=0.5)
    for end in (x, x + CONTROL):
        axes.plot((end, end), (y - 2.0, y + 2.0), color="black", linewidth=0.5)
    axes.text(
        x + 0.5 * CONTROL,
        y - 3.0,
        f"{paper}, 1:1. Print at 100 %, not fitted to the page; this line must then measure {CONTROL:g} mm.",
        ha="center",
        va="top",
        fontsize=8,
    )
