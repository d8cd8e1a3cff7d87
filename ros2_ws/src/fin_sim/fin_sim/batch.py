"""Many swims at once: the figures of one swim for each of many fins, on all cores.

Up to `LONGEST_LANE_CHAIN` links the fish swim side by side in the lanes of generated code (`lane_kernel`); longer
chains, and fins with too little damping for its long steps, each swim by the general kernel (`swim`), in parallel too.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.gait import PAPER_GAIT, Gait, GaitFollower
from fin_sim import lane_kernel
from fin_sim.chain import CLAMPS, REACTIVE_FORMS, Clamp, Reactive, build_chain
from fin_sim.dynamics import StepError
from fin_sim.lane_equations import LaneLink
from fin_sim.swim import PAPER_FISH, RAMP_TIME, swim_chain

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from fin_sim.fish import Fish, Water

Precision = Literal["double", "single"]
FinColumns = Mapping[str, "ArrayLike"]

LONGEST_LANE_CHAIN = 12
"""Links up to which code is generated: each link adds a second to the first call's compilation."""
STEPS_A_BEAT = 56.0
LONGEST_STEP = 0.02
"""Default step in s for slow gaits: the paper fins' mean speeds are then within 0.1 % of the converged ones."""
GENERAL_STEP = 5e-3
"""Longest step in s of the fish that swim by the general kernel."""
_BLOCK = 2048
"""Fins set up at a time by one thread: what bounds the memory, some 2 MB a thread."""


class Status(IntEnum):
    """How a swim of the batch ended."""

    OK = 0
    REFUSED = 1
    DIVERGED = 2


@dataclass(frozen=True)
class BatchSwim:
    """Figures of n swims; NaN where the status is not OK.

    Attributes:
        fins: The fins' attributes by name, each of shape (n,).
        status: `Status`, shape (n,).
        mean_speed: Distance from start to end over the duration, m/s, shape (n,): the papers' mean speed.
        mean_forward_speed: Mean over the window of the forward velocity, m/s, shape (n,).
        thrust: Mean over the window of the forward force of the water on the tail less its inertial reaction, which
            has no mean over whole beats, N, shape (n,).
        servo_power: Mean over the window of the servos' mechanical power, W, shape (n,).
        x: Where the swim ended, m, shape (n,).
        y: Where the swim ended, m, shape (n,).
        heading: At the end, rad, shape (n,).
    """

    fins: dict[str, NDArray[np.generic]]
    status: NDArray[np.int8]
    mean_speed: NDArray[np.float64]
    mean_forward_speed: NDArray[np.float64]
    thrust: NDArray[np.float64]
    servo_power: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.status)

    def reason(self, index: int) -> str:
        """Return why a swim has no result; empty if it has one."""
        if self.status[index] == Status.DIVERGED:
            return "the state stopped being finite: use a shorter step or a slower gait"
        if self.status[index] == Status.REFUSED:
            try:
                _fin(self.fins, index)
            except ValueError as error:
                return str(error)
            return "the fin and the fish's peduncle together have more links than a chain can have: use fewer segments"
        return ""


_FIGURES = tuple(item.name for item in fields(BatchSwim) if item.name not in {"fins", "status"})


def _fin(columns: Mapping[str, NDArray[np.generic]], index: int) -> Fin:
    return Fin(**{name: column[index].item() for name, column in columns.items()})


def fin_columns(fins: Sequence[Fin] | FinColumns) -> dict[str, NDArray[np.generic]]:
    """Return the fins' attributes as columns of one length, those not given at the paper fin's.

    Raises:
        ValueError: A name that is no attribute of a fin, columns of unequal length, or a column that is not numbers.
    """
    names = [item.name for item in fields(Fin)]
    if not isinstance(fins, Mapping):
        return {name: np.array([getattr(fin, name) for fin in fins]) for name in names}
    for name in fins:
        FIN_PARAMETERS.require(f"fin.{name}")
    defaults = Fin()
    columns = {}
    for name in names:
        column = np.atleast_1d(np.asarray(fins.get(name, getattr(defaults, name))))
        if column.dtype.kind not in ("U" if name == "hinges" else "fiu"):
            msg = f"fin.{name} must be a column of {'names' if name == 'hinges' else 'numbers'}, got {column.dtype}"
            raise ValueError(msg)
        columns[name] = column
    try:
        return dict(zip(names, np.broadcast_arrays(*columns.values()), strict=True))
    except ValueError:
        lengths = {f"fin.{name}": column.shape for name, column in columns.items() if column.size > 1}
        msg = f"the columns of the fins have different shapes, {lengths}: give one value each, or one for all"
        raise ValueError(msg) from None


def accepted(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return which fins `Fin` would accept, shape (n,)."""
    good = np.ones(len(columns["length"]), dtype=bool)
    for name, column in columns.items():
        parameter = FIN_PARAMETERS[f"fin.{name}"]
        if parameter.choices:
            good &= np.isin(column, parameter.choices)
        else:
            values = column.astype(float)
            good &= (values >= parameter.minimum) & (values <= parameter.maximum)
            if parameter.kind == "integer":
                good &= values == np.floor(values)
    sheet = np.minimum(columns["length"].astype(float), columns["height"].astype(float))
    return np.asarray(good & (columns["thickness"].astype(float) < sheet))


def _links(fish: Fish, fins: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.float64]]:
    """Return the links of fins of equal segments and hinges, by attribute of `Link`, each of shape (n, links)."""
    count = len(fins["length"])
    number = {name: column.astype(float)[:, None] for name, column in fins.items() if name != "hinges"}
    segments = int(fins["segments"][0])
    inner = np.arange(1, segments) if fins["hinges"][0] == "between" else np.arange(segments) + 0.5
    at = np.concatenate(([0.0], inner / segments, [1.0]))
    heights = number["height"] * (1.0 - at) + number["tip_height"] * at
    segment = number["length"] / segments
    stiffness = number["young_modulus"] * heights[:, :-1] * number["thickness"] ** 3 / (12.0 * segment)
    tail = {
        "length": number["length"] * np.diff(at),
        "root_height": heights[:, :-1],
        "tip_height": heights[:, 1:],
        "mass_per_area": np.broadcast_to(number["density"] * number["thickness"], (count, len(at) - 1)),
        "stiffness": stiffness,
        "damping": stiffness * number["damping_time"],
    }
    return {
        name: np.hstack((np.tile([getattr(link, name) for link in fish.peduncle], (count, 1)), column))
        for name, column in tail.items()
    }


def _lane_links(links: Mapping[str, NDArray[np.float64]], water: Water) -> dict[str, NDArray[np.float64]]:
    """Return the constants of `LaneLink`, each of shape (n, links); moments of linear heights in closed form."""
    length, root, tip = links["length"], links["root_height"], links["tip_height"]
    change = tip - root
    virtual = 0.25 * np.pi * water.density
    virtual_moments = [
        virtual * length ** (p + 1) * (root**2 / (p + 1) + 2.0 * root * change / (p + 2) + change**2 / (p + 3))
        for p in range(3)
    ]
    solid_moments = [links["mass_per_area"] * length ** (p + 1) * (root / (p + 1) + change / (p + 2)) for p in range(3)]
    resistive = -0.5 * water.density * water.normal_drag
    normal = [v + s for v, s in zip(virtual_moments, solid_moments, strict=True)]
    constants = LaneLink(
        length=length,  # type: ignore[arg-type]  # columns here, numbers in the traced equations
        along_mass=solid_moments[0],  # type: ignore[arg-type]
        normal_mass=normal[0],  # type: ignore[arg-type]
        normal_first=normal[1],  # type: ignore[arg-type]
        normal_second=normal[2],  # type: ignore[arg-type]
        virtual_mass=virtual_moments[0],  # type: ignore[arg-type]
        virtual_first=virtual_moments[1],  # type: ignore[arg-type]
        tip_virtual=virtual * tip**2,  # type: ignore[arg-type]
        resistive_force=resistive * root * length / 3.0,  # type: ignore[arg-type]
        resistive_moment=resistive * root * length**2 / 12.0,  # type: ignore[arg-type]
        taper_force=resistive * change * length / 12.0,  # type: ignore[arg-type]
        taper_moment=resistive * change * length**2 / 30.0,  # type: ignore[arg-type]
    )
    return cast("dict[str, NDArray[np.float64]]", vars(constants))


@dataclass(frozen=True)
class _Task:
    """What all fins of a batch share."""

    fish: Fish
    gait: Gait
    duration: float
    steps: int
    first_step: int  # at whose end the window begins
    reactive: Reactive
    clamp: Clamp
    tow_speed: float
    ramp_time: float
    precision: Precision

    @property
    def step(self) -> float:
        return self.duration / self.steps

    def window_weights(self, samples: int, first: int) -> NDArray[np.float64]:
        """Return the trapezoidal rule's weights of the mean from sample ``first`` to the last, shape (samples,)."""
        weights = np.zeros(samples)
        weights[first:] = 1.0 / (samples - 1 - first)
        weights[[first, -1]] *= 0.5
        return weights


@lru_cache(maxsize=4)  # a search swims batch after batch with the same gait
def _shared(task: _Task) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return what a lane kernel needs to know of each step, flat (steps, columns), and of all steps, (``UNIFORM``,)."""
    follower = GaitFollower(task.fish.driven_joints, task.ramp_time, as_asked=True)
    follower.command(task.gait, 0.0)
    motion = follower.motion(np.linspace(task.step, task.duration, task.steps))
    window = task.window_weights(task.steps + 1, task.first_step)[1:]
    path = np.full(task.steps, task.step)
    path[-1] *= 0.5
    angle, rate, acceleration = np.moveaxis(motion, 2, 0)
    drives = np.stack((np.sin(angle), np.cos(angle), rate, acceleration), axis=2)
    real = np.float64 if task.precision == "double" else np.float32
    table = np.column_stack((window, path, drives.reshape(task.steps, -1)))
    body = build_chain(task.fish, Fin()).body_vector()
    uniform = np.array([*body, task.step, _tow_speed(task)])
    return np.asarray(table, dtype=real).ravel(), np.asarray(uniform, dtype=real)


def _lane_figures(task: _Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the figures of one block of fins of equal segments and hinges, shape (n, figures)."""
    links = _links(task.fish, fins)
    count, size = links["length"].shape
    driven = task.fish.driven_joints
    form = lane_kernel.Form(
        driven,
        size,
        task.clamp == "free",
        task.reactive == "distributed",
        bool(np.any(links["root_height"] != links["tip_height"])),
        task.precision,
    )
    kernel = lane_kernel.generate(form)
    reach = lane_kernel.HINGE_REACH * task.step
    constants = _lane_links(links, task.fish.water)
    constants |= {name: links[name] for name in ("stiffness", "damping")}
    constants["compliance"] = reach * (reach * links["stiffness"] + links["damping"])
    columns = [constants[name.rpartition("_")[0]][:, int(name.rpartition("_")[2])] for name in kernel.parameters]
    real = np.float64 if task.precision == "double" else np.float32
    chunks = -(-count // form.lanes)
    padded = np.minimum(np.arange(chunks * form.lanes), count - 1)
    parameters = np.array(columns, dtype=real)[:, padded].reshape(len(columns), chunks, form.lanes)
    results = np.empty(chunks * len(kernel.results) * form.lanes, dtype=real)
    table, uniform = _shared(task)
    kernel.advance(
        np.ascontiguousarray(parameters.swapaxes(0, 1)).ravel(), table, uniform, results, 0, chunks, task.steps
    )
    by_fish = results.reshape(chunks, -1, form.lanes).swapaxes(0, 1).reshape(-1, chunks * form.lanes)[:, :count]
    return _figures(task, dict(zip(kernel.results, by_fish.astype(float), strict=True)))


def _tow_speed(task: _Task) -> float:
    return task.tow_speed if task.clamp == "towed" else 0.0


def _figures(task: _Task, left: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the columns of ``_FIGURES`` from what a lane kernel left, shape (n, figures)."""
    nothing = np.zeros_like(left["thrust_sum"])
    speed, sound = _tow_speed(task), nothing
    for value in left.values():
        sound = sound + 0.0 * value  # NaN where anything is not finite
    x = left.get("x_sum", nothing + speed * task.duration)
    y = left.get("y_sum", nothing)
    columns = {
        "mean_speed": np.hypot(x, y) / task.duration,
        "mean_forward_speed": left.get("surge_sum", nothing + speed),
        "thrust": left["thrust_sum"],
        "servo_power": left["power_sum"],
        "x": x,
        "y": y,
        "heading": left.get("heading", nothing),
    }
    return np.column_stack([columns[name] + sound for name in _FIGURES])


def _general_figures(task: _Task, fin: Fin) -> NDArray[np.float64]:
    """Return the figures of one fin by the general kernel, shape (figures,); NaN if it diverged."""
    chain = build_chain(task.fish, fin, reactive=task.reactive, clamp=task.clamp, tow_speed=task.tow_speed)
    try:
        swum = swim_chain(
            chain,
            task.gait,
            task.duration,
            ramp_time=task.ramp_time,
            step=min(task.step, GENERAL_STEP),
            sample_time=task.step,
        )
    except StepError:
        return np.full(len(_FIGURES), np.nan)
    weights = task.window_weights(len(swum.time), task.first_step)
    forward = np.stack((np.cos(swum.heading), np.sin(swum.heading)), axis=1)
    figures = {
        "mean_speed": swum.mean_speed,
        "mean_forward_speed": weights @ swum.surge,
        "thrust": weights @ np.sum(swum.convective_force * forward, axis=1),
        "servo_power": weights @ swum.servo_power,
        "x": swum.x[-1],
        "y": swum.y[-1],
        "heading": swum.heading[-1],
    }
    return np.array([figures[name] for name in _FIGURES])


@lru_cache(maxsize=64)
def _task(
    fish: Fish,
    gait: Gait,
    duration: float,
    reactive: str,
    clamp: str,
    tow_speed: float,
    ramp_time: float,
    settle: float,
    step: float | None,
    precision: str,
) -> _Task:
    """Check what all fins share."""
    duration = checks.number("duration", duration, 0.0, 1e5, unit="s", exclusive_minimum=True)
    settle = checks.number("settle", settle, 0.0, duration, unit="s")
    fastest = max(joint.frequency for joint in gait.joints)
    if step is None:
        step = min(LONGEST_STEP, 1.0 / (STEPS_A_BEAT * fastest) if fastest > 0.0 else LONGEST_STEP)
    step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
    if len(gait.joints) != fish.driven_joints:
        msg = f"gait has {len(gait.joints)} rows, the tail has {fish.driven_joints} driven joints: give one row a joint"
        raise ValueError(msg)
    steps = max(1, int(np.ceil(duration / step - 1e-9)))
    return _Task(
        fish=fish,
        gait=gait,
        duration=duration,
        steps=steps,
        first_step=min(round(settle / duration * steps), steps - 1),
        reactive=cast("Reactive", checks.choice("reactive", reactive, REACTIVE_FORMS)),
        clamp=cast("Clamp", checks.choice("clamp", clamp, CLAMPS)),
        tow_speed=checks.number("tow_speed", tow_speed, unit="m/s"),
        ramp_time=checks.number("ramp_time", ramp_time, 0.0, unit="s"),
        precision=cast("Precision", checks.choice("precision", precision, tuple(lane_kernel.LANES))),
    )


def _work(
    task: _Task, columns: Mapping[str, NDArray[np.generic]], chosen: NDArray[np.bool_]
) -> Iterable[tuple[bool, NDArray[np.intp]]]:
    """Return pieces of work: whether by lanes, and the fins' indices; a piece in lanes has equal segments and hinges.

    Whether a fin swims in lanes depends on itself and on what all share, never on the other fins of the batch.
    """
    damped = columns["damping_time"].astype(float) >= lane_kernel.LEAST_DAMPING * task.step
    for hinges in np.unique(columns["hinges"][chosen]):
        for segments in np.unique(columns["segments"][chosen]).astype(int):
            same = chosen & (columns["hinges"] == hinges) & (columns["segments"] == segments)
            passive = segments - 1 if hinges == "between" else segments
            lanes = same & (damped | (passive == 0))
            if passive + task.fish.driven_joints > LONGEST_LANE_CHAIN:
                lanes = np.zeros_like(same)
            straight = columns["height"] == columns["tip_height"]
            for kind in (lanes & straight, lanes & ~straight):
                indices = np.flatnonzero(kind)
                yield from ((True, indices[start : start + _BLOCK]) for start in range(0, len(indices), _BLOCK))
            yield from ((False, index[None]) for index in np.flatnonzero(same & ~lanes))


def swim_batch(
    fins: Sequence[Fin] | FinColumns,
    fish: Fish = PAPER_FISH,
    gait: Gait = PAPER_GAIT,
    duration: float = 10.0,
    *,
    reactive: Reactive = "distributed",
    clamp: Clamp = "free",
    tow_speed: float = 0.0,
    ramp_time: float = RAMP_TIME,
    settle: float = 0.0,
    step: float | None = None,
    precision: Precision = "double",
    threads: int | None = None,
) -> BatchSwim:
    """Swim a fish from rest with each of many fins.

    A fin's result depends on nothing but itself: not on the other fins, their order or the number of threads.

    Args:
        fins: The fins, or columns of their attributes (shape (n,), or one value for all; what is not given is the paper
            fin's), which spares building n objects. A fin that `Fin` would not accept gets the status ``REFUSED``.
        fish: The fish.
        gait: The gait, one row for each driven joint.
        duration: s.
        reactive: ``distributed`` or ``tip``, see `Chain`.
        clamp: ``free``, ``fixed`` or ``towed``.
        tow_speed: m/s, for ``towed``.
        ramp_time: Time in which the gait starts, s.
        settle: Time from the start to the window over which means are taken, s; rounded to a step.
        step: Longest time step, s; where none is given 1/56 beat, 20 ms at most.
        precision: Of the arithmetic in lanes, ``double`` or ``single`` (half the time, 1e-5 of the speed).
        threads: Number of threads; where none is given one a core.

    Raises:
        ValueError: An argument other than a fin that is refused; the message names it.
    """
    task = _task(fish, gait, duration, reactive, clamp, tow_speed, ramp_time, settle, step, precision)
    columns = fin_columns(fins)
    good = accepted(columns)
    figures = np.full((len(good), len(_FIGURES)), np.nan)
    status = np.where(good, Status.OK, Status.REFUSED).astype(np.int8)

    def swim(piece: tuple[bool, NDArray[np.intp]]) -> None:
        in_lanes, indices = piece
        if in_lanes:
            figures[indices] = _lane_figures(task, {name: column[indices] for name, column in columns.items()})
        else:
            try:
                figures[indices] = _general_figures(task, _fin(columns, int(indices[0])))
            except ValueError:
                status[indices] = Status.REFUSED

    pieces = list(_work(task, columns, good))
    workers = checks.whole_number("threads", threads or os.cpu_count() or 1, 1)
    if workers == 1 or len(pieces) <= 1:
        for piece in pieces:
            swim(piece)
    else:
        with ThreadPoolExecutor(min(workers, len(pieces))) as pool:
            list(pool.map(swim, pieces))
    status[(status == Status.OK) & ~np.isfinite(figures).all(axis=1)] = Status.DIVERGED
    figures[status != Status.OK] = np.nan
    return BatchSwim(columns, status, **dict(zip(_FIGURES, figures.T, strict=True)))
