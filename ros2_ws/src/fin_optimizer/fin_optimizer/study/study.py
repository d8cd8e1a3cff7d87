"""The ledger of a study: which fins were tried, what came of them, and what must be tried next.

The ledger is an Optuna study in a journal file, so `optuna-dashboard FOLDER/journal.log` shows it. The journal is only
appended to, each entry is on the disk before the call returns, and an entry is written before a trial starts and after
it ends. Outcomes are Optuna's states:

    PROPOSED WAITING, RUNNING RUNNING, OK COMPLETE, FAILED FAIL, INTERRUPTED FAIL, INFEASIBLE PRUNED

A trial that is FAIL to Optuna has an attribute that tells which of the two it is.

The order of the entries is the order of events, so what was known when a candidate was proposed can be told from the
journal, also where several fish swim at once.

A study's folder holds ``study.json`` (settings, written once), ``journal.log`` with ``journal.end``, ``bags/`` and the
report's files. Settings and journal carry check sums, see `fin_optimizer.study.journal`; a ledger that something else
changed is refused, and nothing on the disk is changed by that.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import statistics
import sys
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TextIO

import optuna

from fin_optimizer.search.space import Evaluation, Values, pareto_front
from fin_optimizer.study.checked_journal import WRONG_CONTENT, storage_of
from fin_optimizer.study.journal import (
    STUDY_NAME,
    JournalLines,
    StudyError,
    remove_stale_lock,
    take_off_cut_line,
    whole_entries,
)
from fin_optimizer.study.settings import (
    PARTIAL,
    SETTINGS_FILE,
    Objective,
    Policy,
    Settings,
    begun_already,
    differing,
    locked,
    read_settings,
    settings_and_sum,
    written_settings,
)
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import show_values, trial_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from optuna.storages import JournalStorage

    from fin_optimizer.search.space import Search
    from fin_optimizer.trial.result import Result

__all__ = [
    "BAG_FOLDER",
    "JOURNAL_FILE",
    "SETTINGS_FILE",
    "Candidate",
    "Objective",
    "Policy",
    "Settings",
    "Study",
    "TrialRecord",
    "bag_name",
    "candidates",
    "fastest",
    "front",
    "history",
    "is_for_another",
    "read_ledger",
    "read_settings",
    "read_trials",
]
JOURNAL_FILE = "journal.log"
BAG_FOLDER = "bags"
_FISH = "fish"
"""Of the study in Optuna's ledger: what swims."""
_BAG_NAME = re.compile(r"trial_(\d+)_")
_KILLED = "the optimiser's process ended before the trial did"

optuna.logging.set_verbosity(optuna.logging.WARNING)


_STATE_OF = {
    Outcome.PROPOSED: optuna.trial.TrialState.WAITING,
    Outcome.RUNNING: optuna.trial.TrialState.RUNNING,
    Outcome.OK: optuna.trial.TrialState.COMPLETE,
    Outcome.FAILED: optuna.trial.TrialState.FAIL,
    Outcome.INTERRUPTED: optuna.trial.TrialState.FAIL,
    Outcome.INFEASIBLE: optuna.trial.TrialState.PRUNED,
}
_OUTCOME_OF = {state: outcome for outcome, state in _STATE_OF.items() if outcome is not Outcome.INTERRUPTED}


@dataclass(frozen=True)
class TrialRecord:
    """One trial as the journal has it.

    Attributes:
        number: Of the trial, from 0; Optuna's number.
        candidate: Which candidate it tried, from 0; several trials repeat one candidate.
        values: The candidate, in SI units.
        outcome: What became of it.
        reason: Why it FAILED, was INTERRUPTED or is INFEASIBLE, else empty.
        score: Mean forward speed in m/s, None unless OK.
        spread: Standard deviation of the speed between blocks of the swim in m/s, None unless OK and known.
        cost: Cost of transport in J/m, None unless OK and asked for.
        samples: Number of velocities in the score.
        plant: Namespace of the fish that swam it, empty if unknown.
        bag: Its bag, relative to the study's folder.
        started: When it was begun, None while PROPOSED.
        ended: When its outcome was written, None before.
    """

    number: int
    candidate: int
    values: Values
    outcome: Outcome
    reason: str
    score: float | None
    spread: float | None
    cost: float | None
    samples: int
    plant: str
    bag: str
    started: datetime | None
    ended: datetime | None


@dataclass(frozen=True)
class Candidate:
    """A candidate and all its trials, in order."""

    number: int
    values: Values
    trials: tuple[TrialRecord, ...]

    @cached_property
    def score(self) -> float | None:
        """Mean score of its OK trials in m/s, None without any."""
        return _mean([trial.score for trial in self.trials])

    @cached_property
    def cost(self) -> float | None:
        """Mean cost of transport of its OK trials in J/m, None without any."""
        return _mean([trial.cost for trial in self.trials])

    @cached_property
    def spread(self) -> float | None:
        """Standard deviation of its OK trials' scores in m/s (n - 1 in the denominator), None with fewer than two."""
        scores = [trial.score for trial in self.trials if trial.score is not None]
        return statistics.stdev(scores) if len(scores) > 1 else None

    @property
    def evaluation(self) -> Evaluation:
        """What a search is told of it."""
        return Evaluation(self.values, self.score, self.cost)

    def wants_trial(self, policy: Policy) -> bool:
        """Whether one more trial should be begun, now that some may be under way."""
        outcomes = [trial.outcome for trial in self.trials]
        begun = outcomes.count(Outcome.OK) + outcomes.count(Outcome.RUNNING) + outcomes.count(Outcome.PROPOSED)
        return not self._given_up(policy) and begun < policy.repeats

    def settled(self, policy: Policy) -> bool:
        """Whether it needs no further trial, and none is under way: what is known of it changes no more."""
        outcomes = [trial.outcome for trial in self.trials]
        if Outcome.RUNNING in outcomes or Outcome.PROPOSED in outcomes:
            return False
        return self._given_up(policy) or outcomes.count(Outcome.OK) >= policy.repeats

    def _given_up(self, policy: Policy) -> bool:
        """Whether it is infeasible, or has failed too often."""
        outcomes = [trial.outcome for trial in self.trials]
        return Outcome.INFEASIBLE in outcomes or outcomes.count(Outcome.FAILED) >= policy.attempts


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None


def candidates(trials: Iterable[TrialRecord]) -> list[Candidate]:
    """Return the candidates of these trials in the order they were proposed."""
    groups: dict[int, list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(trial.candidate, []).append(trial)
    return [Candidate(number, group[0].values, tuple(group)) for number, group in sorted(groups.items())]


def is_for_another(candidate: Candidate, plant: str, plants: Iterable[str]) -> bool:
    """Return whether the candidate FAILED or was INTERRUPTED on this fish and not yet on every other one.

    Args:
        candidate: What is to be swum.
        plant: Namespace of the fish that could swim it now.
        plants: Namespaces of all fish that take part.
    """
    failed_on = {trial.plant for trial in candidate.trials if trial.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}}
    return plant in failed_on and any(other not in failed_on for other in plants)


def history(tried: Sequence[Candidate]) -> list[Evaluation]:
    """Return what a search is told of these candidates: a score for those that have one, never NaN."""
    return [candidate.evaluation for candidate in tried]


class Study:
    """A study that is being worked on by this process alone; a context manager that lets go of it.

    Attributes:
        folder: Where everything of the study lies.
        settings: As they were when the study was begun.
        notes: What had to be put right when it was opened, for the user.
        history: What a search is told, one entry a candidate; one without a score may still be swimming.
    """

    def __init__(self, folder: Path, settings: Settings, lock: TextIO) -> None:
        """Use `create` or `open`."""
        self.folder = folder
        self.settings = settings
        self.history: list[Evaluation] = []
        self._lock = lock
        self._journal = folder / JOURNAL_FILE
        self._storage, frozen, lines = _ledger(folder, settings)
        self.notes = lines.notes
        # Until here nothing on the disk was changed.
        if self._journal.exists():
            remove_stale_lock(self._journal)
            if length := take_off_cut_line(self._journal):
                self.notes.append(f"the journal's last entry was cut short ({length} bytes) and was taken off")
        with whole_entries(self._journal):
            (folder / BAG_FOLDER).mkdir(exist_ok=True)
            self._study_id = _begun(self._storage, settings.objective)
        self._distributions: dict[str, optuna.distributions.BaseDistribution] = {
            d.name: optuna.distributions.FloatDistribution(d.minimum, d.maximum) for d in settings.space.dimensions
        }
        self._ids: list[int] = []
        self._trials: list[TrialRecord] = []
        self._candidates: list[Candidate] = []
        self._open: set[int] = set()
        self._best: Candidate | None = None
        for trial in frozen:
            self._ids.append(trial._trial_id)  # noqa: SLF001  (Optuna's own key; it has no public name)
            self._note(_record(trial))

    @classmethod
    def create(cls, folder: Path, settings: Settings) -> Study:
        """Begin a study in ``folder``, which is made; its parents too.

        Raises:
            StudyError: The folder holds something already, or the disk refuses the journal.
            OSError: The folder cannot be written.
        """
        if (folder / SETTINGS_FILE).exists():
            raise begun_already(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if any(not entry.match(f"{SETTINGS_FILE}*{PARTIAL}") for entry in folder.iterdir()):
            if (folder / SETTINGS_FILE).exists():  # by now
                raise begun_already(folder)
            msg = f"{folder} is neither empty nor a study's folder: choose another one"
            raise StudyError(msg)
        with contextlib.ExitStack() as unless_all_is_well:
            lock = unless_all_is_well.enter_context(written_settings(folder, settings))
            study = cls(folder, settings, lock)
            _sync_folder(folder)
            unless_all_is_well.pop_all()
        return study

    @classmethod
    def open(cls, folder: Path, settings: Settings | None = None) -> Study:
        """Go on with the study in ``folder``. A trial that a kill left open was INTERRUPTED.

        Args:
            folder: The study's folder.
            settings: Those that the caller means to go on with; they must equal the study's.

        Raises:
            StudyError: No study, one of a newer version, one begun with other settings, one that was damaged or that
                another program changed, or one that another process works on. Nothing on the disk is changed then.
        """
        own = read_settings(folder)
        if settings is not None and (different := own.differences(settings)):
            msg = f"{folder} was begun with other settings: {'; '.join(different)}. Use the same, or another folder"
            raise StudyError(msg)
        with contextlib.ExitStack() as unless_all_is_well:
            lock = unless_all_is_well.enter_context(locked(folder))
            study = cls(folder, own, lock)
            if settings is not None and (left_out := [n for n in settings.details if n not in own.details]):
                study.notes.append(_left_out(left_out, settings))
            study._fail_unfinished()
            unless_all_is_well.pop_all()
        return study

    @property
    def trials(self) -> tuple[TrialRecord, ...]:
        """All trials so far, by number."""
        return tuple(self._trials)

    @property
    def candidates(self) -> list[Candidate]:
        """All candidates so far, in order."""
        return list(self._candidates)

    def best(self) -> Candidate | None:
        """Return the candidate with the highest speed, of equals the first; None if nothing was scored."""
        return self._best

    def settled(self) -> int:
        """Return how many candidates need no further trial."""
        return len(self._candidates) - len(self._open)

    @property
    def fish(self) -> Mapping[str, object]:
        """What swims, as the journal has it; empty before the first one is met."""
        return _fish(self._storage)

    def meet(self, fish: Mapping[str, object]) -> list[str]:
        """Return a text for each property in which a fish differs from the study's, which is the first one met.

        The first one is written into the journal. Scores of two fish cannot be compared.

        Args:
            fish: What swims and its parameters, apart from the fin; numbers, truth values and texts.

        Raises:
            StudyError: The disk refused. The journal is as before.
        """
        known = self.fish
        if not known:
            with whole_entries(self._journal):
                self._storage.set_study_user_attr(self._study_id, _FISH, dict(fish))
            return []
        return differing(known, fish)

    def next_candidate(
        self, search: Search, total: int | None = None, *, passes: Callable[[Candidate], bool] = lambda _: False
    ) -> tuple[int, Values] | None:
        """Return number and values of the candidate to try next, None if there is none before a trial has ended.

        That is the first one that lacks a trial (repeats, failed attempts, an interruption), or else the one that
        ``search`` proposes for the history of all candidates; those still swimming have no score in it yet.

        Args:
            search: Proposes candidates.
            total: Candidates that the study shall have, None for no end.
            passes: Whether a candidate that lacks a trial is left to somebody else.
        """
        for number in sorted(self._open):
            candidate = self._candidates[number]
            if candidate.wants_trial(self.settings.policy) and not passes(candidate):
                return number, candidate.values
        number = len(self._candidates)
        if (total is not None and number >= total) or any(before < search.needed(number) for before in self._open):
            return None
        return number, self.settings.space.check(search.propose(self.history))

    def propose(self, candidate: int, values: Values, plant: str = "") -> TrialRecord:
        """Write down that a trial of this candidate will be made by the fish of this namespace, and return it.

        Raises:
            StudyError: The disk refused. The journal is as before.
        """
        values = self.settings.space.check(values)
        bag = f"{BAG_FOLDER}/{bag_name(len(self._trials), values)}"
        trial = optuna.create_trial(
            state=optuna.trial.TrialState.WAITING,
            params=values,
            distributions=self._distributions,
            user_attrs={"candidate": candidate, "bag": bag, "plant": plant},
        )
        with whole_entries(self._journal):
            self._ids.append(self._storage.create_new_trial(self._study_id, trial))
        return self._refreshed(len(self._ids) - 1)

    def start(self, number: int) -> TrialRecord:
        """Write down that the trial, proposed before, is under way.

        Raises:
            StudyError: The disk refused. The journal is as before.
        """
        with whole_entries(self._journal):
            self._storage.set_trial_state_values(self._ids[number], optuna.trial.TrialState.RUNNING)
        return self._refreshed(number)

    def finish(self, number: int, result: Result) -> TrialRecord:
        """Write down how the trial ended.

        Raises:
            StudyError: The disk refused. The trial is still open in the journal.
        """
        # The reason comes last: a trial that was left open without one counts as interrupted.
        attributes: dict[str, object] = {"interrupted": result.outcome is Outcome.INTERRUPTED, "reason": result.reason}
        values = None
        if result.outcome is Outcome.OK and result.score is not None:
            attributes = {"spread": result.spread, "samples": result.samples}
            values = [result.score]
        if values is not None and self.settings.objective is Objective.SPEED_AND_COST:
            if result.cost is None:
                msg = f"{trial_name(number)} has no cost of transport, which this study is about"
                raise StudyError(msg)
            values.append(result.cost)
        with whole_entries(self._journal):
            for name, value in attributes.items():
                self._storage.set_trial_user_attr(self._ids[number], name, value)
            # Last, since it makes the trial count: a kill before it leaves the trial open, and it is made again.
            self._storage.set_trial_state_values(self._ids[number], _STATE_OF[result.outcome], values)
        return self._refreshed(number)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let another process work on the study."""
        self._lock.close()

    def _refreshed(self, number: int) -> TrialRecord:
        """Return a trial as the journal has it now, which is also what the search will be told."""
        record = _record(self._storage.get_trial(self._ids[number]))
        self._note(record)
        return record

    def _note(self, record: TrialRecord) -> None:
        """Take in a trial that is new or has changed; nothing here grows with the number of trials before it."""
        self._trials[record.number : record.number + 1] = [record]
        number = record.candidate
        known = self._candidates[number].trials if number < len(self._candidates) else ()
        trials = (*(trial for trial in known if trial.number != record.number), record)
        candidate = Candidate(number, record.values, tuple(sorted(trials, key=lambda trial: trial.number)))
        self._candidates[number : number + 1] = [candidate]
        self.history[number : number + 1] = [candidate.evaluation]
        if candidate.settled(self.settings.policy):
            self._open.discard(number)
        else:
            self._open.add(number)
        if candidate.score is None:
            return
        if self._best is not None and self._best.number == number:
            self._best = fastest(self._candidates)
        elif self._best is None or _rank(candidate) > _rank(self._best):
            self._best = candidate

    def _fail_unfinished(self) -> None:
        for trial in self.trials:
            if trial.outcome in {Outcome.PROPOSED, Outcome.RUNNING}:
                with whole_entries(self._journal):
                    self._storage.set_trial_state_values(self._ids[trial.number], optuna.trial.TrialState.FAIL)
                self._refreshed(trial.number)
                self.notes.append(
                    f"{trial_name(trial.number)} was under way when the optimiser ended: INTERRUPTED, made again"
                )


def _left_out(names: Sequence[str], settings: Settings) -> str:
    said = ", ".join(f"{name} (here {settings.details[name]!s})" for name in names)
    return f"{SETTINGS_FILE} is an older version's and does not say {said}: go on with what it was begun with"


def _rank(candidate: Candidate) -> tuple[float, int]:
    """Return what sorts candidates with a score, the best last; of equals the first one is the best."""
    return (candidate.score if candidate.score is not None else float("-inf"), -candidate.number)


def fastest(tried: Iterable[Candidate]) -> Candidate | None:
    """Return the candidate with the highest speed, of equals the first; None if none has a score."""
    return max((c for c in tried if c.score is not None), key=_rank, default=None)


def front(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates of the Pareto front of speed and cost of transport, the fastest first."""
    chosen = [tried[index] for index in pareto_front([candidate.evaluation for candidate in tried])]
    return sorted(chosen, key=_rank, reverse=True)


def bag_name(number: int, values: Values) -> str:
    """Return the name of a trial's bag, which tells a person the fin, for example ``trial_0007_E1.112GPa``."""
    fin = show_values(values).replace(", ", "_").replace(" ", "")
    return f"{trial_name(number).replace(' ', '_')}_{fin}"


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
    if not (folder / JOURNAL_FILE).exists() and not list(_bags(folder)):
        msg = f"{folder} holds no study: {JOURNAL_FILE} is missing"
        raise StudyError(msg)
    storage, frozen, lines = _ledger(folder, read_settings(folder))
    for note in lines.notes:
        tell(note)
    if length := lines.cut():
        tell(
            f"the journal's last entry is cut short ({length} bytes) and not counted; a kill or a running study does so"
        )
    return [_record(trial) for trial in frozen], _fish(storage) if lines.count else {}


def _fish(storage: JournalStorage) -> Mapping[str, object]:
    known: Mapping[str, object] = storage.get_study_user_attrs(storage.get_study_id_from_name(STUDY_NAME)).get(
        _FISH, {}
    )
    return known


def _bags(folder: Path) -> Iterator[tuple[int, str]]:
    """Yield number and name of every bag of a trial in a study's folder."""
    for path in (folder / BAG_FOLDER).glob("trial_*_*"):
        if found := _BAG_NAME.match(path.name):
            yield int(found[1]), path.name


def _ledger(folder: Path, settings: Settings) -> tuple[JournalStorage, list[optuna.trial.FrozenTrial], JournalLines]:
    """Return Optuna's storage of a study, its trials, which are as they should be, and the journal's lines.

    Nothing is changed. A study that was just begun has an empty journal or none.

    Raises:
        StudyError: The journal cannot be read, or is not that of what else lies in the folder.
    """
    bags = sorted(_bags(folder))  # before the journal: a trial is written there before its bag is made
    lines = JournalLines(folder / JOURNAL_FILE, settings_and_sum(folder)[1])
    storage = storage_of(lines)
    lines.check_end()
    trials = storage.get_all_trials(0, deepcopy=False) if lines.count else []
    try:
        _check_trials(trials, settings)
    except WRONG_CONTENT as error:
        what = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        msg = f"{lines.journal} is damaged or was changed by another program ({what}): restore it from a copy"
        raise StudyError(msg) from error
    beyond = [name for number, name in bags if number >= len(trials)]
    if beyond:
        lie = f"{len(beyond)} bags of later trials lie beside it ({beyond[0]} to {beyond[-1]})"
        if len(beyond) == 1:
            lie = f"the bag of a later trial lies beside it ({beyond[0]})"
        knows = f"knows {len(trials)} trials" if lines.count else "is empty" if lines.journal.exists() else "is missing"
        msg = (
            f"{lines.journal} {knows}, but {lie}: restore the journal from a copy, or move what lies beside it "
            "elsewhere to go on without it"
        )
        raise StudyError(msg)
    return storage, trials, lines


def _check_trials(trials: Sequence[optuna.trial.FrozenTrial], settings: Settings) -> None:
    """Look at what a journal without check sums may have wrong; with them, nothing of that can be.

    Raises:
        ValueError: A trial that this program never wrote; also a KeyError, or what else wrong content leads to.
    """
    known: list[Values] = []
    for trial in trials:
        record = _record(trial)
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
        if record.outcome is Outcome.OK and len(numbers) != len(settings.objective.parts):
            msg = f"{where} is OK with {len(numbers)} numbers, needed are {len(settings.objective.parts)}"
            raise ValueError(msg)
        for value in (*numbers, record.spread, record.samples):
            if value is not None and not math.isfinite(value):
                msg = f"{where} is OK with {value!r}, needed are finite numbers"
                raise ValueError(msg)


def _begun(storage: JournalStorage, objective: Objective) -> int:
    """Return Optuna's number of the study in the journal; the study is begun if the journal is new."""
    try:
        return storage.get_study_id_from_name(STUDY_NAME)
    except KeyError:
        study = optuna.create_study(study_name=STUDY_NAME, storage=storage, directions=objective.directions)
    with warnings.catch_warnings():  # only the dashboard's axis label: nothing is lost if Optuna drops it
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.set_metric_names([label for _, _, label in objective.parts])
    return storage.get_study_id_from_name(STUDY_NAME)


def _record(trial: optuna.trial.FrozenTrial) -> TrialRecord:
    """Return Optuna's trial as ours. One that failed without a reason was left open by a process that died."""
    attributes: dict[str, Any] = trial.user_attrs
    outcome: Outcome = _OUTCOME_OF[trial.state]
    killed = outcome is Outcome.FAILED and "reason" not in attributes
    if killed or (outcome is Outcome.FAILED and attributes.get("interrupted", False)):
        outcome = Outcome.INTERRUPTED
    started, ended = trial.datetime_start, trial.datetime_complete
    score, cost = [*(trial.values or []), None, None][:2] if outcome is Outcome.OK else (None, None)
    return TrialRecord(
        number=trial.number,
        candidate=attributes["candidate"],
        values=dict(trial.params),
        outcome=outcome,
        reason=_KILLED if killed else attributes.get("reason", ""),
        score=score,
        spread=attributes.get("spread") if outcome is Outcome.OK else None,
        cost=cost,
        samples=attributes.get("samples", 0) if outcome is Outcome.OK else 0,
        plant=attributes.get("plant", ""),
        bag=attributes["bag"],
        started=started.astimezone() if started else None,
        ended=ended.astimezone() if ended else None,
    )


def _sync_folder(folder: Path) -> None:
    """Bring the names of new files to the disk."""
    for path in (folder, folder.parent):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
