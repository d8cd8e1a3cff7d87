"""The paper's figures 4 to 7 from a campaign's runs, and every number that the papers state with ours beside it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fin_sim
from fin_optimizer.experiments import SHAPE_LENGTH
from fin_plant.figures import empty_figure, own_style, try_to_draw
from fin_plant.fin import Fin
from fin_sim.materials import materials

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from fin_optimizer.experiments import Run, Study, Table

CENTI, GIGA = 1e2, 1e-9
_OURS, _THEIRS, _OTHER, _GREY = "#0b6aa2", "#c8553d", "#3a7d44", "#8a8a8a"


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


def _curve(axes: Axes, table: Table, label: str, colour: str) -> None:
    axes.plot(table["young_modulus"] * GIGA, table["speed"] * CENTI, color=colour, label=label)
    peak = best(table)
    axes.plot(peak["young_modulus"] * GIGA, peak["speed"] * CENTI, "o", color=colour)


def _figure_4(results: Mapping[Run, Table]) -> Figure:
    figure, axes = _axes("Mathematical model: speed over stiffness (figure 4)")
    _curve(axes, _of(results, "model")[0], "ours, body held, fin without mass", _OURS)
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
    figure, axes = _axes("Measured fins beside model and simulation (figure 6)", width=7.4)
    _curve(axes, _of(results, "model")[0], "our model", _OTHER)
    _curve(axes, _of(results, "simulation")[0], "our simulation", _OURS)
    axes.plot(*_published("model"), "s", color=_OTHER, mfc="none", label="2012, model")
    axes.plot(*_published("simulation"), "s", color=_OURS, mfc="none", label="2012, simulation")
    right, lift = axes.get_xlim()[1], 6
    for row in (row for row in paper_curves() if row["curve"] == "physical"):
        speed, material = float(row["speed_cm_s"]), materials().get(row["material"])
        known = material.young_modulus if material is not None else None
        if known is not None and known[1] * GIGA < right:
            centre = 0.5 * sum(known) * GIGA
            axes.errorbar(centre, speed, xerr=centre - known[0] * GIGA, fmt="D", color=_THEIRS, capsize=3)
            axes.annotate(
                row["material"], (centre, speed), (6, 6), textcoords="offset points", color=_THEIRS, fontsize=8
            )
        else:
            note = f"{row['material']} (E not stated)"
            axes.annotate(
                note,
                (right, speed),
                (6, lift),
                textcoords="offset points",
                va="center",
                annotation_clip=False,
                color=_THEIRS,
                fontsize=8,
            )
            lift -= 12
            axes.plot([0.985 * right, right], [speed, speed], color=_THEIRS)
    axes.plot([], [], "D", color=_THEIRS, label="2012, measured")
    axes.set_ylim(-0.1, 7.6)
    axes.set_xlim(0.0, right)
    axes.legend(frameon=False, fontsize=8, loc="upper right", ncols=2)
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
    axes.plot(7.55, 14.0, "*", color=_THEIRS, mec="white", ms=13, label="the paper's optimum", clip_on=False)
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


def _peak(table: Table) -> str:
    row = best(table)
    return f"{row['speed'] * CENTI:.2f} cm/s at {row['young_modulus'] * GIGA:.2f} GPa"


def _hinge(modulus: float, length: float) -> float:
    height = Fin().area / length
    segment = Fin(young_modulus=modulus, length=length, height=height, tip_height=height)
    return segment.hinge_stiffness(length / segment.segments)


def rows(results: Mapping[Run, Table]) -> list[Row]:
    """Return the comparison, for the experiments that were carried out."""
    done = {run.experiment for run in results}
    table = []
    if "model" in done:
        remark = (
            "They differ on the same curve. Neither states the drag area, with whose root the speed falls (ours is "
            "fitted to one measured stiff fin), nor the damping and the sheet's true thickness, which move the peak."
        )
        table.append(
            Row(
                "model: peak speed",
                "4.8 cm/s at 0.7 GPa",
                "5.1 cm/s at 0.9 GPa",
                _peak(_of(results, "model")[0]),
                remark,
            )
        )
    if "simulation" in done:
        remark = (
            "The papers' simulation is three times slower than their prototype and model; its mass and drag are not "
            "stated. With ours, fitted to the stiff prototype, the peak lies between theirs and the prototype's."
        )
        table.append(
            Row(
                "simulation: peak speed",
                "1.2 cm/s at 0.9 GPa",
                "1.4 cm/s at 1.9 GPa",
                _peak(_of(results, "simulation")[0]),
                remark,
            )
        )
    if "hill_climber" in done:
        table += _search_rows(results, "hill_climber", "hill climber: E found", "1.7 GPa", "not stated")
    if "genetic" in done:
        table += _search_rows(results, "genetic", "genetic algorithm: E found", "1.6 GPa", "1.9 GPa")
    if "shape" in done:
        table += _shape_rows(results)
    table.append(
        Row(
            "prototype: peak speed",
            "3.7 cm/s",
            "3.7 cm/s",
            "not simulated",
            "Measured: a simulation cannot repeat it. It is drawn in figure 6.",
        )
    )
    remark = (
        "Equation 3 with the stated 1 mm gives 110 times these; both follow from 0.208 mm, with which all of this was "
        "computed: `Fin.hinge_stiffness` of the papers' two optima."
    )
    ours = f"{_hinge(1.9e9, 0.08):.3g} and {_hinge(7.55e9, 0.14):.3g} N m"
    table.append(Row("hinge stiffness at the two optima", "1.35e-3 and 1.73e-3 N m", "the same", ours, remark))
    return table


def _search_rows(results: Mapping[Run, Table], experiment: str, quantity: str, paper: str, clark: str) -> list[Row]:
    found = _bests(results, experiment)
    stiffness, speed = _spread(found["young_modulus"], "GPa", GIGA), _spread(found["speed"], "cm/s", CENTI)
    ours = f"{stiffness}, {speed}, {len(found['speed'])} runs"
    remark = (
        "Every run ends at the peak of our landscape. The paper's own curve peaks at 0.9 GPa while its searches end at "
        "1.6 to 1.7: searches that maximise that curve cannot."
    )
    return [Row(quantity, paper, clark, ours, remark)]


def _shape_rows(results: Mapping[Run, Table]) -> list[Row]:
    found = _bests(results, "shape")
    ours = (
        f"{_spread(found['young_modulus'], 'GPa', GIGA)}, {_spread(found['length'], 'cm long', CENTI)}, "
        f"{_spread(found['speed'], 'cm/s', CENTI)}, {len(found['speed'])} runs"
    )
    remark = (
        "Along a ridge of nearly constant hinge stiffness the speed hardly changes with length, so its summit follows "
        "small differences in drag and mass, which the papers do not state."
    )
    table = [Row("shape and E together", "7.55 GPa, 14 x 1.43 cm, 2.2 cm/s", "the same", ours, remark)]
    if any(run.experiment == "landscape" for run in results):
        landscape = _of(results, "landscape")[0]
        longest = landscape["length"] == landscape["length"].max()
        ridge = best({name: column[longest] for name, column in landscape.items()})
        summit = best(landscape)["speed"]
        ours = f"{ridge['speed'] * CENTI:.2f} cm/s at {ridge['young_modulus'] * GIGA:.2f} GPa"
        remark = (
            f"At the paper's length of {SHAPE_LENGTH[1] * CENTI:.0f} cm our best E is near the paper's, and its speed "
            f"is {ridge['speed'] / summit:.0%} of our summit."
        )
        table.append(Row("best E of the 14 cm fin", "7.55 GPa", "7.55 GPa", ours, remark))
    if any(run.experiment == "cma" for run in results):
        cma = _bests(results, "cma")
        swims = len(_of(results, "cma")[0]["speed"])
        genetic = len(_of(results, "shape")[0]["speed"])
        ours = f"{_spread(cma['speed'], 'cm/s', CENTI)} in {swims} swims a run (genetic algorithm: {genetic})"
        table.append(Row("the same by CMA-ES", "-", "-", ours, "The yardstick, not in the papers."))
    return table


def markdown(study: Study, results: Mapping[Run, Table]) -> str:
    """Return the comparison as a table."""
    lines = [
        f"Seed {study.seed}; spread: standard deviation over runs. Papers: Raja Mohamed & Raviraj; Clark et al. 2012.",
        "",
        "| quantity | paper | 2012 | ours | remark |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {row.quantity} | {row.paper} | {row.clark} | {row.ours} | {row.remark} |" for row in rows(results)]
    return "\n".join(lines) + "\n"


def _save(draw: Callable[[Mapping[Run, Table]], Figure], results: Mapping[Run, Table], path: Path) -> None:
    draw(results).savefig(path)


def write(
    folder: Path, study: Study, results: Mapping[Run, Table], warn: Callable[[str], object] = print
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
    paths[0].write_text(markdown(study, results), encoding="utf-8")
    with own_style(font_size=9):
        for number, experiments in needs:
            if experiments <= done:
                path = folder / f"paper_figure_{number}.png"
                if failure := try_to_draw(path, partial(_save, draw[number], results, path)):
                    warn(failure)
                else:
                    paths.append(path)
    return paths
