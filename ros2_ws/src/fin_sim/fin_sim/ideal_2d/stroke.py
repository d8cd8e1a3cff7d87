"""What a linkage does in one stroke: joints with prescribed angles, from rest, without momentum.

Momentum stays 0, so the velocity of the first member follows from the joints' rates alone, (u, v, omega) = -M_bb^-1
M_bs rates, and the net motion from the loop that the angles go through, not from how fast: the geometric phase (Kelly &
Murray 1995; Kanso et al. 2005, equation 3.13). A loop without area, as that of a single joint, leads nowhere: the
scallop theorem. Angles are periodic, so all integrals over time are Fourier series, right to rounding once the stroke
has samples enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fin_plant import checks
from fin_sim.ideal_2d.errors import MassError, StrokeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_sim.ideal_2d.linkage import Linkage

_FEWEST_SAMPLES, _MOST_SAMPLES = 32, 2048
TOLERANCE = 1e-9
"""Of the net motion, over the length of the first member's path, at which samples are enough."""


_Moved = tuple[NDArray[np.float64], float]  # velocity of the first member, and kinetic energy


@dataclass(frozen=True)
class JointAngle:
    """A periodic joint angle: offset plus the sum of amplitude sin(2 pi order t / period + phase).

    Attributes:
        offset: rad.
        waves: Order (1 for once a stroke), amplitude and phase, rad, of each wave.

    Raises:
        ValueError: Something that is not a finite number, or an order that is not a whole one from 1 to 20.
    """

    offset: float = 0.0
    waves: tuple[tuple[int, float, float], ...] = ()

    def __post_init__(self) -> None:
        checks.number("offset", self.offset, -math.pi, math.pi, unit="rad")
        for order, amplitude, phase in self.waves:
            checks.whole_number("order of a wave", order, 1, 20)
            checks.number("amplitude", amplitude, -math.pi, math.pi, unit="rad")
            checks.number("phase", phase, unit="rad")

    def at(self, turn: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the angle and its derivative by the turn, 2 pi t / period, of the same shape."""
        angle, slope = np.full_like(turn, self.offset), np.zeros_like(turn)
        for order, amplitude, phase in self.waves:
            angle += amplitude * np.sin(order * turn + phase)
            slope += order * amplitude * np.cos(order * turn + phase)
        return angle, slope


@dataclass(frozen=True)
class Stroke:
    """What a linkage did in one stroke. S samples, the last one the first of the next stroke.

    Attributes:
        time: s, shape (S + 1,).
        angles: Of the joints, rad, shape (S + 1, joints).
        place: Of the first member's origin, x + i y in its axes at time 0, m, shape (S + 1,).
        heading: Of the first member, rad, shape (S + 1,).
        energy: Kinetic energy of solids and water, J per metre of depth, shape (S + 1,).
        error: Of the net motion, m: its change from half as many samples.
    """

    time: NDArray[np.float64]
    angles: NDArray[np.float64]
    place: NDArray[np.complex128]
    heading: NDArray[np.float64]
    energy: NDArray[np.float64]
    error: float

    def track(self, linkage: Linkage, member: int) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Return a member's origin and heading over time, in that member's axes at time 0, shapes (S + 1,)."""
        poses = [linkage.places(angles) for angles in self.angles]
        origin = np.array([pose[0][member] for pose in poses])
        turn = np.array([pose[1][member] for pose in poses])
        place, heading = self.place + np.exp(1j * self.heading) * origin, self.heading + turn
        return (place - place[0]) * np.exp(-1j * heading[0]), heading - heading[0]


def _antiderivative(values: NDArray[np.float64], turn: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the integral from 0 of a periodic function, less its mean's share, and the mean."""
    count = len(values)
    series = np.fft.rfft(values) / count
    orders = np.arange(len(series))
    rest = series[1:] / (1j * orders[1:])
    rest[-1] = 0.0
    periodic = 2.0 * np.real(np.exp(1j * np.outer(turn, orders[1:])) @ rest)
    return periodic - periodic[0], float(series[0].real)


def _integrate(
    velocity: NDArray[np.float64], turn: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return place and heading at the turns of the samples and at 2 pi, from velocities per turn, shape (S, 3)."""
    turning, mean = _antiderivative(velocity[:, 2], turn)
    count = len(velocity)
    along = (velocity[:, 0] + 1j * velocity[:, 1]) * np.exp(1j * turning[:-1])
    orders = np.fft.fftfreq(count, 1.0 / count)
    series = np.fft.fft(along) / count
    series[count // 2] = 0.0
    rate = mean + orders
    half = 0.5 * np.outer(turn, rate)
    place = (turn[:, None] * np.exp(1j * half) * np.sinc(half / math.pi)) @ series
    return place.astype(np.complex128), turning + mean * turn


def _refuse_collision(linkage: Linkage, angles: NDArray[np.float64], time: float) -> None:
    """Raise `StrokeError` if members collide with the joints at these angles, at this time of the stroke in s."""
    collision = linkage.overlap(angles)
    if collision:
        shown = ", ".join(f"{angle:.4g}" for angle in angles)
        msg = (
            f"members {collision[0] + 1} and {collision[1] + 1} collide at t = {time:.4g} s of the stroke, "
            f"with the joints at {shown} rad: give smaller angles, or more room at the joints"
        )
        raise StrokeError(msg)


def _sampled(
    joints: Sequence[JointAngle], samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return turns over a stroke, shape (S + 1,), the joints' angles there and their slopes, shape (S + 1, joints)."""
    turn = 2.0 * math.pi / samples * np.arange(samples + 1, dtype=np.float64)
    both = [joint.at(turn) for joint in joints]
    angles = np.stack([angle for angle, _ in both], axis=1)
    slopes = np.stack([slope for _, slope in both], axis=1)
    return turn, angles, slopes


def _moved(
    linkage: Linkage,
    matrix: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    angles: NDArray[np.float64],
    slopes: NDArray[np.float64],
    time: float,
) -> _Moved:
    """Return how the first member moves at zero momentum, per turn, and the energy, at this time of the stroke in s.

    Raises:
        StrokeError: Members collide, or the mass matrix is not positive.
    """
    _refuse_collision(linkage, angles, time)
    try:
        mass = matrix(angles)
    except MassError as error:
        msg = f"at t = {time:.4g} s of the stroke {error}"
        raise StrokeError(msg) from error
    base = -np.linalg.solve(mass[:3, :3], mass[:3, 3:] @ slopes)  # Kanso et al. 2005, equation 3.13
    whole = np.concatenate([base, slopes])
    return base, float(0.5 * whole @ mass @ whole)


def swim_stroke(
    linkage: Linkage,
    matrix: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    joints: Sequence[JointAngle],
    period: float = 2.0 * math.pi,
    *,
    tolerance: float = TOLERANCE,
) -> Stroke:
    """Return one stroke from rest.

    Args:
        linkage: What swims.
        matrix: Its mass matrix by the joints' angles, shape (3 + joints, 3 + joints), as `AddedMass.matrix`.
        joints: The angle of each joint.
        period: Of a stroke, s.
        tolerance: See `TOLERANCE`.

    Raises:
        ValueError: Another number of angles than joints, or a period that is not positive.
        StrokeError: Members collide, the mass matrix is not positive, or the net motion does not converge.
    """
    period = checks.number("period", period, 0.0, unit="s", exclusive_minimum=True)
    if len(joints) != linkage.joints:
        msg = f"{len(joints)} joint angles for a linkage of {linkage.joints} joints: give one for each joint"
        raise ValueError(msg)
    known: dict[float, _Moved] = {}  # by the turn: of twice as many samples every second one is known
    samples, before = _FEWEST_SAMPLES, None
    while samples <= _MOST_SAMPLES:
        turn, angles, slopes = _sampled(joints, samples)
        time = turn * period / (2.0 * math.pi)
        for index, at in enumerate(turn[:-1].tolist()):
            if at not in known:
                known[at] = _moved(linkage, matrix, angles[index], slopes[index], float(time[index]))
        motion = [known[at] for at in turn[:-1].tolist()]
        velocity = np.array([base for base, _ in motion])
        place, heading = _integrate(velocity, turn)
        length = 2.0 * math.pi * float(np.mean(np.abs(velocity[:, 0] + 1j * velocity[:, 1])))
        end = np.array([place[-1], heading[-1] * length])
        error = float(np.max(np.abs(end - before))) if before is not None else math.inf
        if error <= tolerance * length:
            energy = np.array([energy for _, energy in motion]) * (2.0 * math.pi / period) ** 2
            return Stroke(time, angles, place, heading, np.append(energy, energy[0]), error)
        before = end
        samples *= 2
    msg = (
        f"the net motion still changes by {error:.3g} m from {_MOST_SAMPLES // 2} to {_MOST_SAMPLES} samples of a "
        "stroke: members nearly touch; give smaller angles, more room at the joints, or more nodes"
    )
    raise StrokeError(msg)
