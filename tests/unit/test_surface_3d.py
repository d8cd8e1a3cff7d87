"""The ideal flow in three dimensions against another solver, closed forms, and what its swims must conserve."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from fin_plant.fin import Fin, ProfiledFin
from fin_sim.angular_momentum import angular_momentum_budget
from fin_sim.batch import Status, swim_batch
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.links import lane_constants, link_columns
from fin_sim.chain import SOLID_2, TIP_VIRTUAL, VIRTUAL_0, VIRTUAL_1, VIRTUAL_2, Chain, Reactive, build_chain
from fin_sim.dense_dynamics import bent_matrix, dense_kinematics, place
from fin_sim.energy import energy_budget
from fin_sim.fish import Fish, Link, ellipsoid_added_mass_factors
from fin_sim.presets import preset
from fin_sim.surface_3d.added_mass import link_factors, link_matrix, straight_kinematics
from fin_sim.surface_3d.ellipsoid import Ellipsoid
from fin_sim.surface_3d.factors import factors, rectangle_factors
from fin_sim.surface_3d.sheet import Sheet
from fin_sim.swim import PAPER_FISH, swim

DATA = Path(__file__).parents[1] / "data" / "potential_flow"
AXES = (0.14, 0.045, 0.06)
BODY = Ellipsoid(0.07, 0.0225, 0.03, 0.07)
THREE = preset("three_segments")

Array = NDArray[np.float64]


def rows(name: str) -> list[dict[str, str]]:
    with (DATA / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def in_three_dimensions(fish: Fish = PAPER_FISH, **changes: str) -> Fish:
    water = replace(fish.water, model="surface_3d", **changes)  # type: ignore[arg-type]
    return replace(fish, water=water, axes=AXES if water.has_matrix else None)


def plate(length: float, height: float, along: int, across: int) -> tuple[float, float]:
    """Return the sway mass in kg and the pitch inertia about the leading edge in kg m^2 of a plate."""
    sheet = Sheet.of_profile(np.array([0.0, length]), np.array([height, height]), along, across)
    s, _ = sheet.collocation()
    strengths = np.linalg.solve(sheet.own_velocity(), np.stack((np.ones_like(s), s), axis=1))
    spans = 2.0 * np.diff(sheet.levels)[across:]
    moments = sheet.moments(np.array([0.0]), np.array([length]))[:, 0]
    mass = 1000.0 * np.einsum("pi,q,pqi->i", moments, spans, strengths.reshape(along, across, 2))
    return float(mass[0]), float(mass[1])


@pytest.mark.parametrize("row", rows("plates3d"), ids=lambda row: row["case"])
def test_plates_are_those_of_another_solver_and_of_the_rules_for_ships(row: dict[str, str]) -> None:
    length, height = float(row["length_m"]), float(row["height_m"])
    sway, pitch = plate(length, height, 24, 8)
    assert sway == pytest.approx(float(row["sway_kg"]), rel=4e-4)
    assert pitch == pytest.approx(float(row["pitch_leading_edge_kgm2"]), rel=4e-4)
    if row["dnv_rp_c205"]:  # DNV-RP-C205, table 6-2, to its three digits
        coefficient = sway / (1000.0 * math.pi / 4.0 * min(length, height) ** 2 * max(length, height))
        assert coefficient == pytest.approx(float(row["dnv_rp_c205"]), abs=6e-4)


def test_plates_converge_at_second_order() -> None:
    exact = 0.05684424  # another solver's square of 5 cm, to 1.4e-6
    errors = [abs(plate(0.05, 0.05, 2 * across, across)[0] / exact - 1.0) for across in (3, 6, 12)]
    assert errors[0] / errors[1] > 3.5
    assert errors[1] / errors[2] > 3.5
    assert errors[2] < 1e-4


@pytest.mark.parametrize("row", rows("ellipsoids3d"), ids=lambda row: row["case"])
def test_bodies_are_lambs(row: dict[str, str]) -> None:
    length, width, height = (float(row[f"{name}_m"]) for name in ("length", "width", "height"))
    mass = 1000.0 * math.pi / 6.0 * length * width * height
    surge, sway, yaw = ellipsoid_added_mass_factors(length, width, height)
    assert surge * mass == pytest.approx(float(row["surge_kg"]), rel=1e-11)
    assert sway * mass == pytest.approx(float(row["sway_kg"]), rel=1e-11)
    assert yaw * mass * (length**2 + width**2) / 20.0 == pytest.approx(float(row["yaw_kgm2"]), rel=1e-11)


def test_the_flow_of_a_moving_body_is_that_of_a_moving_sphere() -> None:
    ball = Ellipsoid(0.05, 0.05, 0.05, 0.05)
    s, z = np.array([0.0, 0.02, 0.1]), np.array([0.01, 0.0, 0.03])
    sway, yaw = ball.flow_on_sheet(s, z)
    distance = np.hypot(0.05 + s, z)
    assert sway == pytest.approx(-0.5 * (0.05 / distance) ** 3, rel=1e-12)  # beside the dipole's axis
    assert not yaw.any()


def test_sources_on_a_body_cancel_a_flow_through_it() -> None:
    # A uniform stream along y through a sphere: its density is 3 n_y / 2, and outside it is a dipole.
    ball = Ellipsoid(0.05, 0.05, 0.05, 0.05)
    surface = ball.surface(24, 12)
    density = np.linalg.solve(surface.flow_through(), -surface.normals[:, 1])
    assert density == pytest.approx(-1.5 * surface.normals[:, 1], rel=0.02)
    s, z = np.array([0.03]), np.array([0.02])
    assert surface.flow_on_sheet(s, z) @ density == pytest.approx(0.5 * (0.05 / np.hypot(0.08, 0.02)) ** 3, rel=0.01)


def straight_matrix(length: float, height: float) -> tuple[Array, Array]:
    """Return the 6 x 6 of body and three equal links, and the links' own matrix."""
    links = [Link(length / 3.0, height, height)] * 3
    own = link_matrix(links, BODY, 1000.0)
    moves = straight_kinematics([link.length for link in links], 0.07)
    body = PAPER_FISH.body
    own = own[: len(moves)]
    whole = moves.T @ own @ moves + np.diag([body.added_surge, body.added_sway, body.added_inertia, 0.0, 0.0, 0.0])
    return whole, own


@pytest.mark.parametrize(("case", "length", "height"), [("fish_8x2.5", 0.08, 0.025), ("fish_4x5", 0.04, 0.05)])
def test_body_and_fin_move_as_much_water_as_in_another_solver(case: str, length: float, height: float) -> None:
    expected = np.zeros((6, 6))
    for row in rows("fish3d"):
        if row["case"] == f"{case}_straight":
            i, j = int(row["row"]), int(row["column"])
            expected[i, j] = expected[j, i] = float(row["value"])
    whole, own = straight_matrix(length, height)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(whole - expected) / scale) < 5e-3
    assert np.array_equal(own, own.T)
    assert np.linalg.eigvalsh(own[1:, 1:])[0] > 0.0


@pytest.mark.parametrize("row", rows("link_factors3d"), ids=lambda row: row["length_over_height"])
def test_factors_are_those_of_another_solver(row: dict[str, str]) -> None:
    ratio = float(row["length_over_height"])
    links = [Link(ratio / 3.0, 1.0, 1.0)] * 3
    own = factors(links)
    expected = np.array([[float(row[f"link{k}_moment{power}"]) for power in range(3)] for k in (1, 2, 3)])
    # The first link's mass is the integral of momentum over distance from a place at rest. The other solver's sum of
    # it converges with the first power of its panels only (see the next test): up to 0.8 % are its own.
    assert own[0, 0] == pytest.approx(expected[0, 0], rel=8e-3)
    assert own.ravel()[1:] == pytest.approx(expected.ravel()[1:], rel=5e-3)
    assert own == pytest.approx(link_factors(links, 32, 10), rel=1e-3)  # the table against a solution
    pitch = sum((k / 3) ** 2 * own[k, 0] / 3 + 2 * (k / 3) * own[k, 1] / 18 + own[k, 2] / 81 for k in range(3))
    assert 3.0 * pitch == pytest.approx(float(row["pitch_root_over_strip"]), rel=3e-4)


def test_the_first_links_mass_is_the_limit_of_a_plain_sum_over_panels() -> None:
    sums = []
    for along in (48, 96, 192):
        sheet = Sheet.of_profile(np.array([0.0, 1.0]), np.array([1.0, 1.0]) / 3.2, along, 3)
        s, _ = sheet.collocation()
        line = sheet.line(np.linalg.solve(sheet.own_velocity(), s[:, None]))[:, 0]
        low, high = (np.minimum(side, 1.0 / 3.0) for side in (sheet.sides[:-1], sheet.sides[1:]))
        sums.append(float(line @ np.log(high / low)) * 3.0 / (math.pi / 4.0 / 3.2**2))
    assert (sums[1] - sums[0]) / (sums[2] - sums[1]) == pytest.approx(2.0, rel=0.1)  # first order
    limit = 2.0 * sums[2] - sums[1]
    assert link_factors([Link(1.0, 3.2, 3.2)] * 3, 24, 8)[0, 0] > 0.0
    own = factors([Link(3.2 / 3.0, 1.0, 1.0)] * 3)[0, 0]
    assert own == pytest.approx(limit, rel=1e-3)
    assert abs(sums[0] / limit - 1.0) > 5e-3


def test_a_slender_fin_becomes_the_strips() -> None:
    middle = rectangle_factors(np.array([10.0, 40.0, 160.0]), np.linspace(0.0, 1.0, 6))[:, 2]
    assert np.all(np.abs(middle - 1.0) < np.array([2e-2, 3e-3, 2e-3])[:, None])
    masses = rectangle_factors(np.array([5.0, 50.0, 200.0]), np.array([0.0, 1.0]))[:, 0, 2]  # about the root
    assert masses == pytest.approx([0.8562, 0.985, 0.996], abs=3e-3)


def test_rectangles_of_a_batch_are_all_taken_from_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    length = np.linspace(0.04, 0.14, 301)
    height = 2e-3 / length
    columns: dict[str, ArrayLike] = {"length": length, "height": height, "tip_height": height}
    columns |= {"segments": 3, "hinges": "midpoint"}
    monkeypatch.setattr("fin_sim.surface_3d.factors.link_factors", None)  # what solves; it takes milliseconds a fin
    constants = lane_constants(link_columns(PAPER_FISH, fin_columns(columns)), in_three_dimensions().water)
    assert constants["virtual_mass"].shape == (301, 4)


def test_a_fin_of_any_outline_has_factors_of_its_own_that_its_size_does_not_change() -> None:
    tapered = [Link(0.03, 0.03, 0.02), Link(0.03, 0.02, 0.01)]
    twice = [Link(0.06, 0.06, 0.04), Link(0.06, 0.04, 0.02)]
    assert np.array_equal(factors(tapered), factors(twice))
    nearly = [Link(0.03, 0.02, 0.02), Link(0.03, 0.02, 0.02 + 1e-9)]
    assert factors(nearly) == pytest.approx(factors([Link(0.03, 0.02, 0.02)] * 2), rel=1e-3)


@pytest.mark.parametrize("wake", ["lighthill", "none"])
@pytest.mark.parametrize("tip_term", ["strip", "scaled"])
def test_a_batch_has_the_links_of_a_chain(wake: str, tip_term: str) -> None:
    fish = in_three_dimensions(wake=wake, tip_term=tip_term)
    profiled = ProfiledFin(segments=3, tip_height=0.01, profile_position=(0.4,), profile_height=(0.04,))
    fins = [THREE.fin, replace(THREE.fin, length=0.05, height=0.03, tip_height=0.01), profiled]
    for fin in fins:
        columns = link_columns(fish, fin_columns([fin]))
        lane, chain = lane_constants(columns, fish.water), build_chain(fish, fin).link_table()
        assert lane["virtual_mass"][0] == pytest.approx(chain[:, VIRTUAL_0], rel=1e-9)
        assert lane["virtual_first"][0] == pytest.approx(chain[:, VIRTUAL_1], rel=1e-9)
        assert lane["normal_second"][0] == pytest.approx(chain[:, VIRTUAL_2] + chain[:, SOLID_2], rel=1e-9)
        assert lane["tip_virtual"][0, -1] == pytest.approx(chain[-1, TIP_VIRTUAL], rel=1e-9)
    batch = swim_batch(fins[:1], fish, duration=3.0, reactive="tip", threads=1)
    assert batch.mean_speed[0] == pytest.approx(swim(fins[0], fish, duration=3.0, reactive="tip").mean_speed, rel=1e-3)


def test_short_fins_are_lighter_than_the_strips_and_long_ones_hardly() -> None:
    def share(length: float, height: float) -> float:
        fin = Fin(length=length, height=height, tip_height=height)
        mass = [build_chain(fish, fin).straight_mass_matrix()[2, 2] for fish in (PAPER_FISH, in_three_dimensions())]
        solid = fin.density * fin.thickness * height * length**3 / 3.0
        return float((mass[0] - solid) / (mass[1] - solid))

    assert share(0.04, 0.05) == pytest.approx(2.21, abs=0.02)
    assert share(0.08, 0.025) == pytest.approx(1.27, abs=0.01)
    assert share(0.14, 0.0143) == pytest.approx(1.08, abs=0.01)


def test_the_scaled_tip_term_sheds_less() -> None:
    speeds = [swim(Fin(), in_three_dimensions(tip_term=term), duration=4.0).mean_speed for term in ("strip", "scaled")]
    assert 0.3 < speeds[1] / speeds[0] < 0.95


def test_the_papers_simulation_peaks_where_it_should() -> None:
    moduli = np.geomspace(4e8, 2e9, 33)
    fins = {**vars(THREE.fin), "young_modulus": moduli}
    strip = replace(THREE.fish, water=replace(THREE.fish.water, wake="none"))
    for fish, speed, modulus in (
        (strip, 1.04e-2, 0.95e9),
        (in_three_dimensions(THREE.fish, wake="none"), 0.95e-2, 0.76e9),
    ):
        batch = swim_batch(fins, fish, threads=1)
        assert np.all(batch.status == Status.OK)
        best = int(np.argmax(batch.mean_speed))
        assert batch.mean_speed[best] == pytest.approx(speed, rel=0.02)
        assert moduli[best] == pytest.approx(modulus, rel=0.06)


def test_the_matrix_takes_the_place_of_the_moments() -> None:
    chain = build_chain(in_three_dimensions(added_mass="matrix"), Fin())
    assert not chain.link_table()[:, VIRTUAL_0 : VIRTUAL_2 + 1].any()
    matrix = chain.added_mass()
    assert matrix is not None
    assert matrix.shape == (3 + 4 * len(chain.links), 3 + 2 * len(chain.links))
    assert build_chain(in_three_dimensions(), Fin()).added_mass() is None


def test_a_tail_that_begins_inside_of_the_body_is_refused_where_the_flow_around_it_counts() -> None:
    fish = in_three_dimensions(added_mass="matrix")
    inside = replace(fish, body=replace(fish.body, tail_offset=0.05))
    with pytest.raises(ValueError, match=r"body\.tail_offset = 0\.05 m lies inside of a body of length 0\.14 m"):
        swim(Fin(), inside, duration=1.0)
    with pytest.raises(ValueError, match=r"needs the body's length, width and height"):
        build_chain(replace(fish, axes=None), Fin())
    assert swim_batch([Fin()], inside, duration=1.0).status[0] == Status.REFUSED


IDEAL = in_three_dimensions(THREE.fish, wake="none", drag="off", added_mass="matrix")


def test_a_bent_tail_moves_as_much_water_as_in_another_solver() -> None:
    chain = build_chain(IDEAL, THREE.fin)
    state = np.zeros(12)
    state[6:9] = 0.2, 0.3, 0.4
    motions, jacobian, _, poses = dense_kinematics(state, chain.link_table(), chain.body.tail_offset)
    added = chain.added_mass()
    assert added is not None
    matrix = bent_matrix(added, motions, np.zeros(3), poses)[0]
    moves = jacobian[[place(i) for i in range(9)]]
    body = chain.body
    own = moves.T @ matrix @ moves + np.diag([body.added_surge, body.added_sway, body.added_inertia, 0.0, 0.0, 0.0])
    for row in rows("fish3d"):
        if row["case"] == "fish_8x2.5_bent":
            i, j = int(row["row"]), int(row["column"])
            assert own[i, j] == pytest.approx(float(row["value"]), abs=7.5e-3 * math.sqrt(own[i, i] * own[j, j]))


@pytest.mark.parametrize("row", [row for row in rows("fish_swims") if row["model"] == "surface_3d"])
def test_fish_without_wake_and_drag_swim_as_with_another_solver(row: dict[str, str]) -> None:
    fin = replace(THREE.fin, young_modulus=float(row["E_Pa"]), damping_time=float(row["damping_time_s"]))
    swum = swim(fin, IDEAL)
    assert swum.x[-1] == pytest.approx(float(row["x_m"]), rel=1e-2)
    assert swum.y[-1] == pytest.approx(float(row["y_m"]), rel=1e-2)
    assert swum.heading[-1] == pytest.approx(float(row["heading"]), rel=1e-2)
    assert swum.mean_speed == pytest.approx(1e-2 * float(row["mean_speed_cm_s"]), rel=1e-2)


@pytest.mark.parametrize("added_mass", ["links", "matrix"])
@pytest.mark.parametrize(("wake", "drag"), [("none", "off"), ("lighthill", "on"), ("none", "on")])
def test_no_energy_and_no_angular_momentum_come_from_nowhere(added_mass: str, wake: str, drag: str) -> None:
    fish = in_three_dimensions(added_mass=added_mass, wake=wake, drag=drag)
    swum = swim(replace(THREE.fin, young_modulus=1e9), fish, duration=2.0, sample_time=2e-3)
    energy = energy_budget(swum)
    gained = np.trapezoid(energy.supplied - energy.lost, swum.time)
    assert energy.stored[-1] == pytest.approx(gained, abs=2e-5 * float(np.max(energy.stored)))
    turning = angular_momentum_budget(swum)
    moments = turning.wake + turning.resistive + turning.body
    swept = swum.chain.body_vector()[2] * float(np.max(np.abs(swum.yaw_rate)))
    assert turning.stored[-1] - turning.stored[0] == pytest.approx(np.trapezoid(moments, swum.time), abs=2e-5 * swept)


def test_a_matrix_of_links_that_move_no_other_swims_as_the_moments_do(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = build_chain(in_three_dimensions(), Fin())

    def blocks(chain: Chain) -> Array:
        count = len(chain.links)
        matrix = np.zeros((3 + 4 * count, 3 + 2 * count))
        for index, (mass, first, second) in enumerate(alone.link_table()[:, VIRTUAL_0 : VIRTUAL_2 + 1]):
            at = slice(3 + 2 * index, 5 + 2 * index)
            matrix[at, at] = [[mass, -first], [-first, second]]
        return matrix if chain.water.has_matrix else np.zeros((0, 0))

    forms: tuple[Reactive, ...] = ("tip", "distributed")
    expected = [swim(Fin(), in_three_dimensions(), duration=1.5, reactive=form) for form in forms]
    monkeypatch.setattr(Chain, "added_mass", blocks)
    for form, other in zip(forms, expected, strict=True):
        swum = swim(Fin(), in_three_dimensions(added_mass="matrix"), duration=1.5, reactive=form)
        for name in ("x", "heading", "joint_angles", "servo_power", "force", "convective_force"):
            own, theirs = getattr(swum, name), getattr(other, name)
            assert own == pytest.approx(theirs, abs=1e-8 * float(np.max(np.abs(theirs)))), name
