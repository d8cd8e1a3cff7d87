"""The paper's figures 4 to 7 from a campaign's runs, and every number that the papers state with ours beside it."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fin_sim
from fin_optimizer.paper.experiments import SIMULATION
from fin_plant.figures import empty_figure, own_style, try_to_draw
from fin_sim.presets import preset
from fin_sim.validation import measured_fins

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from fin_optimizer.paper.experiments import Campaign, Run, Table

CENTI, GIGA = 1e2, 1e-9
_OURS, _THEIRS, _OTHER, _GREY = "#0b6aa2", "#c8553d", "#3a7d44", "#8a8a8a"


# What the papers state, Raja Mohamed & Raviraj and then Clark et al. 2012: speed in m/s and Young's modulus in Pa.
_MODEL = ((0.048, 0.7e9), (0.051, 0.9e9))
_SIMULATION = ((0.012, 0.9e9), (0.014, 1.9e9))
_PROTOTYPE = 0.037
_OPTIMA = ((1.9e9, 0.08), (7.55e9, 0.14))
"""Young's modulus and length in m of the two fins that evolved."""
_HINGES = (1.35e-3, 1.73e-3)
"""Their hinge stiffness in N m."""
_STATED_THICKNESS = 1e-3
_AT_THE_PEAK = 0.01
"""A run that ends within this share of the highest speed known has found the peak."""


def best(table: Table) -> dict[str, float]:
    """Return the row of the fastest candidate; NaN where nothing swam."""
    speed = table["speed"]
    index = int(np.nanargmax(speed)) if np.isfinite(speed).any() else 0
    return {name: float(column[index]) for name, column in table.items()}


def _of(results: Mapping[Run, Table], experiment: str) -> list[Table]:
    runs = sorted((run for run in results if run.experiment == experiment), key=lambda run: run.number)
    return [results[run] for run in runs]


def _bests(results: Mapping[Run, Table], experiment: str) -> dict[str, NDArray[np.float64]]:
    """Return the fastest candidate of every run, a column an attribute."""
    rows = [best(table) for table in _of(results, experiment)]
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


def paper_curves() -> list[dict[str, str]]:
    """Return the papers' measured, modelled and simulated speeds, as read off their figures."""
    path = Path(fin_sim.__file__).parent / "data" / "paper_curves.csv"
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _published(curve: str) -> tuple[list[float], list[float]]:
    rows = [row for row in paper_curves() if row["curve"] == curve and row["young_modulus_gpa"]]
    return [float(row["young_modulus_gpa"]) for row in rows], [float(row["speed_cm_s"]) for row in rows]


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


def _figure_4(results: Mapping[Run, Table]) -> Figure:
    figure, axes = _axes("Mathematical model: speed over stiffness (figure 4)")
    _draw_speed(axes, _of(results, "model")[0], "ours, body held, fin without mass", _OURS)
    axes.plot(*_published("model"), "s", color=_THEIRS, mfc="none", label="Clark et al. 2012, model")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)
    return figure


def _figure_5(results: Mapping[Run, Table]) -> Figure:
    figure = empty_figure(9.6, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    landscape = _of(results, "simulation")[0]
    for axes, experiment, title in zip(
        panels, ("hill_climber", "genetic"), ("hill climber", "genetic algorithm"), strict=True
    ):
        tables, found = _of(results, experiment), _bests(results, experiment)
        axes.plot(landscape["young_modulus"] * GIGA, landscape["speed"] * CENTI, color=_GREY, label="landscape")
        low, high = min(t["young_modulus"].min() for t in tables), max(t["young_modulus"].max() for t in tables)
        starts = np.array([[t["young_modulus"][0], t["speed"][0]] for t in tables])
        if experiment == "hill_climber":
            axes.plot(starts[:, 0] * GIGA, starts[:, 1] * CENTI, ".", color=_THEIRS, label="start of each run")
        axes.plot(
            found["young_modulus"] * GIGA,
            found["speed"] * CENTI,
            "o",
            color=_OURS,
            mfc="none",
            label="best of each run",
        )
        axes.axvspan(low * GIGA, high * GIGA, color=_OURS, alpha=0.06, label="range tried")
        axes.set(title=f"{title}, {len(tables)} runs (figure 5)", xlabel="Young's modulus in GPa", ylim=(0.0, None))
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False)
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


def _figure_7(results: Mapping[Run, Table]) -> Figure:
    figure = empty_figure(7.0, 4.6)
    axes = figure.add_subplot()
    table = _of(results, "landscape")[0]
    shape = (len(np.unique(table["length"])), -1)
    modulus, length, speed = (table[name].reshape(shape) for name in ("young_modulus", "length", "speed"))
    levels = axes.contourf(modulus * GIGA, length * CENTI, speed * CENTI, levels=20, cmap="viridis")
    figure.colorbar(levels, label="mean speed in cm/s")
    found = _bests(results, "shape")
    if found:
        axes.plot(
            found["young_modulus"] * GIGA,
            found["length"] * CENTI,
            "o",
            color="white",
            mec="black",
            label="our best of each run",
        )
    optimum = _OPTIMA[1][0] * GIGA, _OPTIMA[1][1] * CENTI
    axes.plot(*optimum, "*", color=_THEIRS, mec="white", ms=13, label="the paper's optimum", clip_on=False)
    axes.set(
        xlabel="Young's modulus in GPa",
        ylabel="fin length in cm",
        title="Stiffness and shape at constant area (figure 7)",
    )
    axes.legend(loc="upper left", fontsize=8)
    return figure


@dataclass(frozen=True)
class Row:
    """One number that the papers state."""

    quantity: str
    paper: str
    clark: str
    ours: str
    remark: str


def _spread(values: NDArray[np.float64], unit: str, scale: float = 1.0) -> str:
    return f"{np.mean(values) * scale:.3g} +- {np.std(values) * scale:.2g} {unit}"


def _span(values: NDArray[np.float64], unit: str, scale: float = 1.0, digits: int = 4) -> str:
    """Return the range of values; one number where both ends read the same."""
    low, high = (f"{value * scale:.{digits}g}" for value in (np.min(values), np.max(values)))
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def _beside(ours: float, theirs: float) -> str:
    """Return how much ours is above or below theirs."""
    percent = round(100.0 * (ours / theirs - 1.0))
    return "the same" if percent == 0 else f"{abs(percent)} % {'above' if percent > 0 else 'below'}"


def _hinge(modulus: float, length: float) -> float:
    fin = replace(preset(SIMULATION).fin, young_modulus=modulus).at_length(length)
    return fin.hinge_stiffness(length / fin.segments)


def rows(results: Mapping[Run, Table]) -> list[Row]:
    """Return the comparison, for the experiments that were carried out.

    What is said of ours follows from the tables; what is said of the papers stands in them.
    """
    done = {run.experiment for run in results}
    table = []
    if "model" in done:
        remark = (
            "Neither paper states the drag area, with whose root the speed falls (ours is fitted to one measured stiff "
            "fin), nor the damping and the sheet's true thickness, which move the peak."
        )
        table.append(_peak_row("model: peak speed", _MODEL, _of(results, "model")[0], remark))
    if "simulation" in done:
        times = np.array([_PROTOTYPE / speed for speed, _ in _SIMULATION])
        remark = (
            f"The papers' prototype is {_span(np.round(times, 1), 'times')} as fast as their simulation, whose mass "
            "and drag are not stated. Ours are fitted to the stiff prototype."
        )
        table.append(_peak_row("simulation: peak speed", _SIMULATION, _of(results, "simulation")[0], remark))
    on_stiffness = ("simulation", "hill_climber", "genetic")
    remark = "The paper's own curve peaks at 0.9 GPa; its searches end at 1.6 and 1.7 GPa, where that curve is lower."
    if "hill_climber" in done:
        ours = _ours(results, "hill_climber", on_stiffness)
        table.append(Row("hill climber: E found", "1.7 GPa", "not stated", ours[0], f"{ours[1]} {remark}"))
    if "genetic" in done:
        ours = _ours(results, "genetic", on_stiffness)
        table.append(Row("genetic algorithm: E found", "1.6 GPa", "1.9 GPa", ours[0], f"{ours[1]} {remark}"))
    on_shape = ("shape", "landscape", "cma")
    if "shape" in done:
        ours = _ours(results, "shape", on_shape)
        remark = f"{ours[1]} The papers state neither drag nor mass."
        table.append(Row("shape and E together", "7.55 GPa, 14 x 1.43 cm, 2.2 cm/s", "the same", ours[0], remark))
    if "landscape" in done:
        table.append(_ridge_row(_of(results, "landscape")[0]))
    if "cma" in done:
        ours = _ours(results, "cma", on_shape)
        table.append(Row("the same by CMA-ES", "-", "-", ours[0], f"{ours[1]} The yardstick, not in the papers."))
    prototype = f"{_PROTOTYPE * CENTI:.1f} cm/s"
    remark = "A printed fin of 1 mm, DM9895; figure 6 and `validation.md`, Measured fins, simulate it."
    table.append(Row("prototype: peak speed", prototype, prototype, "see figure 6", remark))
    table.append(_hinge_row())
    return table


def _peak_row(quantity: str, published: Sequence[tuple[float, float]], table: Table, remark: str) -> Row:
    """Return the peak of a curve over E beside the papers'."""
    paper, clark = (f"{speed * CENTI:.1f} cm/s at {modulus * GIGA:.1f} GPa" for speed, modulus in published)
    peak = best(table)
    if np.isnan(peak["speed"]):
        return Row(quantity, paper, clark, "no fin swam", remark)
    ours = f"{peak['speed'] * CENTI:.2f} cm/s at {peak['young_modulus'] * GIGA:.2f} GPa"
    if peak["young_modulus"] in {table["young_modulus"].min(), table["young_modulus"].max()}:
        ours += ", an end of the range"
    speed = " and ".join(_beside(peak["speed"], theirs) for theirs, _ in published)
    modulus = " and ".join(_beside(peak["young_modulus"], theirs) for _, theirs in published)
    compared = f"Beside the paper and 2012 ours is {speed} in speed, {modulus} in E."
    return Row(quantity, paper, clark, ours, f"{compared} {remark}")


def _ours(results: Mapping[Run, Table], experiment: str, known: Sequence[str]) -> tuple[str, str]:
    """Return what the runs of an experiment found, and how many of them came to the highest speed known.

    Args:
        results: The tables.
        experiment: The runs.
        known: The experiments on fins of the same kind, which say what speed is known.
    """
    found = _bests(results, experiment)
    count = len(found["speed"])
    swam = {name: column[np.isfinite(found["speed"])] for name, column in found.items()}
    swims = _span(np.array([len(table["speed"]) for table in _of(results, experiment)]), "swims", digits=9)
    size = f"{count} runs of {swims}"
    if not len(swam["speed"]):
        return f"no fin swam in {size}", ""
    parts = [_spread(swam["young_modulus"], "GPa", GIGA)]
    if np.ptp(np.concatenate([table["length"] for table in _of(results, experiment)])) > 0.0:
        parts.append(_spread(swam["length"], "cm long", CENTI))
    ours = ", ".join((*parts, _spread(swam["speed"], "cm/s", CENTI), size))
    bests = [best(table)["speed"] for name in known for table in _of(results, name)]
    peak = max(speed for speed in bests if np.isfinite(speed))
    there = swam["speed"] >= (1.0 - _AT_THE_PEAK) * peak
    reached = f"{np.count_nonzero(there)} of {count} runs end within {_AT_THE_PEAK:.0%} of the highest speed known"
    told = [f"{reached}, {peak * CENTI:.3g} cm/s"]
    if not there.all():
        speed, modulus = (swam[name][~there] for name in ("speed", "young_modulus"))
        told.append(f"{len(speed)} at {_span(speed, 'cm/s', CENTI)}, E {_span(modulus, 'GPa', GIGA)}")
    if len(there) < count:
        told.append(f"in {count - len(there)} no fin swam")
    return ours, "; ".join(told) + "."


def _ridge_row(landscape: Table) -> Row:
    """Return the best E of the longest fin, and what the best of each length have in common."""
    lengths = np.unique(landscape["length"])
    ridge = [best({name: of[landscape["length"] == length] for name, of in landscape.items()}) for length in lengths]
    longest, swam = ridge[-1], [row for row in ridge if np.isfinite(row["speed"])]
    quantity, paper = f"best E of the {lengths[-1] * CENTI:.3g} cm fin", _OPTIMA[1][0]
    theirs = f"{paper * GIGA:.2f} GPa"
    if not swam:
        return Row(quantity, theirs, theirs, "no fin swam", "")
    hinges = np.array([_hinge(row["young_modulus"], row["length"]) for row in swam])
    speeds = np.array([row["speed"] for row in swam])
    remark = (
        f"The fastest fin of each length, {_span(np.array([row['length'] for row in swam]), 'cm', CENTI)}, swims "
        f"{_span(speeds, 'cm/s', CENTI)}, with hinges of {_span(hinges, 'N m')}."
    )
    if np.isnan(longest["speed"]):
        return Row(quantity, theirs, theirs, "no fin swam", remark)
    ours = f"{longest['speed'] * CENTI:.2f} cm/s at {longest['young_modulus'] * GIGA:.2f} GPa"
    share = f"{longest['speed'] / speeds.max():.0%} of the fastest of all"
    return Row(quantity, theirs, theirs, ours, f"E {_beside(longest['young_modulus'], paper)}; {share}. {remark}")


def _hinge_row() -> Row:
    thickness = preset(SIMULATION).fin.thickness
    hinges = [_hinge(*optimum) for optimum in _OPTIMA]
    remark = (
        f"`Fin.hinge_stiffness` of the papers' two optima {thickness * 1e3:.3g} mm thick, with which all of this was "
        f"computed. Equation 3 with the stated {_STATED_THICKNESS * 1e3:g} mm gives "
        f"{(_STATED_THICKNESS / thickness) ** 3:.0f} times as much."
    )
    theirs, ours = (" and ".join(f"{value:.2e}" for value in values) + " N m" for values in (_HINGES, hinges))
    return Row("hinge stiffness at the two optima", theirs, "the same", ours, remark)


def markdown(campaign: Campaign, results: Mapping[Run, Table]) -> str:
    """Return the comparison as a table."""
    papers = "Raja Mohamed & Raviraj; Clark et al. 2012"
    lines = [
        f"Seed {campaign.seed}; spread: standard deviation over runs. Papers: {papers}.",
        "",
        "| quantity | paper | 2012 | ours | remark |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {row.quantity} | {row.paper} | {row.clark} | {row.ours} | {row.remark} |" for row in rows(results)]
    return "\n".join(lines) + "\n"


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
    return paths
