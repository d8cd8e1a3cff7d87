"""Measured against predicted, swim by swim: forward speed, heading and path."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.figures import new_figure, own_style

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from fin_optimizer.calibration.prediction import Prediction
    from fin_optimizer.calibration.swims import Swim

_MEASURED, _PREDICTED = "#7b8794", "#d64545"
_PANELS, _SWIMS_A_ROW = 3, 2
_PANEL = (2.6, 1.75)  # inches


@own_style(font_size=7)
def draw_page(
    path: Path, swims: Sequence[Swim], predictions: Sequence[Prediction], given: float, *, fitted: bool = False
) -> None:
    """Draw the page into a file.

    Args:
        path: Of the file.
        swims: Recorded.
        predictions: Of each of them.
        given: What each prediction was given, s; a line marks its end.
        fitted: Whether the fish was fitted to these very swims, which is no prediction.
    """
    how = "fitted to these swims, started" if fitted else "predicted"
    rows = math.ceil(len(swims) / _SWIMS_A_ROW)
    columns = _SWIMS_A_ROW * _PANELS
    figure, axes = new_figure(columns * _PANEL[0], rows * _PANEL[1] + 0.4, rows, columns)
    for index, (swim, predicted) in enumerate(zip(swims, predictions, strict=True)):
        row, place = divmod(index, _SWIMS_A_ROW)
        speed, heading, way = axes[row, _PANELS * place : _PANELS * (place + 1)]
        for values, colour, label in (
            (swim, _MEASURED, "measured"),
            (predicted, _PREDICTED, f"{how} from the first {given:g} s"),
        ):
            speed.plot(swim.time, 100.0 * values.forward, color=colour, lw=0.9, label=label)
            heading.plot(swim.time, np.degrees(values.heading), color=colour, lw=0.9)
            if swim.position is not None and values.position is not None:
                way.plot(100.0 * values.position[:, 0], 100.0 * values.position[:, 1], color=colour, lw=0.9)
        name = f"{math.degrees(swim.amplitude):.3g} deg, bias {math.degrees(swim.bias):+.3g} deg"
        speed.set_title(name, loc="left", fontsize=7.5)
        speed.set(ylabel="forward, cm/s")
        heading.set(ylabel="heading, deg")
        way.set(ylabel="y over x, cm")
        way.axis("equal")
        for panel in (speed, heading):
            panel.axvline(given, color="#9aa5b1", lw=0.6, ls=":")
        if index + _SWIMS_A_ROW >= len(swims):  # the lowest of its column
            speed.set_xlabel("time, s")
            heading.set_xlabel("time, s")
    for panel in axes.flat[len(swims) * _PANELS :]:
        panel.set_axis_off()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    figure.savefig(path, dpi=110)
