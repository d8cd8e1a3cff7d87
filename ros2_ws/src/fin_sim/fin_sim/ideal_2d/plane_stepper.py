"""A fish in a plane ideal flow, advanced through time: with a table of its water, or with the water solved for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_sim import time_stepping
from fin_sim.dynamics import BODY_STATES, RECORD_HEAD, SERVO_POWER
from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.direct_dynamics import Direct
from fin_sim.ideal_2d.plane_dynamics import integrate_plane
from fin_sim.ideal_2d.plane_fish import linkage_of, slice_of, table_of
from fin_sim.ideal_2d.table import MOST_JOINTS_ON_A_GRID, refuse_fold
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.chain import Chain
    from fin_sim.ideal_2d.table import Table

DEGREE, QUICK_DEGREE = 8, 6
"""Of the tables: with that of a quick swim, mean speeds are right to 3e-4 and a shape takes half the time."""
_LONGEST_STEP = 5e-3  # s; a shorter one, as strips need it, tells nothing more
DRIVEN_REACHES = (0.35, 0.6, 0.9, 1.2)
PASSIVE_REACHES = (0.7, 1.2)
"""Half-widths of the table, rad: the least that holds what is commanded; those that are tried in turn for hinges."""
OF_MANY = ((0.2, 4), (0.45, 4))
"""The same for the hinges of a fin with many, each of which bends less, with the degree. What bends further swims
without a table."""


class PlaneStepper(time_stepping.Stepper):
    """A fish in a plane ideal flow ready to be advanced, as `time_stepping.Stepper` one in strips."""

    def __init__(self, chain: Chain, step: float, every: int = 1, *, quick: bool = False) -> None:
        """Prepare.

        Args:
            chain: The fish; its water has neither wake nor drag.
            step: Time step in s.
            every: Steps from one kept sample to the next.
            quick: Whether the coarser table will do.

        Raises:
            ValueError: As `time_stepping.Stepper`, and what a plane flow has not, see `plane_fish.slice_of`.
        """
        self.chain = chain
        self.step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
        self.every = checks.whole_number("steps a sample", every, 1)
        self._fish = slice_of(chain)
        self._passive = np.array([index for index, driven in enumerate(chain.driven) if not driven], dtype=np.int64)
        springs = [chain.links[index] for index in self._passive]
        degree = QUICK_DEGREE if quick else DEGREE
        grid = len(chain.links) <= MOST_JOINTS_ON_A_GRID
        self._tables = tuple((reach, degree) for reach in PASSIVE_REACHES) if grid else OF_MANY
        strides = [count for count in range(1, every + 1) if every % count == 0 and count * step <= _LONGEST_STEP]
        self._stride = max(strides, default=1)
        self._solved: Direct | None = None
        self._springs = np.array([[link.stiffness for link in springs], [link.damping for link in springs]])

    def start(self) -> NDArray[np.float64]:
        """Return the state at the origin, at rest in the water, shape (6 + 2 N,)."""
        return np.zeros(BODY_STATES + 2 * len(self.chain.links))

    def _exponentials(self, table: Table) -> NDArray[np.float64]:
        """Return the matrices of the exponential integrator, shape (7, 2 E, 2 E)."""
        joints, count = len(self.chain.links), len(self._passive)
        mass = np.zeros((joints, joints))
        mass[np.triu_indices(joints)] = table.at(np.zeros(joints))[0][: joints * (joints + 1) // 2]
        mass = (mass + np.triu(mass, 1).T)[np.ix_(self._passive, self._passive)]
        linear = np.zeros((2 * count, 2 * count))
        linear[:count, count:] = np.eye(count)
        linear[count:, :count] = -np.linalg.solve(mass, np.diag(self._springs[0]))
        linear[count:, count:] = -np.linalg.solve(mass, np.diag(self._springs[1]))
        return time_stepping.exponential_matrices(linear, self.step * self._stride)

    def advance(
        self, state: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Advance ``state`` in place through the driven joints' ``motion``, as `time_stepping.Stepper.advance`.

        The records have no forces on the tail: what water presses on the tail alone is not worked out, NaN.

        Raises:
            FoldError: A joint left the largest table or, of many, what can be solved for.
            CollisionError: Links touch.
            StepError: The state stopped being finite.
        """
        joints = len(self.chain.links)
        samples = (len(motion) - 1) // (2 * self.every)
        drive = np.zeros((2 * samples * self.every // self._stride + 1, joints, 3))
        drive[:, np.array(self.chain.driven)] = motion[:: self._stride]
        begin = state.copy()
        states = np.zeros((samples + 1, len(state)))
        records = np.zeros((samples + 1, RECORD_HEAD + joints))
        records[:, :SERVO_POWER] = math.nan
        largest = float(np.abs(drive[:, :, 0]).max())
        driven = next((reach for reach in DRIVEN_REACHES if largest <= reach), DRIVEN_REACHES[-1])
        for passive, degree in self._tables:
            state[:] = begin
            reaches = tuple(driven if is_driven else passive for is_driven in self.chain.driven)
            table = table_of(self._fish, reaches, degree)
            written = integrate_plane(
                state,
                drive,
                self._passive,
                self._springs,
                table.reach,
                table.orders,
                table.weights,
                self._exponentials(table),
                (self.chain.water.current_x, self.chain.water.current_y),
                self.step * self._stride,
                self.every // self._stride,
                states,
                records,
            )
            if written > samples:
                return states, records
        if len(self.chain.links) > MOST_JOINTS_ON_A_GRID:
            state[:] = begin
            self._direct(table).integrate(state, drive, self.every // self._stride, states, records)
            if not np.isfinite(state).all():
                raise StepError(samples * self.sample_time)
            return states, records
        angles = state[BODY_STATES : BODY_STATES + joints]
        if not np.isfinite(angles).all():
            raise StepError(written * self.sample_time)
        refuse_fold(angles, table.reach, written * self.sample_time)
        raise StepError(written * self.sample_time)

    def _direct(self, table: Table) -> Direct:
        """Return the fish with its water solved for in every pose; kept, since a node advances by few samples."""
        self._solved = self._solved or Direct(
            water=AddedMass(linkage_of(self._fish)),
            driven=np.array(self.chain.driven),
            stiffness=self._springs[0],
            damping=self._springs[1],
            exponentials=self._exponentials(table),
            current=complex(self.chain.water.current_x, self.chain.water.current_y),
            step=self.step * self._stride,
        )
        return self._solved
