"""What a study found, as a table of all trials that a person and a spreadsheet read."""

from __future__ import annotations

import csv
import io
from datetime import UTC
from typing import TYPE_CHECKING, Any

from fin_optimizer.goals import ENERGY_PER_METRE, MEAN_SPEED, MEASURES
from fin_optimizer.words import SPREAD, with_unit
from fin_plant.whole_file import write_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from fin_optimizer.goals import Measure
    from fin_optimizer.study.candidate import TrialRecord
    from fin_optimizer.study.settings import Settings

CSV_FILE = "trials.csv"


def varied(settings: Settings, tried: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the parameters that differ among these candidates, those that are searched first in any case.

    A height at the tip that is always the height at the root is not told twice.
    """
    fins = [settings.told(values) for values in tried]
    names = list(settings.space.names)
    names += [
        name
        for name in dict.fromkeys(name for fin in fins for name in fin)
        if name not in names and any(fin[name] != fins[0][name] for fin in fins)
    ]
    follows = "fin.tip_height" in names and "fin.tip_height" not in settings.space.names
    if follows and all(fin["fin.tip_height"] == fin["fin.height"] for fin in fins):
        names.remove("fin.tip_height")
    return names


def measures_of(settings: Settings) -> list[Measure]:
    """Return what tables tell of a swim beside the mean speed: what is asked for, the energy per metre in any case."""
    names = [each.name for each in settings.goals.asked if each.name != MEAN_SPEED]
    return [MEASURES[name] for name in dict.fromkeys([ENERGY_PER_METRE, *names])]


def trials_table(trials: Sequence[TrialRecord], settings: Settings) -> str:
    """Return all trials as CSV, one row each, units in the header; what is not known is left empty.

    A trial has its number from 0, as in its bag's name; fins are counted from 1, as in the lines of progress.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = varied(settings, [trial.values for trial in trials])
    asked = measures_of(settings)
    measured = [MEASURES[MEAN_SPEED].column, SPREAD, *(each.column for each in asked), "samples"]
    times = ["started [UTC]", "ended [UTC]"]
    parameters = [with_unit(name) for name in names]
    writer.writerow(["trial", "fin", *parameters, "outcome", *measured, *times, "plant", "bag", "reason"])
    for trial in trials:
        fin = settings.told(trial.values)
        values = [fin[name] if isinstance(fin[name], str) else repr(fin[name]) for name in names]
        others = [_number(trial.measured.get(each.name)) for each in asked]
        measured = [_number(trial.score), _number(trial.spread), *others, str(trial.samples or "")]
        times = [_utc(trial.started), _utc(trial.ended)]
        last = [trial.plant, trial.bag, trial.reason]
        writer.writerow([trial.number, trial.candidate + 1, *values, trial.outcome.value, *measured, *times, *last])
    return text.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None else repr(value)


def _utc(time: datetime | None) -> str:
    return "" if time is None else time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write_table(path: Path, trials: Sequence[TrialRecord], settings: Settings) -> None:
    """Write `trials_table` to ``path``; an older file is replaced as a whole or not at all."""
    text = trials_table(trials, settings)
    write_text(path, text)
