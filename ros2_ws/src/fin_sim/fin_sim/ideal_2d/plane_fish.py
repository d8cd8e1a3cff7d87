"""The simulator's fish in a plane ideal flow: its ellipse and its tail as a linkage, and the table that moves it.

The plane has no height: the fish is a slice of it, as high as the fin is on average, in which the fin is infinitely
high. Masses are those of the slice: the body's ellipse as dense as the fish's body is, the fin's solid as it is.

At rest at the start and without drag, the fish has no momentum, ever. The velocity of the body then follows from the
joints' rates, (u, v, omega) = -A rates, and what is left is a mass matrix m of the joints alone (Kanso et al. 2005,
section 4: the reduced Lagrangian).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fin_sim.chain import link_moments
from fin_sim.ideal_2d.added_mass import AddedMass, Circulation
from fin_sim.ideal_2d.linkage import Linkage, Member
from fin_sim.ideal_2d.outline import fin, joined_ellipse
from fin_sim.ideal_2d.table import MOST_JOINTS, Table, tabulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.chain import Chain
    from fin_sim.fish import Fish, Link

_SEALED_NODES, _SEALED_BODY_NODES = 8, 64
"""On a link and on the body: right to 6e-7 of the matrix of finer ones."""
SMALLEST_GAP = 1e-3
"""Over the length of a link."""
_SAME = 1e-9  # of a length


class Slice(NamedTuple):
    """What a fish's mass matrix in the plane follows from; hashable.

    Attributes:
        half_length: Of the body's ellipse, m.
        half_width: The same, m.
        offset: From the body's centre back to the first joint, m.
        lengths: Of the links, m.
        depth: Of the slice, m.
        water: Density, kg/m^3.
        body: Mass, kg, and inertia, kg m^2, of the slice of the body.
        solids: Of each link mass, first and second moment of the solid about its joint: kg, kg m, kg m^2.
        gap: Between links, and between body and fin, m; 0 where the tail is one sheet.
        circulation: See `AddedMass`.
    """

    half_length: float
    half_width: float
    offset: float
    lengths: tuple[float, ...]
    depth: float
    water: float
    body: tuple[float, float]
    solids: tuple[tuple[float, float, float], ...]
    gap: float = 0.0
    circulation: Circulation = "none"


def _nodes(gap: float, length: float) -> int:
    """Return the nodes of a link that resolve the gap at its ends."""
    return _SEALED_NODES if gap == 0.0 else math.ceil(8.0 / math.sqrt(2.0 * gap / length))


def linkage_of(fish: Slice) -> Linkage:
    """Return body and tail as a linkage; masses are those of the slice, so that its matrix is in kg."""
    touches = fish.gap == 0.0 and fish.offset == fish.half_length
    longest = max(fish.lengths)
    nodes = _SEALED_BODY_NODES if touches else 2 * _nodes(max(fish.gap, fish.offset - fish.half_length), longest) + 64
    body = joined_ellipse(fish.half_length, fish.half_width, nodes)
    members = [Member(body, *fish.body)]
    front = 0.5 * fish.gap
    for index, (length, solid) in enumerate(zip(fish.lengths, fish.solids, strict=True)):
        sealed = fish.gap == 0.0 and (index > 0 or touches)
        sheet = fin(
            length - fish.gap,
            _nodes(fish.gap, length),
            front_joined=sealed,
            rear_joined=fish.gap == 0.0 and index < len(fish.lengths) - 1,
        )
        mass, first, second = solid
        middle = first / mass if mass else 0.0
        members.append(
            Member(
                section=sheet,
                mass=mass,
                inertia=second - mass * middle**2,
                centre=complex(front - middle),
                joint=complex(front),
                parent=index,
                parent_joint=complex(-fish.offset if index == 0 else front - fish.lengths[index - 1]),
                sealed=sealed,
            )
        )
    return Linkage(members, fish.water * fish.depth)


def reduced(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return m's upper triangle row by row, then A row by row (u, v, omega), of a mass matrix."""
    connection = np.linalg.solve(matrix[:3, :3], matrix[:3, 3:])
    joints = matrix[3:, 3:] - matrix[3:, :3] @ connection
    return np.concatenate([joints[np.triu_indices(len(joints))], connection.ravel()])


def mirror_signs(joints: int) -> NDArray[np.float64]:
    """Return by which sign `reduced` differs in the mirrored pose: only that of the surge."""
    upper = joints * (joints + 1) // 2
    return np.concatenate([np.ones(upper), -np.ones(joints), np.ones(2 * joints)])


@lru_cache(maxsize=64)
def table_of(fish: Slice, reach: tuple[float, ...], degree: int) -> Table:
    """Return the table of `reduced` for a fish; kept, since swims that differ in stiffness share it.

    Raises:
        MassError: The matrix is not positive.
    """
    water = AddedMass(linkage_of(fish), fish.circulation)
    return tabulate(lambda angles: reduced(water.matrix(angles)), reach, mirror=mirror_signs(len(reach)), degree=degree)


def slice_of(chain: Chain) -> Slice:
    """Return the slice of a fish.

    Raises:
        ValueError: What a plane flow has not: a motor, a held body, a wake, drag, or more joints than a table has; a
            tail that begins inside of the body, or a gap as long as a link.
    """
    water, body = chain.water, chain.body
    refuse_fish(chain, chain.clamp)
    _refuse_links(chain)
    length, width, height = chain.axes or (0.0, 0.0, 0.0)
    a, b = 0.5 * length, 0.5 * width
    tail = sum(link.length for link in chain.links)
    depth = sum(link.area for link in chain.links) / tail
    displaced = water.density * math.pi / 6.0 * length * width * height
    ellipse = water.density * depth * math.pi * a * b
    return Slice(
        half_length=a,
        half_width=b,
        offset=a if abs(body.tail_offset - a) <= _SAME * a else body.tail_offset,
        lengths=tuple(link.length for link in chain.links),
        depth=depth,
        water=water.density,
        body=(
            ellipse * body.mass / displaced,
            ellipse * (a * a + b * b) / 4.0 * body.inertia / (displaced * (a * a + b * b) / 5.0),
        ),
        solids=tuple(_solid(link) for link in chain.links),
        gap=water.gap,
    )


def _solid(link: Link) -> tuple[float, float, float]:
    mass, first, second = (link.mass_per_area * moment for moment in link_moments(link, 1))
    return mass, first, second


def refuse_fish(fish: Fish | Chain, clamp: str) -> None:
    """Refuse what a plane flow has not, whatever the fin.

    Raises:
        ValueError: A wake, drag, a held body, a motor, a body without axes, or a tail that begins inside of it.
    """
    water = fish.water
    if fish.axes is None:
        msg = "water.model = ideal_2d needs the body's length and width: give axes, or another model"
        raise ValueError(msg)
    if water.wake != "none" or water.drag != "off":
        msg = (
            f"water.model = ideal_2d with water.wake = {water.wake} and water.drag = {water.drag}: a plane flow has "
            "neither trailing edge nor height; take water.preset = bht, which has no wake and no drag, or another model"
        )
        raise ValueError(msg)
    if clamp != "free":
        msg = (
            f"clamp = {clamp} with water.model = ideal_2d: without a wake a held or towed fish has exactly no mean "
            "thrust; leave the body free, or take another model"
        )
        raise ValueError(msg)
    if fish.motor is not None:
        msg = "servo.stall_torque with water.model = ideal_2d: its servos go as commanded; leave it out"
        raise ValueError(msg)
    half = 0.5 * fish.axes[0]
    if fish.body.tail_offset < half * (1.0 - _SAME):
        msg = (
            f"body.tail_offset = {fish.body.tail_offset:g} m begins the tail inside of the body, which ends {half:g} m "
            "behind its centre: give at least that, or a shorter body.length"
        )
        raise ValueError(msg)


def _refuse_links(chain: Chain) -> None:
    """Refuse a tail that is none in a plane flow.

    Raises:
        ValueError: More joints than a table has, or a gap that is as long as a link, or too narrow.
    """
    if len(chain.links) > MOST_JOINTS:
        msg = (
            f"{len(chain.links)} joints with water.model = ideal_2d: its table has {MOST_JOINTS} at most; take fewer "
            "fin.segments"
        )
        raise ValueError(msg)
    gap, shortest = chain.water.gap, min(link.length for link in chain.links)
    if gap and not SMALLEST_GAP * shortest <= gap <= 0.5 * shortest:
        msg = (
            f"ideal_2d.gap = {gap:g} m must be 0, for no gap, or {SMALLEST_GAP * shortest:.3g} to "
            f"{0.5 * shortest:.3g} m: the shortest link is {shortest:g} m long"
        )
        raise ValueError(msg)
