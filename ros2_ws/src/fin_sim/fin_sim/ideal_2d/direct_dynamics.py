"""The same motion as `plane_dynamics` without a table: the water is solved for at every moment.

A tail of many hinges that folds far has no table: in part of any box of angles it would lie on itself. What a moment
costs is some thousandths of a second, so this is for what tables do not hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.dynamics import BODY_STATES, HEADING, SERVO_POWER, SURGE, SWAY, YAW_RATE, X, Y
from fin_sim.ideal_2d.errors import CollisionError, MassError
from fin_sim.ideal_2d.table import FoldError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.ideal_2d.added_mass import AddedMass

    Array = NDArray[np.float64]

REACH = 1.2
"""Largest angle of a hinge, rad: the water near a sealed hinge is right to a thousandth up to it."""
_MAY_MEET = 1.5
"""Between the headings of any two links, rad: a tail that bends less reaches neither itself nor the body."""


@dataclass(frozen=True)
class Direct:
    """A fish without momentum whose water is solved for in every pose.

    Attributes:
        water: Its linkage, ready for the mass matrix.
        driven: Of each joint, whether it is; shape (J,).
        stiffness: Of the elastic joints, shape (E,).
        damping: The same.
        exponentials: Of the elastic joints about the straight pose, shape (7, 2 E, 2 E); `time_stepping.propagator`.
        current: Velocity of the water along the tank's axes, x + i y, m/s.
        step: s.
    """

    water: AddedMass
    driven: NDArray[np.bool_]
    stiffness: Array
    damping: Array
    exponentials: Array
    current: complex
    step: float

    def _moment(self, elastic: Array, drive: Array, time: float) -> tuple[Array, Array, Array, Array]:
        """Return accelerations of the elastic joints, body velocity, every joint's torque and rate.

        Raises:
            FoldError: A hinge beyond `REACH`.
            CollisionError: The matrix is not positive, for links are in each other.
        """
        angles, rates, accelerations = drive.T.copy()
        passive, count = ~self.driven, len(self.stiffness)
        angles[passive], rates[passive] = elastic[:count], elastic[count:]
        beyond = np.flatnonzero(~(np.abs(angles) <= REACH))
        if len(beyond):
            raise FoldError(int(beyond[0]), float(angles[beyond[0]]), REACH, time)
        try:
            mass, connection, bias = self.water.without_momentum(angles, rates)
        except MassError as error:
            raise CollisionError(None, time) from error
        springs = -self.stiffness * angles[passive] - self.damping * rates[passive]
        pushed = springs - bias[passive] - mass[np.ix_(passive, self.driven)] @ accelerations[self.driven]
        accelerations[passive] = np.linalg.solve(mass[np.ix_(passive, passive)], pushed)
        torques = mass @ accelerations + bias
        torques[passive] = springs
        return accelerations[passive], -connection @ rates, torques, rates

    def integrate(self, state: Array, motion: Array, every: int, samples: Array, records: Array) -> None:
        """Advance the state; the arguments are those of `plane_dynamics.integrate_plane`.

        Raises:
            FoldError: A hinge beyond `REACH`.
            CollisionError: Links touch.
        """
        joints, count, step = len(self.driven), len(self.stiffness), self.step
        linear, half, whole, advance, first, middle, last = self.exponentials
        own = np.flatnonzero(~self.driven)
        elastic = np.concatenate([state[BODY_STATES + own], state[BODY_STATES + joints + own]])
        place, heading = complex(state[X], state[Y]), float(state[HEADING])

        def slopes(elastic: Array, index: int, heading: float) -> tuple[Array, complex, float, Array, Array, Array]:
            found = self._moment(elastic, motion[index], 0.5 * index * step)
            accelerations, velocity, torques, rates = found
            rest = np.zeros(2 * count)
            rest[count:] = accelerations - linear[count:] @ elastic
            over_ground = complex(velocity[0], velocity[1]) * np.exp(1j * heading) + self.current
            return rest, over_ground, float(velocity[2]), velocity, torques, rates

        steps = (len(motion) - 1) // 2
        for index in range(steps + 1):
            r0, v0, w0, velocity, torques, rates = slopes(elastic, 2 * index, heading)
            state[:SURGE] = place.real, place.imag, heading
            state[[SURGE, SWAY, YAW_RATE]] = velocity
            angles = motion[2 * index, :, 0].copy()
            angles[own] = elastic[:count]
            if np.ptp(np.cumsum([0.0, *angles])) > _MAY_MEET:
                met = self.water.linkage.overlap(angles)
                if met:
                    raise CollisionError(met, index * step)
            state[BODY_STATES : BODY_STATES + joints], state[BODY_STATES + joints :] = angles, rates
            if index % every == 0:
                row = index // every
                records[row, -joints:], samples[row] = torques, state
                records[row, SERVO_POWER] = torques[self.driven] @ rates[self.driven]
            if index == steps:
                return
            begin = half @ elastic
            middle_1 = begin + advance @ r0
            r1, v1, w1, *_ = slopes(middle_1, 2 * index + 1, heading + 0.5 * step * w0)
            middle_2 = begin + advance @ r1
            r2, v2, w2, *_ = slopes(middle_2, 2 * index + 1, heading + 0.5 * step * w1)
            end = half @ middle_1 + advance @ (2.0 * r2 - r0)
            r3, v3, w3, *_ = slopes(end, 2 * index + 2, heading + step * w2)
            elastic = whole @ elastic + first @ r0 + middle @ (r1 + r2) + last @ r3
            place += step / 6.0 * (v0 + 2.0 * (v1 + v2) + v3)
            heading += step / 6.0 * (w0 + 2.0 * (w1 + w2) + w3)
