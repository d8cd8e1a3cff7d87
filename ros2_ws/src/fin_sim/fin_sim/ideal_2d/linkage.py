"""How rigid sections hang together at joints, and where each of them is for given joint angles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.ideal_2d.outline import crossing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_sim.ideal_2d.outline import Section


@dataclass(frozen=True)
class Member:
    """One rigid member of a linkage, in its own axes.

    Attributes:
        section: Its boundary.
        mass: Of the solid, per metre of depth, kg/m.
        inertia: Of the solid about its centre of mass, per metre of depth, kg m.
        centre: Its centre of mass, x + i y, m.
        joint: Where it is joined to its parent, in its own axes, m; without meaning for the first member.
        parent: Index of the member that it is joined to, less than its own; -1 of the first.
        parent_joint: Where it is joined to it, in the parent's axes, m.
        sealed: Whether no water passes the joint: the sections touch there, and share the flux.
    """

    section: Section
    mass: float = 0.0
    inertia: float = 0.0
    centre: complex = 0.0
    joint: complex = 0.0
    parent: int = -1
    parent_joint: complex = 0.0
    sealed: bool = False


class Linkage:
    """A tree of members in water. Its generalised velocity is (u, v, omega of the first member in its axes, joints).

    Attributes:
        members: The members, each after its parent; the first one is what the others' angles are counted from.
        density: Of the water, kg/m^3.
        moved: Of each joint and member, whether the joint turns it, shape (joints, members).
        connected: For each member the number of the sheet, without a gap, that it is part of.
    """

    def __init__(self, members: Sequence[Member], density: float = 1000.0) -> None:
        self.members = tuple(members)
        self.density = density
        count = len(self.members)
        self.moved = np.zeros((count - 1, count), dtype=bool)
        connected = list(range(count))
        for index, member in enumerate(self.members[1:], start=1):
            if member.parent >= index or member.parent < 0:
                msg = f"member {index} is joined to {member.parent}: it must be one before it, 0 to {index - 1}"
                raise ValueError(msg)
            self.moved[:, index] = self.moved[:, member.parent]
            self.moved[index - 1, index] = True
            if member.sealed:
                connected[index] = connected[member.parent]
        self.connected = np.unique(connected, return_inverse=True)[1]

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.members) - 1

    def places(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Return each member's origin (x + i y) and heading in the first member's axes, shapes (members,)."""
        origins = np.zeros(len(self.members), dtype=np.complex128)
        headings = np.zeros(len(self.members))
        for index, member in enumerate(self.members[1:], start=1):
            headings[index] = headings[member.parent] + angles[index - 1]
            hinge = origins[member.parent] + np.exp(1j * headings[member.parent]) * member.parent_joint
            origins[index] = hinge - np.exp(1j * headings[index]) * member.joint
        return origins, headings

    def hinges(self, angles: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the joints' positions in the first member's axes, x + i y, shape (joints,)."""
        origins, headings = self.places(angles)
        turned = np.exp(1j * headings)
        joints = np.array([member.joint for member in self.members[1:]], dtype=np.complex128)
        return np.asarray(origins[1:] + turned[1:] * joints)

    def velocity_of(self, member: int, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the matrix from the generalised velocity to (u, v, omega) of a member in its axes, (3, 3 + joints)."""
        origins, headings = self.places(angles)
        return self.velocity_at(member, origins[member], headings[member], self.hinges(angles))

    def velocity_at(
        self, member: int, point: complex, heading: float, hinges: NDArray[np.complex128]
    ) -> NDArray[np.float64]:
        """Return the matrix from the generalised velocity to a member's at a point (of the first member's axes).

        Args:
            member: Its index.
            point: x + i y, m.
            heading: Of the axes that the velocity is told in, rad.
            hinges: See `hinges`.
        """
        arms = np.concatenate([[point], point - hinges])
        turned = np.concatenate([[True], self.moved[:, member]])
        rates = np.where(turned, 1j * arms, 0.0) * np.exp(-1j * heading)
        forward = np.exp(-1j * heading)
        matrix = np.zeros((3, 3 + self.joints))
        matrix[:, 0] = forward.real, forward.imag, 0.0
        matrix[:, 1] = -forward.imag, forward.real, 0.0
        matrix[:, 2:] = rates.real, rates.imag, turned
        return matrix

    def outlines(self, angles: NDArray[np.float64]) -> list[NDArray[np.complex128]]:
        """Return every member's outline as a line of points, closed ones closed, in the first member's axes."""
        lines = []
        for origin, heading, member in zip(*self.places(angles), self.members, strict=True):
            section = member.section
            own = np.array(section.ends) if section.is_fin else np.append(section.nodes, section.nodes[0])
            lines.append(np.asarray(origin + np.exp(1j * heading) * own))
        return lines

    def overlap(self, angles: NDArray[np.float64]) -> tuple[int, int] | None:
        """Return two members that overlap in this pose; None where none do."""
        lines = self.outlines(angles)
        for (first, line), (second, other) in combinations(enumerate(lines), 2):
            if crossing(line, other) or _inside(line, other[0]) or _inside(other, line[0]):
                return first, second
        return None


def _inside(line: NDArray[np.complex128], point: complex) -> bool:
    """Return whether a closed line goes around a point."""
    if line[0] != line[-1] or np.min(np.abs(line - point)) == 0.0:
        return False
    return bool(abs(np.sum(np.angle((line[1:] - point) / (line[:-1] - point)))) > np.pi)
