"""Divide the fins among threads, and swim each in lanes or by the general kernel."""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from fin_plant import checks, validity
from fin_plant.gait import PAPER_GAIT, Gait
from fin_sim.batch.columns import accepted, fin_columns, with_gaits
from fin_sim.batch.general_kernel import swim_by_general_kernel
from fin_sim.batch.lanes import swim_in_lanes
from fin_sim.batch.links import least_damping_times, piece_counts
from fin_sim.batch.plane import swim_in_plane
from fin_sim.batch.proven import proven_fins
from fin_sim.batch.result import FIGURES, LARGEST_ANGLE, OF_A_MOTOR, BatchSwim, Status
from fin_sim.batch.step import LEAST_DAMPING
from fin_sim.batch.task import checked_task, first_steps
from fin_sim.chain import MAXIMUM_LINKS
from fin_sim.swim import PAPER_FISH, RAMP_TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from fin_plant.fin import Fin
    from fin_sim.batch.columns import FinColumns
    from fin_sim.batch.task import Precision, Task
    from fin_sim.chain import Clamp, Reactive
    from fin_sim.fish import Fish

_BLOCK = 2048
"""Fins set up at a time by one thread: what bounds the memory, some 2 MB a thread, 10 for the longest chains."""


_RUNGS, _MOST_DOUBLINGS = 4, 14
"""Numbers of steps that fins with gaits of their own may have for each doubling: the more, the fewer fins share one."""
_STEP_PARTS = (1, 2, 4)
"""Parts of the task's step with which lanes begin, where hinges have too little damping for the whole of it."""


@dataclass(frozen=True)
class _Piece:
    """Fins, by their indices, that one thread swims at a time; in lanes they have equal segments, hinges and steps.

    ``parts`` is into how many parts the task's step is divided in lanes; 0 stands for the general kernel.
    """

    task: Task
    indices: NDArray[np.intp]
    parts: int
    proven: bool = False


def _tasks(task: Task, steps: NDArray[np.intp]) -> dict[int, Task]:
    """Return the task with each of these numbers of steps."""
    return {int(count): replace(task, steps=int(count)) for count in np.unique(steps)}


def _steps(task: Task, columns: Mapping[str, NDArray[np.generic]], step: float | None) -> NDArray[np.intp]:
    """Return the number of the first steps of each fin, shape (n,): its gait's, rounded up to one that many share."""
    least = np.full(len(columns["length"]), task.steps)
    if task.gait is None and step is None:
        wanted = task.duration / first_steps(task.gaits(columns), task.ramp_time, task.fish.water.wake)
        with np.errstate(all="ignore"):  # a gait that is refused may be anything
            rung = np.ceil(_RUNGS * np.log2(wanted / task.steps) - 1e-9)
        rung = np.clip(np.nan_to_num(rung), 0.0, _RUNGS * _MOST_DOUBLINGS)
        least = np.ceil(task.steps * 2.0 ** (rung / _RUNGS)).astype(np.intp)
    return least


def _pieces(
    task: Task, columns: Mapping[str, NDArray[np.generic]], steps: NDArray[np.intp], chosen: NDArray[np.bool_]
) -> Iterable[_Piece]:
    """Divide the work.

    How a fin swims depends on itself and on what all share, never on the other fins of the batch.
    """
    longest = least_damping_times(columns) / LEAST_DAMPING
    between = columns["hinges"] == "between"
    segments = columns["segments"].astype(np.intp)
    passive = segments - between
    parts = np.select([longest >= task.duration / steps / each for each in _STEP_PARTS], _STEP_PARTS)
    parts = np.where(passive > 0, parts, 1)
    # The motor's equations and a matrix of added mass are the general kernel's alone; no chain can have more links.
    general = task.fish.motor is not None or task.fish.water.has_matrix or task.fish.water.model == "ideal_2d"
    parts[(passive + task.fish.driven_joints > MAXIMUM_LINKS) | general] = 0
    straight = columns["height"] == columns["tip_height"]
    key = np.column_stack(
        (steps, between, segments, parts, proven_fins(task, columns), straight, piece_counts(columns))
    )
    kinds, which = np.unique(key[chosen], axis=0, return_inverse=True)
    tasks, rows = _tasks(task, steps[chosen]), np.flatnonzero(chosen)
    for number, (count, _, _, first, known, _, _) in enumerate(kinds.tolist()):
        indices = rows[which.ravel() == number]
        size = _BLOCK if first else 1
        for start in range(0, len(indices), size):
            yield _Piece(tasks[count], indices[start : start + size], first, bool(known))


def swim_batch(
    fins: Sequence[Fin] | FinColumns,
    fish: Fish = PAPER_FISH,
    gait: Gait | ArrayLike = PAPER_GAIT,
    duration: float = 10.0,
    *,
    reactive: Reactive = "distributed",
    clamp: Clamp = "free",
    tow_speed: float = 0.0,
    ramp_time: float = RAMP_TIME,
    settle: float = 0.0,
    whole_beats: bool = False,
    step: float | None = None,
    precision: Precision = "double",
    threads: int | None = None,
) -> BatchSwim:
    """Swim a fish from rest with each of many fins.

    A fin's result depends on nothing but itself: not on the other fins, their order or the number of threads.

    Args:
        fins: The fins, or columns of their attributes (shape (n,), or one value for all; what is not given is the
            default fin's), which spares building n objects. A fin that `Fin` would not accept gets the status
            ``REFUSED``.
        fish: The fish.
        gait: The gait, one row for each driven joint; or a gait for each fin, shape (n, joints, 4), each as
            `Gait.rows`. A gait that cannot be gives the status ``REFUSED`` too.
        duration: s.
        reactive: ``distributed`` or ``tip``, see `Chain`.
        clamp: ``free``, ``fixed`` or ``towed``.
        tow_speed: m/s, for ``towed``.
        ramp_time: Time in which the gait starts, s.
        settle: Time from the start to the window over which means are taken, s; a window of no length ends the swim.
        whole_beats: Whether means are taken over the whole beats of a fin's quickest joint that end with the window, as
            many as it has; over the window where it has none.
        step: Longest first time step, s; where none is given 1/56 beat, 20 ms at most, and less for a short ramp.
            Fins whose figures it leaves in doubt swim at shorter ones.
        precision: Of the arithmetic in lanes, ``double`` or ``single`` (half the time, 1e-5 of the speed).
        threads: Number of threads; where none is given one a core.

    Raises:
        ValueError: An argument other than a fin that is refused; the message names it.
    """
    shared = gait if isinstance(gait, Gait) else None
    timing = (ramp_time, settle, step, precision, whole_beats)
    task = checked_task(fish, shared, duration, reactive, clamp, tow_speed, *timing)
    columns = fin_columns(fins)
    if not isinstance(gait, Gait):
        columns = with_gaits(columns, gait, fish.driven_joints)
    workers = checks.whole_number("threads", threads or os.cpu_count() or 1, 1)
    return _result(columns, *_swim_columns(task, columns, step, workers))


def _swim_columns(
    task: Task, columns: dict[str, NDArray[np.generic]], step: float | None, workers: int
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Swim all fins, in lanes as far as they can; return their figures, shape (n, figures), and status, shape (n,)."""
    good = accepted(columns)
    figures = np.full((len(good), len(FIGURES)), np.nan)
    status = np.where(good, Status.OK, Status.REFUSED).astype(np.int8)

    def swim(piece: _Piece) -> None:
        own = {name: column[piece.indices] for name, column in columns.items()}
        figures[piece.indices], status[piece.indices] = _swim_piece(piece, own)

    pieces = list(_pieces(task, columns, _steps(task, columns, step), good))
    _run(swim, pieces, workers)
    _run(swim, _unsettled(pieces, status), workers)
    if not task.fish.motor:
        figures[:, [FIGURES.index(name) for name in OF_A_MOTOR]] = np.nan
    return figures, status


def _swim_piece(
    piece: _Piece, fins: Mapping[str, NDArray[Any]]
) -> tuple[NDArray[np.float64] | float, NDArray[np.int8] | Status]:
    """Swim a piece's fins; return their figures, shape (n, figures), and their status, shape (n,) or one for all."""
    if piece.parts:
        figures, right = swim_in_lanes(piece.task.refined(piece.parts), fins, piece.proven)
        return figures, np.where(right, Status.OK, Status.NOT_CONVERGED).astype(np.int8)
    alone = swim_in_plane if piece.task.fish.water.model == "ideal_2d" else swim_by_general_kernel
    try:
        return alone(piece.task, fins)
    except ValueError:
        return np.nan, Status.REFUSED


def _unsettled(pieces: Sequence[_Piece], status: NDArray[np.int8]) -> list[_Piece]:
    """Return what lanes at their shortest step did not settle, each fin for the general kernel."""
    return [
        _Piece(piece.task, piece.indices[at : at + 1], parts=0)
        for piece in pieces
        if piece.parts
        for at in np.flatnonzero(status[piece.indices] != Status.OK)
    ]


def _result(
    columns: dict[str, NDArray[np.generic]], figures: NDArray[np.float64], status: NDArray[np.int8]
) -> BatchSwim:
    """Return the result: a fin that folded is told, and figures of a swim that is not OK are taken away."""
    folded = np.isin(status, (Status.OK, Status.NOT_CONVERGED)) & (figures[:, LARGEST_ANGLE] > validity.FOLDED_ANGLE)
    status[folded] = Status.FOLDED
    for name, column in zip(FIGURES, figures.T, strict=True):
        told = folded | (status == Status.BEYOND_TABLE)
        column[(status != Status.OK) & ~(told & (name == "largest_hinge_angle"))] = np.nan
    return BatchSwim(columns, status, **dict(zip(FIGURES, figures.T, strict=True)))


def _run(swim: Callable[[_Piece], None], pieces: Sequence[_Piece], workers: int) -> None:
    with contextlib.ExitStack() as held:
        if not all(piece.parts for piece in pieces):
            # Threads of the general kernel's matrix exponential take the cores from each other: four times as long.
            held.enter_context(threadpool_limits(1, user_api="blas"))
        if workers == 1 or len(pieces) <= 1:
            for piece in pieces:
                swim(piece)
        else:
            with ThreadPoolExecutor(min(workers, len(pieces))) as pool:
                list(pool.map(swim, pieces))
