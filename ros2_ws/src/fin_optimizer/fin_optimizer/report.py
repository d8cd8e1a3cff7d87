"""What a study found, for people: a table of all trials, a figure, and values as a laboratory writes them."""

from __future__ import annotations

import csv
import io
from datetime import UTC
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.trial import Outcome
from fin_plant.figures import empty_figure, own_style

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from matplotlib.axes import Axes

    from fin_optimizer.search import Dimension
    from fin_optimizer.study import Candidate, TrialRecord

    Curve = tuple[Sequence[float], Sequence[float]]
    """Values of the parameter in SI units, and the speed in m/s at each."""

CSV_FILE = "trials.csv"
FIGURE_FILE = "speed_over_modulus.png"
FRONT_FILE = "pareto_front.png"
MODULUS = "fin.young_modulus"
_CURVE_POINTS = 71
# Symbol or word, factor to SI and unit in which a laboratory speaks of a parameter.
_SHOWN_AS = {
    MODULUS: ("E", 1e9, "GPa"),
    "fin.length": ("length", 1e-2, "cm"),
    "fin.height": ("height", 1e-2, "cm"),
    "fin.tip_height": ("tip height", 1e-2, "cm"),
    "fin.thickness": ("thickness", 1e-3, "mm"),
}
_CM = 1e-2


def show_values(values: Mapping[str, float]) -> str:
    """Return a candidate in a laboratory's units, for example ``E 1.234 GPa``."""
    shown = []
    for name, value in values.items():
        word, factor, unit = _SHOWN_AS.get(name, (name, 1.0, ""))
        shown.append(f"{word} {value / factor:.4g} {unit}".rstrip())
    return ", ".join(shown)


def show_speed(speed: float) -> str:
    """Return a speed given in m/s as cm/s with four digits, for example ``2.661 cm/s``."""
    return f"{speed / _CM:#.4g} cm/s"


def trials_table(trials: Sequence[TrialRecord], space: Sequence[Dimension]) -> str:
    """Return all trials as CSV, one row each, with the units in the header. What is not known is left empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    parameters = [f"{d.name} [{d.unit}]" if d.unit else d.name for d in space]
    measured = ["speed [m/s]", "spread [m/s]", "cost of transport [J/m]", "samples"]
    times = ["started [UTC]", "ended [UTC]"]
    writer.writerow(["trial", "candidate", *parameters, "outcome", *measured, *times, "plant", "bag", "reason"])
    for trial in trials:
        values = [repr(trial.values[dimension.name]) for dimension in space]
        measured = [_number(trial.score), _number(trial.spread), _number(trial.cost), str(trial.samples or "")]
        times = [_utc(trial.started), _utc(trial.ended)]
        last = [trial.plant, trial.bag, trial.reason]
        writer.writerow([trial.number, trial.candidate, *values, trial.outcome.value, *measured, *times, *last])
    return text.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None else repr(value)


def _utc(time: datetime | None) -> str:
    return "" if time is None else time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write_table(path: Path, trials: Sequence[TrialRecord], space: Sequence[Dimension]) -> None:
    """Write `trials_table` to ``path``; an older file is replaced as a whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(trials_table(trials, space), encoding="utf-8")
    partial.replace(path)


def sweep(dimension: Dimension, speed: Callable[[float], float], points: int = _CURVE_POINTS) -> Curve:
    """Return the curve of ``speed`` (SI to m/s) over the whole range of a parameter."""
    values = np.linspace(dimension.minimum, dimension.maximum, points)
    return [float(value) for value in values], [speed(float(value)) for value in values]


@own_style()
def write_figure(
    path: Path,
    trials: Sequence[TrialRecord],
    best: Candidate | None,
    dimension: Dimension,
    *,
    curve: Curve | None = None,
    title: str = "",
) -> None:
    """Draw the speed of every trial over one parameter, coloured by order, the best one marked.

    Args:
        path: Where to write the PNG; an older one is replaced.
        trials: All trials; those without a score are ticks at the bottom.
        best: The best candidate.
        dimension: The parameter of the horizontal axis.
        curve: The simulator's speed over that parameter, drawn behind the trials; None for a robot.
        title: Heading, for example the fish and its gait.
    """
    word, factor, unit = _SHOWN_AS.get(dimension.name, (dimension.name, 1.0, dimension.unit))
    figure = empty_figure(8.0, 5.0)
    axes = figure.add_subplot()
    if curve is not None:
        values, speeds = np.asarray(curve[0]) / factor, np.asarray(curve[1]) / _CM
        axes.plot(values, speeds, color="0.6", linewidth=2.0, label="sweep in the simulator", zorder=1)
    _draw_trials(axes, trials, dimension.name, factor)
    if best is not None and best.score is not None:
        _mark_best(axes, best, dimension, factor)
    name = "Young's modulus E" if dimension.name == MODULUS else word
    axes.set_xlabel(f"{name} ({unit})" if unit else name)
    axes.set_ylabel("mean forward speed (cm/s)")
    margin = 0.02 * (dimension.maximum - dimension.minimum)
    axes.set_xlim((dimension.minimum - margin) / factor, (dimension.maximum + margin) / factor)
    axes.grid(visible=True, color="0.92")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, loc="best")
    axes.set_title(title, fontsize="medium")
    figure.savefig(path)


@own_style()
def write_front(path: Path, tried: Sequence[Candidate], front: Sequence[Candidate]) -> None:
    """Draw speed and cost of transport of every candidate, those of the Pareto front joined.

    Args:
        path: Where to write the PNG; an older one is replaced.
        tried: All candidates; those without both numbers are left out.
        front: Those of the front, the fastest first.
    """
    figure = empty_figure(8.0, 5.0)
    axes = figure.add_subplot()
    known = [(c.score / _CM, c.cost) for c in tried if c.score is not None and c.cost is not None]
    if known:
        axes.plot(*zip(*known, strict=True), "o", color="0.6", markersize=4.0, label=f"fins ({len(known)})")
    line = [(c.score / _CM, c.cost) for c in front if c.score is not None and c.cost is not None]
    if line:
        axes.plot(*zip(*line, strict=True), "o-", color="tab:red", label=f"Pareto front ({len(line)})")
        axes.legend(frameon=False, loc="best")
    axes.set_xlabel("mean forward speed (cm/s)")
    axes.set_ylabel("cost of transport (J/m)")
    axes.grid(visible=True, color="0.92")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)


def _draw_trials(axes: Axes, trials: Sequence[TrialRecord], name: str, factor: float) -> None:
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415  (loaded by `own_style` by now)

    scored = [trial for trial in trials if trial.score is not None]
    if scored:
        points = axes.scatter(
            [trial.values[name] / factor for trial in scored],
            [(trial.score or 0.0) / _CM for trial in scored],
            c=[trial.number for trial in scored],
            cmap="viridis",
            s=36.0,
            edgecolors="white",
            linewidths=0.5,
            label=f"trials ({len(scored)})",
            zorder=3,
        )
        axes.figure.colorbar(points, ax=axes, label="trial", pad=0.02, ticks=MaxNLocator(integer=True))
    for outcome, marker in ((Outcome.FAILED, "x"), (Outcome.INFEASIBLE, "|")):
        places = [trial.values[name] / factor for trial in trials if trial.outcome is outcome]
        if places:
            axes.plot(
                places,
                [0.02] * len(places),
                marker,
                color="tab:red",
                transform=axes.get_xaxis_transform(),
                label=f"{outcome.value} ({len(places)})",
                zorder=2,
            )


def _mark_best(axes: Axes, best: Candidate, dimension: Dimension, factor: float) -> None:
    score = best.score or 0.0
    axes.plot(
        [best.values[dimension.name] / factor],
        [score / _CM],
        "o",
        markersize=13.0,
        markerfacecolor="none",
        markeredgecolor="tab:red",
        markeredgewidth=1.8,
        linestyle="none",
        label=f"best: {show_values({dimension.name: best.values[dimension.name]})}, {show_speed(score)}",
        zorder=4,
    )
