"""Linkages whose joints have springs: Euler-Lagrange's equations with the momentum of body and water conserved.

State: the first member's pose, the momentum p = dT/d(u, v, omega) in its axes, angles and momenta dT/d(rate) of the
elastic joints. Kirchhoff's equations turn p as the first member turns, so that it stays where it is in space; a joint's
momentum grows by dT/d(angle) less the torques of spring and damper (Lamb, *Hydrodynamics*, 1932, articles 124 and 135).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.integrate

from fin_sim.ideal_2d.errors import MassError, StrokeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from fin_sim.ideal_2d.linkage import Linkage


class MassModel(Protocol):
    """What knows the mass matrix: `AddedMass`, or a table of it."""

    def matrix_and_slopes(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the mass matrix and its derivatives by the joint angles."""


@dataclass(frozen=True)
class Joint:
    """A joint: driven, or elastic.

    Attributes:
        drive: Angle and rate over time, rad and rad/s, of a driven joint; None of an elastic one.
        stiffness: Of its spring, N m/rad per metre of depth.
        damping: N m s/rad per metre of depth.
        rest: Angle at which the spring has no torque, rad.
        start: Angle of an elastic joint at time 0, rad.
        start_rate: The same, rad/s.
    """

    drive: Callable[[float], tuple[float, float]] | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    start: float = 0.0
    start_rate: float = 0.0


@dataclass(frozen=True)
class Motion:
    """What a linkage did. S samples; of the first member's pose at time 0 the tank's axes are made.

    Attributes:
        time: s, shape (S,).
        place: Of the first member, x + i y, m, shape (S,).
        heading: rad, shape (S,).
        velocity: u, v, omega of the first member in its axes, and the joints' rates, shape (S, 3 + J).
        angles: Of the joints, rad, shape (S, J).
        energy: Kinetic energy and that of the springs, J per metre of depth, shape (S,).
        momentum: Of solids and water in the tank's axes and about its origin, shape (S, 3).
    """

    time: NDArray[np.float64]
    place: NDArray[np.complex128]
    heading: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angles: NDArray[np.float64]
    energy: NDArray[np.float64]
    momentum: NDArray[np.float64]


class _Equations:
    """The equations of motion; the state is place, heading, momentum, then angles and momenta of elastic joints."""

    def __init__(self, mass: MassModel, joints: Sequence[Joint]) -> None:
        self.mass, self.joints = mass, joints
        self.elastic = [index for index, joint in enumerate(joints) if joint.drive is None]
        self.free = [0, 1, 2, *(3 + index for index in self.elastic)]
        self.held = [3 + index for index, joint in enumerate(joints) if joint.drive is not None]
        chosen = [joints[index] for index in self.elastic]
        self.stiffness = np.array([joint.stiffness for joint in chosen])
        self.damping = np.array([joint.damping for joint in chosen])
        self.rest = np.array([joint.rest for joint in chosen])

    def start(self, time: float, velocity: Sequence[float]) -> NDArray[np.float64]:
        """Return the state at the start."""
        count = len(self.elastic)
        state = np.zeros(6 + 2 * count)
        state[6 : 6 + count] = [self.joints[index].start for index in self.elastic]
        angles, whole = self._driven(time, state)
        whole[:3] = velocity
        whole[self.free[3:]] = [self.joints[index].start_rate for index in self.elastic]
        momenta = self.mass.matrix_and_slopes(angles)[0] @ whole
        state[3:6], state[6 + count :] = momenta[:3], momenta[self.free[3:]]
        return state

    def _driven(self, time: float, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the joints' angles, and the velocity with that of what is free 0."""
        angles, whole = np.zeros(len(self.joints)), np.zeros(3 + len(self.joints))
        angles[self.elastic] = state[6 : 6 + len(self.elastic)]
        for index, joint in enumerate(self.joints):
            if joint.drive is not None:
                angles[index], whole[3 + index] = joint.drive(time)
        return angles, whole

    def rates(
        self, time: float, state: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return angles, velocity, mass matrix and its derivatives.

        Raises:
            StrokeError: The matrix is not positive.
        """
        angles, whole = self._driven(time, state)
        try:
            matrix, slopes = self.mass.matrix_and_slopes(angles)
        except MassError as error:
            msg = f"at t = {time:.4g} s {error}"
            raise StrokeError(msg) from error
        momenta = np.concatenate([state[3:6], state[6 + len(self.elastic) :]])
        given = matrix[np.ix_(self.free, self.held)] @ whole[self.held]
        whole[self.free] = np.linalg.solve(matrix[np.ix_(self.free, self.free)], momenta - given)
        return angles, whole, matrix, slopes

    def springs(self, angles: NDArray[np.float64]) -> float:
        """Return the energy of the springs, J/m."""
        return 0.5 * float(np.sum(self.stiffness * (angles[self.elastic] - self.rest) ** 2))

    def __call__(self, time: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state's derivative."""
        angles, whole, _, slopes = self.rates(time, state)
        u, v, omega = whole[:3]
        along = (u + 1j * v) * np.exp(1j * state[2])
        p = state[3:6]
        turned = [omega * p[1], -omega * p[0], v * p[0] - u * p[1]]
        moving = whole[self.free[3:]]
        torque = self.stiffness * (angles[self.elastic] - self.rest) + self.damping * moving
        pushed = 0.5 * np.einsum("i,kij,j->k", whole, slopes[self.elastic], whole) - torque
        return np.concatenate([[along.real, along.imag, omega], turned, moving, pushed])


def move(
    linkage: Linkage,
    mass: MassModel,
    joints: Sequence[Joint],
    times: NDArray[np.float64],
    *,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    tolerance: float = 1e-9,
) -> Motion:
    """Return how a linkage moves.

    Args:
        linkage: What moves.
        mass: Its mass matrix and derivatives.
        joints: One for each joint.
        times: At which samples are wanted, from the start, s, shape (S,).
        velocity: Of the first member at the start, m/s and rad/s.
        tolerance: Relative and absolute, of each step of Dormand & Prince's method of order 8.

    Raises:
        ValueError: Another number of joints.
        StrokeError: Members collide, the mass matrix is not positive, or no step is short enough.
    """
    if len(joints) != linkage.joints:
        msg = f"{len(joints)} joints for a linkage of {linkage.joints}: give one for each"
        raise ValueError(msg)
    equations = _Equations(mass, joints)
    solved = scipy.integrate.solve_ivp(
        equations,
        (float(times[0]), float(times[-1])),
        equations.start(float(times[0]), velocity),
        "DOP853",
        times,
        rtol=tolerance,
        atol=tolerance * 1e-2,
    )
    if not solved.success:
        msg = f"the motion cannot be followed beyond t = {solved.t[-1] if len(solved.t) else 0:.4g} s: {solved.message}"
        raise StrokeError(msg)
    samples = []
    for time, state in zip(times.tolist(), solved.y.T, strict=True):
        angles, whole, matrix, _ = equations.rates(time, state)
        collision = linkage.overlap(angles)
        if collision:
            msg = f"members {collision[0] + 1} and {collision[1] + 1} collide at t = {time:.4g} s: stiffen the joints"
            raise StrokeError(msg)
        p = (state[3] + 1j * state[4]) * np.exp(1j * state[2])
        about = state[5] + state[0] * p.imag - state[1] * p.real
        energy = 0.5 * whole @ matrix @ whole + equations.springs(angles)
        samples.append((whole, angles, energy, [p.real, p.imag, about]))
    velocities, poses, energies, momentum = zip(*samples, strict=True)
    return Motion(
        time=times,
        place=solved.y[0] + 1j * solved.y[1],
        heading=solved.y[2],
        velocity=np.array(velocities),
        angles=np.array(poses),
        energy=np.array(energies),
        momentum=np.array(momentum),
    )
