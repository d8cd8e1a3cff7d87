"""Strokes of articulated bodies in a plane ideal flow: the independent solver's gaits, and the scallop theorem."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.errors import StrokeError
from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import ellipse, fin
from fin_sim.ideal_2d.stroke import JointAngle, Stroke, swim_stroke
from support.plane_linkages import DATA, ellipses

QUARTER = 0.5 * math.pi


def swum(linkage: Linkage, *joints: JointAngle) -> Stroke:
    return swim_stroke(linkage, AddedMass(linkage).matrix, joints)


def outer(scale: float) -> tuple[JointAngle, JointAngle]:
    """Return the reference's gait: the front ellipse at -cos t from the middle one, the rear one at sin t."""
    return JointAngle(waves=((1, scale, QUARTER),)), JointAngle(waves=((1, scale, 0.0),))


def rows(file: str, case: str) -> list[dict[str, float]]:
    with (DATA / file).open(encoding="utf-8") as lines:
        return [
            {name: float(value) for name, value in row.items() if name != "case"}
            for row in csv.DictReader(lines)
            if row["case"] == case
        ]


@pytest.mark.parametrize(("case", "semi_minor", "scale"), [("forward", 0.1, 1.0), ("forward_thick", 0.5, 0.6)])
def test_three_ellipses_swim_as_those_of_the_reference(case: str, semi_minor: float, scale: float) -> None:
    linkage = ellipses(3, semi_minor, 104 if semi_minor == 0.1 else 0)
    stroke = swum(linkage, *outer(scale))
    place, heading = stroke.track(linkage, 1)
    (net,) = rows("gaits2d.csv", case)
    assert abs(place[-1] - complex(net["dx"], net["dy"])) < 1e-8
    assert heading[-1] == pytest.approx(0.0, abs=1e-8)
    track = rows("gaits2d_tracks.csv", case)
    every = (len(stroke.time) - 1) // len(track)
    assert stroke.time[:-1:every] == pytest.approx([row["t"] for row in track], abs=1e-9)
    expected = np.array([complex(row["x"], row["y"]) for row in track])
    assert np.max(np.abs(place[:-1:every] - expected)) < 1e-8
    assert heading[:-1:every] == pytest.approx([row["heading"] for row in track], abs=1e-8)


@pytest.mark.parametrize(
    "joints",
    [
        (JointAngle(waves=((1, 1.0, 0.0), (2, 0.3, QUARTER))),),
        (JointAngle(waves=((1, 1.0, 0.0),)), JointAngle(waves=((1, 0.7, 0.0),))),
        (JointAngle(0.3, ((1, 0.5, 0.2),)), JointAngle(-0.4, ((1, -0.8, 0.2),))),
    ],
)
def test_a_stroke_that_goes_back_the_way_it_came_leads_nowhere(joints: tuple[JointAngle, ...]) -> None:
    """The scallop theorem: one joint, or several in step, whatever the course of time."""
    stroke = swum(ellipses(len(joints) + 1, 0.1, 104), *joints)
    assert abs(stroke.place[-1]) < 1e-12
    assert abs(stroke.heading[-1]) < 1e-12
    assert np.max(np.abs(stroke.place)) > 1e-3, "on the way it moves"


def test_the_way_depends_on_the_angles_not_on_how_fast_they_go() -> None:
    """Another course of time through the same angles, and backwards it is the way back."""
    linkage = ellipses(3, 0.5)
    mass = AddedMass(linkage).matrix
    there = swim_stroke(linkage, mass, outer(0.6), 1.0)
    slower = swim_stroke(linkage, mass, outer(0.6), 30.0)
    assert slower.place[-1] == pytest.approx(there.place[-1], rel=1e-12)
    assert slower.energy == pytest.approx(there.energy / 900.0, rel=1e-9)
    back = swim_stroke(
        linkage, mass, [JointAngle(waves=((1, -0.6, -QUARTER),)), JointAngle(waves=((1, -0.6, 0.0),))], 1.0
    )
    turned = back.place[-1] * np.exp(1j * there.heading[-1])
    assert abs(there.place[-1] + turned) < 1e-9


def test_fins_that_meet_without_a_gap_swim_as_one_sheet() -> None:
    """A fin cut in two and joined again, the joint held, is the fin: the stroke is the same."""
    body = Member(ellipse(0.3, 0.2), 0.2, 0.01)
    nose = Member(fin(0.5, 16), 0.1, 0.01, -0.2, -0.5, 0, 0.35)
    whole = Linkage([body, nose, Member(fin(1.0, 24), 0.1, 0.01, -0.5, 0.0, 0, -0.35)])
    front = Member(fin(0.4, 24, rear_joined=True), 0.1, 0.01, -0.5, 0.0, 0, -0.35)
    rear = Member(fin(0.6, 24, front_joined=True), 0.0, 0.0, 0.0, 0.0, 2, -0.4, sealed=True)
    ahead, root = JointAngle(waves=((1, 0.4, 0.0),)), JointAngle(waves=((1, 0.4, 1.0),))
    in_two = swum(Linkage([body, nose, front, rear]), ahead, root, JointAngle())
    assert in_two.place[-1] == pytest.approx(swum(whole, ahead, root).place[-1], rel=1e-6)


def test_links_that_collide_are_refused_with_the_time() -> None:
    with pytest.raises(StrokeError, match=r"members 1 and 2 collide at t = .* s of the stroke, with the joints at"):
        swum(ellipses(2), JointAngle(waves=((1, 3.0, 0.0),)))


def test_an_angle_too_few_is_refused() -> None:
    with pytest.raises(ValueError, match="1 joint angles for a linkage of 2 joints"):
        swum(ellipses(3), JointAngle())
