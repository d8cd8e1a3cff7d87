"""What plots are made of, as plotly's data: axes, points, lines, and words for a point.

Colours are variables of the page, so that they follow its light and dark. They are those of Okabe & Ito (2008) and
the scale is cividis (Nuñez et al. 2018), which colour-blind people tell apart; what differs in colour differs in shape
or dash too.
"""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.search.space import Choice
from fin_optimizer.study.candidate import improvements
from fin_optimizer.study.drawing import axis_label, axis_scale
from fin_optimizer.words import in_words, show_number, show_values, trial_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from fin_optimizer.goals import Measure
    from fin_optimizer.search.space import AnyDimension
    from fin_optimizer.study.candidate import Candidate, TrialRecord

    Figure = dict[str, Any]

SPEED = MEASURES[MEAN_SPEED]
BLUE, RED, GREEN, ORANGE, PURPLE = (f"var(--{name})" for name in ("blue", "red", "green", "orange", "purple"))
INK, QUIET = "var(--ink)", "var(--quiet)"
COLOURS = (BLUE, RED, GREEN, ORANGE, PURPLE)
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
MOST = 2000
"""Points that a plot shows at most; more are slow to open and one grey area on paper."""


def rounded(number: float | None, digits: int = 6) -> float | None:
    """Return a number with so many digits as JSON has it: None of one that is not finite."""
    if number is None or not math.isfinite(number):
        return None
    return float(f"{number:.{digits}g}")


def numbers(values: Iterable[float | None]) -> list[float | None]:
    """Return numbers as `rounded`."""
    return [rounded(value) for value in values]


def some_of(count: int, most: int = MOST) -> list[int]:
    """Return places of a list that are shown: all, or of many evenly chosen ones with the first and the last."""
    if count <= most:
        return list(range(count))
    return sorted(set(np.linspace(0, count - 1, most).astype(int).tolist()))


def figure(data: Sequence[Mapping[str, Any]], across: Mapping[str, Any], up: Mapping[str, Any], **more: Any) -> Figure:
    """Return a plot with two axes."""
    return {"data": list(data), "layout": {"xaxis": dict(across), "yaxis": dict(up), **more}}


def titled(text: str, **more: Any) -> dict[str, Any]:
    """Return an axis with its label."""
    return {"title": {"text": text}, **more}


def along(dimension: AnyDimension) -> dict[str, Any]:
    """Return a parameter's axis: label, range and scale, or the names of its choices."""
    if isinstance(dimension, Choice):
        shown = [html.escape(show_number(each, in_words(dimension.name)[1])) for each in dimension.choices]
        ticks = {"tickvals": list(range(dimension.count)), "ticktext": shown}
        return titled(axis_label(dimension), range=[dimension.low, dimension.high], **ticks)
    factor = axis_scale(dimension)
    low, high = dimension.minimum / factor, dimension.maximum / factor
    if dimension.log:
        margin = 0.02 * (math.log10(high) - math.log10(low))
        return titled(axis_label(dimension), type="log", range=[math.log10(low) - margin, math.log10(high) + margin])
    margin = 0.02 * (high - low)
    return titled(axis_label(dimension), range=[low - margin, high + margin])


def place(dimension: AnyDimension, value: Any) -> float | None:
    """Return where a value stands on a parameter's axis."""
    return rounded(dimension.number(value) / axis_scale(dimension))


def dots(x: Sequence[Any], y: Sequence[Any], name: str, text: Sequence[str] = (), **marker: Any) -> dict[str, Any]:
    """Return points with what is said of each."""
    trace: dict[str, Any] = {"type": "scatter", "mode": "markers", "x": list(x), "y": list(y), "name": name}
    trace["marker"] = {"size": 8, "line": {"width": 1, "color": "var(--paper)"}, **marker}
    if text:
        trace |= {"text": list(map(html.escape, text)), "hovertemplate": "%{text}<extra></extra>"}
    return trace


def line(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> dict[str, Any]:
    """Return a line."""
    style = {"color": colour, "width": 2, "dash": more.pop("dash", "solid"), "shape": more.pop("shape", "linear")}
    return {"type": "scatter", "mode": "lines", "x": list(x), "y": list(y), "name": name, "line": style, **more}


def ring(x: Any, y: Any, text: str) -> dict[str, Any]:
    """Return the mark around the best."""
    told = html.escape(text)
    marker = {"size": 16, "symbol": "circle-open", "color": RED, "line": {"width": 3, "color": RED}}
    trace = {"type": "scatter", "mode": "markers", "x": [x], "y": [y], "name": "the best", "marker": marker}
    return {**trace, "text": [told], "hovertemplate": "%{text}<extra></extra>"}


def value_of(goal: Measure, some: TrialRecord | Candidate) -> float | None:
    """Return a measure of a trial or a candidate in the unit of a laboratory; None of one without a score."""
    value = some.measured.get(goal.name)
    return None if value is None else rounded(value / goal.shown_in[1])


def say(goal: Measure, trial: TrialRecord) -> str:
    """Return a trial in words."""
    said = f"{trial_name(trial.number)}: {show_values(trial.values)}"
    return f"{said}, {goal.shown(trial.measured[goal.name])}" if trial.measured else f"{said}, {trial.outcome.value}"


def say_candidate(goal: Measure, candidate: Candidate) -> str:
    """Return a candidate in words."""
    score = f", {goal.shown(candidate.measured[goal.name])}" if candidate.measured else ""
    return f"fin {candidate.number + 1}: {show_values(candidate.values)}{score}"


def size_of(shown: Sequence[Any], few: int) -> int:
    """Return the size of a point: that of few, or half of it where there are many."""
    return few if len(shown) < 400 else few // 2  # noqa: PLR2004


def best_so_far(goal: Measure, scored: Iterable[TrialRecord], last: int) -> tuple[list[int], list[float | None]]:
    """Return where the best gets better and how good it is then, up to trial ``last``."""
    better = list(improvements(goal, scored))
    x, y = [trial.number for trial in better], [value_of(goal, trial) for trial in better]
    if x and x[-1] < last:
        x.append(last)
        y.append(y[-1])
    return x, y
