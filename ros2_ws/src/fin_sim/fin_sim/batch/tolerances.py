"""How right a figure of the batch is, and when swims at shorter steps have settled on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_sim.batch.columns import highest_heights
from fin_sim.batch.result import FIGURES
from fin_sim.batch.task import beating

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_sim.batch.task import Task

TOLERANCES = {"mean_speed": 1e-3, "mean_forward_speed": 1e-3, "thrust": 3e-3, "servo_power": 3e-3}
"""Largest error of a figure, relative to its size or, where it is nearly 0, to its floor in `error_floors`."""
_ALLOWED = {**TOLERANCES, "electrical_power": TOLERANCES["servo_power"]}
"""Those of servos with a motor too; until the swims are done an ideal servo's electrical power counts as 0."""
_SPEED_FLOOR, _FORCE_FLOOR = 1e-3, 1e-2
_PAIR, _TRIPLE = 0.1, (1.5, 0.4)
"""Converged are two swims that differ by so much of the tolerance, or three that differ by so much in turn."""
_CHECKED = [FIGURES.index(name) for name in _ALLOWED]


def error_floors(task: Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the sizes below which the errors of `_ALLOWED` count as absolute ones, shape (n, 5).

    With U = frequency times amplitude times the fin's length: U / 1000 of a speed; of a force a hundredth of
    pi/4 rho d^2 U^2, the momentum that the water at the fin's largest height d takes up a second at that speed; of
    power this force times the tip's speed 2 pi U.
    """
    speed = beating(task.gaits(fins)) * fins["length"].astype(float)
    force = _FORCE_FLOOR * 0.25 * np.pi * task.fish.water.density * highest_heights(fins) ** 2 * speed**2
    size = {
        "mean_speed": _SPEED_FLOOR * speed,
        "mean_forward_speed": _SPEED_FLOOR * speed,
        "thrust": force,
        "servo_power": force * 2.0 * np.pi * speed,
        "electrical_power": force * 2.0 * np.pi * speed,
    }
    return np.column_stack([size[name] for name in _ALLOWED])


def difference(
    coarse: NDArray[np.float64], fine: NDArray[np.float64], floors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the largest difference of each two swims over what is allowed, shape (n,); NaN where there is none."""
    allowed = np.array(list(_ALLOWED.values())) * np.maximum(np.abs(fine[:, _CHECKED]), floors)
    change = np.abs(fine - coarse)[:, _CHECKED]
    # A held body's speed is exactly 0 at any step, and so is what it may differ by where the tail does not beat.
    share = np.divide(change, allowed, out=np.where(change == 0.0, 0.0, np.nan), where=allowed > 0.0)
    return np.asarray(share.max(axis=1))


def settled(last: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which swims have converged, from the last two differences from halving to halving, shape (n,).

    Two swims may agree by chance while both are wrong: either the first two agree closely, or the last three draw near.
    """
    first = np.isinf(before)
    return np.where(first, last <= _PAIR, (last <= _TRIPLE[1]) & (before <= _TRIPLE[0]))
