"""Linkages that the tests of plane ideal flow share: the ellipses of the independent solver, and the fish."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import ellipse, fin, joined_ellipse

if TYPE_CHECKING:
    from numpy.typing import NDArray

DATA = Path(__file__).parents[1] / "data" / "potential_flow"
A, B = 0.07, 0.0225
FIN_LENGTH, FIN_SOLID = 0.08, 1180.0 * 0.208e-3


def fish(gap: float, nodes: int = 24, body_nodes: int = 160) -> Linkage:
    """Return the ellipse of 14 x 4.5 cm with its fin of 8 cm in three segments."""
    body_mass, segment = 1000.0 * math.pi * A * B, FIN_LENGTH / 3.0
    section = ellipse(A, B, body_nodes) if gap else joined_ellipse(A, B, body_nodes)
    members = [Member(section, body_mass, body_mass * (A * A + B * B) / 4.0)]
    for index in range(3):
        joined = {} if gap else {"front_joined": True, "rear_joined": index < 2}
        sheet = fin(segment - gap, nodes, **joined)
        front = 0.5 * gap
        members.append(
            Member(
                sheet,
                FIN_SOLID * segment,
                FIN_SOLID * segment**3 / 12.0,
                complex(-0.5 * segment + front),
                complex(front),
                index,
                complex(-A) if index == 0 else complex(-segment + front),
                sealed=gap == 0.0,
            )
        )
    return Linkage(members)


def ellipses(count: int = 3, semi_minor: float = 0.1, nodes: int = 0) -> Linkage:
    """Return a row of ellipses of length 2, each as dense as the water, hinged 0.2 beyond their tips."""
    section, mass = ellipse(1.0, semi_minor, nodes), math.pi * semi_minor
    inertia = mass * (1.0 + semi_minor**2) / 4.0
    rear = [Member(section, mass, inertia, 0.0, 1.2, parent, -1.2) for parent in range(count - 1)]
    return Linkage([Member(section, mass, inertia), *rear], 1.0)


def largest_difference(matrix: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return it over the geometric mean of the two diagonal entries."""
    scale = np.sqrt(np.diag(expected))
    return float(np.max(np.abs(matrix - expected) / np.outer(scale, scale)))
