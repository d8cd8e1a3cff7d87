"""Command ``export``: a study as CSV and Parquet, one row a trial, the units in the header."""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from fin_optimizer.study.candidate import candidates
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.report import measures_of, varied
from fin_optimizer.words import SPEED, with_unit
from fin_plant.command import command
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.settings import Settings

CSV_FILE = "study.csv"
PARQUET_FILE = "study.parquet"
Column = tuple[str, str, "Callable[[TrialRecord, Candidate], object]"]


def columns(settings: Settings, trials: Sequence[TrialRecord]) -> list[Column]:
    """Return name with unit, Arrow type, and value of every column of a study's table."""
    names = varied(settings, [trial.values for trial in trials])
    told = [settings.told(trial.values) for trial in trials]
    texts = {name for name in names if any(isinstance(fin[name], str | list) for fin in told)}
    fin = [(with_unit(name), "string" if name in texts else "double", _value_of(settings, name)) for name in names]
    return [
        ("trial", "int64", lambda trial, _: trial.number),
        ("fin", "int64", lambda trial, _: trial.candidate + 1),
        *fin,
        ("outcome", "string", lambda trial, _: trial.outcome.value),
        (SPEED, "double", lambda trial, _: trial.score),
        ("spread within the swim [m/s]", "double", lambda trial, _: trial.spread),
        *((each.column, "double", _measured(each.name)) for each in measures_of(settings)),
        ("samples", "int64", lambda trial, _: trial.samples or None),
        ("mean speed of the fin [m/s]", "double", lambda _, candidate: candidate.score),
        ("spread between its repeats [m/s]", "double", lambda _, candidate: candidate.spread),
        *([("misses", "string", _missed)] if settings.goals.constraints else []),
        ("started [UTC]", "timestamp[us, tz=UTC]", lambda trial, _: trial.started),
        ("ended [UTC]", "timestamp[us, tz=UTC]", lambda trial, _: trial.ended),
        ("plant", "string", lambda trial, _: trial.plant),
        ("bag", "string", lambda trial, _: trial.bag),
        ("reason", "string", lambda trial, _: trial.reason),
    ]


def _measured(name: str) -> Callable[[TrialRecord, Candidate], object]:
    return lambda trial, _: trial.measured.get(name)


def _missed(_: TrialRecord, candidate: Candidate) -> str:
    return "; ".join(candidate.missed)


def _value_of(settings: Settings, name: str) -> Callable[[TrialRecord, Candidate], object]:
    def value(trial: TrialRecord, _: Candidate) -> object:
        found = settings.told(trial.values)[name]
        return repr(found) if isinstance(found, list) else found

    return value


def export(study: Path, folder: Path) -> list[Path]:
    """Write the tables of the study in a folder; return what was written, older files of that name replaced.

    Args:
        study: Folder of the study, which is only read; an optimiser may be working on it.
        folder: Where the tables go; it is made.

    Raises:
        StudyError: There is no study, or this version cannot read it.
        OSError: The tables cannot be written.
    """
    # A third of a second and 150 MB of memory, which only an export spends.
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import csv, parquet  # noqa: PLC0415

    settings, trials = read_settings(study), read_trials(study)
    tried = {candidate.number: candidate for candidate in candidates(trials, settings.goals)}
    wanted = columns(settings, trials)
    types = {"timestamp[us, tz=UTC]": pa.timestamp("us", "UTC")}
    table = pa.table(
        [
            pa.array([value(t, tried[t.candidate]) for t in trials], types.get(kind) or pa.type_for_alias(kind))
            for _, kind, value in wanted
        ],
        names=[name for name, _, _ in wanted],
    ).replace_schema_metadata({f"study.{name}": str(value) for name, value in settings.flat().items()})
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, write in ((CSV_FILE, csv.write_csv), (PARQUET_FILE, parquet.write_table)):
        partial = folder / (name + ".partial")
        write(table, str(partial))
        written.append(partial.replace(folder / name))
    return written


@command("export")
def main(arguments: Sequence[str] | None = None) -> int:
    """Export a study; return 0, or 2 if it cannot be."""
    if arguments is None:
        # Optuna turns the journal's times into local ones, which cannot tell the hour that a change of clocks repeats.
        os.environ["TZ"] = "UTC"
        time.tzset()
    parser = argparse.ArgumentParser(
        prog="export",
        description=f"Write a study as {CSV_FILE} and {PARQUET_FILE}: one row a trial, units in the header.",
    )
    parser.add_argument("study", type=given_path, metavar="STUDY", help="folder of the study")
    parser.add_argument(
        "--into", type=given_path, metavar="FOLDER", help="where the tables go; the study's folder if left out"
    )
    given = parser.parse_args(arguments)
    written = export(given.study, given.into or given.study)
    sys.stdout.writelines(f"{path}\n" for path in written)
    return 0


if __name__ == "__main__":
    sys.exit(main())
