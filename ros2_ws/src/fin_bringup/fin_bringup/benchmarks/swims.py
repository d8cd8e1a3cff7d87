"""Many fish side by side: the core time of a swim and its error, and the time over swims, links and cores."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_bringup.benchmarks.measuring import DURATION, MANY, MODULI, PAPER, batch, core_time, lanes, wall_time
from fin_sim.batch import swim_batch
from fin_sim.swim import swim
from fin_sim.water_settings import PRESETS, Settings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_bringup.benchmarks.measuring import Sizes


def converged(reactive: str) -> NDArray[np.float64]:
    """Return the mean speeds in m/s of the paper fin at ``MODULI`` by the general kernel at 1 ms: converged to 1e-8."""
    fins = [replace(PAPER.fin, young_modulus=modulus) for modulus in MODULI]
    return np.array([swim(fin, PAPER.fish, duration=DURATION, reactive=reactive).mean_speed for fin in fins])  # type: ignore[arg-type]


def methods(sizes: Sizes) -> list[dict[str, Any]]:
    """Return the core time of a swim and its error for every form, precision and some steps of the lanes."""
    rows = []
    for reactive in ("tip", "distributed"):
        exact = converged(reactive)
        for precision in ("double", "single"):
            for step in (0.01, 0.02):
                options = {"reactive": reactive, "precision": precision, "step": step}
                taken = core_time(batch(MANY, **options), sizes.repeats)
                columns = {**vars(PAPER.fin), "young_modulus": MODULI}
                speeds = swim_batch(columns, PAPER.fish, threads=1, **options).mean_speed  # type: ignore[arg-type]
                error = float(np.abs(speeds / exact - 1.0).max())
                rows.append({**options, "core_ms": taken / MANY * 1e3, "error": error})
    return rows


_PRESETS = (PRESETS["paper_simulation"], PRESETS["soleil"], PRESETS["bht"])
_BEYOND_RESONANCE = replace(PAPER.fin, young_modulus=3e9)
"""For the plane flow, in which the preset's own fin folds too far."""
WATERS = (Settings("strip", "lighthill", "on"), Settings("surface_3d", "lighthill", "on"), *_PRESETS)
_IN_A_WATER = 256


def waters(sizes: Sizes) -> list[dict[str, Any]]:
    """Return the core time of a swim in each kind of water: of a study of shapes, and alone by the general kernel."""
    length = np.linspace(0.06, 0.14, _IN_A_WATER)
    height = PAPER.fin.area / length
    columns = {**vars(PAPER.fin), "length": length, "height": height, "tip_height": height}
    columns["young_modulus"] = np.geomspace(5e8, 5e9, _IN_A_WATER)
    rows = []
    for settings in WATERS:
        fish = replace(PAPER.fish, water=replace(PAPER.fish.water, **settings._asdict()))
        row: dict[str, Any] = settings._asdict()
        if settings.drag == "on":  # without, hardly a swim settles in lanes
            many = partial(swim_batch, columns, fish, reactive=PAPER.reactive, threads=1)
            row["core_ms"] = core_time(many, sizes.repeats) / _IN_A_WATER * 1e3
        fin = _BEYOND_RESONANCE if settings.model == "ideal_2d" else PAPER.fin
        alone = partial(swim, fin, fish, duration=DURATION, reactive=PAPER.reactive)
        row["alone_ms"] = core_time(alone, sizes.repeats) * 1e3
        rows.append(row)
    return rows


def scaling(sizes: Sizes) -> dict[str, list[dict[str, float]]]:
    """Return the time of a swim over the number of swims, of links and of cores."""
    over_swims = [
        {"swims": float(n), "core_ms": core_time(batch(n), sizes.repeats if n <= MANY else 1) / n * 1e3}
        for n in sizes.swims
    ]
    over_links = []
    for links in sizes.segments:
        n, changes = 256, {"segments": np.full(256, links)}
        once = core_time(lanes(n, changes), sizes.repeats) / n
        proven = core_time(batch(n, columns=changes), sizes.repeats) / n
        over_links.append({"links": float(links), "once_ms": once * 1e3, "core_ms": proven * 1e3})
    n = 4 * MANY
    over_cores = [
        {"cores": float(c), "swims_per_second": n / wall_time(batch(n, threads=c), sizes.repeats)}
        for c in range(1, (os.cpu_count() or 1) + 1)
    ]
    return {"swims": over_swims, "links": over_links, "cores": over_cores}
