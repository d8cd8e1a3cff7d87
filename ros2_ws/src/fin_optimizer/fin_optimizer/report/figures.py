"""Plots as plotly's data. Colours are variables of the page, so that they follow its light and dark.

Colours are those of Okabe & Ito (2008) and the scale is cividis (Nuñez et al. 2018), which colour-blind people tell
apart; what differs in colour differs in shape or dash too.
"""

from __future__ import annotations

import html
import math
import statistics
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.goals import LESS, MEAN_SPEED, MEASURES
from fin_optimizer.search.space import Choice
from fin_optimizer.study.drawing import axis_label, axis_scale
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import in_words, show_number, show_values, trial_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from fin_optimizer.goals import Goals, Measure
    from fin_optimizer.report.simulated import Curve, Map
    from fin_optimizer.search.space import AnyDimension, Space
    from fin_optimizer.study.candidate import Candidate, TrialRecord

    Figure = dict[str, Any]

SPEED = MEASURES[MEAN_SPEED]
BLUE, RED, GREEN, ORANGE, PURPLE = (f"var(--{name})" for name in ("blue", "red", "green", "orange", "purple"))
INK, QUIET = "var(--ink)", "var(--quiet)"
COLOURS = (BLUE, RED, GREEN, ORANGE, PURPLE)
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
_OUTCOME_SYMBOLS = {Outcome.FAILED: "x-thin", Outcome.INTERRUPTED: "cross-thin", Outcome.INFEASIBLE: "line-ns"}
MOST = 2000
"""Points that a plot shows at most; more are slow to open and one grey area on paper."""
LINES = 240
"""Candidates that parallel coordinates show at most."""
_SHADES = tuple(f"var(--shade{number})" for number in range(8))
"""Of cividis, from slow to fast, which stands out."""


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


# -- plots of a study ------------------------------------------------------------------------------------------------


def progress(goals: Goals, trials: Sequence[TrialRecord], best: Candidate | None) -> Figure:
    """Return what is looked for over the number of the trial, the best so far, and below what has no score."""
    goal = goals.measures[0]
    scored = [trial for trial in trials if trial.measured]
    shown = [scored[index] for index in some_of(len(scored))]
    data = [
        dots(
            [trial.number for trial in shown],
            [value_of(goal, trial) for trial in shown],
            f"trials ({len(scored)})" if len(shown) == len(scored) else f"{len(shown)} of {len(scored)} trials",
            [say(goal, trial) for trial in shown],
            color=BLUE,
            size=_size(shown, 8),
        )
    ]
    x, y = _best_so_far(goal, [trial for trial in scored if not goals.missed(trial.measured)], trials[-1].number)
    data.append(line(x, y, "best so far", INK, shape="hv", hoverinfo="skip"))
    for outcome, symbol in _OUTCOME_SYMBOLS.items():
        without = [trial for trial in trials if trial.outcome is outcome]
        if without:
            few = [without[index] for index in some_of(len(without), 500)]
            marks = dots(
                [trial.number for trial in few],
                [0.02] * len(few),
                f"{outcome.value} ({len(without)})",
                [f"{say(goal, trial)}: {trial.reason}" for trial in few],
                symbol=symbol,
                size=9,
                line={"width": 2, "color": ORANGE},
            )
            data.append({**marks, "yaxis": "y2"})
    if best is not None:
        first = next(trial for trial in best.trials if trial.measured)
        data.append(ring(first.number, value_of(goal, first), say_candidate(goal, best)))
    second = {"overlaying": "y", "range": [0, 1], "visible": False, "fixedrange": True}
    return figure(data, titled("trial"), titled(goal.axis), yaxis2=second)


def _size(shown: Sequence[Any], few: int) -> int:
    """Return the size of a point: that of few, or half of it where there are many."""
    return few if len(shown) < 400 else few // 2  # noqa: PLR2004


def _best_so_far(goal: Measure, scored: Sequence[TrialRecord], last: int) -> tuple[list[int], list[float | None]]:
    """Return where the best gets better and how good it is then, up to trial ``last``."""
    x: list[int] = []
    y: list[float | None] = []
    best = -math.inf
    for trial in scored:
        good = goal.direction * trial.measured[goal.name]
        if good > best:
            best = good
            x.append(trial.number)
            y.append(value_of(goal, trial))
    if x and x[-1] < last:
        x.append(last)
        y.append(y[-1])
    return x, y


def over(
    goal: Measure, dimension: AnyDimension, scored: Sequence[Candidate], best: Candidate, curve: Curve | None
) -> Figure:
    """Return the score over one parameter, with the simulator's curve through the best behind it."""
    data = []
    if curve is not None:
        x = [place(dimension, value) for value in curve.values]
        y = numbers(each / goal.shown_in[1] for each in curve.found)
        name = "simulator, all else as the best has it"
        hover = f"%{{y:.4g}} {goal.shown_in[0]}<extra>simulator</extra>"
        if isinstance(dimension, Choice):
            edge = {"width": 2, "color": QUIET}
            hollow = dots(x, y, name, symbol="square-open", size=12, color=QUIET, line=edge)
            data.append({**hollow, "hovertemplate": hover})
        else:
            data.append(line(x, y, name, QUIET, hovertemplate=hover))
    shown = [scored[index] for index in some_of(len(scored))]
    data.append(
        dots(
            [place(dimension, c.values[dimension.name]) for c in shown],
            [value_of(goal, c) for c in shown],
            f"fins ({len(scored)})" if len(shown) == len(scored) else f"{len(shown)} of {len(scored)} fins",
            [say_candidate(goal, c) for c in shown],
            size=_size(shown, 8),
            color=[c.number for c in shown],
            colorscale="Cividis",
            line={"width": 1, "color": QUIET},
        )
    )
    at = place(dimension, best.values[dimension.name])
    data.append(ring(at, value_of(goal, best), say_candidate(goal, best)))
    return figure(data, along(dimension), titled(goal.axis))


def chart(goal: Measure, space: Space, scored: Sequence[Candidate], best: Candidate, simulated: Map | None) -> Figure:
    """Return the first two parameters as axes, with the score as colour, and the simulator's map behind them."""
    first, second = space.dimensions[:2]
    data: list[dict[str, Any]] = []
    factor = goal.shown_in[1]
    swum = [c.measured[goal.name] / factor for c in scored]
    known = [each / factor for row in simulated.found for each in row if math.isfinite(each)] if simulated else []
    scale = {"colorscale": "Cividis", "cmin": rounded(min(swum + known)), "cmax": rounded(max(swum + known))}
    scale["reversescale"] = goal.direction == LESS
    if simulated is not None:
        data.append(
            {
                "type": "contour",
                "x": [place(first, value) for value in simulated.across],
                "y": [place(second, value) for value in simulated.up],
                "z": [numbers(each / factor for each in row) for row in simulated.found],
                "colorscale": "Cividis",
                "reversescale": scale["reversescale"],
                "zmin": scale["cmin"],
                "zmax": scale["cmax"],
                "ncontours": 16,
                "showscale": False,
                "line": {"width": 0.5, "color": "var(--paper)"},
                "hovertemplate": f"%{{z:.4g}} {goal.shown_in[0]}<extra>simulator</extra>",
            }
        )
    shown = [scored[index] for index in some_of(len(scored))]
    data.append(
        dots(
            [place(first, c.values[first.name]) for c in shown],
            [place(second, c.values[second.name]) for c in shown],
            "fins",
            [say_candidate(goal, c) for c in shown],
            size=_size(shown, 11),
            line={"width": 1.5, "color": "white"},
            color=[value_of(goal, c) for c in shown],
            colorbar={"title": {"text": goal.shown_in[0]}, "thickness": 14, "outlinewidth": 0},
            **scale,
        )
    )
    data.append(
        ring(place(first, best.values[first.name]), place(second, best.values[second.name]), say_candidate(goal, best))
    )
    return figure(data, along(first), along(second), showlegend=False)


def parallel(goal: Measure, space: Space, scored: Sequence[Candidate], best: Candidate) -> Figure:
    """Return each candidate as a line over one axis a parameter and one for what is looked for, the best on top."""
    ranked = sorted(scored, key=lambda c: goal.direction * c.measured[goal.name])
    chosen = [ranked[index] for index in some_of(len(ranked), LINES)]
    factor = goal.shown_in[1]
    ends = sorted(ranked[place].measured[goal.name] / factor for place in (0, -1))
    across = list(range(len(space.dimensions) + 1))
    data: list[dict[str, Any]] = []
    for shade, colour in enumerate(_SHADES):
        x: list[float | None] = []
        y: list[float | None] = []
        for candidate in chosen:
            share = _share(goal, candidate, ends)
            good = share if goal.direction != LESS else 1.0 - share
            if candidate is not best and min(int(good * len(_SHADES)), len(_SHADES) - 1) == shade:
                x += [*across, None]
                y += [*_heights(space, candidate, share), None]
        if x:
            data.append(line(x, y, "", colour, hoverinfo="skip", showlegend=False, opacity=0.75))
            data[-1]["line"]["width"] = 1.3
    data.append(line(across, _heights(space, best, _share(goal, best, ends)), "the best", RED, hoverinfo="skip"))
    data[-1]["line"]["width"] = 4
    labels = [axis_label(dimension).replace(" (", "<br>(") for dimension in space.dimensions]
    notes = [note for index, dimension in enumerate(space.dimensions) for note in _ends(index, dimension)]
    notes += [_note(across[-1], height, f"{end:.4g}") for height, end in zip((-0.05, 1.05), ends, strict=True)]
    shapes = [
        {"type": "line", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": {"color": QUIET, "width": 1}} for x in across
    ]
    last = f"{goal.words}<br>({goal.shown_in[0]})"
    axis = {"tickvals": across, "ticktext": [*labels, last], "showgrid": False, "zeroline": False}
    axis |= {"range": [-0.3, across[-1] + 0.3], "fixedrange": True}
    up = {"visible": False, "range": [-0.12, 1.12], "fixedrange": True}
    return figure(data, axis, up, annotations=notes, shapes=shapes)


def _share(goal: Measure, candidate: Candidate, ends: Sequence[float]) -> float:
    low, high = ends
    return (candidate.measured[goal.name] / goal.shown_in[1] - low) / (high - low) if high > low else 0.5


def _heights(space: Space, candidate: Candidate, share: float) -> list[float | None]:
    row = np.array([space.row(candidate.values)])
    low, high = space.bounds
    return numbers([*((space.coordinates(row)[0] - low) / (high - low)).tolist(), share])


def _ends(index: int, dimension: AnyDimension) -> list[dict[str, Any]]:
    if isinstance(dimension, Choice):
        factor, span = in_words(dimension.name)[1], dimension.high - dimension.low
        heights = [(place - dimension.low) / span for place in range(dimension.count)]
        names = [show_number(each, factor) for each in dimension.choices]
        return [_note(index, height, name) for height, name in zip(heights, names, strict=True)]
    factor = axis_scale(dimension)
    ends = ((-0.05, dimension.minimum), (1.05, dimension.last))
    return [_note(index, height, f"{value / factor:.4g}") for height, value in ends]


def _note(x: float, y: float, text: str) -> dict[str, Any]:
    look = {"showarrow": False, "font": {"size": 11}, "bgcolor": "var(--paper)"}
    return {"x": x, "y": y, "text": html.escape(text), **look}


def repeats(goal: Measure, some: Sequence[Candidate]) -> Figure:
    """Return the swims of candidates one by one, with their mean and its standard deviation, the best first."""
    x = [f"fin {candidate.number + 1}" for candidate in some]
    swims = [(name, trial) for name, c in zip(x, some, strict=True) for trial in c.trials if trial.measured]
    data = [
        dots(
            [name for name, _ in swims],
            [value_of(goal, trial) for _, trial in swims],
            "swims",
            [say(goal, trial) for _, trial in swims],
            color=BLUE,
            symbol="circle-open",
            line={"width": 2, "color": BLUE},
        )
    ]
    told = [say_candidate(goal, c) for c in some]
    means = dots(x, [value_of(goal, c) for c in some], "mean and standard deviation", told)
    means["marker"] = {"symbol": "line-ew", "size": 18, "line": {"width": 3, "color": RED}}
    spread = numbers(spread_of(goal, c) / goal.shown_in[1] for c in some)
    means["error_y"] = {"type": "data", "array": spread, "color": RED, "thickness": 1.5, "width": 5}
    return figure([*data, means], {"type": "category"}, titled(goal.axis))


def spread_of(goal: Measure, candidate: Candidate) -> float:
    """Return the standard deviation of a measure between the swims of a candidate, in SI; 0 of one swim."""
    known = [trial.measured[goal.name] for trial in candidate.trials if trial.measured]
    return statistics.stdev(known) if len(known) > 1 else 0.0


def front(tried: Sequence[Candidate], chosen: Sequence[Candidate], goals: Sequence[Measure]) -> Figure:
    """Return two measures of every candidate, those of the Pareto front joined."""
    known = [c for c in tried if c.measured]
    known = [known[index] for index in some_of(len(known))]

    def shown(candidates: Sequence[Candidate], goal: Measure) -> list[float | None]:
        return numbers(candidate.measured[goal.name] / goal.shown_in[1] for candidate in candidates)

    def say(candidate: Candidate) -> str:
        return ", ".join(
            [
                f"fin {candidate.number + 1}: {show_values(candidate.values)}",
                *(goal.told(candidate.measured[goal.name]) for goal in goals),
            ]
        )

    first, second = goals
    points = dots(
        shown(known, first), shown(known, second), f"fins ({len(known)})", list(map(say, known)), color=QUIET, size=6
    )
    ends = line(
        shown(chosen, first),
        shown(chosen, second),
        f"Pareto front ({len(chosen)})",
        RED,
        text=[html.escape(say(candidate)) for candidate in chosen],
        hovertemplate="%{text}<extra></extra>",
        mode="lines+markers",
    )
    ends["marker"] = {"size": 9, "symbol": "diamond"}
    return figure([points, ends], titled(first.axis), titled(second.axis))


def importance(shares: Mapping[str, float]) -> Figure:
    """Return the share of each parameter as a bar, the largest on top."""
    names = list(shares)[::-1]
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": [rounded(100.0 * shares[name]) for name in names],
        "y": [html.escape(in_words(name)[0]) for name in names],
        "text": [f"{100.0 * shares[name]:.0f} %" for name in names],
        "textposition": "outside",
        "cliponaxis": False,
        "marker": {"color": BLUE},
        "hoverinfo": "skip",
    }
    most = 115.0 * max(shares.values())
    return figure([bars], titled("share (%)", range=[0, most]), {"automargin": True})


def against(measure: Measure, pairs: Sequence[tuple[Candidate, float, float]]) -> Figure:
    """Return measured over simulated, with the line on which both are equal."""
    unit, factor = measure.shown_in
    x = numbers(simulated / factor for _, simulated, _ in pairs)
    y = numbers(measured / factor for _, _, measured in pairs)
    ends = [min(v for v in x + y if v is not None), max(v for v in x + y if v is not None)]
    points = dots(x, y, "fins", [say_candidate(measure, candidate) for candidate, _, _ in pairs], color=BLUE)
    spread = numbers(spread_of(measure, c) / factor for c, _, _ in pairs)
    points["error_y"] = {"type": "data", "array": spread, "color": BLUE, "thickness": 1}
    equal = line(ends, ends, "equal", QUIET, dash="dash", hoverinfo="skip")
    across, up = (titled(f"{measure.words}, {how} ({unit})") for how in ("simulated", "measured"))
    return figure([equal, points], across, up)


# -- several studies, and runs of a campaign ---------------------------------------------------------------------------


def _look(index: int) -> tuple[str, str, str]:
    """Return colour, symbol and dash of one of several, which repeat after many."""
    return COLOURS[index % len(COLOURS)], SYMBOLS[index % len(SYMBOLS)], DASHES[index // len(COLOURS) % len(DASHES)]


def progress_of_several(studies: Sequence[tuple[str, Sequence[TrialRecord]]]) -> Figure:
    """Return the best so far of each study over the number of the trial."""
    data = []
    for index, (name, trials) in enumerate(studies):
        colour, symbol, dash = _look(index)
        x, y = _best_so_far(SPEED, [trial for trial in trials if trial.measured], trials[-1].number)
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
