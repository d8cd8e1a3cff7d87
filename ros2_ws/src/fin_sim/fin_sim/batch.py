"""Many swims at once: the figures of one swim for each of many fins, on all cores.

Up to `LONGEST_LANE_CHAIN` links the fish swim side by side in the lanes of generated code (`lane_kernel`); longer
chains, fins with a profile, and fins with too little damping for its long steps, each swim by the general kernel
(`swim`), in parallel too.

Every figure is right to `TOLERANCES`, or its swim has none and says so. Near the paper's gait and fins
(`_proven`) one step length is known to be short enough. Everywhere else a fin swims again at half the step, and at a
quarter, until the results have settled (`_settled`); where they have not, the general kernel takes over, which halves
its own step likewise. A fin whose results never settle, such as one that whips chaotically, is
`Status.NOT_CONVERGED`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from fin_plant import checks, validity
from fin_plant.fin import FIN_PARAMETERS, Fin, ProfiledFin
from fin_plant.gait import PAPER_GAIT, Gait, GaitFollower
from fin_sim import lane_kernel
from fin_sim.chain import CLAMPS, REACTIVE_FORMS, Clamp, Reactive, build_chain
from fin_sim.dynamics import StepError
from fin_sim.lane_equations import LaneLink
from fin_sim.swim import PAPER_FISH, RAMP_TIME, swim_chain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from fin_sim.fish import Fish, Water

Precision = Literal["double", "single"]
FinColumns = Mapping[str, "ArrayLike"]

LONGEST_LANE_CHAIN = 12
"""Links up to which code is generated: each link adds a second to the first call's compilation."""
STEPS_A_BEAT = 56.0
LONGEST_STEP = 0.02
"""Default step in s for slow gaits: the paper fins' mean speeds are then within 0.1 % of the converged ones."""
RAMP_STEPS, MOST_STEPS_A_BEAT = 16.0, 224.0
"""Least steps in the gait's ramp, as far as that takes no more than so many a beat."""
GENERAL_STEP = 5e-3
GENERAL_STEPS_A_BEAT, GENERAL_RAMP_STEPS = 100.0, 16.0
"""First step of the fish that swim by the general kernel: at most so long in s, in parts of a beat and of the ramp."""
_PROVEN_AMPLITUDE = (0.17, 0.28)  # rad
_PROVEN_BEATS, _PROVEN_RAMP_BEATS, _PROVEN_DAMPING_BEATS, _PROVEN_STEP = 7.9, 0.44, 0.0085, 1.0 / 55.0
_PROVEN_FREQUENCY_RATIO, _PROVEN_SEGMENTS, _PROVEN_MASS_RATIO = 0.15, 4, 0.05
_PROVEN_ANGLE = 0.25 * np.pi
_LANE_HALVINGS, _GENERAL_HALVINGS = 2, 6
_PAIR, _TRIPLE = 0.1, (1.5, 0.4)
"""Converged are two swims that differ by so much of the tolerance, or three that differ by so much in turn."""
TOLERANCES = {"mean_speed": 1e-3, "mean_forward_speed": 1e-3, "thrust": 3e-3, "servo_power": 3e-3}
"""Largest error of a figure, relative to its size or, where it is nearly 0, to its floor in `_floors`."""
_SPEED_FLOOR, _FORCE_FLOOR = 1e-3, 1e-2
_LEAST_STEPS = 4
_BLOCK = 2048
"""Fins set up at a time by one thread: what bounds the memory, some 2 MB a thread."""


class Status(IntEnum):
    """How a swim of the batch ended."""

    OK = 0
    REFUSED = 1
    DIVERGED = 2
    NOT_CONVERGED = 3
    FOLDED = 4


_REASONS = {
    Status.DIVERGED: (
        "the state stopped being finite at every step tried: use a slower or smaller gait, or a stiffer fin"
    ),
    Status.NOT_CONVERGED: (
        "swims at ever shorter steps do not settle on one result: the fin whips, flutters, or is far too stiff for its "
        "mass; use a slower or smaller gait, or more damping"
    ),
}


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
        largest_hinge_angle: Of any hinge at any time of the swim, rad, shape (n,); also of a fin that is ``FOLDED``.
            Above `validity.BENT_ANGLE` the figures are doubtful.
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
    largest_hinge_angle: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.status)

    def reason(self, index: int) -> str:
        """Return why a swim has no result; empty if it has one."""
        status = Status(self.status[index])
        if status == Status.REFUSED:
            try:
                _fin(self.fins, index)
            except ValueError as error:
                return str(error)
            return "the fin and the fish's peduncle together have more links than a chain can have: use fewer segments"
        if status == Status.FOLDED:
            return validity.folded(float(self.largest_hinge_angle[index]))
        return _REASONS.get(status, "")

    def warnings(self, index: int) -> list[str]:
        """Return what is doubtful in a swim that has a result; see `validity`."""
        if self.status[index] != Status.OK:
            return []
        return validity.warnings(_fin(self.fins, index), float(self.largest_hinge_angle[index]))


_CUBIC = [
    np.polynomial.Polynomial.fromroots(others).integ() / np.prod([node - other for other in others])
    for node in range(4)
    for others in ([other for other in range(4) if other != node],)
]
"""Antiderivatives of the cubics that are 1 at one of four points 0, 1, 2, 3 and 0 at the others."""

_FIGURES = tuple(item.name for item in fields(BatchSwim) if item.name not in {"fins", "status"})


_CHECKED = [_FIGURES.index(name) for name in TOLERANCES]
_LARGEST_ANGLE = _FIGURES.index("largest_hinge_angle")
_PROFILE = ("profile_position", "profile_height")
_NAMES = tuple(item.name for item in fields(Fin))


def _fin(columns: Mapping[str, NDArray[np.generic]], index: int) -> Fin:
    values = {name: columns[name][index].item() for name in _NAMES}
    profile = {name: columns[name][index] for name in _PROFILE if name in columns}
    return ProfiledFin(**values, **profile) if any(map(len, profile.values())) else Fin(**values)


def _profile_column(profiles: Sequence[Sequence[float]]) -> NDArray[np.generic]:
    column = np.empty(len(profiles), dtype=object)
    for index, profile in enumerate(profiles):
        column[index] = tuple(profile)
    return column


def fin_columns(fins: Sequence[Fin] | FinColumns) -> dict[str, NDArray[np.generic]]:
    """Return the fins' attributes as columns of one length, those not given at the paper fin's.

    A profile is the same for all fins of columns; there are columns of profiles only where a fin has one.

    Raises:
        ValueError: A name that is no attribute of a fin, columns of unequal length, or a column that is not numbers.
    """
    columns: dict[str, NDArray[np.generic]]
    if not isinstance(fins, Mapping):
        columns = {name: np.array([getattr(fin, name) for fin in fins]) for name in _NAMES}
        if any(isinstance(fin, ProfiledFin) for fin in fins):
            columns |= {name: _profile_column([getattr(fin, name, ()) for fin in fins]) for name in _PROFILE}
        return columns
    for name in fins:
        FIN_PARAMETERS.require(f"fin.{name}")
    defaults = Fin()
    columns = {}
    for name in _NAMES:
        column = np.atleast_1d(np.asarray(fins.get(name, getattr(defaults, name))))
        if column.dtype.kind not in ("U" if name == "hinges" else "fiu"):
            msg = f"fin.{name} must be a column of {'names' if name == 'hinges' else 'numbers'}, got {column.dtype}"
            raise ValueError(msg)
        columns[name] = column
    try:
        columns = dict(zip(_NAMES, np.broadcast_arrays(*columns.values()), strict=True))
    except ValueError:
        lengths = {f"fin.{name}": column.shape for name, column in columns.items() if column.size > 1}
        msg = f"the columns of the fins have different shapes, {lengths}: give one value each, or one for all"
        raise ValueError(msg) from None
    profile = {name: tuple(map(float, cast("Sequence[float]", fins.get(name, ())))) for name in _PROFILE}
    if any(profile.values()):
        columns |= {name: _profile_column([profile[name]] * len(columns["length"])) for name in _PROFILE}
    return columns


def accepted(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return which fins `Fin` would accept, shape (n,)."""
    good = np.ones(len(columns["length"]), dtype=bool)
    for name in _NAMES:
        column, parameter = columns[name], FIN_PARAMETERS[f"fin.{name}"]
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
    number = {name: fins[name].astype(float)[:, None] for name in _NAMES if name != "hinges"}
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
    settle: float
    reactive: Reactive
    clamp: Clamp
    tow_speed: float
    ramp_time: float
    precision: Precision

    @property
    def step(self) -> float:
        return self.duration / self.steps

    @property
    def fastest(self) -> float:
        """Highest frequency of any joint that moves, Hz."""
        return max(joint.frequency for joint in self.gait.joints)

    @property
    def beat(self) -> float:
        """Duration of the fastest joint's beat, s; infinite where none beats."""
        return 1.0 / self.fastest if self.fastest > 0.0 else np.inf

    @property
    def beating(self) -> float:
        """Largest product of frequency and amplitude of any joint, rad/s."""
        return max(joint.frequency * joint.amplitude for joint in self.gait.joints)

    def refined(self, factor: int) -> _Task:
        """Return the same swim at a step shorter by a factor."""
        return replace(self, steps=self.steps * factor)


def window_weights(samples: int, begin: float) -> NDArray[np.float64]:
    """Return the weights of the mean over a window that ends at the last of evenly spaced samples, shape (samples,).

    They integrate the cubic through the four samples around each interval, so that the window may begin between two.

    Args:
        samples: Number of samples, 4 at least.
        begin: Where the window begins, in intervals after sample 0.
    """
    weights = np.zeros(samples)
    cells = np.arange(int(begin), samples - 1)
    first = np.clip(cells - 1, 0, samples - len(_CUBIC))
    for node, antiderivative in enumerate(_CUBIC):
        integral = antiderivative(cells + 1 - first) - antiderivative(np.maximum(cells, begin) - first)
        np.add.at(weights, first + node, integral)
    return weights / (samples - 1 - begin)


@lru_cache(maxsize=8)  # a search swims batch after batch with the same gait
def _shared(task: _Task) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return what a lane kernel needs to know of each step, flat (steps, columns), and of all steps, (``UNIFORM``,)."""
    follower = GaitFollower(task.fish.driven_joints, task.ramp_time, as_asked=True)
    follower.command(task.gait, 0.0)
    motion = follower.motion(np.linspace(task.step, task.duration, task.steps))
    window = window_weights(task.steps + 1, task.settle / task.step)[1:]
    path = task.duration * window_weights(task.steps + 1, 0.0)[1:]
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
        "largest_hinge_angle": left.get("largest_angle", nothing),
    }
    return np.column_stack([columns[name] + sound for name in _FIGURES])


def _general_figures(task: _Task, fin: Fin, steps: int) -> NDArray[np.float64]:
    """Return the figures of one fin by the general kernel in so many steps, shape (figures,); NaN if it diverged."""
    step = task.duration / steps
    chain = build_chain(task.fish, fin, reactive=task.reactive, clamp=task.clamp, tow_speed=task.tow_speed)
    try:
        swum = swim_chain(chain, task.gait, task.duration, ramp_time=task.ramp_time, step=step, sample_time=step)
    except StepError:
        return np.full(len(_FIGURES), np.nan)
    samples = len(swum.time)
    weights = window_weights(samples, task.settle / task.duration * (samples - 1))
    forward = np.stack((np.cos(swum.heading), np.sin(swum.heading)), axis=1)
    figures = {
        "mean_speed": swum.mean_speed,
        "mean_forward_speed": weights @ swum.surge,
        "thrust": weights @ np.sum(swum.convective_force * forward, axis=1),
        "servo_power": weights @ swum.servo_power,
        "x": swum.x[-1],
        "y": swum.y[-1],
        "heading": swum.heading[-1],
        "largest_hinge_angle": swum.largest_hinge_angle,
    }
    return np.array([figures[name] for name in _FIGURES])


def _floors(task: _Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the sizes below which the errors of `TOLERANCES` count as absolute ones, shape (n, tolerances).

    With U = frequency times amplitude times the fin's length: U / 1000 of a speed; of a force a hundredth of
    pi/4 rho d^2 U^2, the momentum that the water at the fin's largest height d takes up a second at that speed; of
    power this force times the tip's speed 2 pi U.
    """
    length, height, tip = (fins[name].astype(float) for name in ("length", "height", "tip_height"))
    speed = task.beating * length
    force = _FORCE_FLOOR * 0.25 * np.pi * task.fish.water.density * np.maximum(height, tip) ** 2 * speed**2
    size = {
        "mean_speed": _SPEED_FLOOR * speed,
        "mean_forward_speed": _SPEED_FLOOR * speed,
        "thrust": force,
        "servo_power": force * 2.0 * np.pi * speed,
    }
    return np.column_stack([size[name] for name in TOLERANCES])


def _difference(
    coarse: NDArray[np.float64], fine: NDArray[np.float64], floors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the largest difference of each two swims over what is allowed, shape (n,); NaN where there is none."""
    allowed = np.array(list(TOLERANCES.values())) * np.maximum(np.abs(fine[:, _CHECKED]), floors)
    change = np.abs(fine - coarse)[:, _CHECKED]
    # A held body's speed is exactly 0 at any step, and so is what it may differ by where the tail does not beat.
    share = np.divide(change, allowed, out=np.where(change == 0.0, 0.0, np.nan), where=allowed > 0.0)
    return np.asarray(share.max(axis=1))


def _settled(last: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which swims have converged, from the last two differences from halving to halving, shape (n,).

    Two swims may agree by chance while both are wrong: either the first two agree closely, or the last three draw near.
    """
    first = np.isinf(before)
    return np.where(first, last <= _PAIR, (last <= _TRIPLE[1]) & (before <= _TRIPLE[0]))


def _by_lanes(
    task: _Task, fins: Mapping[str, NDArray[np.generic]], proven: bool
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the figures of one block of fins, shape (n, figures), and which of them are right, shape (n,)."""
    figures = _lane_figures(task, fins)
    if proven:
        return figures, figures[:, _LARGEST_ANGLE] <= _PROVEN_ANGLE
    floors = _floors(task, fins)
    right = np.zeros(len(figures), dtype=bool)
    before = np.full(len(figures), np.inf)
    for halving in range(1, _LANE_HALVINGS + 1):
        rest = np.flatnonzero(~right)
        finer = _lane_figures(task.refined(2**halving), {name: column[rest] for name, column in fins.items()})
        last = _difference(figures[rest], finer, floors[rest])
        right[rest] = _settled(last, before[rest])
        figures[rest], before[rest] = finer, last
        if right.all():
            break
    return figures, right


def _by_general_kernel(
    task: _Task, fins: Mapping[str, NDArray[np.generic]]
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Return the figures of one fin by the general kernel, shape (1, figures), and its status, shape (1,)."""
    fin, floors = _fin(fins, 0), _floors(task, fins)
    step = min(GENERAL_STEP, task.step)
    if task.fastest > 0.0:
        step = min(step, 1.0 / (GENERAL_STEPS_A_BEAT * task.fastest))
        if task.ramp_time > 0.0:
            step = min(step, max(task.ramp_time / GENERAL_RAMP_STEPS, 0.1 * step))
    step = min(step, _window_step(task.duration, task.settle))
    steps = max(_LEAST_STEPS, int(np.ceil(task.duration / step)))
    coarse, before = _general_figures(task, fin, steps)[None], np.array([np.inf])
    for halving in range(1, _GENERAL_HALVINGS + 1):
        fine = _general_figures(task, fin, steps * 2**halving)[None]
        last = _difference(coarse, fine, floors)
        if _settled(last, before)[0]:
            return fine, np.array([Status.OK], dtype=np.int8)
        coarse, before = fine, last
    status = Status.NOT_CONVERGED if np.isfinite(coarse).all() else Status.DIVERGED
    return coarse, np.array([status], dtype=np.int8)


def _window_step(duration: float, settle: float) -> float:
    """Return the longest step in s for the window over which means are taken, as far as it has any length."""
    window = duration - settle
    return window / _LEAST_STEPS if window >= 1e-4 * duration else np.inf


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
        if fastest > 0.0 and ramp_time > 0.0:
            step = min(step, max(ramp_time / RAMP_STEPS, 1.0 / (MOST_STEPS_A_BEAT * fastest)))
    step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
    step = min(step, _window_step(duration, settle))
    if len(gait.joints) != fish.driven_joints:
        msg = f"gait has {len(gait.joints)} rows, the tail has {fish.driven_joints} driven joints: give one row a joint"
        raise ValueError(msg)
    steps = max(_LEAST_STEPS, int(np.ceil(duration / step - 1e-9)))
    return _Task(
        fish=fish,
        gait=gait,
        duration=duration,
        steps=steps,
        settle=min(settle, duration - 1e-3 * step),
        reactive=cast("Reactive", checks.choice("reactive", reactive, REACTIVE_FORMS)),
        clamp=cast("Clamp", checks.choice("clamp", clamp, CLAMPS)),
        tow_speed=checks.number("tow_speed", tow_speed, unit="m/s"),
        ramp_time=checks.number("ramp_time", ramp_time, 0.0, unit="s"),
        precision=cast("Precision", checks.choice("precision", precision, tuple(lane_kernel.LANES))),
    )


def _proven(task: _Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return for which fins the default step is known to be short enough, shape (n,).

    The papers' fish and the surroundings of their gait and fins, in numbers without units; the sweep of
    `tests/unit/test_batch_errors.py` swims them against the general kernel.
    """
    count, beat = len(fins["length"]), task.beat
    joint = task.gait.joints[0]
    like_the_papers = (
        task.fish == PAPER_FISH
        and task.clamp != "towed"
        and joint.phase == joint.bias == 0.0
        and _PROVEN_AMPLITUDE[0] <= joint.amplitude <= _PROVEN_AMPLITUDE[1]
        and task.ramp_time >= _PROVEN_RAMP_BEATS * beat
        and task.duration >= _PROVEN_BEATS * beat
        and task.duration - task.settle >= (1.0 - 1e-9) * beat
        and task.step <= _PROVEN_STEP * beat
    )
    if not like_the_papers:
        return np.zeros(count, dtype=bool)
    modulus, length, height, tip, thickness, density, damping = (
        fins[name].astype(float)
        for name in ("young_modulus", "length", "height", "tip_height", "thickness", "density", "damping_time")
    )
    segments = fins["segments"].astype(float)
    virtual = 0.25 * np.pi * task.fish.water.density
    # A hinge's own frequency with the water of a fin that is as high as its highest end over the beat's.
    stiffness = modulus * (height + tip) * thickness**3 * segments / (24.0 * length)
    with np.errstate(all="ignore"):  # a fin that is refused may be of any size
        ratio = np.sqrt(3.0 * stiffness / (virtual * tip**2 * length**3)) * beat / (2.0 * np.pi)
        return np.asarray(
            (ratio >= _PROVEN_FREQUENCY_RATIO)
            & (tip >= height)
            & (tip <= 3.01 * height)
            & (segments <= _PROVEN_SEGMENTS)
            & (damping >= _PROVEN_DAMPING_BEATS * beat)
            & (density * thickness <= _PROVEN_MASS_RATIO * virtual * height)
        )


@dataclass(frozen=True)
class _Piece:
    """Fins, by their indices, that one thread swims at a time; in lanes they have equal segments and hinges."""

    indices: NDArray[np.intp]
    lanes: bool
    proven: bool = False


def _pieces(task: _Task, columns: Mapping[str, NDArray[np.generic]], chosen: NDArray[np.bool_]) -> Iterable[_Piece]:
    """Divide the work.

    How a fin swims depends on itself and on what all share, never on the other fins of the batch.
    """
    damped = columns["damping_time"].astype(float) >= lane_kernel.LEAST_DAMPING * task.step
    straight = columns["height"] == columns["tip_height"]
    profiled = np.zeros(len(chosen), dtype=bool)
    for name in _PROFILE:
        if name in columns:
            profiled |= np.array([len(profile) > 0 for profile in columns[name]], dtype=bool)
    proven = _proven(task, columns)
    for hinges in np.unique(columns["hinges"][chosen]):
        for segments in np.unique(columns["segments"][chosen]).astype(int):
            same = chosen & (columns["hinges"] == hinges) & (columns["segments"] == segments)
            passive = segments - 1 if hinges == "between" else segments
            lanes = same & (damped | (passive == 0)) & ~profiled
            if passive + task.fish.driven_joints > LONGEST_LANE_CHAIN:
                lanes = np.zeros_like(same)
            for known in (True, False):
                for kind in (lanes & (proven == known) & straight, lanes & (proven == known) & ~straight):
                    indices = np.flatnonzero(kind)
                    starts = range(0, len(indices), _BLOCK)
                    yield from (_Piece(indices[start : start + _BLOCK], lanes=True, proven=known) for start in starts)
            yield from (_Piece(index[None], lanes=False) for index in np.flatnonzero(same & ~lanes))


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
        settle: Time from the start to the window over which means are taken, s; a window of no length ends the swim.
        step: Longest first time step, s; where none is given 1/56 beat, 20 ms at most, and less for a short ramp.
            Fins whose figures it leaves in doubt swim at shorter ones.
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

    def swim(piece: _Piece) -> None:
        fins = {name: column[piece.indices] for name, column in columns.items()}
        if piece.lanes:
            figures[piece.indices], right = _by_lanes(task, fins, piece.proven)
            status[piece.indices] = np.where(right, Status.OK, Status.NOT_CONVERGED)
            return
        try:
            figures[piece.indices], status[piece.indices] = _by_general_kernel(task, fins)
        except ValueError:
            status[piece.indices] = Status.REFUSED

    workers = checks.whole_number("threads", threads or os.cpu_count() or 1, 1)
    pieces = list(_pieces(task, columns, good))
    _run(swim, pieces, workers)
    # What lanes at their shortest step did not settle, each fin by the general kernel.
    lanes = np.concatenate([piece.indices for piece in pieces if piece.lanes] or [np.zeros(0, dtype=np.intp)])
    _run(swim, [_Piece(lanes[at : at + 1], lanes=False) for at in np.flatnonzero(status[lanes] != Status.OK)], workers)
    folded = np.isin(status, (Status.OK, Status.NOT_CONVERGED)) & (figures[:, _LARGEST_ANGLE] > validity.FOLDED_ANGLE)
    status[folded] = Status.FOLDED
    for name, column in zip(_FIGURES, figures.T, strict=True):
        column[(status != Status.OK) & ~(folded & (name == "largest_hinge_angle"))] = np.nan
    return BatchSwim(columns, status, **dict(zip(_FIGURES, figures.T, strict=True)))


def _run(swim: Callable[[_Piece], None], pieces: Sequence[_Piece], workers: int) -> None:
    if workers == 1 or len(pieces) <= 1:
        for piece in pieces:
            swim(piece)
    else:
        with ThreadPoolExecutor(min(workers, len(pieces))) as pool:
            list(pool.map(swim, pieces))
