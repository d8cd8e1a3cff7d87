"""The map of the batch's errors: over all that a space may name no row is silently wrong.

Rows are drawn from cells of frequency and Young's modulus; all else is drawn over its whole range: amplitude to 60
degrees, length 4 to 14 cm, heights of every shape, one to twenty segments, either kind of hinges. Each fish has its own
gait, and all of a band of frequencies swim as one batch. The general kernel at ever shorter steps judges them.

``python -m pytest tests/unit/test_batch_map.py -m long -s`` prints the map.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_sim.batch import Status, swim_batch
from fin_sim.batch.columns import fin_columns, with_gaits
from fin_sim.batch.general_kernel import swim_by_general_kernel
from fin_sim.batch.result import FIGURES
from fin_sim.batch.task import checked_task
from fin_sim.batch.tolerances import difference, error_floors
from support.paper_fish import FISH, paper_columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

FREQUENCIES = ((0.1, 0.3), (0.3, 1.0), (1.0, 3.0), (3.0, 10.0))  # Hz
BEATS = 3.0
"""Of the slowest fish of a band; the means are over the last third of its swim."""
MODULI = ((1e7, 1e8), (1e8, 1e9), (1e9, 1e10), (1e10, 2e11))  # Pa
RAMP = 0.5
"""Of the slowest beat."""


@dataclass(frozen=True)
class Cell:
    """What became of the rows of a cell.

    Attributes:
        rows: How many there are.
        told: How many have no figures and say so.
        unjudged: How many have figures where the general kernel settles on none.
        worst: Largest error over the tolerance of the others.
        shares: Processor time of the batch's rows, s, those of all moduli of the band alike.
    """

    rows: int
    told: int
    unjudged: int
    worst: float
    shares: float


def log_uniform(random: np.random.Generator, ends: tuple[float, float], count: int) -> NDArray[np.float64]:
    return np.exp(random.uniform(math.log(ends[0]), math.log(ends[1]), count))


def drawn(band: tuple[float, float], count: int, *, one_form: bool) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Return columns of fins, so many of each range of E, and their gaits."""
    random = np.random.default_rng(round(1000 * band[0]))
    rows = count * len(MODULI)
    moduli = np.concatenate([log_uniform(random, ends, count) for ends in MODULI])
    height = random.uniform(0.01, 0.04, rows)
    tip = height * np.exp(random.uniform(-math.log(3.0), math.log(3.0), rows))
    segments = random.integers(2 if one_form else 1, 21, rows)
    columns = paper_columns(
        young_modulus=moduli,
        length=random.uniform(0.04, 0.14, rows),
        height=height,
        tip_height=tip if one_form else np.where(random.random(rows) < 0.3, height, tip),
        thickness=random.choice([2e-4, 5e-4, 1.2e-3], rows),
        damping_time=random.choice([0.005, 0.015, 0.04], rows),
        segments=segments,
        hinges=np.where(random.random(rows) < 0.5, "between", "midpoint"),
    )
    gaits = np.zeros((rows, 1, 4))
    gaits[:, 0, 0] = np.radians(random.uniform(3.0, 60.0, rows))
    gaits[:, 0, 1] = log_uniform(random, band, rows)
    gaits[:, 0, 2] = random.uniform(-math.pi, math.pi, rows)
    gaits[:, 0, 3] = np.where(random.random(rows) < 0.2, np.radians(random.uniform(-20.0, 20.0, rows)), 0.0)
    return columns, gaits


def band_of_the_map(band: tuple[float, float], count: int, *, one_form: bool = False) -> list[Cell]:
    """Return the cells of a band of frequencies, one a range of E."""
    columns, gaits = drawn(band, count, one_form=one_form)
    duration, ramp = BEATS / band[0], RAMP / band[0]
    settle = duration * 2.0 / 3.0
    swum = swim_batch(columns, FISH, gaits, duration, ramp_time=ramp, settle=settle, threads=1)  # may compile
    begun = time.thread_time()
    swum = swim_batch(columns, FISH, gaits, duration, ramp_time=ramp, settle=settle, threads=1)
    took = (time.thread_time() - begun) / len(swum)
    task = checked_task(FISH, None, duration, "distributed", "free", 0.0, ramp, settle, None, "double")
    fins = with_gaits(fin_columns(columns), gaits, 1)
    errors, unjudged = np.zeros(len(swum)), np.zeros(len(swum), dtype=bool)
    for row in np.flatnonzero(swum.status == Status.OK):
        own = {name: column[row : row + 1] for name, column in fins.items()}
        exact, status = swim_by_general_kernel(task, own)
        figures = np.array([[getattr(swum, name)[row] for name in FIGURES]])
        unjudged[row] = status[0] != Status.OK
        if not unjudged[row]:
            errors[row] = difference(np.nan_to_num(figures), exact, error_floors(task, own))[0]
    told = swum.status != Status.OK
    assert not np.isfinite(swum.mean_speed[told]).any()
    assert all(swum.reason(int(row)) for row in np.flatnonzero(told))
    parts = [slice(count * place, count * (place + 1)) for place in range(len(MODULI))]
    return [
        Cell(count, int(told[part].sum()), int(unjudged[part].sum()), float(errors[part].max()), took) for part in parts
    ]


@pytest.mark.parametrize("band", [FREQUENCIES[1], FREQUENCIES[3]])
def test_no_row_of_the_reduced_map_is_silently_wrong(band: tuple[float, float]) -> None:
    cells = band_of_the_map(band, 2, one_form=True)
    assert max(cell.worst for cell in cells) < 1.0
    assert not any(cell.unjudged for cell in cells)
    assert sum(cell.told for cell in cells) < 0.5 * sum(cell.rows for cell in cells)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_no_row_of_the_map_is_silently_wrong() -> None:
    heads = (
        "frequency, Hz | E, GPa | rows | without figures, said so | not judged | largest error over the tolerance | ms"
    )
    sys.stdout.write(f"\n| {heads} |\n{'|---' * 7}|\n")
    every = []
    for band in FREQUENCIES:
        for ends, cell in zip(MODULI, band_of_the_map(band, 8), strict=True):
            low, high = (f"{end / 1e9:g}" for end in ends)
            frequencies, own = (
                f"{band[0]:g} to {band[1]:g}",
                f"{cell.told} | {cell.unjudged} | {cell.worst:.2f} | {1e3 * cell.shares:.1f}",
            )
            sys.stdout.write(f"| {frequencies} | {low} to {high} | {cell.rows} | {own} |\n")
            sys.stdout.flush()
            every.append(cell)
    assert max(cell.worst for cell in every) < 1.0
    assert sum(cell.unjudged for cell in every) <= 0.02 * sum(cell.rows for cell in every)
