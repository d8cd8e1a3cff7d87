"""The paper's figures 4 to 7 from a campaign's runs."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.paper.comparison import (
    CENTI,
    CLARK,
    FOUND,
    GIGA,
    OPTIMA,
    best,
    bests,
    markdown,
    of_experiment,
    published_curves,
)
from fin_optimizer.paper.experiments import EXPERIMENTS, LENGTH, MODULUS, speeds
from fin_optimizer.study.file_names import IMPORTANCE_FILE, PARALLEL_FILE, SLICES_FILE
from fin_optimizer.study.importance import importances
from fin_optimizer.study.space_drawing import Tried, draw_importance, draw_parallel
from fin_optimizer.study.space_drawing import draw_slices as draw_slices_of
from fin_plant.figures import empty_figure, own_style, try_to_draw
from fin_sim.validation import measured_fins

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fin_optimizer.paper.experiments import Campaign, Run, Table

_OURS, _THEIRS, _OTHER, _GREY = "#0b6aa2", "#c8553d", "#3a7d44", "#8a8a8a"
_MANY = 50
"""Points from which on they are drawn small."""
_OF_SEVERAL = ("shape", "cma")
"""Experiments on several parameters."""
_SEARCHED = {MODULUS: "young_modulus", LENGTH: "length"}
_SLICE = 71
"""Points of a curve through the best fin."""
_MOST = 20_000
"""Fins at most of which the importance is drawn: evenly chosen, for Optuna keeps an object a fin."""


def _axes(title: str, *, width: float = 6.4) -> tuple[Figure, Axes]:
    figure = empty_figure(width, 4.2)
    axes = figure.add_subplot()
    axes.set(xlabel="Young's modulus in GPa", ylabel="mean speed in cm/s", title=title)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure, axes


def _draw_speed(axes: Axes, table: Table, label: str, colour: str) -> None:
    axes.plot(table["young_modulus"] * GIGA, table["speed"] * CENTI, color=colour, label=label)
    peak = best(table)
    axes.plot(peak["young_modulus"] * GIGA, peak["speed"] * CENTI, "o", color=colour)


def _draw_published(axes: Axes, name: str, label: str) -> None:
    points = published_curves()[name]
    few = len(points.speed) < _MANY
    marker, size = ("s", 6) if few else (".", 3)
    axes.plot(
        points.modulus * GIGA,
        points.speed * CENTI,
        marker,
        ms=size,
        color=_THEIRS,
        mfc="none" if few else _THEIRS,
        label=label,
    )


def _figure_4(results: Mapping[Run, Table]) -> Figure:
    figure, axes = _axes("Mathematical model: speed over stiffness (figure 4)")
    _draw_published(axes, "model", "Clark et al. 2012, model")
    _draw_speed(axes, of_experiment(results, "model")[0], "ours, preset clark2012_model", _OURS)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)
    return figure


def _figure_5(results: Mapping[Run, Table]) -> Figure:
    figure = empty_figure(9.6, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    landscape = of_experiment(results, "simulation")[0]
    for axes, experiment, title in zip(
        panels, ("hill_climber", "genetic"), ("hill climber", "genetic algorithm"), strict=True
    ):
        tables, found = of_experiment(results, experiment), bests(results, experiment)
        low, high = min(t["young_modulus"].min() for t in tables), max(t["young_modulus"].max() for t in tables)
        axes.axvspan(low * GIGA, high * GIGA, color=_OURS, alpha=0.06, label="range tried")
        _draw_published(axes, "figure 5", "Clark et al. 2012, simulation")
        axes.plot(
            landscape["young_modulus"] * GIGA,
            landscape["speed"] * CENTI,
            color=_OURS,
            label="ours, preset clark2012_simulation",
        )
        for whose, modulus in FOUND[experiment].items():
            style = ":" if whose == CLARK else "--"
            axes.axvline(modulus * GIGA, color=_GREY, ls=style, lw=1, label=f"{whose}: E found")
        starts = np.array([[t["young_modulus"][0], t["speed"][0]] for t in tables])
        if experiment == "hill_climber":
            axes.plot(starts[:, 0] * GIGA, starts[:, 1] * CENTI, ".", color=_OTHER, label="start of each of our runs")
        axes.plot(
            found["young_modulus"] * GIGA,
            found["speed"] * CENTI,
            "o",
            color="black",
            mfc="none",
            label="best of each of our runs",
        )
        axes.set(title=f"{title}, {len(tables)} runs (figure 5)", xlabel="Young's modulus in GPa", ylim=(0.0, None))
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=8)
    panels[0].set_ylabel("mean speed in cm/s")
    return figure


def _figure_6(results: Mapping[Run, Table]) -> Figure:
    """Measured fins of 1 mm over hinge stiffness; over E the papers' fins of 0.30 mm are elsewhere."""
    del results  # what was measured does not depend on the campaign
    figure = empty_figure(8.4, 4.6)
    axes = figure.add_subplot()
    fins = measured_fins.printed_fins()
    measured_fins.draw_over_stiffness(axes, fins, measured_fins.readings(fins, 2))
    axes.set_title("Measured fins beside model and simulation, over hinge stiffness (figure 6)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure


def _draw_landscape(axes: Axes, results: Mapping[Run, Table]) -> None:
    table = of_experiment(results, "landscape")[0]
    shape = (len(np.unique(table["length"])), -1)
    modulus, length, speed = (table[name].reshape(shape) for name in ("young_modulus", "length", "speed"))
    levels = axes.contourf(modulus * GIGA, length * CENTI, speed * CENTI, levels=20, cmap="viridis")
    axes.figure.colorbar(levels, ax=axes, label="mean speed in cm/s")
    found = bests(results, "shape")
    axes.plot(
        found["young_modulus"] * GIGA,
        found["length"] * CENTI,
        "o",
        color="white",
        mec="black",
        label="our best of each run",
        clip_on=False,
    )
    optimum = OPTIMA[1][0] * GIGA, OPTIMA[1][1] * CENTI
    axes.plot(*optimum, "*", color=_THEIRS, mec="white", ms=13, label="the papers' optimum", clip_on=False)
    axes.set(
        xlabel="Young's modulus in GPa",
        ylabel="fin length in cm",
    )
    axes.set_title("Stiffness and shape at constant area (figure 7)", pad=12)
    axes.legend(loc="lower right", fontsize=8)


def _draw_histories(axes: Axes, results: Mapping[Run, Table]) -> None:
    """Draw the best speed so far over the number of swims: mean of the runs, and from the least to the largest."""
    done = {run.experiment for run in results}
    for experiment, colour, label in (
        ("hill_climber", _OTHER, "hill climber on E"),
        ("genetic", _OURS, "genetic algorithm on E"),
        ("shape", _THEIRS, "genetic algorithm on E and shape"),
        ("cma", "black", "CMA-ES on E and shape"),
    ):
        if experiment not in done:
            continue
        tables = of_experiment(results, experiment)
        swims = min(len(table["speed"]) for table in tables)
        so_far = CENTI * np.array([np.fmax.accumulate(table["speed"][:swims]) for table in tables])
        at = np.unique(np.geomspace(1, swims, 200).astype(int))
        shown = so_far[:, at - 1]
        axes.plot(at, np.mean(shown, axis=0), color=colour, label=f"{label}, {len(tables)} runs")
        axes.fill_between(at, shown.min(axis=0), shown.max(axis=0), color=colour, alpha=0.15, lw=0)
    axes.set(
        xscale="log", xlabel="swims", ylabel="best speed so far in cm/s", title="Histories: mean and range of runs"
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _figure_7(results: Mapping[Run, Table]) -> Figure:
    figure = empty_figure(11.4, 4.6)
    left, right = figure.subplots(1, 2)
    _draw_landscape(left, results)
    _draw_histories(right, results)
    return figure


def _of_several(folder: Path, experiment: str, results: Mapping[Run, Table]) -> dict[Path, Callable[[], None]]:
    """Return the pictures of an experiment on E and length, all its runs in one, each with what draws it."""
    run = next(run for run in results if run.experiment == experiment)
    space, tables = run.campaign.shape(), of_experiment(results, experiment)
    columns = {
        name: np.concatenate([t[column] for t in tables]) for name, column in (*_SEARCHED.items(), ("speed", "speed"))
    }
    known = np.isfinite(columns["speed"])
    if not known.any():
        return {}
    numbers = np.column_stack([columns[name][known] for name in space.names])
    tried = Tried(space.dimensions, numbers, columns["speed"][known] * CENTI)
    best = space.values(numbers[tried.best])

    def draw_slices(path: Path) -> None:
        curves = {}
        for dimension in space.ranges:
            values = np.linspace(dimension.minimum, dimension.maximum, _SLICE)
            fins = {name: np.full(_SLICE, value) for name, value in best.items()} | {dimension.name: values}
            curves[dimension.name] = (values, speeds(fins, run.preset) * CENTI)
        draw_slices_of(path, tried, simulated=curves, title=title)

    title = f"{EXPERIMENTS[experiment].title}: {len(numbers)} fins of {len(tables)} runs"
    some = slice(None, None, -(-len(numbers) // _MOST))
    told = [space.values(row) for row in numbers[some]]
    shares = importances(space, told, tried.scores[some].tolist())
    draw: dict[str, Callable[[Path], None]] = {
        SLICES_FILE: draw_slices,
        PARALLEL_FILE: lambda path: draw_parallel(path, tried, title=title),
    }
    if shares:
        draw[IMPORTANCE_FILE] = lambda path: draw_importance(path, space.dimensions, shares, len(told))
    paths = {folder / f"{experiment}_{name}": each for name, each in draw.items()}
    return {path: partial(each, path) for path, each in paths.items()}


def _save(draw: Callable[[Mapping[Run, Table]], Figure], results: Mapping[Run, Table], path: Path) -> None:
    draw(results).savefig(path)


def write(
    folder: Path, campaign: Campaign, results: Mapping[Run, Table], warn: Callable[[str], object] = print
) -> list[Path]:
    """Write paper.md and those figures whose experiments were carried out; return their paths.

    A figure that fails is told to ``warn`` and left out.
    """
    needs: Sequence[tuple[int, set[str]]] = (
        (4, {"model"}),
        (5, {"simulation", "hill_climber", "genetic"}),
        (6, {"model", "simulation"}),
        (7, {"landscape", "shape"}),
    )
    draw = {4: _figure_4, 5: _figure_5, 6: _figure_6, 7: _figure_7}
    done = {run.experiment for run in results}
    paths = [folder / "paper.md"]
    paths[0].write_text(markdown(campaign, results), encoding="utf-8")
    with own_style(font_size=9):
        for number, experiments in needs:
            if experiments <= done:
                path = folder / f"paper_figure_{number}.png"
                if failure := try_to_draw(path, partial(_save, draw[number], results, path)):
                    warn(failure)
                else:
                    paths.append(path)
    for experiment in _OF_SEVERAL:
        wanted = _of_several(folder, experiment, results) if experiment in done else {}
        for path, draw_it in wanted.items():
            if failure := try_to_draw(path, draw_it):
                warn(failure)
            else:
                paths.append(path)
    return paths
