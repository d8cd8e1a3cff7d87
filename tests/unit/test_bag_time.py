"""At which time a message is logged: at its own stamp where it can be believed, and never decades away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.bags.log_time import FAR, LogTime
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter
from support.bags import SECOND, START, STATE, STEP, VELOCITY, quality, state, velocity

if TYPE_CHECKING:
    from pathlib import Path

HOUR = 3600 * SECOND
POSE = BagTopic("/fish/pose", VELOCITY.type_name, quality())


def test_a_stamp_is_believed_and_a_message_without_a_header_is_logged_at_the_newest() -> None:
    time = LogTime()
    assert time.of("state", None) is None
    assert time.of("a", START) == START
    assert time.of("b", START - SECOND) == START - SECOND
    assert (time.of("state", None), time.newest, time.unusable) == (START, START, {})


@pytest.mark.parametrize(
    ("stamp", "told"),
    [
        (0, "zero, it was never set"),
        (-SECOND, "-1 s, before 1970"),
        (5 * SECOND, "5 s, decades from the plant's time: does its clock count from 1970?"),
        (START - HOUR, "3600 s before the plant's time: do the two clocks agree?"),
        (START + HOUR, "3600 s after the plant's time: do the two clocks agree?"),
    ],
)
def test_what_a_stamp_is_that_is_not_believed_is_told_of_the_first(stamp: int, told: str) -> None:
    time = LogTime(START)
    for each in (stamp, START - 2 * HOUR):
        time.of("pose", each)
    assert time.first_unusable == {"pose": told}


@pytest.mark.parametrize("stamp", [0, -SECOND, 5 * SECOND, START - HOUR, START + HOUR, START + FAR + SECOND])
def test_a_stamp_that_cannot_be_believed_is_counted_and_drags_nothing_behind_it(stamp: int) -> None:
    time = LogTime()
    for index in range(100):
        now = START + index * STEP
        assert time.of("a", now) == now
        if index % 10 == 5:
            assert time.of("a", stamp) == now
        assert time.of("b", stamp) == now  # a tracker that counts from its own start, for the whole swim
    assert time.unusable == {"a": 10, "b": 100}


def test_zeros_at_the_very_beginning_decide_nothing() -> None:
    time = LogTime()
    assert [time.of("a", stamp) for stamp in (0, 0, START, 0)] == [None, None, START, START]
    assert LogTime(START).of("a", 0) == START


@pytest.mark.parametrize("jump", [HOUR, -HOUR])
def test_a_jump_of_all_topics_is_followed(jump: int) -> None:
    time = LogTime()
    for index in range(10):
        for topic in ("a", "b"):
            time.of(topic, START + index * STEP)
    after = [time.of(topic, START + jump + index * STEP) for index in range(20) for topic in ("a", "b")]
    assert after[-2:] == [START + jump + 19 * STEP] * 2
    assert sum(time.unusable.values()) <= 6
    assert time.of("state", None) == START + jump + 19 * STEP


def test_a_topic_that_arrives_in_batches_keeps_its_own_stamps() -> None:
    time = LogTime(START)
    for batch in range(20):  # of ten messages each, as from a simulator that is far ahead of its listener
        for topic in ("a", "b"):
            for index in range(10):
                stamp = START + (batch * 10 + index) * SECOND
                assert time.of(topic, stamp) == stamp
    assert time.unusable == {}


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(-(2**31), 2**31)), max_size=200))
def test_whatever_comes_between_is_logged_within_reach_of_the_plants_time(between: list[tuple[str, int]]) -> None:
    time = LogTime(START)
    for index, (topic, seconds) in enumerate(between):
        assert time.of("plant", START + index * STEP) == START + index * STEP
        logged = time.of(topic, seconds * SECOND)
        assert logged is not None
        assert abs(logged - START - index * STEP) <= FAR * (index + 1)


def test_one_zero_stamp_makes_no_bag_of_56_years_and_the_bag_counts_it(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", (VELOCITY, POSE, STATE), {"trial.number": "7"}, newest_stamp_ns=START) as writer:
        writer.write(STATE.name, state("READY", START))
        for index in range(101):
            writer.write(VELOCITY.name, velocity(START + index * STEP, 0.1))
            odd = (0, 1, START + HOUR, 2**31 * SECOND - 1)[index % 4]
            writer.write(POSE.name, velocity(odd, 0.0))
    summary = writer.close()
    assert (summary.start_ns, summary.duration_ns) == (START, SECOND)
    assert summary.unusable_stamps == {POSE.name: 101}
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["custom_data"] == {"trial.number": "7", "unusable_stamps./fish/pose": "101"}
    bag = read_bag(tmp_path / "bag")
    assert (bag.metadata, bag.counts[POSE.name]) == ({"trial.number": "7"}, 101)
