"""Command ``predict``: how well a fitted fish predicts recorded swims of which it is shown the first moments."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import TYPE_CHECKING

from fin_optimizer.calibration.fish_file import read_fish
from fin_optimizer.calibration.recorded import read_folder
from fin_optimizer.calibration.swims import LAST, SHORTEST, usable
from fin_plant import checks, text_file
from fin_plant.command import command
from fin_plant.figures import check_picture, try_to_draw
from fin_plant.paths import check_output, given_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.calibration.errors import Errors

_WINDOWS = (
    "Errors in true time: of the mean forward speed over the last 2 s and of the mean turning rate from the end of "
    "what was given to the swim's end (swims with a bias only), both relative; of the position, m, 3 s after the "
    "first second."
)

_WIDTHS = {"speed": 6, "turning_rate": 7, "position": 8}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="predict",
        description="Predict recorded swims from their first moments by a fitted fish.",
        epilog=_WINDOWS,
        allow_abbrev=False,
    )
    parser.add_argument("--fish", type=given_path, required=True, metavar="FILE", help="what calibrate wrote")
    parser.add_argument("--swims", type=given_path, required=True, metavar="FOLDER", help="as for calibrate")
    parser.add_argument(
        "--given", type=checks.read_number, default=1.0, metavar="S", help="s that are shown of each swim (default 1)"
    )
    parser.add_argument(
        "--frequency", type=checks.read_number, default=0.0, metavar="HZ", help="stated beat: another clock is refused"
    )
    parser.add_argument("--page", type=given_path, metavar="FILE", help="draw measured against predicted, .png or .pdf")
    parser.add_argument("--json", action="store_true", help="the errors as JSON instead of a table")
    return parser


def _stated(given: argparse.Namespace, knots: Sequence[float]) -> float:
    """Return the beat that swims must have: as stated, or the middle of those that the fish was fitted with, Hz."""
    if given.frequency:
        return checks.number("--frequency", given.frequency, 0.01, 100.0, unit="Hz")
    known = sorted(each for each in knots if each > 0.0)
    return known[len(known) // 2] if known else 0.0


def _run(given: argparse.Namespace) -> int:
    if given.page:
        check_picture(given.page)
        check_output(given.page)
    shown = checks.number("--given", given.given, 0.3, SHORTEST - LAST, unit="s")  # none of what is judged by
    model = read_fish(given.fish)
    read = read_folder(given.swims)
    with text_file.named(given.swims):
        swims, notes = usable(read, _stated(given, model.knots.frequency))
    for note in notes:
        sys.stderr.write(f"note: {note}\n")
    if not swims:
        msg = f"{given.swims} holds no swim that can be used"
        raise ValueError(msg)
    from fin_optimizer.calibration.errors import KINDS, errors, medians_and_90  # noqa: PLC0415
    from fin_optimizer.calibration.model import Tank  # noqa: PLC0415
    from fin_optimizer.calibration.prediction import predict  # noqa: PLC0415

    tank = Tank(model)
    predictions = [predict(tank, swim, shown) for swim in swims]
    found = [errors(swim, predicted, shown) for swim, predicted in zip(swims, predictions, strict=True)]
    if given.json:
        rows = [
            {
                "name": swim.name,
                "amplitude": swim.amplitude,
                "bias": swim.bias,
                **{kind: getattr(each, kind) for kind in KINDS},
            }
            for swim, each in zip(swims, found, strict=True)
        ]
        sys.stdout.write(json.dumps({**medians_and_90(found), "swims": rows}, indent=2) + "\n")
    else:
        _table([swim.name for swim in swims], found, shown)
    if given.page:
        from fin_optimizer.calibration.page import draw_page  # noqa: PLC0415

        failure = try_to_draw(given.page, lambda: draw_page(given.page, swims, predictions, shown))
        sys.stderr.write(f"note: {failure}\n" if failure else f"wrote {given.page}\n")
    return 0


def _table(names: Sequence[str], found: Sequence[Errors], given: float) -> None:
    from fin_optimizer.calibration.errors import KINDS, medians_and_90, shown  # noqa: PLC0415

    width = max(len("90th percentile"), *map(len, names))
    sys.stdout.write(f"first {given:g} s given\n{'swim'.ljust(width)}  speed   turning  position\n")
    told = medians_and_90(found)
    rows = [(name, [getattr(each, kind) for kind in KINDS]) for name, each in zip(names, found, strict=True)]
    for name, key in (("median", "median"), ("90th percentile", "p90")):
        rows.append((name, [told[key][kind] for kind in KINDS]))
    for name, values in rows:
        cells = (
            ("-" if value is None or math.isnan(value) else shown(kind, value)).rjust(_WIDTHS[kind])
            for kind, value in zip(KINDS, values, strict=True)
        )
        sys.stdout.write(f"{name.ljust(width)}  {'  '.join(cells)}\n")


@command("predict")
def main(arguments: Sequence[str] | None = None) -> int:
    """Predict; return 0, 2 for input that cannot be used, 130 for Ctrl-C."""
    return _run(_parser().parse_args(arguments))


if __name__ == "__main__":
    sys.exit(main())
