"""How a study is drawn: speed over one parameter, over two, and the Pareto front, from candidates and trials alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fin_optimizer.search.space import Choice
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import CM, MODULUS, in_words, show_number, show_speed, show_values
from fin_plant.figures import empty_figure, own_style
from fin_plant.whole_file import write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fin_optimizer.goals import Measure
    from fin_optimizer.search.space import AnyDimension
    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.simulated_curve import SpeedCurve

_MARKERS = {Outcome.FAILED: "x", Outcome.INTERRUPTED: "+", Outcome.INFEASIBLE: "|"}


@own_style()
def draw_speed(
    path: Path,
    trials: Sequence[TrialRecord],
    best: Candidate | None,
    dimension: AnyDimension,
    *,
    simulated: SpeedCurve | None = None,
    title: str = "",
) -> None:
    """Draw the speed of every trial over one parameter, coloured by order, the best one marked.

    Args:
        path: Where to write the picture; an older one is replaced.
        trials: All trials; those without a score are ticks at the bottom.
        best: The best candidate.
        dimension: The parameter of the horizontal axis.
        simulated: The simulator's speed over that parameter, drawn behind the trials; None for a robot.
        title: Heading, for example the fish and its gait.
    """
    factor = axis_scale(dimension)
    figure, axes = _axes(title)
    if simulated is not None:
        values, speeds = np.asarray(simulated[0]) / factor, np.asarray(simulated[1]) / CM
        axes.plot(values, speeds, color="0.6", linewidth=2.0, label="simulator", zorder=1)
    _draw_trials(axes, trials, dimension)
    if best is not None and best.score is not None:
        _mark_best(axes, best, dimension)
    dress(axes, "x", dimension)
    axes.set_ylabel("mean forward speed (cm/s)")
    _save(figure, axes, path)


@own_style()
def draw_map(
    path: Path,
    tried: Sequence[Candidate],
    best: Candidate | None,
    dimensions: tuple[AnyDimension, AnyDimension],
    *,
    title: str = "",
) -> None:
    """Draw every candidate of a study of two parameters at its place, its speed as colour, the best one marked.

    Args:
        path: Where to write the picture; an older one is replaced.
        tried: All candidates; those without a score are red marks.
        best: The best one.
        dimensions: The parameters of the horizontal and of the vertical axis.
        title: Heading.
    """
    figure, axes = _axes(title)
    across, up = dimensions

    def places(some: Sequence[Candidate]) -> tuple[list[float], list[float]]:
        return tuple([_place(d, c.values) for c in some] for d in dimensions)  # type: ignore[return-value]

    scored = [candidate for candidate in tried if candidate.score is not None]
    if scored:
        speeds = [(candidate.score or 0.0) / CM for candidate in scored]
        points = axes.scatter(
            *places(scored), c=speeds, cmap="viridis", s=64.0, edgecolors="white", linewidths=0.5, zorder=3
        )
        if len(scored) > 1:
            figure.colorbar(points, ax=axes, label="mean forward speed (cm/s)", pad=0.02)
    for outcome, marker in _MARKERS.items():
        without = [c for c in tried if c.score is None and c.trials[-1].outcome is outcome]
        if without:
            axes.plot(*places(without), marker, color="tab:red", label=f"{outcome.value} ({len(without)})", zorder=2)
    if best is not None and best.score is not None:
        _ring(axes, *places([best]), f"best: {show_values(best.values)}, {show_speed(best.score)}")
    dress(axes, "x", across)
    dress(axes, "y", up)
    _save(figure, axes, path, below=True)


@own_style()
def draw_front(
    path: Path, tried: Sequence[Candidate], front: Sequence[Candidate], goals: Sequence[Measure], *, title: str = ""
) -> None:
    """Draw two measures of every candidate, those of the Pareto front joined.

    Args:
        path: Where to write the picture; an older one is replaced.
        tried: All candidates; those without a score are left out.
        front: Those of the front, the best by the first goal first.
        goals: Both measures.
        title: Heading.
    """
    figure, axes = _axes(title)
    known = [[c.measured[goal.name] / goal.shown_in[1] for goal in goals] for c in tried if c.measured]
    if known:
        axes.plot(*zip(*known, strict=True), "o", color="0.6", markersize=4.0, label=f"fins ({len(known)})")
    line = [[c.measured[goal.name] / goal.shown_in[1] for goal in goals] for c in front]
    if line:
        axes.plot(*zip(*line, strict=True), "o-", color="tab:red", label=f"Pareto front ({len(line)})")
    axes.set_xlabel(goals[0].axis)
    axes.set_ylabel(goals[1].axis)
    _save(figure, axes, path)


def _draw_trials(axes: Axes, trials: Sequence[TrialRecord], dimension: AnyDimension) -> None:
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415  (loaded by `own_style` by now)

    scored = [trial for trial in trials if trial.score is not None]
    if scored:
        points = axes.scatter(
            [_place(dimension, trial.values) for trial in scored],
            [(trial.score or 0.0) / CM for trial in scored],
            c=[trial.number for trial in scored],
            cmap="viridis",
            s=36.0,
            edgecolors="white",
            linewidths=0.5,
            label=f"trials ({len(scored)})",
            zorder=3,
        )
        if len(scored) > 1:
            axes.figure.colorbar(points, ax=axes, label="trial", pad=0.02, ticks=MaxNLocator(integer=True))
    for outcome, marker in _MARKERS.items():
        places = [_place(dimension, trial.values) for trial in trials if trial.outcome is outcome]
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


def _mark_best(axes: Axes, best: Candidate, dimension: AnyDimension) -> None:
    score, value = best.score or 0.0, best.values[dimension.name]
    label = f"best: {show_values({dimension.name: value})}, {show_speed(score)}"
    _ring(axes, [_place(dimension, best.values)], [score / CM], label)


def _ring(axes: Axes, across: Sequence[float], up: Sequence[float], label: str) -> None:
    axes.plot(
        across,
        up,
        "o",
        markersize=13.0,
        markerfacecolor="none",
        markeredgecolor="tab:red",
        markeredgewidth=1.8,
        linestyle="none",
        label=label,
        zorder=4,
    )


def _axes(title: str) -> tuple[Figure, Axes]:
    figure = empty_figure(8.0, 5.0)
    axes = figure.add_subplot()
    axes.set_title(title, fontsize="medium")
    axes.grid(visible=True, color="0.92")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def axis_scale(dimension: AnyDimension) -> float:
    """Return what stands for 1 on an axis, in SI; choices stand at their places."""
    return 1.0 if isinstance(dimension, Choice) else in_words(dimension.name)[1]


def _place(dimension: AnyDimension, values: Mapping[str, Any]) -> float:
    """Return where a candidate stands on a parameter's axis."""
    return dimension.number(values[dimension.name]) / axis_scale(dimension)


def dress(axes: Axes, which: Literal["x", "y"], dimension: AnyDimension) -> None:
    """Give an axis its parameter's label, range and scale, or its choices' names."""
    if isinstance(dimension, Choice):
        factor = in_words(dimension.name)[1]
        shown = [show_number(each, factor) for each in dimension.choices]
        axes.set(**{f"{which}ticks": range(dimension.count), f"{which}ticklabels": shown})
    elif dimension.log:
        axes.set(**{f"{which}scale": "log"})
    axes.set(**{f"{which}label": axis_label(dimension), f"{which}lim": _limits(dimension)})


def axis_label(dimension: AnyDimension) -> str:
    """Return what stands at a parameter's axis: its name and the unit in which it is told."""
    word, _, unit = in_words(dimension.name)
    name = "Young's modulus E" if dimension.name == MODULUS else word
    return f"{name} ({unit})" if unit else name


def _limits(dimension: AnyDimension) -> tuple[float, float]:
    if isinstance(dimension, Choice):
        return dimension.low, dimension.high
    factor = axis_scale(dimension)
    if dimension.log:
        margin = (dimension.maximum / dimension.minimum) ** 0.02
        return dimension.minimum / margin / factor, dimension.maximum * margin / factor
    margin = 0.02 * (dimension.maximum - dimension.minimum)
    return (dimension.minimum - margin) / factor, (dimension.maximum + margin) / factor


def _save(figure: Figure, axes: Axes, path: Path, *, below: bool = False) -> None:
    """Write the picture with its legend, ``below`` the axes where no corner is free."""
    if axes.get_legend_handles_labels()[0] and below:
        figure.legend(frameon=False, loc="outside lower center", ncols=4)
    elif axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, loc="best")
    save_whole(figure, path)


def save_whole(figure: Figure, path: Path) -> None:
    """Write a picture; an older one is replaced as a whole or not at all."""
    write_whole(path, figure.savefig)
