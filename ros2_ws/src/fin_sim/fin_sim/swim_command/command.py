"""The command ``swim``: one swim, a case file, or many that differ in a number or two; as table, file or picture."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import track

from fin_plant import validity
from fin_plant.command import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, command, tell_error
from fin_sim import case as case_files
from fin_sim.ideal_2d.errors import MassError, StrokeError
from fin_sim.swim_command.axes import varied_plans
from fin_sim.swim_command.options import swim_parser
from fin_sim.swim_command.output import check_outputs, put_out_swim, put_out_swimmer, put_out_variation, shown
from fin_sim.swim_command.plan_of_options import plan_of, refuse_beside_file
from fin_sim.swim_command.quick_variation import swim_quickly
from fin_sim.swim_command.variation import swim_all
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from fin_sim.swim_command.axes import Axis
    from fin_sim.swim_command.plan import SwimPlan
    from fin_sim.swim_command.variation import Cell

_MODEL = "water.model"
_MANY_SWIMS = 500


@dataclass
class _Rows:
    """What many swims gave, as far as they were swum.

    Attributes:
        rows: Of each swim the numbers that vary, and its figures.
        warnings: What to know before they are believed, each once and in order.
        failures: Why swims have no figures, or why there are no more of them.
        code: With which the command ends.
    """

    rows: list[dict[str, Cell]] = field(default_factory=list)
    warnings: dict[str, None] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    code: int = EXIT_OK


def _swim_case(options: argparse.Namespace) -> None:
    refuse_beside_file(options, "case", own=("step",))
    case = case_files.read_case(options.case)
    swim = case.swim() if options.step is None else case.swim(step=options.step)
    case_files.summary(swim)  # a held swim that is too short is refused, not shown without its means
    length = 2.0 * case.chain.body.tail_offset or 0.1  # a case knows no axes: an ellipse up to the tail's joint
    put_out_swim(swim, options, (length, length / 3.0), options.case.stem, case_files.SAMPLES_A_ROW)


def _swim_chain(options: argparse.Namespace) -> None:
    """Swim a swimmer of one's own, and put out what was asked of it.

    Raises:
        ValueError: The file is refused, or an option that has nothing to do with it.
        StrokeError: Links collide.
        MassError: The mass matrix is not positive.
    """
    from fin_sim.ideal_2d.swimmer_file import read_swimmer  # noqa: PLC0415  (a fish needs none)
    from fin_sim.swim_command.swimmer import swim_swimmer  # noqa: PLC0415

    if getattr(options, _MODEL) != "ideal_2d":
        msg = "--chain swims in a plane ideal flow alone: add --water ideal_2d"
        raise ValueError(msg)
    if options.case:
        msg = "--chain and --case both say what swims: leave one of them out"
        raise ValueError(msg)
    refuse_beside_file(options, "chain", own=(_MODEL,))
    put_out_swimmer(swim_swimmer(read_swimmer(options.chain)), options)


def _swim_variation(plan: SwimPlan, axes: list[Axis], options: argparse.Namespace) -> int:
    """Swim all of them and put out their rows; a swim that diverges leaves a gap, Ctrl-C ends with the rows so far."""
    plans = varied_plans(plan, axes)
    if len(plans) > _MANY_SWIMS and not options.quick:
        print(  # noqa: T201
            f"swim: {len(plans)} swims; with --quick they take a fraction of the time, with fewer figures, of which "
            "speeds are right to 0.1 %",
            file=sys.stderr,
        )
    swum = _rows(plans, axes, quick=options.quick)
    for warning in swum.warnings:
        print(f"swim: warning: {warning}", file=sys.stderr)  # noqa: T201
    for failure in swum.failures:
        tell_error("swim", failure)
    if swum.rows:
        put_out_variation(axes, swum.rows, options, plan.title([axis.name for axis in axes]))
    return swum.code


def _rows(plans: list[tuple[tuple[float | str, ...], SwimPlan]], axes: list[Axis], *, quick: bool) -> _Rows:
    """Swim plans, with their numbers before them, and show on a terminal how far it is."""
    result = _Rows()
    swim_these = swim_quickly if quick else swim_all
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
                result.rows.append({**row, **swum.figures})
                result.warnings |= dict.fromkeys(swum.warnings)
                if swum.failure:
                    result.code = EXIT_FAILURE
                    varied = ", ".join(f"{name} = {shown(number)}" for name, number in row.items())
                    result.failures.append(f"{varied}: {swum.failure}")
        except KeyboardInterrupt:
            result.code = EXIT_INTERRUPTED
            result.failures.append(f"stopped after {len(result.rows)} of {len(plans)} swims")
    return result


def _run(options: argparse.Namespace) -> int:
    check_outputs(options)
    if options.chain:
        _swim_chain(options)
        return EXIT_OK
    if options.case:
        _swim_case(options)
        return EXIT_OK
    plan, axes = plan_of(options)
    if axes:
        return _swim_variation(plan, axes, options)
    put_out_swim(plan.swim(), options, plan.body_axes(), plan.title())
    return EXIT_OK


@command("swim", failures=(StepError, StrokeError, MassError, validity.FoldedError), when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, 2 for bad input, 1 for a swim that diverged or folded, 130 for Ctrl-C."""
    return _run(swim_parser().parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())
