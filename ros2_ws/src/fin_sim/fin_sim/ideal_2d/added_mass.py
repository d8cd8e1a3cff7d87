"""The mass matrix of a linkage and its water by boundary integrals.

The water's velocity is that of a vortex sheet on every section: stream function psi(x) = -1/(2 pi) integral of
gamma(x') log |x - x'| ds'. On a section that moves with (u, v) and turns with omega about P, psi = u y - v x -
omega |x - P|^2 / 2 up to a constant, which is one number for each sheet without a gap: so no water passes its joints.
The circulation about each sheet is 0. With g = gamma times speed at the nodes, this is the symmetric system

    K g + c = psi,   sum of h g over each sheet = 0,

and rho times the integral of gamma psi ds is twice the kinetic energy of the plane, the inside of the outlines filled
with a flow of its own. That flow is harmonic, so it is the translation of the section and, for its turning, the
function of `Section.inner_energy`; neither depends on the pose, and both are taken off (Lamb, *Hydrodynamics*, 1932,
articles 72 and 137, for what is left: the added mass).

Since the energy is stationary in g, its derivative by a joint's angle is the explicit one, with g held: exact for the
discrete system, at the cost of one product a joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import scipy.linalg
from threadpoolctl import ThreadpoolController

from fin_sim.compiled import kernel
from fin_sim.ideal_2d.errors import MassError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from numpy.typing import NDArray

    from fin_sim.ideal_2d.linkage import Linkage


Circulation = Literal["none", "free"]
CIRCULATIONS: tuple[Circulation, ...] = ("none", "free")


_SCALE = 4.0
_ROUNDING = -1e-10


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def _one_thread() -> AbstractContextManager[object]:
    """Return a block in which BLAS keeps to one thread: on matrices this small the others cost more than they do."""
    return cast("AbstractContextManager[object]", _blas().limit(limits=1, user_api="blas"))


@dataclass(frozen=True)
class _Pose:
    """A linkage in one pose, in the first member's axes.

    Attributes:
        angles: Of the joints, rad.
        places: All nodes, x + i y.
        hinges: The joints.
        origins: Those of the members.
        headings: The same, rad.
    """

    angles: NDArray[np.float64]
    places: NDArray[np.complex128]
    hinges: NDArray[np.complex128]
    origins: NDArray[np.complex128]
    headings: NDArray[np.float64]


@kernel
def _fill(
    system: NDArray[np.float64],
    places: NDArray[np.complex128],
    member: NDArray[np.int64],
    spacing: NDArray[np.float64],
    log_scale: float,
) -> None:
    """Add the part of K between different members: -h h' / (2 pi) (log |x - x'| - log_scale)."""
    for row in range(places.shape[0]):
        for column in range(row):
            if member[row] != member[column]:
                apart = places[row] - places[column]
                distance = 0.5 * math.log(apart.real * apart.real + apart.imag * apart.imag) - log_scale
                value = -spacing[row] * spacing[column] / (2.0 * math.pi) * distance
                system[row, column] = value
                system[column, row] = value


@kernel
def _drifting(
    places: NDArray[np.complex128],
    drift: NDArray[np.complex128],
    member: NDArray[np.int64],
    layer: NDArray[np.float64],
    force: NDArray[np.complex128],
    flow: NDArray[np.float64],
) -> None:
    """Add what follows from the logarithm between different members as nodes drift.

    Args:
        places: x + i y, shape (n,).
        drift: Its rate, shape (n,).
        member: Of each node, shape (n,).
        layer: g times the spacing, shape (n,).
        force: Conjugate of the force of the other members' vortices on a node's, over the density; added to.
        flow: dK/dt times g over the spacing; added to.
    """
    for row in range(places.shape[0]):
        for column in range(row):
            if member[row] != member[column]:
                inverse = 1.0 / (2.0 * math.pi * (places[row] - places[column]))
                pulled = layer[row] * layer[column] * inverse
                force[row] += pulled
                force[column] -= pulled
                nearing = ((drift[row] - drift[column]) * inverse).real
                flow[row] -= nearing * layer[column]
                flow[column] -= nearing * layer[row]


class AddedMass:
    """A linkage ready for its mass matrix in any pose: what does not depend on the pose is computed once.

    The logarithm is that of the distance over a length of which the linkage is a small part: this adds to K what the
    zero sums of g make nothing of, and makes K positive definite.
    """

    def __init__(self, linkage: Linkage, circulation: Circulation = "none") -> None:
        """Prepare.

        Args:
            linkage: What moves.
            circulation: ``none`` about every sheet; ``free``: only about its first member, so that there is some at
                infinity. No water that was ever at rest does so, see `docs/water.md`; it is here because others did.
        """
        self.linkage = linkage
        self.circulation = circulation
        sections = [member.section for member in linkage.members]
        counts = [len(section.nodes) for section in sections]
        ends = np.cumsum(counts)
        size, sheets = int(ends[-1]), int(linkage.connected.max()) + 1
        self._member = np.repeat(np.arange(len(sections)), counts)
        self._spacing = np.repeat([section.spacing for section in sections], counts)
        self._turned = linkage.moved[:, self._member]
        reach = sum(float(np.ptp(section.nodes.real) + np.ptp(section.nodes.imag)) for section in sections)
        reach += sum(abs(member.joint) + abs(member.parent_joint) for member in linkage.members)
        self._log_scale = math.log(_SCALE * reach)
        self._own = np.zeros((size, size))
        for section, end in zip(sections, ends, strict=True):
            part = slice(end - len(section.nodes), end)
            self._own[part, part] = section.spacing**2 / (2.0 * math.pi) * (self._log_scale - section.self_log)
        self._solid_members = np.tile(np.arange(len(sections)), 2)
        self._centres = (
            np.array([member.centre for member in linkage.members]),
            np.array([section.centroid for section in sections]),
        )
        areas = np.array([section.area for section in sections])
        inside = np.array([section.inner_energy for section in sections])
        self._inertias = (
            np.concatenate([[member.mass for member in linkage.members], -linkage.density * areas]),
            np.concatenate([[member.inertia for member in linkage.members], -linkage.density * inside]),
        )
        self._border = (linkage.connected[self._member][:, None] == np.arange(sheets)) * self._spacing[:, None]
        self._without = self._border
        if circulation == "free":
            first = [int(np.flatnonzero(linkage.connected == sheet)[0]) for sheet in range(sheets)]
            self._without = (self._member[:, None] == first) * self._spacing[:, None]

    def _pose(self, angles: NDArray[np.float64]) -> _Pose:
        origins, headings = self.linkage.places(angles)
        turned = np.exp(1j * headings)
        places = np.concatenate(
            [
                origin + turn * member.section.nodes
                for origin, turn, member in zip(origins, turned, self.linkage.members, strict=True)
            ]
        )
        return _Pose(angles, places, self.linkage.hinges(angles), origins, headings)

    def _stream(self, pose: _Pose) -> NDArray[np.float64]:
        """Return psi at the nodes for each unit of the generalised velocity, shape (n, 3 + joints)."""
        places = pose.places
        stream = np.empty((len(places), 3 + self.linkage.joints))
        stream[:, 0], stream[:, 1], stream[:, 2] = places.imag, -places.real, -0.5 * np.abs(places) ** 2
        stream[:, 3:] = np.where(self._turned.T, -0.5 * np.abs(places[:, None] - pose.hinges) ** 2, 0.0)
        if self.circulation == "free":  # then the energy depends on the constant: that of the ellipse's own turning
            first = self.linkage.members[0].section
            stream[:, 2] += first.second_moment / first.area
        return stream

    def _sheet(self, pose: _Pose, stream: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return g for each column of the stream function, shape (n, columns).

        Raises:
            MassError: The system is not positive: nodes coincide or cross.
        """
        system = self._own.copy()
        _fill(system, pose.places, self._member, self._spacing, self._log_scale)
        try:
            factor = scipy.linalg.cho_factor(system, lower=True, overwrite_a=True, check_finite=False)
        except np.linalg.LinAlgError as error:
            raise MassError(_not_positive(pose.angles)) from error
        right = np.hstack([self._spacing[:, None] * stream, self._border])
        solved = scipy.linalg.cho_solve(factor, right, check_finite=False)
        layers, uniform = solved[:, : stream.shape[1]], solved[:, stream.shape[1] :]
        constants = np.linalg.solve(self._without.T @ uniform, self._without.T @ layers)
        return np.asarray(layers - uniform @ constants)

    def _solids(
        self, pose: _Pose
    ) -> tuple[NDArray[np.int64], NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
        """Return what is rigid, shapes (2 members,): member, point, mass and inertia there.

        First the solids, then, with negative masses, the flow inside of the outlines, taken off.
        """
        turned = np.exp(1j * pose.headings)
        points = np.concatenate([pose.origins + turned * centres for centres in self._centres])
        return self._solid_members, points, *self._inertias

    def matrix(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mass matrix of solids and water for these joint angles, shape (3 + joints, 3 + joints).

        Raises:
            MassError: It is not positive: sections overlap, or their nodes are too few.
        """
        with _one_thread():
            return self._matrix(self._pose(angles))[0]

    def _matrix(self, pose: _Pose) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the mass matrix, the sheet g and the stream function."""
        stream = self._stream(pose)
        sheet = self._sheet(pose, stream)
        energy = stream.T @ (self._spacing[:, None] * sheet)
        matrix = 0.5 * self.linkage.density * (energy + energy.T)
        members, points, masses, inertias = self._solids(pose)
        turned = self.linkage.moved[:, members].T
        ahead = np.ones_like(points)
        along = np.column_stack(
            [ahead, 1j * ahead, 1j * points, 1j * np.where(turned, points[:, None] - pose.hinges, 0)]
        )
        turning = np.column_stack([0.0 * masses, 0.0 * masses, np.ones_like(masses), turned])
        matrix += np.real(np.conj(along).T @ (masses[:, None] * along)) + turning.T @ (inertias[:, None] * turning)
        scale = np.sqrt(np.abs(np.diag(matrix)))
        lowest = np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] if scale.all() else 0.0
        if not lowest > _ROUNDING:
            raise MassError(_not_positive(pose.angles))
        return matrix, sheet, stream

    def matrix_and_slopes(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the mass matrix, as `matrix`, and its derivatives by the angles, shape (joints, 3 + J, 3 + J).

        Raises:
            MassError: As `matrix`.
            ValueError: With circulation the energy is not stationary: there is no such formula.
        """
        self._refuse_circulation()
        pose = self._pose(angles)
        with _one_thread():
            matrix, sheet, _ = self._matrix(pose)
            slopes = np.array([self._slope(joint, pose, sheet) for joint in range(self.linkage.joints)])
        return matrix, slopes.reshape(-1, *matrix.shape)

    def _refuse_circulation(self) -> None:
        if self.circulation == "free":
            msg = "circulation = 'free' has no exact derivatives: tabulate the matrix, or take 'none'"
            raise ValueError(msg)

    def without_momentum(
        self, angles: NDArray[np.float64], rates: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return what moves the joints of a linkage without momentum: m, A and the bias.

        The first member's velocity is -A rates, and m accelerations + bias are the joints' torques. The derivatives of
        the mass matrix are wanted times that one velocity only, which costs two products in place of one a joint.

        Args:
            angles: rad, shape (J,).
            rates: rad/s, shape (J,).

        Returns:
            m, shape (J, J); A, shape (3, J); the bias, shape (J,).

        Raises:
            MassError: As `matrix`.
            ValueError: As `matrix_and_slopes`.
        """
        self._refuse_circulation()
        pose = self._pose(angles)
        with _one_thread():
            matrix, sheet, _ = self._matrix(pose)
            connection = np.linalg.solve(matrix[:3, :3], matrix[:3, 3:])
            change, pushed = self._change(pose, sheet, np.concatenate([-connection @ rates, rates]))
        joints = matrix[3:, 3:] - matrix[3:, :3] @ connection
        return joints, connection, change[3:] - connection.T @ change[:3] - pushed

    def _change(
        self, pose: _Pose, sheet: NDArray[np.float64], velocity: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return dM/dt times a velocity, shape (3 + J,), and its energy's derivatives by the angles, shape (J,)."""
        hinges, rates, nodes = pose.hinges, velocity[3:], len(pose.places)
        members, solids, mass, _ = self._solids(pose)
        points = np.concatenate([pose.places, solids])
        turned = np.vstack([self._turned.T, self.linkage.moved[:, members].T])
        moves = self.linkage.moved[:, 1:].T & ~np.eye(len(hinges), dtype=bool)
        hinge_shift = np.where(moves, 1j * (hinges[:, None] - hinges), 0.0)  # of a hinge, by an angle
        arms = np.where(turned, points[:, None] - hinges, 0.0)
        shift = 1j * arms  # of a point, by an angle
        moving = velocity[0] + 1j * velocity[1] + 1j * velocity[2] * points + 1j * (arms @ rates)
        drift, hinge_drift = shift @ rates, hinge_shift @ rates  # as the joints turn, the first member held
        arm_drift = np.where(turned, drift[:, None] - hinge_drift, 0.0)

        x, dx, weighted = points[:nodes], drift[:nodes], self._spacing[:, None] * sheet
        layer = weighted @ velocity
        stream = np.empty((nodes, len(velocity)))
        stream[:, 0], stream[:, 1], stream[:, 2] = dx.imag, -dx.real, -np.real(np.conj(x) * dx)
        stream[:, 3:] = -np.real(np.conj(arms[:nodes]) * arm_drift[:nodes])
        force, flow = np.zeros(nodes, dtype=np.complex128), np.zeros(nodes)
        _drifting(x, dx, self._member, layer, force, flow)
        change = self.linkage.density * (stream.T @ layer + weighted.T @ (stream @ velocity - flow))
        lever = rates * (layer @ np.conj(arms[:nodes]))
        pushed = np.imag((layer * np.conj(moving[:nodes])) @ shift[:nodes]) + np.real(lever @ hinge_shift)
        pushed = self.linkage.density * (pushed + np.real(force @ shift[:nodes]))

        own, own_arms, own_drift = moving[nodes:], arms[nodes:], arm_drift[nodes:]
        own_turned = turned[nodes:] * rates
        basis = 1j * np.column_stack([np.full(len(mass), -1j), np.ones(len(mass)), points[nodes:], own_arms])
        faster = 1j * (velocity[2] * drift[nodes:] + own_drift @ rates)
        change += np.real((mass * np.conj(faster)) @ basis)
        change[2:] += np.real((mass * np.conj(own)) @ (1j * np.column_stack([drift[nodes:], own_drift])))
        turning = velocity[2] + own_turned.sum(axis=1)
        pushed += np.real((mass * np.conj(own)) @ (1j * (turning[:, None] * shift[nodes:] - own_turned @ hinge_shift)))
        return change, pushed

    def _slope(self, joint: int, pose: _Pose, sheet: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivative of the mass matrix by one joint's angle."""
        hinge = pose.hinges[joint]
        turned = self._turned[joint]
        places, hinges = pose.places, pose.hinges
        motion = np.where(turned, 1j * (places - hinge), 0.0)  # derivative of the places
        later = np.array([self.linkage.moved[joint, index + 1] and index != joint for index in range(len(hinges))])
        hinge_motion = np.where(later, 1j * (hinges - hinge), 0.0)
        stream = np.empty((len(places), 3 + len(hinges)))
        stream[:, 0], stream[:, 1], stream[:, 2] = motion.imag, -motion.real, -np.real(np.conj(places) * motion)
        arms, arm_motion = places[:, None] - hinges, motion[:, None] - hinge_motion
        stream[:, 3:] = np.where(self._turned.T, -np.real(np.conj(arms) * arm_motion), 0.0)
        explicit = stream.T @ (self._spacing[:, None] * sheet)
        ahead, behind = places[~turned], places[turned]
        kernel_motion = np.imag((behind[:, None] - hinge) / (behind[:, None] - ahead)) / (2.0 * math.pi)
        weighted = self._spacing[:, None] * sheet
        across = weighted[turned].T @ (kernel_motion @ weighted[~turned])
        slope = self.linkage.density * (explicit + explicit.T - across - across.T)
        for member, point, mass, own_inertia in zip(*self._solids(pose), strict=True):
            inertia = np.array([mass, mass, own_inertia])
            velocity = self.linkage.velocity_at(member, point, 0.0, hinges)
            moves = self.linkage.moved[:, member]
            point_motion = 1j * (point - hinge) if moves[joint] else 0.0
            rates = 1j * np.concatenate([[point_motion], np.where(moves, point_motion - hinge_motion, 0.0)])
            change = np.zeros_like(velocity)
            change[0, 2:], change[1, 2:] = rates.real, rates.imag
            half = velocity.T @ (inertia[:, None] * change)
            slope += half + half.T
        return np.asarray(slope)

    def water_of_free_members(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the added mass of the members as if their joints were cut, shape (3 members, 3 members).

        Of each member (u, v, omega) about its origin, along the first member's axes; without the solids. For members
        that are apart.
        """
        pose = self._pose(angles)
        count = len(self.linkage.members)
        motions = np.zeros((len(pose.places), count, 3))
        for index, origin in enumerate(pose.origins):
            own = self._member == index
            arm = pose.places[own] - origin
            motions[own, index] = np.stack([arm.imag, -arm.real, -0.5 * np.abs(arm) ** 2], axis=1)
        stream = motions.reshape(len(pose.places), 3 * count)
        energy = stream.T @ (self._spacing[:, None] * self._sheet(pose, stream))
        matrix = 0.5 * self.linkage.density * (energy + energy.T)
        for member, point, mass, own_inertia in zip(*(part[count:] for part in self._solids(pose)), strict=True):
            inertia = np.array([mass, mass, own_inertia])
            arm = 1j * (point - pose.origins[member])
            velocity = np.array([[1.0, 0.0, arm.real], [0.0, 1.0, arm.imag], [0.0, 0.0, 1.0]])
            part = slice(3 * member, 3 * member + 3)
            matrix[part, part] += velocity.T @ (inertia[:, None] * velocity)
        return np.asarray(matrix)


def _not_positive(angles: NDArray[np.float64]) -> str:
    shown = ", ".join(f"{angle:.4g}" for angle in angles)
    return (
        f"the mass matrix at the joint angles ({shown}) rad is not positive: members overlap there, or have too few "
        "nodes for how close they come"
    )
