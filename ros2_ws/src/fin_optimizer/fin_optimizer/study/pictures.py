"""The pictures of a study, drawn from its settings, trials and fish alone: also later, and while it runs."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from fin_optimizer.gait_parameters import describe_gait, gait_from_parameters
from fin_optimizer.goals import LESS
from fin_optimizer.search.space import Choice
from fin_optimizer.study import drawing, space_drawing
from fin_optimizer.study.candidate import best_of, candidates, front
from fin_optimizer.study.file_names import FIGURE_FILE, FRONT_FILE, IMPORTANCE_FILE, PARALLEL_FILE, SLICES_FILE, of_goal
from fin_optimizer.study.importance import importances
from fin_optimizer.study.report import varied
from fin_optimizer.study.simulated_curve import TOLD, SimulatedFish, values_along
from fin_plant.figures import try_to_draw
from fin_plant.fin import AREA, Fin

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_optimizer.goals import Measure
    from fin_optimizer.search.space import Space
    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.settings import Settings
    from fin_optimizer.study.simulated_curve import SpeedCurve

_FREQUENCY, _AMPLITUDE = "gait.frequency", "gait.amplitude"
_DURATION = "measurement.duration"
_POINTS, _POINTS_ALONE = 25, 71
"""Of a slice, and of the curve over the only parameter; each is a swim."""


def draw_study(
    path: Path,
    settings: Settings,
    trials: Sequence[TrialRecord],
    fish: Mapping[str, object],
    goal: Measure | None = None,
) -> tuple[list[Path], list[str]]:
    """Draw speed over what was searched, and beside it what else tells something of the study.

    That is the Pareto front of the first two goals where there are several, and where several parameters were searched,
    for every goal, slices through the candidate that is best in it, parallel coordinates and, of enough candidates,
    which parameter decides.

    Args:
        path: Where to write the first picture, in the format that its name ends in.
        settings: Of the study.
        trials: All of them, one at least with a score.
        fish: What swam, as the journal has it; empty if it is not known.
        goal: The one goal to draw this for; all of the study's if left out.

    Returns:
        What was drawn, and why the rest could not be.
    """
    tried, goals = candidates(trials, settings.goals), settings.goals.measures
    wanted = {path: lambda: _draw_speed(path, settings, trials, fish)}
    if len(goals) > 1:
        there = _beside(path, FRONT_FILE)
        wanted[there] = lambda: drawing.draw_front(there, tried, front(tried), goals[:2], title=title(settings, tried))
    if len(settings.space.dimensions) > 1:
        for each in goals if goal is None else (goal,):
            wanted |= _of_several(path, settings, tried, fish, each)
    failures = {each: try_to_draw(each, draw) for each, draw in wanted.items()}
    return [each for each, why in failures.items() if not why], [why for why in failures.values() if why]


def _beside(path: Path, name: str) -> Path:
    """Return where another picture goes: beside the first, under a name that belongs to it."""
    if path.name != FIGURE_FILE:
        return path.with_stem(f"{path.stem}_{name.partition('.')[0]}")
    return path.with_name(name).with_suffix(path.suffix)


def _of_several(
    path: Path, settings: Settings, tried: Sequence[Candidate], fish: Mapping[str, object], goal: Measure
) -> dict[Path, Callable[[], None]]:
    """Return the pictures of a goal in a space of several parameters, each with what draws it."""
    arrays, heading, goals = as_arrays(settings, tried, goal), title(settings, tried), settings.goals.measures
    slices, parallel, importance = (
        _beside(path, name if goal == goals[0] else of_goal(name, goal.name))
        for name in (SLICES_FILE, PARALLEL_FILE, IMPORTANCE_FILE)
    )
    best = best_of(tried, goal)
    simulated = SimulatedFish.of(settings, fish)

    def draw_slices() -> None:
        curves = None
        if best is not None and simulated is not None and goal.name in TOLD:
            curves = slices_through(settings.space, best.values, goal, partial(simulated.told, goal.name))
        space_drawing.draw_slices(slices, arrays, simulated=curves, title=heading)

    wanted: dict[Path, Callable[[], None]] = {
        slices: draw_slices,
        parallel: lambda: space_drawing.draw_parallel(parallel, arrays, title=heading),
    }
    scored = [candidate for candidate in tried if candidate.measured]
    good = [goal.direction * candidate.measured[goal.name] for candidate in scored]
    shares = importances(settings.space, [c.values for c in scored], good)
    if shares:
        words = goal.words if len(goals) > 1 else ""
        wanted[importance] = lambda: space_drawing.draw_importance(
            importance, settings.space.dimensions, shares, len(scored), words
        )
    return wanted


def as_arrays(settings: Settings, tried: Sequence[Candidate], goal: Measure | None = None) -> space_drawing.Tried:
    """Return the candidates with a score as arrays: of a goal, the first if left out, in the unit of a laboratory."""
    goal = goal or settings.goals.measures[0]
    best = best_of(tried, goal)
    scored = [candidate for candidate in tried if candidate.measured]
    numbers = np.array([settings.space.row(candidate.values) for candidate in scored])
    found = np.array([candidate.measured[goal.name] for candidate in scored]) / goal.shown_in[1]
    chosen = None if best is None else scored.index(best)
    return space_drawing.Tried(settings.space.dimensions, numbers, found, goal.axis, goal.direction == LESS, chosen)


def slices_through(
    space: Space,
    best: Mapping[str, Any],
    goal: Measure,
    told: Callable[[Sequence[Mapping[str, Any]]], Sequence[float]],
    points: int = _POINTS,
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return of each parameter its values in SI, and a measure in a laboratory's unit, all else as a candidate has it.

    Args:
        space: What was searched.
        best: The candidate.
        goal: The measure.
        told: Returns it of candidates in SI, NaN where one cannot be.
        points: Of a range; a choice has all of its values.
    """
    curves = {}
    for dimension in space.dimensions:
        values = values_along(dimension, points)
        swum = np.array(told([{**best, dimension.name: value} for value in values])) / goal.shown_in[1]
        curves[dimension.name] = (np.array([dimension.number(value) for value in values]), swum)
    return curves


def _draw_speed(path: Path, settings: Settings, trials: Sequence[TrialRecord], fish: Mapping[str, object]) -> None:
    tried = candidates(trials, settings.goals)
    best, heading = best_of(tried), title(settings, tried)
    first, *others = settings.space.dimensions
    if others:
        drawing.draw_map(path, tried, best, (first, others[0]), title=heading)
        return
    simulated = _simulated(settings, fish)
    drawing.draw_speed(path, trials, best, first, simulated=simulated, title=heading)


def _simulated(settings: Settings, fish: Mapping[str, object]) -> SpeedCurve | None:
    """Return the simulator's speed over what was searched, None where the fish that swam cannot be computed."""
    (dimension,) = settings.space.dimensions
    if isinstance(dimension, Choice) or settings.rules is not None:
        return None
    computed = SimulatedFish.of(settings, fish)
    if computed is None:
        return None
    values = np.linspace(dimension.minimum, dimension.maximum, _POINTS_ALONE).tolist()
    return values, computed.speeds([{dimension.name: value} for value in values])


def title(settings: Settings, tried: Sequence[Candidate]) -> str:
    """Return a picture's heading: the fin as far as it stays, with its profile, and the gait."""
    details = cast("Mapping[str, float]", settings.details)
    lines = [_fin(settings, tried)]
    if {_FREQUENCY, _AMPLITUDE} <= details.keys():
        gait = describe_gait(gait_from_parameters(details))
        lines.append(f"{gait}; swims of {details[_DURATION]:g} s" if _DURATION in details else gait)
    return "\n".join(filter(None, lines))


def _fin(settings: Settings, tried: Sequence[Candidate]) -> str:
    """Return the fin in words, without what was searched; nothing if the settings do not tell it."""
    if tried and settings.rules is not None:
        varies = varied(settings, [candidate.values for candidate in tried])
        shown = Fin.from_parameters(settings.fin_of(tried[0].values)).describe(without=varies)
        return shown if shown != "fin " else ""
    if not tried or "fin.thickness" not in settings.details:
        return ""
    names = settings.space.names
    fin = settings.fin_of(tried[0].values)
    if "fin.length" not in names:
        return Fin.from_parameters(fin).describe(without=names)
    told = [f"{1000.0 * fin['fin.thickness']:.4g} mm thick"]
    area = cast("float", settings.details.get(AREA, 0.0))
    if area:
        told.insert(0, f"of {1e4 * area:.4g} cm²")
        heights = [fin["fin.height"], *fin["fin.profile_height"], fin["fin.tip_height"]]
        shape = [f"{height / heights[0]:.3g}" for height in heights]
        if len(set(shape)) > 1:
            told.append(f"heights from root to tip as {' : '.join(shape)}")
    return f"fin {', '.join(told)}"
