"""Whether a study's scores still follow from its bags, looked at when the study is gone on with.

To score a bag takes some hundredths of a second, so a long study is not compared as a whole: first come the bags that
were written to after their trial had ended, then the newest.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.goals import MEASURES
from fin_optimizer.score.mean_speed import ScoreError
from fin_optimizer.score.recorded import achieved
from fin_optimizer.study.file_names import JOURNAL_FILE
from fin_optimizer.words import SPREAD, trial_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.study.candidate import TrialRecord

LONGEST = 5.0
"""s that a person waits for it at most."""
_NAMED = 5
"""Trials that are named one by one."""
_ALLOWANCE = 2.0
"""s between a trial's end in the journal and its bag's last change: the bag is closed before, file systems round."""


def check_scores(
    folder: Path, trials: Sequence[TrialRecord], longest: float = LONGEST, clock: Callable[[], float] = time.monotonic
) -> list[str]:
    """Return notes on the OK trials whose bag is missing, cannot be scored, or gives another score than the journal.

    Args:
        folder: Of the study.
        trials: All of them.
        longest: s after which no further bag is scored.
        clock: Time in s.
    """
    scored = [trial for trial in trials if trial.score is not None]
    there = [trial for trial in scored if (folder / trial.bag).is_dir()]
    notes = []
    if missing := len(scored) - len(there):
        notes.append(f"{missing} of {len(scored)} OK trials have no bag any more: their scores cannot be checked")
    there.sort(key=lambda trial: (_is_changed(folder, trial), trial.number), reverse=True)
    end = clock() + longest
    wrong = []
    for compared, trial in enumerate(there):
        if clock() >= end:
            notes.append(
                f"{compared} of {len(there)} scores were compared with their bags in {longest:g} s; "
                "score_bag of the study compares all"
            )
            break
        if why := _contradiction(folder / trial.bag, trial):
            wrong.append(f"{trial_name(trial.number)}: its score does not follow from its bag any more: {why}")
    if len(wrong) > _NAMED:
        wrong[_NAMED:] = [f"{len(wrong) - _NAMED} more scores do not follow from their bags: score_bag names all"]
    return wrong + notes


def _contradiction(bag: Path, trial: TrialRecord) -> str:
    try:
        numbers = achieved(read_bag(bag))
    except (BagError, ScoreError) as error:
        return str(error)
    return difference(numbers, trial)


def difference(numbers: Mapping[str, float], trial: TrialRecord) -> str:
    """Return which of a bag's numbers is not the one that its study has, or an empty text."""
    known = {SPREAD: trial.spread, **{MEASURES[name].column: value for name, value in trial.measured.items()}}
    differs = [name for name, value in numbers.items() if known.get(name) is not None and known[name] != value]
    said = ", ".join(
        f"{name} is {numbers[name]!r} from the bag and {known[name]!r} in {JOURNAL_FILE}" for name in differs
    )
    return said and f"{said}: one of them was changed, or another version scored it"


def _is_changed(folder: Path, trial: TrialRecord) -> bool:
    """Whether a file of its bag was written after the trial had ended."""
    try:
        newest = max((file.stat().st_mtime for file in (folder / trial.bag).iterdir()), default=0.0)
    except OSError:
        return True
    return trial.ended is None or newest > trial.ended.timestamp() + _ALLOWANCE
