"""The ledger of a study: which fins were tried, what came of them, and what must be tried next.

The ledger is an Optuna study in a journal file, so Optuna's dashboard shows it. The journal is only
appended to, each entry is on the disk before the call returns, and an entry is written before a trial starts and after
it ends.

The order of the entries is the order of events, so what was known when a candidate was proposed can be told from the
journal, also where several fish swim at once.

Settings and journal carry check sums, see `fin_optimizer.study.journal`; a ledger that something else changed is
refused, and nothing on the disk is changed by that.
"""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Self, TextIO

import optuna
from optuna.study import StudyDirection

from fin_optimizer.goals import LESS, MORE
from fin_optimizer.search.distributions import distributions
from fin_optimizer.study.candidate import Candidate, TrialRecord, best_of, rank
from fin_optimizer.study.file_names import BAG_FOLDER, JOURNAL_FILE, REPEATED_MARK, SETTINGS_FILE
from fin_optimizer.study.folder import bag_name, begun, locked, put_on_disk, read_settings
from fin_optimizer.study.journal import STUDY_NAME, StudyError, remove_stale_lock, take_off_cut_line, whole_entries
from fin_optimizer.study.records import (
    ASKED_FOR_AGAIN,
    FISH,
    MEASURED,
    REPEATED,
    STATE_OF,
    fish_in,
    read_checked,
    record_of,
    repeated_in,
)
from fin_optimizer.study.settings import Settings, differing
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import trial_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from optuna.storages import JournalStorage

    from fin_optimizer.goals import Goals
    from fin_optimizer.search.space import Evaluation, Search, Values
    from fin_optimizer.trial.result import Result

optuna.logging.set_verbosity(optuna.logging.WARNING)

_CONSTRAINT = "constraints:"
"""What the names of a trial's attributes begin with in which Optuna keeps by how much it misses a constraint."""


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
        self._storage, frozen, lines = read_checked(folder, settings)
        self.notes = lines.notes
        # Until here nothing on the disk was changed.
        if self._journal.exists():
            remove_stale_lock(self._journal)
            if length := take_off_cut_line(self._journal):
                self.notes.append(f"the journal's last entry was cut short ({length} bytes) and was taken off")
        with whole_entries(self._journal):
            (folder / BAG_FOLDER).mkdir(exist_ok=True)
            self._study_id = _study_in(self._storage, settings.goals)
        self._distributions = distributions(settings.space)
        self._ids: list[int] = []
        self._trials: list[TrialRecord] = []
        self._candidates: list[Candidate] = []
        self._open: set[int] = set()
        self._best: Candidate | None = None
        self._repeated = repeated_in(self._storage)
        for trial in frozen:
            self._ids.append(trial._trial_id)  # noqa: SLF001  (Optuna's own key; it has no public name)
            self._note(record_of(trial, settings.goals, self._repeated))

    @classmethod
    def create(cls, folder: Path, settings: Settings) -> Study:
        """Begin a study in ``folder``, which is made; its parents too.

        Raises:
            StudyError: The folder holds something already, or the disk refuses the journal.
            OSError: The folder cannot be written.
        """
        with contextlib.ExitStack() as on_failure:
            lock = on_failure.enter_context(begun(folder, settings))
            study = cls(folder, settings, lock)
            put_on_disk(folder)
            on_failure.pop_all()
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
        with contextlib.ExitStack() as on_failure:
            lock = on_failure.enter_context(locked(folder))
            study = cls(folder, own, lock)
            if settings is not None and (left_out := own.left_out(settings)):
                study.notes.append(_left_out(left_out, settings))
            study._fail_unfinished()
            on_failure.pop_all()
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
        """Return the best candidate, see `best_of`; None if nothing was scored."""
        return self._best

    def settled(self) -> int:
        """Return how many candidates need no further trial."""
        return len(self._candidates) - len(self._open)

    @property
    def fish(self) -> Mapping[str, object]:
        """What swims, as the journal has it; empty before the first one is met."""
        return fish_in(self._storage)

    def keep_or_compare(self, fish: Mapping[str, object]) -> list[str]:
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
                self._storage.set_study_user_attr(self._study_id, FISH, dict(fish))
            return []
        return differing(known, fish)

    def next_candidate(
        self, search: Search, total: int | None = None, *, is_left: Callable[[Candidate], bool] = lambda _: False
    ) -> tuple[int, Values] | None:
        """Return number and values of the candidate to try next, None if there is none before a trial has ended.

        That is the first one that lacks a trial (repeats, failed attempts, an interruption), or else the one that
        ``search`` proposes for the history of all candidates; those still swimming have no score in it yet.

        Args:
            search: Proposes candidates.
            total: Candidates that the study shall have, None for no end.
            is_left: Whether a candidate that lacks a trial is left to somebody else.
        """
        for number in sorted(self._open):
            candidate = self._candidates[number]
            if candidate.wants_trial(self.settings.policy) and not is_left(candidate):
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
        values, limits = None, dict[str, float]()
        if result.outcome is Outcome.OK:
            goals = self.settings.goals
            if lacks := [each.words for each in goals.asked if each.name not in result.measured]:
                msg = f"{trial_name(number)} has no {' and no '.join(lacks)}, which this study is about"
                raise StudyError(msg)
            values, attributes, limits = _achieved(goals, result.measured, result.spread, result.samples)
        with whole_entries(self._journal):
            for name, excess in limits.items():
                self._storage.set_trial_system_attr(self._ids[number], name, excess)
            for name, value in attributes.items():
                self._storage.set_trial_user_attr(self._ids[number], name, value)
            # Last, since it makes the trial count: a kill before it leaves the trial open, and it is made again.
            self._storage.set_trial_state_values(self._ids[number], STATE_OF[result.outcome], values)
        return self._refreshed(number)

    def repeat(self, number: int) -> TrialRecord:
        """Let a trial that has ended count no more, so that its candidate is swum again; its bag stays, and is marked.

        Raises:
            StudyError: The disk refused. The journal is as before.
        """
        if self._trials[number].outcome is not Outcome.INTERRUPTED:
            repeated = self._repeated | {number}
            with whole_entries(self._journal):
                self._storage.set_study_user_attr(self._study_id, REPEATED, sorted(repeated))
            self._repeated = repeated
        record = self._refreshed(number)
        if (bag := self.folder / record.bag).is_dir():
            with contextlib.suppress(OSError):  # the journal knows it
                (bag / REPEATED_MARK).write_text(f"{trial_name(number)}: {ASKED_FOR_AGAIN}\n", encoding="utf-8")
        return record

    def put_back(self, record: TrialRecord) -> None:
        """Write down a trial that ended long ago, all of it at once: for a journal that is made anew.

        Args:
            record: As the journal had it; its number follows the last one's.

        Raises:
            StudyError: The disk refused. The journal is as before.
        """
        about: dict[str, object] = {"candidate": record.candidate, "bag": record.bag, "plant": record.plant}
        values, limits = None, dict[str, float]()
        if record.measured:
            values, more, limits = _achieved(self.settings.goals, record.measured, record.spread, record.samples)
            about |= more
        else:
            about |= {"interrupted": record.outcome is Outcome.INTERRUPTED, "reason": record.reason}
        trial = optuna.create_trial(
            state=STATE_OF[record.outcome],
            values=values,
            params=self.settings.space.check(record.values),
            distributions=self._distributions,
            user_attrs=about,
            system_attrs=limits,
        )
        trial.datetime_start, trial.datetime_complete = (
            None if moment is None else moment.astimezone().replace(tzinfo=None)
            for moment in (record.started, record.ended)
        )
        with whole_entries(self._journal):
            self._ids.append(self._storage.create_new_trial(self._study_id, trial))
        self._refreshed(len(self._ids) - 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let another process work on the study."""
        self._lock.close()

    def _refreshed(self, number: int) -> TrialRecord:
        """Return a trial as the journal has it now, which is also what the search will be told."""
        record = record_of(self._storage.get_trial(self._ids[number]), self.settings.goals, self._repeated)
        self._note(record)
        return record

    def _note(self, record: TrialRecord) -> None:
        """Take in a trial that is new or has changed; nothing here grows with the number of trials before it."""
        self._trials[record.number : record.number + 1] = [record]
        number = record.candidate
        known = self._candidates[number].trials if number < len(self._candidates) else ()
        trials = (*(trial for trial in known if trial.number != record.number), record)
        in_order = tuple(sorted(trials, key=lambda trial: trial.number))
        candidate = Candidate(number, record.values, in_order, self.settings.goals)
        self._candidates[number : number + 1] = [candidate]
        settled = candidate.settled(self.settings.policy)
        pending = candidate.score is None and not settled
        self.history[number : number + 1] = [replace(candidate.evaluation, pending=pending)]
        if settled:
            self._open.discard(number)
        else:
            self._open.add(number)
        if self._best is not None and self._best.number == number:
            self._best = best_of(self._candidates)
        elif candidate.score is None:
            return
        elif self._best is None or rank(candidate) > rank(self._best):
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


def _achieved(
    goals: Goals, measured: Mapping[str, float], spread: float | None, samples: int
) -> tuple[list[float], dict[str, object], dict[str, float]]:
    """Return what Optuna has of an OK trial: values of the goals, attributes of ours, and excesses over constraints."""
    beside = {each.name: measured[each.name] for each in goals.asked if each not in goals.measures}
    attributes: dict[str, object] = {"spread": spread, "samples": samples, **({MEASURED: beside} if beside else {})}
    texts = (f"{_CONSTRAINT}{constraint.text}" for constraint in goals.constraints)
    return (
        [measured[goal.name] for goal in goals.measures],
        attributes,
        dict(zip(texts, goals.excesses(measured), strict=True)),
    )


def _left_out(names: Sequence[str], settings: Settings) -> str:
    said = ", ".join(f"{name} (here {settings.details[name]!s})" for name in names)
    return f"{SETTINGS_FILE} is an older version's and does not say {said}: go on with what it was begun with"


def _study_in(storage: JournalStorage, goals: Goals) -> int:
    """Return Optuna's number of the study in the journal; the study is begun if the journal is new."""
    try:
        return storage.get_study_id_from_name(STUDY_NAME)
    except KeyError:
        ways = {MORE: StudyDirection.MAXIMIZE, LESS: StudyDirection.MINIMIZE}
        directions = [ways[goal.direction] for goal in goals.measures]
        study = optuna.create_study(study_name=STUDY_NAME, storage=storage, directions=directions)
    with warnings.catch_warnings():  # only the dashboard's axis label: nothing is lost if Optuna drops it
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.set_metric_names([goal.label for goal in goals.measures])
    return storage.get_study_id_from_name(STUDY_NAME)
