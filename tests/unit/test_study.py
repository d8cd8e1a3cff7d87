"""The ledger keeps every trial, goes on where it stopped, and refuses to mix what must not be mixed."""

from __future__ import annotations

import errno
import json
import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
import optuna
import pytest
from optuna.visualization import matplotlib as plots

from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.candidate import Candidate, is_for_another
from fin_optimizer.study.checked_journal import CheckedJournal
from fin_optimizer.study.file_names import JOURNAL_FILE, SETTINGS_FILE
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.journal import END_FILE, StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Policy, Settings
from fin_optimizer.trial.result import Outcome, Result
from support.simultaneous_studies import begin_together

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from fin_optimizer.search.space import Search, Values

MODULUS = "fin.young_modulus"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
SETTINGS = Settings(SPACE, Policy(repeats=1, attempts=2), {"seed": 1, "gait.frequency": 0.9})
SEARCH = HillClimber(SPACE, 1, {MODULUS: math.sqrt(0.1) * 1e9})
FAILED = Result(Outcome.FAILED, "no message on topic /fish/velocity")
INTERRUPTED = Result(Outcome.INTERRUPTED, "Ctrl-C")
GONE = Result(Outcome.INTERRUPTED, "nobody publishes topic /fish/plant_state any more")
INFEASIBLE = Result(Outcome.INFEASIBLE, "thicker than long")


def ok(score: float) -> Result:
    return Result(Outcome.OK, measured={"mean_speed": score}, spread=0.001, samples=1000)


def hump(modulus: float) -> float:
    return 0.03 - abs(modulus - 1.1e9) / 1e11


def following(study: Study, search: Search = SEARCH) -> tuple[int, Values]:
    """Return what is to be tried next, which must be something."""
    candidate = study.next_candidate(search)
    assert candidate is not None
    return candidate


def swim(study: Study, result: Result | None = None) -> float:
    """Make one trial; return the value tried."""
    number, values = following(study)
    record = study.propose(number, values)
    study.start(record.number)
    study.finish(record.number, result or ok(hump(values[MODULUS])))
    return float(values[MODULUS])


def tried(study: Study) -> list[float]:
    return [trial.values[MODULUS] for trial in study.trials]


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let go of every study at the end of the test."""
    opened: list[Study] = []
    begin = Study.__init__

    def note(study: Study, *arguments: Any) -> None:
        begin(study, *arguments)
        opened.append(study)

    monkeypatch.setattr(Study, "__init__", note)
    yield
    for study in opened:
        study.close()


pytestmark = pytest.mark.usefixtures("closed")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "a study"


def journal_states(folder: Path) -> list[str]:
    """Return the trials' states as Optuna itself, and so its dashboard, reads them."""
    backend = optuna.storages.journal.JournalFileBackend(str(folder / JOURNAL_FILE))
    study = optuna.load_study(study_name=None, storage=optuna.storages.JournalStorage(backend))
    return [trial.state.name for trial in study.trials]


def test_each_step_of_a_trial_is_in_the_journal_before_the_next_one_happens(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    record = study.propose(0, {MODULUS: 1e9})
    assert (record.outcome, record.bag) == (Outcome.PROPOSED, "bags/trial_0000_E1GPa")
    assert journal_states(folder) == ["WAITING"]
    assert study.start(0).outcome is Outcome.RUNNING
    assert journal_states(folder) == ["RUNNING"]
    ended = study.finish(0, ok(0.02))
    assert (ended.outcome, ended.score, ended.spread, ended.samples) == (Outcome.OK, 0.02, 0.001, 1000)
    assert ended.started is not None
    assert ended.ended is not None
    assert ended.started <= ended.ended
    assert journal_states(folder) == ["COMPLETE"]


def test_every_entry_is_on_the_disk_before_the_call_returns(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study.create(folder, SETTINGS)
    synced: list[int] = []
    really = os.fsync

    def fsync(descriptor: int) -> None:
        really(descriptor)
        synced.append(os.fstat(descriptor).st_size)

    def is_synced() -> bool:
        return synced[-1] == (folder / JOURNAL_FILE).stat().st_size

    monkeypatch.setattr(os, "fsync", fsync)
    study.propose(0, {MODULUS: 1e9})
    assert is_synced()
    study.start(0)
    assert is_synced()
    study.finish(0, ok(0.02))
    assert is_synced()


def test_outcomes_are_optunas_states_and_reasons_are_kept(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    for result in (INFEASIBLE, FAILED, FAILED, ok(0.02)):
        swim(study, result)
    study.close()
    assert journal_states(folder) == ["PRUNED", "FAIL", "FAIL", "COMPLETE"]
    trials = Study.open(folder).trials
    assert [trial.reason for trial in trials] == [INFEASIBLE.reason, FAILED.reason, FAILED.reason, ""]
    assert [trial.score for trial in trials] == [None, None, None, 0.02]


@pytest.mark.parametrize("interruption", [0, 1, 7, 19])
def test_a_study_that_was_closed_and_opened_tries_what_an_uninterrupted_one_tries(
    tmp_path: Path, interruption: int
) -> None:
    whole = Study.create(tmp_path / "whole", SETTINGS)
    for _ in range(20):
        swim(whole)
    study = Study.create(tmp_path / "cut", SETTINGS)
    for _ in range(interruption):
        swim(study)
    study.close()
    study = Study.open(tmp_path / "cut", SETTINGS)
    for _ in range(20 - interruption):
        swim(study)
    assert tried(study) == tried(whole)
    assert study.best() is not None


@pytest.mark.parametrize("begun", ["proposed", "started"])
def test_a_trial_that_a_kill_left_open_is_failed_and_made_again(folder: Path, begun: str) -> None:
    study = Study.create(folder, SETTINGS)
    swim(study)
    number, values = following(study)
    study.propose(number, values)
    if begun == "started":
        study.start(1)
    study.close()  # what a kill does to the lock

    again = Study.open(folder, SETTINGS)
    assert again.trials[1].outcome is Outcome.INTERRUPTED
    assert "the optimiser's process ended" in again.trials[1].reason
    assert again.notes == ["trial 0001 was under way when the optimiser ended: INTERRUPTED, made again"]
    assert following(again) == (number, values)
    assert swim(again) == values[MODULUS]


@pytest.mark.parametrize(
    ("results", "settled"),
    [
        ([ok(0.02)], True),
        ([INFEASIBLE], True),
        ([FAILED], False),
        ([FAILED, FAILED], True),
        ([INTERRUPTED, INTERRUPTED, INTERRUPTED], False),
        ([INTERRUPTED, FAILED, ok(0.02)], True),
    ],
)
def test_a_fin_is_tried_again_until_it_is_settled(folder: Path, results: list[Result], settled: bool) -> None:
    study = Study.create(folder, SETTINGS)
    values = [swim(study, result) for result in results]
    assert len(set(values)) == 1
    assert (study.settled(), following(study)[0]) == ((1, 1) if settled else (0, 0))


@pytest.mark.parametrize(
    ("failed_on", "there", "elsewhere"),
    [
        ("", "ab", False),
        ("b", "ab", False),
        ("a", "ab", True),
        ("ab", "ab", False),
        ("a", "a", False),
        ("ab", "abc", True),
        ("abc", "abc", False),
    ],
)
def test_a_fin_that_failed_on_a_fish_is_swum_by_another_as_long_as_there_is_one_where_it_did_not_fail(
    folder: Path, failed_on: str, there: str, elsewhere: bool
) -> None:
    study = Study.create(folder, Settings(SPACE, Policy(attempts=10)))
    for plant in failed_on:
        study.propose(*following(study), plant)
        study.finish(len(study.trials) - 1, GONE)
    study.propose(*following(study), "c")
    assert is_for_another(study.candidates[0], "a", list(there)) is elsewhere


def test_a_fish_swims_on_while_a_fin_that_failed_on_it_waits_for_another_one(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    study.propose(*following(study), "a")
    study.finish(0, FAILED)

    def waits(candidate: Candidate) -> bool:
        return is_for_another(candidate, "a", ["a", "b"])

    assert study.next_candidate(SEARCH, is_left=waits) == (1, study.next_candidate(SEARCH, is_left=lambda _: True)[1])  # type: ignore[index]
    assert study.next_candidate(SEARCH, 1, is_left=waits) is None
    assert following(study)[0] == 0


def test_a_search_is_told_which_fins_may_have_a_score_yet(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    swim(study)
    swim(study, INFEASIBLE)
    study.start(study.propose(*following(study)).number)
    assert [(entry.score is None, entry.pending) for entry in study.history] == [
        (False, False),
        (True, False),
        (True, True),
    ]
    study.finish(2, FAILED)
    assert study.history[2].pending, "it will be swum again"
    assert swim(study, FAILED) == study.history[2].values[MODULUS]
    assert not study.history[2].pending, "it was given up"


def test_nothing_is_proposed_beyond_the_total_also_where_it_has_become_smaller(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    for _ in range(3):
        swim(study)
    assert [study.next_candidate(SEARCH, total) for total in (2, 3)] == [None, None]


def test_a_fin_is_not_settled_while_one_of_its_swims_is_under_way(folder: Path) -> None:
    study = Study.create(folder, Settings(SPACE, Policy(repeats=3, attempts=2)))
    for plant in "abc":
        study.start(study.propose(*following(study), plant).number)
    study.finish(0, FAILED)
    study.finish(1, FAILED)
    assert study.settled() == 0
    assert following(study)[0] == 1, "it is given up: no further swim of it is begun"
    study.finish(2, ok(0.02))
    assert study.settled() == 1
    assert study.candidates[0].score == 0.02


@pytest.mark.parametrize("room", range(3))
def test_an_interruption_stays_one_where_the_disk_refuses_half_of_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    settings = Settings(SPACE, Policy(attempts=1))
    study = Study.create(folder, settings)
    study.start(study.propose(*following(study)).number)
    backend = CheckedJournal
    written, append = iter(range(room)), backend.append_logs

    def append_while_there_is_room(self: Any, logs: Any) -> None:
        if next(written, None) is None:
            raise OSError(errno.ENOSPC, "No space left on device")
        append(self, logs)

    with monkeypatch.context() as full_disk:
        full_disk.setattr(backend, "append_logs", append_while_there_is_room)
        with pytest.raises(StudyError):
            study.finish(0, INTERRUPTED)
    study.close()
    again = Study.open(folder, settings)
    assert again.trials[0].outcome is Outcome.INTERRUPTED
    assert following(again)[0] == 0


def test_the_first_fish_met_is_the_studys_and_another_one_is_named(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    fish = {"plant": "simulator", "body.mass": 0.1 + 0.2, "reactive": "elongated_body"}
    assert study.keep_or_compare(fish) == []
    study.close()
    again = Study.open(folder, SETTINGS)
    assert again.keep_or_compare(fish) == []
    assert again.keep_or_compare(fish | {"body.mass": 1.0}) == ["body.mass is 0.30000000000000004 there and 1.0 here"]
    assert again.keep_or_compare({"plant": "robot"})[0] == "plant is simulator there and robot here"
    assert again.keep_or_compare(fish) == [], "the study's fish stays the one it was"


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
def test_optunas_own_plots_work_on_the_journal(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    study.keep_or_compare({"plant": "simulator", "peduncle.length": [0.1, 0.2]})
    for result in (None, FAILED, None, INFEASIBLE, None):
        swim(study, result)
    backend = optuna.storages.journal.JournalFileBackend(str(folder / JOURNAL_FILE))
    ledger = optuna.load_study(study_name=None, storage=optuna.storages.JournalStorage(backend))
    history = plots.plot_optimization_history(ledger)
    scored = [trial.score for trial in study.trials if trial.score is not None]
    assert np.asarray(history.collections[0].get_offsets())[:, 1].tolist() == scored
    slices: Any = plots.plot_slice(ledger)
    assert slices.get_xlabel() == MODULUS
    plots.plot_timeline(ledger)


def test_repeats_of_a_fin_are_averaged(folder: Path) -> None:
    study = Study.create(folder, Settings(SPACE, Policy(repeats=3)))
    for score in (0.02, 0.03, 0.04):
        assert study.settled() == 0
        swim(study, ok(score))
    assert study.settled() == 1
    assert [candidate.score for candidate in study.candidates] == [pytest.approx(0.03)]


def test_the_best_fin_is_so_by_the_mean_of_all_that_it_has_swum_by_now(folder: Path) -> None:
    """After 0.03 and 0.01 m/s it is no better than one that swam 0.025 m/s."""
    study = Study.create(folder, Settings(SPACE, Policy(repeats=2)))
    seen = []
    for candidate, score in ((0, 0.03), (1, 0.025), (0, 0.01), (1, 0.027)):
        record = study.propose(candidate, {MODULUS: (1 + candidate) * 1e9})
        study.start(record.number)
        study.finish(record.number, ok(score))
        best = study.best()
        assert best is not None
        seen.append((best.number, best.score))
    assert seen == [(0, 0.03), (0, 0.03), (1, 0.025), (1, pytest.approx(0.026))]


def test_a_fin_that_failed_never_becomes_the_one_to_step_from(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    for result in (FAILED, FAILED, ok(0.01), INFEASIBLE):
        swim(study, result)
    best = study.best()
    assert best is not None
    assert (best.number, best.score) == (1, 0.01)


OTHERS = [
    (Settings(SPACE, Policy(), {"seed": 2, "gait.frequency": 0.9}), "seed is 1 there and 2 here"),
    (Settings(SPACE, Policy(), {"seed": 1}), "gait.frequency is 0.9 there and not set here"),
    (Settings(SPACE, Policy(repeats=3), SETTINGS.details), "repeats is 1 there and 3 here"),
    (
        Settings(Space((Dimension(MODULUS, 0.5e9, 5e9, "Pa"),)), Policy(), SETTINGS.details),
        "range of fin.young_modulus is [500000000.0, 4000000000.0] Pa there and [500000000.0, 5000000000.0] Pa here",
    ),
]


@pytest.mark.parametrize(("settings", "message"), OTHERS)
def test_other_settings_are_refused_by_name_and_nothing_is_changed(
    folder: Path, settings: Settings, message: str
) -> None:
    study = Study.create(folder, SETTINGS)
    swim(study)
    study.propose(*following(study))
    study.close()
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(StudyError) as refused:
        Study.open(folder, settings)
    assert message in str(refused.value)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_folder_in_use_or_not_a_study_is_refused(folder: Path, tmp_path: Path) -> None:
    study = Study.create(folder, SETTINGS)
    with pytest.raises(StudyError, match="another optimiser is working on"):
        Study.open(folder, SETTINGS)
    study.close()
    with pytest.raises(StudyError, match="holds a study already"):
        Study.create(folder, SETTINGS)
    with pytest.raises(StudyError, match="holds no study"):
        Study.open(tmp_path / "nothing")
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "to mother.txt").touch()
    with pytest.raises(StudyError, match="neither empty nor a study's folder"):
        Study.create(tmp_path / "letters", SETTINGS)


def test_a_creation_that_a_kill_cut_short_is_begun_again(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "study.json.partial").write_text('{"form')
    (folder / "study.json.8kzj2x_q.partial").write_text("{")
    swim(Study.create(folder, SETTINGS))


def test_of_several_optimisers_that_begin_a_study_at_the_same_moment_one_has_it_and_the_others_are_told(
    tmp_path: Path,
) -> None:
    folders = [tmp_path / f"study {number}" for number in range(40)]
    for folder, words in zip(folders, begin_together(folders, processes=3), strict=True):
        winner = words.index("")
        assert read_settings(folder).details["seed"] == winner, "the winner works with other settings than it wrote"
        refusals = [word for seed, word in enumerate(words) if seed != winner]
        assert all(word.startswith(f"StudyError: {folder} holds a study already") for word in refusals), words
        assert not list(folder.glob("*.partial"))


def test_a_study_is_begun_where_the_file_system_has_no_hard_links(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def link(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")  # what vfat says

    monkeypatch.setattr(os, "link", link)
    study = Study.create(folder, SETTINGS)
    swim(study)
    with pytest.raises(StudyError, match="another optimiser is working on"):
        Study.open(folder, SETTINGS)
    with pytest.raises(StudyError, match="holds a study already"):
        Study.create(folder, SETTINGS)
    study.close()
    assert len(Study.open(folder, SETTINGS).trials) == 1
    assert not list(folder.glob("*.partial"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"format": 4}', "its format 4 is newer than the 3 that this version knows"),
        ('{"form', "it is no study's settings"),
        ("[]", "it is no study's settings"),
    ],
)
def test_settings_that_cannot_be_read_are_refused(folder: Path, content: str, message: str) -> None:
    Study.create(folder, SETTINGS).close()
    (folder / SETTINGS_FILE).write_text(content)
    with pytest.raises(StudyError, match=message):
        Study.open(folder)


def test_the_journal_may_be_cut_at_any_byte_of_its_last_entry(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    swim(study)
    swim(study)
    study.close()
    journal = folder / JOURNAL_FILE
    whole, end = journal.read_bytes(), (folder / END_FILE).read_bytes()
    last = whole[:-1].rfind(b"\n") + 1
    assert json.loads(whole[last:])["state"] == optuna.trial.TrialState.COMPLETE
    for length in range(last, len(whole)):
        journal.write_bytes(whole[:length])
        (folder / END_FILE).write_bytes(end)
        again = Study.open(folder, SETTINGS)
        assert [trial.outcome for trial in again.trials] == [Outcome.OK, Outcome.INTERRUPTED]
        assert ("cut short" in again.notes[0]) == (length > last)
        swim(again)
        again.close()
        assert journal_states(folder) == ["COMPLETE", "FAIL", "COMPLETE"]


def test_a_lock_that_a_killed_process_left_does_not_hold_up_the_study(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    study.close()
    lock = folder / (JOURNAL_FILE + ".lock")
    lock.symlink_to("nowhere")
    os.utime(lock, (0, 0), follow_symlinks=False)
    swim(Study.open(folder, SETTINGS))


def test_a_value_outside_the_space_is_not_written_down(folder: Path) -> None:
    study = Study.create(folder, SETTINGS)
    with pytest.raises(ValueError, match=r"fin\.young_modulus = 5e\+09 Pa is outside"):
        study.propose(0, {MODULUS: 5e9})
    assert journal_states(folder) == []


@pytest.mark.parametrize(
    ("line", "message"),
    [(b'{"op_code":10,"study_id":0}', "operation 10, which this version does not know"), (b'{"op', "is damaged")],
)
def test_a_journal_of_a_newer_version_or_damaged_inside_is_refused_and_not_changed(
    folder: Path, line: bytes, message: str
) -> None:
    study = Study.create(folder, SETTINGS)
    swim(study)
    study.close()
    journal = folder / JOURNAL_FILE
    journal.write_bytes(journal.read_bytes() + line + b"\n" + b'{"op_code":5')
    before = journal.read_bytes()
    with pytest.raises(StudyError, match=message):
        Study.open(folder, SETTINGS)
    assert journal.read_bytes() == before
