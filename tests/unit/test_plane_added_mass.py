"""Added mass of sections in a plane ideal flow: closed forms, an independent solver's matrices, and convergence."""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.errors import MassError
from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import ellipse, fin, outline
from support.plane_linkages import DATA, FIN_LENGTH, FIN_SOLID, A, B, ellipses, fish, largest_difference

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


def reference(case: str, size: int) -> NDArray[np.float64]:
    matrix = np.full((size, size), np.nan)
    with (DATA / "mass2d.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["case"] == case:
                i, j = int(row["row"]), int(row["column"])
                matrix[i, j] = matrix[j, i] = float(row["value"])
    assert np.isfinite(matrix).all()
    return matrix


@pytest.mark.parametrize(("a", "b", "case"), [(2.0, 1.0, "ellipse_2_1"), (10.0, 1.0, "ellipse_10_1")])
def test_an_ellipse_has_lambs_added_mass(a: float, b: float, case: str) -> None:
    matrix = AddedMass(Linkage([Member(ellipse(a, b))], 1.0)).matrix(np.zeros(0))
    closed_form = math.pi * np.diag([b * b, a * a, (a * a - b * b) ** 2 / 8.0])
    assert largest_difference(matrix, closed_form) < 1e-11
    assert largest_difference(matrix, reference(case, 3)) < 1e-11


def test_a_fin_without_thickness_has_that_of_a_plate() -> None:
    matrix = AddedMass(Linkage([Member(fin(2.0, 8), joint=0.0)], 1.0)).matrix(np.zeros(0))
    about_its_middle = math.pi * np.array([[1.0, -1.0], [-1.0, 1.0 + 1.0 / 8.0]])
    assert matrix[1:, 1:] == pytest.approx(about_its_middle, abs=1e-13)
    assert matrix[0, 0] == pytest.approx(0.0, abs=1e-13)


def test_two_circles_move_each_other_as_the_reference_says() -> None:
    circle = ellipse(1.0, 1.0)
    water = AddedMass(Linkage([Member(circle), Member(circle, parent=0, parent_joint=2.5)], 1.0))
    expected = reference("two_circles_2.5", 6)
    assert np.max(np.abs(water.water_of_free_members(np.zeros(1)) - expected)) < 1e-11


@pytest.mark.parametrize(("case", "angles"), [("three_ellipses_0_0", (0.0, 0.0)), ("three_ellipses_1_1", (1.0, 1.0))])
def test_three_ellipses_have_the_matrix_of_the_reference(case: str, angles: tuple[float, float]) -> None:
    matrix = AddedMass(ellipses()).matrix(np.array(angles))
    assert largest_difference(matrix, reference(case, 5)) < 1e-11


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.2, 0.3, -0.4)])
def test_the_fish_with_gaps_has_the_matrix_of_the_reference(angles: tuple[float, float, float]) -> None:
    matrix = AddedMass(fish(1e-3, 40, 400)).matrix(np.array(angles))
    assert largest_difference(matrix, reference("fish_gap1mm_" + "_".join(f"{a:g}" for a in angles), 6)) < 2e-5


def test_the_sealed_fish_of_the_reference_has_circulation_at_infinity() -> None:
    matrix = AddedMass(fish(0.0), "free").matrix(np.zeros(3))
    assert largest_difference(matrix, reference("fish_sealed_0_0_0", 6)) < 1e-6


def test_a_sealed_fish_in_sway_has_the_mass_of_its_conformal_map() -> None:
    """Ellipse and fin are mapped to a circle and a slit, and on to one slit, whose added mass is known.

    A section's sway mass is 2 pi rho (c^2 + a) - rho area, with c the radius of the circle that its outside is mapped
    to and a the coefficient of 1/z.
    """
    radius, focus = 0.5 * (A + B), 0.25 * (A * A - B * B)
    tip = A + FIN_LENGTH
    tip_of_slit = 0.5 * (tip + math.sqrt(tip * tip - 4.0 * focus))
    quarter = 0.25 * (tip_of_slit + radius**2 / tip_of_slit + 2.0 * radius)
    sway = 2.0 * math.pi * 1000.0 * (2.0 * quarter**2 - radius**2 + focus) + FIN_SOLID * FIN_LENGTH
    matrix = AddedMass(fish(0.0)).matrix(np.zeros(3))
    assert matrix[1, 1] == pytest.approx(sway, rel=1e-7)
    circulating = AddedMass(fish(0.0), "free").matrix(np.zeros(3))
    assert circulating[1, 1] > 1.25 * sway, "with circulation at infinity it is another, and wrong"


def test_the_gap_that_closes_leads_to_the_sealed_fin() -> None:
    """The inertia about the servo grows as the logarithm of the gap shrinks, and stays below that of the sheet."""
    sealed = AddedMass(fish(0.0)).matrix(np.zeros(3))[3, 3]
    gaps = ((1e-3, 24, 200), (5e-4, 32, 280), (2.5e-4, 40, 400))
    open_ones = [AddedMass(fish(*gap)).matrix(np.zeros(3))[3, 3] for gap in gaps]
    assert all(wide < narrow for wide, narrow in pairwise(open_ones))
    assert open_ones[-1] < sealed
    assert sealed / open_ones[0] == pytest.approx(2.378, abs=1e-3)


@pytest.mark.parametrize("build", [ellipses, lambda: fish(0.0, 12, 96), lambda: fish(1e-3, 16, 128)])
def test_the_derivatives_are_those_of_the_matrix(build: Callable[[], Linkage]) -> None:
    linkage = build()
    water, angles, reach = AddedMass(linkage), np.linspace(0.3, -0.4, linkage.joints), 1e-3
    matrix, slopes = water.matrix_and_slopes(angles)
    for joint in range(linkage.joints):
        around = [water.matrix(angles + k * reach * np.eye(linkage.joints)[joint]) for k in (-2, -1, 1, 2)]
        difference = (8.0 * (around[2] - around[1]) - (around[3] - around[0])) / (12.0 * reach)
        assert np.max(np.abs(slopes[joint] - difference)) < 1e-8 * np.max(np.abs(matrix))


@pytest.mark.parametrize("build", [lambda: ellipses(3, 0.5), lambda: fish(0.0), lambda: fish(1e-3)])
def test_what_moves_the_joints_without_momentum_follows_from_the_derivatives(build: Callable[[], Linkage]) -> None:
    water = AddedMass(build())
    angles = np.array([0.3, -0.4, 0.5])[: water.linkage.joints]
    rates = np.array([1.0, 2.0, -3.0])[: len(angles)]
    matrix, slopes = water.matrix_and_slopes(angles)
    joints, connection, bias = water.without_momentum(angles, rates)
    projection = np.vstack([-connection, np.eye(len(angles))])
    velocity = projection @ rates
    assert matrix[:3] @ velocity == pytest.approx(np.zeros(3), abs=1e-12 * np.abs(matrix).max())
    assert joints == pytest.approx(projection.T @ matrix @ projection)
    change, energy = (
        np.einsum("k,kij,j->i", rates, slopes, velocity),
        np.einsum("i,kij,j->k", velocity, slopes, velocity),
    )
    assert bias == pytest.approx(projection.T @ change - 0.5 * energy, rel=1e-10, abs=1e-12 * np.abs(bias).max())


def test_closed_outlines_converge_faster_than_any_power() -> None:
    exact = math.pi / 8.0 * (4.0**2 - 1.0) ** 2
    errors = [
        abs(AddedMass(Linkage([Member(ellipse(4.0, 1.0, n))], 1.0)).matrix(np.zeros(0))[2, 2] / exact - 1.0)
        for n in (12, 24, 48)
    ]
    assert errors[1] < 2.0 * errors[0] ** 2, "twice the nodes, twice the digits"
    assert errors[2] < 2.0 * errors[1] ** 2


def test_the_sealed_fish_converges_in_its_nodes() -> None:
    angles = np.array([0.2, 0.5, -0.4])
    finest = AddedMass(fish(0.0, 48, 384)).matrix(angles)
    errors = [largest_difference(AddedMass(fish(0.0, n, 8 * n)).matrix(angles), finest) for n in (6, 12, 24)]
    order = [math.log2(before / after) for before, after in pairwise(errors)]
    assert min(order) > 3.0
    assert errors[1] < 1e-5


def test_the_frame_of_the_first_member_makes_no_difference_to_the_energy() -> None:
    """The same motion told from the other end has the same energy, and the mirrored pose the mirrored matrix."""
    water, angles = AddedMass(ellipses()), np.array([0.7, -0.4])
    mirror = np.diag([1.0, -1.0, -1.0, -1.0, -1.0])
    assert water.matrix(-angles) == pytest.approx(mirror @ water.matrix(angles) @ mirror, abs=1e-10)
    pose = ellipses()
    generalised = np.array([0.3, -0.2, 0.5, 0.4, 0.7])
    last = pose.velocity_of(2, angles) @ generalised
    backwards = np.concatenate([last, -generalised[:2:-1]])
    turned = np.diag([-1.0, -1.0, 1.0, 1.0, 1.0])  # half a turn: its front end shows backwards
    energy = (turned @ backwards) @ water.matrix(-angles[::-1]) @ (turned @ backwards)
    assert energy == pytest.approx(generalised @ water.matrix(angles) @ generalised, rel=1e-10)


def test_members_that_overlap_are_refused() -> None:
    with pytest.raises(MassError, match=r"joint angles \(3, 0\) rad is not positive: members overlap"):
        AddedMass(ellipses()).matrix(np.array([3.0, 0.0]))


def circle(count: int, turn: float = 2.0 * math.pi) -> list[tuple[float, float]]:
    angles = np.arange(count) * turn / count
    return list(zip(np.cos(angles), np.sin(angles), strict=True))


def test_an_outline_of_points_is_the_smooth_section_through_them() -> None:
    points = [(2.0 * x, y) for x, y in circle(80)]
    mass = [
        AddedMass(Linkage([Member(shape)], 1.0)).matrix(np.zeros(0)) for shape in (outline(points), ellipse(2.0, 1.0))
    ]
    assert mass[0] == pytest.approx(mass[1], abs=1e-5)
    assert outline(points[::-1]).area == pytest.approx(2.0 * math.pi, rel=1e-6)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (circle(5), r"points of the outline = 5"),
        (circle(40, math.pi), r"the outline is open: from its last point to its first it is 1.998 m"),
        ([*circle(20)[:5], circle(20)[4], *circle(20)[5:]], r"point 5 of the outline stands twice"),
        ([(x, y * x) for x, y in circle(21)], r"the outline crosses itself near"),
        ([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)], r"turns by 90 degrees at its point 1"),
        ([*circle(10)[:9], (math.nan, 0.0)], r"point 10 of the outline is \(nan"),
    ],
)
def test_an_outline_that_is_no_smooth_closed_line_is_refused(points: list[tuple[float, float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        outline(points)
