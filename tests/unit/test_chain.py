"""From fin to links: hinges, stiffness, profiles, and the tail's natural frequencies."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_plant.fin import ProfiledFin
from fin_sim import chain as tables
from fin_sim import dynamics
from fin_sim.chain import REACTIVE_FORMS, Chain, build_chain, fin_links
from fin_sim.energy import energy_budget
from fin_sim.fish import Body, Link, Water, ellipsoid_added_mass_factors
from fin_sim.swim import PAPER_FISH, swim
from support.paper_fish import paper_fin

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def test_hinges_between_segments_make_equal_links_the_first_one_driven() -> None:
    links, driven = fin_links(paper_fin())
    assert [link.length for link in links] == pytest.approx([0.08 / 3] * 3)
    assert driven == (True, False, False)
    assert links[1].stiffness == pytest.approx(paper_fin().hinge_stiffness(0.08 / 3))
    assert links[1].damping == pytest.approx(0.01 * links[1].stiffness)


def test_hinges_at_midpoints_make_half_links_at_both_ends() -> None:
    links, driven = fin_links(paper_fin(segments=4, hinges="midpoint"))
    assert [link.length for link in links] == pytest.approx([0.01, 0.02, 0.02, 0.02, 0.01])
    assert driven == (True, False, False, False, False)


def test_straight_edges_written_as_a_profile_are_the_same_chain() -> None:
    straight = paper_fin(tip_height=0.05, segments=5, hinges="midpoint")
    points = (0.37, 0.81)
    values = dict(vars(straight))
    written = ProfiledFin(
        **values, profile_position=points, profile_height=tuple(straight.height_at(p * 0.08) for p in points)
    )
    one, other = (build_chain(PAPER_FISH, fin).link_table() for fin in (straight, written))
    assert np.abs(one - other[:, : one.shape[1]])[:, : tables.FIRST_PIECE].max() < 1e-12
    speeds = [swim(fin, duration=2.0).mean_speed for fin in (straight, written)]
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9)


def test_profile_keeps_area_and_mass_whatever_the_segments() -> None:
    for segments in (1, 2, 3, 7, 20):
        fin = ProfiledFin(
            height=0.01, tip_height=0.01, profile_position=(0.5, 0.9), profile_height=(0.02, 0.06), segments=segments
        )
        chain = build_chain(PAPER_FISH, fin)
        assert chain.link_table()[:, tables.SOLID_0].sum() == pytest.approx(fin.area * fin.thickness * fin.density)
        assert sum(link.area for link in chain.links) == pytest.approx(fin.area)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_water_and_mass_act_on_a_profile_piece_by_piece(seed: int) -> None:
    """Every integral over a link with a profile against quadrature of the piecewise linear height itself."""
    random = np.random.default_rng(seed)
    inner = np.sort(random.uniform(0.02, 0.98, random.integers(1, 5)))
    length, heights = random.uniform(0.02, 0.1), random.uniform(0.0, 0.06, len(inner) + 2)
    profile = tuple(zip((length * inner).tolist(), heights[1:-1].tolist(), strict=True))
    link = Link(length, float(heights[0]), float(heights[-1]), 0.3, profile=profile)
    row = Chain(PAPER_FISH.body, (link,), (True,), PAPER_FISH.water).link_table()[0]
    w, turn = random.normal(), random.normal() * 30.0  # with and without a change of sign, anywhere

    def integral(function: Callable[[Array], Array]) -> float:
        breaks = np.unique(np.clip([0.0, *length * inner, length, w / turn], 0.0, length))
        nodes, weights = np.polynomial.legendre.leggauss(5)
        total = 0.0
        for low, high in pairwise(breaks):
            at = low + 0.5 * (high - low) * (nodes + 1.0)
            total += 0.5 * (high - low) * float(weights @ function(at))
        return total

    def height(at: Array) -> Array:
        return np.interp(at, [0.0, *length * inner, length], heights)

    def velocity(at: Array) -> Array:
        return w - at * turn

    force, moment = dynamics._resistive_wrench(w, turn, row)
    scale = (abs(w) + abs(turn) * length) ** 2 * 0.06 * length
    assert force == pytest.approx(integral(lambda s: height(s) * velocity(s) * np.abs(velocity(s))), abs=1e-11 * scale)
    wanted = integral(lambda s: s * height(s) * velocity(s) * np.abs(velocity(s)))
    assert moment == pytest.approx(wanted, abs=1e-11 * scale * length)
    for power in range(3):
        virtual, solid = row[tables.VIRTUAL_0 + power], row[tables.SOLID_0 + power]
        mass = integral(lambda s: 250.0 * math.pi * height(s) ** 2 * s**power)  # noqa: B023
        assert virtual == pytest.approx(mass, rel=1e-10)
        assert solid == pytest.approx(integral(lambda s: 0.3 * height(s) * s**power), rel=1e-10)  # noqa: B023


def test_energy_of_a_swim_with_a_profile_balances() -> None:
    fin = ProfiledFin(
        height=0.02, tip_height=0.03, profile_position=(0.2, 0.5, 0.8), profile_height=(0.01, 0.05, 0.01), segments=2
    )
    swum = swim(fin, duration=3.0, sample_time=1e-3)
    budget = energy_budget(swum)
    rate = np.gradient(budget.stored, swum.time)[600:-5]
    error = np.abs(rate - (budget.supplied - budget.lost)[600:-5])
    assert error.max() < 2e-4 * np.abs(budget.supplied).max()


def test_profiled_fin_swims_like_the_profile_finely_cut() -> None:
    fin = ProfiledFin(
        height=0.015, tip_height=0.015, profile_position=(0.55,), profile_height=(0.035,), hinges="midpoint"
    )
    coarse, fine = (swim(replace(fin, segments=count)).mean_speed for count in (8, 20))
    assert coarse == pytest.approx(fine, rel=0.02)


def test_bending_frequency_tends_to_the_clamped_beams_in_water() -> None:
    fin = paper_fin(segments=20, hinges="midpoint", density=0.0)
    bending = fin.young_modulus * 0.025 * fin.thickness**3 / 12.0
    mass = 0.25 * math.pi * 1000.0 * 0.025**2
    beam = 1.8751040687**2 * math.sqrt(bending / (mass * 0.08**4)) / (2.0 * math.pi)
    assert build_chain(PAPER_FISH, fin).bending_frequencies()[0] == pytest.approx(beam, rel=2e-3)


def test_rigid_tail_has_no_bending_frequency() -> None:
    assert len(build_chain(PAPER_FISH, paper_fin(segments=1)).bending_frequencies()) == 0


def test_body_of_given_added_masses_is_taken_as_given() -> None:
    body = Body.ellipsoid(0.14, 0.045, 0.06, drag_area=1e-3, lift_area=0.05, yaw_drag=4e-4)
    surge, sway, yaw = ellipsoid_added_mass_factors(0.14, 0.045, 0.06)
    assert body.added_surge == pytest.approx(surge * body.mass)
    assert body.added_sway == pytest.approx(sway * body.mass)
    assert body.added_inertia == pytest.approx(yaw * body.inertia)
    assert body.tail_offset == 0.07


@pytest.mark.parametrize("axes", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, math.nan)])
def test_ellipsoid_without_an_axis_is_refused(axes: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"length|width|height"):
        ellipsoid_added_mass_factors(*axes)


def test_sphere_has_the_added_mass_of_a_half_and_no_added_inertia() -> None:
    assert ellipsoid_added_mass_factors(1.0, 1.0, 1.0) == pytest.approx((0.5, 0.5, 0.0))


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        (((0.02, 0.01), (0.01, 0.01)), "must lie in order"),
        (((0.05, 0.01),), "link profile distance"),
        (((0.02, -0.01),), "link profile height"),
        (((0.02, math.nan),), "link profile height"),
    ],
)
def test_profile_of_a_link_that_cannot_be_is_refused(profile: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Link(0.03, 0.02, 0.02, profile=profile)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"links": (), "driven": ()}, "number of links = 0"),
        ({"driven": (True, False)}, "driven names 2 joints"),
        ({"driven": (False,)}, "no joint is driven"),
        ({"reactive": "both"}, "reactive = 'both'"),
        ({"clamp": "glued"}, "clamp = 'glued'"),
        ({"tow_speed": math.nan}, "tow_speed = nan"),
    ],
)
def test_chain_that_cannot_be_is_refused(arguments: dict[str, object], message: str) -> None:
    given = {"body": PAPER_FISH.body, "links": (Link(0.08, 0.025, 0.025),), "driven": (True,), "water": Water()}
    with pytest.raises(ValueError, match=message):
        Chain(**{**given, **arguments})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"),
    [("mass", 0.0), ("inertia", -1.0), ("drag_area", -1e-9), ("lift_area", math.nan), ("tail_offset", math.inf)],
)
def test_body_that_cannot_be_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"body\.{name}"):
        replace(PAPER_FISH.body, **{name: value})


def test_fin_that_ends_in_a_point_swims_in_both_forms() -> None:
    for reactive in REACTIVE_FORMS:
        result = swim(paper_fin(tip_height=0.0, segments=5), reactive=reactive, duration=4.0)  # type: ignore[arg-type]
        assert np.isfinite(result.joint_angles).all()
