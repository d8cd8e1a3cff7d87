"""Equations of motion of body and tail.

Planar motion of a rigid body (Kirchhoff's equations with drag and lift) with a chain of rigid links that Lighthill's
reactive force and a resistive force act on. Accelerations follow from the articulated-body recursion (Featherstone,
*Rigid Body Dynamics Algorithms*, 2008, chapter 7) in body axes, in time proportional to the number of links.

State, shape (6 + 2 N,): x, y, heading in the tank; forward, sideways velocity through the water and yaw rate in body
axes; N joint angles; N joint rates. A driven joint's angle, rate and acceleration are prescribed, or its motor follows
them (`motor`). In a steady uniform current the frame that moves with the water is inertial: there the equations are
those of still water.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
def evaluate_with_added_mass(
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
