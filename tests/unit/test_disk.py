"""A disk that is full, too full or read-only: a clear error, nothing half written, and the study goes on later."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.bags.disk_space import shortage
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.repair import repair_bag
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.file_names import JOURNAL_FILE
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome, Result
from support.bags import START, STEP, VELOCITY, velocity

if TYPE_CHECKING:
    from pathlib import Path

    from support.disk import Disk

MODULUS = "fin.young_modulus"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
SEARCH = HillClimber(SPACE, 1, {MODULUS: math.sqrt(0.1) * 1e9})
SETTINGS = Settings(SPACE)
METADATA = {"trial.number": "0"}


def swim(study: Study) -> float:
    following = study.next_candidate(SEARCH)
    assert following is not None
    record = study.propose(*following)
    study.start(record.number)
    score = 0.03 - abs(following[1][MODULUS] - 1.1e9) / 1e11
    study.finish(record.number, Result(Outcome.OK, measured={"mean_speed": score}, samples=100))
    return float(following[1][MODULUS])


def test_a_study_on_a_full_disk_keeps_every_entry_and_goes_on_with_the_same_fins(disk: Disk, tmp_path: Path) -> None:
    with Study.create(tmp_path / "elsewhere", SETTINGS) as study:
        expected = [swim(study) for _ in range(8)]
    study = Study.create(disk.path / "study", SETTINGS)
    tried = [swim(study) for _ in range(3)]
    disk.fill()

    def go_on() -> None:
        for _ in range(100):  # the journal's last block has room for some more
            tried.append(swim(study))  # noqa: PERF401  (what was tried before the failure counts)

    with pytest.raises(StudyError, match=r"No space left on device; every entry before is safe"):
        go_on()
    journal = disk.path / "study" / JOURNAL_FILE
    assert journal.read_bytes().endswith(b"\n")
    done = [trial for trial in read_trials(disk.path / "study") if trial.outcome is Outcome.OK]
    assert [trial.values[MODULUS] for trial in done] == tried
    study.close()
    disk.make_room()
    with Study.open(disk.path / "study", SETTINGS) as again:
        while len(tried) < 8:
            tried.append(swim(again))
    assert tried[:8] == expected


def test_a_bag_on_a_full_disk_fails_with_a_reason_and_is_repaired_with_what_it_has(disk: Disk) -> None:
    with pytest.raises(BagError, match="No space left on device"):
        fill_with_velocity(disk.path / "trial_0000")
    messages = sum(read_bag(disk.path / "trial_0000").counts.values())
    disk.mount("-o", "remount,size=4m")
    repair = repair_bag(disk.path / "trial_0000")
    assert repair is not None
    assert repair.failure == ""
    assert sum(repair.counts.values()) == messages > 0
    assert read_bag(disk.path / "trial_0000").complete


def fill_with_velocity(path: Path, minimum_free: float = 0.0) -> None:
    with BagWriter(path, (VELOCITY,), METADATA, minimum_free=minimum_free) as writer:
        for index in range(100_000):
            writer.write(VELOCITY.name, velocity(START + index * STEP, math.sin(index)))
            if index % 50 == 0:
                writer.flush()


def test_a_disk_with_too_little_room_is_refused_before_and_noticed_during_a_trial(disk: Disk) -> None:
    needed = r"has 0\.\d MB free, needed are 0\.1 MB \(parameter disk\.minimum_free\): make room"
    assert shortage(disk.path / "study" / "bags", 1e5) == ""
    with pytest.raises(BagError, match=needed):
        fill_with_velocity(disk.path / "during", minimum_free=1e5)
    left = shortage(disk.path, 1e5)
    assert left
    with pytest.raises(BagError, match=needed):
        fill_with_velocity(disk.path / "before", minimum_free=1e5)
    assert not (disk.path / "before").exists()
    assert read_bag(disk.path / "during").counts[VELOCITY.name] > 0


def test_a_read_only_disk_is_named_and_nothing_is_changed(disk: Disk) -> None:
    with Study.create(disk.path / "study", SETTINGS) as study:
        swim(study)
    disk.mount("-o", "remount,ro")
    with Study.open(disk.path / "study", SETTINGS) as study, pytest.raises(StudyError, match="Read-only file system"):
        swim(study)
    assert [trial.outcome for trial in read_trials(disk.path / "study")] == [Outcome.OK]
    with pytest.raises(BagError, match="Read-only file system"), BagWriter(disk.path / "bag", (VELOCITY,), METADATA):
        pass
    with pytest.raises(OSError, match="Read-only file system"):
        Study.create(disk.path / "other", SETTINGS)
