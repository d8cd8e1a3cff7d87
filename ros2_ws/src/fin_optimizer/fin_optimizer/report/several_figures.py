"""The plots of several studies and of a campaign's runs, as plotly's data."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

from fin_optimizer.report.marks import (
    COLOURS,
    DASHES,
    SPEED,
    SYMBOLS,
    best_so_far,
    dots,
    figure,
    line,
    numbers,
    place,
    say_candidate,
    some_of,
    titled,
    value_of,
)
from fin_optimizer.search.space import Choice
from fin_optimizer.study.drawing import axis_label
from fin_optimizer.words import in_words, show_number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.report.marks import Figure
    from fin_optimizer.search.space import Space
    from fin_optimizer.study.candidate import Candidate, TrialRecord


def _look(index: int) -> tuple[str, str, str]:
    """Return colour, symbol and dash of one of several, which repeat after many."""
    return COLOURS[index % len(COLOURS)], SYMBOLS[index % len(SYMBOLS)], DASHES[index // len(COLOURS) % len(DASHES)]


def progress_of_several(studies: Sequence[tuple[str, Sequence[TrialRecord]]]) -> Figure:
    """Return the best so far of each study over the number of the trial."""
    data = []
    for index, (name, trials) in enumerate(studies):
        colour, symbol, dash = _look(index)
        x, y = best_so_far(SPEED, [trial for trial in trials if trial.measured], trials[-1].number)
        steps = line(x, y, html.escape(name), colour, shape="hv", dash=dash, mode="lines+markers")
        data.append({**steps, "marker": {"symbol": symbol, "size": 7}})
    return figure(data, titled("trial"), titled(SPEED.axis))


def spread_of_several(studies: Sequence[tuple[str, Sequence[Candidate]]]) -> Figure:
    """Return how the speeds of each study's fins are spread, as boxes with the fins beside them."""
    data = []
    for index, (name, scored) in enumerate(studies):
        shown = [scored[place] for place in some_of(len(scored))]
        box = {"type": "box", "name": html.escape(name), "y": [value_of(SPEED, c) for c in shown]}
        points = {"boxpoints": "all", "jitter": 0.5, "pointpos": -1.6, "marker": {"size": 4, "color": _look(index)[0]}}
        told = {
            "text": [html.escape(say_candidate(SPEED, c)) for c in shown],
            "hovertemplate": "%{text}<extra></extra>",
        }
        data.append({**box, **points, **told, "hoveron": "points", "showlegend": False})
    return figure(data, {"type": "category"}, titled(SPEED.axis))


def over_of_several(parameter: str, studies: Sequence[tuple[int, str, Space, Sequence[Candidate]]]) -> Figure:
    """Return the speed over a parameter that several studies have searched, each with its place among all of them."""
    data = []
    axis = None
    for index, name, space, scored in studies:
        dimension = space.dimensions[space.names.index(parameter)]
        colour, symbol, _ = _look(index)
        shown = [scored[at] for at in some_of(len(scored))]
        values = [candidate.values[parameter] for candidate in shown]
        x: list[Any] = [place(dimension, value) for value in values]
        if isinstance(dimension, Choice):  # other studies may have other choices
            x = [html.escape(show_number(value, in_words(parameter)[1])) for value in values]
            axis = titled(axis_label(dimension), type="category")
        elif axis is None:
            axis = titled(axis_label(dimension), type="log" if dimension.log else "linear")
        told = [f"{name}, {say_candidate(SPEED, candidate)}" for candidate in shown]
        y = [value_of(SPEED, candidate) for candidate in shown]
        data.append(dots(x, y, html.escape(name), told, color=colour, symbol=symbol))
    return figure(data, axis or {}, titled(SPEED.axis))


def ranges(curves: Sequence[tuple[str, list[int], list[float], list[float], list[float]]]) -> Figure:
    """Return lines over a logarithmic number, each with its band: name, numbers, middle, least and largest."""
    data: list[dict[str, Any]] = []
    for index, (name, at, middle, least, most) in enumerate(curves):
        colour, _, dash = _look(index)
        edge = {"hoverinfo": "skip", "showlegend": False, "opacity": 0.5}
        for values in (least, most):
            data.append(line(at, numbers(values), "", colour, dash="dot", **edge))
            data[-1]["line"]["width"] = 1
        data.append(line(at, numbers(middle), html.escape(name), colour, dash=dash))
    return figure(data, titled("swims", type="log"), titled("best speed so far (cm/s)"))


def curves_and_points(
    curves: Sequence[tuple[str, Any, Any]], points: Sequence[tuple[str, Any, Any]], across: str
) -> Figure:
    """Return curves and points of speeds in cm/s over one parameter."""
    data = []
    for index, (name, x, y) in enumerate(curves):
        data.append(line(numbers(x.tolist()), numbers(y.tolist()), html.escape(name), _look(index)[0]))
    for index, (name, x, y) in enumerate(points, start=len(curves)):
        colour, symbol, _ = _look(index)
        data.append(dots(numbers(x.tolist()), numbers(y.tolist()), html.escape(name), color=colour, symbol=symbol))
    return figure(data, titled(across), titled(SPEED.axis))


def map_and_points(
    behind: tuple[Any, Any, Any] | None, points: Sequence[tuple[str, Any, Any]], across: str, up: str
) -> Figure:
    """Return a map of speeds in cm/s, given as values across, values up and a row a value up, with points on it."""
    data: list[dict[str, Any]] = []
    if behind is not None:
        x, y, speeds = behind
        contour = {"type": "contour", "x": numbers(x.tolist()), "y": numbers(y.tolist())}
        look = {"colorscale": "Cividis", "ncontours": 18, "line": {"width": 0.5, "color": "var(--paper)"}}
        bar = {"title": {"text": "cm/s"}, "thickness": 14, "outlinewidth": 0}
        told = {"hovertemplate": "%{z:.4g} cm/s<extra>simulator</extra>"}
        data.append({**contour, **look, **told, "z": [numbers(row) for row in speeds.tolist()], "colorbar": bar})
    for index, (name, x, y) in enumerate(points):
        symbol = SYMBOLS[index]
        edge = {"width": 1.5, "color": "black"}
        data.append(
            dots(numbers(x.tolist()), numbers(y.tolist()), name, symbol=symbol, size=11, color="white", line=edge)
        )
    return figure(data, titled(across), titled(up))


def spread_of_runs(some: Sequence[tuple[str, Any]]) -> Figure:
    """Return the speeds in cm/s of several runs as boxes with a point a run."""
    data = []
    for index, (name, speeds) in enumerate(some):
        look = {"boxpoints": "all", "jitter": 0.5, "pointpos": -1.6, "marker": {"size": 5, "color": _look(index)[0]}}
        box = {"type": "box", "name": name, "y": numbers(speeds.tolist()), "showlegend": False}
        data.append({**box, **look, "hovertemplate": "%{y:.4g} cm/s<extra></extra>"})
    return figure(data, {"type": "category"}, titled("best speed of a run (cm/s)"))
