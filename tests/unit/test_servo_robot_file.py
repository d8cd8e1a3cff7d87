"""The robot's YAML file: what it holds, how it is refused, how it is written."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from fin_plant.fin import Fin
from fin_plant.fish_model import BodyShape, robot_links, urdf
from fin_plant.frames import Frames, Pose
from fin_plant.gait import Gait, JointDrive
from fin_servo_driver import backends, robot_file
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.robot_file import RelayJoint, RelayTiming, ServoJoint

if TYPE_CHECKING:
    from pathlib import Path

JOINT = {"channel": 9, "centre": 1500, "direction": 1, "units_per_radian": 573, "lowest": 1200, "highest": 1800}
RELAY = {"left": 1, "right": 2}


def content(device: str = "firmata", joints: object = None, **more: object) -> dict[str, object]:
    return {"device": device, "port": "/dev/null", "joints": [JOINT] if joints is None else joints, **more}


@pytest.mark.parametrize("name", robot_file.examples())
def test_every_example_is_accepted_by_its_back_end(name: str) -> None:
    robot = robot_file.load(robot_file.find(name))
    assert robot.device == name or len(robot.joints) > 1  # one of several joints is named after how many
    assert backends.make(robot).robot is robot


def test_there_is_an_example_for_every_back_end() -> None:
    assert set(robot_file.examples()) >= set(backends.BACKENDS)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"centre": 1900}, r"centre = 1900 must lie between lowest = 1200 and highest = 1800"),
        ({"centre": 1200}, r"must lie between"),
        ({"centre": 1800}, r"must lie between"),
        ({"lowest": 1800, "highest": 1200}, r"must lie between"),
        ({"direction": 0}, r"direction = 0 must be 1 .* or -1"),
        ({"direction": 2}, r"direction = 2 .*\[-1, 1\]"),
        ({"units_per_radian": 0}, r"units_per_radian = 0"),
        ({"units_per_radian": math.nan}, r"units_per_radian = nan"),
        ({"sweep": 2.0}, r"sweep = 2 rad"),
        ({"sweep": 0}, r"sweep = 0 rad"),
        ({"rate": -1}, r"rate = -1 rad/s"),
        ({"channel": "nine"}, r"channel must be a number, got 'nine'"),
        ({"centre": True}, r"centre must be a number, got True"),
        ({"colour": "red"}, r"unknown colour: known are channel, centre"),
        ({"lowest": 300}, r"lowest = 300 us .*\[544, 2400\]"),
        ({"highest": 2500}, r"highest = 2500 us"),
        ({"channel": 1}, r"channel 1 is not one of firmata's, 2 to 69"),
        ({"lowest": 1550, "centre": 1600}, r"does not contain 1500 us, with which StandardFirmata starts"),
    ],
)
def test_a_joint_is_refused_with_its_number_and_what_is_wrong(change: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=f"joint 1: .*{complaint}"):
        backends.make(robot_file.parse(content(joints=[{**JOINT, **change}])))


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (content("telepathy"), "device 'telepathy' is not known: choose one of dynamixel, firmata"),
        (content(joints=[JOINT, JOINT]), "channel 9 is used by joint 1 and joint 2"),
        (content("lcus", [{"left": 3, "right": 3}]), "channel 3 is used by joint 1 and joint 1"),
        (content("lcus", [RELAY, {"left": 2, "right": 4}]), "channel 2 is used by joint 1 and joint 2"),
        (content(joints=[JOINT, RELAY]), "mixes servos"),
        (content("lcus"), "device lcus drives relays, and joints describes servos"),
        (content("firmata", [RELAY]), "device firmata drives servos, and joints describes relays"),
        (content(joints=[]), "number of joints = 0"),
        (content(joints=[{**JOINT, "channel": 2 + n} for n in range(21)]), "number of joints = 21"),
        (content(joints="nine"), "joints must be a list"),
        (content(joints=["nine"]), "joint 1: it must be names with values"),
        (content(joints=[{"channel": 9}]), "joint 1: it lacks centre, direction"),
        (content(baud=-1), "baud = -1"),
        (content(speed=9), "unknown speed: known are device, port"),
        (content(options={"model": 6}), "options has unknown model: firmata knows none"),
        (content("maestro", [{**JOINT, "channel": 7}]), "channel 7 is not one of a Maestro with 6 channels"),
        (content("maestro", options={"model": 7}), "options: model = '7'"),
        (content("modbus", [RELAY], options={"unit": 300}), "options: unit = 300"),
        (content("lcus", [RELAY], timing={"dead_time": 0.001}), "timing.dead_time = 0.001 s"),
        (content("lcus", [RELAY], timing={"longest_on": 0.01}), "timing.longest_on = 0.01 s"),
        (content("lcus", [RELAY], timing={"when": 1}), "timing has unknown when"),
        (["device"], "robot file must be names with values"),
        ({"device": "lcus"}, "robot file lacks joints"),
        (None, "robot file must be names with values"),
    ],
)
def test_a_file_is_refused_with_what_is_wrong(given: object, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        backends.make(robot_file.parse(given))


def test_a_file_that_is_no_yaml_is_refused_with_its_name(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("device: [firmata", encoding="utf-8")
    with pytest.raises(ValueError, match=r"robot\.yaml: .*"):
        robot_file.load(path)
    path.write_bytes(b"\xff\xfe\xff")
    with pytest.raises(ValueError, match=r"robot\.yaml: .*"):
        robot_file.load(path)


def test_a_missing_file_is_refused_with_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no such file, and no example of that name"):
        robot_file.find(str(tmp_path / "none.yaml"))
    with pytest.raises(ValueError, match="robot_file is empty"):
        robot_file.find("")


@pytest.mark.parametrize("name", robot_file.examples())
def test_a_written_file_reads_back_the_same(name: str, tmp_path: Path) -> None:
    robot = robot_file.load(robot_file.find(name))
    path = tmp_path / "robot.yaml"
    robot_file.save(robot, path)
    assert robot_file.load(path) == robot
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    robot = robot_file.load(robot_file.find("firmata"))
    folder = tmp_path / "robot.yaml"
    folder.mkdir()
    with pytest.raises(OSError, match=r"robot\.yaml"):
        robot_file.save(robot, folder)


def test_the_reach_of_a_joint_is_its_sweep_or_what_the_servo_allows() -> None:
    joint = ServoJoint(9, 1500, 1, 1000, 1400, 1700, sweep=0.3)
    assert joint.reachable == pytest.approx(0.1)
    assert ServoJoint(9, 1500, 1, 1000, 1000, 2000, sweep=0.3).reachable == pytest.approx(0.3)


def test_a_positive_angle_is_to_the_right_in_frames_servos_and_relays() -> None:
    frames = Frames.from_urdf(urdf(BodyShape(), robot_links(Fin(), 1)))
    angle = 0.2
    tail = frames.shapes(Pose(0.0, 0.0, 0.0, 0.0), [angle])[-1]
    assert tail.pose.y < 0.0, "y is to the left"
    turns_left = ServoJoint(9, 1500, 1, 1000, 1300, 1700)
    assert turns_left.position_at(angle) == pytest.approx(1300.0)
    motion = RelayMotion([RelayJoint(1, 2, angle)], RelayTiming(), 0.01)
    motion.restart(0.0, {})
    motion.command(Gait((JointDrive(angle, 0.5),)), 0.0)
    assert motion.outputs(0.5, 1.0) == {1: 0.0, 2: 1.0}
    assert motion.angles == [angle]


def test_angle_at_a_position_is_the_inverse_of_the_calibration() -> None:
    joint = ServoJoint(9, 1500, -1, 1000, 1300, 1700)
    assert joint.angle_at(1500) == 0.0
    assert joint.angle_at(1600) == pytest.approx(0.1)
    assert joint.position_at(0.1) == pytest.approx(1600)
