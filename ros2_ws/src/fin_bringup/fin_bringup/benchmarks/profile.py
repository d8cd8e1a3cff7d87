"""Where a batch's time goes: set-up and steps, operations of a step, and their rate against the machine's limit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_bringup.benchmarks.measuring import DURATION, MANY, batch, core_time
from fin_sim.batch.kernel import generate
from fin_sim.batch.step import Form
from fin_sim.compiled import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_bringup.benchmarks.measuring import Sizes

_MICRO = 1e6


def operations() -> dict[str, float]:
    """Return what a step of one paper fish costs in floating-point operations, by kind."""
    form = Form(1, 3, free=True, distributed=False, tapered=False)
    return {kind: float(number) for kind, number in generate(form).operations.items()}


@kernel
def _multiply_add(work: NDArray[np.float64], factor: float, rounds: int) -> None:
    """Do 2 x 16 x len(work) x rounds operations with hardly a load between them; len(work) is a multiple of 64."""
    for _ in range(rounds):
        for i in range(64):
            x = work[i]
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            work[i] = x


def profile(sizes: Sizes) -> dict[str, float]:
    """Return where a batch's time goes, the rate of operations that its kernel reaches, and the machine's limit."""
    count = MANY
    total = core_time(batch(count), sizes.repeats)
    short = core_time(batch(count, duration=0.02), sizes.repeats)
    steps = int(np.ceil(DURATION * 56 * 0.9))
    done = sum(operations().values()) * steps * count
    work, rounds = np.zeros(64), 100_000
    limit = 2 * 16 * 64 * rounds / core_time(lambda: _multiply_add(work, 1e-9, rounds), sizes.repeats)
    return {
        "core_us_per_swim": total / count * _MICRO,
        "set_up_us_per_swim": short / count * _MICRO,
        "ns_per_step_of_a_fish": (total - short) / count / steps * 1e9,
        "operations_per_step": sum(operations().values()),
        "gflops": done / (total - short) / 1e9,
        "gflops_limit": limit / 1e9,
        "share_of_limit": done / (total - short) / limit,
    }
