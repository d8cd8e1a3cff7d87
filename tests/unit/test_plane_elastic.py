"""Linkages with springs in a plane ideal flow: the independent solver's motions, energy, momentum, and tables."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.elastic import Joint, Motion, move
from fin_sim.ideal_2d.errors import StrokeError
from fin_sim.ideal_2d.table import FoldError, tabulate
from support.plane_linkages import DATA, ellipses

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

DRIVEN = Joint(drive=lambda time: (0.25 * (1.0 - math.cos(time)), 0.25 * math.sin(time)))
SPRING = Joint(stiffness=1.0)
FREE = (Joint(stiffness=1.0, start=0.8, start_rate=0.3), Joint(stiffness=1.0, start=-0.5, start_rate=0.2))


def reference(case: str, seconds: int) -> dict[str, NDArray[np.float64]]:
    with (DATA / "passive2d.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["case"] == case][: seconds + 1]
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "case"}


def moved(
    joints: Sequence[Joint], times: NDArray[np.float64], *velocity: float, tolerance: float = 1e-9, nodes: int = 88
) -> Motion:
    linkage = ellipses(3, 0.1, nodes)
    return move(linkage, AddedMass(linkage), joints, times, velocity=velocity or (0.0, 0.0, 0.0), tolerance=tolerance)


def compare(motion: Motion, expected: dict[str, NDArray[np.float64]], tolerance: float) -> None:
    found = {
        "x": motion.place.real,
        "y": motion.place.imag,
        "heading": motion.heading,
        **{name: motion.velocity[:, index] for index, name in enumerate(("u", "v", "omega", "rate_1", "rate_2"))},
        "angle_1": motion.angles[:, 0],
        "angle_2": motion.angles[:, 1],
        "energy": motion.energy,
    }
    assert {name: values for name, values in found.items() if np.max(np.abs(values - expected[name])) > tolerance} == {}


@pytest.mark.parametrize("seconds", [2, pytest.param(10, marks=pytest.mark.long)])
def test_a_driven_and_an_elastic_joint_move_as_those_of_the_reference(seconds: int) -> None:
    expected = reference("one_driven_one_elastic", seconds)
    motion = moved((DRIVEN, SPRING), expected["t"])
    compare(motion, expected, 1e-6)
    assert np.max(np.abs(motion.momentum)) < 1e-9, "it began without"


@pytest.mark.parametrize(("seconds", "nodes"), [(1, 88), pytest.param(10, 120, marks=pytest.mark.long)])
def test_a_free_body_with_momentum_moves_as_that_of_the_reference(seconds: int, nodes: int) -> None:
    """Energy and momentum are conserved on the way; the ellipses come close, which 88 nodes resolve to 2e-5 at 10 s."""
    expected = reference("two_elastic_free", seconds)
    motion = moved(FREE, expected["t"], 0.4, 0.1, 0.2, tolerance=1e-10, nodes=nodes)
    compare(motion, expected, 1e-6)
    assert motion.energy == pytest.approx(motion.energy[0], rel=1e-8)
    assert motion.momentum == pytest.approx(np.broadcast_to(motion.momentum[0], motion.momentum.shape), abs=1e-8)


def test_a_damper_takes_energy_and_leaves_momentum() -> None:
    joints = [Joint(stiffness=1.0, damping=0.5, start=joint.start) for joint in FREE]
    motion = moved(joints, np.linspace(0.0, 1.0, 5), 0.4, 0.1, 0.2, tolerance=1e-8)
    assert np.all(np.diff(motion.energy) < 0.0)
    assert motion.momentum == pytest.approx(np.broadcast_to(motion.momentum[0], motion.momentum.shape), abs=1e-6)


def test_links_that_swing_into_each_other_are_refused_with_the_time() -> None:
    folding = Joint(drive=lambda time: (3.0 * time, 3.0))
    with pytest.raises(StrokeError, match=r"members 1 and 2 collide at t = 0\.9|at t = 0\.9.* members overlap there"):
        moved((folding, Joint(stiffness=100.0)), np.linspace(0.0, 1.0, 21), tolerance=1e-5)


def test_a_table_holds_the_matrix_and_its_derivatives() -> None:
    linkage = ellipses(3, 0.5)
    water = AddedMass(linkage)
    upper = np.triu_indices(5)
    table = tabulate(lambda angles: water.matrix(angles)[upper], (0.4, 0.4), degree=12)
    angles = np.array([0.31, -0.27])
    matrix, slopes = water.matrix_and_slopes(angles)
    values, derivatives = table.at(angles)
    assert values == pytest.approx(matrix[upper], abs=1e-6)
    assert derivatives == pytest.approx(np.array([slope[upper] for slope in slopes]), abs=1e-5)


def test_a_mirrored_table_is_the_whole_one_at_half_the_poses() -> None:
    seen: list[int] = []

    def functions(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        seen.append(1)
        return np.array([np.cos(angles.sum()), np.sin(angles[0] + 2.0 * angles[1])])

    whole = tabulate(functions, (0.5, 0.7))
    poses = len(seen)
    halved = tabulate(functions, (0.5, 0.7), mirror=np.array([1.0, -1.0]))
    assert len(seen) - poses == (poses + 1) // 2
    angles = np.array([0.2, -0.6])
    assert halved.at(angles)[0] == pytest.approx(whole.at(angles)[0], abs=1e-12)
    assert halved.at(angles)[0] == pytest.approx(functions(angles), abs=1e-5)


def test_a_fold_beyond_the_table_is_refused() -> None:
    table = tabulate(lambda angles: angles, (0.5,))
    with pytest.raises(FoldError, match=r"joint 1 folds to 0.6 rad, the plane flow holds from -0.5 to 0.5 rad"):
        table.at(np.array([0.6]))
