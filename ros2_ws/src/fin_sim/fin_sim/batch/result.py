"""What a batch of swims gives: a status and the figures of each fin."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING

from fin_plant import validity
from fin_plant.gait import Gait
from fin_sim.batch.columns import GAITS, fin_at

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Status(IntEnum):
    """How a swim of the batch ended."""

    OK = 0
    REFUSED = 1
    DIVERGED = 2
    NOT_CONVERGED = 3
    FOLDED = 4
    BEYOND_TABLE = 5


_REASONS = {
    Status.DIVERGED: (
        "the state stopped being finite at every step tried: use a slower or smaller gait, or a stiffer fin"
    ),
    Status.BEYOND_TABLE: (
        "the fin folds beyond what the plane flow holds, 1.2 rad a hinge, or onto itself or the body: use a stiffer "
        "fin, or a slower or smaller gait"
    ),
    Status.NOT_CONVERGED: (
        "swims at ever shorter steps do not settle on one result: the fin whips, flutters, or is far too stiff for its "
        "mass; use a slower or smaller gait, or more damping"
    ),
}


@dataclass(frozen=True)
class BatchSwim:
    """Figures of n swims; NaN where the status is not OK.

    Attributes:
        fins: The fins' attributes by name, each of shape (n,); profiles (n, points) and own gaits (n, joints, 4).
        status: `Status`, shape (n,).
        mean_speed: Distance over ground from start to end over the duration, m/s, shape (n,): the papers' mean speed.
        mean_forward_speed: Mean over the window of the forward velocity over ground, m/s, shape (n,).
        thrust: Mean over the window of the forward force of the water on the tail less its inertial reaction, N, shape
            (n,). The reaction has no mean over whole steady beats of a body that is held; in the axes of a free body,
            which yaws, it has one: `Swim.mean_thrust` of the papers' fish is 4 to 15 % more than this.
        servo_power: Mean over the window of the servos' mechanical power, W, shape (n,).
        electrical_power: Mean over the window of what the servos draw from their supply, W, shape (n,); NaN of ideal
            servos, which tell none.
        servo_torque: Largest torque at the shaft of any servo after the gait's ramp, N m, shape (n,); NaN of ideal
            servos.
        x: Where the swim ended, m, shape (n,).
        y: Where the swim ended, m, shape (n,).
        heading: At the end, rad, shape (n,).
        largest_hinge_angle: Of any hinge at any time of the swim, rad, shape (n,); also of a fin that is ``FOLDED``.
            Above `validity.BENT_ANGLE` the figures are doubtful.
    """

    fins: dict[str, NDArray[np.generic]]
    status: NDArray[np.int8]
    mean_speed: NDArray[np.float64]
    mean_forward_speed: NDArray[np.float64]
    thrust: NDArray[np.float64]
    servo_power: NDArray[np.float64]
    electrical_power: NDArray[np.float64]
    servo_torque: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    largest_hinge_angle: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.status)

    def reason(self, index: int) -> str:
        """Return why a swim has no result; empty if it has one."""
        status = Status(self.status[index])
        if status == Status.REFUSED:
            try:
                fin_at(self.fins, index)
                if GAITS in self.fins:
                    Gait.from_rows(self.fins[GAITS][index])
            except ValueError as error:
                return str(error)
            return (
                "the fin and the fish's peduncle together have more links than a chain can have, or in ideal_2d than "
                "its table, or such that are shorter than twice the gap: use fewer segments"
            )
        if status == Status.FOLDED:
            return validity.folded(float(self.largest_hinge_angle[index]))
        return _REASONS.get(status, "")

    def warnings(self, index: int) -> list[str]:
        """Return what is doubtful in a swim that has a result; see `validity`."""
        if self.status[index] != Status.OK:
            return []
        return validity.warnings(fin_at(self.fins, index), float(self.largest_hinge_angle[index]))


FIGURES = tuple(item.name for item in fields(BatchSwim) if item.name not in {"fins", "status"})
OF_A_MOTOR = ("electrical_power", "servo_torque")
"""Those that only servos with a motor have."""
LARGEST_ANGLE = FIGURES.index("largest_hinge_angle")
