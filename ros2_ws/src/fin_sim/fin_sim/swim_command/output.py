"""What the command ``swim`` puts out, with its units: figures as table or JSON, samples and rows as CSV, pictures."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from fin_plant import validity
from fin_plant.figures import check_picture, try_to_draw
from fin_plant.paths import check_output
from fin_sim import case as case_files
from fin_sim.swim_command.figures import FIGURES, VARIATION_TABLE, VARIATION_TABLE_OF_MOTORS

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from fin_sim.swim_command.axes import Axis
    from fin_sim.swim_command.swimmer import SwumStrokes
    from fin_sim.swim_command.variation import Cell
    from fin_sim.swim_result import Swim

_PIPE_WIDTH = 140
_UNITS = {figure.name: figure.si for figure in FIGURES} | {
    "final_psi": "rad",
    "mean_thrust_last_two_periods": "N",
    "mean_power_last_two_periods": "W",
}
"""Of what JSON and CSV tell; empty for numbers without a unit."""


def check_outputs(options: argparse.Namespace) -> None:
    """Refuse what cannot be written before anything is computed."""
    if options.plot:
        check_picture(options.plot)
    if options.animate:
        from fin_sim.picture import check_animation  # noqa: PLC0415  (not needed without a picture)

        check_animation(options.animate)
    if options.csv == "-" and options.json:
        msg = "--csv - and --json both write to standard output: give the CSV a file"
        raise ValueError(msg)
    csv_file = Path(options.csv) if options.csv and options.csv != "-" else None
    taken: set[Path] = set()
    for path in filter(None, (csv_file, options.plot, options.animate)):
        check_output(path)
        if path.resolve() in taken:
            msg = f"{path}: two of --csv, --plot and --animate go to the same file: give each its own"
            raise ValueError(msg)
        taken.add(path.resolve())


def put_out_swim(
    swim: Swim, options: argparse.Namespace, body_axes: tuple[float, float], title: str, case_row: int | None = None
) -> None:
    """Put out what was asked of one swim; ``case_row``: the samples from one row of a case's file to the next.

    Raises:
        FoldedError: The fin folded.
    """
    validity.refuse_folded(swim.largest_hinge_angle)
    for warning in swim.warnings:
        print(f"swim: warning: {warning}", file=sys.stderr)  # noqa: T201
    if options.csv:
        _trajectory(swim, options.csv, case_row or 1, units=case_row is None)
    if options.plot:
        from fin_sim.picture import plot_swim  # noqa: PLC0415

        _draw(options.plot, lambda file: plot_swim(swim, file, title))
    if options.animate:
        from fin_sim.picture import animate_swim  # noqa: PLC0415

        _draw(options.animate, lambda file: animate_swim(swim, file, body_axes))
    if options.json:
        figures = _figures(swim, case_row)
        print(_json({**figures, "units": {name: _UNITS[name] for name in figures}}))  # noqa: T201
    elif options.csv != "-":
        _print_swim(swim)


def put_out_swimmer(swum: SwumStrokes, options: argparse.Namespace) -> None:
    """Put out what was asked of a swimmer of one's own."""
    if options.csv == "-":
        sys.stdout.write(swum.table())
    elif options.csv:
        with _output(Path(options.csv)) as file:
            file.write_text(swum.table(), encoding="utf-8")
    if options.plot:
        _draw(options.plot, lambda file: swum.draw(file, options.chain.stem))
    if options.animate:
        _draw(options.animate, swum.animate)
    if options.json:
        print(_json({**swum.figures, "links": list(swum.swimmer.names), "units": swum.units}))  # noqa: T201
    elif options.csv != "-":
        table = Table("a stroke", "value", "unit")
        for name, value in swum.figures.items():
            table.add_row(name.replace("_", " "), f"{value:.6g}", swum.units[name])
        _console().print(table)


def put_out_variation(axes: list[Axis], rows: list[dict[str, Cell]], options: argparse.Namespace, title: str) -> None:
    """Put out what was asked of many swims: a row for each, the numbers that vary and its figures."""
    if options.csv and options.csv != "-":
        with _output(Path(options.csv)) as file:
            file.write_text(_variation_csv(axes, rows), encoding="utf-8")
    if options.plot:
        from fin_sim.picture import plot_variation  # noqa: PLC0415

        _draw(options.plot, lambda file: plot_variation(axes, rows, file, title))
    if options.json:
        units = {name: unit for name, unit in _variation_units(axes).items() if name in rows[0]}
        print(_json([{**row, "units": units} for row in rows]))  # noqa: T201
    elif options.csv == "-":
        sys.stdout.write(_variation_csv(axes, rows))
    else:
        _console().print(_table(axes, rows))


@contextmanager
def _output(path: Path) -> Iterator[Path]:
    """Give a new file to write, which takes the place of ``path`` only when it is complete."""
    replaced = path.exists()
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".swim-") as folder:
        new = Path(folder) / path.name
        yield new
        os.replace(new, path)  # noqa: PTH105
    print(f"swim: {'replaced' if replaced else 'wrote'} {path}", file=sys.stderr)  # noqa: T201


def _draw(path: Path, draw: Callable[[Path], None]) -> None:
    """Draw a picture into a file; a picture that fails is told and costs the swim none of its numbers."""

    def write() -> None:
        with _output(path) as file:
            draw(file)

    if failure := try_to_draw(path, write):
        print(f"swim: warning: {failure}", file=sys.stderr)  # noqa: T201


def _trajectory(swim: Swim, target: str, every: int, *, units: bool) -> None:
    if target == "-":
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "trajectory.csv"
            case_files.write_trajectory(swim, file, every=every, units=units)
            sys.stdout.write(file.read_text(encoding="utf-8"))
        return
    with _output(Path(target)) as file:
        case_files.write_trajectory(swim, file, every=every, units=units)


def _figures(swim: Swim, every: int | None) -> dict[str, float | None]:
    figures = {figure.name: figure.of(swim) for figure in FIGURES}
    common = {"mean_speed": swim.mean_speed, "final_psi": float(swim.heading[-1])}
    with suppress(ValueError):  # held or towed for less than two beats: the means are left out
        common = case_files.summary(swim, every=every)
    return {**figures, **common}


def _console() -> Console:
    """Return standard output; a file or pipe gets the whole width that a table needs."""
    return Console() if sys.stdout.isatty() else Console(width=_PIPE_WIDTH)


def shown(value: Cell, scale: float = 1.0) -> str:
    """Return a number times its scale as tables have it, to four digits; a word as it is, and - for none."""
    if isinstance(value, str):
        return value
    return "-" if value is None else f"{value * scale:.4g}"


def _json(content: object) -> str:
    """Return JSON; what is not finite, a radius on a straight course, becomes null, as JSON has no infinity."""

    def finite(item: object) -> object:
        if isinstance(item, dict):
            return {name: finite(value) for name, value in item.items()}
        if isinstance(item, list):
            return [finite(value) for value in item]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    return json.dumps(finite(content), indent=1, allow_nan=False)


def _print_swim(swim: Swim) -> None:
    table = Table("figure", "value", "unit")
    for figure in FIGURES:
        table.add_row(figure.title, shown(figure.of(swim), figure.scale), figure.unit)
    _console().print(table)


def _table(axes: Sequence[Axis], rows: Sequence[Mapping[str, Cell]]) -> Table:
    known = [figure for figure in FIGURES if figure.name in rows[0]]
    # Quick swims have so few that all fit.
    motors = any(row.get("mean_electrical_power") is not None for row in rows)
    chosen = VARIATION_TABLE_OF_MOTORS if motors else VARIATION_TABLE
    told = known if len(known) < len(FIGURES) else [figure for figure in known if figure.name in chosen]
    table = Table(
        *(f"{axis.name}\n{axis.unit}" for axis in axes), *(f"{figure.title}\n{figure.unit}" for figure in told)
    )
    for row in rows:
        table.add_row(
            *(shown(row[axis.name]) for axis in axes), *(shown(row[figure.name], figure.scale) for figure in told)
        )
    return table


def _variation_units(axes: Sequence[Axis]) -> dict[str, str]:
    return {axis.name: axis.unit for axis in axes} | {figure.name: figure.si for figure in FIGURES}


def _variation_csv(axes: Sequence[Axis], rows: Sequence[Mapping[str, Cell]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    units = _variation_units(axes)
    writer.writerow({name: f"{name} [{units[name]}]" if units[name] else name for name in rows[0]})
    writer.writerows(rows)
    return text.getvalue()
