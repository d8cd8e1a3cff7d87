"""Divide the fins among threads, and swim each in lanes or by the general kernel."""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from fin_plant import checks, validity
from fin_plant.gait import PAPER_GAIT
from fin_sim.batch.columns import PROFILE, accepted, fin_columns
from fin_sim.batch.general_kernel import swim_by_general_kernel
from fin_sim.batch.lanes import swim_in_lanes
from fin_sim.batch.links import least_damping_times
from fin_sim.batch.proven import proven_fins
from fin_sim.batch.result import FIGURES, LARGEST_ANGLE, OF_A_MOTOR, BatchSwim, Status
from fin_sim.batch.step import LEAST_DAMPING
from fin_sim.batch.task import checked_task
from fin_sim.chain import MAXIMUM_LINKS
from fin_sim.swim import PAPER_FISH, RAMP_TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_plant.gait import Gait
    from fin_sim.batch.columns import FinColumns
    from fin_sim.batch.task import Precision, Task
    from fin_sim.chain import Clamp, Reactive
    from fin_sim.fish import Fish

_BLOCK = 2048
"""Fins set up at a time by one thread: what bounds the memory, some 2 MB a thread, 10 for the longest chains."""


_STEP_PARTS = (1, 2, 4)
"""Parts of the task's step with which lanes begin, where hinges have too little damping for the whole of it."""


@dataclass(frozen=True)
class _Piece:
    """Fins, by their indices, that one thread swims at a time; in lanes they have equal segments and hinges.

    ``parts`` is into how many parts the task's step is divided in lanes; 0 stands for the general kernel.
    """

    indices: NDArray[np.intp]
    parts: int
    proven: bool = False


def _pieces(task: Task, columns: Mapping[str, NDArray[np.generic]], chosen: NDArray[np.bool_]) -> Iterable[_Piece]:
    """Divide the work.

    How a fin swims depends on itself and on what all share, never on the other fins of the batch.
    """
    longest = least_damping_times(columns) / LEAST_DAMPING
    least_parts = np.select([longest >= task.step / parts for parts in _STEP_PARTS], _STEP_PARTS)
    straight = columns["height"] == columns["tip_height"]
    profiled = np.zeros(len(chosen), dtype=bool)
    for name in PROFILE:
        if name in columns:
            profiled |= np.array([len(profile) > 0 for profile in columns[name]], dtype=bool)
    proven = proven_fins(task, columns)
    for hinges in np.unique(columns["hinges"][chosen]):
        for segments in np.unique(columns["segments"][chosen]).astype(int):
            same = chosen & (columns["hinges"] == hinges) & (columns["segments"] == segments)
            passive = segments - 1 if hinges == "between" else segments
            parts = np.where(profiled, 0, least_parts if passive else 1)
            if task.fish.motor or passive + task.fish.driven_joints > MAXIMUM_LINKS:  # which no chain can have
                parts = np.zeros_like(parts)
            for first, known, plain in product((*_STEP_PARTS, 0), (True, False), (True, False)):
                indices = np.flatnonzero(same & (parts == first) & (proven == known) & (straight == plain))
                size = _BLOCK if first else 1
                starts = range(0, len(indices), size)
                yield from (_Piece(indices[start : start + size], first, known) for start in starts)


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
        fins: The fins, or columns of their attributes (shape (n,), or one value for all; what is not given is the
            default fin's), which spares building n objects. A fin that `Fin` would not accept gets the status
            ``REFUSED``.
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
    task = checked_task(fish, gait, duration, reactive, clamp, tow_speed, ramp_time, settle, step, precision)
    columns = fin_columns(fins)
    good = accepted(columns)
    figures = np.full((len(good), len(FIGURES)), np.nan)
    status = np.where(good, Status.OK, Status.REFUSED).astype(np.int8)

    def swim(piece: _Piece) -> None:
        fins = {name: column[piece.indices] for name, column in columns.items()}
        if piece.parts:
            figures[piece.indices], right = swim_in_lanes(task.refined(piece.parts), fins, piece.proven)
            status[piece.indices] = np.where(right, Status.OK, Status.NOT_CONVERGED)
            return
        try:
            figures[piece.indices], status[piece.indices] = swim_by_general_kernel(task, fins)
        except ValueError:
            status[piece.indices] = Status.REFUSED

    workers = checks.whole_number("threads", threads or os.cpu_count() or 1, 1)
    pieces = list(_pieces(task, columns, good))
    _run(swim, pieces, workers)
    _run(swim, _unsettled(pieces, status), workers)
    if not task.fish.motor:
        figures[:, [FIGURES.index(name) for name in OF_A_MOTOR]] = np.nan
    return _result(columns, figures, status)


def _unsettled(pieces: Sequence[_Piece], status: NDArray[np.int8]) -> list[_Piece]:
    """Return what lanes at their shortest step did not settle, each fin for the general kernel."""
    lanes = np.concatenate([piece.indices for piece in pieces if piece.parts] or [np.zeros(0, dtype=np.intp)])
    return [_Piece(lanes[at : at + 1], parts=0) for at in np.flatnonzero(status[lanes] != Status.OK)]


def _result(
    columns: dict[str, NDArray[np.generic]], figures: NDArray[np.float64], status: NDArray[np.int8]
) -> BatchSwim:
    """Return the result: a fin that folded is told, and figures of a swim that is not OK are taken away."""
    folded = np.isin(status, (Status.OK, Status.NOT_CONVERGED)) & (figures[:, LARGEST_ANGLE] > validity.FOLDED_ANGLE)
    status[folded] = Status.FOLDED
    for name, column in zip(FIGURES, figures.T, strict=True):
        column[(status != Status.OK) & ~(folded & (name == "largest_hinge_angle"))] = np.nan
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
