"""The gait of a study: a preset, or a value for each driven joint, and what is refused of it before anything moves."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from fin_bringup import study_nodes
from fin_bringup.bringup import parse
from fin_optimizer.gait_parameters import beat_of, describe_gait, gait_from_parameters
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.gait_check import cut_gait
from fin_plant import yaml_file
from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, JointLimits, sub_carangiform
from fin_plant.plant_state import PlantState, State, joint_details

if TYPE_CHECKING:
    from collections.abc import Mapping

SOURCE = Path(__file__).parents[2]
THREE: dict[str, Any] = {
    "gait.frequency": 1.2,
    "gait.joints.amplitude": [0.1, 0.2, 0.25],
    "gait.joints.phase": [0.0, -1.0, -1.5],
    "gait.joints.bias": [0.0, 0.0, 0.05],
}
ROWS = Gait((JointDrive(0.1, 1.2), JointDrive(0.2, 1.2, -1.0), JointDrive(0.25, 1.2, -1.5, 0.05)))


@pytest.mark.parametrize(
    ("given", "gait"),
    [
        ({}, PAPER_GAIT),
        ({"gait.amplitude": 0.2, "gait.frequency": 1.1}, Gait((JointDrive(0.2, 1.1),))),
        ({"gait.amplitude": 0.2, "gait.bias": -0.05}, Gait((JointDrive(0.2, 0.9, bias=-0.05),))),
        ({"gait.preset": "sub_carangiform", "gait.amplitude": 0.2}, sub_carangiform(0.2, 0.9)),
        (
            {"gait.preset": "sub_carangiform", "gait.driven_joints": 3, "gait.amplitude": 0.2, "gait.lag": 0.4},
            sub_carangiform(0.2, 0.9, 3, lag=0.4),
        ),
        (
            {"gait.preset": "sub_carangiform", "gait.amplitude": 0.2, "gait.joints.bias": [0.0, 0.1]},
            Gait((JointDrive(0.57 * 0.2, 0.9), JointDrive(0.2, 0.9, -0.9, 0.1))),
        ),
        (THREE, ROWS),
        (
            {"gait.joints.amplitude": [0.1, 0.2], "gait.lag": 0.5, "gait.bias": 0.02},
            Gait((JointDrive(0.1, 0.9, bias=0.02), JointDrive(0.2, 0.9, -0.5, 0.02))),
        ),
        (
            {"gait.joints.amplitude": [0.1, 0.2], "gait.joints.frequency": [0.5, 1.0]},
            Gait((JointDrive(0.1, 0.5), JointDrive(0.2, 1.0, -0.9))),
        ),
        (
            {"gait.joints.amplitude": [0.05, 0.1, 0.1, 0.2]},
            Gait(tuple(JointDrive(a, 0.9, -0.9 * i) for i, a in enumerate((0.05, 0.1, 0.1, 0.2)))),
        ),
    ],
)
def test_what_is_not_given_for_each_joint_is_the_presets_or_that_of_every_joint(
    given: Mapping[str, Any], gait: Gait
) -> None:
    assert gait_from_parameters(given).same_as(gait, 1e-15)
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))
    assert plan.gait.same_as(gait, 1e-15)
    assert not plan.gait.at_rest.moves
    assert len(plan.gait.at_rest.joints) == len(gait.joints)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"gait.driven_joints": 2},
            "a carangiform tail has 1 driven joint, this one has 2: choose",
        ),
        ({"gait.preset": "sub_carangiform", "gait.driven_joints": 4}, "driven joints of a sub-carangiform gait = 4"),
        ({**THREE, "gait.driven_joints": 2}, "the gait has 3 driven joints, but not every list has as many values"),
        ({**THREE, "gait.joints.phase": [0.0, -1.0]}, "gait.joints.amplitude 3, gait.joints.phase 2"),
        ({"gait.joints.bias": [0.0, 0.1]}, "the gait has 1 driven joint, but not every list has as many values"),
        ({**THREE, "gait.amplitude": 0.2}, "gait.amplitude = 0.2 has no meaning beside gait.joints.amplitude"),
        (
            {**THREE, "gait.preset": "sub_carangiform"},
            "gait.preset = sub_carangiform has no meaning beside",
        ),
        ({**THREE, "gait.lag": 0.5}, "gait.lag = 0.5 has no meaning beside gait.joints.phase"),
        ({**THREE, "gait.bias": 0.1}, "gait.bias = 0.1 has no meaning beside gait.joints.bias"),
        ({"gait.lag": 0.5}, "gait.lag = 0.5 rad has no joint to count for"),
        ({"gait.amplitude": 0.0}, "the gait moves no joint"),
        ({**THREE, "gait.joints.phase": [0.0, -1.0, 7.0]}, "gait.joints.phase = 7 rad is outside"),
        ({**THREE, "gait.joints.bias": [0.0, 0.0, 15.0]}, "gait.joints.bias = 15 rad is outside"),
        ({**THREE, "gait.joints.amplitude": [0.1, math.nan, 0.2]}, "gait.joints.amplitude"),
        ({"gait.amplitude": [0.1, 0.2]}, "gait.amplitude must be a number"),
        ({"gait.bias": 2.0}, "gait.bias = 2 rad is outside"),
    ],
)
def test_a_gait_that_cannot_be_is_refused_before_a_study_begins(given: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))


def test_the_spread_of_a_score_is_that_of_the_slowest_joint_that_beats() -> None:
    assert beat_of(PAPER_GAIT) == pytest.approx(1.0 / 0.9)
    assert beat_of(Gait((JointDrive(0.0, 0.1, bias=0.1), JointDrive(0.1, 2.0), JointDrive(0.1, 0.5)))) == 2.0
    assert beat_of(Gait((JointDrive(0.0, 0.5, bias=0.1),))) == 2.0


def test_a_picture_tells_every_joint_of_the_gait() -> None:
    assert describe_gait(PAPER_GAIT) == "0.9 Hz, 15° either way"
    assert describe_gait(ROWS) == ("1.2 Hz, 5.73, 11.46, 14.32° either way, phases 0, -1, -1.5 rad, bias 0, 0, 2.865°")


def test_a_study_of_one_joint_from_before_there_were_several_is_the_same_study() -> None:
    now = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({"seed": 7})).settings
    added = {name for name in now.details if name.startswith("gait.")} - {"gait.amplitude", "gait.frequency"}
    older = Settings(now.space, now.policy, {n: v for n, v in now.details.items() if n not in added}, now.goals)
    assert len(added) == 8
    assert older.differences(now) == []
    assert older.left_out(now) == []
    other = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({"seed": 7, "gait.bias": 0.1})).settings
    assert older.differences(other) == ["gait.bias is 0.0 there and 0.1 here"]


def test_several_joints_are_settings_that_a_study_keeps() -> None:
    settings = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(THREE)).settings
    read = Settings.from_json(settings.to_json())
    assert read.differences(settings) == []
    assert gait_from_parameters(read.details).same_as(ROWS)
    other = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**THREE, "gait.joints.phase": [0.0, -1.0, -2.0]}))
    assert read.differences(other.settings) == [
        "gait.joints.phase is [0.0, -1.0, -1.5] there and [0.0, -1.0, -2.0] here"
    ]


# -- what a plant has told of its tail -------------------------------------------------------------------------------

LIMITS = {"limits.sweep": "0.35", "limits.frequency": "5.0"}


def plant(*joints: JointLimits) -> PlantState:
    return PlantState(State.READY, "robot", 1, details={**LIMITS, **joint_details(joints)})


WIDE = JointLimits(0.35, 6.0)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (None, ""),
        (PlantState(State.READY, "robot", 1), ""),
        (PlantState(State.READY, "older", 1, details=LIMITS), ""),
        (plant(WIDE, WIDE, WIDE), ""),
        (plant(*[JointLimits(0.35)] * 3), ""),
        (plant(WIDE, WIDE), "the study's gait has 3 driven joints, the plant 2: give as many in gait.*"),
        (PlantState(State.READY, "simulator", 1, details={"driven_joints": "1"}), "3 driven joints, the plant 1"),
        # its bias and its amplitude together, and no other joint
        (plant(WIDE, WIDE, JointLimits(0.29, 6.0)), "joint 3: amplitude 0.25 rad asked, 0.24 rad swum. Ask"),
        (plant(WIDE, WIDE, JointLimits(0.29, 6.0)), "joint 3 by itself 0.29 rad and 6 rad/s) would cut"),
        (plant(WIDE, WIDE, JointLimits(0.04, 6.0)), "bias 0.05 rad asked, 0.04 rad swum"),
        # 2 pi 1.2 Hz 0.2 rad = 1.508 rad/s
        (plant(WIDE, JointLimits(0.35, 1.507), WIDE), "joint 2: amplitude 0.2 rad asked, 0.199872 rad swum"),
        (plant(WIDE, JointLimits(0.35, 1.509), WIDE), ""),
    ],
)
def test_a_gait_that_a_joint_of_the_plant_cannot_follow_is_known_before_it_moves(
    state: PlantState | None, words: str
) -> None:
    said = cut_gait(state, ROWS)
    assert words in said
    assert bool(said) is bool(words)


@pytest.mark.parametrize(
    "details",
    [
        {"driven_joints": "2.5"},
        {"driven_joints": "21"},
        {"driven_joints": "two"},
        {"driven_joints": "2", "joints.sweep": "[0.2]"},
        {"driven_joints": "2", "joints.sweep": "[0.2, -0.2]"},
        {"driven_joints": "2", "joints.sweep": "0.2"},
        {"driven_joints": "2", "joints.sweep": "[0.2, 0.2]", "joints.rate": "[1.0]"},
        {"driven_joints": "1", "joints.sweep": "[NaN]"},
    ],
)
def test_what_no_tail_can_be_is_no_plants_state(details: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"joints"):
        PlantState(State.READY, "robot", 1, details=details)


def test_the_parameter_file_of_three_joints_is_accepted_by_each_of_its_nodes() -> None:
    file: Any = yaml_file.read(SOURCE / "ros2_ws/src/fin_bringup/config/three_joints.yaml")
    given = {name.rpartition("/")[2]: node["ros__parameters"] for name, node in file.items()}
    assert given.keys() == {"simulator", "rehearsal", "optimizer"}
    peduncle = {name: value for name, value in given["simulator"].items() if name.startswith("peduncle.")}
    assert {name: value for name, value in given["rehearsal"].items() if name.startswith("peduncle.")} == peduncle
    gait = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given["optimizer"])).gait
    assert len(gait.joints) == len(peduncle["peduncle.length"]) + 1 == 3


def test_the_documented_line_and_file_of_three_joints_are_a_study_of_three_joints() -> None:
    page = (SOURCE / "docs/trials.md").read_text(encoding="utf-8")
    chapter = page[page.index("## Several driven joints, and turning") :]
    line = chapter[chapter.index("./run fin_optimizer bringup ") :].partition("```")[0].replace("\\\n", " ")
    given = parse(line.split()[3:])
    for plant in ({}, {"plant": "rehearsal", "robot_file": "three_servos"}):
        specs = study_nodes.nodes(given | plant)
        study_nodes.check_tails(specs)
        values = OPTIMIZER_PARAMETERS.checked(specs[-1].parameters)
        assert StudyPlan.from_parameters(values).gait.same_as(sub_carangiform(0.2, 1.2, 3), 1e-15)
    shown = chapter[chapter.index("/**/optimizer:") :].partition("```")[0]
    names = [text.partition(":")[0].strip() for text in shown.splitlines()[2:]]
    file: Any = yaml_file.read(SOURCE / "ros2_ws/src/fin_bringup/config/three_joints.yaml")
    told = yaml.safe_load(shown)["/**/optimizer"]["ros__parameters"]
    assert len(names) == 4
    assert told == {name: file["/**/optimizer"]["ros__parameters"][name] for name in names}


def test_lag_bias_and_numbers_of_each_of_three_joints_are_searched(tmp_path: Path) -> None:
    file = tmp_path / "my_space.yaml"
    file.write_text(
        "search:\n"
        "  gait.lag: {minimum: 20 deg, maximum: 90 deg}\n"
        "  gait.bias: {minimum: -0.1, maximum: 0.1}\n"
        "  gait.joint_2.amplitude: {minimum: 0.05, maximum: 0.15}\n"
        "  gait.joint_3.bias: {minimum: 0.0, maximum: 0.05}\n"
    )
    start = {"gait.preset": "sub_carangiform", "gait.driven_joints": 3, "gait.amplitude": 0.1, "gait.frequency": 1.2}
    given = {"space": str(file), "study_folder": str(tmp_path / "study"), **start}
    with pytest.raises(ValueError, match=r"gait.bias is searched twice, for the whole tail and as gait.joint_3.bias"):
        StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))
    text = file.read_text().replace("gait.joint_3.bias: {minimum: 0.0, maximum: 0.05}", "gait.joint_3.frequency: ")
    file.write_text(f"{text.rstrip()} {{minimum: 0.5, maximum: 1.5}}\n")
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))
    values = {"gait.lag": 0.5, "gait.bias": -0.05, "gait.joint_2.amplitude": 0.12, "gait.joint_3.frequency": 0.6}
    swum = Gait(
        (JointDrive(0.03, 1.2, 0.0, -0.05), JointDrive(0.12, 1.2, -0.5, -0.05), JointDrive(0.1, 0.6, -1.0, -0.05))
    )
    assert plan.gait_of(values).same_as(swum, 1e-12)
    read = Settings.from_json(plan.settings.to_json())
    assert read.differences(plan.settings) == []
    file.write_text("search: {gait.joint_4.amplitude: {minimum: 0.05, maximum: 0.15}}\n")
    with pytest.raises(ValueError, match=r"gait.joint_4.amplitude is not a parameter that can be searched"):
        StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))
