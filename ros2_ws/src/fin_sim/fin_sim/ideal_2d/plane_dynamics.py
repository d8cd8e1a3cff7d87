"""How the fish moves in a plane ideal flow: the equations of its joints, compiled, and an exponential integrator.

With m(theta) and A(theta) of `plane_fish` in a table, the joints obey Lagrange's equations

    m theta'' + m' theta' - 1/2 theta' (dm/dtheta) theta' = torques,

the elastic ones with those of spring and damper; those that are driven ask for theirs. The springs are stiff: what they
do about the straight pose is integrated exactly (Cox & Matthews, Journal of Computational Physics 176, 2002, as
`time_stepping`), so that a step of a fortieth of a beat is short enough.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_sim import time_stepping
from fin_sim.compiled import kernel
from fin_sim.dynamics import BODY_STATES, RECORD_HEAD, SERVO_POWER, SURGE, SWAY, YAW_RATE
from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.direct_dynamics import Direct
from fin_sim.ideal_2d.plane_fish import linkage_of, slice_of, table_of
from fin_sim.ideal_2d.table import MOST_JOINTS_ON_A_GRID, evaluate_table, refuse_fold
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


@kernel
def _accelerations(
    angles: NDArray[np.float64],
    rates: NDArray[np.float64],
    accelerations: NDArray[np.float64],
    passive: NDArray[np.int64],
    stiffness: NDArray[np.float64],
    damping: NDArray[np.float64],
    values: NDArray[np.float64],
    torques: NDArray[np.float64],
    scratch: NDArray[np.float64],
) -> None:
    """Complete the joints' accelerations, and write every joint's torque: the servo's, or spring's and damper's.

    Args:
        angles: rad, shape (J,).
        rates: rad/s, shape (J,).
        accelerations: Shape (J,); those of the driven joints are given.
        passive: Which joints are elastic, shape (E,).
        stiffness: Of the elastic joints, shape (E,).
        damping: The same.
        values: What the table has for these angles, see `evaluate_table`.
        torques: Shape (J,), written.
        scratch: Shape (2 + E, J).
    """
    joints, count = angles.shape[0], passive.shape[0]
    bias, system = scratch[0], scratch[2:]
    position = 0
    for i in range(joints):
        bias[i] = 0.0
    for i in range(joints):
        for j in range(i, joints):
            turn = 0.0
            for k in range(joints):
                turn += values[1 + k, position] * rates[k]
                pushed = values[1 + k, position] * rates[i] * rates[j]
                bias[k] -= 0.5 * pushed if i == j else pushed
            bias[i] += turn * rates[j]
            if i != j:
                bias[j] += turn * rates[i]
            position += 1
    right = scratch[1]
    for row in range(count):
        i = passive[row]
        right[row] = -stiffness[row] * angles[i] - damping[row] * rates[i] - bias[i]
        torques[i] = -stiffness[row] * angles[i] - damping[row] * rates[i]
        for j in range(joints):
            driven = True
            for column in range(count):
                if passive[column] == j:
                    driven = False
                    system[row, column] = values[0, _upper(i, j, joints)]
            if driven:
                right[row] -= values[0, _upper(i, j, joints)] * accelerations[j]
    for pivot in range(count):  # positive definite: no pivoting
        for row in range(pivot + 1, count):
            factor = system[row, pivot] / system[pivot, pivot]
            for column in range(pivot, count):
                system[row, column] -= factor * system[pivot, column]
            right[row] -= factor * right[pivot]
    for row in range(count - 1, -1, -1):
        total = right[row]
        for column in range(row + 1, count):
            total -= system[row, column] * accelerations[passive[column]]
        accelerations[passive[row]] = total / system[row, row]
    for i in range(joints):
        elastic = False
        for row in range(count):
            elastic = elastic or passive[row] == i
        if not elastic:
            torques[i] = bias[i]
            for j in range(joints):
                torques[i] += values[0, _upper(i, j, joints)] * accelerations[j]


@kernel
def _upper(i: int, j: int, size: int) -> int:
    """Return the place of an entry of a symmetric matrix in its upper triangle, row by row."""
    low, high = min(i, j), max(i, j)
    return low * size - low * (low - 1) // 2 + high - low


@kernel
def integrate_plane(
    state: NDArray[np.float64],
    motion: NDArray[np.float64],
    passive: NDArray[np.int64],
    springs: NDArray[np.float64],
    reach: NDArray[np.float64],
    orders: NDArray[np.int64],
    weights: NDArray[np.float64],
    matrices: NDArray[np.float64],
    current: tuple[float, float],
    step: float,
    every: int,
    samples: NDArray[np.float64],
    records: NDArray[np.float64],
) -> int:
    """Advance the state; write samples, and torques and power as `time_stepping.integrate` does.

    Args:
        state: Shape (6 + 2 J,), advanced in place.
        motion: Angle, rate and acceleration of every joint at each half step; of the elastic ones 0, shape
            (2 steps + 1, J, 3).
        passive: Which joints are elastic, shape (E,).
        springs: Their stiffness and damping, shape (2, E).
        reach: Of the table.
        orders: The same.
        weights: The same.
        matrices: Of the exponential integrator, shape (7, 2 E, 2 E), as `time_stepping.propagator` has them.
        current: Velocity of the water along the tank's axes, m/s.
        step: s.
        every: Steps from one sample to the next.
        samples: Shape (samples, 6 + 2 J).
        records: Shape (samples, 9 + J) or more; torques come last.

    Returns:
        The number of samples written: all, or those before a joint left the table, or the state was not finite.
    """
    joints, count = motion.shape[1], passive.shape[0]
    upper = joints * (joints + 1) // 2
    steps = (motion.shape[0] - 1) // 2
    largest = 1
    for term in range(orders.shape[0]):
        for joint in range(joints):
            largest = max(largest, orders[term, joint])
    polynomials = np.empty((2 * joints, largest + 1))
    values = np.empty((1 + joints, weights.shape[1]))
    angles, rates, accelerations = np.zeros(joints), np.zeros(joints), np.zeros(joints)
    torques, scratch = np.zeros(joints), np.zeros((2 + max(1, count), max(joints, count)))
    pose_slope, rest = np.zeros((4, 3)), np.zeros((4, 2 * count))
    begin, first, part, made = np.zeros(2 * count), np.zeros(2 * count), np.zeros(2 * count), np.zeros(2 * count)
    pose, stage_heading = state[:3], 0.0
    for i in range(count):
        begin[i], begin[count + i] = state[BODY_STATES + passive[i]], state[BODY_STATES + joints + passive[i]]
    for index in range(steps + 1):
        for number in range(4):
            drive = motion[2 * index + (number + 1) // 2]
            for j in range(joints):
                angles[j], rates[j], accelerations[j] = drive[j, 0], drive[j, 1], drive[j, 2]
            for i in range(count):
                own = begin[i] if number == 0 else part[i]
                angles[passive[i]] = own
                rates[passive[i]] = begin[count + i] if number == 0 else part[count + i]
            inside = True
            for j in range(joints):
                inside = inside and abs(angles[j]) <= reach[j] * (1.0 + 1e-9)
            if not inside:  # also where it is not a number
                for j in range(joints):
                    state[BODY_STATES + j] = angles[j]
                return int((index - 1) // every + 1) if index > 0 else 0
            evaluate_table(angles, reach, orders, weights, polynomials, upper, values)
            _accelerations(angles, rates, accelerations, passive, springs[0], springs[1], values, torques, scratch)
            surge, sway, turn = 0.0, 0.0, 0.0
            for j in range(joints):
                surge -= values[0, upper + j] * rates[j]
                sway -= values[0, upper + joints + j] * rates[j]
                turn -= values[0, upper + 2 * joints + j] * rates[j]
            if number == 0 and index % every == 0:
                row = index // every
                state[SURGE], state[SWAY], state[YAW_RATE] = surge, sway, turn
                power = 0.0
                for j in range(joints):
                    state[BODY_STATES + j], state[BODY_STATES + joints + j] = angles[j], rates[j]
                    records[row, records.shape[1] - joints + j] = torques[j]
                    power += torques[j] * rates[j]
                for i in range(count):
                    power -= torques[passive[i]] * rates[passive[i]]
                records[row, SERVO_POWER] = power
                samples[row] = state
            if index == steps:
                break
            heading = pose[2] if number == 0 else stage_heading
            cosine, sine = math.cos(heading), math.sin(heading)
            pose_slope[number, 0] = surge * cosine - sway * sine + current[0]
            pose_slope[number, 1] = surge * sine + sway * cosine + current[1]
            pose_slope[number, 2] = turn
            stage_heading = pose[2] + (step if number == 2 else 0.5 * step) * turn  # noqa: PLR2004
            source = begin if number == 0 else part
            for i in range(count):
                rest[number, i] = 0.0
                rest[number, count + i] = accelerations[passive[i]]
                for j in range(2 * count):
                    rest[number, count + i] -= matrices[0, count + i, j] * source[j]
            if number == 3:  # noqa: PLR2004
                break
            for i in range(2 * count):
                made[i] = 0.0
                for j in range(2 * count):
                    if number == 2:  # noqa: PLR2004
                        made[i] += matrices[1, i, j] * first[j] + matrices[3, i, j] * (2.0 * rest[2, j] - rest[0, j])
                    else:
                        made[i] += matrices[1, i, j] * begin[j] + matrices[3, i, j] * rest[number, j]
            for i in range(2 * count):
                part[i] = made[i]
                if number == 0:
                    first[i] = made[i]
        if index == steps:
            break
        for i in range(2 * count):
            made[i] = 0.0
            for j in range(2 * count):
                made[i] += matrices[2, i, j] * begin[j] + matrices[4, i, j] * rest[0, j]
                made[i] += matrices[5, i, j] * (rest[1, j] + rest[2, j]) + matrices[6, i, j] * rest[3, j]
        for i in range(2 * count):
            begin[i] = made[i]
        for i in range(3):
            pose[i] += step / 6.0 * (pose_slope[0, i] + 2.0 * (pose_slope[1, i] + pose_slope[2, i]) + pose_slope[3, i])
    return int(steps // every + 1)


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
