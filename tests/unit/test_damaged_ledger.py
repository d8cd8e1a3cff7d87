"""A ledger that was damaged, or that something else changed, is refused or repaired with a sentence."""

from __future__ import annotations

import json
import shutil
from random import Random
from typing import TYPE_CHECKING

import optuna
import pytest
from hypothesis import HealthCheck, given, settings, strategies

from fin_optimizer.commands import export, recover_study, score_bag, show_study
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.file_names import JOURNAL_FILE, SETTINGS_FILE
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.journal import END_FILE, StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.settings import Policy, Settings
from fin_optimizer.trial.result import Outcome, Result
from support.damage import damaged
from support.old_studies import take_off_check_sums

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fin_optimizer.study.candidate import TrialRecord

MODULUS, LENGTH = "fin.young_modulus", "fin.length"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"), Dimension(LENGTH, 0.05, 0.12, "m")))
SETTINGS = Settings(SPACE, Policy(repeats=1, attempts=2), {"seed": 1, "gait.frequency": 0.9})
RESULTS = [
    Result(Outcome.OK, measured={"mean_speed": 0.0213}, spread=0.001, samples=1000),
    Result(Outcome.FAILED, "no velocity for 1 s"),
    Result(Outcome.INFEASIBLE, "thicker than long"),
    Result(Outcome.OK, measured={"mean_speed": 0.0187}, spread=0.002, samples=999),
    Result(Outcome.OK, measured={"mean_speed": 0.0199}, spread=0.002, samples=1001),
]


def make_study(folder: Path, results: list[Result] = RESULTS, *, bags: bool = True) -> Path:
    """Begin a study and make its trials; the bags are empty folders, which is all that the ledger looks at."""
    with Study.create(folder, SETTINGS) as study:
        study.keep_or_compare({"plant": "simulator"})
        for number, result in enumerate(results, start=len(study.trials)):
            record = study.start(study.propose(number, {MODULUS: 1e9 + 1e8 * number, LENGTH: 0.08}, "/fish").number)
            if bags:
                (folder / record.bag).mkdir()
            study.finish(record.number, result)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_study(tmp_path / "study")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def check_trials(found: list[TrialRecord], true: list[TrialRecord], notes: list[str]) -> None:
    """A trial is as it was; only the outcome of the last one may be lost, which is then said."""
    assert found[:-1] == true[: len(found) - 1]
    assert len(found) in {len(true), len(true) - 1}
    if found != true:
        assert notes
        last = found[-1]
        assert (last.values, last.score) == (true[last.number].values, None) or last == true[last.number]


def damage_and_read(folder: Path, name: str, rounds: int, seed: int) -> tuple[int, int]:
    """Damage a file of a study again and again, and read it; return how often it was refused and how often repaired."""
    random = Random(seed)  # noqa: S311  (a fixed sequence of damages, no secret)
    true = read_trials(folder)
    before = contents(folder)
    refused = repaired = 0
    for _ in range(rounds):
        for path, content in before.items():
            (folder / path).write_bytes(content)
        (folder / name).write_bytes(damaged(before[name], random))
        as_damaged = contents(folder)
        notes: list[str] = []
        try:
            trials = read_trials(folder, notes.append)
        except StudyError:
            refused += 1
            with pytest.raises(StudyError):
                Study.open(folder)
            assert contents(folder) == as_damaged
            continue
        check_trials(trials, true, notes)
        assert read_settings(folder) == SETTINGS
        with Study.open(folder) as study:
            check_trials(list(study.trials), true, study.notes)
        repaired += 1
    return refused, repaired


@pytest.mark.parametrize(("name", "rounds"), [(JOURNAL_FILE, 300), (SETTINGS_FILE, 100), (END_FILE, 50)])
def test_a_ledger_damaged_anywhere_is_refused_or_repaired_with_a_sentence(folder: Path, name: str, rounds: int) -> None:
    refused, repaired = damage_and_read(folder, name, rounds, seed=1)
    assert refused + repaired == rounds
    if name != END_FILE:
        assert refused > 0.8 * rounds


@given(data=strategies.data())
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_whatever_stands_in_place_of_some_bytes_of_a_journal_no_number_changes(
    folder: Path, data: strategies.DataObject
) -> None:
    journal = folder / JOURNAL_FILE
    whole = journal.read_bytes()
    true = read_trials(folder)
    start = data.draw(strategies.integers(0, len(whole)))
    end = data.draw(strategies.integers(start, min(len(whole), start + 300)))
    journal.write_bytes(whole[:start] + data.draw(strategies.binary(max_size=50)) + whole[end:])
    notes: list[str] = []
    try:
        check_trials(read_trials(folder, notes.append), true, notes)
    except StudyError:
        pass
    finally:
        journal.write_bytes(whole)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(4))
def test_ten_thousand_damages_of_a_journal_are_refused_or_repaired_with_a_sentence(tmp_path: Path, seed: int) -> None:
    folder = make_study(tmp_path / "study", bags=seed % 2 == 0)
    assert sum(damage_and_read(folder, JOURNAL_FILE, 2500, seed)) == 2500


@pytest.mark.parametrize("rounds", [200, pytest.param(10_000, marks=pytest.mark.long)])
def test_a_damaged_journal_of_an_older_version_never_ends_a_tool_with_a_traceback(
    folder: Path, rounds: int, capsys: pytest.CaptureFixture[str]
) -> None:
    take_off_check_sums(folder)
    random = Random(2)  # noqa: S311  (a fixed sequence of damages, no secret)
    journal = folder / JOURNAL_FILE
    whole = journal.read_bytes()
    for _ in range(rounds):
        journal.write_bytes(damaged(whole, random))
        code = show_study.main([str(folder)])
        said = capsys.readouterr().err
        assert said.startswith("note: " if code == 0 else "show_study: error: "), said
        try:
            Study.open(folder).close()
        except StudyError:
            assert code == 2


def dashboard(folder: Path) -> tuple[optuna.storages.JournalStorage, int]:
    """Return the journal as Optuna's dashboard opens it, which knows of no check sums, and the study's number there."""
    backend = optuna.storages.journal.JournalFileBackend(str(folder / JOURNAL_FILE))
    storage = optuna.storages.JournalStorage(backend)
    return storage, storage.get_study_id_from_name("study")


def rename(folder: Path) -> None:
    """Do what Optuna's dashboard does to rename a study."""
    storage, study = dashboard(folder)
    directions = storage.get_study_directions(study)
    storage.create_new_study(directions, "a better name")
    storage.delete_study(study)


def delete(folder: Path) -> None:
    storage, study = dashboard(folder)
    storage.delete_study(study)


def edit_attribute(folder: Path) -> None:
    storage, study = dashboard(folder)
    storage.set_study_user_attr(study, "fish", {"plant": "robot"})


def add_trial(folder: Path) -> None:
    storage, study = dashboard(folder)
    storage.create_new_trial(study)


def of_another_version(folder: Path) -> None:
    with (folder / JOURNAL_FILE).open("a") as file:
        file.write('{"op_code":10,"worker_id":"w","study_id":0,"trial_ids":[1]}\n')


def no_journal(folder: Path) -> None:
    (folder / JOURNAL_FILE).unlink()


def empty_journal(folder: Path) -> None:
    (folder / JOURNAL_FILE).write_bytes(b"")


def no_journal_nor_its_end(folder: Path) -> None:
    no_journal(folder)
    (folder / END_FILE).unlink()


def shorter_journal(folder: Path) -> None:
    lines = (folder / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    (folder / JOURNAL_FILE).write_bytes(b"".join(lines[:-6]))
    (folder / END_FILE).unlink()


def journal_of_another_study(folder: Path) -> None:
    shutil.copy(make_study(folder.parent / "other") / JOURNAL_FILE, folder / JOURNAL_FILE)


CHANGES: list[tuple[Callable[[Path], None], str]] = [
    (delete, r"line 29 deletes the study, .*: another one changed the journal; .* let recover_study keep"),
    (rename, r"line 29 begins another study, 'a better name'"),
    (edit_attribute, r"line 29 has no check sum and changes the study, .* let recover_study keep"),
    (add_trial, r"line 29 .*(missing|no check sum)"),
    (of_another_version, "line 29 is operation 10, which this version does not know"),
    (no_journal, "is not there and had 28 entries: the last 28 are missing"),
    (empty_journal, "holds 0 and had 28 entries: the last 28 are missing"),
    (no_journal_nor_its_end, r"is missing, but 5 bags of later trials lie beside it \(trial_0000_.* to trial_0004_"),
    (shorter_journal, r"knows 4 trials, but the bag of a later trial lies beside it \(trial_0004"),
    (journal_of_another_study, "check sum of line 1 does not fit line 1 and the study's settings"),
]


@pytest.mark.parametrize(("change", "message"), CHANGES)
@pytest.mark.parametrize("old", [False, True])
def test_a_ledger_that_something_else_changed_is_refused_and_stays_as_it_is(
    folder: Path, change: Callable[[Path], None], message: str, old: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    if old:
        take_off_check_sums(folder)
        if change in {edit_attribute, journal_of_another_study, add_trial}:
            return  # without check sums these are not known from the program's own
        (folder / END_FILE).touch()
    change(folder)
    before = contents(folder)
    with pytest.raises(StudyError, match="." if old else message):
        Study.open(folder, SETTINGS)
    for tool in (show_study, export, score_bag):
        assert tool.main([str(folder)]) == 2
        assert f"{tool.__name__.rpartition('.')[2]}: error: " in capsys.readouterr().err
    assert contents(folder) == before


def test_what_is_kept_of_a_changed_journal_goes_on_as_the_refusal_says(folder: Path) -> None:
    true = read_trials(folder)
    delete(folder)
    assert recover_study.main([str(folder)]) == 0
    with Study.open(folder, SETTINGS) as study:
        assert (list(study.trials), study.notes) == (true, [])


def test_a_note_written_in_the_dashboard_is_told_and_the_study_goes_on(folder: Path) -> None:
    true = read_trials(folder)
    storage, study_id = dashboard(folder)
    storage.set_study_system_attr(study_id, "dashboard:0:note_str:0", "the tank was warm")
    with Study.open(folder, SETTINGS) as study:
        assert list(study.trials) == true
        assert study.notes == ["journal.log line 29: a remark of another program, which changes no trial"]
        storage.set_study_system_attr(study_id, "dashboard:0:note_str:0", "and deep")  # while it is under way
        study.start(study.propose(5, {MODULUS: 2e9, LENGTH: 0.08}).number)
        study.finish(5, RESULTS[0])
    notes: list[str] = []
    assert [trial.score for trial in read_trials(folder, notes.append)][-1] == 0.0213
    assert notes == ["journal.log line 29, 30: a remark of another program, which changes no trial"]


def test_a_study_under_way_notices_that_it_was_deleted_and_writes_nothing_more(folder: Path) -> None:
    with Study.open(folder, SETTINGS) as study:
        delete(folder)
        before = contents(folder)
        with pytest.raises(StudyError, match="line 29 deletes the study"):
            study.propose(5, {MODULUS: 2e9, LENGTH: 0.08})
        assert contents(folder) == before


def test_a_study_of_an_older_version_goes_on_with_a_note_and_is_guarded_from_then_on(folder: Path) -> None:
    take_off_check_sums(folder)
    with Study.open(folder, SETTINGS) as study:
        (note,) = study.notes
        assert "begun by an older version: its entries carry no check sums" in note
        study.start(study.propose(5, {MODULUS: 2e9, LENGTH: 0.08}).number)
        study.finish(5, RESULTS[0])
    whole = (folder / JOURNAL_FILE).read_bytes()
    assert len(read_trials(folder)) == 6
    (folder / JOURNAL_FILE).write_bytes(whole.replace(b"0.0187", b"0.0387"))
    with pytest.raises(StudyError, match="the check sum of line 29 does not fit lines 1 to 29"):
        read_trials(folder)


def test_optuna_reads_a_journal_with_check_sums_as_one_without(folder: Path) -> None:
    storage, study = dashboard(folder)
    with_sums = storage.get_all_trials(study)
    take_off_check_sums(folder)
    storage, study = dashboard(folder)
    assert storage.get_all_trials(study) == with_sums
    assert [trial.state.name for trial in with_sums] == ["COMPLETE", "FAIL", "PRUNED", "COMPLETE", "COMPLETE"]


def test_a_creation_that_a_kill_cut_short_before_the_journal_is_an_empty_study(folder: Path) -> None:
    for path in [*folder.iterdir()]:
        shutil.rmtree(path) if path.is_dir() else path.unlink() if path.name != SETTINGS_FILE else None
    with Study.open(folder, SETTINGS) as study:
        assert study.trials == ()
    assert json.loads((folder / JOURNAL_FILE).read_text().splitlines()[0])["study_name"] == "study"
