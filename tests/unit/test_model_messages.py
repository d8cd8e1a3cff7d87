"""A bag holds what a 3-D view needs, in the order of time, and no more of it than a view can show."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader

from fin_optimizer.bags.messages import decode, message_types
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.model_messages import PATH_STEP, ModelMessages, quality
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter
from fin_plant.fish_model import BodyShape, LinkShape, urdf
from fin_plant.frames import Frames, Pose
from support.bags import SECOND, START, STEP, VELOCITY, velocity

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ["tail_joint_1", "fin_hinge_1"]
TEXT = urdf(BodyShape(), (LinkShape(NAMES[0], 0.03, 0.04, "peduncle"), LinkShape(NAMES[1], 0.05, 0.02)))
FRAMES = Frames.from_urdf(TEXT)
INPUTS = {
    "/fish/robot_description": "std_msgs/msg/String",
    "/fish/joint_states": "sensor_msgs/msg/JointState",
    "/fish/pose": "geometry_msgs/msg/PoseStamped",
}


def made(kind: str, *values: Any) -> bytes:
    return bytes(message_types().serialize_cdr(message_types().types[kind](*values), kind))


def header(stamp: int, frame: str) -> Any:
    types = message_types().types
    return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), frame)


def pose_at(stamp: int) -> Pose:
    time = (stamp - START) / SECOND
    return Pose(0.05 * time, 0.01 * math.sin(time), 0.0, 0.1 * math.sin(5.0 * time))


def pose(stamp: int) -> bytes:
    types, (x, y, z, heading) = message_types().types, pose_at(stamp)
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
    place = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x, y, z), turn)
    return made(INPUTS["/fish/pose"], header(stamp, "tank"), place)


def angles_at(stamp: int) -> list[float]:
    time = (stamp - START) / SECOND
    return [0.3 * math.sin(6.0 * time), 0.2 * math.cos(6.0 * time)]


def joint_states(stamp: int) -> bytes:
    numbers = np.array(angles_at(stamp))
    return made(INPUTS["/fish/joint_states"], header(stamp, ""), NAMES, numbers, 2.0 * numbers, 3.0 * numbers)


def recorded(path: Path, seconds: int = 4) -> Path:
    """Record as a plant sends that swims faster than real time: each stream in slices of a second."""
    model = ModelMessages("/fish")
    topics = [*(BagTopic(name, kind, quality()) for name, kind in INPUTS.items()), VELOCITY, *model.topics]
    now = [0.0]
    with BagWriter(path, topics, {}, derived=model.take, clock=lambda: now[0]) as writer:
        writer.write("/fish/robot_description", made("std_msgs/msg/String", TEXT))
        for second in range(seconds):
            stamps = range(START + second * SECOND, START + (second + 1) * SECOND, STEP)
            for topic, build in (
                ("/fish/joint_states", joint_states),
                ("/fish/pose", pose),
                (VELOCITY.name, lambda stamp: velocity(stamp, 0.05)),
            ):
                for stamp in stamps:
                    writer.write(topic, build(stamp))
                now[0] += 0.05
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("bags") / "bag")


def test_the_frames_of_a_bag_are_where_the_fish_was(bag: Path) -> None:
    messages = list(read_bag(bag).decoded("/tf"))
    assert len(messages) == 4 * 25
    for log_time, message in messages:
        expected = FRAMES.transforms(pose_at(log_time), angles_at(log_time))
        assert [(t.header.frame_id, t.child_frame_id) for t in message.transforms] == [each[:2] for each in expected]
        for found, each in zip(message.transforms, expected, strict=True):
            assert found.header.stamp.sec * SECOND + found.header.stamp.nanosec == log_time
            place, turn = found.transform.translation, found.transform.rotation
            assert (place.x, place.y, place.z) == pytest.approx(each[2:5], abs=1e-9)
            assert 2.0 * math.atan2(turn.z, turn.w) == pytest.approx(each.angle, abs=1e-9)


def test_the_shapes_and_the_path_of_a_bag_are_where_the_fish_was(bag: Path) -> None:
    shapes = list(read_bag(bag).decoded("markers"))
    assert len(shapes) == 4 * 10
    log_time, message = shapes[-1]
    expected = FRAMES.shapes(pose_at(log_time), angles_at(log_time))
    for marker, shape in zip(message.markers, expected, strict=True):
        place = marker.pose.position
        assert (place.x, place.y, place.z) == pytest.approx(shape.pose[:3], abs=1e-9)
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == pytest.approx(shape.size)
        assert (marker.header.frame_id, marker.lifetime.sec) == ("tank", 1)
    paths = [message for _, message in read_bag(bag).decoded("path")]
    assert len(paths) == 2
    last = paths[-1].poses[-1]
    stamp = last.header.stamp.sec * SECOND + last.header.stamp.nanosec
    assert (last.pose.position.x, last.pose.position.y) == pytest.approx(pose_at(stamp)[:2], abs=1e-9)
    assert len(paths[-1].poses) == 1 + 2 * SECOND // PATH_STEP


def test_the_messages_of_a_bag_stand_in_the_order_of_time_though_the_streams_came_in_slices(bag: Path) -> None:
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream)
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        summary = reader.get_summary()
    assert len(times) > 1300
    assert times == sorted(times)
    assert summary is not None
    chunks = [(chunk.message_start_time, chunk.message_end_time) for chunk in summary.chunk_indexes]
    assert len(chunks) > 4
    assert all(before[1] <= after[0] for before, after in pairwise(chunks))


def test_a_description_that_is_none_and_a_pose_that_is_no_number_show_nothing_and_lose_nothing() -> None:
    model = ModelMessages("/fish")
    assert list(model.take("/fish/robot_description", START, made("std_msgs/msg/String", "<robot/>"))) == []
    assert [name for name, _ in model.take("/fish/pose", START, pose(START))] == ["/fish/path"]
    place = message_types().types["geometry_msgs/msg/Point"](math.nan, 0.0, 0.0)
    turn = message_types().types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    lost = message_types().types["geometry_msgs/msg/Pose"](place, turn)
    later = START + 10 * SECOND
    assert list(model.take("/fish/pose", later, made(INPUTS["/fish/pose"], header(later, "tank"), lost))) == []


def test_the_angles_are_found_also_where_a_message_of_another_length_comes() -> None:
    model = ModelMessages("/fish")
    list(model.take("/fish/robot_description", START, made("std_msgs/msg/String", TEXT)))
    for number, names in enumerate((NAMES, NAMES[:1], NAMES)):
        stamp = START + number * SECOND
        numbers = np.array([0.1 + number, 0.5][: len(names)])
        message = made(INPUTS["/fish/joint_states"], header(stamp, ""), names, numbers, numbers, numbers)
        list(model.take("/fish/joint_states", stamp, message))
        told = dict(model.take("/fish/pose", stamp, pose(stamp)))
        (_, first, second) = decode(told["/tf"], "tf2_msgs/msg/TFMessage").transforms
        assert 2.0 * math.atan2(first.transform.rotation.z, first.transform.rotation.w) == pytest.approx(0.1 + number)
        angle = 2.0 * math.atan2(second.transform.rotation.z, second.transform.rotation.w)
        assert angle == pytest.approx(0.5 if len(names) == 2 else 0.0)
