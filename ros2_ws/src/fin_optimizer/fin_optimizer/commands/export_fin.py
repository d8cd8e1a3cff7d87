"""Command ``export_fin``: the fin to cut, of a study or of given sizes, as DXF, SVG and PDF at 1:1."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.cutting.blank import MM, Clamp, blank
from fin_optimizer.cutting.layers import ROOM_FOR_MEASURES
from fin_optimizer.cutting.sheet import Layout, fitting, nested
from fin_optimizer.search.names import STOCK
from fin_optimizer.study.candidate import candidates, rank
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.records import read_trials
from fin_optimizer.words import show_speed, trial_name
from fin_plant import checks
from fin_plant.command import command
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.paths import given_path
from fin_plant.units import quantity
from fin_plant.whole_file import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_optimizer.cutting.blank import Blank
    from fin_optimizer.study.candidate import Candidate
    from fin_optimizer.study.settings import Settings
    from fin_plant.parameters import Value

_SHAPE = ("fin.length", "fin.height", "fin.tip_height", "fin.profile_position", "fin.profile_height", "fin.thickness")
_GAP = 5.0


@dataclass(frozen=True)
class Wanted:
    """A fin that is to be cut: its label without sizes, and the edges in mm of its sheet, if they are known."""

    fin: Fin
    words: tuple[str, ...]
    sheet: tuple[float, ...] = ()

    def blank(self, clamp: Clamp) -> Blank:
        """Return its piece."""
        fin = self.fin
        size = f"{fin.length / MM:.4g} x {fin.largest_height / MM:.4g} x {fin.thickness / MM:.4g} mm"
        return blank(fin, clamp, (*self.words, size))


def of_study(settings: Settings, tried: Sequence[Candidate], trials: Sequence[int], best: int) -> list[Wanted]:
    """Return the fins of these trials or, without any, the ``best`` fastest ones.

    Raises:
        ValueError: There is no such trial, no score, or the study does not tell the fins' heights.
    """
    if trials:
        by_trial = {trial.number: candidate for candidate in tried for trial in candidate.trials}
        for number in trials:
            if number not in by_trial:
                last = f"its last one is {trial_name(max(by_trial))}" if by_trial else "it has none yet"
                msg = f"the study has no {trial_name(number)}: {last}"
                raise ValueError(msg)
        chosen = [(trial_name(number), by_trial[number]) for number in trials]
    else:
        scored = sorted((c for c in tried if c.score is not None), key=rank, reverse=True)
        if not scored:
            msg = "no trial has a score yet, so there is no best fin: name one by its number with --trial"
            raise ValueError(msg)
        chosen = [(trial_name(candidate.trials[0].number), candidate) for candidate in scored[:best]]
    return [_of_candidate(settings, name, candidate) for name, candidate in chosen]


def _of_candidate(settings: Settings, name: str, candidate: Candidate) -> Wanted:
    fin = settings.fin_of(candidate.values)
    if "fin.height" not in fin:
        msg = "this study of an older version does not tell its fins' heights: give them, for example fin.height=25mm"
        raise ValueError(msg)
    speed = "" if candidate.score is None else f", {show_speed(candidate.score)}"
    words = [f"{name}{speed}"]
    sheet: tuple[float, ...] = ()
    if STOCK in candidate.values and settings.rules is not None:
        kept = settings.rules.stock[str(candidate.values[STOCK])]
        words.append(kept.name)
        sheet = tuple(edge / MM for edge in kept.size)
    return Wanted(Fin.from_parameters(fin), tuple(words), sheet)


def of_sizes(texts: Sequence[str]) -> Wanted:
    """Return the fin of ``NAME=VALUE`` with units, all else as the default fin has it.

    Raises:
        ValueError: An unknown name or a value that is refused.
    """
    values: dict[str, Value] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in _SHAPE:
            msg = f"{text!r} is no size of a fin: write NAME=VALUE with one of {', '.join(_SHAPE)}"
            raise ValueError(msg)
        table = FIN_PARAMETERS[name]
        several = [quantity(name, part, table.unit) for part in value.split(",")]
        values[name] = several if table.kind == "double_array" else several[0]
        if table.kind != "double_array" and len(several) > 1:
            msg = f"{text!r} has {len(several)} values, {name} has one"
            raise ValueError(msg)
    if "fin.height" in values:
        values.setdefault("fin.tip_height", values["fin.height"])
    return Wanted(Fin.from_parameters(values), ())


def read_sheet(text: str) -> tuple[float, float]:
    """Return the edges in mm of ``210x297`` or ``21cm x 29.7cm``; numbers without a unit are mm.

    Raises:
        ValueError: Another form.
    """
    edges = text.lower().split("x")
    if len(edges) != 2:  # noqa: PLR2004
        msg = f"sheet {text!r} must read LENGTHxWIDTH, for example 210x297 or 21cm x 29.7cm"
        raise ValueError(msg)
    length, width = (read_millimetres("sheet", edge) for edge in edges)
    return length, width


def read_millimetres(name: str, text: str) -> float:
    """Return mm of a number, which is in mm, or of a length with its unit.

    Raises:
        ValueError: It is neither.
    """
    try:
        return checks.read_number(text)
    except ValueError:
        return quantity(name, text, "m") / MM


def laid_out(wanted: Sequence[Wanted], clamp: Clamp, sheet: tuple[float, float] | None, gap: float) -> Layout:
    """Return the fins on the sheet that is given, else on the one of the stock that they come from, else side by side.

    Raises:
        ValueError: They do not fit.
    """
    blanks = [each.blank(clamp) for each in wanted]
    if sheet is not None:
        return nested(blanks, sheet, gap)
    stock = {each.sheet for each in wanted}
    if len(blanks) == 1 or len(stock) > 1 or not (size := stock.pop()):
        return fitting(blanks, max(gap, ROOM_FOR_MEASURES) if len(blanks) == 1 else gap)
    long, short = max(size), min(size)
    try:
        return nested(blanks, (long, short), gap)
    except ValueError:
        return nested(blanks, (short, long), gap)


def written(layout: Layout, paths: Sequence[Path]) -> list[Path]:
    """Write the drawings, each whole or not at all; return them.

    Raises:
        OSError: One cannot be written.
        ValueError: An ending that is unknown, or a layout that is too large for a page; then none is written.
    """
    from fin_optimizer.cutting import dxf, pdf, svg  # noqa: PLC0415  (matplotlib, ezdxf: what a drawing alone needs)

    writers: dict[str, Callable[[Path, Layout], None]] = {
        ".dxf": dxf.write_dxf,
        ".svg": svg.write_svg,
        ".pdf": pdf.write_pdf,
    }
    for path in paths:
        if path.suffix.lower() not in writers:
            msg = f"{path}: a drawing's name must end in {', '.join(writers)}"
            raise ValueError(msg)
        if path.suffix.lower() == ".pdf":
            pdf.paper_for(layout)
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write(path, writers[path.suffix.lower()], layout)
    return list(paths)


def _write(path: Path, write: Callable[[Path, Layout], None], layout: Layout) -> None:
    write_whole(path, lambda part: write(part, layout))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="export_fin",
        description="Draw the fin to cut: outline, a tab for the clamp, and the line behind which it swims.",
        epilog="For example: export_fin study; export_fin study --best 6 --sheet 210x297 --out sheet.dxf; "
        "export_fin fin.length=96mm fin.height=21mm fin.thickness=0.35mm --out fin.pdf. "
        "Several fins all lie alike, because a sheet need not be equally stiff along and across.",
    )
    parser.add_argument(
        "what", nargs="+", metavar="STUDY | NAME=VALUE", help=f"folder of a study, or sizes: {', '.join(_SHAPE)}"
    )
    parser.add_argument(
        "--trial",
        type=checks.read_whole_number,
        action="append",
        default=[],
        metavar="N",
        help="of this trial, again for more",
    )
    parser.add_argument(
        "--best", type=checks.read_whole_number, default=1, metavar="N", help="the N fastest fins, 1 if left out"
    )
    parser.add_argument(
        "--out",
        type=given_path,
        action="append",
        metavar="FILE",
        help="ends in .dxf, .svg or .pdf, again for more; "
        "fin.dxf, fin.svg and fin.pdf in the study's folder, or here, if left out",
    )
    parser.add_argument(
        "--clamp",
        default="10",
        metavar="LENGTH",
        help="of the tab beyond the root; 10 mm if left out",
    )
    parser.add_argument(
        "--holes", type=checks.read_whole_number, default=0, metavar="N", help="through the tab; none if left out"
    )
    parser.add_argument("--hole-diameter", default="3", metavar="LENGTH", help="3 mm if left out")
    parser.add_argument("--sheet", metavar="LxW", help="to cut from, along the fins first: 297x210")
    parser.add_argument("--gap", default=f"{_GAP:g}", metavar="LENGTH", help=f"around each; {_GAP:g} mm if left out")
    return parser


def _wanted(given: argparse.Namespace) -> tuple[list[Wanted], Path]:
    """Return the fins and the folder into which their drawings go by default."""
    if all("=" in text for text in given.what):
        return [of_sizes(given.what)], Path()
    if len(given.what) > 1:
        msg = f"{' '.join(given.what)}: give one study, or sizes as NAME=VALUE"
        raise ValueError(msg)
    study = given_path(given.what[0])
    checks.whole_number("best", given.best, 1)
    return of_study(read_settings(study), candidates(read_trials(study)), given.trial, given.best), study


@command("export_fin")
def main(arguments: Sequence[str] | None = None) -> int:
    """Draw fins; return 0, or 2 if that cannot be."""
    given = _parser().parse_args(arguments)
    clamp = Clamp(
        read_millimetres("clamp", given.clamp), given.holes, read_millimetres("hole diameter", given.hole_diameter)
    )
    wanted, folder = _wanted(given)
    sheet = None if given.sheet is None else read_sheet(given.sheet)
    layout = laid_out(wanted, clamp, sheet, read_millimetres("gap", given.gap))
    paths = given.out or [folder / f"fin{ending}" for ending in (".dxf", ".svg", ".pdf")]
    done = written(layout, paths)
    for piece in layout.pieces:
        sys.stdout.write(f"{', '.join(piece.blank.label)}\n")
    sys.stdout.writelines(f"drawing: {path}\n" for path in done)
    return 0


if __name__ == "__main__":
    sys.exit(main())
