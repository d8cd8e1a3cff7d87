"""Command ``calibrate``: a laboratory's own fish, fitted to the swims that it recorded."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import TYPE_CHECKING, cast

from fin_optimizer.calibration.recorded import read_folder
from fin_optimizer.calibration.settings import read_settings
from fin_optimizer.calibration.swims import FEWEST_SWIMS, usable
from fin_plant import checks, text_file
from fin_plant.command import command
from fin_plant.figures import check_picture, try_to_draw
from fin_plant.paths import check_output, config_folder, given_path
from fin_plant.whole_file import write_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from fin_optimizer.calibration.errors import Errors
    from fin_optimizer.calibration.fit import Fit
    from fin_optimizer.calibration.settings import Settings
    from fin_optimizer.calibration.swims import Swim

SETTINGS = "calibrate_tail_actuated_fish.yaml"
GROUPS: dict[str, Callable[[Swim], object]] = {
    "amplitude": lambda swim: round(swim.amplitude, 6),
    "bias": lambda swim: round(swim.bias, 6),
    "condition": lambda swim: swim.condition,
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calibrate",
        description="Fit the uncertain parameters of a fish to recorded swims; say how sure they are.",
        epilog="Swims are CSV files named amplitude<degrees>_bias<degrees>_<run>.csv with the columns t, v_forward, "
        "v_lateral, yaw_rate, heading and, where tracked, x and y, in SI units and radians, or bags of trials.",
        allow_abbrev=False,
    )
    parser.add_argument("--swims", type=given_path, required=True, metavar="FOLDER", help="the recorded swims")
    parser.add_argument(
        "--settings", type=given_path, metavar="FILE", help=f"what is fitted, YAML (default: {SETTINGS} of the package)"
    )
    parser.add_argument("--out", type=given_path, metavar="FILE", help="write the fitted fish, a parameter file")
    parser.add_argument("--page", type=given_path, metavar="FILE", help="draw measured against predicted, .png or .pdf")
    parser.add_argument(
        "--fix", action="append", default=[], metavar="NAME=VALUE", help="known by a ruler or a scale: not fitted"
    )
    parser.add_argument(
        "--leave-out", choices=sorted(GROUPS), help="fit again without each and predict it: how far the fish is right"
    )
    parser.add_argument(
        "--seed", type=checks.read_whole_number, default=0, metavar="N", help="of the starts (default 0)"
    )
    parser.add_argument(
        "--starts", type=checks.read_whole_number, default=4, metavar="N", help="fits from other places (default 4)"
    )
    return parser


def _fixed(texts: Sequence[str]) -> dict[str, float]:
    result = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            result[name.strip()] = checks.read_number(value.strip())
        except ValueError:
            msg = f"--fix {text!r} must be NAME=VALUE, the value a number in SI units"
            raise ValueError(msg) from None
    return result


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _report(found: Fit) -> None:
    width = max(map(len, found.names))
    _say(f"{'fitted'.ljust(width)}  value      one standard error")
    for row in zip(found.names, found.values, found.low, found.high, strict=True):
        _say(f"{row[0].ljust(width)}  {row[1]:<9.4g}  {row[2]:.4g} to {row[3]:.4g}")
    names, together = found.names, found.correlations
    pairs = sorted(
        ((abs(together[i, j]), i, j) for i in range(len(names)) for j in range(i)), key=lambda pair: -pair[0]
    )
    if pairs:
        _say("strongest correlations of the errors:")
    for _, i, j in pairs[:5]:
        _say(f"  {together[i, j]:+.2f}  {names[j]}, {names[i]}")
    for doubt in found.doubts:
        _say(f"note: {doubt}")


def _errors_line(title: str, all_errors: Sequence[Errors]) -> str:
    """Return one line on many predictions: medians, 90th percentiles in brackets."""
    from fin_optimizer.calibration.errors import KINDS, medians_and_90, shown  # noqa: PLC0415

    told = medians_and_90(all_errors)
    parts = []
    for kind in KINDS:
        middle, high = told["median"][kind], told["p90"][kind]
        if middle is not None and high is not None:
            parts.append(f"{kind.replace('_', ' ')} {shown(kind, middle, high)}")
    return f"{title}: {', '.join(parts)}"


def _left_out(kind: str, swims: Sequence[Swim]) -> list[str]:
    """Return what each swim is left out with, in words.

    Raises:
        ValueError: Without one of them too few swims would be left to fit.
    """
    keys = [GROUPS[kind](swim) for swim in swims]
    for key in dict.fromkeys(keys):
        if (left := len(keys) - keys.count(key)) < FEWEST_SWIMS:
            without = ", ".join(swim.name for swim, own in zip(swims, keys, strict=True) if own == key)
            text = f"--leave-out {kind}: {checks.counted(left, 'swim')} would be left without {without}"
            msg = f"{text}; needed are {FEWEST_SWIMS}: record more, or leave the option out"
            raise ValueError(msg)
    if kind == "condition":
        names = {key: [s.name for s, own in zip(swims, keys, strict=True) if own == key] for key in keys}
        return [", ".join(names[key]) for key in keys]
    return [f"{cast('float', key):+.3g} rad" for key in keys]


def _leave_out(kind: str, keys: Sequence[str], swims: Sequence[Swim], settings: Settings, found: Fit) -> None:
    from fin_optimizer.calibration.left_out import SHOWN, predicted_without  # noqa: PLC0415

    everything: dict[float, list[Errors]] = {shown: [] for shown in SHOWN}
    _say(f"each {kind} predicted by a fish fitted without it; medians (90th percentiles) of its swims:")
    for key, known in predicted_without(swims, keys, settings, found):
        for shown, own in known.items():
            everything[shown].extend(own)
            _say(_errors_line(f"  {key}, first {shown:g} s given", own))
    for shown, own in everything.items():
        _say(_errors_line(f"  all, first {shown:g} s given", own))


def _check_outputs(given: argparse.Namespace) -> None:
    if given.page:
        check_picture(given.page)
    for path in filter(None, (given.out, given.page)):
        check_output(path)


def _write(path: Path, text: str) -> None:
    write_text(path, text)
    _say(f"wrote {path}")


def _run(given: argparse.Namespace, made_by: str) -> int:
    _check_outputs(given)
    checks.whole_number("--starts", given.starts, 1, 1000)
    checks.whole_number("--seed", given.seed)
    settings = read_settings(given.settings or config_folder("fin_optimizer") / SETTINGS)
    settings = settings.with_fixed(_fixed(given.fix))
    read = read_folder(given.swims)
    with text_file.named(given.swims):
        swims, notes = usable(read, settings.stated_frequency)
    for note in notes:
        _say(f"note: {note}")
    keys = _left_out(given.leave_out, swims) if given.leave_out else []
    # Half a second, which bad input is not kept waiting for.
    from fin_optimizer.calibration.fish_file import fish_file  # noqa: PLC0415
    from fin_optimizer.calibration.fit import fit  # noqa: PLC0415
    from fin_optimizer.calibration.model import Tank  # noqa: PLC0415
    from fin_optimizer.calibration.prediction import GIVEN, predict  # noqa: PLC0415

    found = fit(swims, settings, given.seed, given.starts, _say)
    _report(found)
    if given.out:
        _write(given.out, fish_file(found, [swim.name for swim in swims], made_by))
    if given.page:
        from fin_optimizer.calibration.page import draw_page  # noqa: PLC0415

        tank = Tank(found.model)
        predictions = [predict(tank, swim) for swim in swims]
        failure = try_to_draw(given.page, lambda: draw_page(given.page, swims, predictions, GIVEN, fitted=True))
        _say(f"note: {failure}" if failure else f"wrote {given.page}")
    if given.leave_out:
        _leave_out(given.leave_out, keys, swims, settings, found)
    return 0


@command("calibrate")
def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate; return 0, 2 for input that cannot be used, 130 for Ctrl-C."""
    given = _parser().parse_args(arguments)
    return _run(given, shlex.join(["calibrate", *(sys.argv[1:] if arguments is None else arguments)]))


if __name__ == "__main__":
    sys.exit(main())
