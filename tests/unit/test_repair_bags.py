"""A bag that was left open is closed with all that is in it; the original stays until its copy is proven equal."""

from __future__ import annotations

import errno
import fcntl
import math
import os
import random
import shutil
from typing import TYPE_CHECKING

import pytest
from rosbags.rosbag2 import Reader

from fin_optimizer.bags import repair as repair_module
from fin_optimizer.bags import writer as bag_module
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.own import is_closed
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.repair import repair_bag, repair_bags
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.commands.repair_bags import main
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.score.recorded import score_bag
from support.bags import START, STATE, STEP, VELOCITY, state, velocity, write_swim

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from support.disk import Disk


def left_open(path: Path, length: int | None = None) -> Path:
    """Make a bag look as a kill leaves it: cut, without metadata.yaml."""
    (path / "metadata.yaml").unlink(missing_ok=True)
    file = next(path.glob("*.mcap"))
    content = file.read_bytes()
    file.write_bytes(content[: len(content) - 20 if length is None else length])
    return path


@pytest.fixture
def swim(tmp_path: Path) -> Path:
    return write_swim(tmp_path / "bags" / "trial_0007_E1.112GPa")


def test_a_closed_bag_needs_no_repair(swim: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in swim.iterdir()}
    assert repair_bag(swim) is None
    assert main([str(swim.parents[1])]) == 0
    assert "every bag was closed" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in swim.iterdir()} == before


def test_a_bag_without_its_end_is_closed_with_every_message_and_the_same_score(swim: Path) -> None:
    score, whole = score_bag(swim)
    left_open(swim)
    repair = repair_bag(swim)
    assert repair is not None
    assert repair.failure == ""
    assert repair.counts == whole.counts
    assert f"{whole.counts['/fish/velocity']} /fish/velocity" in str(repair)
    assert is_closed(swim)
    again, bag = score_bag(swim)
    assert (again, bag.metadata, bag.qos, bag.complete) == (score, whole.metadata, whole.qos, True)
    assert list(bag.messages("velocity")) == list(whole.messages("velocity"))
    with Reader(swim) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == whole.counts
    assert sorted(path.name for path in swim.iterdir()) == ["metadata.yaml", f"{swim.name}_0.mcap"]


def test_a_bag_cut_at_random_lengths_is_repaired_or_left_alone_and_never_gives_other_messages(
    swim: Path, tmp_path: Path
) -> None:
    whole = read_bag(swim)
    messages = list(whole.messages("velocity"))
    size = whole.path.stat().st_size
    repaired = 0
    for length in [0, 7, 8, *random.Random(1).sample(range(9, size), 40)]:  # noqa: S311
        cut = tmp_path / f"cut_{length}" / swim.name
        shutil.copytree(swim, cut)
        left_open(cut, length)
        content = next(cut.glob("*.mcap")).read_bytes()
        repair = repair_bag(cut)
        assert repair is not None
        assert repair.empty == (length <= 8) == (not cut.exists())
        if repair.empty:
            continue
        if repair.failure:
            assert next(cut.glob("*.mcap")).read_bytes() == content
            assert not is_closed(cut)
            continue
        repaired += 1
        bag = read_bag(cut)
        found = list(bag.messages("velocity")) if bag.topics else []
        assert bag.complete
        assert found == messages[: len(found)]
        assert bag.counts == repair.counts
    assert repaired > 30


def test_the_original_stays_if_the_copy_differs(swim: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left_open(swim)
    content = next(swim.glob("*.mcap")).read_bytes()
    monkeypatch.setattr(BagWriter, "copy", lambda *_: None)
    repair = repair_bag(swim)
    assert repair is not None
    assert "differs from it: the original is kept" in repair.failure
    assert next(swim.glob("*.mcap")).read_bytes() == content
    assert [path.name for path in swim.iterdir()] == [f"{swim.name}_0.mcap"]


@pytest.mark.parametrize("after", ["nothing", "the bag"])
def test_a_repair_that_is_itself_cut_short_is_made_again(
    swim: Path, monkeypatch: pytest.MonkeyPatch, after: str
) -> None:
    _, whole = score_bag(swim)
    left_open(swim)
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", lambda *_, **__: None)
        patch.setattr(repair_module, "_verify", None if after == "nothing" else lambda *_: None)
        if after == "nothing":
            with pytest.raises(TypeError):
                repair_bag(swim)
        else:
            repair_bag(swim)
            (swim / "metadata.yaml").unlink()
    repair = repair_bag(swim)
    assert repair is not None
    assert repair.counts == whole.counts
    assert is_closed(swim)


def test_a_study_is_repaired_as_a_whole_and_what_cannot_be_is_named(
    swim: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = swim.parents[1]
    left_open(write_swim(study / "bags" / "trial_0008"))
    left_open(write_swim(study / "bags" / "trial_0009"), 30)
    assert len(repair_bags(study)) == 2
    left_open(study / "bags" / "trial_0008")
    assert main([str(study), str(study / "nothing")]) == 2
    out, err = capsys.readouterr()
    assert "bag trial_0008 was left open: repaired" in out
    assert f"bag {study}/bags/trial_0009 cannot be repaired: " in err
    assert "nothing holds no bag" in err


def make_conflicted(path: Path) -> None:
    next(path.glob("*.mcap")).with_name("x (conflicted copy).mcap").write_bytes(b"")


def make_dangling(path: Path) -> None:
    file = next(path.glob("*.mcap"))
    file.unlink()
    file.symlink_to("nowhere.mcap")


def make_a_folder(path: Path) -> None:
    file = next(path.glob("*.mcap"))
    file.unlink()
    file.mkdir()


ODD = {"2 MCAP files": make_conflicted, "No such file or directory": make_dangling, "Is a directory": make_a_folder}


@pytest.mark.parametrize("reason", ODD)
def test_an_odd_bag_is_named_and_all_others_are_repaired(
    swim: Path, capsys: pytest.CaptureFixture[str], reason: str
) -> None:
    bags = swim.parent
    odd = write_swim(bags / "trial_0006")
    ODD[reason](odd)
    left_open(write_swim(bags / "trial_0005"))
    left_open(swim)
    assert main([str(bags.parent)]) == 2
    out, err = capsys.readouterr()
    assert err.startswith(f"repair_bags: error: bag {odd} cannot be repaired: ")
    assert reason in err
    assert err.count("\n") == 1
    assert out.count("was left open: repaired with all messages") == 2
    assert is_closed(bags / "trial_0005")
    assert is_closed(swim)
    (again,) = repair_bags(bags.parent, or_nothing=True)
    assert reason in again.failure


def test_on_a_read_only_disk_every_bag_that_was_left_open_is_named(
    disk: Disk, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, length in (("trial_0001", 8), ("trial_0002", None)):
        left_open(write_swim(disk.path / "bags" / name), length)
    write_swim(disk.path / "bags" / "trial_0003")
    disk.mount("-o", "remount,ro")
    assert main([str(disk.path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    bags = [f"bag {disk.path}/bags/trial_000{number}" for number in (1, 2)]
    assert [line.split(" cannot ")[0] for line in lines] == [f"repair_bags: error: {bag}" for bag in bags]
    assert all("Read-only file system" in line for line in lines)


@pytest.mark.parametrize("metadata", [{}, {"trial.number": "3"}])
def test_a_bag_with_messages_or_metadata_is_never_called_empty(tmp_path: Path, metadata: dict[str, str]) -> None:
    with BagWriter(tmp_path / "bag", (VELOCITY,), metadata) as writer:
        for index in range(0 if metadata else 300):
            writer.write(VELOCITY.name, velocity(START + index * STEP, 0.1))
    repair = repair_bag(left_open(tmp_path / "bag"))
    assert repair is not None
    assert (repair.failure, repair.counts) == ("", {VELOCITY.name: 0 if metadata else 300})
    assert read_bag(tmp_path / "bag").metadata == metadata


def test_a_bag_without_messages_and_metadata_may_be_deleted(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", (VELOCITY,), {}):
        pass
    repair = repair_bag(left_open(tmp_path / "bag"))
    assert repair is not None
    assert "was cut off before anything was written: delete it" in repair.failure


def test_a_repaired_bag_keeps_the_name_of_its_file(swim: Path) -> None:
    _, whole = score_bag(swim)
    left_open(swim)
    next(swim.glob("*.mcap")).rename(swim / "swim.mcap")
    repair = repair_bag(swim)
    assert repair is not None
    assert repair.failure == ""
    assert sorted(path.name for path in swim.iterdir()) == ["metadata.yaml", "swim.mcap"]
    with Reader(swim) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == whole.counts


def test_an_empty_bag_is_repaired_to_an_empty_bag(tmp_path: Path, swim: Path) -> None:
    topics = [BagTopic(name, kind, read_bag(swim).offered(name)) for name, kind in read_bag(swim).topics.items()]
    with BagWriter(tmp_path / "empty", topics, Measurement().metadata()):
        pass
    left_open(tmp_path / "empty")
    repair = repair_bag(tmp_path / "empty")
    assert repair is not None
    assert "(none)" in str(repair)
    assert is_closed(tmp_path / "empty")


@pytest.mark.parametrize("zeros", [False, True])
def test_a_bag_cut_in_its_very_last_bytes_is_repaired_with_every_message(
    swim: Path, tmp_path: Path, zeros: bool
) -> None:
    whole = read_bag(swim)
    size = whole.path.stat().st_size
    for length in range(size - 45, size):  # statistics, index, footer, and the eight bytes behind it
        cut = tmp_path / f"cut_{length}" / swim.name
        shutil.copytree(swim, cut)
        left_open(cut, length)
        if zeros:
            os.truncate(cut / whole.path.name, size)
        repair = repair_bag(cut)
        assert repair is not None
        assert (repair.failure, repair.counts) == ("", whole.counts)


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[BagWriter]:
    """A bag that is being recorded, with some messages on the disk."""
    with BagWriter(tmp_path / "bags" / "trial_0003", (VELOCITY, STATE), Measurement(duration=1.0).metadata()) as writer:
        writer.write(STATE.name, state("SWIMMING", START))
        for index in range(51):
            writer.write(VELOCITY.name, velocity(START + index * STEP, 0.1))
        writer.flush()
        yield writer


def test_a_bag_that_is_being_recorded_is_left_alone_and_keeps_every_message(
    recording: BagWriter, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(recording.path)]) == 0
    assert capsys.readouterr().out == "bag trial_0003 is being recorded, left alone\n"
    for index in range(51, 101):
        recording.write(VELOCITY.name, velocity(START + index * STEP, 0.1))
    assert recording.close().counts == read_bag(recording.path).counts == {VELOCITY.name: 101, STATE.name: 1}
    assert is_closed(recording.path)
    assert repair_bag(recording.path) is None


def test_a_bag_whose_recording_has_just_begun_is_not_removed(recording: BagWriter) -> None:
    file = next(recording.path.glob("*.mcap"))
    os.truncate(file, 8)
    repair = repair_bag(recording.path)
    assert repair is not None
    assert not repair.empty
    assert file.exists()


def test_a_bag_is_left_alone_until_its_metadata_are_written(
    recording: BagWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    repairs = []
    write_whole = bag_module._write_whole

    def write_late(path: Path, text: str) -> None:
        repairs.append(str(repair_bag(recording.path)))
        write_whole(path, text)

    monkeypatch.setattr(bag_module, "_write_whole", write_late)
    recording.close()
    assert repairs == ["bag trial_0003 is being recorded, left alone"]
    assert is_closed(recording.path)


def test_a_file_system_without_locks_is_recorded_to_and_repaired(
    swim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flock(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", flock)
    left_open(swim)
    repair = repair_bag(swim)
    assert repair is not None
    assert repair.failure == ""
    assert is_closed(swim)


def test_a_bag_that_is_being_repaired_is_not_recorded_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(*_: object) -> None:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(BagError, match=r"cannot write bag .*trial_0003: Resource temporarily unavailable"):
        BagWriter(tmp_path / "trial_0003", (VELOCITY,), {})
    assert not (tmp_path / "trial_0003").exists()


@pytest.fixture
def cut_off(tmp_path: Path) -> tuple[Path, list[int]]:
    """A bag whose machine lost its power: its folder, and the length of its file after each second of the swim."""
    writer = BagWriter(tmp_path / "trial_0005", (VELOCITY, STATE), Measurement().metadata())
    lengths = []
    for index in range(401):
        writer.write(VELOCITY.name, velocity(START + index * STEP, 0.1 + 0.01 * math.sin(index)))
        if index % 100 == 0:
            writer.flush()
            lengths.append(next(writer.path.glob("*.mcap")).stat().st_size)
    writer._file.close()
    return writer.path, lengths


TAILS: dict[str, Callable[[bytes, int], bytes]] = {
    "cut": lambda whole, position: whole[:position],
    "zeros to the end": lambda whole, position: whole[:position] + bytes(len(whole) - position),
    "zeros to the end and behind it": lambda whole, position: whole[:position] + bytes(len(whole) - position + 5000),
    "zeros in one block": lambda whole, position: whole[:position] + bytes(100) + whole[position + 100 :],
}


@pytest.mark.parametrize(
    "tail",
    [name if name in {"cut", "zeros in one block"} else pytest.param(name, marks=pytest.mark.long) for name in TAILS],
)
def test_a_power_cut_takes_no_more_than_the_last_chunk(
    cut_off: tuple[Path, list[int]], tmp_path: Path, tail: str
) -> None:
    path, lengths = cut_off
    whole = next(path.glob("*.mcap")).read_bytes()
    messages = list(read_bag(path).messages("velocity"))
    start, end = lengths[-2:]
    assert end == len(whole)
    counts = []
    for position in [*range(start + 1, start + 80), *range(start + 80, end - 80, 50), *range(end - 80, end)]:
        content = TAILS[tail](whole, position)
        (tmp_path / "cut.mcap").write_bytes(content)
        bag = read_bag(tmp_path / "cut.mcap")
        found = list(bag.messages("velocity"))
        assert found == messages[: len(found)]
        assert bag.counts == {VELOCITY.name: len(found), STATE.name: 0}
        counts.append((len(found), bag.whole_bytes))
    assert counts[0] == (301, start)
    assert {count for count, _ in counts} == {301, 401}  # of the index behind the chunk nothing is missed
    next(path.glob("*.mcap")).write_bytes(TAILS[tail](whole, start + 500))
    repair = repair_bag(path)
    assert repair is not None
    lost = len(TAILS[tail](whole, start + 500)) - start
    assert str(repair).endswith(f"(301 /fish/velocity); its last {lost} bytes could not be read")
    assert list(read_bag(path).messages("velocity")) == messages[:301]


def test_damage_in_the_middle_of_a_bag_is_never_taken_for_its_end(cut_off: tuple[Path, list[int]]) -> None:
    path, lengths = cut_off
    file = next(path.glob("*.mcap"))
    whole = file.read_bytes()
    middle = (lengths[1] + lengths[2]) // 2
    file.write_bytes(whole[:middle] + bytes(50) + whole[middle + 50 :])
    damaged = file.read_bytes()
    repair = repair_bag(path)
    assert repair is not None
    assert "its messages cannot be trusted" in repair.failure
    assert file.read_bytes() == damaged


def test_zeros_anywhere_in_a_closed_bag_are_damage(swim: Path) -> None:
    file = next(swim.glob("*.mcap"))
    whole = file.read_bytes()
    chunk = whole.index(b"zstd")
    file.write_bytes(whole[: chunk + 20] + bytes(50) + whole[chunk + 70 :])
    with pytest.raises(BagError, match="its messages cannot be trusted"):
        read_bag(swim)
