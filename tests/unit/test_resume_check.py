"""A study that is gone on with says which of its scores do not follow from their bags any more."""

from __future__ import annotations

import os
import shutil
from itertools import count
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.score.recorded import score_bag
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.resume_check import check_scores
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome, Result
from support.bags import write_swim
from support.old_studies import take_off_check_sums

if TYPE_CHECKING:
    from pathlib import Path

MODULUS = "fin.young_modulus"
SETTINGS = Settings(Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),)))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Return the folder of a study with seven OK trials, each with its bag, and one that FAILED."""
    folder = tmp_path / "study"
    with Study.create(folder, SETTINGS) as begun:
        for number in range(8):
            record = begun.start(begun.propose(number, {MODULUS: 1e9 + number}).number)
            scored, _ = score_bag(write_swim(folder / record.bag))
            ok = Result(Outcome.OK, measured={"mean_speed": scored.value}, spread=scored.spread, samples=scored.samples)
            begun.finish(number, ok if number < 7 else Result(Outcome.FAILED, "no velocity for 1 s"))
    return folder


def bag(study: Path, number: int) -> Path:
    return study / read_trials(study)[number].bag


def change_scores(study: Path, numbers: list[int]) -> None:
    """Change the last digits of scores in a journal that carries no check sums."""
    if (study / "journal.end").exists():
        take_off_check_sums(study)
    lines = (study / "journal.log").read_text().splitlines(keepends=True)
    ends = [index for index, line in enumerate(lines) if '"op_code":6' in line and '"state":1' in line]
    for number in numbers:
        lines[ends[number]] = lines[ends[number]].replace('"values":[0.1', '"values":[0.2')
    (study / "journal.log").write_text("".join(lines))


def test_scores_that_follow_from_their_bags_are_not_spoken_of(study: Path) -> None:
    assert check_scores(study, read_trials(study)) == []


def test_a_bag_that_was_damaged_or_exchanged_is_named_with_its_trial(study: Path) -> None:
    file = next(bag(study, 2).glob("*.mcap"))
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    shutil.rmtree(bag(study, 4))
    write_swim(bag(study, 4), duration=1.5)
    notes = check_scores(study, read_trials(study))
    assert len(notes) == 2
    assert notes[0].startswith("trial 0004: its score does not follow from its bag any more: speed [m/s] is 0.1")
    assert "trial 0002: its score does not follow from its bag any more: bag " in notes[1]
    assert "is damaged" in notes[1]


def test_a_changed_journal_without_check_sums_is_named_and_a_long_list_ends(study: Path) -> None:
    change_scores(study, [1])
    (note,) = check_scores(study, read_trials(study))
    assert note.startswith("trial 0001: its score does not follow from its bag any more: speed [m/s] is 0.1")
    assert "and 0.2" in note
    change_scores(study, [0, 2, 3, 4, 5, 6])
    notes = check_scores(study, read_trials(study))
    assert [note.partition(":")[0] for note in notes[:5]] == [f"trial {number:04d}" for number in (6, 5, 4, 3, 2)]
    assert notes[5] == "2 more scores do not follow from their bags: score_bag names all"


def test_bags_that_were_moved_away_are_counted(study: Path) -> None:
    for number in (0, 5):
        shutil.rmtree(bag(study, number))
    assert check_scores(study, read_trials(study)) == [
        "2 of 7 OK trials have no bag any more: their scores cannot be checked"
    ]


def test_the_check_ends_after_its_time_and_begins_with_bags_written_to_since(study: Path) -> None:
    trials = read_trials(study)
    write_swim(study / "elsewhere", duration=1.5)
    file = next(bag(study, 0).glob("*.mcap"))
    shutil.copy(next((study / "elsewhere").glob("*.mcap")), file)
    later = trials[0].ended
    assert later is not None
    os.utime(file, (later.timestamp() + 60,) * 2)
    seconds = count()
    notes = check_scores(study, trials, longest=3.0, clock=lambda: float(next(seconds)))
    assert notes[0].startswith("trial 0000: its score does not follow from its bag any more")
    assert notes[1:] == ["2 of 7 scores were compared with their bags in 3 s; score_bag of the study compares all"]
