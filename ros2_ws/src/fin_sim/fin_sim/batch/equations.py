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

Motion = tuple[Real, Real, Real]
"""Along, normal and angular: a velocity or an acceleration."""
Turn = tuple[Real, Real]
"""Sine and cosine of a joint's angle."""

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
class LanePiece:
    """The part of a link between two points of the fin's profile.

    Attributes:
        begin: Distance of its front behind the link's joint, m.
        length: m; 0 of what only fills up the number of pieces.
        resistive_force: As of a link, about the piece's front; so are the others.
        resistive_moment: Likewise.
        taper_force: Likewise.
        taper_moment: Likewise.
    """

    begin: Real
    length: Real
    resistive_force: Real
    resistive_moment: Real
    taper_force: Real
    taper_moment: Real


@dataclass(frozen=True)
class ProfiledLink(LaneLink):
    """A link whose height is linear in pieces: they take the place of its own resistive constants, which are 0."""

    pieces: tuple[LanePiece, ...]


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
class Beat:
    """One fish's own drive of a joint: the columns of a gait, the frequency as 2 pi f in rad/s."""

    amplitude: Real
    turning: Real
    phase: Real
    bias: Real


@dataclass(frozen=True)
class Fade:
    """How much of the gait there is at one instant, with two derivatives, and the time in s."""

    value: Real
    rate: Real
    acceleration: Real
    time: Real


def driven_by(beat: Beat, fade: Fade, precision: Precision) -> Drive:
    """Return the motion of a joint whose angle is fade (bias + amplitude sin(turning time + phase))."""
    sine, cosine = sine_cosine(beat.turning * fade.time + beat.phase, precision)
    swing = beat.amplitude * sine
    wave, slope = beat.bias + swing, beat.amplitude * beat.turning * cosine
    rate = fade.rate * wave + fade.value * slope
    acceleration = fade.acceleration * wave + 2.0 * fade.rate * slope - fade.value * beat.turning * beat.turning * swing
    return Drive(*sine_cosine(fade.value * wave, precision), rate, acceleration)


@dataclass(frozen=True)
class Hinge:
    """A passive joint: its angle and rate, and its torque as ``torque - compliance * acceleration``."""

    angle: Real
    rate: Real
    torque: Real
    compliance: Real


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


def resistive_wrench(front: Real, rear: Real, link: LaneLink | LanePiece) -> tuple[Real, Real]:
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


def _resistance(link: LaneLink, normal: Real, turn: Real) -> tuple[Real, Real]:
    """Return the resistive force on a link and its moment about the link's joint."""
    if not isinstance(link, ProfiledLink):
        return resistive_wrench(normal, normal - link.length * turn, link)
    force: Real = 0.0
    moment: Real = 0.0
    for piece in link.pieces:
        front = normal - piece.begin * turn
        own, own_moment = resistive_wrench(front, front - piece.length * turn, piece)
        force, moment = force + own, moment + (own_moment + piece.begin * own)
    return force, moment


@dataclass
class Wrench:
    """Articulated inertia and bias of all links behind a joint, about the joint, in the axes of the link at hand.

    force = I a + h bend + p and moment = h.a + t bend + q, for the joint's acceleration a and the link's angular
    acceleration ``bend``. ``thrust`` is the force of the water less its reaction.
    """

    ee: Real = 0.0
    en: Real = 0.0
    nn: Real = 0.0
    he: Real = 0.0
    hn: Real = 0.0
    t: Real = 0.0
    pe: Real = 0.0
    pn: Real = 0.0
    q: Real = 0.0
    thrust_e: Real = 0.0
    thrust_n: Real = 0.0

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
        self.thrust_e, self.thrust_n = _turned(self.thrust_e, self.thrust_n, sine, cosine)


def _turned(e: Real, n: Real, sine: Real, cosine: Real) -> tuple[Real, Real]:
    """Return a vector of a link's axes in those of the link ahead."""
    return e * cosine - n * sine, e * sine + n * cosine


def _water(wrench: Wrench, link: LaneLink, motion: Motion, *, distributed: bool, last: bool) -> None:
    """Add the link's own inertia and what the water does to it; motion is along, normal velocity and yaw rate."""
    along, normal, turn = motion
    end = normal - link.length * turn
    resist, resist_moment = _resistance(link, normal, turn)
    force_n: Real = resist
    force_e: Real = 0.0
    wrench.q += resist_moment
    if last:
        tip_n = link.tip_virtual * end * along
        force_n = force_n - tip_n
        force_e = 0.5 * link.tip_virtual * end * end
        wrench.q -= link.length * tip_n
    wrench.thrust_e, wrench.thrust_n = wrench.thrust_e + force_e, wrench.thrust_n + force_n
    # Centripetal and reactive terms that stay when nothing accelerates: both forms' along the link add up.
    wrench.pe += turn * (link.normal_first * turn - link.virtual_mass * normal) - force_e
    wrench.pn -= link.virtual_mass * (turn * along) + force_n
    wrench.q += along * (link.virtual_mass * normal if distributed else link.virtual_first * turn)


def enter_link(front: Motion, turn: Turn, rate: Real) -> Motion:
    """Return a link's motion at its root, in its axes, from that of the point ahead in the axes of the link ahead."""
    along, normal = _turned(front[0], front[1], -turn[0], turn[1])
    return along, normal, front[2] + rate


def leave_link(motion: Motion, length: Real) -> Motion:
    """Return a link's motion at its end."""
    along, normal, turn = motion
    return along, normal - length * turn, turn


def gather_link(
    wrench: Wrench,
    link: LaneLink,
    motion: Motion,
    joint: Drive | Hinge,
    turn: Turn,
    *,
    distributed: bool,
    last: bool,
) -> tuple[Real, ...]:
    """Change the wrench of all links behind a link into that of these and the link, in the axes of the link ahead.

    Returns:
        What `accelerate_link` needs of it.
    """
    if not last:
        wrench.move_forward(link.length, link.length * motion[2] * motion[2])
    wrench.add(link)
    _water(wrench, link, motion, distributed=distributed, last=last)
    kept: tuple[Real, ...] = (wrench.he, wrench.hn, wrench.t, wrench.q)
    if isinstance(joint, Drive):
        wrench.bend(joint.acceleration)
    else:
        kept = (*kept, *wrench.release(joint))
    wrench.rotate(*turn)
    return kept


def accelerate_link(
    ahead: Motion, link: LaneLink, turn: Turn, yaw_rate: Real, kept: Sequence[Real], drive: Drive | None
) -> tuple[Motion, Real]:
    """Return the acceleration of a link's end, and its servo's power or its hinge's acceleration.

    Args:
        ahead: Acceleration of the end of the link ahead, in that link's axes, and its angular acceleration.
        link: The link.
        turn: Of its joint.
        yaw_rate: The link's own.
        kept: What `gather_link` returned.
        drive: Where the joint is driven.
    """
    a_e, a_n = _turned(ahead[0], ahead[1], -turn[0], turn[1])
    bend = ahead[2]
    h_e, h_n, inertia, bias = kept[:4]
    value: Real
    if drive:
        bend = bend + drive.acceleration
        value = (h_e * a_e + h_n * a_n + inertia * bend + bias) * drive.rate
    else:
        push, inverse = kept[4:]
        value = push - inverse * (h_e * a_e + h_n * a_n + inertia * bend)
        bend = bend + value
    return (a_e + link.length * yaw_rate * yaw_rate, a_n - link.length * bend, bend), value


def body_end(body: LaneBody, velocity: Motion) -> Motion:
    """Return the motion of the body's end, where the first joint is."""
    return velocity[0], velocity[1] - body.offset * velocity[2], velocity[2]


def accelerate_body(
    body: LaneBody, wrench: Wrench, velocity: Motion, *, free: bool, precision: Precision
) -> tuple[Motion, Motion]:
    """Return the rates of surge, sway and yaw rate under the tail's wrench, and the acceleration of the body's end."""
    u, v, r = velocity
    shift_e, shift_n = -v * r + body.offset * r * r, u * r  # acceleration of the first joint while du, dv, dr are 0
    du, dv, dr = _body(body, wrench, velocity, (shift_e, shift_n), precision) if free else (0.0, 0.0, 0.0)
    return (du, dv, dr), (du + shift_e, dv + shift_n - body.offset * dr, dr)


def _body(
    body: LaneBody,
    wrench: Wrench,
    velocity: Motion,
    shift: tuple[Real, Real],
    precision: Precision,
) -> Motion:
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
