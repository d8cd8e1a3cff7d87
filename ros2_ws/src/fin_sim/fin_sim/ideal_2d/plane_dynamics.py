"""How the fish moves in a plane ideal flow: the equations of its joints and their integration, compiled.

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

from fin_sim.compiled import kernel
from fin_sim.dynamics import BODY_STATES, SERVO_POWER, SURGE, SWAY, YAW_RATE
from fin_sim.ideal_2d.table import evaluate_table

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
