"""Tails of several driven joints through the graph: what is asked is driven, recorded, scored and gone on with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.gait_parameters import gait_from_parameters
from fin_optimizer.score.joints import JOINT_STATE_TYPE, joint_columns
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from fin_plant import topics, yaml_file
from fin_plant.gait import Gait, JointDrive
from fin_plant.messages import gait_message
from fin_plant.plant_state import State
from support.plant_tester import PlantTester

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
CONFIG = Path(__file__).parents[2] / "ros2_ws/src/fin_bringup/config/three_joints.yaml"
PEDUNCLE = (
    "peduncle.length:=[0.03,0.02]",
    "peduncle.root_height:=[0.05,0.042]",
    "peduncle.tip_height:=[0.042,0.035]",
    "peduncle.mass_per_area:=[20.0,20.0]",
)
FIN = (
    *("fin.length:=0.07", "fin.height:=0.035", "fin.tip_height:=0.045", "fin.thickness:=3.0e-4"),
    *("fin.segments:=3", "fin.hinges:=between"),
)
TURNING = (
    "gait.frequency:=1.2",
    "gait.joints.amplitude:=[0.07,0.14,0.2]",
    "gait.joints.phase:=[0,-0.9,-1.8]",
    "gait.joints.bias:=[0.05,0.04,0.05]",
)
ASKED = Gait.from_rows([[0.07, 1.2, 0.0, 0.05], [0.14, 1.2, -0.9, 0.04], [0.2, 1.2, -1.8, 0.05]])


def bag_of(study: Path) -> Path:
    """Return the bag of the study's one swim with a score."""
    (swum,) = (trial for trial in read_trials(study) if trial.outcome is Outcome.OK)
    found: Path = study / swum.bag
    return found


def look_at_bag(study: Path, asked: Gait, hinges: int) -> None:
    """Compare what a bag holds of gait and joints with what was asked, and its score with the journal's."""
    (swum,) = (trial for trial in read_trials(study) if trial.outcome is Outcome.OK)
    path = bag_of(study)
    scored, bag = score_bag(path)
    assert scored.value == swum.score
    told = [np.reshape(message.data, (-1, 4)) for _, message in bag.decoded("gait_applied")]
    assert any(Gait.from_rows(rows).same_as(asked) for rows in told)
    assert [key for key in bag.metadata if key.startswith("gait.joint_")] == [
        f"gait.joint_{number}" for number in range(1, len(asked.joints) + 1)
    ]
    joints = joint_columns(bag.typed("joint_states", JOINT_STATE_TYPE))
    driven = [f"tail_joint_{number}" for number in range(1, len(asked.joints) + 1)]
    assert list(joints[0].names) == driven + [f"fin_hinge_{number}" for number in range(1, hinges + 1)]
    stamps = np.concatenate([each.stamps for each in joints])
    angles = np.concatenate([each.position for each in joints])
    # After the ramp each joint goes from bias - amplitude to bias + amplitude, as far as servos and samples let it.
    late = angles[stamps > stamps[-1] - 1_500_000_000]
    for column, drive in enumerate(asked.joints):
        assert late[:, column].max() == pytest.approx(drive.bias + drive.amplitude, abs=0.02)
        assert late[:, column].min() == pytest.approx(drive.bias - drive.amplitude, abs=0.02)


def test_three_driven_joints_and_a_passive_fin_swim_a_study_and_go_on_with_it(start: Start, tmp_path: Path) -> None:
    study = tmp_path / "study"
    words = (*PEDUNCLE, *FIN, *TURNING, "measurement.duration:=3.0", f"study_folder:={study}")
    begun = start("fin_optimizer", "bringup", "trials:=1", *words)
    assert begun.wait(60.0) == 0, begun.tail()
    look_at_bag(study, ASKED, hinges=2)
    details = json.loads((study / "study.json").read_text())["details"]
    assert gait_from_parameters(details).same_as(ASKED)
    headings = [message.pose.orientation.z for _, message in read_bag(bag_of(study)).decoded("pose")]
    assert np.mean(headings[len(headings) // 2 :]) < -0.03, "it turns to the side of its bias, the right"
    assert (study / "study.png").exists() or list(study.glob("*.png"))
    other = start("fin_optimizer", "bringup", "trials:=2", *words[:-1], f"study_folder:={study}", "gait.lag:=0.5")
    assert other.wait(60.0) != 0
    assert "gait.lag = 0.5 has no meaning beside gait.joints.phase" in other.tail()
    gone_on = start("fin_optimizer", "bringup", "trials:=2", *words)
    assert gone_on.wait(60.0) == 0, gone_on.tail()
    assert [trial.candidate for trial in read_trials(study) if trial.outcome is Outcome.OK] == [0, 1]


@pytest.mark.long
@pytest.mark.timeout(180)
def test_a_rehearsed_study_drives_three_servos_and_a_passive_fin(start: Start, tmp_path: Path) -> None:
    study = tmp_path / "study"
    words = ("plant:=rehearsal", "robot_file:=three_servos", "trials:=1", "repeats:=1", "measurement.duration:=2.5")
    bringup = start("fin_optimizer", "bringup", *words, *PEDUNCLE, *FIN, *TURNING, f"study_folder:={study}")
    assert bringup.wait(150.0) == 0, bringup.tail()
    look_at_bag(study, ASKED, hinges=0)


@pytest.mark.long
@pytest.mark.timeout(180)
def test_a_rehearsed_study_drives_the_preset_with_two_servos_that_tell_where_they_stand(
    start: Start, tmp_path: Path
) -> None:
    study = tmp_path / "study"
    words = ("plant:=rehearsal", "robot_file:=two_servos", "trials:=1", "repeats:=1", "measurement.duration:=2.5")
    peduncle = [f"{word.partition('[')[0]}[{word.partition('[')[2].partition(',')[0]}]" for word in PEDUNCLE]
    gait = ("gait.preset:=sub_carangiform", "gait.amplitude:=0.2", "gait.frequency:=1.2", "gait.bias:=0.02")
    bringup = start("fin_optimizer", "bringup", *words, *peduncle, *FIN, *gait, f"study_folder:={study}")
    assert bringup.wait(150.0) == 0, bringup.tail()
    asked = Gait((JointDrive(0.57 * 0.2, 1.2, bias=0.02), JointDrive(0.2, 1.2, -0.9, 0.02)))
    look_at_bag(study, asked, hinges=0)


@pytest.mark.long
def test_a_parameter_file_gives_each_node_its_part(start: Start, tmp_path: Path) -> None:
    study = tmp_path / "study"
    file = ("--ros-args", "--params-file", str(CONFIG))
    start("fin_sim", "simulator", *file, "-p", "speed:=0.0", "-p", "command_timeout:=5.0")
    own = ("-p", "trials:=1", "-p", "measurement.duration:=3.0", "-p", f"study_folder:={study}")
    optimizer = start("fin_optimizer", "optimizer", *file, *own)
    assert optimizer.wait(60.0) == 0, optimizer.tail()
    content: Any = yaml_file.read(CONFIG)
    look_at_bag(study, gait_from_parameters(content["/**/optimizer"]["ros__parameters"]), hinges=4)


def test_a_gait_of_another_number_of_joints_is_refused_before_anything_moves(
    start: Start, tmp_path: Path, ros_domain: int
) -> None:
    words = [word for parameter in PEDUNCLE for word in ("-p", parameter)]
    start("fin_sim", "simulator", "--ros-args", *words)
    with PlantTester(ros_domain) as client:
        state = client.wait_for_state(State.READY)
        assert state.driven_joints == 3
        client.publish_gait(gait_message(np.array([[0.2, 1.0, 0.0, 0.0]])))
        optimizer = start("fin_optimizer", "optimizer", "--ros-args", "-p", f"study_folder:={tmp_path / 'study'}")
        assert optimizer.wait(60.0) != 0
        assert "the study's gait has 1 driven joint, the plant 3: give as many in gait.*" in optimizer.tail()
        assert read_trials(tmp_path / "study") == []
        assert not any(
            angle
            for message in client.received(topics.JOINT_STATES)
            for name, angle in zip(message.name, message.position, strict=True)
            if name.startswith("tail_joint")
        )
