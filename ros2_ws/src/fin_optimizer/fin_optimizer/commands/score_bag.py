"""Command ``score_bag``: the score of recorded trials, equal to the live run's to the last digit."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import sys
from typing import TYPE_CHECKING

from fin_optimizer.bags.files import bags_in
from fin_optimizer.bags.integrity import UNGUARDED
from fin_optimizer.bags.messages import BagError, without_name
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.mean_speed import Measurement, MissingMeasurementError, ScoreError
from fin_optimizer.score.recorded import achieved
from fin_optimizer.study.file_names import JOURNAL_FILE, SETTINGS_FILE
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.resume_check import difference
from fin_optimizer.words import SPEED, SPREAD, trial_name, with_unit
from fin_plant import checks
from fin_plant.command import command, tell_error
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.study.candidate import TrialRecord

    _Scored = tuple[Path, Mapping[str, float], Mapping[str, str]]
    """A bag, what its trial achieved by name and unit, and its metadata."""


@command("score_bag")
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the score of each bag; return 0, or 2 if one has none that should have one.

    Of a study, the bags of trials without a score are told and left out, and the other scores must be the journal's.
    """
    parser = _parser()
    words = parser.parse_args(arguments)
    as_table = words.csv or words.json
    rows: list[_Scored] = []
    measured = _measured(words.settle, words.duration, parser)
    failed = False
    heads: list[str] = []
    without_sums: list[bool] = []
    for given in words.paths:
        try:
            wanted, refused = _wanted(given)
        except BagError as error:
            failed = _tell(given, error)
            continue
        if refused:
            tell_error("score_bag", refused)
            failed = True
        for path, trial in wanted:
            try:
                bag = _read(path, trial)
                numbers = achieved(bag, measured)
            except MissingMeasurementError as error:
                failed = _tell(path, f"{error}; --settle and --duration say it")
                continue
            except (BagError, ScoreError) as error:
                failed = _tell(path, error)
                continue
            _tell_unclosed(path, bag)
            rows.append((path, numbers, bag.metadata))
            if not as_table:
                heads = _print_line(path, numbers, heads)
            if trial is not None and (differs := difference(numbers, trial)):
                failed = _tell(path, differs)
            without_sums.append(not bag.guarded)
    sys.stdout.write(_tables(rows, words))
    _tell_unguarded(without_sums)
    return 2 if failed else 0


def _tables(scored: Sequence[_Scored], words: argparse.Namespace) -> str:
    """Return the table that was asked for, or an empty text."""
    if words.json:
        return _as_json(_table(scored))
    return _as_csv(_table(scored)) if words.csv else ""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="score_bag",
        description="Print one line a recorded trial, or a table with heads: mean forward speed [m/s], its spread "
        "[m/s], in a study of it the energy per metre [J/m], and the bag.",
    )
    parser.add_argument(
        "paths", nargs="+", type=given_path, metavar="PATH", help="a bag, its .mcap file, a folder of bags, or a study"
    )
    parser.add_argument(
        "--settle",
        type=checks.read_number,
        metavar="S",
        help="time from the gait's start to the window, of bags that do not say it",
    )
    parser.add_argument("--duration", type=checks.read_number, metavar="S", help="length of the window, likewise")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="a table with units in its head, and each number that varies")
    form.add_argument("--json", action="store_true", help="the same as JSON, null for what is not known")
    return parser


def _print_line(path: Path, numbers: Mapping[str, float], heads: list[str]) -> list[str]:
    """Print a bag's numbers, on a terminal below their heads where these are not ``heads``; return the heads."""
    if sys.stdout.isatty() and heads != [*numbers]:  # a program that reads the numbers knows what they are
        sys.stdout.write(f"{' '.join(f'{head:<20}' for head in numbers)} bag\n")
    sys.stdout.write(f"{' '.join(map(repr, numbers.values()))} {path}\n")
    return [*numbers]


def _table(scored: Sequence[_Scored]) -> list[dict[str, object]]:
    """Return a row a bag by heads with units: the fin's parameters that differ among the bags, and what it achieved."""
    told = dict.fromkeys(name for _, _, metadata in scored for name in metadata if name in FIN_PARAMETERS)
    varied = [name for name in told if len({metadata.get(name) for _, _, metadata in scored}) > 1]
    heads = {name: with_unit(name) for name in varied}
    measured = dict.fromkeys(name for _, numbers, _ in scored for name in numbers)
    return [
        {
            "bag": str(path),
            **{head: _value(metadata.get(name)) for name, head in heads.items()},
            **{name: numbers.get(name) for name in measured},
        }
        for path, numbers, metadata in scored
    ]


def _value(text: str | None) -> object:
    """Return a parameter that a bag's metadata tell: a number where it is one."""
    try:
        return None if text is None else json.loads(text)
    except ValueError:
        return text


def _as_csv(table: Sequence[Mapping[str, object]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, table[0] if table else ["bag", SPEED, SPREAD], lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def _as_json(table: Sequence[Mapping[str, object]]) -> str:
    known = [{n: None if isinstance(v, float) and math.isnan(v) else v for n, v in row.items()} for row in table]
    return json.dumps(known, indent=1, allow_nan=False) + "\n"


def _measured(settle: float | None, duration: float | None, parser: argparse.ArgumentParser) -> dict[str, str]:
    """Return what the command line says of the window, as a bag's metadata would."""
    if settle is None and duration is None:
        return {}
    if settle is None or duration is None:
        parser.error("--settle and --duration go together: one alone does not say which part of the swim counts")
    try:
        return Measurement(settle, duration).metadata()
    except ValueError as error:
        parser.error(str(error))


def _read(path: Path, trial: TrialRecord | None) -> Bag:
    """Return a bag, which an OK trial must have."""
    if trial is not None and not path.exists():
        msg = f"{trial_name(trial.number)} is OK, but its bag is missing"
        raise BagError(msg)
    return read_bag(path)


def _tell_unclosed(path: Path, bag: Bag) -> None:
    if not bag.complete:
        count = sum(bag.counts.values())
        sys.stderr.write(f"note: {path} was not closed; scored from the {count} messages that it holds\n")


def _tell_unguarded(bags: Sequence[bool]) -> None:
    """Note how many of the bags, each of which is one or not, have no check sums."""
    if count := sum(bags):
        sys.stderr.write(f"note: {count} of {len(bags)} bags {'was' if count == 1 else 'were'} {UNGUARDED}\n")


def _tell(path: Path, error: object) -> bool:
    """Tell why a bag has no score."""
    tell_error("score_bag", f"{path}: {without_name(error, path)}")
    return True


def _wanted(path: Path) -> tuple[list[tuple[Path, TrialRecord | None]], str]:
    """Return the bags to score, those of a study with their trials, and why its journal is none, or an empty text.

    Those that need no score are told.

    Raises:
        BagError: There is none.
    """
    bags = list(bags_in(path)) if path.is_dir() else [path]
    # After the bags: of each bag of a study that is under way the journal has the trial.
    trials, refused = _trials(path)
    scored = [bag for bag, trial in trials.items() if trial.score is not None]
    wanted = []
    for bag in sorted({*bags, *scored}):
        trial = trials.get(bag)
        if trial is None or trial.score is not None:
            wanted.append((bag, trial))
        else:
            because = f" ({trial.reason})" if trial.reason else ""
            sys.stderr.write(f"note: {bag}: {trial_name(trial.number)} is {trial.outcome.value}{because}\n")
    return wanted, refused


def _trials(path: Path) -> tuple[dict[Path, TrialRecord], str]:
    """Return the trials of a study by their bags, and why its journal cannot be read; nothing if it is no study."""
    if not (path / JOURNAL_FILE).exists() and not (path / SETTINGS_FILE).exists():
        return {}, ""
    # Optuna takes a third of a second, which only a study's scores spend.
    from fin_optimizer.study.records import read_trials  # noqa: PLC0415

    try:
        return {path / trial.bag: trial for trial in read_trials(path)}, ""
    except (StudyError, OSError) as error:
        return {}, f"{error}: every bag of {path} is scored"


if __name__ == "__main__":
    sys.exit(main())
