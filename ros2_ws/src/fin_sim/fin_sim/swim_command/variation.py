"""Many swims on all cores, one by one, and what is kept of each."""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from fin_plant import validity
from fin_sim.swim_command.figures import FIGURES
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from fin_sim.swim_command.plan import SwimPlan

Cell = Any
"""What a row of a variation holds: a number, a word that varies, or None."""


@dataclass(frozen=True)
class Swum:
    """What a variation keeps of a swim.

    Attributes:
        figures: Each of `FIGURES` by name; None where it is not defined, or the swim failed.
        warnings: What to know before they are believed.
        failure: Why the swim failed, or empty.
    """

    figures: Mapping[str, float | None]
    warnings: Sequence[str] = ()
    failure: str = ""


def swim_one(plan: SwimPlan) -> Swum:
    """Swim a plan and return its figures, or why there are none."""
    try:
        swum = plan.swim()
        validity.refuse_folded(swum.largest_hinge_angle)
        return Swum({figure.name: figure.of(swum) for figure in FIGURES}, tuple(swum.warnings))
    except (StepError, validity.FoldedError) as error:
        return Swum({figure.name: None for figure in FIGURES}, failure=str(error))


def cores_of_process() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def swimming_threads(cores: int | None) -> Iterator[ThreadPoolExecutor]:
    """Yield threads to swim in, one a core if None; what they have not begun at the end is not swum."""
    # The kernel runs beside other threads of Python; threads of the matrix exponential would only get in their way.
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(cores or cores_of_process(), "swim") as executor:
        try:
            yield executor
        finally:
            executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def swim_all(plans: Sequence[SwimPlan], cores: int | None = None) -> Iterator[Iterator[Swum]]:
    """Swim plans on all cores; yield their outcomes in order. What is not asked for any more is not swum.

    Args:
        plans: To swim.
        cores: Swims at a time; as many as this process may use if None.
    """
    with swimming_threads(cores) as executor:
        yield executor.map(swim_one, plans)
