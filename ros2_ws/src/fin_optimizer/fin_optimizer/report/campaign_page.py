"""The page of a campaign: the paper's experiments, all their runs together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.paper import comparison
from fin_optimizer.paper.experiments import DURATION, EXPERIMENTS, shaped
from fin_optimizer.report import several_figures
from fin_optimizer.report.film import film_of
from fin_optimizer.report.parts import Cell, Column, Facts, Film, Page, Plot, Section, Table
from fin_optimizer.report.simulated import numbers_of
from fin_optimizer.report.study_page import listed
from fin_optimizer.words import CM, show_speed
from fin_plant.checks import counted
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_sim.swim import swim

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.paper.experiments import Campaign, Run
    from fin_optimizer.paper.experiments import Table as RunTable

    Results = Mapping[Run, RunTable]

_SEARCHES = ("hill_climber", "genetic", "shape", "cma")
_OF_TWO = ("shape", "cma")
_GIGA, _CENTI = 1e9, 1e-2
_ROWS = 400
"""Runs that the table holds at most."""


def campaign_page(name: str, campaign: Campaign, results: Results, versions: Mapping[str, str]) -> Page:
    """Return the page of a campaign.

    Args:
        name: What it is called: its folder's name.
        campaign: Its sizes and its seed.
        results: Its finished runs.
        versions: Of what writes the page; a campaign keeps none.
    """
    done = [experiment for experiment in EXPERIMENTS if any(run.experiment == experiment for run in results)]
    swims = sum(len(table["speed"]) for table in results.values())
    seen = [("experiments", f"{len(done)} of {len(EXPERIMENTS)}"), ("runs", str(len(results))), ("swims", str(swims))]
    fastest = {e: comparison.best(t) for e in done if e in _SEARCHES for t in [_joined(results, e)] if _any(t)}
    seen += [(EXPERIMENTS[e].title, show_speed(best["speed"])) for e, best in fastest.items()]
    sections = [
        _progress(results, done),
        _over_stiffness(results, done),
        _landscape(results, done),
        _repeats(results, done),
        _best_fin(results, fastest),
        _beside_the_paper(results),
        _runs(results),
        _without_speed(results),
        Section(
            "settings",
            "Parameters, versions, seed",
            [f"Seed {campaign.seed}. A campaign keeps no versions; these are of the program that wrote this page."],
            [listed(_settings(campaign), "Campaign"), listed(versions, "Versions")],
        ),
    ]
    return Page(
        title=f"Campaign {name}",
        lead=[f"{counted(len(results), 'run')} of {counted(len(done), 'experiment')} with {counted(swims, 'swim')}."],
        facts=Facts(seen, "large"),
        sections=[section for section in sections if section is not None],
    )


def _settings(campaign: Campaign) -> dict[str, object]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in vars(campaign).items()}


def _any(table: RunTable) -> bool:
    return bool(np.isfinite(table["speed"]).any())


def _joined(results: Results, experiment: str) -> RunTable:
    """Return all candidates of an experiment's runs in one table."""
    tables = comparison.of_experiment(results, experiment)
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def _progress(results: Results, done: Sequence[str]) -> Section | None:
    curves = []
    for experiment in done:
        if experiment in _SEARCHES:
            tables = comparison.of_experiment(results, experiment)
            count = min(len(table["speed"]) for table in tables)
            so_far = np.array([np.fmax.accumulate(table["speed"][:count]) for table in tables]) / CM
            at = np.unique(np.geomspace(1, count, 120).astype(int))
            shown = so_far[:, at - 1]
            ends = (np.nanmean(shown, axis=0), np.nanmin(shown, axis=0), np.nanmax(shown, axis=0))
            title = f"{EXPERIMENTS[experiment].title} ({counted(len(tables), 'run')})"
            curves.append((title, at.tolist(), *(end.tolist() for end in ends)))
    if not curves:
        return None
    says = "The best speed so far over the number of swims: mean of the runs, and from the least to the largest."
    return Section("progress", "Progress of the searches", (), [Plot(several_figures.ranges(curves), says, 420)])


def _over_stiffness(results: Results, done: Sequence[str]) -> Section | None:
    curves, found = [], []
    for experiment in ("model", "simulation", "stated_fin"):
        if experiment in done:
            table = comparison.of_experiment(results, experiment)[0]
            curves.append((EXPERIMENTS[experiment].title, table["young_modulus"] / _GIGA, table["speed"] / CM))
    for experiment in ("hill_climber", "genetic"):
        if experiment in done:
            best = comparison.bests(results, experiment)
            found.append((f"best of each run, {experiment}", best["young_modulus"] / _GIGA, best["speed"] / CM))
    if not curves and not found:
        return None
    plot = several_figures.curves_and_points(curves, found, "Young's modulus E (GPa)")
    says = "Speed over Young's modulus: the landscape as lines, and what the searches found as marks."
    return Section("searched", "Speed over Young's modulus", (), [Plot(plot, says, 420)])


def _landscape(results: Results, done: Sequence[str]) -> Section | None:
    if not set(done) & {"landscape", *_OF_TWO}:
        return None
    behind = None
    if "landscape" in done:
        table = comparison.of_experiment(results, "landscape")[0]
        up, across = np.unique(table["length"]), np.unique(table["young_modulus"])
        speeds = table["speed"].reshape(len(up), len(across)) / CM
        behind = (across / _GIGA, up / _CENTI, speeds)
    found = []
    for experiment in _OF_TWO:
        if experiment in done:
            best = comparison.bests(results, experiment)
            found.append((f"best of each run, {experiment}", best["young_modulus"] / _GIGA, best["length"] / _CENTI))
    plot = several_figures.map_and_points(behind, found, "Young's modulus E (GPa)", "length (cm)")
    says = "Stiffness and shape at constant area" + ("; behind the bests the simulator's speed." if behind else ".")
    return Section("shape", "Stiffness and shape", (), [Plot(plot, says, 480)])


def _repeats(results: Results, done: Sequence[str]) -> Section | None:
    searches = [experiment for experiment in done if experiment in _SEARCHES]
    some = [(experiment, comparison.bests(results, experiment)["speed"] / CM) for experiment in searches]
    if not some:
        return None
    rows = []
    for experiment, speeds in some:
        spread = float(np.std(speeds, ddof=1)) if len(speeds) > 1 else math.nan
        rows.append(
            [
                Cell(EXPERIMENTS[experiment].title),
                Cell(str(len(speeds)), len(speeds)),
                Cell(f"{np.mean(speeds):.4g}", float(np.mean(speeds))),
                Cell("" if math.isnan(spread) else f"{spread:.2g}", None if math.isnan(spread) else spread),
                Cell(f"{np.max(speeds):.4g}", float(np.max(speeds))),
            ]
        )
    columns = [
        Column("experiment", is_number=False),
        Column("runs"),
        Column("best of a run, mean", "cm/s"),
        Column("standard deviation", "cm/s"),
        Column("largest", "cm/s"),
    ]
    plot = Plot(several_figures.spread_of_runs(some), "The best speed of each run.")
    return Section("repeats", "How far runs differ", (), [plot, Table(columns, rows)])


def _best_fin(results: Results, fastest: Mapping[str, Mapping[str, float]]) -> Section | None:
    if not fastest:
        return None
    experiment, best = max(fastest.items(), key=lambda item: item[1]["speed"])
    given = next(run for run in results if run.experiment == experiment).preset
    values = {"fin.young_modulus": np.array([best["young_modulus"]]), "fin.length": np.array([best["length"]])}
    changed: dict[str, Any] = {name: float(column[0]) for name, column in shaped(values, given).items()}
    fin = Fin(**{**vars(given.fin), **changed})
    swum = swim(fin, given.fish, PAPER_GAIT, DURATION, reactive=given.reactive)
    body = given.fish.body
    film = Film(film_of(swum, (2.0 * body.tail_offset, 0.6 * body.tail_offset)), "The best fin's swim from above.")
    preset = EXPERIMENTS[experiment].preset
    said = f"Of {EXPERIMENTS[experiment].title}: {fin.describe()}, on the fish of the preset {preset}."
    return Section("best", "The best fin", [said], [film, Facts(numbers_of(swum, 0.0))])


def _beside_the_paper(results: Results) -> Section | None:
    rows = comparison.rows(results)
    if not rows:
        return None
    columns = [
        Column(name, is_number=False)
        for name in ("quantity", "Raja Mohamed & Raviraj", "Clark et al. 2012", "ours", "remark")
    ]
    cells = [[Cell(text) for text in (row.quantity, row.paper, row.clark, row.ours, row.remark)] for row in rows]
    return Section("paper", "Beside the paper", (), [Table(columns, cells)])


def _runs(results: Results) -> Section:
    ordered = sorted(results, key=lambda run: (list(EXPERIMENTS).index(run.experiment), run.number))
    rows = []
    for run in ordered[:_ROWS]:
        best = comparison.best(results[run]) if _any(results[run]) else None
        count = len(results[run]["speed"])
        row = [Cell(run.experiment), Cell(str(run.number), run.number), Cell(str(run.seed)), Cell(str(count), count)]
        for name, factor in (("speed", CM), ("young_modulus", _GIGA), ("length", _CENTI), ("height", _CENTI)):
            row.append(Cell("" if best is None else f"{best[name] / factor:.4g}", None if best is None else best[name]))
        rows.append(row)
    columns = [Column("experiment", is_number=False), Column("run"), Column("seed", is_minor=True), Column("swims")]
    columns += [Column("best", "cm/s"), Column("E", "GPa"), Column("length", "cm"), Column("height", "cm")]
    note = f"The first {_ROWS} of {len(ordered)} runs; all stand in runs.csv." if len(ordered) > _ROWS else ""
    return Section("runs", "Runs", (), [Table(columns, rows, note)])


def _without_speed(results: Results) -> Section:
    lost = {run: int(np.count_nonzero(~np.isfinite(table["speed"]))) for run, table in results.items()}
    some = {run: count for run, count in lost.items() if count}
    if not some:
        return Section("refused", "Refused and failed", ["Every fin has a speed: nothing was refused."])
    columns = [Column("experiment", is_number=False), Column("run"), Column("fins without a speed")]
    rows = [[Cell(run.experiment), Cell(str(run.number), run.number), Cell(str(n), n)] for run, n in some.items()]
    said = "A fin has no speed if no fin can be so, or its swim does not settle at any time step."
    note = f"The first {_ROWS} of {len(rows)} such runs." if len(rows) > _ROWS else ""
    return Section("refused", "Refused and failed", [said], [Table(columns, rows[:_ROWS], note)])
