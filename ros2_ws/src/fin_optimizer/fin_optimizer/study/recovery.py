"""A study's journal made anew: its first entries as far as they are whole, and its bags for all behind them.

A bag's metadata tell the trial's number, its candidate, its fin, its fish and what the study is; its messages give the
score again, to the last digit. A trial without a bag, one that was INFEASIBLE for example, is not known any more; it
stands as INTERRUPTED with the values that the search proposes there, so it is made again.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.recorded import recorded_swim
from fin_optimizer.study.candidate import TrialRecord
from fin_optimizer.study.file_names import BAG_FOLDER, JOURNAL_FILE, REPEATED_MARK, SETTINGS_FILE
from fin_optimizer.study.folder import bag_name, bags_in, locked, put_on_disk, read_settings, settings_and_sum
from fin_optimizer.study.journal import END_FILE, JournalLines, StudyError, write_end
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import VALUES, read_checked
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.scored import result_of
from fin_optimizer.words import trial_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.search.space import Search, Values
    from fin_optimizer.study.settings import Settings

_NUMBER, _CANDIDATE, _STARTED, _NAMESPACE = "trial.number", "trial.candidate", "trial.started", "plant.namespace"
_SETTING = "study."
_NO_FISH = (_SETTING, "trial.", "version.", "git.", "measurement.", "fin.", "gait.", _NAMESPACE)
"""How entries of a bag's metadata begin that do not describe the fish."""
_LOST = "its entries in the journal were lost, and no bag of it tells a score"
_SET_ASIDE = ".damaged"


@dataclass
class Recovery:
    """What a journal was made anew from.

    Attributes:
        kept: Trials that the old journal's whole entries tell.
        from_bags: Numbers of those that only their bags told.
        lost: Numbers of those of which neither told how they ended.
        set_aside: What the old journal is called now; None if there was none.
    """

    kept: int = 0
    from_bags: list[int] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    set_aside: Path | None = None


def recover(folder: Path, search: Search | None) -> Recovery | None:
    """Make the journal of the study in a folder anew; None, and nothing is changed, if it is as it should be.

    Args:
        folder: Of the study, whose settings are whole.
        search: What proposed its candidates; None leaves one that no bag tells with the values of its neighbour.

    Raises:
        StudyError: No study, another process works on it, or its bags contradict each other. Nothing is changed.
        OSError: The folder cannot be written. The old journal is still there.
    """
    settings, origin = settings_and_sum(folder)
    with closing(locked(folder)):
        with suppress(StudyError):
            read_checked(folder, settings)
            return None
        found = _Bags(folder, settings)
        with tempfile.TemporaryDirectory(prefix=".recovery-", dir=folder) as temporary:
            anew = Path(temporary)
            shutil.copy(folder / SETTINGS_FILE, anew)
            recovery = _made_anew(folder, anew, origin, found, search)
            write_end(anew / JOURNAL_FILE, origin, (anew / JOURNAL_FILE).read_bytes().count(b"\n"))
            recovery.set_aside = _set_aside(folder / JOURNAL_FILE)
            # A kill between the two leaves a journal that is refused as before, and this is done again.
            (anew / END_FILE).replace(folder / END_FILE)
            (anew / JOURNAL_FILE).replace(folder / JOURNAL_FILE)
            put_on_disk(folder)
        read_checked(folder, settings)
        return recovery


def _set_aside(journal: Path) -> Path | None:
    """Give an old journal a second name under which it stays; return that."""
    if not journal.exists():
        return None
    names = (journal.with_name(f"{journal.name}{_SET_ASIDE}{number or ''}") for number in range(10_000))
    free = next(name for name in names if not os.path.lexists(name))
    shutil.copy2(journal, free)
    return free


def _made_anew(folder: Path, anew: Path, origin: str, found: _Bags, search: Search | None) -> Recovery:
    """Write the journal of a folder into another one."""
    lines = JournalLines(folder / JOURNAL_FILE, origin)
    with suppress(StudyError):
        lines.read()
    if lines.whole_bytes:
        (anew / JOURNAL_FILE).write_bytes((folder / JOURNAL_FILE).read_bytes()[: lines.whole_bytes])
    settings = read_settings(anew)
    try:
        study = Study(anew, settings, locked(anew))
    except StudyError:  # entries without check sums that do not fit together
        (anew / JOURNAL_FILE).unlink()
        study = Study(anew, settings, locked(anew))
    with study:
        recovery = Recovery(kept=len(study.trials))
        for trial in study.trials:
            if trial.outcome in {Outcome.PROPOSED, Outcome.RUNNING}:
                result = found.result(trial.number)
                study.finish(trial.number, result or Result(Outcome.INTERRUPTED, _LOST))
                (recovery.lost if result is None else recovery.from_bags).append(trial.number)
        for number in range(len(study.trials), found.after):
            told = found.told(number)
            _put_back(study, number, told, found.next_candidate(number), search)
            ended = told is not None and told.outcome is not Outcome.INTERRUPTED
            (recovery.from_bags if ended else recovery.lost).append(number)
        if not study.fish and found.fish:
            study.keep_or_compare(found.fish)
    return recovery


def _put_back(study: Study, number: int, told: TrialRecord | None, following: int, search: Search | None) -> None:
    """Write a trial down; one of which nothing is told is taken for the first of a candidate that is missing."""
    known = len(study.candidates)
    if told is not None:
        if told.candidate > known:
            msg = f"{told.bag} is of fin {told.candidate + 1}, but no trial before it is of fin {known + 1}: {_MOVE}"
            raise StudyError(msg)
        if told.candidate < known and study.candidates[told.candidate].values != told.values:
            msg = f"{told.bag} says other values of fin {told.candidate + 1} than a trial before it: {_MOVE}"
            raise StudyError(msg)
        study.put_back(told)
        return
    candidate = known if following > known or not known else known - 1
    values = study.candidates[candidate].values if candidate < known else _proposed(study, search)
    name = f"{BAG_FOLDER}/{bag_name(number, values)}"
    study.put_back(
        TrialRecord(number, candidate, values, Outcome.INTERRUPTED, _LOST, {}, None, 0, "", name, None, None)
    )


def _proposed(study: Study, search: Search | None) -> Values:
    if search is not None:
        with suppress(ValueError, ArithmeticError):
            return study.settings.space.check(search.propose([replace(each, pending=False) for each in study.history]))
    if study.candidates:
        return study.candidates[-1].values
    msg = "nothing tells what the first fin was, and no search proposes it: restore the journal from a copy"
    raise StudyError(msg)


_MOVE = "move the bag that does not belong to the study elsewhere"


class _Bags:
    """What the bags of a study tell of its trials.

    Attributes:
        after: The number behind the last bag's.
        fish: What swims; empty where no bag tells it.

    Raises:
        StudyError: One is of another study, or two are of one trial.
    """

    def __init__(self, folder: Path, settings: Settings) -> None:
        self._folder, self._settings = folder, settings
        self._bags: dict[int, Bag] = {}
        self._told: dict[int, TrialRecord | None] = {}
        names: dict[int, str] = {}
        for number, name in sorted(bags_in(folder)):
            if number in names:
                msg = f"{names[number]} and {name} are both of {trial_name(number)}: {_MOVE}"
                raise StudyError(msg)
            names[number] = name
            with suppress(BagError):  # a damaged one tells nothing
                self._bags[number] = self._checked(number, name)
        self.after = max(names, default=-1) + 1
        self._names = names
        self.fish = next((_fish(bag.metadata) for _, bag in sorted(self._bags.items())), {})

    def _checked(self, number: int, name: str) -> Bag:
        bag = read_bag(self._folder / BAG_FOLDER / name)
        own = {f"{_SETTING}{key}": str(value) for key, value in self._settings.flat().items()}
        differs = [key for key, value in own.items() if bag.metadata.get(key, value) != value]
        if bag.metadata.get(_NUMBER, str(number)) != str(number):
            differs = [_NUMBER]
            own[_NUMBER] = str(number)
        if differs:
            key = differs[0]
            msg = f"{name} is of another study ({key} is {bag.metadata[key]} there and {own[key]} here): {_MOVE}"
            raise StudyError(msg)
        return bag

    def next_candidate(self, number: int) -> int:
        """Return the candidate of the first trial from this number on that a bag tells; -1 without one."""
        return next(self._candidates(number), -1)

    def _candidates(self, start: int) -> Iterator[int]:
        for number in range(start, self.after):
            told = self.told(number)
            if told is not None:
                yield told.candidate

    def result(self, number: int) -> Result | None:
        """Return how a trial ended by its bag; None if that tells no score.

        Whether such a trial FAILED or was INTERRUPTED no bag tells: it is made again, as one that was INTERRUPTED.
        """
        bag = self._bags.get(number)
        if bag is None or (bag.path.parent / REPEATED_MARK).exists():
            return None
        goals = self._settings.goals
        try:
            result = result_of(recorded_swim(bag, {}, goals.needs), goals)
        except BagError:
            return None
        return result if result.outcome in {Outcome.OK, Outcome.INFEASIBLE} else None

    def told(self, number: int) -> TrialRecord | None:
        """Return the trial of a number as its bag tells it; None if no bag does."""
        if number not in self._told:
            self._told[number] = self._read(number)
        return self._told[number]

    def _read(self, number: int) -> TrialRecord | None:
        bag = self._bags.get(number)
        try:
            values = None if bag is None else _values(self._settings, bag.metadata)
            candidate = int(bag.metadata[_CANDIDATE]) if bag is not None else 0
        except (LookupError, ValueError):
            return None
        if bag is None or values is None or candidate < 0:
            return None
        result = self.result(number) or Result(Outcome.INTERRUPTED, _LOST)
        return TrialRecord(
            number=number,
            candidate=candidate,
            values=values,
            outcome=result.outcome,
            reason=result.reason,
            measured=result.measured,
            spread=result.spread,
            samples=result.samples,
            plant=bag.metadata.get(_NAMESPACE, ""),
            bag=f"{BAG_FOLDER}/{self._names[number]}",
            started=_moment(bag.metadata.get(_STARTED, "")),
            ended=datetime.fromtimestamp(max(file.stat().st_mtime for file in bag.files)).astimezone(),
        )


def _values(settings: Settings, metadata: Mapping[str, str]) -> Values:
    """Return what was searched of a bag's candidate.

    Raises:
        ValueError: It is not a candidate of the study.
        LookupError: The metadata do not say it.
    """
    if VALUES in metadata:
        said = json.loads(metadata[VALUES])
    else:
        said = {name: _value(metadata[name]) for name in settings.space.names}
    return settings.space.check(said)


def _fish(metadata: Mapping[str, str]) -> dict[str, Any]:
    return {name: _value(text) for name, text in metadata.items() if not name.startswith(_NO_FISH)}


def _value(text: str) -> Any:
    """Return a parameter that metadata tell: JSON, or a text."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def _moment(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None
