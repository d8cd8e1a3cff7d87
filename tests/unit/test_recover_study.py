"""A study whose journal was lost or changed is recovered from what was whole of it, and from its bags."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import optuna
import pytest

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.commands import recover_study, score_bag, show_study
from fin_optimizer.goals import Goals
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.score.recorded import recorded_swim
from fin_optimizer.study.file_names import BAG_FOLDER, JOURNAL_FILE, REPEATED_MARK
from fin_optimizer.study.journal import END_FILE
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import ASKED_FOR_AGAIN, read_ledger, read_trials
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.scored import result_of
from support.bags import write_swim
from support.source_tree import SOURCE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fin_optimizer.study.candidate import TrialRecord

OLD = SOURCE.parents[1] / "tests/data/study_2026_11"
MODULUS = "fin.young_modulus"
FISH = {"plant": "simulator", "body.length": 0.14, "peduncle.length": [], "reactive": "none"}


@pytest.fixture
def plan(tmp_path: Path) -> StudyPlan:
    given = {"study_folder": str(tmp_path / "study"), "measurement.duration": 2.0, "seed": 3}
    return StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))


@pytest.fixture
def folder(plan: StudyPlan) -> Path:
    """A study of five trials: the third is INFEASIBLE, the fourth was INTERRUPTED, and both have no bag."""
    with plan.study() as study:
        study.keep_or_compare(FISH)
        for outcome in (Outcome.OK, Outcome.OK, Outcome.INFEASIBLE, Outcome.INTERRUPTED, Outcome.OK):
            swim(study, plan, outcome)
        return study.folder


def swim(study: Study, plan: StudyPlan, outcome: Outcome) -> None:
    following = study.next_candidate(plan.search)
    assert following is not None
    record = study.start(study.propose(*following, "/fish").number)
    if outcome is not Outcome.OK:
        study.finish(record.number, Result(outcome, "no such fin"))
        return
    assert record.started is not None
    told = {
        "trial.number": str(record.number),
        "trial.candidate": str(record.candidate),
        "trial.started": record.started.isoformat(),
        "plant.namespace": "/fish",
        "plant": "simulator",
        "body.length": "0.14",
        "peduncle.length": "[]",
        "reactive": "none",
        MODULUS: repr(record.values[MODULUS]),
        **{f"study.{name}": str(value) for name, value in study.settings.flat().items()},
    }
    bag = read_bag(write_swim(study.folder / record.bag, metadata=told))
    study.finish(record.number, result_of(recorded_swim(bag, {}), Goals()))


def ignoring_times(trial: TrialRecord) -> TrialRecord:
    return replace(trial, ended=None)


def delete(folder: Path) -> None:
    """Do what a request to Optuna's dashboard on the journal itself did."""
    backend = optuna.storages.journal.JournalFileBackend(str(folder / JOURNAL_FILE))
    storage = optuna.storages.JournalStorage(backend)
    storage.delete_study(storage.get_study_id_from_name("study"))


def lose(folder: Path) -> None:
    (folder / JOURNAL_FILE).unlink()
    (folder / END_FILE).unlink()


def cut(folder: Path) -> None:
    lines = (folder / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    (folder / JOURNAL_FILE).write_bytes(b"".join(lines[:-9]))


def flip(folder: Path) -> None:
    content = bytearray((folder / JOURNAL_FILE).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / JOURNAL_FILE).write_bytes(content)


def take_another_studys(folder: Path) -> None:
    shutil.copy(OLD / JOURNAL_FILE, folder / JOURNAL_FILE)


@pytest.mark.parametrize("change", [delete, lose, cut, flip, take_another_studys])
def test_a_study_is_refused_and_then_recovered_with_every_score_that_a_bag_tells(
    folder: Path, plan: StudyPlan, change: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    true, fish = read_ledger(folder)
    change(folder)
    before = (folder / JOURNAL_FILE).read_bytes() if (folder / JOURNAL_FILE).exists() else None
    assert show_study.main([str(folder)]) == 2
    assert "recover_study" in capsys.readouterr().err
    assert recover_study.main([str(folder)]) == 0
    said = capsys.readouterr().out
    notes: list[str] = []
    found, fish_found = read_ledger(folder, notes.append)
    assert notes == []
    assert fish_found == fish == FISH
    assert len(found) == len(true)
    for trial, as_it_was in zip(found, true, strict=True):
        assert trial.score == as_it_was.score
        if as_it_was.score is None:
            assert trial.outcome in {as_it_was.outcome, Outcome.INTERRUPTED}
        else:
            assert ignoring_times(trial) == ignoring_times(as_it_was)
            assert trial.ended is not None
    assert score_bag.main([str(folder)]) == 0
    if change is delete:
        assert found == true
    if before is not None:
        assert (folder / f"{JOURNAL_FILE}.damaged").read_bytes() == before
        assert "the old journal is journal.log.damaged now" in said
    if change is lose:
        assert "3 trials from bags" in said
        assert "of 2 trials nothing tells how it ended, they are made again: 0002, 0003" in said
    # Where no bag tells a fin, it is the one that the search proposed there.
    assert {trial.candidate: trial.values for trial in found} == {trial.candidate: trial.values for trial in true}
    with Study.open(folder, plan.settings) as study:
        assert study.next_candidate(plan.search) is not None


def test_a_journal_that_is_whole_is_left_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / JOURNAL_FILE).read_bytes()
    assert recover_study.main([str(folder)]) == 0
    assert "nothing to recover" in capsys.readouterr().out
    assert (folder / JOURNAL_FILE).read_bytes() == before
    assert not list(folder.glob("*.damaged*"))


def test_a_study_of_an_older_version_is_recovered_from_its_bags_alone(tmp_path: Path) -> None:
    study = shutil.copytree(OLD, tmp_path / "study")
    true, fish = read_ledger(study)
    lose(study)
    assert recover_study.main([str(study)]) == 0
    found, fish_found = read_ledger(study)
    assert fish_found == fish
    assert [ignoring_times(trial) for trial in found] == [ignoring_times(trial) for trial in true]


def test_a_bag_of_another_study_or_a_second_one_of_a_trial_is_refused_and_nothing_changes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = read_trials(folder)[0]
    lose(folder)
    shutil.copytree(folder / trial.bag, folder / BAG_FOLDER / "trial_0000_copy")
    assert recover_study.main([str(folder)]) == 2
    assert "are both of trial 0000: move the bag that does not belong" in capsys.readouterr().err
    shutil.rmtree(folder / BAG_FOLDER / "trial_0000_copy")
    write_swim(folder / BAG_FOLDER / "trial_0005_other", metadata={"trial.number": "5", "study.seed": "4"})
    assert recover_study.main([str(folder)]) == 2
    assert "trial_0005_other is of another study (study.seed is 4 there and 3 here)" in capsys.readouterr().err
    assert not (folder / JOURNAL_FILE).exists()
    assert not list(folder.glob(".recovery-*"))


def test_without_settings_there_is_nothing_to_recover_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert recover_study.main([str(tmp_path)]) == 2
    assert "holds no study: study.json is missing" in capsys.readouterr().err


def test_a_trial_that_was_asked_for_again_counts_no_more_and_is_swum_again(folder: Path, plan: StudyPlan) -> None:
    with Study.open(folder, plan.settings) as study:
        best = study.best()
        assert best is not None
        settled = study.settled()
        again = study.repeat(best.trials[0].number)
        assert (again.outcome, again.reason, again.score) == (Outcome.INTERRUPTED, ASKED_FOR_AGAIN, None)
        assert study.best() != best
        assert study.settled() == settled - 1
        following = study.next_candidate(plan.search)
        assert following == (best.number, best.values)
    true = read_trials(folder)
    assert true[again.number] == again
    assert (folder / again.bag / REPEATED_MARK).is_file()
    lose(folder)
    assert recover_study.main([str(folder)]) == 0
    assert [trial.score for trial in read_trials(folder)] == [trial.score for trial in true]
