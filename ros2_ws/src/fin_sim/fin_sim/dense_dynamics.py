"""The equations of `dynamics` where every link's water moves every other's: with a matrix of added mass, not a sum.

The water's kinetic energy is 1/2 q.A q with the motions q of body and links across themselves and a constant matrix A.
Each q is the velocity of one rigid body in its own axes, so Lagrange's equations are Kirchhoff's for each (Lamb,
*Hydrodynamics*, 1932, article 124): with the momentum P = A q, d P/dt in the tank's axes and, about the joint, V x P.
The joints couple them: M = J^T (A + solid) J, solved densely. Only the coupling of surge to the links changes with the
bending: it adds its rate to d P/dt and its slope in the joints' angles to their torques.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_sim.chain import (
    BACK_EMF,
    LENGTH,
    PRESCRIBED,
    ROTOR,
    SOLID_0,
    SOLID_1,
    SOLID_2,
    STALL_TORQUE,
    TIP_VIRTUAL,
)
from fin_sim.compiled import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.swim_result import Swim

    Array = NDArray[np.float64]


@kernel
def dense_kinematics(state: Array, links: Array, offset: float) -> tuple[Array, Array, Array, Array]:
    """Return the motions of body and links, what the coordinates' rates do to them, and what stays without.

    Args:
        state: As for `dynamics.evaluate`.
        links: As there.
        offset: From the centre of mass back to the first joint, m.

    Returns:
        Motions in their own axes, forward, left, turning: body, then links, shape (3 + 3 N,). Their Jacobian, shape
        (3 + 3 N, 3 + N). Their rates while no coordinate accelerates, shape (3 + 3 N,). Sine and cosine of each link's
        angle to the body, and its joint's place in the body's axes, m, shape (N, 4).
    """
    count = links.shape[0]
    jacobian, bias = np.zeros((3 + 3 * count, 3 + count)), np.zeros(3 + 3 * count)
    motions, poses = np.zeros(3 + 3 * count), np.zeros((count, 4))
    u, v, r = state[3], state[4], state[5]
    motions[0], motions[1], motions[2] = u, v, r
    for i in range(3):
        jacobian[i, i] = 1.0
    angle, turn, vx, vy, px, py = 0.0, r, u, v - offset * r, -offset, 0.0
    ax, ay = -v * r + offset * r * r, u * r
    for k in range(count):
        angle += state[6 + k]
        turn += state[6 + count + k]
        sine, cosine = np.sin(angle), np.cos(angle)
        poses[k, 0], poses[k, 1], poses[k, 2], poses[k, 3] = sine, cosine, px, py
        at = 3 + 3 * k
        along, normal = vx * cosine + vy * sine, -vx * sine + vy * cosine
        motions[at], motions[at + 1], motions[at + 2] = along, normal, turn
        bias[at] = ax * cosine + ay * sine + turn * normal
        bias[at + 1] = -ax * sine + ay * cosine - turn * along
        jacobian[at, 0], jacobian[at, 1] = cosine, sine
        jacobian[at + 1, 0], jacobian[at + 1, 1] = -sine, cosine
        jacobian[at, 2], jacobian[at + 1, 2], jacobian[at + 2, 2] = (
            px * sine - py * cosine,
            py * sine + px * cosine,
            1.0,
        )
        for j in range(k + 1):
            dx, dy = px - poses[j, 2], py - poses[j, 3]
            jacobian[at, 3 + j] = dx * sine - dy * cosine
            jacobian[at + 1, 3 + j] = dy * sine + dx * cosine
            jacobian[at + 2, 3 + j] = 1.0
        length = links[k, LENGTH]
        vx, vy = vx + length * turn * sine, vy - length * turn * cosine
        px, py = px - length * cosine, py - length * sine
        ax, ay = ax + length * turn * turn * cosine, ay + length * turn * turn * sine
    return motions, jacobian, bias, poses


@kernel
def place(coordinate: int) -> int:
    """Return which motion a coordinate of the matrix is: the body's three, then two of each link's three."""
    return coordinate if coordinate < 3 else 3 + 3 * ((coordinate - 3) // 2) + 1 + (coordinate - 3) % 2  # noqa: PLR2004


@kernel
def bent_matrix(added: Array, motions: Array, rates: Array, poses: Array) -> tuple[Array, Array, Array]:
    """Return the matrix of a bent tail, what its change adds to the momenta's rates, and to the joints' torques.

    Args:
        added: Shape (3 + 4 N, 3 + 2 N), see `surface_3d.added_mass.link_matrix`.
        motions: From `dense_kinematics`.
        rates: Of the joints, rad/s, shape (N,).
        poses: From `dense_kinematics`.

    Returns:
        Shapes (3 + 2 N, 3 + 2 N), (3 + 3 N,) and (N,).
    """
    count, size = poses.shape[0], added.shape[1]
    matrix, change, torques = added[:size].copy(), np.zeros(3 + 3 * count), np.zeros(count)
    for k in range(count):
        for part in range(2):
            row = size + 2 * k + part
            bend, speed, carried = poses[k, 0] if part == 0 else -poses[k, 3], 0.0, 0.0
            for i in range(1, size):
                carried += added[row, i] * motions[place(i)]
            for j in range(k + 1):
                slope = poses[k, 1] if part == 0 else poses[j, 2] - poses[k, 2]
                speed += slope * rates[j]
                torques[j] += motions[0] * slope * carried
            change[0] += speed * carried
            for i in range(1, size):
                matrix[0, i] += bend * added[row, i]
                matrix[i, 0] += bend * added[row, i]
                change[place(i)] += speed * added[row, i] * motions[0]
    return matrix, change, torques


@kernel
def add_inertia(links: Array, body: Array, added: Array, columns: Array, water: Array, whole: Array) -> None:
    """Write what the inertia makes of columns of motions: momenta of the links' water, and of all.

    Args:
        links: As for `dynamics.evaluate`.
        body: As there.
        added: Shape (3 + 2 N, 3 + 2 N), from `bent_matrix`.
        columns: Shape (3 + 3 N, C).
        water: Written, without the body's own added mass, shape (3 + 3 N, C).
        whole: Written, shape (3 + 3 N, C).
    """
    count, width = links.shape[0], columns.shape[1]
    water[:] = 0.0
    for i in range(added.shape[0]):
        row = place(i)
        for j in range(added.shape[0]):
            column = place(j)
            for c in range(width):
                water[row, c] += added[i, j] * columns[column, c]
    for c in range(width):
        for i in range(3):
            whole[i, c] = water[i, c] + body[i] * columns[i, c]
        for k in range(count):
            at = 3 + 3 * k
            mass, first, second = links[k, SOLID_0], links[k, SOLID_1], links[k, SOLID_2]
            normal, turn = columns[at + 1, c], columns[at + 2, c]
            whole[at, c] = water[at, c] + mass * columns[at, c]
            whole[at + 1, c] = water[at + 1, c] + mass * normal - first * turn
            whole[at + 2, c] = water[at + 2, c] - first * normal + second * turn


@kernel
def solve_positive(matrix: Array, right: Array) -> None:
    """Solve a symmetric, positive system by Cholesky's method; overwrites both, the right side with the solution."""
    size = matrix.shape[0]
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]
    for i in range(size):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@kernel
def evaluate_dense(
    kinematics: tuple[Array, Array, Array, Array],
    state: Array,
    drive: Array,
    links: Array,
    body: Array,
    added: Array,
    free: bool,
    distributed: bool,
    forces: Array,
    torques: Array,
    derivative: Array,
    record: Array,
) -> None:
    """Write the state's time derivative and the record of forces, as `dynamics.evaluate` does.

    Args:
        kinematics: What `dense_kinematics` returns for the state.
        state: As there, with prescribed joints as driven.
        drive: As there.
        links: As there; the virtual moments are not read.
        body: As there.
        added: Shape (3 + 4 N, 3 + 2 N): the water's added mass but for the body's own.
        free: As there.
        distributed: As there.
        forces: Resistive force across each link and its moment about the joint, shape (N, 2).
        torques: Of the joints that are not prescribed, N m, shape (N,).
        derivative: Written.
        record: Written.
    """
    count = links.shape[0]
    size, rows = 3 + count, 3 + 3 * count
    motions, jacobian, bias, poses = kinematics
    u, v, r = motions[0], motions[1], motions[2]
    # Columns: the coordinates, the rates that stay, and the motion itself.
    columns = np.zeros((rows, size + 2))
    columns[:, :size], columns[:, size], columns[:, size + 1] = jacobian, bias, motions
    water, whole = np.zeros((rows, size + 2)), np.zeros((rows, size + 2))
    matrix, change, bending = bent_matrix(added, motions, state[6 + count : 6 + 2 * count], poses)
    add_inertia(links, body, matrix, columns, water, whole)
    water[:, size] += change
    whole[:, size] += change

    # What each body asks for while no coordinate accelerates, less the forces on it, in its own axes.
    asked, reaction = np.zeros(rows), np.zeros(rows)
    last = size + 1
    asked[0] = whole[0, size] - r * whole[1, last]
    asked[1] = whole[1, size] + r * whole[0, last]
    asked[2] = whole[2, size] + u * whole[1, last] - v * whole[0, last]
    if free:
        speed = np.sqrt(u * u + v * v)
        slip = np.arctan2(v, u) if speed > 0.0 else 0.0
        side, resist = body[5] * slip * speed, body[8] + body[4] * speed
        asked[0] += resist * u - side * v
        asked[1] += resist * v + side * u
        asked[2] += body[6] * r * abs(r)
    convective_x, convective_y = 0.0, 0.0
    for k in range(count):
        at = 3 + 3 * k
        along, normal, turn = motions[at], motions[at + 1], motions[at + 2]
        force_e, force_n, moment = 0.0, forces[k, 0], forces[k, 1]
        if k == count - 1:
            end = normal - links[k, LENGTH] * turn
            shed = -links[k, TIP_VIRTUAL] * end * along
            force_n += shed
            force_e += 0.5 * links[k, TIP_VIRTUAL] * end * end
            moment -= links[k, LENGTH] * shed
        convective_x += force_e * poses[k, 1] - force_n * poses[k, 0]
        convective_y += force_e * poses[k, 0] + force_n * poses[k, 1]
        munk = along * whole[at + 1, last] - normal * whole[at, last]
        if not distributed:  # the papers' form leaves the water's moment out
            munk -= along * water[at + 1, last]
        asked[at] = whole[at, size] - turn * whole[at + 1, last] - force_e
        asked[at + 1] = whole[at + 1, size] + turn * whole[at, last] - force_n
        asked[at + 2] = whole[at + 2, size] + munk - moment
        reaction[at] = turn * water[at + 1, last]

    mass, push = np.zeros((size, size)), np.zeros(size)
    for i in range(size):
        for row in range(rows):
            push[i] -= jacobian[row, i] * asked[row]
            for j in range(i + 1):
                mass[i, j] += jacobian[row, i] * whole[row, j]
        for j in range(i):
            mass[j, i] = mass[i, j]

    rates, moving = np.zeros(size), np.zeros(size, dtype=np.int64)
    unknown = 0
    for i in range(size):
        if i < 3:  # noqa: PLR2004
            known = not free
        else:
            known = links[i - 3, PRESCRIBED] > 0.0
            push[i] += bending[i - 3]
            rates[i] = drive[i - 3, 2] if known else 0.0
            if not known:
                push[i] += torques[i - 3]
                mass[i, i] += links[i - 3, ROTOR]
        if not known:
            moving[unknown] = i
            unknown += 1
    system, right = np.zeros((unknown, unknown)), np.zeros(unknown)
    for i in range(unknown):
        right[i] = push[moving[i]]
        for j in range(size):
            right[i] -= mass[moving[i], j] * rates[j]
        for j in range(unknown):
            system[i, j] = mass[moving[i], moving[j]]
    solve_positive(system, right)
    for i in range(unknown):
        rates[moving[i]] = right[i]

    heading_sine, heading_cosine = np.sin(state[2]), np.cos(state[2])
    derivative[0] = u * heading_cosine - v * heading_sine + body[9]
    derivative[1] = u * heading_sine + v * heading_cosine + body[10]
    derivative[2] = r
    derivative[3], derivative[4], derivative[5] = rates[0], rates[1], rates[2]
    power, electrical_power = 0.0, 0.0
    force_x, force_y = convective_x, convective_y
    for k in range(count):
        row, rate, relative = 3 + k, state[6 + count + k], rates[3 + k]
        if links[k, PRESCRIBED] > 0.0:
            torque = -push[row]
            for j in range(size):
                torque += mass[row, j] * rates[j]
            power += torque * rate
        else:
            torque = torques[k]
            if links[k, STALL_TORQUE] > 0.0:
                electrical_power += torque * (rate + torque / links[k, BACK_EMF])
                torque -= links[k, ROTOR] * relative
                power += torque * rate
        derivative[6 + k], derivative[6 + count + k] = rate, relative
        record[6 + k] = torque
        at = 3 + 3 * k
        across = -water[at + 1, size]
        for j in range(size):
            across -= water[at + 1, j] * rates[j]
        force_x += reaction[at] * poses[k, 1] - across * poses[k, 0]
        force_y += reaction[at] * poses[k, 0] + across * poses[k, 1]
    record[0] = force_x * heading_cosine - force_y * heading_sine
    record[1] = force_x * heading_sine + force_y * heading_cosine
    record[2] = convective_x * heading_cosine - convective_y * heading_sine
    record[3] = convective_x * heading_sine + convective_y * heading_cosine
    record[4], record[5] = power, electrical_power


def water_of_matrix(swim: Swim) -> tuple[Array, Array]:
    """Return what the water of a matrix stores over a swim's samples, without the body's own added mass.

    Args:
        swim: Of a chain whose `Chain.added_mass` has a matrix.

    Returns:
        Kinetic energy in J, shape (S,), and angular momentum about the swim's start in the frame that moves with the
        water, kg m^2/s, shape (S,).

    Raises:
        ValueError: The swim's water has no matrix of added mass.
    """
    chain, links = swim.chain, swim.chain.link_table()
    added, size = chain.added_mass(), 3 + 2 * len(links)
    if added is None:
        msg = "the swim's water has no matrix of added mass: energy.py tells what it stores"
        raise ValueError(msg)
    own = [place(i) for i in range(size)]
    x, y = swim.x - chain.water.current_x * swim.time, swim.y - chain.water.current_y * swim.time
    columns = (x, y, swim.heading, swim.water_surge, swim.water_sway, swim.yaw_rate)
    states = np.column_stack((*columns, swim.joint_angles, swim.joint_rates))
    energy, moment = np.zeros(len(states)), np.zeros(len(states))
    for index, state in enumerate(states):
        motions, _, _, poses = dense_kinematics(state, links, chain.body.tail_offset)
        matrix = bent_matrix(added, motions, state[6 + len(links) :], poses)[0]
        momenta = matrix @ motions[own]
        energy[index] = 0.5 * motions[own] @ momenta
        sine, cosine = np.sin(state[2]), np.cos(state[2])
        push = np.array([cosine * momenta[0] - sine * momenta[1], sine * momenta[0] + cosine * momenta[1]])
        moment[index] = state[0] * push[1] - state[1] * push[0] + momenta[2]
        for (link_sine, link_cosine, at_x, at_y), across, turning in zip(
            poses, momenta[3::2], momenta[4::2], strict=True
        ):
            left = (-link_sine * cosine - link_cosine * sine, link_cosine * cosine - link_sine * sine)
            joint = (state[0] + at_x * cosine - at_y * sine, state[1] + at_x * sine + at_y * cosine)
            moment[index] += across * (joint[0] * left[1] - joint[1] * left[0]) + turning
    return energy, moment
