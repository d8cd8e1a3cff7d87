"""The equations of `dynamics` for many fish side by side, written for the fewest operations, and one step in time.

Every function here works on plain floats and on the recording numbers of `tracing`, from which `kernel` makes
code. The physics is that of `dynamics.evaluate`, in three ways cheaper:

* Each link is treated in its own axes, forward along the link (e) and normal to it (n). Its virtual mass then acts
  along one axis only, and the wrench of the links behind is rotated through one hinge angle.
* Lighthill's distributed force needs no forces at the joints between the links: what leaves a link at its end enters
  the next one there, so their sum acts on no link, and the moment w (v.e) m_0 on every link is all that is left.
* The resistive force integral of d v |v| over a link has a form without a case for the change of sign.

A hinge's spring and damper may act on the state at the end of the step (linearly implicit): torque = -K theta - D
theta_dot there is ``torque - compliance * acceleration`` with both known before. The recursion (Featherstone, *Rigid
Body Dynamics Algorithms*, 2008, chapter 7) then only adds ``compliance`` to the hinge's inertia; with 0 it is
the explicit one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.batch.tracing import Real, absolute, floor, select, square_root

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

_TINY = 1e-30  # added to a denominator that is 0 only where its numerator is 0 too


@dataclass(frozen=True)
class LaneLink:
    """One link's constants.

    Attributes:
        length: m.
        along_mass: Moment 0 of the solid mass per length, kg.
        normal_mass: Moment 0 of solid and virtual mass, kg.
        normal_first: Moment 1 of both, kg m.
        normal_second: Moment 2 of both, kg m^2.
        virtual_mass: Moment 0 of the virtual mass, kg.
        virtual_first: Moment 1 of it, kg m.
        tip_virtual: Virtual mass per length at the link's end, kg/m.
        resistive_force: -1/2 rho C_N times root height times length / 3.
        resistive_moment: The same times length^2 / 12.
        taper_force: -1/2 rho C_N times the slope of the height times length^2 / 12; the float 0 if there is none.
        taper_moment: The same times length^3 / 30; likewise.
    """

    length: Real
    along_mass: Real
    normal_mass: Real
    normal_first: Real
    normal_second: Real
    virtual_mass: Real
    virtual_first: Real
    tip_virtual: Real
    resistive_force: Real
    resistive_moment: Real
    taper_force: Real
    taper_moment: Real


@dataclass(frozen=True)
class LaneBody:
    """The body's constants in the order of `Chain.body_vector`."""

    mass_surge: Real
    mass_sway: Real
    inertia: Real
    munk: Real
    drag: Real
    lift: Real
    yaw_drag: Real
    offset: Real
    linear_drag: Real = 0.0
    current_x: Real = 0.0
    current_y: Real = 0.0


@dataclass(frozen=True)
class Drive:
    """A driven joint at one instant: sine and cosine of its angle, its rate and acceleration."""

    sine: Real
    cosine: Real
    rate: Real
    acceleration: Real


@dataclass(frozen=True)
class Hinge:
    """A passive joint: its angle and rate, and its torque as ``torque - compliance * acceleration``."""

    angle: Real
    rate: Real
    torque: Real
    compliance: Real


@dataclass(frozen=True)
class Response:
    """What the equations give: accelerations, forward force of the water less its reaction, servos' power."""

    surge: Real
    sway: Real
    yaw: Real
    hinges: tuple[Real, ...]
    thrust: Real
    power: Real


@dataclass(frozen=True)
class Precision:
    """Degrees of the polynomials, in the square of their argument, for one floating-point type."""

    sine: int
    arctangent: int


DOUBLE = Precision(sine=8, arctangent=14)
SINGLE = Precision(sine=4, arctangent=7)


@cache
def _fitted(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]], reach: float, degree: int
) -> tuple[float, ...]:
    """Return the coefficients in x^2, lowest first, of the Chebyshev interpolant of ``function`` for |x| < reach."""
    even = np.polynomial.Chebyshev.interpolate(lambda square: function(np.sqrt(square)), degree, (0.0, reach**2))
    return tuple(float(c) for c in even.convert(kind=np.polynomial.Polynomial).coef)


def _sine_ratio(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sinc(x / math.pi)


def _arctangent_ratio(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.arctan(x) / x)


def _polynomial(coefficients: Sequence[float], x: Real) -> Real:
    result: Real = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        result = result * x + coefficient
    return result


def sine_cosine(angle: Real, precision: Precision) -> tuple[Real, Real]:
    """Return sine and cosine, from those of half the angle less whole turns."""
    half = 0.5 * angle - math.pi * floor(angle * (0.5 / math.pi) + 0.5)
    square = half * half
    sine = half * _polynomial(_fitted(_sine_ratio, 0.5 * math.pi, precision.sine), square)
    cosine = _polynomial(_fitted(np.cos, 0.5 * math.pi, precision.sine + 1), square)
    return 2.0 * (sine * cosine), 1.0 - 2.0 * (sine * sine)


def slip_angle(forward: Real, sideways: Real, speed: Real, precision: Precision) -> Real:
    """Return atan2(sideways, forward), 0 at rest, from the tangent of half the angle."""
    half = absolute(sideways) / (speed + absolute(forward) + _TINY)
    degrees = _fitted(_arctangent_ratio, 1.0, precision.arctangent)
    angle = 2.0 * half * _polynomial(degrees, half * half)
    angle = select(forward, angle, math.pi - angle)
    return select(sideways, angle, -angle)


def resistive_wrench(front: Real, rear: Real, link: LaneLink) -> tuple[Real, Real]:
    """Return the integrals over a link of c v |v| and s c v |v|, v changing linearly from ``front`` to ``rear``.

    c = -1/2 rho C_N d, linear along the link. With a and b for front and rear, the integral of s^j v |v| follows from
    that of (v - a)^j v |v| over v. Where v keeps its sign the division by b - a is done out: length (a^2 + a b + b^2)
    / 3, length^2 (3 b^2 + 2 a b + a^2) / 12 and length^3 (6 b^2 + 3 a b + a^2) / 30 for j = 0, 1, 2.
    """
    size_a, size_b = absolute(front), absolute(rear)
    inverse = 1.0 / (size_a + size_b + _TINY)
    square_a, square_b, product = front * front, rear * rear, front * rear
    sign = (front + rear) * inverse
    plain = (square_a + absolute(product) + square_b) * sign
    cube_b = square_b * size_b
    turned = (cube_b * (3.0 * rear - 4.0 * front) + square_a * (size_a * front)) * (inverse * inverse)
    kept = (3.0 * square_b + 2.0 * product + square_a) * sign
    first = select(product, kept, turned)
    turned = cube_b * (6.0 * square_b - 15.0 * product + 10.0 * square_a) - square_a * (square_a * size_a)
    turned = turned * (inverse * inverse * inverse)
    kept = (6.0 * square_b + 3.0 * product + square_a) * sign
    second = select(product, kept, select(rear, turned, -turned))
    force = link.resistive_force * plain + link.taper_force * first
    return force, link.resistive_moment * first + link.taper_moment * second


class _Wrench:
    """Articulated inertia and bias of all links behind a joint, about the joint, in the axes of the link at hand.

    force = I a + h bend + p and moment = h.a + t bend + q, for the joint's acceleration a and the link's angular
    acceleration ``bend``.
    """

    def __init__(self) -> None:
        self.ee: Real = 0.0
        self.en: Real = 0.0
        self.nn: Real = 0.0
        self.he: Real = 0.0
        self.hn: Real = 0.0
        self.t: Real = 0.0
        self.pe: Real = 0.0
        self.pn: Real = 0.0
        self.q: Real = 0.0
        self.thrust: tuple[Real, Real] = (0.0, 0.0)  # forces of the water less their reaction

    def move_forward(self, length: Real, centripetal: Real) -> None:
        """Refer to a point ``length`` ahead, from which this one accelerates by ``centripetal`` forward."""
        self.pe += self.ee * centripetal
        self.pn += self.en * centripetal
        self.q += self.he * centripetal - length * self.pn
        old = self.hn
        self.he -= length * self.en
        self.hn -= length * self.nn
        self.t -= length * (old + self.hn)

    def add(self, link: LaneLink) -> None:
        """Add the inertia of a link about its own joint."""
        self.ee += link.along_mass
        self.nn += link.normal_mass
        self.hn -= link.normal_first
        self.t += link.normal_second

    def bend(self, acceleration: Real) -> None:
        """Prescribe the joint's acceleration."""
        self.pe += self.he * acceleration
        self.pn += self.hn * acceleration
        self.q += self.t * acceleration

    def release(self, hinge: Hinge) -> tuple[Real, Real]:
        """Let the joint move under its torque; return its acceleration at rest of the link ahead, and 1 / inertia."""
        inverse = 1.0 / (self.t + hinge.compliance)
        push = (hinge.torque - self.q) * inverse
        share = hinge.compliance * inverse
        self.pe += self.he * push
        self.pn += self.hn * push
        self.q = hinge.torque - hinge.compliance * push
        scaled_e, scaled_n = self.he * inverse, self.hn * inverse
        self.ee -= self.he * scaled_e
        self.en -= self.he * scaled_n
        self.nn -= self.hn * scaled_n
        self.he, self.hn, self.t = share * self.he, share * self.hn, share * self.t
        return push, inverse

    def rotate(self, sine: Real, cosine: Real) -> None:
        """Go over to the axes of the link ahead, which this one is turned against by the angle of ``sine``."""
        difference = self.nn - self.ee
        lift = sine * (sine * difference - 2.0 * cosine * self.en)
        mixed = sine * cosine
        en = self.en - 2.0 * sine * (sine * self.en) - mixed * difference
        self.ee, self.nn, self.en = self.ee + lift, self.nn - lift, en
        self.he, self.hn = _turned(self.he, self.hn, sine, cosine)
        self.pe, self.pn = _turned(self.pe, self.pn, sine, cosine)
        self.thrust = _turned(*self.thrust, sine, cosine)


def _turned(e: Real, n: Real, sine: Real, cosine: Real) -> tuple[Real, Real]:
    """Return a vector of a link's axes in those of the link ahead."""
    return e * cosine - n * sine, e * sine + n * cosine


def _water(wrench: _Wrench, link: LaneLink, motion: tuple[Real, Real, Real], *, distributed: bool, last: bool) -> None:
    """Add the link's own inertia and what the water does to it; motion is along, normal velocity and yaw rate."""
    along, normal, turn = motion
    end = normal - link.length * turn
    resist, resist_moment = resistive_wrench(normal, end, link)
    force_n: Real = resist
    force_e: Real = 0.0
    wrench.q += resist_moment
    if last:
        tip_n = link.tip_virtual * end * along
        force_n = force_n - tip_n
        force_e = 0.5 * link.tip_virtual * end * end
        wrench.q -= link.length * tip_n
    wrench.thrust = (wrench.thrust[0] + force_e, wrench.thrust[1] + force_n)
    # Centripetal and reactive terms that stay when nothing accelerates: both forms' along the link add up.
    wrench.pe += turn * (link.normal_first * turn - link.virtual_mass * normal) - force_e
    wrench.pn -= link.virtual_mass * (turn * along) + force_n
    wrench.q += along * (link.virtual_mass * normal if distributed else link.virtual_first * turn)


def respond(
    body: LaneBody,
    links: Sequence[LaneLink],
    drives: Sequence[Drive],
    hinges: Sequence[Hinge],
    velocity: tuple[Real, Real, Real],
    *,
    free: bool,
    distributed: bool,
    precision: Precision,
) -> Response:
    """Return the accelerations of the body (in body axes) and of the hinges.

    Args:
        body: The body.
        links: From the head to the tail.
        drives: Of the first joints.
        hinges: The joints behind them.
        velocity: Surge, sway, yaw rate.
        free: Whether the body moves under its forces.
        distributed: Form of the reactive force.
        precision: Of sines and arctangents.
    """
    u, v, r = velocity
    turns = [(drive.sine, drive.cosine) for drive in drives]
    turns += [sine_cosine(hinge.angle, precision) for hinge in hinges]
    rates = [drive.rate for drive in drives] + [hinge.rate for hinge in hinges]
    motions = []
    along, normal, turn = u, v - body.offset * r, r
    for link, (sine, cosine), rate in zip(links, turns, rates, strict=True):
        along, normal = _turned(along, normal, -sine, cosine)
        turn = turn + rate
        motions.append((along, normal, turn))
        normal = normal - link.length * turn

    wrench = _Wrench()
    eliminated: list[tuple[Real, ...]] = []
    for k in range(len(links) - 1, -1, -1):
        if k < len(links) - 1:
            wrench.move_forward(links[k].length, links[k].length * motions[k][2] * motions[k][2])
        wrench.add(links[k])
        _water(wrench, links[k], motions[k], distributed=distributed, last=k == len(links) - 1)
        kept = (wrench.he, wrench.hn, wrench.t, wrench.q)
        if k < len(drives):
            wrench.bend(drives[k].acceleration)
            eliminated.append(kept)
        else:
            eliminated.append((*kept, *wrench.release(hinges[k - len(drives)])))
        wrench.rotate(*turns[k])
    eliminated.reverse()

    shift_e, shift_n = -v * r + body.offset * r * r, u * r  # acceleration of the first joint while du, dv, dr are 0
    thrust = wrench.thrust[0]
    du, dv, dr = _body(body, wrench, velocity, (shift_e, shift_n), precision) if free else (0.0, 0.0, 0.0)
    ahead = (du + shift_e, dv + shift_n - body.offset * dr, dr)
    accelerations, power = _outward(links, drives, turns, motions, eliminated, ahead)
    return Response(du, dv, dr, accelerations, thrust, power)


def _body(
    body: LaneBody,
    wrench: _Wrench,
    velocity: tuple[Real, Real, Real],
    shift: tuple[Real, Real],
    precision: Precision,
) -> tuple[Real, Real, Real]:
    """Solve Kirchhoff's equations of the free body with the tail's wrench."""
    u, v, r = velocity
    wrench.pe += wrench.ee * shift[0] + wrench.en * shift[1]
    wrench.pn += wrench.en * shift[0] + wrench.nn * shift[1]
    wrench.q += wrench.he * shift[0] + wrench.hn * shift[1]
    wrench.move_forward(body.offset, 0.0)
    speed = square_root(u * u + v * v)
    side = body.lift * slip_angle(u, v, speed, precision) * speed
    drag = body.drag * speed + body.linear_drag
    force_e = body.mass_sway * (v * r) - drag * u + side * v - wrench.pe
    force_n = -(body.mass_surge * (u * r)) - drag * v - side * u - wrench.pn
    moment = body.munk * (u * v) - body.yaw_drag * (r * absolute(r)) - wrench.q
    ee, nn, tt = wrench.ee + body.mass_surge, wrench.nn + body.mass_sway, wrench.t + body.inertia
    en, et, nt = wrench.en, wrench.he, wrench.hn
    inverse = 1.0 / ee
    ratio_n, ratio_t = en * inverse, et * inverse
    nn, nt, force_n = nn - ratio_n * en, nt - ratio_n * et, force_n - ratio_n * force_e
    tt, moment = tt - ratio_t * et, moment - ratio_t * force_e
    ratio = nt / nn
    dr = (moment - ratio * force_n) / (tt - ratio * nt)
    dv = force_n / nn - ratio * dr
    du = inverse * force_e - ratio_n * dv - ratio_t * dr
    return du, dv, dr


def _outward(
    links: Sequence[LaneLink],
    drives: Sequence[Drive],
    turns: Sequence[tuple[Real, Real]],
    motions: Sequence[tuple[Real, Real, Real]],
    eliminated: Sequence[tuple[Real, ...]],
    ahead: tuple[Real, Real, Real],
) -> tuple[tuple[Real, ...], Real]:
    """Return the hinges' accelerations and the servos' power, from the acceleration of the body's end."""
    a_e, a_n, bend = ahead
    accelerations: list[Real] = []
    power: Real = 0.0
    for k, link in enumerate(links):
        sine, cosine = turns[k]
        a_e, a_n = _turned(a_e, a_n, -sine, cosine)
        h_e, h_n, inertia, bias = eliminated[k][:4]
        if k < len(drives):
            bend = bend + drives[k].acceleration
            power = power + (h_e * a_e + h_n * a_n + inertia * bend + bias) * drives[k].rate
        else:
            push, inverse = eliminated[k][4:]
            relative = push - inverse * (h_e * a_e + h_n * a_n + inertia * bend)
            accelerations.append(relative)
            bend = bend + relative
        turn = motions[k][2]
        a_e, a_n = a_e + link.length * turn * turn, a_n - link.length * bend
    return tuple(accelerations), power
