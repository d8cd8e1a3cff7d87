"""The papers' fish and fin as the first version had them, every number written out: no default moves them."""

from __future__ import annotations

from fin_plant.fin import Fin
from fin_sim.fish import Body

BODY = Body.ellipsoid(0.14, 0.045, 0.06, drag_area=2e-3, lift_area=0.05, yaw_drag=4e-4)
"""Drag area aside, which is a round number here."""
FIN = Fin(
    young_modulus=1.2e9,
    length=0.08,
    height=0.025,
    tip_height=0.025,
    thickness=2.08e-4,
    density=1180.0,
    segments=3,
    hinges="between",
    damping_time=0.01,
)
