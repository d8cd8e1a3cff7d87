"""The description of a fish is a URDF that others read, and its frames are where the fish computes its links to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fin_plant.fin import Fin, node_table
from fin_plant.fish_model import BodyShape, LinkShape, robot_links, urdf
from fin_plant.frames import FLOOR_DEPTH, Frames, Pose, heading_of

TAIL = (
    LinkShape("tail_joint_1", 0.03, 0.05, "peduncle"),
    LinkShape("tail_joint_2", 0.02, 0.025),
    LinkShape("fin_hinge_1", 0.04, 0.02),
)
TEXT = urdf(BodyShape(), TAIL)
POSE = Pose(0.3, -0.2, 0.05, 0.7)
ANGLES = {"tail_joint_1": 0.2, "tail_joint_2": -0.4, "fin_hinge_1": 0.1}


def matrix(x: float, y: float, z: float, angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine, 0.0, x], [sine, cosine, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def test_the_joints_of_the_description_are_those_of_joint_states_in_a_chain_from_the_tank() -> None:
    frames = Frames.from_urdf(TEXT)
    assert [joint.name for joint in frames.joints] == list(ANGLES)
    chain = frames.transforms(POSE, frames.angles(ANGLES))
    assert [each.parent for each in chain] == ["tank", "base_link", "tail_link_1", "tail_link_2"]
    assert [each.child for each in chain] == ["base_link", "tail_link_1", "tail_link_2", "tail_link_3"]
    assert [each.angle for each in chain] == [0.7, 0.2, -0.4, 0.1]
    several = Frames.from_urdf(TEXT, "tank_a/fish/").transforms(POSE, frames.angles({}))
    assert several[1][:2] == ("tank_a/fish/base_link", "tank_a/fish/tail_link_1")
    assert several[0].parent == "tank"


def test_another_program_reads_the_description_and_finds_each_link_where_the_frames_are() -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    from io import BytesIO  # noqa: PLC0415

    robot = yourdfpy.URDF.load(BytesIO(TEXT.encode()))
    assert robot.validate()
    assert robot.actuated_joint_names == list(ANGLES)
    robot.update_cfg(ANGLES)
    frames = Frames.from_urdf(TEXT)
    place = matrix(*POSE)
    for transform in frames.transforms(POSE, frames.angles(ANGLES))[1:]:
        place = place @ matrix(*transform[2:])
        theirs = matrix(*POSE) @ robot.get_transform(transform.child, "base_link")
        np.testing.assert_allclose(theirs, place, atol=1e-6)


def test_the_shapes_lie_in_the_middle_of_their_links() -> None:
    frames = Frames.from_urdf(TEXT)
    angles = frames.angles(ANGLES)
    floor, body, *links = frames.shapes(POSE, angles)
    assert (floor.pose.z, body.pose) == (-FLOOR_DEPTH, POSE)
    assert body.size == pytest.approx((0.14, 0.045, 0.06), rel=0.01)
    place = matrix(*POSE)
    for transform, shape, link in zip(frames.transforms(POSE, angles)[1:], links, TAIL, strict=True):
        place = place @ matrix(*transform[2:])
        middle = place @ [-0.5 * link.length, 0.0, 0.0, 1.0]
        np.testing.assert_allclose(shape.pose[:3], middle[:3], atol=1e-6)
        assert (shape.size[0], shape.size[2]) == pytest.approx((link.length, link.height))


def test_a_robots_fin_is_one_link_at_its_last_driven_joint() -> None:
    links = robot_links(Fin(length=0.06, height=0.02, tip_height=0.0), 2)
    assert [link.joint for link in links] == ["tail_joint_1", "tail_joint_2"]
    assert (links[-1].length, links[-1].height) == pytest.approx((0.06, 0.01))


def test_what_has_no_height_or_is_no_fish_is_refused_with_what_it_is() -> None:
    with pytest.raises(ValueError, match=r"height of a link of the tail = 0 m is outside .* cannot be shown"):
        LinkShape("fin_hinge_1", 0.02, 0.0)
    for text in ("", "<robot/>", "<robot name='arm'><link name='base_link'/></robot>"):
        with pytest.raises(ValueError, match="robot_description is not that of a fish"):
            Frames.from_urdf(text)


def test_the_body_that_is_drawn_of_a_robot_is_the_simulators_by_default() -> None:
    table = node_table("fin_sim", "simulator")
    body = BodyShape()
    for name in ("length", "width", "height", "tail_offset"):
        assert getattr(body, name) == table[f"body.{name}"].default


@pytest.mark.parametrize("heading", [-3.0, -0.5, 0.0, 0.4, 2.9])
def test_a_heading_is_read_from_a_quaternion_or_from_a_tracker_that_puts_it_into_z(heading: float) -> None:
    assert heading_of(0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)) == pytest.approx(heading)
    assert heading_of(0.0, 0.0, heading, 0.0) == heading
