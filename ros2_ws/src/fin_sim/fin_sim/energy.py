"""Where the servos' energy goes: the balance that proves that no term of the equations is missing or counted twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_sim import chain as tables
from fin_sim.dense_dynamics import water_of_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.swim_result import Swim

# Gauss-Legendre points along a piece of a link: the resistive loss d |w|^3 is a polynomial of degree 4 on either side
# of the point where w changes its sign, and 12 points leave 1e-5 of it where there is such a point.
_GAUSS_POINTS = 12


@dataclass(frozen=True)
class EnergyBudget:
    """Energies and powers of a swim over its samples; every array has shape (S,).

    d(stored)/dt = servo + tow - wake - resistive - dampers - drag - yaw_damping. Lift does no work. At any time of a
    free or fixed body; under tow of the means over whole beats of a periodic swim only, since `tow` leaves out what
    the water and the tail's own mass take up and give back within a beat.

    Attributes:
        stored: Kinetic energy of body, tail and the water they carry, and of the hinges' springs, J.
        servo: Mechanical power of the servos at their shafts, W.
        tow: Power of what tows the body against the convective and resistive force, W; of a free or fixed one 0.
        wake: 1/2 m w^2 (v.e) at the trailing edge, energy left in the wake, W (Lighthill 1971, eq. 5).
        resistive: Loss to the resistive force, W.
        dampers: Loss in the hinges' dampers, W.
        drag: Loss to the body's drag, W; of a body that is held or towed 0.
        yaw_damping: Loss to the body's yaw damping, W.
    """

    stored: NDArray[np.float64]
    servo: NDArray[np.float64]
    tow: NDArray[np.float64]
    wake: NDArray[np.float64]
    resistive: NDArray[np.float64]
    dampers: NDArray[np.float64]
    drag: NDArray[np.float64]
    yaw_damping: NDArray[np.float64]

    @property
    def supplied(self) -> NDArray[np.float64]:
        """Power that comes in, W, shape (S,)."""
        return self.servo + self.tow

    @property
    def lost(self) -> NDArray[np.float64]:
        """Power that is gone, W, shape (S,)."""
        return self.wake + self.resistive + self.dampers + self.drag + self.yaw_damping


def energy_budget(swim: Swim) -> EnergyBudget:
    """Return the energies and powers of a swim.

    Raises:
        ValueError: The force acts at the tip, which does not conserve energy.
    """
    checks.choice("reactive", swim.chain.reactive, ("distributed",))
    chain, table = swim.chain, swim.chain.link_table()
    body = chain.body_vector()
    surge, sway, yaw = swim.water_surge, swim.water_sway, swim.yaw_rate  # the frame of the water is inertial
    speed = np.hypot(surge, sway)
    stored = 0.5 * (body[0] * surge**2 + body[1] * sway**2 + body[2] * yaw**2)
    if chain.water.has_matrix:
        stored = stored + water_of_matrix(swim)[0]
    resistive, dampers, wake = np.zeros_like(surge), np.zeros_like(surge), np.zeros_like(surge)
    angle, turn = np.zeros_like(surge), yaw
    vx, vy = surge, sway - chain.body.tail_offset * yaw
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    for index, row in enumerate(table):
        angle = angle + swim.joint_angles[:, index]
        turn = turn + swim.joint_rates[:, index]
        sine, cosine = np.sin(angle), np.cos(angle)
        normal, along = vy * cosine - vx * sine, vx * cosine + vy * sine
        stored = stored + 0.5 * (
            (row[tables.VIRTUAL_0] + row[tables.SOLID_0]) * normal**2
            - 2.0 * (row[tables.VIRTUAL_1] + row[tables.SOLID_1]) * normal * turn
            + (row[tables.VIRTUAL_2] + row[tables.SOLID_2]) * turn**2
            + row[tables.SOLID_0] * along**2
            + row[tables.STIFFNESS] * swim.joint_angles[:, index] ** 2
        )
        dampers += row[tables.DAMPING] * swim.joint_rates[:, index] ** 2
        length, start = row[tables.LENGTH], 0.0
        for end, front, slope in row[tables.FIRST_PIECE :].reshape(-1, tables.PIECE_COLUMNS):
            size = max(end - start, 0.0)  # a row ends with pieces of no length
            for node, weight in zip(0.5 * size * (nodes + 1.0), 0.5 * size * weights, strict=True):
                loss = (front + slope * node) * np.abs(normal - (start + node) * turn) ** 3
                resistive -= weight * row[tables.RESISTIVE] * loss
            start = max(start, end)
        tip = normal - length * turn
        wake = 0.5 * row[tables.TIP_VIRTUAL] * tip**2 * along
        vx, vy = vx + length * turn * sine, vy - length * turn * cosine
    free = chain.clamp == "free"
    return EnergyBudget(
        stored=stored,
        servo=swim.servo_power,
        tow=-swim.convective_force @ np.array(chain.held_velocity),
        wake=wake,
        resistive=resistive,
        dampers=dampers,
        drag=(body[8] * speed**2 + body[4] * speed**3) * free,
        yaw_damping=body[6] * np.abs(yaw) ** 3 * free,
    )
