"""Bags of other writers: the same messages and the same score, or a refusal by name that stops nothing else."""

from __future__ import annotations

import contextlib
import random
import shutil
from pathlib import Path

import pytest
import yaml
from rosbags.interfaces import QosDurability, QosHistory, QosReliability

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.repair import repair_bag
from fin_optimizer.commands import repair_bags
from fin_optimizer.commands.score_bag import main
from fin_optimizer.score.mean_speed import Measurement, ScoreError
from fin_optimizer.score.recorded import score_bag
from support.bags import SECOND, START, STATE, VELOCITY, state, velocity, write_swim
from support.foreign_bags import RECORDED_QOS, WRITERS, one_by_one, plain_mcap, split

WINDOW = ("--settle", "0", "--duration", "2")


@pytest.fixture
def swim(tmp_path: Path) -> Path:
    return write_swim(tmp_path / "own")


@pytest.mark.parametrize("writer", WRITERS)
def test_a_trial_in_a_bag_of_another_writer_has_the_same_messages_and_score(
    swim: Path, tmp_path: Path, writer: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = WRITERS[writer](swim, tmp_path / "other")
    own, other = read_bag(swim), read_bag(path)
    assert (other.topics, other.counts, other.complete) == (own.topics, own.counts, True)
    for topic in own.topics:
        assert list(other.messages(topic)) == list(own.messages(topic))
    assert main([str(path), *WINDOW]) == 0
    score = score_bag(swim)[0]
    assert capsys.readouterr().out == f"{score.value!r} {score.spread!r} {path}\n"


def test_a_bag_that_does_not_say_its_window_is_told_what_is_missing(
    swim: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = one_by_one(swim, tmp_path / "other")
    assert main([str(path), str(swim)]) == 2
    out, err = capsys.readouterr()
    assert err == (
        f"score_bag: error: {path}: metadata lack measurement.settle_s, measurement.duration_s, measurement.block_s: "
        "they do not say which part of the swim counts; --settle and --duration say it\n"
    )
    assert out.endswith(f"{swim}\n")
    with pytest.raises(SystemExit):
        main([str(path), "--settle", "1"])
    assert "--settle and --duration go together" in capsys.readouterr().err


def make_zeros(path: Path, _: Path) -> Path:
    (path / "zero_0.mcap").touch()
    return path


def make_empty(path: Path, _: Path) -> Path:
    return plain_mcap(path / "none_0.mcap", {}, []).parent


def make_text(path: Path, _: Path) -> Path:
    (path / "notes.db3").write_text("the fish swam well")
    return path


def make_ros1(path: Path, _: Path) -> Path:
    (path / "old.mcap").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    return path


def make_incomplete(path: Path, swim: Path) -> Path:
    split(swim, path / "parts", 3)
    names = [f"parts_{part}.mcap" for part in range(3)]
    text = yaml.safe_dump({"rosbag2_bagfile_information": {"relative_file_paths": names}})
    (path / "parts" / "metadata.yaml").write_text(text)
    (path / "parts" / names[1]).unlink()
    return path / "parts"


def make_cut_inside(path: Path, swim: Path) -> Path:
    split(swim, path, 3)
    (path / f"{path.name}_1.mcap").write_bytes((path / f"{path.name}_1.mcap").read_bytes()[:-300])
    return path


def make_json(path: Path, _: Path) -> Path:
    return plain_mcap(path / "web.mcap", {"/fish/velocity": "json"}, [], encoding="json").parent


def make_other_bytes(path: Path, _: Path) -> Path:
    topics = {STATE.name: STATE.type_name, VELOCITY.name: VELOCITY.type_name}
    messages = [(STATE.name, START, state("SWIMMING", START)), (VELOCITY.name, START, b"\0\1\0\0not a velocity")]
    return plain_mcap(path / "odd.mcap", topics, messages).parent


def make_other_type(path: Path, _: Path) -> Path:
    topics = {STATE.name: "std_msgs/msg/String", VELOCITY.name: VELOCITY.type_name}
    return plain_mcap(path / "odd.mcap", topics, []).parent


def make_only_metadata(path: Path, _: Path) -> Path:
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [1, 2")
    return path


BAD = {
    "is empty: it was cut off before anything was written": make_zeros,
    "has 0 topics 'plant_state'": make_empty,
    "it is neither MCAP nor SQLite": make_text,
    "is a bag of ROS 1: convert it": make_ros1,
    "metadata.yaml names parts_1.mcap, which is missing": make_incomplete,
    "is cut off, and the recording goes on in bad_2.mcap": make_cut_inside,
    "topic /fish/velocity is serialised as 'json', needed is 'cdr'": make_json,
    "is no geometry_msgs/msg/TwistStamped": make_other_bytes,
    "is std_msgs/msg/String, needed is diagnostic_msgs/msg/DiagnosticStatus": make_other_type,
    "it holds no .mcap or .db3 file": make_only_metadata,
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bag_that_cannot_be_scored_is_named_and_the_others_are_scored(
    swim: Path, tmp_path: Path, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = tmp_path / "bags"
    shutil.copytree(swim, bags / "z_own")
    (bags / "bad").mkdir()
    bad = BAD[reason](bags / "bad", swim)
    if bad.parent != bags:
        shutil.move(bad, bags / "moved")
        shutil.rmtree(bags / "bad")
        bad = bags / "moved"
    for path in ([bags], [bad, swim]):
        assert main([*map(str, path), *WINDOW]) == 2
        out, err = capsys.readouterr()
        assert reason in err
        assert err.startswith(f"score_bag: error: {bad}")
        assert err.count("\n") == out.count("\n") == 1


def test_a_file_that_may_not_be_read_is_named(
    swim: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(self: Path, *_: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    with monkeypatch.context() as patch:  # a superuser may read whatever the file's mode is
        patch.setattr(Path, "open", refuse)
        assert main([str(swim)]) == 2
    assert capsys.readouterr().err.endswith("_0.mcap: Permission denied\n")


def test_files_of_different_bags_in_one_folder_are_bags_of_their_own(
    swim: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loose = tmp_path / "loose"
    loose.mkdir()
    for name in ("monday_0.mcap", "tuesday_0.mcap"):
        shutil.copy(next(swim.glob("*.mcap")), loose / name)
    assert main([str(loose)]) == 0
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines()] == [
        f"{loose}/monday_0.mcap",
        f"{loose}/tuesday_0.mcap",
    ]
    with pytest.raises(BagError, match=r"holds several bags: give one of monday_0\.mcap, tuesday_0\.mcap"):
        read_bag(loose)


@pytest.mark.parametrize(
    ("told", "history", "depth", "reliability"),
    [
        ([RECORDED_QOS], QosHistory.KEEP_LAST, 1000, QosReliability.RELIABLE),
        ([{**RECORDED_QOS, "history": 3, "reliability": 2}], QosHistory.KEEP_LAST, 1000, QosReliability.BEST_EFFORT),
        ([{**RECORDED_QOS, "history": "keep_all"}], QosHistory.KEEP_ALL, 0, QosReliability.RELIABLE),
        (
            [{**RECORDED_QOS, "reliability": "best_effort"}, {**RECORDED_QOS, "history": 1, "depth": 7}],
            QosHistory.KEEP_LAST,
            7,
            QosReliability.RELIABLE,
        ),
        ([{"history": "keep_last"}], QosHistory.KEEP_LAST, 1000, QosReliability.RELIABLE),
        ("", QosHistory.KEEP_LAST, 1000, QosReliability.RELIABLE),
        ("7: [", QosHistory.KEEP_LAST, 1000, QosReliability.RELIABLE),
    ],
)
def test_a_quality_of_service_that_a_recorder_does_not_know_gets_a_default(
    tmp_path: Path, told: object, history: QosHistory, depth: int, reliability: QosReliability
) -> None:
    text = told if isinstance(told, str) else yaml.safe_dump(told)
    bag = read_bag(plain_mcap(tmp_path / "bag.mcap", {VELOCITY.name: VELOCITY.type_name}, [], qos=text))
    offer = bag.offered("velocity")
    assert (offer.history, offer.depth, offer.reliability) == (history, depth, reliability)
    assert offer.durability is QosDurability.VOLATILE


def test_a_topic_with_two_types_is_left_out_and_named(tmp_path: Path) -> None:
    velocities = [(VELOCITY.name, START, velocity(START, 0.1))]
    plain_mcap(tmp_path / "b" / "b_0.mcap", {VELOCITY.name: VELOCITY.type_name, "/a": "std_msgs/msg/String"}, [])
    plain_mcap(tmp_path / "b" / "b_1.mcap", {VELOCITY.name: VELOCITY.type_name, "/a": "std_msgs/msg/Bool"}, velocities)
    bag = read_bag(tmp_path / "b")
    assert bag.topics == {VELOCITY.name: VELOCITY.type_name}
    assert bag.left_out == {"/a": "has two message types, std_msgs/msg/String and std_msgs/msg/Bool"}
    assert list(bag.messages("velocity")) == velocities


@pytest.mark.parametrize("writer", WRITERS)
def test_damaged_bytes_of_any_writer_are_refused_or_do_not_matter_and_never_end_in_a_traceback(
    tmp_path: Path, writer: str
) -> None:
    path = WRITERS[writer](write_swim(tmp_path / "own", 0.5), tmp_path / "other")
    dice = random.Random(writer)  # noqa: S311
    for file in path.iterdir():
        whole = file.read_bytes()
        for _ in range(20):
            damaged = bytearray(whole[: dice.randrange(len(whole))] if dice.random() < 0.25 else whole)
            if damaged:
                damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
            file.write_bytes(damaged)
            with contextlib.suppress(BagError, ScoreError):
                score_bag(path, Measurement(duration=0.5).metadata())
            repair_bag(path)
        file.write_bytes(whole)


@pytest.mark.parametrize("writer", WRITERS)
def test_bags_of_other_writers_are_not_repaired(
    swim: Path, tmp_path: Path, writer: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = WRITERS[writer](swim, tmp_path / "other")
    before = {file: file.read_bytes() for file in path.iterdir()}
    assert repair_bags.main([str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: every bag was closed, nothing to repair\n"
    assert {file: file.read_bytes() for file in path.iterdir()} == before


def test_a_bag_of_another_writer_that_was_cut_is_scored_and_left_to_its_own_tools(
    swim: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = split(swim, tmp_path / "other", 1)
    file = next(path.iterdir())
    file.write_bytes(file.read_bytes()[:-200])
    assert main([str(path), *WINDOW]) == 0
    out, err = capsys.readouterr()
    assert float(out.split()[0]) == score_bag(swim)[0].value
    assert "was not closed; scored from the" in err
    assert repair_bags.main([str(path)]) == 2
    assert "another program recorded it and did not close it; `ros2 bag reindex`" in capsys.readouterr().err


def test_a_pose_long_after_the_swim_changes_no_score(swim: Path, tmp_path: Path) -> None:
    bag = read_bag(swim)
    late = [*bag.messages(*bag.topics), (VELOCITY.name, START + 99 * SECOND, velocity(START + 99 * SECOND, 9.0))]
    plain_mcap(tmp_path / "swim.mcap", bag.topics, late)
    assert score_bag(tmp_path / "swim.mcap", bag.metadata)[0] == score_bag(swim)[0]
