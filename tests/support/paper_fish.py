"""The papers' fish and fin as the first version had them, every number written out: no default moves them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fin_plant.fin import Fin
from fin_sim.fish import Body, Fish

BODY = Body.ellipsoid(0.14, 0.045, 0.06, drag_area=2e-3, lift_area=0.05, yaw_drag=4e-4)
"""Drag area aside, which is a round number here."""
FISH = Fish(replace(BODY, drag_area=3.65e-3))
FIN = Fin(
    young_modulus=1.2e9,
    length=0.08,
    height=0.025,
    tip_height=0.025,
    thickness=2.08e-4,
    density=1180.0,
    segments=3,
    hinges="between",
    stiffness_length="segment",
    damping_time=0.01,
    hinge_damping=0.0,
)


def paper_fin(**changes: Any) -> Fin:
    """Return the paper's fin with other values of these attributes."""
    return replace(FIN, **changes)


def paper_columns(**columns: Any) -> dict[str, Any]:
    """Return the paper's fin as columns of a batch, with other values in these."""
    return {**vars(FIN), **columns}
