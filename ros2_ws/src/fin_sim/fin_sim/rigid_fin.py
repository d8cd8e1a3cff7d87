"""What a servo must give to beat a fin that does not bend, in still water: an estimate before anything swims."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fin_plant.fin import node_table

if TYPE_CHECKING:
    from fin_plant.fin import Fin

_PLACES = 200
"""Strips of the fin: the trapezoidal rule is exact to 1e-4 of the load then."""
_PHASES = 180
"""Moments of a beat, every 2 degrees: a peak of the power is met to 1e-3."""
_WATER = node_table("fin_sim", "simulator")
_DENSITY, _DRAG = (float(_WATER[f"water.{name}"].default) for name in ("density", "normal_drag"))  # type: ignore[arg-type]


class Load(NamedTuple):
    """Largest torque in N m and largest power in W of a servo within a beat."""

    torque: float
    power: float


def rigid_fin_load(fin: Fin, amplitude: float, frequency: float) -> Load:
    """Return what a servo gives that beats a rigid fin hinged at its root, A sin(2 pi f t), in the simulator's water.

    Each strip has its own mass and Lighthill's virtual mass pi/4 rho d^2 (1971), and resists as 1/2 rho C_N d v |v|
    (Taylor 1952): T = I A w^2 sin + D (A w)^2 cos |cos|. A fin that bends asks for less, but near its resonance.

    Args:
        fin: Its length, heights, thickness and density count.
        amplitude: A, rad.
        frequency: f, Hz.
    """
    at = np.linspace(0.0, fin.length, _PLACES + 1)
    positions = getattr(fin, "profile_position", ())
    stations = np.array([0.0, *positions, 1.0]) * fin.length
    height = np.interp(at, stations, fin.heights)
    mass = fin.density * fin.thickness * height + 0.25 * math.pi * _DENSITY * height**2
    inertia = np.trapezoid(mass * at**2, at)
    drag = 0.5 * _DENSITY * _DRAG * np.trapezoid(height * at**3, at)
    rate = 2.0 * math.pi * frequency
    phase = np.linspace(0.0, 2.0 * math.pi, _PHASES, endpoint=False)
    wave, slope = np.sin(phase), np.cos(phase)
    # The servo holds against the fin's acceleration -A w^2 sin and against its speed.
    torque = -inertia * amplitude * rate**2 * wave + drag * (amplitude * rate) ** 2 * slope * np.abs(slope)
    return Load(float(np.max(np.abs(torque))), float(np.max(torque * amplitude * rate * slope)))
