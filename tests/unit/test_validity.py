"""Where a swim's model holds: what is said of a bent, a folded, a short fin, and by whom."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from fin_optimizer.bags.messages import message_types
from fin_optimizer.score.joints import joint_columns
from fin_optimizer.score.mean_speed import ScoreError
from fin_optimizer.score.swim import refuse_folded
from fin_plant import validity
from fin_plant.fin import Fin, ProfiledFin
from fin_sim.swim import swim
from fin_sim.swim_command.command import main as swim_main

FOLDING = [
    *("--fin.young_modulus", "1.23e7", "--fin.length", ".079", "--fin.height", ".011", "--fin.tip_height", ".025"),
    *("--fin.thickness", ".00032", "--frequency", "5.5", "--amplitude", "36", "--duration", "3"),
    *("--fin.segments", "3", "--fin.hinges", "between"),
]


@pytest.mark.parametrize(
    ("degrees", "is_bent", "is_folded"), [(0, False, False), (89, False, False), (91, True, False), (181, False, True)]
)
def test_a_hinge_is_doubtful_beyond_a_right_angle_and_folded_beyond_two(
    degrees: float, is_bent: bool, is_folded: bool
) -> None:
    angle = math.radians(degrees)
    assert bool(validity.bent(angle)) is is_bent
    assert bool(validity.folded(angle)) is is_folded
    assert not (is_bent or is_folded) or f"{degrees} degrees" in validity.bent(angle) + validity.folded(angle)


def test_a_fin_shorter_than_three_of_its_largest_heights_is_doubtful() -> None:
    assert not validity.short(Fin())
    assert not validity.short(Fin(length=0.075))
    assert "0.07 m long" in validity.short(Fin(length=0.07))
    assert "0.04 m high" in validity.short(Fin(tip_height=0.04))
    assert validity.short(ProfiledFin(profile_position=(0.5,), profile_height=(0.03,)))


def test_a_swim_that_folds_exits_with_its_angle_and_without_figures(capsys: pytest.CaptureFixture[str]) -> None:
    assert swim_main([*FOLDING, "--json"]) == 1
    out, err = capsys.readouterr()
    assert not out
    assert "degrees, more than 180" in err


def test_a_variation_leaves_a_gap_where_a_fin_folds(capsys: pytest.CaptureFixture[str]) -> None:
    variation = [*FOLDING[2:], "--vary", "fin.young_modulus=1.23e7,4e9", "--json"]
    assert swim_main(variation) == 1
    out, err = capsys.readouterr()
    rows = json.loads(out)
    assert rows[0]["mean_speed"] is None
    assert rows[1]["mean_speed"] > 0.0
    assert "more than 180" in err


def test_a_swim_reports_its_largest_hinge_angle_and_warns(capsys: pytest.CaptureFixture[str]) -> None:
    assert swim_main(["--fin.length", "0.05", "--duration", "2", "--json"]) == 0
    out, err = capsys.readouterr()
    swum = swim(Fin(length=0.05), duration=2.0)
    angles = np.abs(swum.joint_angles[:, 1:])
    assert json.loads(out)["largest_hinge_angle"] == pytest.approx(angles.max())
    assert "warning: the fin is 0.05 m long" in err
    assert swum.warnings == [validity.short(Fin(length=0.05))]


def test_largest_angle_is_that_of_the_hinges_alone() -> None:
    assert validity.largest_hinge_angle(["tail_joint_1", "fin_hinge_1", "fin_hinge_2"], [4.0, 0.5, -2.0]) == 2.0
    assert validity.largest_hinge_angle(["tail_joint_1"], [4.0]) == 0.0


def joint_state(**angles: float) -> bytes:
    """Return a serialised JointState with these joints' angles in rad."""
    types = message_types().types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    nothing = np.zeros(0)
    message = types["sensor_msgs/msg/JointState"](
        header=header, name=list(angles), position=np.array(list(angles.values())), velocity=nothing, effort=nothing
    )
    return bytes(message_types().serialize_cdr(message, "sensor_msgs/msg/JointState"))


def test_a_recorded_swim_in_which_the_fin_folded_has_no_score() -> None:
    refuse_folded(joint_columns([joint_state(tail_joint_1=4.0), joint_state(tail_joint_1=-4.0)]))
    refuse_folded(joint_columns([joint_state(tail_joint_1=0.2, fin_hinge_1=2.0)]))
    with pytest.raises(ScoreError, match="bent by 201 degrees"):
        refuse_folded(
            joint_columns(
                [joint_state(tail_joint_1=0.2, fin_hinge_1=0.1), joint_state(tail_joint_1=0.2, fin_hinge_1=-3.5)]
            )
        )
