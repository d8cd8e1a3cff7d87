"""What a campaign over a space leaves: one table of candidates, one of runs, the best in words, and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.goals import LESS
from fin_optimizer.search import names
from fin_optimizer.search.pareto import ranks
from fin_optimizer.study.file_names import FRONT_FILE, IMPORTANCE_FILE, PARALLEL_FILE, SLICES_FILE, of_goal
from fin_optimizer.study.importance import importances
from fin_optimizer.study.space_drawing import Tried, draw_importance, draw_parallel, draw_slices
from fin_optimizer.words import show_values
from fin_plant.checks import counted
from fin_plant.figures import empty_figure, own_style, try_to_draw
from fin_plant.fin import Fin, ProfiledFin
from fin_plant.whole_file import write_text, write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_optimizer.paper.space_campaign import SpaceCampaign, SpaceRun, Table

REPORT = "report.md"
_HISTORY, _OUTLINE = "history.png", "outline.png"
_MOST = 20_000
"""Candidates at most of which pictures are drawn: the best ones and others evenly chosen, for drawing keeps objects."""
_PART = 1000
"""Candidates of which the front of three and more goals is sought at a time: its cost grows as their square."""
_SHOWN = 8
"""Rows of the front in the report."""


def write(
    folder: Path, campaign: SpaceCampaign, results: Mapping[SpaceRun, Table], warn: Callable[[str], object]
) -> list[Path]:
    """Write tables, report and pictures; return their paths. A picture that cannot be drawn is warned of."""
    runs = sorted(results, key=lambda run: run.number)
    tables = [results[run] for run in runs]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in runs[0].columns}
    number = np.repeat([run.number for run in runs], [len(table["candidate"]) for table in tables])
    paths = [folder / name for name in ("candidates.npz", "runs.csv", REPORT)]
    write_whole(paths[0], lambda path: np.savez_compressed(path, allow_pickle=False, run=number, **columns))
    write_text(paths[1], _runs(campaign, runs, tables))
    write_text(paths[2], report(campaign, tables))
    for path, draw in _pictures(folder, campaign, tables, columns).items():
        if why := try_to_draw(path, draw):
            warn(why)
        else:
            paths.append(path)
    return paths


def objectives(campaign: SpaceCampaign, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return what is good, more being better, shape (goals, candidates).

    NaN of candidates that lack any of it or miss a constraint.
    """
    goals = campaign.wanted
    found = np.array(goals.objectives(table))
    bad = np.isnan(found).any(axis=0)
    for excess in goals.excesses(table):
        bad = bad | ~(excess <= 0.0)
    return np.where(bad, np.nan, found)


def best_place(campaign: SpaceCampaign, table: Mapping[str, NDArray[np.float64]]) -> int | None:
    """Return the place of the candidate that is best in the first goal; None if none has it."""
    first = objectives(campaign, table)[0]
    return int(np.nanargmax(first)) if np.isfinite(first).any() else None


def front_places(campaign: SpaceCampaign, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.intp]:
    """Return the places of the candidates than which none is better in all goals, the best in the first one first."""
    good = objectives(campaign, table)
    known = np.flatnonzero(np.isfinite(good[0]))
    if not len(known):
        return known
    order = known[np.argsort(-good[0, known], kind="stable")]
    if len(good) == 1:
        return order[:1]
    if len(good) == 2:  # noqa: PLR2004  (of millions few are above all that are better in the first goal)
        order = known[np.lexsort((-good[1, known], -good[0, known]))]
        rising = np.maximum.accumulate(good[1, order])
        order = order[np.concatenate(([True], good[1, order[1:]] > rising[:-1]))]
    else:
        order = order[fronts(good[:, order])]
    return np.asarray(order[ranks(-good[:, order].T) == 0])


def fronts(good: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which candidates, shape (goals, candidates), may be on the front: those of the fronts of small parts."""
    keep = np.zeros(good.shape[1], dtype=bool)
    for start in range(0, good.shape[1], _PART):
        part = good[:, start : start + _PART]
        keep[start : start + _PART] = ranks(-part.T) == 0
    return keep


def _values(campaign: SpaceCampaign, table: Mapping[str, NDArray[np.float64]], place: int) -> dict[str, object]:
    space = campaign.start.space
    return space.values(float(table[name][place]) for name in space.names)


def _runs(campaign: SpaceCampaign, runs: Sequence[SpaceRun], tables: Sequence[Table]) -> str:
    space, goals = campaign.start.space, campaign.wanted
    heads = [f"best_{goal.name}" for goal in goals.measures]
    lines = [",".join(["run", "seed", "swims", "without_score", *heads, *space.names])]
    for run, table in zip(runs, tables, strict=True):
        count, lacking = len(table["candidate"]), int(np.count_nonzero(np.isnan(objectives(campaign, table)[0])))
        place = best_place(campaign, table)
        own = ["" for _ in (*heads, *space.names)]
        if place is not None:
            own = [f"{table[goal.name][place]:.9g}" for goal in goals.measures]
            own += [_cell(value) for value in _values(campaign, table, place).values()]
        lines.append(",".join([str(run.number), str(run.seed), str(count), str(lacking), *own]))
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def report(campaign: SpaceCampaign, tables: Sequence[Table]) -> str:
    """Return the campaign's results in words, in Markdown."""
    goals = campaign.wanted
    count = sum(len(table["candidate"]) for table in tables)
    lacking = sum(int(np.count_nonzero(np.isnan(objectives(campaign, table)[0]))) for table in tables)
    runs, swims = counted(len(tables), "run"), len(tables[0]["candidate"])
    what = f"{campaign.algorithm}, {runs} of {swims} swims, seed {campaign.seed}"
    lack = "have no score or miss a constraint" if goals.constraints else "have no score"
    lines = [f"{what}; {lacking} of {count} swims {lack}.", ""]
    whole = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    place = best_place(campaign, whole)
    if place is None:
        return "\n".join([*lines, "No candidate has a score."]) + "\n"
    bests = [objectives(campaign, table) for table in tables]
    for number, goal in enumerate(goals.measures):
        each = goal.direction * np.array([np.nanmax(good[number]) for good in bests if np.isfinite(good[number]).any()])
        top = each.min() if goal.direction == LESS else each.max()
        spread = ""
        if len(each) > 1:
            mean, deviation = goal.shown(each.mean()), goal.shown(each.std(ddof=1))
            spread = f"; the runs' bests: mean {mean}, standard deviation {deviation}"
        lines.append(f"* best {goal.words}: {goal.shown(top)}{spread}")
    lines += ["", f"Best in {goals.measures[0].words}: {show_values(_values(campaign, whole, place))}", ""]
    if len(goals.measures) > 1:
        lines += _front_lines(campaign, whole)
    return "\n".join(lines) + "\n"


def _front_lines(campaign: SpaceCampaign, table: Mapping[str, NDArray[np.float64]]) -> list[str]:
    front = front_places(campaign, table)
    measures = campaign.wanted.measures
    lines = [f"Pareto front: {len(front)} candidates, of which", ""]
    lines += [f"| {' | '.join(each.words for each in measures)} | |", "|---" * (len(measures) + 1) + "|"]
    chosen = front[np.unique(np.linspace(0, len(front) - 1, min(_SHOWN, len(front))).astype(int))]
    for place in chosen:
        shown = " | ".join(each.shown(float(table[each.name][place])) for each in measures)
        lines.append(f"| {shown} | {show_values(_values(campaign, table, int(place)))} |")
    return [*lines, ""]


def _pictures(
    folder: Path, campaign: SpaceCampaign, tables: Sequence[Table], columns: Mapping[str, NDArray[np.float64]]
) -> dict[Path, Callable[[], None]]:
    good = objectives(campaign, columns)
    if not np.isfinite(good[0]).any():
        return {}
    space = campaign.start.space
    wanted: dict[Path, Callable[[], None]] = {}
    if len(good) > 1:
        wanted[folder / FRONT_FILE] = lambda: _draw_front(folder / FRONT_FILE, campaign, columns)
    wanted[folder / _HISTORY] = lambda: _draw_history(folder / _HISTORY, campaign, tables)
    if any(names.height_place(name) is not None for name in space.names):
        wanted[folder / _OUTLINE] = lambda: _draw_outline(folder / _OUTLINE, campaign, tables)
    if len(space.dimensions) > 1:
        for place in range(len(good)):
            wanted |= _of_goal(folder, campaign, columns, good[place], place)
    return wanted


def _of_goal(
    folder: Path,
    campaign: SpaceCampaign,
    columns: Mapping[str, NDArray[np.float64]],
    good: NDArray[np.float64],
    place: int,
) -> dict[Path, Callable[[], None]]:
    """Return what is drawn of each goal: of the one at ``place``, of which ``good`` is more the better."""
    space, goals = campaign.start.space, campaign.wanted.measures
    goal = goals[place]
    slices, parallel, importance = (
        folder / (of_goal(name, goal.name) if place else name) for name in (SLICES_FILE, PARALLEL_FILE, IMPORTANCE_FILE)
    )
    known = np.flatnonzero(np.isfinite(good))
    order = known[np.argsort(good[known], kind="stable")]
    chosen = np.sort(order[np.linspace(0, len(order) - 1, min(_MOST, len(order))).astype(int)])
    unit, factor = goal.shown_in
    numbers = np.column_stack([columns[name][chosen] for name in space.names])
    label = f"{goal.words} ({unit})" if unit else goal.words
    tried = Tried(space.dimensions, numbers, columns[goal.name][chosen] / factor, label, goal.direction == LESS)
    title = f"{campaign.algorithm}, {counted(campaign.runs, 'run')}"
    wanted: dict[Path, Callable[[], None]] = {
        slices: lambda: draw_slices(slices, tried, title=title),
        parallel: lambda: draw_parallel(parallel, tried, title=title),
    }
    values = [space.values(row) for row in numbers.tolist()]
    shares = importances(space, values, (goal.direction * tried.scores).tolist())
    if shares:
        words = goal.words if len(goals) > 1 else ""
        wanted[importance] = lambda: draw_importance(importance, space.dimensions, shares, len(chosen), words)
    return wanted


@own_style()
def _draw_front(path: Path, campaign: SpaceCampaign, columns: Mapping[str, NDArray[np.float64]]) -> None:
    figure = empty_figure(6.4, 4.6)
    axes = figure.add_subplot()
    across, up = campaign.wanted.measures[:2]
    known = np.flatnonzero(np.isfinite(objectives(campaign, columns)[0]))
    some = known[np.linspace(0, len(known) - 1, min(_MOST, len(known))).astype(int)]
    front = front_places(campaign, columns)

    def points(places: NDArray[np.intp]) -> list[NDArray[np.float64]]:
        return [columns[each.name][places] / each.shown_in[1] for each in (across, up)]

    axes.plot(*points(some), ".", color="0.7", markersize=2.0, label=f"{len(some)} of {len(known)} candidates")
    axes.plot(*points(front), "o-", color="tab:red", markersize=4.0, label=f"Pareto front ({len(front)})")
    low = [max(float(np.min(each)), 0.0) for each in points(front)]
    high = [float(np.max(each)) for each in points(front)]
    room = [0.6 * (most - least) + 0.05 * most for least, most in zip(low, high, strict=True)]
    axes.set(
        xlabel=f"{across.words} ({across.shown_in[0]})",
        ylabel=f"{up.words} ({up.shown_in[0]})",
        xlim=(low[0] - room[0], high[0] + 0.3 * room[0]),
        ylim=(low[1] - room[1], high[1] + 0.3 * room[1]),
        title=f"{campaign.algorithm}: front of all runs",
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path)


@own_style()
def _draw_outline(path: Path, campaign: SpaceCampaign, tables: Sequence[Table]) -> None:
    """Draw the best fin of each run as it is seen from the side, the fastest of all filled."""
    figure = empty_figure(6.4, 3.0)
    axes = figure.add_subplot()
    goal, start = campaign.wanted.measures[0], campaign.start
    places = [(table, best_place(campaign, table)) for table in tables]
    found = [(table, place) for table, place in places if place is not None]
    first = max(found, key=lambda each: objectives(campaign, each[0])[0, each[1]])
    for table, place in found:
        fin = Fin.from_parameters(start.rules.sent(start.start, _values(campaign, table, place)))
        inner = fin.profile_position if isinstance(fin, ProfiledFin) else ()
        at = 100.0 * fin.length * np.array([0.0, *inner, 1.0])
        half = 50.0 * np.array(fin.heights)
        if table is first[0]:
            label = f"the best: {goal.shown(float(table[goal.name][place]))}, {1e3 * fin.thickness:.3g} mm thick"
            axes.fill_between(at, -half, half, color="tab:blue", alpha=0.25, lw=0)
            axes.plot([*at, *at[::-1]], [*half, *-half[::-1]], color="tab:blue", label=label)
        else:
            axes.plot([*at, *at[::-1]], [*half, *-half[::-1]], color="0.6", lw=0.8)
    axes.set(xlabel="behind the fin's root (cm)", ylabel="height (cm)", aspect="equal")
    axes.set_title(f"{campaign.algorithm}: best fins of {counted(len(found), 'run')}")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="center")
    figure.savefig(path)


@own_style()
def _draw_history(path: Path, campaign: SpaceCampaign, tables: Sequence[Table]) -> None:
    figure = empty_figure(6.4, 4.2)
    axes = figure.add_subplot()
    goal = campaign.wanted.measures[0]
    swims = min(len(table["candidate"]) for table in tables)
    so_far = np.array([np.fmax.accumulate(objectives(campaign, table)[0, :swims]) for table in tables])
    so_far *= goal.direction / goal.shown_in[1]
    at = np.unique(np.geomspace(1, swims, 200).astype(int))
    shown = so_far[:, at - 1]
    axes.plot(at, np.median(shown, axis=0), color="tab:blue", label=f"median of {counted(len(tables), 'run')}")
    axes.fill_between(at, shown.min(axis=0), shown.max(axis=0), color="tab:blue", alpha=0.15, lw=0, label="all of them")
    axes.set(xscale="log", xlabel="swims", ylabel=f"best so far: {goal.words} ({goal.shown_in[0]})")
    axes.set_title(f"{campaign.algorithm}: how the best was found")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path)
