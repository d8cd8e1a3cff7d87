"""Every number that the papers state, with what a campaign's runs give beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fin_sim
from fin_optimizer.paper.experiments import SIMULATION, STATED
from fin_sim.presets import preset
from fin_sim.validation.paper import SpeedCurve, published

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.paper.experiments import Campaign, Run, Table

CENTI, GIGA = 1e2, 1e-9


# What the papers state, Raja Mohamed & Raviraj and then Clark et al. 2012: speed in m/s and Young's modulus in Pa.
_MODEL = ((0.048, 0.7e9), (0.051, 0.9e9))
_SIMULATION = ((0.012, 0.9e9), (0.014, 1.9e9))
_PROTOTYPE = 0.037
OPTIMA = ((1.9e9, 0.08), (7.55e9, 0.14))
"""Young's modulus and length in m of the two fins that evolved."""
_HINGES = (1.35e-3, 1.73e-3)
"""Their hinge stiffness in N m."""
_STATED_THICKNESS = 1e-3
PAPER, CLARK = "Raja Mohamed & Raviraj", "Clark et al. 2012"
FOUND = {"hill_climber": {PAPER: 1.7e9}, "genetic": {PAPER: 1.6e9, CLARK: 1.9e9}}
"""Young's modulus in Pa at which their searches ended."""
_SHAPE, _SHAPE_SPEED = "7.55 GPa, 14 x 1.43 cm, 2.2 cm/s", 0.022
_AT_THE_PEAK = 0.01
"""A run that ends within this share of the highest speed known has found the peak."""


def best(table: Table) -> dict[str, float]:
    """Return the row of the fastest candidate; NaN where nothing swam."""
    speed = table["speed"]
    index = int(np.nanargmax(speed)) if np.isfinite(speed).any() else 0
    return {name: float(column[index]) for name, column in table.items()}


def of_experiment(results: Mapping[Run, Table], experiment: str) -> list[Table]:
    """Return the tables of an experiment's runs, in their order."""
    runs = sorted((run for run in results if run.experiment == experiment), key=lambda run: run.number)
    return [results[run] for run in runs]


def bests(results: Mapping[Run, Table], experiment: str) -> dict[str, NDArray[np.float64]]:
    """Return the fastest candidate of every run, a column an attribute."""
    rows = [best(table) for table in of_experiment(results, experiment)]
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


@cache
def published_curves() -> dict[str, SpeedCurve]:
    """Return the curves of Clark et al. 2012 by name, and figure 5 once more, read densely, as ``figure 5``."""
    data = Path(fin_sim.__file__).parent / "data"
    modulus, speed = np.loadtxt(data / "paper_figure_5.csv", delimiter=",", skiprows=1).T
    return {**published(data / "paper_curves.csv"), "figure 5": SpeedCurve(1e9 * modulus, 0.01 * speed)}


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
        curve = of_experiment(results, "model")[0]
        table.append(_peak_row("model: peak speed", _MODEL, curve, _miss(curve, "model")))
    if "simulation" in done:
        curve = of_experiment(results, "simulation")[0]
        table.append(_peak_row("simulation: peak speed", _SIMULATION, curve, _miss(curve, "figure 5")))
    if "stated_fin" in done:
        table.append(_stated_row(of_experiment(results, "stated_fin")[0]))
    on_stiffness = ("simulation", "hill_climber", "genetic")
    for experiment, quantity in (
        ("hill_climber", "hill climber: E found"),
        ("genetic", "genetic algorithm: E found"),
    ):
        if experiment in done:
            ours, told = _ours(results, experiment, on_stiffness)
            paper, clark = (
                f"{found * GIGA:.1f} GPa" if (found := FOUND[experiment].get(whose)) else "not stated"
                for whose in (PAPER, CLARK)
            )
            table.append(Row(quantity, paper, clark, ours, told + _found_beside(results, experiment)))
    on_shape = ("shape", "landscape", "cma")
    if "shape" in done:
        ours, told = _ours(results, "shape", on_shape)
        table.append(Row("shape and E together", _SHAPE, "the same", ours, told + _shape_beside(results)))
    if "landscape" in done:
        table.append(_ridge_row(of_experiment(results, "landscape")[0]))
    if "cma" in done:
        ours, told = _ours(results, "cma", on_shape)
        table.append(Row("the same by CMA-ES", "-", "-", ours, f"{told} The yardstick, not in the papers."))
    prototype = f"{_PROTOTYPE * CENTI:.1f} cm/s"
    remark = "A printed fin of 1 mm, DM9895; figure 6 and `validation.md`, Measured fins, simulate it."
    table.append(Row("prototype: peak speed", prototype, prototype, "see figure 6", remark))
    table.append(_hinge_row())
    return table


def _miss(table: Table, name: str) -> str:
    """Return how far a curve lies from the published points within its range of E."""
    points = published_curves()[name]
    swam = np.isfinite(table["speed"])
    if not swam.any():
        return ""
    curve = SpeedCurve(table["young_modulus"][swam], table["speed"][swam])
    inside = (points.modulus >= curve.modulus[0]) & (points.modulus <= curve.modulus[-1])
    off = curve.at(points.modulus[inside]) - points.speed[inside]
    return (
        f"Root mean square difference from {len(off)} points read off the figure of 2012: "
        f"{np.sqrt(np.mean(off**2)) * CENTI:.2g} cm/s."
    )


def _found_beside(results: Mapping[Run, Table], experiment: str) -> str:
    found = bests(results, experiment)
    swam = found["young_modulus"][np.isfinite(found["speed"])]
    if not len(swam):
        return ""
    told = [f"beside {whose} {_beside(float(np.mean(swam)), theirs)}" for whose, theirs in FOUND[experiment].items()]
    return f" E: {', '.join(told)}."


def _shape_beside(results: Mapping[Run, Table]) -> str:
    found = bests(results, "shape")
    swam = np.isfinite(found["speed"])
    if not swam.any():
        return ""
    modulus, length = OPTIMA[1]
    told = [
        f"{name} {_beside(float(np.mean(found[column][swam])), theirs)}"
        for name, column, theirs in (
            ("E", "young_modulus", modulus),
            ("length", "length", length),
            ("speed", "speed", _SHAPE_SPEED),
        )
    ]
    return f" Beside the papers' optimum: {', '.join(told)}. Nothing was fitted to it but the thickness, to its hinge."


def _stated_row(table: Table) -> Row:
    """Return the peak of the fin that the later paper states."""
    fin = preset(STATED).fin
    paper = f'3.0 x 4.0 x 0.1 cm, "each segment": {fin.length * CENTI:.3g} cm in three'
    remark = "Preset `raja_mohamed`. The papers' optimum of the shape, 14 x 1.43 cm, has the area of 2.5 x 8.0 cm."
    swam = best(table)
    if np.isnan(swam["speed"]):
        ours = "no fin swam"
    else:
        ours = f"{swam['speed'] * CENTI:.2f} cm/s at {swam['young_modulus'] * GIGA:.2f} GPa"
        if swam["young_modulus"] == table["young_modulus"].max():
            ours += ", the end of the range"
            remark = f"Faster the stiffer, so the papers' peaks and searches are of no such fin. {remark}"
    return Row("fin of the simulation", paper, "2.5 x 8.0 x 0.1 cm, the whole fin", ours, remark)


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
    found = bests(results, experiment)
    count = len(found["speed"])
    swam = {name: column[np.isfinite(found["speed"])] for name, column in found.items()}
    swims = _span(np.array([len(table["speed"]) for table in of_experiment(results, experiment)]), "swims", digits=9)
    size = f"{count} runs of {swims}"
    if not len(swam["speed"]):
        return f"no fin swam in {size}", ""
    parts = [_spread(swam["young_modulus"], "GPa", GIGA)]
    if np.ptp(np.concatenate([table["length"] for table in of_experiment(results, experiment)])) > 0.0:
        parts.append(_spread(swam["length"], "cm long", CENTI))
    ours = ", ".join((*parts, _spread(swam["speed"], "cm/s", CENTI), size))
    highest = [best(table)["speed"] for name in known for table in of_experiment(results, name)]
    peak = max(speed for speed in highest if np.isfinite(speed))
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
    quantity, paper = f"best E of the {lengths[-1] * CENTI:.3g} cm fin", OPTIMA[1][0]
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
    hinges = [_hinge(*optimum) for optimum in OPTIMA]
    remark = (
        f"`Fin.hinge_stiffness` of the papers' two optima {thickness * 1e3:.2f} mm thick, l of equation 3 the fin's "
        f"length, as in preset `{SIMULATION}`; 0.208 mm with a segment's length gives the same. Equation 3 with the "
        f"stated {_STATED_THICKNESS * 1e3:g} mm gives {(_STATED_THICKNESS / thickness) ** 3:.0f} times as much."
    )
    theirs, ours = (" and ".join(f"{value:.2e}" for value in values) + " N m" for values in (_HINGES, hinges))
    return Row("hinge stiffness at the two optima", theirs, "the same", ours, remark)


def markdown(campaign: Campaign, results: Mapping[Run, Table]) -> str:
    """Return the comparison as a table."""
    lines = [
        f"Seed {campaign.seed}; spread: standard deviation over runs. Papers: {PAPER}; {CLARK}.",
        "",
        "| quantity | paper | 2012 | ours | remark |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {row.quantity} | {row.paper} | {row.clark} | {row.ours} | {row.remark} |" for row in rows(results)]
    return "\n".join(lines) + "\n"
