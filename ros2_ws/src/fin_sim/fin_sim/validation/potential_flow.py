"""Ideal flow in the plane and in three dimensions against closed forms and the values of independent solvers."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.fin import Fin
from fin_sim.angular_momentum import angular_momentum_budget
from fin_sim.energy import energy_budget
from fin_sim.fish import ellipsoid_added_mass_factors
from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import ellipse
from fin_sim.ideal_2d.stroke import JointAngle, swim_stroke
from fin_sim.presets import preset
from fin_sim.surface_3d.sheet import Sheet
from fin_sim.swim import PAPER_FISH, swim
from fin_sim.validation.page import Check, Section
from fin_sim.water_settings import PRESETS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_DENSITY = 1000.0
_SHOWN_AGAINST = {"ideal_2d_gap_1mm": 1e-3}
"""Rows of ``fish_swims.csv`` that the plane fish meets as they are, and their gap; of sealed ones see docs/water.md."""


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _matrix(folder: Path, case: str, size: int) -> Array:
    matrix = np.full((size, size), np.nan)
    for row in _rows(folder / "mass2d.csv"):
        if row["case"] == case:
            i, j = int(row["row"]), int(row["column"])
            matrix[i, j] = matrix[j, i] = float(row["value"])
    return matrix


def _apart(matrix: Array, expected: Array) -> float:
    """Return the largest difference over the geometric mean of the two diagonal entries."""
    scale = np.sqrt(np.diag(expected))
    return float(np.max(np.abs(matrix - expected) / np.outer(scale, scale)))


def ellipses(count: int, semi_minor: float, nodes: int = 0) -> Linkage:
    """Return a row of ellipses of length 2, each as dense as the water, hinged 0.2 beyond their tips."""
    section, mass = ellipse(1.0, semi_minor, nodes), math.pi * semi_minor
    inertia = mass * (1.0 + semi_minor**2) / 4.0
    rear = [Member(section, mass, inertia, 0.0, 1.2, parent, -1.2) for parent in range(count - 1)]
    return Linkage([Member(section, mass, inertia), *rear], 1.0)


def plate(length: float, height: float, across: int = 8) -> tuple[float, float]:
    """Return the sway mass in kg and the pitch inertia about the leading edge in kg m^2 of a plate."""
    along = 3 * across
    sheet = Sheet.of_profile(np.array([0.0, length]), np.array([height, height]), along, across)
    s, _ = sheet.collocation()
    strengths = np.linalg.solve(sheet.own_velocity(), np.stack((np.ones_like(s), s), axis=1))
    spans = 2.0 * np.diff(sheet.levels)[across:]
    moments = sheet.moments(np.array([0.0]), np.array([length]))[:, 0]
    mass = _DENSITY * np.einsum("pi,q,pqi->i", moments, spans, strengths.reshape(along, across, 2))
    return float(mass[0]), float(mass[1])


def _plane(folder: Path) -> list[Check]:
    alone = AddedMass(Linkage([Member(ellipse(10.0, 1.0))], 1.0)).matrix(np.zeros(0))
    circle = ellipse(1.0, 1.0)
    two = AddedMass(Linkage([Member(circle), Member(circle, parent=0, parent_joint=2.5)], 1.0))
    three = AddedMass(ellipses(3, 0.1))
    lamb = math.pi * np.diag([1.0, 100.0, 99.0**2 / 8.0])
    expected = _matrix(folder, "two_circles_2.5", 6)
    apart = float(np.max(np.abs(two.water_of_free_members(np.zeros(1)) - expected)))
    bent = _apart(three.matrix(np.array([1.0, 1.0])), _matrix(folder, "three_ellipses_1_1", 5))
    exact = math.pi / 8.0 * (4.0**2 - 1.0) ** 2
    misses = [
        abs(AddedMass(Linkage([Member(ellipse(4.0, 1.0, count))], 1.0)).matrix(np.zeros(0))[2, 2] / exact - 1.0)
        for count in (12, 24)
    ]
    quarter = 0.5 * math.pi
    gait = [JointAngle(waves=((1, 1.0, quarter),)), JointAngle(waves=((1, 1.0, 0.0),))]
    fine = AddedMass(ellipses(3, 0.1, 104))
    forward = swim_stroke(fine.linkage, fine.matrix, gait).track(fine.linkage, 1)[0]
    row = next(each for each in _rows(folder / "gaits2d.csv") if each["case"] == "forward")
    there = complex(float(row["dx"]), float(row["dy"]))
    one = AddedMass(ellipses(2, 0.1, 104))
    scallop = swim_stroke(one.linkage, one.matrix, [JointAngle(waves=((1, 1.0, 0.0), (2, 0.3, quarter)))])
    return [
        Check("plane, ellipse 10:1: added masses (Lamb)", _apart(alone, lamb), 1e-9),
        Check("plane, two circles: another solver", apart, 1e-9),
        Check("plane, three ellipses bent by 1 rad: the same", bent, 1e-9),
        Check(
            "plane, ellipse 4:1: error with 24 nodes over its square root with 12", misses[1] / misses[0] ** 0.5, 1.0
        ),
        Check("plane, gait `forward`: net motion, of 1.86", abs(forward[-1] - there), 1e-7),
        Check("plane, one joint there and back (scallop theorem)", abs(scallop.place[-1]), 1e-12),
    ]


def _fish(folder: Path) -> list[Check]:
    given = preset("three_segments")
    checks = []
    for row in _rows(folder / "fish_swims.csv"):
        gap = _SHOWN_AGAINST.get(row["model"])
        if gap is None:
            continue
        water = replace(given.fish.water, **PRESETS["bht"]._asdict(), gap=gap)
        modulus, damping = float(row["E_Pa"]), float(row["damping_time_s"])
        fin = replace(given.fin, young_modulus=modulus, damping_time=damping)
        found = swim(fin, replace(given.fish, water=water), duration=10.0)
        way = math.hypot(float(row["x_m"]), float(row["y_m"]))
        name = f"plane, fish with gaps, {1e-9 * modulus:g} GPa, {damping:g} s: way in 10 s, another solver"
        checks.append(Check(name, math.hypot(found.x[-1], found.y[-1]) / way - 1.0, 0.02))
    return checks


def _deep(folder: Path) -> list[Check]:
    plates = _rows(folder / "plates3d.csv")
    found = [plate(float(row["length_m"]), float(row["height_m"])) for row in plates]
    sway = max(abs(one[0] / float(row["sway_kg"]) - 1.0) for one, row in zip(found, plates, strict=True))
    pitch = max(
        abs(one[1] / float(row["pitch_leading_edge_kgm2"]) - 1.0) for one, row in zip(found, plates, strict=True)
    )
    rules = []
    for (mass, _), row in zip(found, plates, strict=True):
        if row["dnv_rp_c205"]:
            short, long = sorted((float(row["length_m"]), float(row["height_m"])))
            rules.append(abs(mass / (_DENSITY * 0.25 * math.pi * short**2 * long) - float(row["dnv_rp_c205"])))
    lamb = []
    for row in _rows(folder / "ellipsoids3d.csv"):
        axes = [float(row[f"{name}_m"]) for name in ("length", "width", "height")]
        mass = _DENSITY * math.pi / 6.0 * math.prod(axes)
        factors = ellipsoid_added_mass_factors(*axes)
        lamb += [abs(factors[at] * mass / float(row[name]) - 1.0) for at, name in enumerate(("surge_kg", "sway_kg"))]
    errors = [abs(plate(0.05, 0.05, across)[0] / float(plates[0]["sway_kg"]) - 1.0) for across in (3, 6)]
    slender = plate(1.0, 0.025)[1] / (_DENSITY * 0.25 * math.pi * 0.025**2 / 3.0)
    return [
        Check("3-D, eight plates: sway, another solver", sway, 1e-3),
        Check("3-D, eight plates: pitch about the leading edge, the same", pitch, 1e-3),
        Check("3-D, plates: coefficient of DNV-RP-C205, in its three digits", max(rules), 6e-4),
        Check("3-D, ellipsoids: surge and sway (Lamb)", max(lamb), 1e-10),
        Check(
            "3-D, square plate: four times the error with twice the panels over that before",
            4.0 * errors[1] / errors[0],
            1.2,
        ),
        Check("3-D, plate 40 times as long as high: pitch over the strips', less 1", slender - 1.0, 0.03),
    ]


def _conserved() -> list[Check]:
    water = replace(PAPER_FISH.water, wake="none", drag="off")
    found = swim(Fin(young_modulus=1e9, damping_time=0.03), replace(PAPER_FISH, water=water), duration=4.0)
    turning, energy = angular_momentum_budget(found), energy_budget(found)
    beating = float(np.max(np.abs(found.chain.body_vector()[2] * found.yaw_rate)))
    gained = float(np.trapezoid(energy.supplied - energy.lost, found.time))
    turned_over = float(np.trapezoid(np.abs(energy.supplied), found.time))
    return [
        Check(
            "no wake, no drag: change of angular momentum over the body's",
            float(np.max(np.abs(turning.stored - turning.stored[0]))) / beating,
            1e-4,
        ),
        Check(
            "the same: energy stored less work, over what is turned over",
            (energy.stored[-1] - gained) / turned_over,
            1e-3,
        ),
    ]


def section(folder: Path) -> Section:
    """Return the part on potential flow; ``folder`` holds the independent solvers' values."""
    text = """
Water as `docs/water.md` tells it: the plane ideal flow and the flow in three dimensions, against closed forms and
values of solvers that share no line with this one (`tests/data/potential_flow`)."""
    checks = [*_plane(folder), *_fish(folder), *_deep(folder), *_conserved()]
    return Section("Potential flow", checks, text)
