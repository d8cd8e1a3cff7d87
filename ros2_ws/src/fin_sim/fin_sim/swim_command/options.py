"""The options of the command ``swim``, and what its help says of them."""

from __future__ import annotations

import argparse
from dataclasses import fields

from fin_plant import checks
from fin_plant.fin import SHAPES
from fin_plant.paths import given_path
from fin_sim.chain import CLAMPS, REACTIVE_FORMS
from fin_sim.swim_command.plan import PARAMETERS, SwimPlan

PLAN_OPTIONS = tuple(item.name for item in fields(SwimPlan) if item.name not in {"values", "loss_factor"})
"""Options of gait and run: the attributes of a plan by their names."""
# Short names of what is asked for often.
_SHORT = {"water.model": "--water", "water.wake": "--wake", "water.drag": "--drag", "water.preset": "--preset"}
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


def swim_parser() -> argparse.ArgumentParser:
    """Return the command's parser."""
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
    _add_parameters(parser)
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
    for name in PLAN_OPTIONS:
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


def _add_parameters(parser: argparse.ArgumentParser) -> None:
    numbers = parser.add_argument_group("parameters of fin, fish, water and servo, as the node names them")
    for name, entry in PARAMETERS.items():
        unit = f", {entry.unit}" if entry.unit else ""
        meaning = entry.description.removesuffix(".")
        help_text = f"{meaning}{unit} (default {entry.default})".replace("%", "%%")
        metavar = "A,B" if entry.kind.endswith("_array") else "X"
        names = [f"--{name}", *([_SHORT[name]] if name in _SHORT else [])]
        numbers.add_argument(*names, dest=name, metavar=metavar, help=help_text)
