"""The ledger of a study: which fins were tried, what came of them, and what must be tried next.

The ledger is an Optuna study in a journal file, so `optuna-dashboard FOLDER/journal.log` shows it. The journal is only
appended to, each entry is on the disk before the call returns, and an entry is written before a trial starts and after
it ends. Outcomes are Optuna's states:

    PROPOSED WAITING, RUNNING RUNNING, OK COMPLETE, FAILED FAIL, INFEASIBLE PRUNED

A study's folder holds ``study.json`` (settings, written once), ``journal.log``, ``bags/`` and the report's files.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import statistics
import time
import warnings
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Self, TextIO

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

from fin_optimizer.search import Dimension, Evaluation, Space, Values
from fin_optimizer.trial import Outcome
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from fin_optimizer.search import Search
    from fin_optimizer.trial import Result

FORMAT = 1
SETTINGS_FILE = "study.json"
JOURNAL_FILE = "journal.log"
BAG_FOLDER = "bags"
# Left by a process that was killed between taking and releasing it; a living one holds it for milliseconds.
_STALE_LOCK_SECONDS = 5.0

_STUDY_NAME = "study"
_KILLED = "interrupted: the optimiser's process ended before the trial did"

optuna.logging.set_verbosity(optuna.logging.WARNING)


class StudyError(ValueError):
    """A study that cannot be begun or gone on with; the message says what to do."""


_STATE_OF = {
    Outcome.PROPOSED: optuna.trial.TrialState.WAITING,
    Outcome.RUNNING: optuna.trial.TrialState.RUNNING,
    Outcome.OK: optuna.trial.TrialState.COMPLETE,
    Outcome.FAILED: optuna.trial.TrialState.FAIL,
    Outcome.INFEASIBLE: optuna.trial.TrialState.PRUNED,
}
_OUTCOME_OF = {state: outcome for outcome, state in _STATE_OF.items()}


@dataclass(frozen=True)
class TrialRecord:
    """One trial as the journal has it.

    Attributes:
        number: Of the trial, from 0; Optuna's number.
        candidate: Which candidate it tried, from 0; several trials repeat one candidate.
        values: The candidate, in SI units.
        outcome: What became of it.
        reason: Why it FAILED or is INFEASIBLE, else empty.
        interrupted: It FAILED because somebody or something stopped the optimiser; it says nothing about the fin.
        score: Mean forward speed in m/s, None unless OK.
        spread: Standard deviation of the speed between blocks of the swim in m/s, None unless OK and known.
        samples: Number of velocities in the score.
        bag: Its bag, relative to the study's folder.
        started: When it was begun, None while PROPOSED.
        ended: When its outcome was written, None before.
    """

    number: int
    candidate: int
    values: Values
    outcome: Outcome
    reason: str
    interrupted: bool
    score: float | None
    spread: float | None
    samples: int
    bag: str
    started: datetime | None
    ended: datetime | None


@dataclass(frozen=True)
class Policy:
    """How often a candidate is swum.

    Attributes:
        repeats: Swims with a score that a candidate needs; its score is their mean.
        attempts: FAILED trials after which a candidate is given up and the study goes on; interrupted ones don't count.
    """

    repeats: int = 1
    attempts: int = 2

    def __post_init__(self) -> None:
        checks.whole_number("repeats", self.repeats, 1)
        checks.whole_number("attempts", self.attempts, 1)


@dataclass(frozen=True)
class Candidate:
    """A candidate and all its trials, in order."""

    number: int
    values: Values
    trials: tuple[TrialRecord, ...]

    @property
    def score(self) -> float | None:
        """Mean score of its OK trials in m/s, None without any."""
        scores = [trial.score for trial in self.trials if trial.score is not None]
        return statistics.fmean(scores) if scores else None

    def settled(self, policy: Policy) -> bool:
        """Whether it needs no further trial: swum often enough, failed too often, or infeasible."""
        outcomes = [trial.outcome for trial in self.trials if not trial.interrupted]
        return (
            Outcome.INFEASIBLE in outcomes
            or outcomes.count(Outcome.OK) >= policy.repeats
            or outcomes.count(Outcome.FAILED) >= policy.attempts
        )


def candidates(trials: Iterable[TrialRecord]) -> list[Candidate]:
    """Return the candidates of these trials in the order they were proposed."""
    groups: dict[int, list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(trial.candidate, []).append(trial)
    return [Candidate(number, group[0].values, tuple(group)) for number, group in sorted(groups.items())]


def history(tried: Sequence[Candidate]) -> list[Evaluation]:
    """Return what a search is told of these candidates: a score for those that have one, never NaN."""
    return [Evaluation(candidate.values, candidate.score) for candidate in tried]


@dataclass(frozen=True)
class Settings:
    """What must not change while a study goes on.

    Attributes:
        space: What is searched.
        policy: How often a candidate is swum.
        details: All else that decides the candidates and their scores, by name: search, seed, gait, window.
    """

    space: Space
    policy: Policy = field(default_factory=Policy)
    details: Mapping[str, object] = field(default_factory=dict)

    def flat(self) -> dict[str, object]:
        """Return every setting by a name that a reader knows."""
        bounds = {f"range of {d.name}": f"[{d.minimum!r}, {d.maximum!r}] {d.unit}" for d in self.space.dimensions}
        return {**bounds, **asdict(self.policy), **self.details}

    def differences(self, other: Settings) -> list[str]:
        """Return a text for each setting that differs, its value here first."""
        here, there = self.flat(), other.flat()
        names = [*here, *(name for name in there if name not in here)]
        return [
            f"{name} is {here.get(name, 'not set')!s} there and {there.get(name, 'not set')!s} here"
            for name in names
            if here.get(name) != there.get(name)
        ]

    def to_json(self) -> str:
        """Return the text of ``study.json``."""
        content = {
            "format": FORMAT,
            "space": [asdict(dimension) for dimension in self.space.dimensions],
            "policy": asdict(self.policy),
            "details": dict(self.details),
        }
        return json.dumps(content, indent=2, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Settings:
        """Read the text of ``study.json``.

        Raises:
            StudyError: It was written by a newer version, or is not a study's.
        """
        try:
            content = json.loads(text)
            version = content["format"]
            if version > FORMAT:
                msg = f"its format {version} is newer than the {FORMAT} that this version knows: update fin_optimizer"
                raise StudyError(msg)
            space = Space(tuple(Dimension(**dimension) for dimension in content["space"]))
            return cls(space, Policy(**content["policy"]), content["details"])
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            msg = f"it is no study's settings ({type(error).__name__}: {error}); restore it or begin another folder"
            raise StudyError(msg) from error


class Study:
    """A study that is being worked on by this process alone; a context manager that lets go of it.

    Attributes:
        folder: Where everything of the study lies.
        settings: As they were when the study was begun.
        notes: What had to be put right when it was opened, for the user.
    """

    def __init__(self, folder: Path, settings: Settings, lock: TextIO, notes: list[str]) -> None:
        """Use `create` or `open`."""
        self.folder = folder
        self.settings = settings
        self.notes = notes
        self._lock = lock
        (folder / BAG_FOLDER).mkdir(exist_ok=True)
        self._study = _ledger(folder / JOURNAL_FILE)
        self._distributions: dict[str, optuna.distributions.BaseDistribution] = {
            d.name: optuna.distributions.FloatDistribution(d.minimum, d.maximum) for d in settings.space.dimensions
        }
        self._running: dict[int, optuna.Trial] = {}
        self._trials = [_record(trial) for trial in self._study.get_trials(deepcopy=False)]

    @classmethod
    def create(cls, folder: Path, settings: Settings) -> Study:
        """Begin a study in ``folder``, which is made; its parents too.

        Raises:
            StudyError: The folder holds something already.
            OSError: The folder cannot be written.
        """
        if (folder / SETTINGS_FILE).exists():
            msg = f"{folder} holds a study already: open it to go on with it, or choose another folder"
            raise StudyError(msg)
        partial = folder / (SETTINGS_FILE + ".partial")
        if folder.exists() and any(entry != partial for entry in folder.iterdir()):
            msg = f"{folder} is neither empty nor a study's folder: choose another one"
            raise StudyError(msg)
        folder.mkdir(parents=True, exist_ok=True)
        with partial.open("w", encoding="utf-8") as file:
            file.write(settings.to_json())
            file.flush()
            os.fsync(file.fileno())
        partial.rename(folder / SETTINGS_FILE)
        with contextlib.ExitStack() as unless_all_is_well:
            lock = unless_all_is_well.enter_context(_locked(folder))
            study = cls(folder, settings, lock, [])
            _sync_folder(folder)
            unless_all_is_well.pop_all()
        return study

    @classmethod
    def open(cls, folder: Path, settings: Settings | None = None) -> Study:
        """Go on with the study in ``folder``. A trial that a kill left open becomes FAILED.

        Args:
            folder: The study's folder.
            settings: Those that the caller means to go on with; they must equal the study's.

        Raises:
            StudyError: No study, one of a newer version, one begun with other settings, or one that another process
                works on. Nothing on the disk is changed then.
        """
        try:
            own = Settings.from_json((folder / SETTINGS_FILE).read_text(encoding="utf-8"))
        except FileNotFoundError:
            msg = f"{folder} holds no study: {SETTINGS_FILE} is missing"
            raise StudyError(msg) from None
        except StudyError as error:
            msg = f"{folder / SETTINGS_FILE}: {error}"
            raise StudyError(msg) from error
        if settings is not None and (different := own.differences(settings)):
            msg = f"{folder} was begun with other settings: {'; '.join(different)}. Use the same, or another folder"
            raise StudyError(msg)
        with contextlib.ExitStack() as unless_all_is_well:
            lock = unless_all_is_well.enter_context(_locked(folder))
            study = cls(folder, own, lock, _repaired(folder / JOURNAL_FILE))
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
        return candidates(self._trials)

    def best(self) -> Candidate | None:
        """Return the candidate with the highest score, of equals the first; None if nothing was scored."""
        scored = [candidate for candidate in self.candidates if candidate.score is not None]
        return max(scored, key=lambda candidate: candidate.score or 0.0, default=None)

    def settled(self) -> int:
        """Return how many candidates need no further trial."""
        return sum(candidate.settled(self.settings.policy) for candidate in self.candidates)

    def next_candidate(self, search: Search) -> tuple[int, Values]:
        """Return number and values of the candidate to try next.

        That is the last one again while it is not settled (repeats, failed attempts, an interruption), then the one
        that ``search`` proposes for the history of all candidates.
        """
        tried = self.candidates
        if tried and not tried[-1].settled(self.settings.policy):
            return tried[-1].number, tried[-1].values
        return len(tried), self.settings.space.check(search.propose(history(tried)))

    def propose(self, candidate: int, values: Values) -> TrialRecord:
        """Write down that a trial of this candidate will be made, and return it."""
        values = self.settings.space.check(values)
        number = len(self._trials)
        self._study.add_trial(
            optuna.create_trial(
                state=optuna.trial.TrialState.WAITING,
                params=values,
                distributions=self._distributions,
                user_attrs={"candidate": candidate, "bag": f"{BAG_FOLDER}/trial_{number:04d}"},
            )
        )
        return self._refreshed(number)

    def start(self, number: int) -> TrialRecord:
        """Write down that the trial, proposed before, is under way."""
        trial = self._study.ask()
        if trial.number != number:
            msg = f"trial {number} cannot be started: trial {trial.number} was proposed before it and waits"
            raise StudyError(msg)
        self._running[number] = trial
        return self._refreshed(number)

    def finish(self, number: int, result: Result) -> TrialRecord:
        """Write down how the trial ended."""
        trial = self._running.pop(number)
        attributes: dict[str, object] = {"reason": result.reason, "interrupted": result.interrupted}
        if result.outcome is Outcome.OK:
            attributes = {"spread": result.spread, "samples": result.samples}
        for name, value in attributes.items():
            trial.set_user_attr(name, value)
        # Last, since it makes the trial count: a kill before it leaves the trial open, and it is made again.
        self._study.tell(trial, values=result.score, state=_STATE_OF[result.outcome])
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
        record = _record(self._study.get_trials(deepcopy=False)[number])
        self._trials[number:] = [record]
        return record

    def _fail_unfinished(self) -> None:
        for trial in list(self._trials):
            if trial.outcome is Outcome.PROPOSED:
                self.start(trial.number)
            if trial.outcome in {Outcome.PROPOSED, Outcome.RUNNING}:
                self._study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
                self._trials[trial.number] = _record(self._study.get_trials(deepcopy=False)[trial.number])
                self.notes.append(f"trial {trial.number} was under way when the optimiser ended: FAILED, made again")
        self._running.clear()


def _ledger(journal: Path) -> optuna.Study:
    """Return the Optuna study in the journal; it is begun if the journal is new."""
    storage = JournalStorage(JournalFileBackend(str(journal), lock_obj=JournalFileOpenLock(str(journal))))
    sampler = optuna.samplers.RandomSampler()  # never asked: candidates come from fin_optimizer.search
    if optuna.get_all_study_names(storage):
        return optuna.load_study(study_name=_STUDY_NAME, storage=storage, sampler=sampler)
    study = optuna.create_study(study_name=_STUDY_NAME, storage=storage, sampler=sampler, direction="maximize")
    with warnings.catch_warnings():  # only the dashboard's axis label: nothing is lost if Optuna drops it
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.set_metric_names(["mean forward speed (m/s)"])
    return study


def _record(trial: optuna.trial.FrozenTrial) -> TrialRecord:
    """Return Optuna's trial as ours. One that failed without a reason was left open by a process that died."""
    attributes: dict[str, Any] = trial.user_attrs
    outcome = _OUTCOME_OF[trial.state]
    killed = outcome is Outcome.FAILED and "reason" not in attributes
    started, ended = trial.datetime_start, trial.datetime_complete
    return TrialRecord(
        number=trial.number,
        candidate=attributes["candidate"],
        values=dict(trial.params),
        outcome=outcome,
        reason=_KILLED if killed else attributes.get("reason", ""),
        interrupted=killed or attributes.get("interrupted", False),
        score=trial.value if outcome is Outcome.OK else None,
        spread=attributes.get("spread"),
        samples=attributes.get("samples", 0),
        bag=attributes["bag"],
        started=started.astimezone() if started else None,
        ended=ended.astimezone() if ended else None,
    )


def _locked(folder: Path) -> TextIO:
    """Return the settings file, locked for this process until it is closed or the process ends."""
    file = (folder / SETTINGS_FILE).open(encoding="utf-8")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        msg = f"another optimiser is working on {folder}: stop it first, or choose another folder"
        raise StudyError(msg) from None
    return file


def _repaired(journal: Path) -> list[str]:
    """Remove what a kill in the middle of an entry leaves behind, and return a note on each; needs the study's lock.

    Optuna ignores a last line that is cut short, but would then append to it and make both unreadable.
    """
    notes: list[str] = []
    lock = journal.with_name(journal.name + ".lock")
    if os.path.lexists(lock) and time.time() - lock.lstat().st_mtime > _STALE_LOCK_SECONDS:
        lock.unlink()
    if not journal.exists():
        return notes
    content = journal.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with journal.with_name(journal.name + ".cut").open("ab") as kept:
            kept.write(content[whole:] + b"\n")
        os.truncate(journal, whole)
        notes.append(f"the journal's last entry was cut short ({len(content) - whole} bytes) and was taken off")
    return notes


def _sync_folder(folder: Path) -> None:
    """Bring the names of new files to the disk."""
    for path in (folder, folder.parent):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
