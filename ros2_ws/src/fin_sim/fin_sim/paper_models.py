"""The two models of the papers (Clark et al. 2012; Raja Mohamed & Raviraj): what each takes in and what it returns."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_plant.gait import PAPER_GAIT, Gait
from fin_sim.swim import PAPER_FISH, Swim, swim

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_sim.chain import Reactive
    from fin_sim.fish import Fish

# Beats that a held tail takes to forget its start: the slowest, the soft fin at 0.2 GPa, is periodic to 1e-4 after 8.
_BEATS = 12


def mean_thrust_held(
    fin: Fin, fish: Fish = PAPER_FISH, gait: Gait = PAPER_GAIT, *, reactive: Reactive = "tip"
) -> float:
    """Return the mean thrust in N over whole beats of a fin without mass on a body that is held.

    Raises:
        ValueError: A gait that does not beat, or a value that is refused.
    """
    frequency = checks.number("gait frequency", gait.joints[0].frequency, 0.0, unit="Hz", exclusive_minimum=True)
    held = swim(replace(fin, density=0.0), fish, gait, _BEATS / frequency, reactive=reactive, clamp="fixed")
    return held.mean_thrust


def speed_from_thrust(thrust: float, drag_area: float, density: float = 1000.0) -> float:
    """Return the speed in m/s at which drag balances a thrust in N: U = sqrt(2 T / (rho S C_D)); 0 where T is negative.

    Args:
        thrust: T, N.
        drag_area: S C_D, m^2.
        density: rho, kg/m^3.

    Raises:
        ValueError: A number out of range.
    """
    checks.number("thrust", thrust, unit="N")
    checks.number("drag_area", drag_area, 0.0, unit="m^2", exclusive_minimum=True)
    checks.number("density", density, 0.0, unit="kg/m^3", exclusive_minimum=True)
    return float(speeds_from_thrust(np.array(thrust), drag_area, density))


def speeds_from_thrust(thrust: NDArray[np.float64], drag_area: float, density: float) -> NDArray[np.float64]:
    """Return `speed_from_thrust` of many thrusts, of any shape; NaN where there is none."""
    return np.asarray(np.sqrt(2.0 * np.maximum(thrust, 0.0) / (density * drag_area)))


def mathematical_model(
    fin: Fin, fish: Fish = PAPER_FISH, gait: Gait = PAPER_GAIT, *, reactive: Reactive = "tip"
) -> float:
    """Return the speed in m/s that the papers' mathematical model gives a fin: body held, fin without mass.

    Raises:
        ValueError: A value that is refused.
    """
    thrust = mean_thrust_held(fin, fish, gait, reactive=reactive)
    return speed_from_thrust(thrust, fish.body.drag_area, fish.water.density)


def simulation(
    fin: Fin,
    fish: Fish = PAPER_FISH,
    gait: Gait = PAPER_GAIT,
    duration: float = 10.0,
    *,
    reactive: Reactive = "tip",
) -> Swim:
    """Return the swim that the papers' simulation stands for: body free, fin with mass, 10 s from rest.

    Raises:
        ValueError: A value that is refused.
    """
    return swim(fin, fish, gait, duration, reactive=reactive)


def towed(fin: Fin, speed: float, fish: Fish = PAPER_FISH, gait: Gait = PAPER_GAIT, duration: float = 10.0) -> Swim:
    """Return the swim of a body towed forward at ``speed`` m/s: for thrust, power and efficiency.

    Raises:
        ValueError: A value that is refused.
    """
    return swim(fin, fish, gait, duration, clamp="towed", tow_speed=speed)
