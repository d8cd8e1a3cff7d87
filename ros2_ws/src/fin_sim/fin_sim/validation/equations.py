"""Closed forms: plate, energy, body, added masses and the limits of stiffness."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_simpson

from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive, carangiform
from fin_sim import closed_forms, dynamics, time_stepping
from fin_sim.chain import Chain, Reactive
from fin_sim.energy import energy_budget
from fin_sim.fish import Body, Link, Water, ellipsoid_added_mass_factors
from fin_sim.swim import PAPER_FISH, swim, swim_chain
from fin_sim.validation.page import Check, Section

if TYPE_CHECKING:
    from numpy.typing import NDArray

PLATES = ((15.0, 0.9, 0.0), (15.0, 0.9, 0.0305), (30.0, 2.0, 0.10))
"""Amplitude in degrees, frequency in Hz, speed in m/s of the towed plates."""

PLATE_LENGTH, PLATE_HEIGHT = 0.08, 0.025

ADDED_MASSES = {
    2: (0.2100, 0.7042, 0.2394),
    3: (0.1220, 0.8039, 0.4657),
    4: (0.0816, 0.8598, 0.6079),
    5: (0.0591, 0.8943, 0.6999),
    6: (0.0452, 0.9171, 0.7623),
}
"""Prolate spheroid, length over width: k surge, sway, yaw, to four digits (Lamb 1932, article 115)."""

# A tail that carries no water and weighs nothing, so that the body is alone.
_NO_TAIL = Link(length=1e-6, root_height=1e-9, tip_height=1e-9)
_STILL = Gait((JointDrive(0.0, 1.0),))
_BODY = Body(0.198, 0.02, 0.21, 2.1e-4, 1.4e-4, 0.0, 0.0, 0.0, 0.07)


def plate_errors(amplitude: float, frequency: float, speed: float) -> tuple[float, float]:
    """Return the relative errors of mean thrust and power of a towed plate; power's is 0 where both are."""
    link = Link(PLATE_LENGTH, PLATE_HEIGHT, PLATE_HEIGHT)
    chain = Chain(_BODY, (link,), (True,), Water(1000.0, 0.0), clamp="towed", tow_speed=speed)
    angle = math.radians(amplitude)
    result = swim_chain(
        chain, carangiform(angle, frequency), 4.0 / frequency, ramp_time=0.0, sample_time=1e-2 / frequency
    )
    mass = closed_forms.plate_virtual_mass(PLATE_HEIGHT)
    thrust = closed_forms.plate_thrust(PLATE_LENGTH, mass, angle, frequency, speed)
    power = closed_forms.plate_power(PLATE_LENGTH, mass, angle, frequency, speed)
    thrust_error = result.beat_mean(result.convective_force[:, 0]) / thrust - 1.0
    return thrust_error, (result.mean_servo_power / power - 1.0 if power else result.mean_servo_power)


def tip_power_excess() -> float:
    """Return by how much of itself the force at the tip overstates the power of the plate towed at 3.05 cm/s."""
    link = Link(PLATE_LENGTH, PLATE_HEIGHT, PLATE_HEIGHT)
    powers = []
    forms: tuple[Reactive, ...] = ("tip", "distributed")
    for reactive in forms:
        chain = Chain(_BODY, (link,), (True,), Water(1000.0, 0.0), reactive, "towed", 0.0305)
        gait = carangiform(math.radians(15.0), 0.9)
        powers.append(swim_chain(chain, gait, 4.0, ramp_time=0.0).mean_servo_power)
    return powers[0] / powers[1] - 1.0


def towed_energy_error(reactive: Reactive = "distributed") -> float:
    """Return the miss of the energy balance of a flexible fin under tow over whole beats, relative to power."""
    fin = Fin(tip_height=0.045, height=0.015, segments=6, hinges="midpoint", density=0.0)
    result = swim(
        fin,
        PAPER_FISH,
        duration=20.0 / 0.9,
        reactive=reactive,
        clamp="towed",
        tow_speed=0.05,
        step=5e-4,
    )
    # What the force at the tip made the tail do is held against the balance of the consistent form.
    budget = energy_budget(replace(result, chain=replace(result.chain, reactive="distributed")))
    lost, supplied = result.beat_mean(budget.lost), result.beat_mean(budget.supplied)
    return (supplied - lost) / result.mean_servo_power


def free_energy_error(fin: Fin, duration: float = 10.0, step: float = 1e-3) -> float:
    """Return the largest miss of a free swim's energy balance at any time, relative to the energy supplied."""
    result = swim(fin, duration=duration, step=step, sample_time=2e-3)
    budget = energy_budget(result)
    supplied = cumulative_simpson(budget.supplied, x=result.time, initial=0.0)
    lost = cumulative_simpson(budget.lost, x=result.time, initial=0.0)
    return float(np.abs(budget.stored - budget.stored[0] + lost - supplied).max() / np.abs(supplied).max())


def coast(body: Body, start: tuple[float, float, float], duration: float, step: float) -> NDArray[np.float64]:
    """Return the states, shape (S, 8), of a body without a tail from the start velocities surge, sway, yaw rate."""
    chain = Chain(body, (_NO_TAIL,), (True,), Water(1000.0, 0.0))
    stepper = time_stepping.Stepper(chain, step, every=max(1, round(duration / step / 1000)))
    state = stepper.start()
    state[[dynamics.SURGE, dynamics.SWAY, dynamics.YAW_RATE]] = start
    samples = round(duration / stepper.sample_time)
    motion = np.zeros((2 * samples * stepper.every + 1, 1, 3))
    return stepper.advance(state, motion)[0]


def kirchhoff_energy_error(duration: float = 100.0) -> float:
    """Return the largest relative change of the energy of a body that tumbles without drag."""
    states = coast(_BODY, (0.2, 0.1, 1.0), duration, 1e-3)
    masses = (
        _BODY.mass + _BODY.added_surge,
        _BODY.mass + _BODY.added_sway,
        _BODY.inertia + _BODY.added_inertia,
    )
    velocities = states[:, [dynamics.SURGE, dynamics.SWAY, dynamics.YAW_RATE]]
    energy = 0.5 * velocities**2 @ np.array(masses)
    return float(np.abs(energy / energy[0] - 1.0).max())


def coasting_error(duration: float = 20.0) -> float:
    """Return the relative error of the speed of a body that coasts against drag."""
    body = replace(_BODY, drag_area=3.65e-3)
    states = coast(body, (0.3, 0.0, 0.0), duration, 5e-3)
    expected = closed_forms.coasting_speed(0.3, body.mass + body.added_surge, 500.0 * body.drag_area, duration)
    return float(states[-1, dynamics.SURGE] / expected - 1.0)


def added_mass_error() -> float:
    """Return the largest deviation from the table of added masses."""
    return max(
        abs(got - wanted)
        for ratio, row in ADDED_MASSES.items()
        for got, wanted in zip(ellipsoid_added_mass_factors(float(ratio), 1.0, 1.0), row, strict=True)
    )


def stiff_limit_error() -> float:
    """Return the relative difference of thrust between a fin of 2e11 Pa, 2 mm thick, and the plate."""
    fish = replace(PAPER_FISH, water=Water(1000.0, 0.0))
    fin = Fin(young_modulus=2e11, thickness=2e-3, density=0.0)
    result = swim(fin, fish, duration=8.0, clamp="fixed")
    plate = closed_forms.plate_thrust(0.08, closed_forms.plate_virtual_mass(0.025), math.radians(15.0), 0.9, 0.0)
    return result.mean_thrust / plate - 1.0


def soft_limit_thrust() -> float:
    """Return the thrust of a fin of 1e5 Pa over that of a stiff one, both held."""
    soft, stiff = (swim(Fin(young_modulus=modulus), duration=8.0, clamp="fixed") for modulus in (1e5, 1e11))
    return soft.mean_thrust / stiff.mean_thrust


def section() -> Section:
    """Return the part on closed forms."""
    checks = []
    for amplitude, frequency, speed in PLATES:
        thrust, power = plate_errors(amplitude, frequency, speed)
        name = f"plate, {amplitude:g} degrees, {frequency:g} Hz, towed at {speed:g} m/s"
        checks.append(Check(f"{name}: mean thrust, relative", thrust, 1e-6))
        checks.append(Check(f"{name}: mean power, {'relative' if speed else 'W'}", power, 1e-6))
    checks += [
        Check("force at the tip: overstated power of the plate, less one half", tip_power_excess() - 0.5, 1e-6),
        Check("energy over whole beats, flexible tapered fin towed at 5 cm/s", towed_energy_error(), 1e-4),
        Check("energy at any time of a free swim, 10 s", free_energy_error(Fin()), 1e-4),
        Check("Kirchhoff: energy of a tumbling body, 100 s", kirchhoff_energy_error(), 1e-8),
        Check("coasting against drag, 20 s", coasting_error(), 1e-8),
        Check("Lamb's added masses, spheroids 2 to 6", added_mass_error(), 5.1e-5, "four digits"),
        Check("E to infinity: thrust against the plate's", stiff_limit_error(), 1e-3),
        Check("E to zero: thrust over the stiff fin's", soft_limit_thrust(), 0.05),
    ]
    missed = towed_energy_error("tip")
    text = f"""
Sources: Lighthill, Proc. R. Soc. B 179 (1971) 125 for the plate and the wake's energy; Lamb, *Hydrodynamics* (1932) for
body and added masses. Energy: servo power = thrust times speed + energy left in the wake, 1/2 m w^2 (v.e) at the
trailing edge + losses to resistive force and dampers. With the papers' force at the tip the same balance misses by
{abs(missed):.0%} of the servo's power: efficiencies are computed in the `distributed` form only."""
    return Section("Closed forms", checks, text)
