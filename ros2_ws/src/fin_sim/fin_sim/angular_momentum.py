"""Where a fish's turning comes from: the balance of the angular momentum of body, tail and the water they carry.

About a point fixed in the water, the distributed form of Lighthill's force leaves exactly the moment of what is shed at
the trailing edge: with r = p - s e along a link, the moments of its convective part r x dG/ds and of -d/dt(m w n)
differ from whole derivatives by m w (v.e) each, with opposite signs. The force at the tip has the first part only at
its end and so keeps the second one's: a moment, integral of m w (v.e) over the tail, that comes from nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_sim import chain as tables
from fin_sim.dense_dynamics import water_of_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.swim_result import Swim

_GAUSS_POINTS = 12  # as for the energy's resistive loss


@dataclass(frozen=True)
class AngularMomentumBudget:
    """Angular momentum and moments of a free swim about its start, over its samples; every array has shape (S,).

    d(stored)/dt = wake + resistive + body, with ``reactive = "tip"`` + spurious.

    Attributes:
        stored: Of body, tail and the water that they carry, kg m^2/s.
        wake: Moment of the momentum that leaves at the trailing edge, N m.
        resistive: Moment of the resistive force, N m.
        body: Moment of the body's drag, lift and yaw damping, N m.
        spurious: The integral of m w (v.e) over the tail, N m, which the force at the tip adds.
    """

    stored: NDArray[np.float64]
    wake: NDArray[np.float64]
    resistive: NDArray[np.float64]
    body: NDArray[np.float64]
    spurious: NDArray[np.float64]


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertical part of the vector product, shape (S,), of vectors of shape (2, S)."""
    return np.asarray(one[0] * other[1] - one[1] * other[0])


def _axes(angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the forward and the left unit vector at an angle, each of shape (2, S)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.stack((cosine, sine)), np.stack((-sine, cosine))


def angular_momentum_budget(swim: Swim) -> AngularMomentumBudget:
    """Return the angular momentum and the moments of a swim.

    Raises:
        ValueError: The body is held or towed: what holds it takes up any moment.
    """
    if swim.chain.clamp != "free":
        msg = f"clamp = {swim.chain.clamp!r}: the balance of angular momentum needs a free body"
        raise ValueError(msg)
    chain, constants = swim.chain, swim.chain.body_vector()
    water = chain.water
    place = np.stack((swim.x - water.current_x * swim.time, swim.y - water.current_y * swim.time))
    forward, left = _axes(swim.heading)
    surge, sway, yaw = swim.water_surge, swim.water_sway, swim.yaw_rate
    stored = _cross(place, constants[0] * surge * forward + constants[1] * sway * left) + constants[2] * yaw
    if chain.water.has_matrix:
        stored = stored + water_of_matrix(swim)[1]
    speed = np.hypot(surge, sway)
    drag, side = constants[8] + constants[4] * speed, constants[5] * speed * np.arctan2(sway, surge)
    force = (side * sway - drag * surge) * forward - (side * surge + drag * sway) * left
    body = _cross(place, force) - constants[6] * yaw * np.abs(yaw)

    wake, resistive, spurious = np.zeros_like(surge), np.zeros_like(surge), np.zeros_like(surge)
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    angle, turn = swim.heading, yaw
    joint = place - constants[7] * forward
    velocity = surge * forward + (sway - constants[7] * yaw) * left
    for index, row in enumerate(chain.link_table()):
        angle = angle + swim.joint_angles[:, index]
        turn = turn + swim.joint_rates[:, index]
        forward, left = _axes(angle)
        along, normal = (np.sum(velocity * axis, axis=0) for axis in (forward, left))
        arm = _cross(joint, left)
        mass, first, second = row[tables.VIRTUAL_0 : tables.VIRTUAL_2 + 1] + row[tables.SOLID_0 : tables.SOLID_2 + 1]
        stored = stored + arm * (mass * normal - first * turn) - (first * normal - second * turn)
        stored = stored + row[tables.SOLID_0] * along * _cross(joint, forward)
        spurious += along * (row[tables.VIRTUAL_0] * normal - row[tables.VIRTUAL_1] * turn)
        length, start = row[tables.LENGTH], 0.0
        for end, height, slope in row[tables.FIRST_PIECE :].reshape(-1, tables.PIECE_COLUMNS):
            size = max(end - start, 0.0)  # a row ends with pieces of no length
            for node, weight in zip(0.5 * size * (nodes + 1.0), 0.5 * size * weights, strict=True):
                local = normal - (start + node) * turn
                push = row[tables.RESISTIVE] * (height + slope * node) * local * np.abs(local)
                resistive += weight * push * (arm - start - node)
            start = max(start, end)
        tip = normal - length * turn
        shed = row[tables.TIP_VIRTUAL] * tip * (0.5 * tip * forward - along * left)
        joint, velocity = joint - length * forward, velocity - length * turn * left
        wake = _cross(joint, shed)
    return AngularMomentumBudget(stored, wake, resistive, body, spurious)
