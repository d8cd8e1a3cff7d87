"""Bags of trials: any tool opens them, a kill takes at most the last second, nothing is ever overwritten."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from fin_optimizer.bags import writer as bag_module
from fin_optimizer.bags.messages import BagError, decode, header_stamp, message_types
from fin_optimizer.bags.metadata import BagSummary, BagTopic
from fin_optimizer.bags.reader import bag_metadata, read_bag, read_velocity
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.commands.score_bag import main
from fin_optimizer.score.mean_speed import Measurement, ScoreError, score
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.score.swim import start_of_swim
from support.bags import GAIT, SECOND, START, STATE, STEP, VELOCITY, gait, quality, state

SAMPLES = 1001
SILENT = BagTopic("/fish/thrust", "geometry_msgs/msg/WrenchStamped", quality())
TOPICS = (VELOCITY, STATE, GAIT, SILENT)
METADATA = {
    "fin.young_modulus": "1.5e9",
    "study.seed": "7",
    "note": "glued: ä\n# twice",
} | Measurement().metadata()


def serialised(type_name: str, message: object, *, little_endian: bool = True) -> bytes:
    """Return a message's bytes as they come from a subscription."""
    return bytes(message_types().serialize_cdr(message, type_name, little_endian=little_endian))


def velocity(stamp: int, forward: float, *, little_endian: bool = True) -> bytes:
    """Return a serialised TwistStamped."""
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), "base_link")
    vector = types["geometry_msgs/msg/Vector3"]
    twist = types["geometry_msgs/msg/Twist"](vector(forward, 0.1, 0.0), vector(0.0, 0.0, 0.2))
    stamped = types["geometry_msgs/msg/TwistStamped"](header, twist)
    return serialised(VELOCITY.type_name, stamped, little_endian=little_endian)


def speeds(count: int = SAMPLES) -> np.ndarray:
    """Return forward speeds from rest with all their digits in use."""
    return np.tanh(np.arange(count) / 20.0) * np.random.default_rng(3).normal(0.1, 0.02, count)


def write_trial(path: Path, *, samples: int = SAMPLES) -> BagSummary:
    """Write the bag of a whole trial."""
    with BagWriter(path, TOPICS, METADATA) as writer:
        writer.write(STATE.name, state("READY", START - SECOND))
        writer.write(STATE.name, state("SWIMMING", START))
        for index, forward in enumerate(speeds(samples)):
            if index % 25 == 0:
                writer.write(GAIT.name, gait())
            writer.write(VELOCITY.name, velocity(START + index * STEP, float(forward)))
    return writer.close()


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    """A bag of a whole trial."""
    return write_trial(tmp_path / "trial_0001").path


COUNTS = {VELOCITY.name: 1001, STATE.name: 2, GAIT.name: 41, SILENT.name: 0}


def test_the_summary_counts_every_message_by_header_time(tmp_path: Path) -> None:
    summary = write_trial(tmp_path / "deep" / "below" / "trial")
    assert summary.counts == COUNTS
    assert (summary.start_ns, summary.duration_ns, summary.message_count) == (START, 10 * SECOND, 1044)


def test_rosbags_opens_it_with_counts_qualities_and_hashes(trial: Path) -> None:
    with Reader(trial) as reader:
        assert {item.topic: item.msgcount for item in reader.connections} == COUNTS
        connection = next(item for item in reader.connections if item.topic == STATE.name)
        assert connection.ext.offered_qos_profiles == [STATE.qos]  # type: ignore[union-attr]
        assert connection.digest == message_types().hash_rihs01(STATE.type_name)
        assert (reader.start_time, reader.duration - 1) == (START, 10 * SECOND)  # its end is exclusive
    with AnyReader([trial]) as any_reader:
        (chosen,) = [item for item in any_reader.connections if item.topic == VELOCITY.name]
        messages = [
            (log_time, any_reader.deserialize(data, chosen.msgtype))
            for _, log_time, data in any_reader.messages([chosen])
        ]
    assert [log_time for log_time, _ in messages] == [START + index * STEP for index in range(SAMPLES)]
    assert [message.twist.linear.x for _, message in messages] == speeds().tolist()  # type: ignore[attr-defined]


def decoded(path: Path, topic: str) -> list[Any]:
    """Return a topic's messages as mcap and mcap-ros2-support read them."""
    with next(path.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [item.decoded_message for item in reader.iter_decoded_messages(topics=[topic])]


def test_mcap_opens_it_with_schemas_that_decode_every_type(trial: Path) -> None:
    assert [message.twist.linear.x for message in decoded(trial, VELOCITY.name)] == speeds().tolist()
    assert [message.message for message in decoded(trial, STATE.name)] == ["READY", "SWIMMING"]
    assert decoded(trial, STATE.name)[1].values[0].value == str(START)
    assert list(decoded(trial, GAIT.name)[40].data) == [0.3, 1.0, 0.0, 0.0]
    with (trial / "trial_0001_0.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 1044
        assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 64 * 1024
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert records["trial"] == METADATA
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"])["message_count"] == 1044


def test_metadata_yaml_is_version_9_as_rosbag2_writes_it(trial: Path) -> None:
    information = yaml.safe_load((trial / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")
    assert information["relative_file_paths"] == ["trial_0001_0.mcap"]
    assert information["custom_data"] == METADATA
    first = information["topics_with_message_count"][0]
    assert first["topic_metadata"]["offered_qos_profiles"][0]["reliability"] == "reliable"
    assert first["topic_metadata"]["type_description_hash"].startswith("RIHS01_")
    assert "&id" not in (trial / "metadata.yaml").read_text()  # rosbag2 is given no YAML references
    assert not list(trial.glob("*.tmp"))


def test_our_reader_returns_what_was_written(trial: Path) -> None:
    bag = read_bag(trial)
    assert bag.complete
    assert (bag.metadata, bag.counts) == (METADATA, COUNTS)
    assert bag_metadata(trial) == METADATA
    stamps, forward = read_velocity(trial)
    assert stamps.tolist() == [START + index * STEP for index in range(SAMPLES)]
    assert forward.tolist() == speeds().tolist()
    assert [message.message for _, message in bag.decoded("plant_state")] == ["READY", "SWIMMING"]
    assert sum(1 for _ in bag.messages("gait", "/fish/plant_state")) == 43


def test_messages_without_header_are_logged_at_the_newest_stamp(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", TOPICS, {}) as writer:
        writer.write(GAIT.name, gait())  # before any stamp: held back until one is known
        writer.write(VELOCITY.name, velocity(START, 0.0))
        writer.write(VELOCITY.name, velocity(START - SECOND, 0.0))
        writer.write(GAIT.name, gait())
    assert [log_time for _, log_time, _ in read_bag(tmp_path / "bag").messages("gait")] == [START, START]
    with BagWriter(tmp_path / "later", TOPICS, {}, newest_stamp_ns=START) as writer:
        writer.write(STATE.name, state("READY", 0))
    assert [log_time for log_time, _ in read_bag(tmp_path / "later").decoded("plant_state")] == [START]
    before = time.time_ns()
    with BagWriter(tmp_path / "clockless", TOPICS, {}) as writer:
        writer.write(STATE.name, state("READY", 0))
    assert before <= writer.close().start_ns <= time.time_ns()


@pytest.mark.parametrize("little_endian", [True, False])
def test_header_stamps_are_read_in_either_byte_order(little_endian: bool) -> None:
    assert header_stamp(velocity(START + 17, 0.0, little_endian=little_endian)) == START + 17


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty", TOPICS, METADATA) as writer:
        pass
    assert writer.close().message_count == 0
    with Reader(tmp_path / "empty") as reader:
        assert reader.message_count == 0
    bag = read_bag(tmp_path / "empty")
    assert (bag.complete, bag.metadata, sum(bag.counts.values())) == (True, METADATA, 0)


def test_an_existing_bag_is_not_touched(trial: Path) -> None:
    before = {file.name: file.read_bytes() for file in trial.iterdir()}
    with pytest.raises(BagError, match=r"trial_0001 exists already and is not overwritten"):
        BagWriter(trial, TOPICS, {})
    assert {file.name: file.read_bytes() for file in trial.iterdir()} == before


def test_an_exception_leaves_a_readable_bag(tmp_path: Path) -> None:
    def interrupted() -> None:
        with BagWriter(tmp_path / "bag", TOPICS, METADATA) as writer:
            writer.write(VELOCITY.name, velocity(START, 0.25))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 1
    assert read_bag(tmp_path / "bag").complete


def test_wrong_use_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"has the type my_msgs/msg/Own, which ROS 2 Jazzy does not define"):
        BagWriter(tmp_path / "bag", [BagTopic("/own", "my_msgs/msg/Own", quality())], {})
    assert not (tmp_path / "bag").exists()
    with BagWriter(tmp_path / "bag", TOPICS, {}) as writer:
        with pytest.raises(BagError, match=r"topic /other is not recorded in .*: recorded are /fish/velocity"):
            writer.write("/other", b"")
        with pytest.raises(BagError, match=r"message of 3 bytes is too short for a header"):
            writer.write(VELOCITY.name, b"abc")
    with pytest.raises(BagError, match=r"is closed: /fish/velocity came too late"):
        writer.write(VELOCITY.name, velocity(START, 0.0))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"cannot make bag .*/file/bag: Not a directory"):
        BagWriter(tmp_path / "file" / "bag", TOPICS, {})


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """A disk that refuses everything from the moment on at which the list's entry is set."""
    full = [False]
    real = os.fsync

    def fsync(descriptor: int) -> None:
        if full[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    return full


def test_a_full_disk_is_a_clear_error_and_what_was_flushed_is_readable(tmp_path: Path, full_disk: list[bool]) -> None:
    writer = BagWriter(tmp_path / "bag", TOPICS, METADATA)
    writer.write(VELOCITY.name, velocity(START, 0.25))
    writer.flush()
    full_disk[0] = True
    with pytest.raises(BagError, match=r"cannot write bag .*/bag: No space left on device \(after 1 messages\)"):
        writer.flush()
    full_disk[0] = False  # too late: nobody knows what is missing
    for use in (lambda: writer.write(VELOCITY.name, velocity(START, 0.25)), writer.close, writer.close):
        with pytest.raises(BagError, match=r"cannot write bag .*/bag: No space left on device"):
            use()
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    assert read_bag(tmp_path / "bag").counts[VELOCITY.name] == 1


def test_a_bag_that_cannot_even_start_leaves_its_name_free(tmp_path: Path, full_disk: list[bool]) -> None:
    full_disk[0] = True
    with pytest.raises(BagError, match=r"No space left on device"):
        BagWriter(tmp_path / "bag", TOPICS, METADATA)
    assert not (tmp_path / "bag").exists()


WRITE_AND_WAIT_FOR_THE_KILL = """
import sys
from pathlib import Path
import test_bag as t
now = [100.0]
writer = t.BagWriter(Path(sys.argv[1]), t.TOPICS, t.METADATA, clock=lambda: now[0])
for index in range(int(sys.argv[2])):
    writer.write(t.VELOCITY.name, t.velocity(t.START + index * t.STEP, 0.1))
    now[0] += t.bag_module.FLUSH_PERIOD / 64
print("written", flush=True)
sys.stdin.read()
"""


def test_what_is_written_is_on_the_disk_after_half_a_second_of_the_clock(tmp_path: Path) -> None:
    now = [100.0]
    writer = BagWriter(tmp_path / "bag", TOPICS, METADATA, clock=lambda: now[0])
    for index in range(150):
        writer.write(VELOCITY.name, velocity(START + index * STEP, 0.1))
        if index >= 64:
            assert read_bag(tmp_path / "bag").velocity()[0].size == index // 64 * 64 + 1, index
        now[0] += bag_module.FLUSH_PERIOD / 64
    writer.close()


def test_a_bag_in_which_nothing_tells_the_time_begins_at_the_walls(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", TOPICS, METADATA, wall_clock=lambda: START + 7)
    writer.write(GAIT.name, gait())
    summary = writer.close()
    assert (summary.start_ns, summary.duration_ns) == (START + 7, 0)


def test_a_kill_takes_at_most_the_last_second(tmp_path: Path) -> None:
    path = tmp_path / "killed"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_AND_WAIT_FOR_THE_KILL, str(path), "250"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "written\n"
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    bag = read_bag(path)
    assert not bag.complete
    assert bag.metadata == METADATA
    assert not (path / "metadata.yaml").exists()
    stamps, _ = bag.velocity()
    # A flush each 64 messages, the last one with the message that it came with: at half a second of the writer's clock.
    assert stamps.tolist() == [START + index * STEP for index in range(3 * 64 + 1)]


def test_a_bag_cut_anywhere_gives_a_beginning_or_an_error_never_other_values(trial: Path, tmp_path: Path) -> None:
    whole = (trial / "trial_0001_0.mcap").read_bytes()
    stamps, forward = read_velocity(trial)
    generator = np.random.default_rng(5)
    sizes = set()
    for length in [*generator.integers(0, len(whole), 60).tolist(), 0, 7, 8, 9, len(whole) - 1]:
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[:length])
        try:
            bag = read_bag(cut)
            cut_stamps, cut_forward = bag.velocity()
        except BagError:
            continue
        assert not bag.complete
        assert cut_stamps.tolist() == stamps[: cut_stamps.size].tolist()
        assert cut_forward.tolist() == forward[: cut_stamps.size].tolist()
        sizes.add(cut_stamps.size)
    assert len(sizes) > 2  # several beginnings, not only errors


def test_damaged_bytes_are_an_error_never_other_values(trial: Path, tmp_path: Path) -> None:
    whole = (trial / "trial_0001_0.mcap").read_bytes()
    stamps, forward = read_velocity(trial)
    generator = np.random.default_rng(6)
    errors = 0
    for position in generator.integers(0, len(whole), 100).tolist():
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(generator.integers(8))
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        try:
            got_stamps, got_forward = read_velocity(tmp_path / "damaged.mcap")
        except BagError:
            errors += 1
            continue
        assert got_stamps.tolist() == stamps[: got_stamps.size].tolist()
        assert got_forward.tolist() == forward[: got_forward.size].tolist()
    assert errors > 30  # most of the file is chunks, and each has a checksum


def test_what_is_no_bag_is_said_so(tmp_path: Path, trial: Path) -> None:
    with pytest.raises(BagError, match=r"it is neither folder nor file"):
        read_bag(tmp_path / "nowhere")
    with pytest.raises(BagError, match=r"it holds no \.mcap or \.db3 file"):
        read_bag(tmp_path)
    (tmp_path / "text.mcap").write_text("this is not an MCAP file, but long enough for its magic")
    with pytest.raises(BagError, match=r"text\.mcap is damaged"):
        read_bag(tmp_path / "text.mcap")
    with pytest.raises(BagError, match=r"has 0 topics 'pose', needed is one: it has /fish/velocity"):
        list(read_bag(trial).messages("pose"))


def test_a_topic_without_a_message_type_is_no_topic_of_a_trial(tmp_path: Path) -> None:
    with (tmp_path / "foreign.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_message(writer.register_channel("/a", "json", 0), 1, b"{}", 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(BagError, match=r"foreign\.mcap: topic /a has no message type: ROS 2 did not record it"):
        read_bag(tmp_path / "foreign.mcap")


# score_bag


def test_a_bag_scores_what_its_samples_score(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    measurement = Measurement()
    stamps = np.array([START + index * STEP for index in range(SAMPLES)], dtype=np.int64)
    live = score(stamps, speeds(), measurement.window(START), block=measurement.block)
    assert score_bag(trial)[0] == live
    assert main([str(trial), str(trial / "trial_0001_0.mcap")]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"{live.value!r} {live.spread!r} {trial}"
    assert float(second.split()[0]) == live.value


@pytest.mark.parametrize(
    ("states", "reason"),
    [
        ([], "plant_state tells 0 starts of a swim"),
        ([("SWIMMING", 1, "2.0e9"), ("READY", 2, "2.0e9"), ("SWIMMING", 3, "2.0e9")], "plant_state tells 2 starts"),
        (
            [("SWIMMING", 1, "1.2e9")],
            "the fish swam with fin.young_modulus = 1.2e9 instead of 2.0e9: it is another fin's",
        ),
    ],
)
def test_what_is_not_one_swim_of_the_bags_own_fin_is_not_scored(
    states: list[tuple[str, int, str]], reason: str
) -> None:
    said = [decode(state(name, stamp, fin__young_modulus=modulus), STATE.type_name) for name, stamp, modulus in states]
    with pytest.raises(ScoreError, match=re.escape(reason)):
        start_of_swim(said, {"fin.young_modulus": "2.0e9"})


@pytest.mark.parametrize("stamp", [[], ["soon"]])
def test_a_swim_that_does_not_say_when_it_started_is_not_scored(stamp: list[str]) -> None:
    said = decode(state("SWIMMING", START), STATE.type_name)
    said.values = [replace(item, value=value) for item, value in zip(said.values, stamp, strict=False)]
    with pytest.raises(ScoreError, match=r"plant_state SWIMMING has stamp_ns = .*, needed is the plant's time in ns"):
        start_of_swim([said], {})


def test_a_state_said_again_during_a_swim_is_the_same_swim() -> None:
    said = [decode(state("SWIMMING", 5, fin__young_modulus="2.0e9"), STATE.type_name)] * 2
    assert start_of_swim(said, {"fin.young_modulus": "2.0e9", "fin.length": "0.08"}) == 5


def test_a_bag_without_score_says_why_and_the_others_are_scored(
    trial: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = write_trial(tmp_path / "short", samples=900).path
    with BagWriter(tmp_path / "dry", TOPICS, METADATA) as writer:
        writer.write(VELOCITY.name, velocity(START, 0.0))
    assert main([str(short), str(tmp_path / "dry"), str(tmp_path / "none"), str(trial)]) == 2
    captured = capsys.readouterr()
    assert "short: no velocity for 1.01 s from 8.99 s into the window" in captured.err
    assert "dry: plant_state tells 0 starts of a swim, needed is one" in captured.err
    assert f"score_bag: error: {tmp_path / 'none'}: " in captured.err
    assert captured.out.count("\n") == 1


def test_a_bag_without_velocity_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, recorded in (("no topic", [topic for topic in TOPICS if topic is not VELOCITY]), ("silent", TOPICS)):
        with BagWriter(tmp_path / name, recorded, METADATA) as writer:
            writer.write(STATE.name, state("SWIMMING", START))
            writer.write(STATE.name, state("READY", START + 13 * SECOND))
    assert main([str(tmp_path / "no topic"), str(tmp_path / "silent")]) == 2
    captured = capsys.readouterr()
    assert "has 0 topics 'velocity', needed is one: it has /fish/plant_state" in captured.err
    assert "silent: window of 10 s holds 0 of 0 velocity samples: needed are at least 100" in captured.err
    assert captured.out == ""


def test_a_bag_that_was_not_closed_is_scored_with_a_note(
    trial: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = trial / "trial_0001_0.mcap"
    (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[:-100])  # without the end of its index
    assert main([str(tmp_path / "cut.mcap")]) == 0
    captured = capsys.readouterr()
    assert "was not closed; scored from the 1044 messages that it holds" in captured.err
    assert float(captured.out.split()[0]) == score_bag(trial)[0].value
