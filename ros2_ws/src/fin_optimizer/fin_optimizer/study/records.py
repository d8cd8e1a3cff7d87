"""What a study's journal tells: its trials, each as it should be, read from Optuna's storage; nothing is changed.

Outcomes are Optuna's states:

    PROPOSED WAITING, RUNNING RUNNING, OK COMPLETE, FAILED FAIL, INTERRUPTED FAIL, INFEASIBLE PRUNED

A trial that is FAIL to Optuna has an attribute that tells which of the two it is.
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any

import optuna

from fin_optimizer.study.candidate import TrialRecord
from fin_optimizer.study.checked_journal import WRONG_CONTENT, storage_of
from fin_optimizer.study.file_names import JOURNAL_FILE, SETTINGS_FILE
from fin_optimizer.study.folder import bags_in, read_settings, settings_and_sum
from fin_optimizer.study.journal import RESTORE, STUDY_NAME, JournalLines, StudyError
from fin_optimizer.study.settings import begun_by_default
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import trial_name

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from optuna.storages import JournalStorage

    from fin_optimizer.goals import Goals
    from fin_optimizer.search.space import Values
    from fin_optimizer.study.settings import Settings
    from fin_plant.parameters import Value

FISH = "fish"
"""Of the study in Optuna's ledger: what swims."""
REPEATED = "repeated"
"""Of the study in Optuna's ledger: numbers of trials that had ended when somebody asked for them to be swum again."""
ASKED_FOR_AGAIN = "~/repeat was called: swum again"
VALUES = "trial.values"
"""Of a bag's metadata: what was searched of the candidate, as JSON. Bags of older versions tell the fin alone."""

MEASURED = "measured"
"""Of a trial: what was measured beside the goals, by measure in SI."""
_KILLED = "the optimiser's process ended before the trial did"

STATE_OF = {
    Outcome.PROPOSED: optuna.trial.TrialState.WAITING,
    Outcome.RUNNING: optuna.trial.TrialState.RUNNING,
    Outcome.OK: optuna.trial.TrialState.COMPLETE,
    Outcome.FAILED: optuna.trial.TrialState.FAIL,
    Outcome.INTERRUPTED: optuna.trial.TrialState.FAIL,
    Outcome.INFEASIBLE: optuna.trial.TrialState.PRUNED,
}
_OUTCOME_OF = {state: outcome for outcome, state in STATE_OF.items() if outcome is not Outcome.INTERRUPTED}


def _tell(note: str) -> None:
    sys.stderr.write(f"note: {note}\n")


def read_trials(folder: Path, tell: Callable[[str], object] = _tell) -> list[TrialRecord]:
    """Return all trials of the study in a folder, also while an optimiser works on it; nothing is changed.

    Args:
        folder: Of the study.
        tell: Is called with each note on the journal that a user should know of; writes it to stderr if left out.

    Raises:
        StudyError: There is no journal, it was damaged or changed by another program, or this version cannot read it.
    """
    return read_ledger(folder, tell)[0]


def read_ledger(folder: Path, tell: Callable[[str], object] = _tell) -> tuple[list[TrialRecord], Mapping[str, object]]:
    """Return the trials of a study as `read_trials`, and what swam them as `Study.fish`; raises as that does."""
    if not (folder / JOURNAL_FILE).exists() and not list(bags_in(folder)):
        msg = f"{folder} holds no study: {JOURNAL_FILE} is missing"
        raise StudyError(msg)
    settings = read_settings(folder)
    storage, frozen, lines = read_checked(folder, settings)
    for note in lines.notes:
        tell(note)
    if length := lines.cut():
        tell(
            f"the journal's last entry is cut short ({length} bytes) and not counted; a kill or a running study does so"
        )
    repeated = repeated_in(storage) if lines.count else frozenset[int]()
    return [record_of(trial, settings.goals, repeated) for trial in frozen], fish_in(storage) if lines.count else {}


def earlier_defaults(folder: Path) -> dict[str, Value]:
    """Return what the study in a folder, or its fish, has because it was the default then; nothing of no study.

    Raises:
        StudyError: The study cannot be read.
    """
    if not (folder / SETTINGS_FILE).exists():
        return {}
    fish = read_ledger(folder, lambda _: None)[1] if (folder / JOURNAL_FILE).exists() else {}
    return begun_by_default({**read_settings(folder).details, **fish})


def fish_in(storage: JournalStorage) -> Mapping[str, object]:
    """Return what swims, as the journal has it; empty before the first fish is met."""
    known: Mapping[str, object] = _attributes(storage).get(FISH, {})
    return known


def repeated_in(storage: JournalStorage) -> frozenset[int]:
    """Return the numbers of the trials that somebody asked for again after they had ended."""
    return frozenset(_attributes(storage).get(REPEATED, ()))


def _attributes(storage: JournalStorage) -> Mapping[str, Any]:
    return storage.get_study_user_attrs(storage.get_study_id_from_name(STUDY_NAME))


def read_checked(
    folder: Path, settings: Settings
) -> tuple[JournalStorage, list[optuna.trial.FrozenTrial], JournalLines]:
    """Return Optuna's storage of a study, its trials, which are as they should be, and the journal's lines.

    Nothing is changed. A study that was just begun has an empty journal or none.

    Raises:
        StudyError: The journal cannot be read, or is not that of what else lies in the folder.
    """
    bags = sorted(bags_in(folder))  # before the journal: a trial is written there before its bag is made
    lines = JournalLines(folder / JOURNAL_FILE, settings_and_sum(folder)[1])
    storage = storage_of(lines)
    lines.check_end()
    trials = storage.get_all_trials(0, deepcopy=False) if lines.count else []
    try:
        _check_trials(trials, settings)
    except WRONG_CONTENT as error:
        what = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        msg = f"{lines.journal} is damaged or was changed by another program ({what}): {RESTORE}"
        raise StudyError(msg) from error
    beyond = [name for number, name in bags if number >= len(trials)]
    if beyond:
        lie = f"{len(beyond)} bags of later trials lie beside it ({beyond[0]} to {beyond[-1]})"
        if len(beyond) == 1:
            lie = f"the bag of a later trial lies beside it ({beyond[0]})"
        knows = f"knows {len(trials)} trials" if lines.count else "is empty" if lines.journal.exists() else "is missing"
        msg = f"{lines.journal} {knows}, but {lie}: {RESTORE}. To go on without those, move them elsewhere"
        raise StudyError(msg)
    return storage, trials, lines


def _check_trials(trials: Sequence[optuna.trial.FrozenTrial], settings: Settings) -> None:
    """Look at what a journal without check sums may have wrong; with them, nothing of that can be.

    Raises:
        ValueError: A trial that this program never wrote; also a KeyError, or what else wrong content leads to.
    """
    known: list[Values] = []
    for trial in trials:
        record = record_of(trial, settings.goals)
        where = trial_name(record.number)
        values = settings.space.check(record.values)
        number = record.candidate
        if type(number) is not int or not 0 <= number <= len(known):
            msg = f"{where} is of candidate {number!r}, which no trial before it leads to"
            raise ValueError(msg)
        if number == len(known):
            known.append(values)
        if known[number] != values:
            msg = f"{where} has other values than candidate {number} had before"
            raise ValueError(msg)
        if any(not isinstance(trial.user_attrs.get(name, ""), str) for name in ("bag", "reason", "plant")):
            msg = f"{where} has a bag, a reason or a plant that is no text"
            raise ValueError(msg)
        numbers = [*(trial.values or [])] if record.outcome is Outcome.OK else []
        if record.outcome is Outcome.OK and len(numbers) != len(settings.goals.measures):
            msg = f"{where} is OK with {len(numbers)} numbers, needed are {len(settings.goals.measures)}"
            raise ValueError(msg)
        lacks = [each.name for each in settings.goals.asked if each.name not in record.measured]
        if record.outcome is Outcome.OK and lacks:
            msg = f"{where} is OK without {', '.join(lacks)}"
            raise ValueError(msg)
        for value in (*numbers, *record.measured.values(), record.spread, record.samples):
            if value is not None and not math.isfinite(value):
                msg = f"{where} is OK with {value!r}, needed are finite numbers"
                raise ValueError(msg)


def record_of(trial: optuna.trial.FrozenTrial, goals: Goals, repeated: Collection[int] = ()) -> TrialRecord:
    """Return Optuna's trial as ours. One that failed without a reason was left open by a process that died.

    Args:
        trial: Optuna's, whose values are those of the goals; what else was measured is an attribute.
        goals: What the study looks for.
        repeated: Numbers of those whose outcome counts no more, since they were asked for again.
    """
    attributes: dict[str, Any] = trial.user_attrs
    outcome: Outcome = _OUTCOME_OF[trial.state]
    killed = outcome is Outcome.FAILED and "reason" not in attributes
    if killed or (outcome is Outcome.FAILED and attributes.get("interrupted", False)):
        outcome = Outcome.INTERRUPTED
    again = trial.number in repeated
    if again:
        outcome = Outcome.INTERRUPTED
    started, ended = trial.datetime_start, trial.datetime_complete
    measured: dict[str, float] = {}
    if outcome is Outcome.OK:
        measured = dict(zip((goal.name for goal in goals.measures), trial.values or [], strict=False))
        measured |= attributes.get(MEASURED, {})
    return TrialRecord(
        number=trial.number,
        candidate=attributes["candidate"],
        values=dict(trial.params),
        outcome=outcome,
        reason=ASKED_FOR_AGAIN if again else _KILLED if killed else attributes.get("reason", ""),
        measured=measured,
        spread=attributes.get("spread") if outcome is Outcome.OK else None,
        samples=attributes.get("samples", 0) if outcome is Outcome.OK else 0,
        plant=attributes.get("plant", ""),
        bag=attributes["bag"],
        started=started.astimezone() if started else None,
        ended=ended.astimezone() if ended else None,
    )
