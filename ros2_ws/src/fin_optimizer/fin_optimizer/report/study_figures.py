"""The plots of one study, as plotly's data."""

from __future__ import annotations

import html
import math
import statistics
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.goals import LESS
from fin_optimizer.report.marks import (
    BLUE,
    INK,
    ORANGE,
    QUIET,
    RED,
    along,
    best_so_far,
    dots,
    figure,
    line,
    numbers,
    place,
    ring,
    rounded,
    say,
    say_candidate,
    size_of,
    some_of,
    titled,
    value_of,
)
from fin_optimizer.search.space import Choice
from fin_optimizer.study.drawing import axis_label, axis_scale
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import in_words, show_number, show_values

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.goals import Goals, Measure
    from fin_optimizer.report.marks import Figure
    from fin_optimizer.report.simulated import Curve, Map
    from fin_optimizer.search.space import AnyDimension, Space
    from fin_optimizer.study.candidate import Candidate, TrialRecord

_OUTCOME_SYMBOLS = {Outcome.FAILED: "x-thin", Outcome.INTERRUPTED: "cross-thin", Outcome.INFEASIBLE: "line-ns"}
LINES = 240
"""Candidates that parallel coordinates show at most."""
_SHADES = tuple(f"var(--shade{number})" for number in range(8))
"""Of cividis, from slow to fast, which stands out."""


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
            size=size_of(shown, 8),
        )
    ]
    x, y = best_so_far(goal, [trial for trial in scored if not goals.missed(trial.measured)], trials[-1].number)
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
            size=size_of(shown, 8),
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
            size=size_of(shown, 11),
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
