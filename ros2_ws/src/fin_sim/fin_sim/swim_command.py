"""The command ``swim``: one swim, a case file, or many that differ in a number or two; as table, file or picture."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import os
import sys
import tempfile
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rich.console import Console
from rich.progress import track
from rich.table import Table

from fin_plant import checks, validity, yaml_file
from fin_plant.command import EXIT_FAILURE, EXIT_INTERRUPTED, command, tell_error
from fin_plant.figures import check_picture, try_to_draw
from fin_plant.fin import PLANT_PARAMETERS, SHAPES
from fin_plant.parameters import ParameterTable
from fin_plant.paths import check_output, given_path
from fin_sim import case as case_files
from fin_sim.chain import CLAMPS, REACTIVE_FORMS
from fin_sim.ideal_2d.errors import MassError, StrokeError
from fin_sim.materials import material
from fin_sim.quick_variation import swim_quickly
from fin_sim.swim import SIMULATOR_PARAMETERS
from fin_sim.time_stepping import StepError
from fin_sim.variation import (
    FIGURES,
    PARAMETERS,
    VARIATION_TABLE,
    VARIATION_TABLE_OF_MOTORS,
    Axis,
    Cell,
    SwimPlan,
    parse_axis,
    swim_all,
    varied_plans,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from fin_plant.parameters import Parameter, Value
    from fin_sim.swim_result import Swim

_PLAN_OPTIONS = tuple(item.name for item in fields(SwimPlan) if item.name not in {"values", "loss_factor"})
# What a node's parameter file says of the run, and the option that says it here.
_RUN_PARAMETERS = {"reactive": "reactive", "step": "step", "drive.ramp_time": "ramp_time"}
# Parameters that ROS gives every node.
_EVERY_NODES = ("use_sim_time", "qos_overrides.", "start_type_description_service")
# Short names of what is asked for often.
_SHORT = {"water.model": "--water", "water.wake": "--wake", "water.drag": "--drag", "water.preset": "--preset"}
_OF_MATERIAL = ("fin.young_modulus", "fin.density")
_DAMPING_TIME = "fin.damping_time"  # follows from a material's loss and the frequency, where it is not given
_MODEL = "water.model"
_PIPE_WIDTH = 140
_MANY_SWIMS = 500
_EXAMPLES = """examples:
  swim
      the default fish and fin, of the papers' size, 10 s
  swim --fin.young_modulus 2e9 --plot swim.png
      a stiffer fin, with a picture
  swim --material PP
      a range of stiffness gives a range of speeds
  swim --vary fin.young_modulus=1e8:1e10:30:log --csv E.csv --plot E.png
  swim --vary fin.young_modulus=1e9,2e9 --vary frequency=0.5:2:7
  swim --clamp towed --tow_speed 0.03
      thrust, power and efficiency at a given speed
  swim --preset soleil
      in ideal water of three dimensions, without wake and drag
  swim --animate swim.gif
      body, fin and path from above
  swim --case case.json --json --csv trajectory.csv
  swim --water.preset bht --fin.young_modulus 3e9
      in the plane ideal flow, without wake and drag
  swim --water ideal_2d --chain three_ellipses.yaml --animate stroke.gif
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="swim",
        usage="swim [OPTION ...]; swim --help lists the options",
        description="Swim a simulated fish. Numbers are in SI units, angles of the gait in degrees.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    _add_what_swims(parser)
    _add_gait_and_run(parser)
    _add_outputs(parser)
    numbers = parser.add_argument_group("parameters of fin, fish, water and servo, as the node names them")
    for name, entry in PARAMETERS.items():
        unit = f", {entry.unit}" if entry.unit else ""
        meaning = entry.description.removesuffix(".")
        help_text = f"{meaning}{unit} (default {entry.default})".replace("%", "%%")
        metavar = "A,B" if entry.kind.endswith("_array") else "X"
        names = [f"--{name}", *([_SHORT[name]] if name in _SHORT else [])]
        numbers.add_argument(*names, dest=name, metavar=metavar, help=help_text)
    return parser


def _add_what_swims(parser: argparse.ArgumentParser) -> None:
    what = parser.add_argument_group("what swims")
    what.add_argument("--case", type=given_path, metavar="FILE", help="a case file, JSON, with every parameter")
    what.add_argument(
        "--chain",
        type=given_path,
        metavar="FILE",
        help="a swimmer of one's own for --water ideal_2d, YAML: ellipses, outlines, fins, and how their joints move",
    )
    what.add_argument(
        "--material",
        metavar="NAME",
        help="of the fin: its softest and stiffest grade swim; the command materials lists them",
    )
    what.add_argument("--shape", choices=sorted(SHAPES), help="straight edges at the length and area that the fin has")
    what.add_argument(
        "--params-file", type=given_path, metavar="FILE", help="parameters as the node's --params-file takes them"
    )
    what.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="NAME=RANGE",
        help="many swims, a number over FIRST:LAST:COUNT[:log] or A,B,C; once or twice",
    )
    what.add_argument("--sweep", dest="vary", action="append", help=argparse.SUPPRESS)  # as it was called at first
    what.add_argument(
        "--quick",
        action="store_true",
        help="many swims side by side: speeds right to 0.1 %%, forces and power to 0.3 %%; what "
        "needs every moment of a swim is left out, and so is a free body's thrust",
    )


def _add_gait_and_run(parser: argparse.ArgumentParser) -> None:
    gait = parser.add_argument_group("gait and run")
    defaults = {item.name: item.default for item in fields(SwimPlan)}
    choices = {"gait": ("carangiform", "sub_carangiform"), "reactive": REACTIVE_FORMS, "clamp": CLAMPS}
    described = {
        "gait": "preset",
        "amplitude": "of the last driven joint, degrees",
        "frequency": "Hz",
        "bias": "of every driven joint, degrees; it turns the fish",
        "duration": "s",
        "ramp_time": "in which the gait starts, s",
        "reactive": "form of the water's force",
        "clamp": "body free, fixed or towed",
        "tow_speed": "of a towed body, m/s",
        "step": "longest time step, s",
    }
    for name in _PLAN_OPTIONS:
        help_text = f"{described[name]} (default {defaults[name]})"
        if name in choices:
            gait.add_argument(f"--{name}", choices=choices[name], help=help_text)
        else:
            gait.add_argument(f"--{name}", type=checks.read_number, metavar="X", help=help_text)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    out = parser.add_argument_group("what comes out; a file that exists is replaced, and the command says so")
    out.add_argument("--json", action="store_true", help="figures as JSON instead of a table")
    out.add_argument(
        "--csv",
        type=lambda text: str(given_path(text)),
        metavar="FILE",
        help="the trajectory, or of many swims the table; - is standard output",
    )
    out.add_argument(
        "--plot", type=given_path, metavar="FILE", help="picture of the swim or the swims, .png, .pdf or .svg"
    )
    out.add_argument("--animate", type=given_path, metavar="FILE", help="animated swim, .gif or .mp4")


def _value(parameter: Parameter, given: object) -> Value:
    """Return what the command line or a file gives for a parameter, in the parameter's type.

    A number may be a text: the command line knows nothing else, and YAML 1.1 takes 2.0e9 for one where ROS does not.
    """

    def number(item: object) -> object:
        return checks.read_number(item) if isinstance(item, str) else item

    try:
        if parameter.kind == "double_array":
            parts = [part for part in given.split(",") if part.strip()] if isinstance(given, str) else given
            given = [number(part) for part in parts] if isinstance(parts, list) else parts
        elif parameter.kind in {"double", "integer"}:
            given = number(given)
    except ValueError:
        allowed = checks.describe_range(parameter.minimum, parameter.maximum, parameter.unit)
        kind = "whole number" if parameter.kind == "integer" else "number"
        msg = f"{parameter.name} = {given!r} must be a {kind}: allowed is {allowed}"
        raise ValueError(msg) from None
    return parameter.check(given)


def _is_simulators(node: str) -> bool:
    """Return whether the entry of a ROS parameter file counts for the simulator: named so, or all nodes' (``/**``)."""
    name = node.rsplit("/", 1)[-1]
    return name == "simulator" or "*" in name


def _mapping_in(name: str, entry: object, part: str) -> dict[str, Any]:
    return checks.mapping(f"{part} of {name}", checks.mapping(name, entry).get(part))


def _read_parameters(path: Path) -> tuple[dict[str, Value], dict[str, Value]]:
    """Return what a ROS parameter file says of fin, fish and servo, and of the run; the rest is the node's alone."""
    try:
        nodes = {
            name: dict(_flatten(_mapping_in(name, entry, "ros__parameters")))
            for name, entry in checks.mapping("it", yaml_file.read(path)).items()
        }
        chosen = [entry for name, entry in nodes.items() if _is_simulators(name)]
    except ValueError as error:
        msg = f"{path} is not a ROS parameter file (node: ros__parameters: name: value): {error}"
        raise ValueError(msg) from None
    if not chosen:
        msg = f"{path} has parameters of {', '.join(nodes)} only: name its entry simulator or /**"
        raise ValueError(msg)
    known = ParameterTable({**PLANT_PARAMETERS, **SIMULATOR_PARAMETERS})
    flat = {name: value for entry in chosen for name, value in entry.items() if not name.startswith(_EVERY_NODES)}
    try:
        checked = {name: _value(known.require(name), value) for name, value in flat.items()}
    except ValueError as error:
        msg = f"{path}: {error}"
        raise ValueError(msg) from None
    values = {name: value for name, value in checked.items() if name in PARAMETERS}
    return values, {option: checked[name] for name, option in _RUN_PARAMETERS.items() if name in checked}


def _flatten(entry: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in entry.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _refuse_step(options: argparse.Namespace, run: Mapping[str, Value]) -> None:
    """Refuse a time step for quick swims, wherever it is given."""
    given = ["--step"] if options.step is not None else []
    given += [f"step in {options.params_file}"] if "step" in run else []
    if given:
        msg = f"--quick chooses its steps by itself, as short as its figures need: leave out {' and '.join(given)}"
        raise ValueError(msg)


def _plan(options: argparse.Namespace) -> SwimPlan:
    values, run = _read_parameters(options.params_file) if options.params_file else ({}, {})
    if options.quick:
        _refuse_step(options, run)
    given = {name: getattr(options, name) for name in PARAMETERS}
    values |= {name: _value(PARAMETERS[name], text) for name, text in given.items() if text is not None}
    chosen = {name: getattr(options, name) for name in _PLAN_OPTIONS if getattr(options, name) is not None}
    twice = [name for name in _OF_MATERIAL if options.material and name in values]
    if twice:
        msg = f"--material gives {twice[0]}: leave one of them out"
        raise ValueError(msg)
    plan = SwimPlan(values, **{**run, **chosen})
    if options.shape:
        shaped = plan.fin().shaped(options.shape)
        plan = replace(plan, values={**plan.values, **shaped.as_parameters()})
    return plan


def _refuse_with_file(options: argparse.Namespace, holder: str, own: tuple[str, ...]) -> None:
    """Refuse options beside a file that holds everything but its ``own`` ones.

    Raises:
        ValueError: There is one.
    """
    names = [*PARAMETERS, *(name for name in _PLAN_OPTIONS if name not in own), "material", "shape", "params_file"]
    given = [name for name in names if getattr(options, name) is not None]
    if given or options.vary or options.quick:
        option = (given or (["vary"] if options.vary else ["quick"]))[0].replace("params_file", "params-file")
        msg = f"--{holder} holds every parameter: leave out --{option} or edit the file"
        raise ValueError(msg)


def _check_outputs(options: argparse.Namespace) -> None:
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


_UNITS = {figure.name: figure.si for figure in FIGURES} | {
    "final_psi": "rad",
    "mean_thrust_last_two_periods": "N",
    "mean_power_last_two_periods": "W",
}
"""Of what JSON and CSV tell; empty for numbers without a unit."""


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


def _shown(value: Cell, scale: float = 1.0) -> str:
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
        table.add_row(figure.title, _shown(figure.of(swim), figure.scale), figure.unit)
    _console().print(table)


def _one(
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


def _run_case(options: argparse.Namespace) -> None:
    _refuse_with_file(options, "case", own=("step",))
    case = case_files.read_case(options.case)
    swim = case.swim() if options.step is None else case.swim(step=options.step)
    case_files.summary(swim)  # a held swim that is too short is refused, not shown without its means
    length = 2.0 * case.chain.body.tail_offset or 0.1  # a case knows no axes: an ellipse up to the tail's joint
    _one(swim, options, (length, length / 3.0), options.case.stem, case_files.SAMPLES_A_ROW)


def _run_chain(options: argparse.Namespace) -> None:
    """Swim a swimmer of one's own, and put out what was asked of it.

    Raises:
        ValueError: The file is refused, or an option that has nothing to do with it.
        StrokeError: Links collide.
        MassError: The mass matrix is not positive.
    """
    from fin_sim.ideal_2d.swimmer_file import read_swimmer  # noqa: PLC0415  (a fish needs none)
    from fin_sim.swimmer_command import UNITS, swim_swimmer  # noqa: PLC0415

    if getattr(options, _MODEL) != "ideal_2d":
        msg = "--chain swims in a plane ideal flow alone: add --water ideal_2d"
        raise ValueError(msg)
    setattr(options, _MODEL, None)
    if options.case:
        msg = "--chain and --case both say what swims: leave one of them out"
        raise ValueError(msg)
    _refuse_with_file(options, "chain", own=())
    swum = swim_swimmer(read_swimmer(options.chain))
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
        units = {name: UNITS[name] for name in swum.figures}
        print(_json({**swum.figures, "links": list(swum.swimmer.names), "units": units}))  # noqa: T201
    elif options.csv != "-":
        table = Table("a stroke", "value", "unit")
        for name, value in swum.figures.items():
            table.add_row(name.replace("_", " "), f"{value:.6g}", UNITS[name])
        _console().print(table)


def _table(axes: Sequence[Axis], rows: Sequence[Mapping[str, Cell]]) -> Table:
    known = [figure for figure in FIGURES if figure.name in rows[0]]
    # Quick swims have so few that all fit.
    motors = any(row.get("mean_electrical_power") is not None for row in rows)
    chosen = VARIATION_TABLE_OF_MOTORS if motors else VARIATION_TABLE
    shown = known if len(known) < len(FIGURES) else [figure for figure in known if figure.name in chosen]
    table = Table(
        *(f"{axis.name}\n{axis.unit}" for axis in axes), *(f"{figure.title}\n{figure.unit}" for figure in shown)
    )
    for row in rows:
        table.add_row(
            *(_shown(row[axis.name]) for axis in axes), *(_shown(row[figure.name], figure.scale) for figure in shown)
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


def _run_variation(plan: SwimPlan, axes: list[Axis], options: argparse.Namespace) -> int:
    """Swim all of them and put out their rows; a swim that diverges leaves a gap, Ctrl-C ends with the rows so far."""
    plans = varied_plans(plan, axes)
    if len(plans) > _MANY_SWIMS and not options.quick:
        print(  # noqa: T201
            f"swim: {len(plans)} swims; with --quick they take a fraction of the time, with fewer figures, of which "
            "speeds are right to 0.1 %",
            file=sys.stderr,
        )
    rows: list[dict[str, Cell]] = []
    failures: list[str] = []
    doubts: dict[str, None] = {}
    code = 0
    swim_these = swim_quickly if options.quick else swim_all
    with swim_these([each for _, each in plans]) as swims:
        watched = track(
            zip(plans, swims, strict=True),
            total=len(plans),
            description="swimming",
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
        try:
            for (numbers, _), swum in watched:
                row: dict[str, Cell] = {axis.name: number for axis, number in zip(axes, numbers, strict=True)}
                rows.append({**row, **swum.figures})
                doubts |= dict.fromkeys(swum.warnings)
                if swum.failure:
                    code = EXIT_FAILURE
                    failures.append(
                        f"{', '.join(f'{axis.name} = {_shown(row[axis.name])}' for axis in axes)}: {swum.failure}"
                    )
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
            failures.append(f"stopped after {len(rows)} of {len(plans)} swims")
    for doubt in doubts:
        print(f"swim: warning: {doubt}", file=sys.stderr)  # noqa: T201
    for failure in failures:
        tell_error("swim", failure)
    if rows:
        _put_out_variation(axes, rows, options, plan.title([axis.name for axis in axes]))
    return code


def _put_out_variation(axes: list[Axis], rows: list[dict[str, Cell]], options: argparse.Namespace, title: str) -> None:
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


def _check_tow_speed(plan: SwimPlan, axes: Sequence[Axis], options: argparse.Namespace) -> None:
    given = options.tow_speed is not None or any(axis.name == "tow_speed" for axis in axes)
    if given and plan.clamp != "towed":
        msg = f"tow_speed is that of a towed body, this one is {plan.clamp}: add --clamp towed or leave it out"
        raise ValueError(msg)


def _run(options: argparse.Namespace) -> int:
    _check_outputs(options)
    if options.chain:
        _run_chain(options)
        return 0
    if options.case:
        _run_case(options)
        return 0
    plan, axes = _plan(options), [parse_axis(text) for text in options.vary]
    _check_tow_speed(plan, axes, options)
    if options.material:
        twice = [axis.name for axis in axes if axis.name in _OF_MATERIAL]
        if twice:
            msg = f"--material gives {twice[0]}: leave one of them out"
            raise ValueError(msg)
        cut_from = material(options.material)
        soft, stiff = cut_from.fins(plan.fin())
        measured = _DAMPING_TIME in plan.values or any(axis.name == _DAMPING_TIME for axis in axes)
        plan = replace(
            plan,
            values={**plan.values, "fin.density": soft.density},
            loss_factor=None if measured else cut_from.loss_factor,
        )
        axes = [Axis("fin.young_modulus", (soft.young_modulus, stiff.young_modulus)), *axes]
    if axes:
        if options.animate:
            msg = "--animate shows one swim: leave out --vary and --material, and give fin.young_modulus"
            raise ValueError(msg)
        return _run_variation(plan, axes, options)
    if options.quick:
        msg = "--quick is for many swims: add --vary or --material, or leave it out"
        raise ValueError(msg)
    body = (
        PARAMETERS[name].check(plan.values.get(name, PARAMETERS[name].default))
        for name in ("body.length", "body.width")
    )
    length, width = (cast("float", value) for value in body)
    _one(plan.swim(), options, (length, width), plan.title())
    return 0


@command("swim", failures=(StepError, StrokeError, MassError, validity.FoldedError), when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, 2 for bad input, 1 for a swim that diverged or folded, 130 for Ctrl-C."""
    return _run(_parser().parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())
