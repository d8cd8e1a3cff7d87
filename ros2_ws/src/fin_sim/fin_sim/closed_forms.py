"""Answers that are known without integrating anything, to check the integration against."""

from __future__ import annotations

import math

from scipy.special import j0, j1, jv

from fin_plant import checks


def plate_virtual_mass(height: float, density: float = 1000.0) -> float:
    """Return Lighthill's virtual mass per length of a plate of this height in m, pi/4 rho d^2, kg/m.

    Raises:
        ValueError: A height or density that is not positive.
    """
    checks.number("height", height, 0.0, unit="m", exclusive_minimum=True)
    checks.number("density", density, 0.0, unit="kg/m^3", exclusive_minimum=True)
    return 0.25 * math.pi * density * height**2


def plate_thrust(length: float, virtual_mass: float, amplitude: float, frequency: float, speed: float) -> float:
    """Return the mean thrust in N of a rigid plate hinged at its root and towed, without resistive force.

    theta = A sin(w t): 1/2 m [L^2 w^2 A J1(A) - U^2/4 (J0(A) - J0(3A))], from Lighthill (1971) in the
    energy-consistent form; J are Bessel functions. (J0(A) - J0(3A) is the mean of 4 sin^2 cos over a beat.)

    Args:
        length: L, m.
        virtual_mass: m, kg/m.
        amplitude: A, rad.
        frequency: Hz.
        speed: U, m/s.

    Raises:
        ValueError: A number that is not finite.
    """
    for name, value in (("length", length), ("amplitude", amplitude), ("frequency", frequency), ("speed", speed)):
        checks.number(name, value)
    sweep = length**2 * (2.0 * math.pi * frequency) ** 2 * amplitude * j1(amplitude)
    return float(0.5 * virtual_mass * (sweep - 0.25 * speed**2 * (j0(amplitude) - jv(0, 3.0 * amplitude))))


def plate_power(length: float, virtual_mass: float, amplitude: float, frequency: float, speed: float) -> float:
    """Return the mean servo power in W of the plate of `plate_thrust`: m U L^2 w^2 A J1(A).

    Raises:
        ValueError: A number that is not finite.
    """
    for name, value in (("length", length), ("amplitude", amplitude), ("frequency", frequency), ("speed", speed)):
        checks.number(name, value)
    rate = 2.0 * math.pi * frequency
    return float(virtual_mass * speed * length**2 * rate**2 * amplitude * j1(amplitude))


def coasting_speed(start: float, mass: float, drag: float, time: float) -> float:
    """Return the speed in m/s of a body that coasts against drag k u^2: u0 / (1 + k u0 t / M).

    Args:
        start: u0, m/s.
        mass: M, with the added mass, kg.
        drag: k = 1/2 rho S C_D, kg/m.
        time: s.

    Raises:
        ValueError: A number out of range.
    """
    checks.number("mass", mass, 0.0, unit="kg", exclusive_minimum=True)
    checks.number("drag", drag, 0.0, unit="kg/m")
    checks.number("time", time, 0.0, unit="s")
    return start / (1.0 + drag * start * time / mass)


def midpoint_deflection(segments: int) -> float:
    """Return the tip deflection of a `midpoint` chain under a force at its tip over the beam's: 1 - 1/(4 N^2).

    Raises:
        ValueError: Less than one segment.
    """
    return 1.0 - 0.25 / checks.whole_number("segments", segments, 1) ** 2
