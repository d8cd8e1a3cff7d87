"""Equations of motion of body and tail, and their integration.

Planar motion of a rigid body (Kirchhoff's equations with drag and lift) with a chain of rigid links that Lighthill's
reactive force and a resistive force act on. Accelerations follow from the articulated-body recursion (Featherstone,
*Rigid Body Dynamics Algorithms*, 2008, chapter 7) in body axes, in time proportional to the number of links.

State, shape (6 + 2 N,): x, y, heading in the tank; forward, sideways velocity through the water and yaw rate in body
axes; N joint angles; N joint rates. A driven joint's angle, rate and acceleration are prescribed, or its motor follows
them (`motor`). In a steady uniform
current the frame that moves with the water is inertial: there the equations are those of still water.

Time stepping: the classical Runge-Kutta method of order 4, in the exponential form of Cox & Matthews (Journal of
Computational Physics 176, 2002, eq. 26 to 29) for the springs and dampers of the hinges, whose effect on the straight
chain is linear and is integrated exactly. Without springs it is the classical method, with them the step is not bound
by the stiffest hinge.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from fin_plant import checks
from fin_sim.chain import (
    BACK_EMF,
    DAMPING,
    FIRST_PIECE,
    GAIN,
    LENGTH,
    PIECE_COLUMNS,
    PIECE_END,
    PIECE_HEIGHT,
    PIECE_SLOPE,
    PRESCRIBED,
    RATE_GAIN,
    RESISTIVE,
    ROTOR,
    SOLID_0,
    SOLID_1,
    SOLID_2,
    STALL_TORQUE,
    STIFFNESS,
    TIP_VIRTUAL,
    VIRTUAL_0,
    VIRTUAL_1,
    VIRTUAL_2,
    Chain,
)
from fin_sim.compiled import kernel
from fin_sim.dense_dynamics import dense_kinematics, evaluate_dense

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

BODY_STATES = 6
X, Y, HEADING, SURGE, SWAY, YAW_RATE = range(BODY_STATES)
# What the kernel notes down beside a state: force of the water on the tail in tank axes, its convective and resistive
# part alone, mechanical power of the servos at their shafts, electrical power of those with a motor; then the torque
# of each joint, of a motor's what its rotor leaves for the shaft.
FORCE_X, FORCE_Y, CONVECTIVE_X, CONVECTIVE_Y, SERVO_POWER, ELECTRICAL_POWER, RECORD_HEAD = range(7)
# Scratch of one link: sine and cosine of its angle, velocity of its joint, yaw rate; coupling of its articulated
# inertia between force and turning (2), articulated moment of inertia, bias moment, torque of a joint that is free.
SCRATCH_COLUMNS = 10


@kernel
def _resistive_integrals(w: float, turn: float, length: float, height: float, slope: float) -> tuple[float, float]:
    """Return the integrals over a piece of d v |v| and s d v |v| with v = w - s turn and d = height + slope s."""
    c0 = height * w * w
    c1 = slope * w * w - 2.0 * height * w * turn
    c2 = height * turn * turn - 2.0 * slope * w * turn
    c3 = slope * turn * turn
    s = length
    force = s * (c0 + s * (c1 / 2.0 + s * (c2 / 3.0 + s * c3 / 4.0)))
    moment = s * s * (c0 / 2.0 + s * (c1 / 3.0 + s * (c2 / 4.0 + s * c3 / 5.0)))
    w_end = w - length * turn
    if w * w_end >= 0.0:
        sign = 1.0 if w + w_end >= 0.0 else -1.0
        return sign * force, sign * moment
    s = w / turn
    force_front = s * (c0 + s * (c1 / 2.0 + s * (c2 / 3.0 + s * c3 / 4.0)))
    moment_front = s * s * (c0 / 2.0 + s * (c1 / 3.0 + s * (c2 / 4.0 + s * c3 / 5.0)))
    sign = 1.0 if w > 0.0 else -1.0
    return sign * (2.0 * force_front - force), sign * (2.0 * moment_front - moment)


@kernel
def _resistive_wrench(w: float, turn: float, link: Array) -> tuple[float, float]:
    """Return the integrals over a link, of as many pieces as its row has, of d v |v| and s d v |v|, v = w - s turn."""
    force, moment, start = 0.0, 0.0, 0.0
    for piece in range(FIRST_PIECE, link.shape[0], PIECE_COLUMNS):
        end = link[piece + PIECE_END]
        if end <= start:
            break
        part, part_moment = _resistive_integrals(
            w - start * turn, turn, end - start, link[piece + PIECE_HEIGHT], link[piece + PIECE_SLOPE]
        )
        force += part
        moment += part_moment + start * part
        start = end
    return force, moment


@kernel
def _joint_torque(angle: float, rate: float, drive: Array, link: Array) -> float:
    """Return the torque in N m of a joint that is not prescribed: its motor's, or its spring's and damper's."""
    torque: float = -link[STIFFNESS] * angle - (link[DAMPING] + link[BACK_EMF]) * rate
    if link[STALL_TORQUE] > 0.0:
        duty = link[GAIN] * (drive[0] - angle) + link[RATE_GAIN] * (drive[1] - rate)
        torque += link[STALL_TORQUE] * min(max(duty, -1.0), 1.0)
    return torque


@kernel
def evaluate(
    state: Array,
    drive: Array,
    links: Array,
    body: Array,
    free: bool,
    distributed: bool,
    derivative: Array,
    record: Array,
    scratch: Array,
) -> None:
    """Write the state's time derivative and the record of forces.

    Args:
        state: Shape (6 + 2 N,). Angles and rates of prescribed joints are set to ``drive``'s.
        drive: Shape (N, 3), angle, rate and acceleration of the driven joints; other rows are not read. A motor's
            joint follows angle and rate.
        links: Shape (N, columns), `Chain.link_table`.
        body: Shape (11,), `Chain.body_vector`.
        free: Whether the body moves under its forces; otherwise its velocity stays as it is.
        distributed: Whether the convective force acts where it arises, or at the tip.
        derivative: Written, shape (6 + 2 N,).
        record: Written, shape (``RECORD_HEAD`` + N,).
        scratch: Overwritten, shape (N, ``SCRATCH_COLUMNS``).
    """
    count = links.shape[0]
    mass_surge, mass_sway, inertia, munk = body[0], body[1], body[2], body[3]
    drag, lift, yaw_drag, offset = body[4], body[5], body[6], body[7]
    linear_drag, current_x, current_y = body[8], body[9], body[10]
    u, v, r = state[SURGE], state[SWAY], state[YAW_RATE]

    # Outward: positions and velocities of the links, in body axes.
    angle, turn, vx, vy = 0.0, r, u, v - offset * r
    for k in range(count):
        if links[k, PRESCRIBED] > 0.0:
            state[BODY_STATES + k] = drive[k, 0]
            state[BODY_STATES + count + k] = drive[k, 1]
        angle += state[BODY_STATES + k]
        turn += state[BODY_STATES + count + k]
        sine, cosine = np.sin(angle), np.cos(angle)
        scratch[k, 0], scratch[k, 1], scratch[k, 2], scratch[k, 3], scratch[k, 4] = sine, cosine, vx, vy, turn
        vx += links[k, LENGTH] * turn * sine
        vy -= links[k, LENGTH] * turn * cosine

    # Inward: each link's inertia with all behind it, and the wrench it asks of its joint when nothing accelerates.
    ixx, ixy, iyy, hx, hy, it = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    px, py, pt = 0.0, 0.0, 0.0
    total_cx, total_cy = 0.0, 0.0
    for k in range(count - 1, -1, -1):
        sine, cosine, turn = scratch[k, 0], scratch[k, 1], scratch[k, 4]
        length, m0, m1, m2 = links[k, LENGTH], links[k, VIRTUAL_0], links[k, VIRTUAL_1], links[k, VIRTUAL_2]
        w = -scratch[k, 2] * sine + scratch[k, 3] * cosine
        along = scratch[k, 2] * cosine + scratch[k, 3] * sine
        # Wrench of the links behind, carried from the link's end to its joint.
        gx, gy = length * sine, -length * cosine
        ax, ay = length * turn * turn * cosine, length * turn * turn * sine
        px, py, pt = px + ixx * ax + ixy * ay, py + ixy * ax + iyy * ay, pt + hx * ax + hy * ay
        pt += gx * px + gy * py
        sx, sy = ixx * gx + ixy * gy + hx, ixy * gx + iyy * gy + hy
        it += gx * sx + gy * sy + hx * gx + hy * gy
        hx, hy = sx, sy
        # The link's own inertia: solid mass in every direction, virtual mass along its normal only.
        normal_mass, normal_first = m0 + links[k, SOLID_0], m1 + links[k, SOLID_1]
        solid = links[k, SOLID_0]
        ixx += normal_mass * sine * sine + solid * cosine * cosine
        ixy += (solid - normal_mass) * sine * cosine
        iyy += normal_mass * cosine * cosine + solid * sine * sine
        hx += normal_first * sine
        hy -= normal_first * cosine
        it += m2 + links[k, SOLID_2]
        # Forces normal to the link and along it: convective and resistive.
        resist, resist_moment = _resistive_wrench(w, turn, links[k])
        cn = links[k, RESISTIVE] * resist
        ct = -links[k, RESISTIVE] * resist_moment
        ce = 0.0
        if distributed or k == count - 1:
            w_end = w - length * turn
            tip_n = -links[k, TIP_VIRTUAL] * w_end * along
            cn += tip_n
            ce += 0.5 * links[k, TIP_VIRTUAL] * w_end * w_end
            ct -= length * tip_n
        cx, cy = -cn * sine + ce * cosine, cn * cosine + ce * sine
        if distributed:
            ct -= along * (m0 * w - m1 * turn)
            if k > 0:  # what leaves the link in front at its end arrives here
                sine_f, cosine_f = scratch[k - 1, 0], scratch[k - 1, 1]
                w_f = -scratch[k, 2] * sine_f + scratch[k, 3] * cosine_f
                along_f = scratch[k, 2] * cosine_f + scratch[k, 3] * sine_f
                tip_n = -links[k - 1, TIP_VIRTUAL] * w_f * along_f
                tip_e = 0.5 * links[k - 1, TIP_VIRTUAL] * w_f * w_f
                cx -= -tip_n * sine_f + tip_e * cosine_f
                cy -= tip_n * cosine_f + tip_e * sine_f
        total_cx += cx
        total_cy += cy
        # Centripetal and reactive terms that stay when nothing accelerates.
        bn = -m0 * turn * along
        be = links[k, SOLID_1] * turn * turn - turn * (m0 * w - m1 * turn)
        px += -bn * sine + be * cosine - cx
        py += bn * cosine + be * sine - cy
        pt += m1 * turn * along - ct
        # Through the joint to the link in front.
        scratch[k, 5], scratch[k, 6], scratch[k, 7] = hx, hy, it
        if links[k, PRESCRIBED] > 0.0:
            bend = drive[k, 2]
            scratch[k, 8] = pt
            px, py, pt = px + hx * bend, py + hy * bend, pt + it * bend
        else:
            torque = _joint_torque(state[BODY_STATES + k], state[BODY_STATES + count + k], drive[k], links[k])
            rotor = links[k, ROTOR]
            inverse = 1.0 / (it + rotor)
            share = rotor * inverse  # of what the link in front does that the rotor takes over
            scratch[k, 8], scratch[k, 9] = pt, torque
            push = (torque - pt) * inverse
            px, py, pt = px + hx * push, py + hy * push, torque - rotor * push
            ixx, ixy, iyy = ixx - hx * hx * inverse, ixy - hx * hy * inverse, iyy - hy * hy * inverse
            hx, hy, it = share * hx, share * hy, share * it

    # The body.
    kx, ky = -v * r + offset * r * r, u * r
    px, py, pt = px + ixx * kx + ixy * ky, py + ixy * kx + iyy * ky, pt + hx * kx + hy * ky
    pt -= offset * py
    du, dv, dr = 0.0, 0.0, 0.0
    if free:
        speed = np.sqrt(u * u + v * v)
        slip = np.arctan2(v, u) if speed > 0.0 else 0.0
        side = lift * slip * speed
        resist = linear_drag + drag * speed
        fx = mass_sway * v * r - resist * u + side * v - px
        fy = -mass_surge * u * r - resist * v - side * u - py
        ft = munk * u * v - yaw_drag * r * abs(r) - pt
        sx, sy = hx - offset * ixy, hy - offset * iyy
        att = it + inertia - offset * (sy + hy)
        axx, ayy = ixx + mass_surge, iyy + mass_sway
        # Symmetric 3 x 3 system by elimination.
        f1 = ixy / axx
        byy, byt, by = ayy - f1 * ixy, sy - f1 * sx, fy - f1 * fx
        f2 = sx / axx
        btt, bt = att - f2 * sx, ft - f2 * fx
        f3 = byt / byy
        dr = (bt - f3 * by) / (btt - f3 * byt)
        dv = (by - byt * dr) / byy
        du = (fx - ixy * dv - sx * dr) / axx
    heading_sine, heading_cosine = np.sin(state[HEADING]), np.cos(state[HEADING])
    derivative[X] = u * heading_cosine - v * heading_sine + current_x
    derivative[Y] = u * heading_sine + v * heading_cosine + current_y
    derivative[HEADING] = r
    derivative[SURGE], derivative[SWAY], derivative[YAW_RATE] = du, dv, dr

    # Outward: accelerations of the joints, torques, and the reaction of the water.
    ax, ay, bend = du + kx, dv + ky - offset * dr, dr
    force_x, force_y, power, electrical_power = total_cx, total_cy, 0.0, 0.0
    for k in range(count):
        sine, cosine, turn = scratch[k, 0], scratch[k, 1], scratch[k, 4]
        hx, hy, it, pt = scratch[k, 5], scratch[k, 6], scratch[k, 7], scratch[k, 8]
        rate = state[BODY_STATES + count + k]
        if links[k, PRESCRIBED] > 0.0:
            relative = drive[k, 2]
            torque = hx * ax + hy * ay + it * (bend + relative) + pt
            power += torque * rate
        else:
            torque, rotor = scratch[k, 9], links[k, ROTOR]
            relative = (torque - pt - hx * ax - hy * ay - it * bend) / (it + rotor)
            if links[k, STALL_TORQUE] > 0.0:
                electrical_power += torque * (rate + torque / links[k, BACK_EMF])
                torque -= rotor * relative
                power += torque * rate
        bend += relative
        derivative[BODY_STATES + k] = rate
        derivative[BODY_STATES + count + k] = relative
        record[RECORD_HEAD + k] = torque
        length, m0, m1 = links[k, LENGTH], links[k, VIRTUAL_0], links[k, VIRTUAL_1]
        w = -scratch[k, 2] * sine + scratch[k, 3] * cosine
        along = scratch[k, 2] * cosine + scratch[k, 3] * sine
        reaction_n = -m0 * (-ax * sine + ay * cosine - turn * along) + m1 * bend
        reaction_e = turn * (m0 * w - m1 * turn)
        force_x += -reaction_n * sine + reaction_e * cosine
        force_y += reaction_n * cosine + reaction_e * sine
        ax += length * (bend * sine + turn * turn * cosine)
        ay += length * (-bend * cosine + turn * turn * sine)
    record[FORCE_X] = force_x * heading_cosine - force_y * heading_sine
    record[FORCE_Y] = force_x * heading_sine + force_y * heading_cosine
    record[CONVECTIVE_X] = total_cx * heading_cosine - total_cy * heading_sine
    record[CONVECTIVE_Y] = total_cx * heading_sine + total_cy * heading_cosine
    record[SERVO_POWER], record[ELECTRICAL_POWER] = power, electrical_power


@kernel
def _evaluate_with(
    state: Array,
    drive: Array,
    links: Array,
    body: Array,
    added: Array | None,
    free: bool,
    distributed: bool,
    derivative: Array,
    record: Array,
    scratch: Array,
) -> None:
    """Do as `evaluate`, with a matrix of added mass in the place of the links' virtual moments if there is one.

    ``added`` is None, or has the shape (3 + 4 N, 3 + 2 N); see `Chain.added_mass`. What is compiled for None knows
    nothing of matrices, which take longer to compile than all the rest.
    """
    if added is None:
        evaluate(state, drive, links, body, free, distributed, derivative, record, scratch)
        return
    count = links.shape[0]
    forces, torques = np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        if links[k, PRESCRIBED] > 0.0:
            state[BODY_STATES + k] = drive[k, 0]
            state[BODY_STATES + count + k] = drive[k, 1]
        torques[k] = _joint_torque(state[BODY_STATES + k], state[BODY_STATES + count + k], drive[k], links[k])
    kinematics = dense_kinematics(state, links, body[7])
    for k in range(count):
        resist, resist_moment = _resistive_wrench(kinematics[0][4 + 3 * k], kinematics[0][5 + 3 * k], links[k])
        forces[k, 0], forces[k, 1] = links[k, RESISTIVE] * resist, -links[k, RESISTIVE] * resist_moment
    evaluate_dense(kinematics, state, drive, links, body, added, free, distributed, forces, torques, derivative, record)


def propagator(chain: Chain, step: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which states the hinges' springs and dampers move, and how over one step.

    Args:
        chain: The chain.
        step: Time step in s.

    Returns:
        Positions in the state, shape (S,), and matrices, shape (7, S, S): the linear part L, exp(L step / 2),
        exp(L step), and the weights of Cox & Matthews (2002), eq. 26 to 29: of the half steps, of the first, the two
        middle and the last stage.
    """
    response, rows = chain.elastic_response()
    passive = [index for index, is_driven in enumerate(chain.driven) if not is_driven]
    count, size = len(passive), 2 * len(passive) + len(rows) - len(passive)
    if not passive:
        return np.zeros(0, dtype=np.int64), np.zeros((7, 0, 0))
    links = len(chain.links)
    angles = [BODY_STATES + index for index in passive]
    rates = [BODY_STATES + links + index for index in passive]
    accelerated = [SURGE + row if row < YAW_RATE - SURGE + 1 else BODY_STATES + links + row - 3 for row in rows]
    states = angles + rates + [state for state in accelerated if state not in rates]
    linear = np.zeros((size, size))
    linear[:count, count : 2 * count] = np.eye(count)
    for row, state in zip(response, accelerated, strict=True):
        linear[states.index(state), : 2 * count] = row
    return np.array(states, dtype=np.int64), exponential_matrices(linear, step)


def exponential_matrices(linear: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the matrices that move a linear part over one step, see `propagator`, shape (7, S, S)."""
    half, half_1, _, _ = exponential_functions(0.5 * step * linear)
    exponential, phi_1, phi_2, phi_3 = exponential_functions(step * linear)
    return np.stack(
        (
            linear,
            half,
            exponential,
            0.5 * step * half_1,
            step * (phi_1 - 3.0 * phi_2 + 4.0 * phi_3),
            step * (2.0 * phi_2 - 4.0 * phi_3),
            step * (4.0 * phi_3 - phi_2),
        )
    )


def exponential_functions(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return exp(A), phi_1(A), phi_2(A) and phi_3(A) with phi_(j+1)(A) = (phi_j(A) - 1/j!) / A, A of shape (S, S).

    The exponential of one block matrix holds them all (Al-Mohy & Higham, SIAM J. Sci. Comput. 33, 2011, theorem 2.1).
    """
    size = len(matrix)
    block = np.zeros((4 * size, 4 * size))
    block[:size, :size] = matrix
    for part in range(3):
        block[part * size : (part + 1) * size, (part + 1) * size : (part + 2) * size] = np.eye(size)
    result = scipy.linalg.expm(block)
    return tuple(result[:size, part * size : (part + 1) * size] for part in range(4))


@kernel
def _add_product(matrix: Array, vector: Array, result: Array) -> None:
    """Add matrix @ vector to result; shapes (S, S), (S,), (S,)."""
    for row in range(result.shape[0]):
        total = 0.0
        for column in range(result.shape[0]):
            total += matrix[row, column] * vector[column]
        result[row] += total


@kernel
def integrate(
    state: Array,
    motion: Array,
    links: Array,
    body: Array,
    added: Array | None,
    free: bool,
    distributed: bool,
    step: float,
    every: int,
    stiff: NDArray[np.int64],
    matrices: Array,
    samples: Array,
    records: Array,
) -> int:
    """Advance a chain through time and keep every so many states.

    Args:
        state: Shape (n,) with n = 6 + 2 N, the first state; overwritten with the last.
        motion: Shape (2 steps + 1, N, 3): the driven joints' angle, rate and acceleration at every half step.
        links: As for `evaluate`.
        body: As for `evaluate`.
        added: `Chain.added_mass`.
        free: As for `evaluate`.
        distributed: As for `evaluate`.
        step: Time step in s.
        every: Steps between two samples; divides the number of steps.
        stiff: Shape (S,), and
        matrices: shape (7, S, S), from `propagator`.
        samples: Written, shape (steps / every + 1, n).
        records: Written, shape (steps / every + 1, ``RECORD_HEAD`` + N); see `evaluate`.

    Returns:
        The number of samples whose states are finite; less than all where the integration broke off.
    """
    size, count, stiff_count = state.shape[0], links.shape[0], stiff.shape[0]
    steps = (motion.shape[0] - 1) // 2
    scratch = np.zeros((count, SCRATCH_COLUMNS))
    slope = np.zeros((4, size))
    rest = np.zeros((4, stiff_count))  # of each stage: derivative less the linear part
    stage, record = np.zeros(size), np.zeros(records.shape[1])
    begin, middle, part = np.zeros(stiff_count), np.zeros(stiff_count), np.zeros(stiff_count)
    linear, propagate_half, propagate = matrices[0], matrices[1], matrices[2]
    weight_half, weight_first, weight_middle, weight_last = matrices[3], matrices[4], matrices[5], matrices[6]
    for index in range(steps + 1):
        at = 2 * index
        _evaluate_with(state, motion[at], links, body, added, free, distributed, slope[0], record, scratch)
        if index % every == 0:
            row = index // every
            samples[row] = state
            records[row] = record
            finite = True
            for i in range(size):
                finite = finite and np.isfinite(state[i]) and np.isfinite(slope[0, i])
            if not finite:
                return row
        if index == steps:
            break
        for i in range(stiff_count):
            begin[i] = state[stiff[i]]
        for number in range(4):
            if number > 0:
                drive = motion[at + (number + 1) // 2]
                _evaluate_with(stage, drive, links, body, added, free, distributed, slope[number], record, scratch)
            for i in range(stiff_count):
                part[i] = state[stiff[i]] if number == 0 else stage[stiff[i]]
                rest[number, i] = 0.0
            _add_product(linear, part, rest[number])
            for i in range(stiff_count):
                rest[number, i] = slope[number, stiff[i]] - rest[number, i]
            if number == 3:  # noqa: PLR2004  (the last of four stages)
                break
            reach = step if number == 2 else 0.5 * step  # noqa: PLR2004
            for i in range(size):
                stage[i] = state[i] + reach * slope[number, i]
            part[:] = 0.0
            if number == 0:
                _add_product(propagate_half, begin, part)
                _add_product(weight_half, rest[0], part)
                middle[:] = part
            elif number == 1:
                _add_product(propagate_half, begin, part)
                _add_product(weight_half, rest[1], part)
            else:
                _add_product(propagate_half, middle, part)
                for i in range(stiff_count):
                    begin[i] = 2.0 * rest[2, i] - rest[0, i]
                _add_product(weight_half, begin, part)
            for i in range(stiff_count):
                stage[stiff[i]] = part[i]
        for i in range(stiff_count):
            begin[i] = state[stiff[i]]
        part[:] = 0.0
        _add_product(propagate, begin, part)
        _add_product(weight_first, rest[0], part)
        for i in range(stiff_count):
            middle[i] = rest[1, i] + rest[2, i]
        _add_product(weight_middle, middle, part)
        _add_product(weight_last, rest[3], part)
        for i in range(size):
            state[i] += step / 6.0 * (slope[0, i] + 2.0 * (slope[1, i] + slope[2, i]) + slope[3, i])
        for i in range(stiff_count):
            state[stiff[i]] = part[i]
    return int(steps // every + 1)


class StepError(ArithmeticError):
    """A swim whose state stopped being finite: says when, and what may help."""

    def __init__(self, time: float) -> None:
        """Note the time in s since the sample that `Stepper.advance` started from."""
        super().__init__(
            f"the state stopped being finite after {time:.3f} s: "
            "the step is too long for this fin and gait; use a shorter step or a slower gait"
        )
        self.time = time


class Stepper:
    """A chain ready to be advanced: its tables and its propagator for one step length."""

    def __init__(self, chain: Chain, step: float, every: int = 1) -> None:
        """Prepare.

        Args:
            chain: The chain.
            step: Time step in s.
            every: Steps from one kept sample to the next.

        Raises:
            ValueError: A step that is not positive, or less than one step a sample.
        """
        self.chain = chain
        self.step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
        self.every = checks.whole_number("steps a sample", every, 1)
        self._links, self._body, self._added = chain.link_table(), chain.body_vector(), chain.added_mass()
        self._free, self._distributed = chain.clamp == "free", chain.reactive == "distributed"
        self._stiff, self._matrices = propagator(chain, step)

    @property
    def sample_time(self) -> float:
        """Time from one sample to the next in s."""
        return self.step * self.every

    def start(self) -> NDArray[np.float64]:
        """Return the state at the origin, at rest in the water or under tow, shape (6 + 2 N,)."""
        state = np.zeros(BODY_STATES + 2 * len(self._links))
        state[SURGE], state[SWAY] = self.chain.held_velocity
        return state

    def half_step_times(self, samples: int, first: int = 0) -> NDArray[np.float64]:
        """Return the times at which `advance` needs the driven joints' motion, in s since sample 0.

        Args:
            samples: Number of samples to advance by.
            first: Sample to advance from. A swim advanced in slices has bit for bit the times of one in a piece.
        """
        steps = np.arange(2 * samples * self.every + 1, dtype=np.float64)
        return 0.5 * self.step * (2 * first * self.every + steps)

    def advance(
        self, state: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Advance ``state`` in place through the driven joints' ``motion``.

        Args:
            state: Shape (6 + 2 N,).
            motion: Shape (2 samples * every + 1, driven joints, 3), angle, rate and acceleration at
                `half_step_times`.

        Returns:
            States, shape (samples + 1, 6 + 2 N), the first one that of the start; and their records, shape
            (samples + 1, ``RECORD_HEAD`` + N), see `evaluate`.

        Raises:
            StepError: The state stopped being finite; its time is since the first of these samples.
        """
        links = len(self._links)
        samples = (len(motion) - 1) // (2 * self.every)
        drive = np.zeros((len(motion), links, 3))
        drive[:, np.array(self.chain.driven)] = motion
        states = np.zeros((samples + 1, len(state)))
        records = np.zeros((samples + 1, RECORD_HEAD + links))
        finite = integrate(
            state,
            drive,
            self._links,
            self._body,
            self._added,
            self._free,
            self._distributed,
            self.step,
            self.every,
            self._stiff,
            self._matrices,
            states,
            records,
        )
        if finite <= samples:
            raise StepError(finite * self.sample_time)
        return states, records


def steps_a_sample(sample_time: float, longest: float) -> int:
    """Return into how many equal steps a sample is divided, so that none is longer than ``longest`` s; at least one."""
    return max(1, math.ceil(sample_time / longest - 1e-9))


def stepper_of(chain: Chain, step: float, every: int = 1, *, quick: bool = False) -> Stepper:
    """Return what advances a chain in its water; arguments and errors as `Stepper`; ``quick``: as `PlaneStepper`."""
    if chain.water.model == "ideal_2d":
        from fin_sim.ideal_2d.plane_dynamics import PlaneStepper  # noqa: PLC0415  (strips need no plane)

        return PlaneStepper(chain, step, every, quick=quick)
    return Stepper(chain, step, every)
