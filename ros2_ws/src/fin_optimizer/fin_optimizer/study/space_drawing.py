"""How a space of several parameters is drawn: parallel coordinates, slices through the best, importance.

All is drawn from arrays alone, so a study and a campaign have the same pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.space import Choice
from fin_optimizer.study.drawing import axis_label, axis_scale, dress, save_whole
from fin_optimizer.words import in_words, show_number
from fin_plant.figures import empty_figure, own_style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection
    from numpy.typing import NDArray

    from fin_optimizer.search.space import AnyDimension

    Array = NDArray[np.float64]
    Curves = Mapping[str, tuple[Array, Array]]

_LINES = 400
"""Candidates that parallel coordinates show at most, more would be one grey area, and slices as large points."""
_COLUMNS = 3
"""Slices side by side."""
_BEST = "tab:red"


@dataclass(frozen=True)
class Tried:
    """Candidates with a score, as arrays.

    Attributes:
        dimensions: What was searched, two parameters or more.
        numbers: Shape (candidates, parameters), in SI, of a choice its place; see `Space.row`.
        scores: Shape (candidates,), finite, in the unit of ``label``; more is better unless ``least``.
        label: What the score is, with its unit.
        least: Whether less is better.
        chosen: Place of the best one, where that is not simply the one with the best score: constraints count too.
    """

    dimensions: tuple[AnyDimension, ...]
    numbers: Array
    scores: Array
    label: str = "mean forward speed (cm/s)"
    least: bool = False
    chosen: int | None = None

    @property
    def order(self) -> NDArray[np.intp]:
        """Places of the candidates, the worst first."""
        return np.argsort(-self.scores if self.least else self.scores, kind="stable")

    @property
    def best(self) -> int:
        """Place of the best one, of equals the first."""
        if self.chosen is not None:
            return self.chosen
        return int(np.argmin(self.scores) if self.least else np.argmax(self.scores))

    def shown(self, place: int) -> Array:
        """Return the numbers of a parameter in the unit of its axis."""
        return self.numbers[:, place] / axis_scale(self.dimensions[place])


@own_style()
def draw_parallel(path: Path, tried: Tried, *, title: str = "") -> None:
    """Draw each candidate as a line over one axis a parameter, its score as the last axis and as colour.

    Args:
        path: Where to write the picture; an older one is replaced.
        tried: The candidates; of many `_LINES` of all ranks are drawn, the best among them, and the picture says so.
        title: Heading.
    """
    from matplotlib.collections import LineCollection  # noqa: PLC0415  (loaded by `own_style` by now)

    figure = empty_figure(max(8.0, 1.5 * (len(tried.dimensions) + 1)), 5.0)
    axes = figure.add_subplot()
    lines = np.column_stack([_shares(tried, place) for place in range(len(tried.dimensions))])
    low, high = float(tried.scores.min()), float(tried.scores.max())
    span = high - low or 1.0
    lines = np.column_stack([lines, (tried.scores - low) / span if high > low else np.full(len(lines), 0.5)])
    count = len(tried.scores)
    chosen = tried.order[np.linspace(0, count - 1, min(count, _LINES)).astype(int)]
    across = np.arange(lines.shape[1], dtype=float)
    segments = [np.column_stack([across, lines[i]]) for i in chosen]
    drawn = LineCollection(segments, cmap="viridis", linewidths=1.1, alpha=0.75, zorder=2)
    drawn.set_array(tried.scores[chosen])
    drawn.set_clim(low, high if high > low else low + span)
    axes.add_collection(drawn)
    axes.plot(across, lines[tried.best], color=_BEST, linewidth=2.4, zorder=3, label="the best")
    for place, dimension in enumerate(tried.dimensions):
        _upright(axes, place, dimension)
    _ends(axes, len(tried.dimensions), f"{low:.4g}", f"{high:.4g}" if high > low else "")
    axes.set_xticks(across, [*(_broken(axis_label(d)) for d in tried.dimensions), _broken(tried.label)])
    axes.set(xlim=(-0.35, across[-1] + 0.35), ylim=(-0.1, 1.1), yticks=[])
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    said = f"{len(chosen)} of {count}, evenly from the worst to the best" if len(chosen) < count else f"{count}"
    axes.set_title("\n".join(filter(None, [title, f"candidates with a score: {said}"])), fontsize="medium")
    figure.legend(frameon=False, loc="outside lower right")
    save_whole(figure, path)


def _draw_tried(axes: Axes, tried: Tried, place: int) -> PathCollection:
    """Draw the score of each candidate over the parameter at this place, and a ring around the best."""
    many = len(tried.scores) > _LINES
    shown, best = tried.shown(place), tried.best
    axes.plot(
        shown[best],
        tried.scores[best],
        "o",
        markersize=12.0,
        markerfacecolor="none",
        markeredgecolor=_BEST,
        markeredgewidth=1.8,
        linestyle="none",
        label="the best" if place == 0 else None,
        clip_on=False,
        zorder=3,
    )
    return axes.scatter(
        shown,
        tried.scores,
        c=np.arange(len(tried.scores)),
        cmap="viridis",
        s=6.0 if many else 22.0,
        edgecolors="none" if many else "white",
        linewidths=0.4,
        rasterized=many,
        zorder=2,
    )


@own_style()
def draw_slices(path: Path, tried: Tried, *, simulated: Curves | None = None, title: str = "") -> None:
    """Draw the score over each parameter, and through the best the simulator's curve where it is known.

    Args:
        path: Where to write the picture; an older one is replaced.
        tried: The candidates; where the curve is missing, their scatter alone.
        simulated: Of each parameter the values in SI and the scores with all others as the best has them; NaN where a
            candidate cannot be.
        title: Heading.
    """
    count = len(tried.dimensions)
    columns = 2 if count == 4 else min(_COLUMNS, count)  # noqa: PLR2004  (two rows of two leave no gap)
    rows = -(-count // columns)
    figure = empty_figure(max(8.0, 3.6 * columns), 1.2 + 3.0 * rows)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    points = None
    for place, (axes, dimension) in enumerate(zip(panels.flat, tried.dimensions, strict=False)):
        axes.grid(visible=True, color="0.92")
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        if simulated is not None and dimension.name in simulated:
            values, scores = simulated[dimension.name]
            kind = "s" if isinstance(dimension, Choice) else "-"
            axes.plot(values / axis_scale(dimension), scores, kind, color="0.6", linewidth=2.0, zorder=1)
        points = _draw_tried(axes, tried, place)
        dress(axes, "x", dimension)
    for axes in list(panels.flat)[count:]:
        axes.set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel(tried.label)
    if points is not None and len(tried.scores) > 1:
        figure.colorbar(points, ax=panels, label="in the order tried", pad=0.02, ticks=[])
    if simulated:
        first = panels.flat[0]
        first.plot([], [], "-", color="0.6", linewidth=2.0, label="simulator, all else as the best has it")
    figure.suptitle(title, fontsize="medium")
    figure.legend(frameon=False, loc="outside lower center", ncols=2)
    save_whole(figure, path)


@own_style()
def draw_importance(
    path: Path, dimensions: Sequence[AnyDimension], shares: Mapping[str, float], count: int, goal: str = ""
) -> None:
    """Draw which share each parameter has in what tells the best tenth of the candidates from all.

    Args:
        path: Where to write the picture; an older one is replaced.
        dimensions: What was searched.
        shares: Of `importances`, the largest first.
        count: Candidates that they are drawn from.
        goal: In what they are the best, in words, where there are several goals.
    """
    figure = empty_figure(8.0, 1.6 + 0.42 * len(shares))
    axes = figure.add_subplot()
    words = {dimension.name: in_words(dimension.name)[0] for dimension in dimensions}
    places = np.arange(len(shares))[::-1]
    bars = axes.barh(places, list(shares.values()), color="tab:blue", height=0.62)
    axes.bar_label(bars, [f"{100.0 * share:.0f} %" for share in shares.values()], padding=4)
    axes.set_yticks(places, [words[name] for name in shares])
    axes.set(xlim=(0.0, 1.08 * max(shares.values())), xticks=[])
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    what = f"Which parameter decides {goal}" if goal else "Which parameter decides"
    axes.set_title(f"{what}: the best tenth of {count} candidates beside all (PED-ANOVA)", fontsize="medium")
    save_whole(figure, path)


def _shares(tried: Tried, place: int) -> Array:
    """Return where candidates lie on an axis from 0 to 1; choices and steps keep their distance from its ends."""
    dimension = tried.dimensions[place]
    column = dimension.coordinates(tried.numbers[:, place])
    return np.asarray((column - dimension.low) / (dimension.high - dimension.low))


def _upright(axes: Axes, place: int, dimension: AnyDimension) -> None:
    """Draw a parameter's axis with its ends, or its choices."""
    if isinstance(dimension, Choice):
        axes.axvline(place, color="0.3", linewidth=0.8, zorder=1)
        factor = in_words(dimension.name)[1]
        for index, choice in enumerate(dimension.choices):
            height = (index - dimension.low) / (dimension.high - dimension.low)
            _tell(axes, place, height, show_number(choice, factor), "center")
        return
    factor = axis_scale(dimension)
    _ends(axes, place, f"{dimension.minimum / factor:.4g}", f"{dimension.last / factor:.4g}")


def _ends(axes: Axes, place: int, low: str, high: str) -> None:
    axes.axvline(place, 0.1 / 1.2, 1.1 / 1.2, color="0.3", linewidth=0.8, zorder=1)
    _tell(axes, place, -0.02, low, "top")
    _tell(axes, place, 1.02, high, "bottom")


def _tell(axes: Axes, place: int, height: float, text: str, align: str) -> None:
    halo = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8}
    axes.text(place, height, text, ha="center", va=align, fontsize="small", bbox=halo, zorder=4)


def _broken(label: str) -> str:
    """Return an axis's label over two lines, the unit below."""
    return label.replace(" (", "\n(")
