"""A bag that was damaged anywhere is refused or repaired with a sentence: it never gives another number."""

from __future__ import annotations

import shutil
from random import Random
from typing import TYPE_CHECKING

import pytest
from mcap.writer import Writer

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.repair import repair_bag
from fin_optimizer.commands import score_bag
from support.bags import write_swim
from support.damage import damaged

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def swim(tmp_path: Path) -> Path:
    return write_swim(tmp_path / "bags" / "trial_0007")


def mcap(bag: Path) -> Path:
    return next(bag.glob("*.mcap"))


def leave_open(bag: Path) -> None:
    """Take the end of a bag off, as a kill does."""
    content = mcap(bag).read_bytes()
    mcap(bag).write_bytes(content[: content.index(b"rosbag2") - 13])
    (bag / "metadata.yaml").unlink()


def scored(bag: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what `score_bag` prints of a bag, empty if it refuses it with a sentence."""
    code = score_bag.main([str(bag)])
    shown = capsys.readouterr()
    assert bool(shown.out) == (code == 0)
    if code:
        assert shown.err.startswith(("score_bag: error: ", "note: ")), shown.err
    return shown.out


def damage_and_score(bag: Path, name: str, rounds: int, seed: int, capsys: pytest.CaptureFixture[str]) -> int:
    """Damage a file of a bag again and again, score and repair it; return how often it was refused."""
    random = Random(seed)  # noqa: S311  (a fixed sequence of damages, no secret)
    true = scored(bag, capsys)
    assert true
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    refused = 0
    for _ in range(rounds):
        shutil.rmtree(bag, ignore_errors=True)
        bag.mkdir()
        for path, content in before.items():
            (bag / path).write_bytes(content)
        (bag / name).write_bytes(damaged(before[name], random))
        found = scored(bag, capsys)
        assert found in {true, ""}
        refused += not found
        repair = repair_bag(bag)
        if repair is not None:
            assert str(repair)
        if bag.exists():
            assert scored(bag, capsys) in {true, ""}
    return refused


@pytest.mark.parametrize("state", ["closed", "left open"])
def test_a_bag_damaged_anywhere_is_refused_or_gives_the_same_score(
    swim: Path, state: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if state == "left open":
        leave_open(swim)
    assert damage_and_score(swim, mcap(swim).name, 120, 1, capsys) > 60


def test_a_metadata_file_damaged_anywhere_changes_no_score(swim: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert damage_and_score(swim, "metadata.yaml", 100, 2, capsys) > 0


def test_a_bag_that_was_cut_after_it_was_closed_is_no_bag_of_a_killed_trial(swim: Path) -> None:
    content = mcap(swim).read_bytes()
    mcap(swim).write_bytes(content[: content.index(b"rosbag2") // 2])
    with pytest.raises(BagError, match=r"it was cut after it was closed: metadata\.yaml tells of \d+ messages, and"):
        read_bag(swim)
    cut = mcap(swim).read_bytes()
    repair = repair_bag(swim)
    assert repair is not None
    assert "it was cut after it was closed" in repair.failure
    assert mcap(swim).read_bytes() == cut


def test_an_open_bag_whose_middle_is_lost_is_no_bag_of_a_killed_trial(swim: Path) -> None:
    leave_open(swim)
    content = mcap(swim).read_bytes()
    second = content.index(b"\x04\0\0\0zstd", content.index(b"zstd") + 4) - 37
    mcap(swim).write_bytes(content[:second] + b"\0" + content[second + 1 :])
    with pytest.raises(BagError, match=f"is damaged at byte {second}, and goes on behind that"):
        read_bag(swim)


def test_metadata_that_were_exchanged_are_noticed(swim: Path) -> None:
    text = (swim / "metadata.yaml").read_text()
    (swim / "metadata.yaml").write_text(text.replace("trial.number: '7'", "trial.number: '8'"))
    with pytest.raises(BagError, match=r"metadata\.yaml and the bag differ in trial\.number"):
        read_bag(swim)


def as_older_versions_wrote(path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a bag without check sums of its trial record, its data and its summary."""
    with monkeypatch.context() as older:
        older.setattr("fin_optimizer.bags.writer.WITH_SUMS", "fin_optimizer")
        older.setattr("fin_optimizer.bags.writer.TRIAL_SUM", "something else")
        older.setattr(
            "fin_optimizer.bags.writer.Writer",
            lambda *given, **named: Writer(*given, **{**named, "enable_data_crcs": False}),
        )
        return write_swim(path)


def test_a_bag_of_an_older_version_is_scored_with_a_note(
    swim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    old = as_older_versions_wrote(tmp_path / "bags" / "trial_0008", monkeypatch)
    assert (read_bag(swim).guarded, read_bag(old).guarded) == (True, False)
    assert score_bag.main([str(tmp_path / "bags")]) == 0
    out, err = capsys.readouterr()
    assert len({line.split()[0] for line in out.splitlines()}) == 1
    assert err.startswith("note: 1 of 2 bags was recorded without check sums, by an older version or another program")


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(10))
def test_ten_thousand_damages_of_a_bag_give_no_other_score(
    swim: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    if seed % 2:
        leave_open(swim)
    assert damage_and_score(swim, mcap(swim).name, 1000, seed, capsys) > 500
