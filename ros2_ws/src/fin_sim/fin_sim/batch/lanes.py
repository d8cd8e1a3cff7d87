"""Swims side by side in the lanes of generated code, again at shorter steps where that is needed."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.fin import Fin
from fin_plant.gait_follower import GaitFollower, smooth_step
from fin_sim.batch.kernel import generate
from fin_sim.batch.links import lane_constants, link_columns, normal_drags
from fin_sim.batch.proven import PROVEN_ANGLE
from fin_sim.batch.result import FIGURES, LARGEST_ANGLE, OF_A_MOTOR
from fin_sim.batch.step import BEAT_FIELDS, HINGE_REACH, WINDOW_BEGIN, Form
from fin_sim.batch.tolerances import difference, error_floors, settled
from fin_sim.batch.window import line_weights, window_weights
from fin_sim.chain import build_chain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_sim.batch.task import Task

_HALVINGS = 3
_MEANS = ("surge_sum", "thrust_sum", "power_sum")


@lru_cache(maxsize=8)  # a search swims batch after batch with the same gait
def _shared(task: Task) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return what a lane kernel needs to know of each step, flat (steps, columns), and of all steps, (``UNIFORM``,)."""
    times = np.linspace(task.step, task.duration, task.steps)
    if task.gait is None and task.whole_beats:
        window = line_weights(task.steps + 1)[1:] * task.step  # each fish's sum is divided by its own window
    else:
        begin = task.settle if task.gait is None else task.begin(task.gait)
        window = window_weights(task.steps + 1, begin / task.step)[1:]
    path = task.duration * window_weights(task.steps + 1, 0.0)[1:]
    real = np.float64 if task.precision == "double" else np.float32
    table = np.column_stack((window, path, _drives(task, times)))
    chain = build_chain(task.fish, Fin(), clamp=task.clamp, tow_speed=task.tow_speed)
    uniform = np.array([*chain.body_vector(), task.step, *chain.held_velocity])
    return np.asarray(table, dtype=real).ravel(), np.asarray(uniform, dtype=real)


def _drives(task: Task, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a lane kernel knows of the gait at ``times`` s, shape (times, columns)."""
    if task.gait is None:
        fade = np.ones((4, len(times)))
        fade[1:3] = 0.0
        if task.ramp_time > 0.0:
            per_second = np.array([[1.0], [1.0 / task.ramp_time], [1.0 / task.ramp_time**2]])
            fade[:3] = smooth_step(times / task.ramp_time)[:3] * per_second
        fade[3] = times
        return fade.T
    follower = GaitFollower(task.fish.driven_joints, task.ramp_time, as_asked=True)
    follower.command(task.gait, 0.0)
    angle, rate, acceleration = np.moveaxis(follower.motion(times), 2, 0)
    drives = np.stack((np.sin(angle), np.cos(angle), rate, acceleration), axis=2)
    return np.asarray(drives.reshape(len(times), -1))


def _beats(gaits: NDArray[np.float64], links: int) -> dict[str, NDArray[np.float64]]:
    """Return the columns of `Beat` of every joint, each of shape (n, links); 0 where none is driven."""
    columns = np.zeros((len(BEAT_FIELDS), len(gaits), links))
    columns[:, :, : gaits.shape[1]] = np.moveaxis(gaits, 2, 0)
    beats = dict(zip(BEAT_FIELDS, columns, strict=True))
    beats["turning"] *= 2.0 * np.pi
    return beats


def lane_figures(task: Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the figures of one block of fins of equal segments, hinges and pieces, shape (n, figures)."""
    links = link_columns(task.fish, fins)
    count, size = links["length"].shape
    driven = task.fish.driven_joints
    form = Form(
        driven,
        size,
        task.clamp == "free",
        task.reactive == "distributed",
        "piece_begin" in links or bool(np.any(links["root_height"] != links["tip_height"])),
        task.precision,
        task.fish.body.linear_drag > 0.0,
        task.fish.water.flows,
        task.gait is None,
        links["piece_begin"].shape[2] if "piece_begin" in links else 1,
    )
    kernel = generate(form)
    reach = HINGE_REACH * task.step
    gaits = task.gaits(fins)
    constants = lane_constants(links, task.fish.water, normal_drags(links, fins, task.fish, gaits))
    if task.gait is None:
        constants |= _beats(gaits, size)
        own = task.begins(gaits) if task.whole_beats else np.full(count, -task.duration)
        constants[WINDOW_BEGIN] = np.broadcast_to(own[:, None], (count, size))
    constants |= {name: links[name] for name in ("stiffness", "damping")}
    constants["compliance"] = reach * (reach * links["stiffness"] + links["damping"])
    columns = [constants[name.rpartition("_")[0]][:, int(name.rpartition("_")[2])] for name in kernel.parameters]
    real = np.float64 if task.precision == "double" else np.float32
    chunks = -(-count // form.lanes)
    padded = np.minimum(np.arange(chunks * form.lanes), count - 1)
    parameters = np.array(columns, dtype=real)[:, padded].reshape(len(columns), chunks, form.lanes)
    results = np.empty(chunks * len(kernel.results) * form.lanes, dtype=real)
    table, uniform = _shared(task)
    flat = np.ascontiguousarray(parameters.swapaxes(0, 1)).ravel()
    kernel.advance(flat, table, uniform, results, 0, chunks, task.steps, size)
    by_fish = results.reshape(chunks, -1, form.lanes).swapaxes(0, 1).reshape(-1, chunks * form.lanes)[:, :count]
    left = dict(zip(kernel.results, by_fish.astype(float), strict=True))
    if task.gait is None and task.whole_beats:
        left |= {name: left[name] / (task.duration - task.begins(gaits)) for name in _MEANS if name in left}
    return _figures(task, left)


def _figures(task: Task, left: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of ``FIGURES`` from what a lane kernel left, shape (n, figures)."""
    nothing = np.zeros_like(left["thrust_sum"])
    speed, sound = task.body_speed, nothing
    for value in left.values():
        sound = sound + 0.0 * value  # NaN where anything is not finite
    if task.clamp == "free":
        x = left["x_sum"] + task.fish.water.current_x * task.duration
        y = left["y_sum"] + task.fish.water.current_y * task.duration
    else:
        x, y = nothing + speed * task.duration, nothing
    largest = np.max([nothing, *(left[name] for name in left if name.startswith("largest_angle"))], axis=0)
    columns = {
        "mean_speed": np.hypot(x, y) / task.duration,
        "mean_forward_speed": left.get("surge_sum", nothing + speed),
        "thrust": left["thrust_sum"],
        "servo_power": left["power_sum"],
        "x": x,
        "y": y,
        "heading": left.get("heading", nothing),
        "largest_hinge_angle": largest,
    }
    columns |= dict.fromkeys(OF_A_MOTOR, nothing)
    return np.column_stack([columns[name] + sound for name in FIGURES])


def swim_in_lanes(
    task: Task, fins: Mapping[str, NDArray[np.generic]], proven: bool
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the figures of one block of fins, shape (n, figures), and which of them are right, shape (n,)."""
    figures = lane_figures(task, fins)
    if proven:
        return figures, figures[:, LARGEST_ANGLE] <= PROVEN_ANGLE
    floors = error_floors(task, fins)
    right = np.zeros(len(figures), dtype=bool)
    before = np.full(len(figures), np.inf)
    for halving in range(1, _HALVINGS + 1):
        rest = np.flatnonzero(~right)
        finer = lane_figures(task.refined(2**halving), {name: column[rest] for name, column in fins.items()})
        last = difference(figures[rest], finer, floors[rest])
        right[rest] = settled(last, before[rest])
        figures[rest], before[rest] = finer, last
        if right.all():
            break
    return figures, right
