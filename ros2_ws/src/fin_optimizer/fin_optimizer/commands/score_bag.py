"""Command ``score_bag``: the score of recorded trials, equal to the live run's to the last digit."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import sys
from types import MappingProxyType
from typing import TYPE_CHECKING

from fin_optimizer.bags.files import bags_in
from fin_optimizer.bags.integrity import UNGUARDED
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.joints import JOINT_STATE_TYPE
from fin_optimizer.score.mean_speed import (
    Measurement,
    MissingMeasurementError,
    Score,
    ScoreError,
)
from fin_optimizer.score.swim import SwimRecord, score_swim, start_of_swim
from fin_optimizer.study.journal import StudyError
from fin_optimizer.words import ENERGY_PER_METRE, SPEED, SPREAD, trial_name, with_unit
from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.output import end_when_output_closes
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.study.candidate import TrialRecord

    _Scored = tuple[Path, Mapping[str, float], Mapping[str, str]]
    """A bag, what its trial achieved by name and unit, and its metadata."""

_JOURNAL_FILE = "journal.log"  # as fin_optimizer.study.folder names it, which needs Optuna
_SETTINGS_FILE = "study.json"  # likewise
_OBJECTIVE_KEY, _OBJECTIVE_WITH_COST = "study.objective", "speed_and_cost_of_transport"  # likewise
_STATE_TYPE = "diagnostic_msgs/msg/DiagnosticStatus"


def swimming_since(bag: Bag) -> int:
    """Return the plant's time in ns at which the gait of a recorded trial started.

    Raises:
        BagError: The bag has no ``plant_state``, or is damaged.
        ScoreError: As `start_of_swim` says.
    """
    states = bag.decoded("plant_state", _STATE_TYPE)
    return start_of_swim((message for _, message in states), bag.metadata)


def score_bag(path: Path, measured: Mapping[str, str] = MappingProxyType({})) -> tuple[Score, Bag]:
    """Return the score of a recorded trial, and its bag.

    Args:
        path: The bag.
        measured: Entries of `Measurement.metadata` for a bag whose own metadata lack them: one of another program.

    Raises:
        BagError: There is no bag, it lacks a topic, or it is damaged.
        ScoreError: Its samples give no score.
    """
    bag = read_bag(path)
    return score_swim(recorded_swim(bag, measured, with_cost=False), with_cost=False)[0], bag


def energy_per_metre(bag: Bag) -> float | None:
    """Return the energy per metre of a recorded trial in J/m, None without headway.

    Raises:
        BagError: It lacks a topic, or is damaged.
        ScoreError: Its samples give no score, or no power.
    """
    return score_swim(recorded_swim(bag, {}, with_cost=True), with_cost=True)[1]


def recorded_swim(bag: Bag, measured: Mapping[str, str], *, with_cost: bool) -> SwimRecord:
    """Return what a bag holds of its swim.

    Args:
        bag: Of a trial, or of another program's swim.
        measured: Which part of the swim counts, if its metadata do not say so.
        with_cost: Whether it must have joint states.

    Raises:
        BagError: It lacks a topic, or is damaged.
    """
    states = [message for _, message in bag.decoded("plant_state", _STATE_TYPE)]
    told = any(topic.endswith("/joint_states") and kind == JOINT_STATE_TYPE for topic, kind in bag.topics.items())
    joints = bag.typed("joint_states", JOINT_STATE_TYPE) if with_cost or told else None
    return SwimRecord(bag.velocity(), states, joints, {**measured, **bag.metadata})


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the score of each bag; return 0, or 2 if one has none that should have one.

    Of a study, the bags of trials without a score are told and left out, and the other scores must be the journal's.
    """
    if arguments is None:
        end_when_output_closes()
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
            failed = _tell(f"{error}")
            continue
        if refused:
            failed = _tell(refused)
        for path, trial in wanted:
            try:
                numbers, bag = numbers_of(path, trial, measured)
            except MissingMeasurementError as error:
                failed = _tell(f"{path}: {error}; --settle and --duration say it")
                continue
            except (BagError, ScoreError) as error:
                failed = _tell(f"{path}: {error}")
                continue
            rows.append((path, numbers, bag.metadata))
            if not as_table:
                heads = _print_line(path, numbers, heads)
            if trial is not None and (differs := difference(numbers, trial)):
                failed = _tell(f"{path}: {differs}")
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


def _tell_unguarded(bags: Sequence[bool]) -> None:
    """Note how many of the bags, each of which is one or not, have no check sums."""
    if count := sum(bags):
        sys.stderr.write(f"note: {count} of {len(bags)} bags {'was' if count == 1 else 'were'} {UNGUARDED}\n")


def _tell(error: str) -> bool:
    sys.stderr.write(f"error: {error}\n")
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
    if not (path / _JOURNAL_FILE).exists() and not (path / _SETTINGS_FILE).exists():
        return {}, ""
    # Optuna takes a third of a second, which only a study's scores spend.
    from fin_optimizer.study.records import read_trials  # noqa: PLC0415

    try:
        return {path / trial.bag: trial for trial in read_trials(path)}, ""
    except (StudyError, OSError) as error:
        return {}, f"{error}: every bag of {path} is scored"


def numbers_of(
    path: Path, trial: TrialRecord | None, measured: Mapping[str, str] = MappingProxyType({})
) -> tuple[dict[str, float], Bag]:
    """Return what a bag's trial achieved, by name and unit, and the bag.

    Args:
        path: The bag.
        trial: Its OK trial, if it is known.
        measured: Which part of the swim counts, if its metadata do not say so.

    Raises:
        BagError: There is no bag, it lacks a topic, or it is damaged.
        ScoreError: Its samples give no score.
    """
    if trial is not None and not path.exists():
        msg = f"{trial_name(trial.number)} is OK, but its bag is missing"
        raise BagError(msg)
    bag = read_bag(path)
    with_cost = bag.metadata.get(_OBJECTIVE_KEY) == _OBJECTIVE_WITH_COST
    result, cost = score_swim(recorded_swim(bag, measured, with_cost=with_cost), with_cost=with_cost)
    if not bag.complete:
        count = sum(bag.counts.values())
        sys.stderr.write(f"note: {path} was not closed; scored from the {count} messages that it holds\n")
    numbers = {SPEED: result.value, SPREAD: result.spread}
    if with_cost:
        numbers[ENERGY_PER_METRE] = math.nan if cost is None else cost
    return numbers, bag


def difference(numbers: Mapping[str, float], trial: TrialRecord) -> str:
    """Return which of a bag's numbers is not the one that its study has, or an empty text."""
    known = {SPEED: trial.score, SPREAD: trial.spread, ENERGY_PER_METRE: trial.cost}
    differs = [name for name, value in numbers.items() if known[name] is not None and known[name] != value]
    said = ", ".join(
        f"{name} is {numbers[name]!r} from the bag and {known[name]!r} in {_JOURNAL_FILE}" for name in differs
    )
    return said and f"{said}: one of them was changed, or another version scored it"


if __name__ == "__main__":
    sys.exit(main())
