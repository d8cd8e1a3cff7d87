"""Swims of one fin in a plane ideal flow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_plant.gait import Gait
from fin_sim.batch.columns import fin_at
from fin_sim.batch.result import FIGURES, LARGEST_ANGLE, Status
from fin_sim.batch.task import LEAST_STEPS, window_step
from fin_sim.batch.window import window_weights
from fin_sim.chain import build_chain
from fin_sim.ideal_2d.errors import CollisionError
from fin_sim.ideal_2d.table import FoldError
from fin_sim.swim import swim_chain
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_sim.batch.task import Task

_ENOUGH = 1e-3
_HALVINGS = 5


def _figures(task: Task, gait: Gait, fin: Fin, steps: int) -> NDArray[np.float64]:
    """Return the figures of one fin in so many steps, shape (figures,).

    Raises:
        ValueError: What a plane flow has not.
        FoldError: A joint left the table.
        CollisionError: Links touch.
        StepError: The state stopped being finite.
    """
    step = task.duration / steps
    chain = build_chain(task.fish, fin, reactive=task.reactive, clamp=task.clamp, tow_speed=task.tow_speed)
    swum = swim_chain(chain, gait, task.duration, ramp_time=task.ramp_time, step=step, sample_time=step, quick=True)
    weights = window_weights(len(swum.time), task.begin(gait) / task.duration * steps)
    figures = {
        "mean_speed": swum.mean_speed,
        "mean_forward_speed": weights @ swum.surge,
        "servo_power": weights @ swum.servo_power,
        "x": swum.x[-1],
        "y": swum.y[-1],
        "heading": swum.heading[-1],
        "largest_hinge_angle": swum.largest_hinge_angle,
    }
    return np.array([figures.get(name, np.nan) for name in FIGURES])  # the force on the tail alone is not worked out


def swim_in_plane(task: Task, fins: Mapping[str, NDArray[np.generic]]) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Return the figures of one fin, shape (1, figures), and its status, shape (1,).

    Steps are halved until mean speed and largest angle change by less than a thousandth.

    Raises:
        ValueError: What a plane flow has not.
    """
    fin, gait = fin_at(fins, 0), Gait.from_rows(task.gaits(fins)[0])
    step = min(task.step, window_step(task.duration, task.settle))
    steps = max(LEAST_STEPS, int(np.ceil(task.duration / step - 1e-9)))
    watched = [FIGURES.index("mean_speed"), LARGEST_ANGLE]
    coarse = np.full(len(FIGURES), np.nan)
    status = Status.DIVERGED
    for _ in range(_HALVINGS):
        try:
            fine = _figures(task, gait, fin, steps)
        except FoldError as error:
            coarse[:], status = np.nan, Status.BEYOND_TABLE
            coarse[LARGEST_ANGLE] = abs(error.angle)
            break
        except CollisionError:
            coarse[:], status = np.nan, Status.BEYOND_TABLE
            break
        except StepError:
            fine = np.full(len(FIGURES), np.nan)
        if np.all(np.abs(fine[watched] - coarse[watched]) <= _ENOUGH * np.abs(fine[watched])):
            return fine[None], np.array([Status.OK], dtype=np.int8)
        status = Status.NOT_CONVERGED if np.isfinite(fine[watched]).all() else Status.DIVERGED
        coarse, steps = fine, 2 * steps
    return coarse[None], np.array([status], dtype=np.int8)
