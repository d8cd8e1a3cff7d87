"""Command ``compare_searches``: how many simulated swims each search needs, and how long it takes to propose a fin.

The fish is the one whose curves the papers published. One space has Young's modulus and the length at a fixed area, as
a study searches them; the other one also the fin's taper and thickness. Several studies of one search go on in step, so
that their fins swim side by side.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from functools import cache
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from fin_optimizer.search.algorithms import ALGORITHMS, search
from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import Generation
from fin_optimizer.search.random_search import RandomSearch
from fin_optimizer.search.space import Dimension, Evaluation, Space
from fin_plant import checks
from fin_plant.command import command
from fin_plant.fin import scaled_to_area
from fin_plant.gait import PAPER_GAIT
from fin_sim.batch import swim_batch
from fin_sim.presets import preset

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Search

    Array = NDArray[np.float64]

MODULUS = Dimension("fin.young_modulus", 0.5e9, 10e9, "Pa")
LENGTH = Dimension("fin.length", 0.04, 0.14, "m")
TAPER = Dimension("taper", 0.4, 2.5, log=True)
"""Height of the tip over that of the root."""
THICKNESS = Dimension("fin.thickness", 3e-4, 1.5e-3, "m", log=True)
SPACES = {"2 parameters": Space((MODULUS, LENGTH)), "4 parameters": Space((MODULUS, LENGTH, TAPER, THICKNESS))}
STEPS = {"fin.young_modulus": math.sqrt(0.1) * 1e9, "fin.length": 0.01, "taper": 0.2, "fin.thickness": 0.2}
"""Standard deviations of the steps of hill climber and genetic algorithm: the papers', and a tenth of the range."""
DURATION = 10.0
"""s (both papers)."""
NEAR = 0.99
"""Share of the highest speed known at which a study has found what it looks for."""
_REFERENCE_RUNS, _REFERENCE_GENERATIONS = 10, 60
_TRIALS = 200
"""Scores that are known where a proposal is timed."""
_PROPOSALS = 5


def speeds(rows: Array, space: Space) -> Array:
    """Return the mean speeds of candidates, shape (n, parameters), in m/s; NaN where there is none."""
    given = preset("clark2012_simulation")
    values = dict(zip(space.names, rows.T, strict=True))
    fin = {**given.fin.as_parameters(), **values}
    fin["fin.tip_height"] = fin["fin.height"] * fin.pop("taper", np.ones(1))
    fins = scaled_to_area(fin, given.fin.area)
    columns = {**vars(given.fin), **{name.removeprefix("fin."): fins[name] for name in (*fins,) if name in _COLUMNS}}
    return swim_batch(columns, given.fish, PAPER_GAIT, DURATION, reactive=given.reactive).mean_speed


_COLUMNS = {"fin.young_modulus", "fin.length", "fin.height", "fin.tip_height", "fin.thickness"}


@cache
def highest(name: str) -> float:
    """Return the highest speed that is known in a space, m/s: what long runs of CMA-ES find."""
    space = SPACES[name]
    found = -math.inf
    for seed in range(_REFERENCE_RUNS):
        history: list[Generation] = []
        reference = CmaEs(space, seed, population=20)
        for _ in range(_REFERENCE_GENERATIONS):
            rows = reference.propose(history)
            history.append(Generation(rows, speeds(rows, space)))
        found = max(found, *(float(np.nanmax(generation.scores)) for generation in history))
    return found


def swims_needed(algorithm: str, name: str, studies: int, most: int) -> list[float]:
    """Return for each study how many fins it swims until one is as fast as wanted, infinity for more than ``most``."""
    space, wanted = SPACES[name], NEAR * highest(name)
    searches = [search(algorithm, space, seed, {n: STEPS[n] for n in space.names}) for seed in range(studies)]
    histories: dict[int, list[Evaluation]] = {number: [] for number in range(studies)}
    needed = [math.inf] * studies
    for count in range(1, most + 1):
        going_on = [number for number in histories if math.isinf(needed[number])]
        if not going_on:
            break
        tried = {number: searches[number].propose(histories[number]) for number in going_on}
        swum = speeds(np.array([space.row(values) for values in tried.values()]), space).tolist()
        for (number, values), speed in zip(tried.items(), swum, strict=True):
            histories[number].append(Evaluation(values, None if math.isnan(speed) else speed))
            if speed >= wanted:
                needed[number] = count
    return needed


def proposal_time(algorithm: str, name: str) -> float:
    """Return the time of a proposal after 200 scored fins in s, the least of five after 200 to 204."""
    space = SPACES[name]
    drawn = RandomSearch(space, 1)
    history: list[Evaluation] = []
    while len(history) < _TRIALS + _PROPOSALS:
        values = drawn.propose(history)
        unit = [(d.coordinates(np.array([float(values[d.name])]))[0] - d.low) / (d.high - d.low) for d in space.ranges]
        history.append(Evaluation(values, -sum((each - 0.3) ** 2 for each in unit)))
    one: Search = search(algorithm, space, 1, {n: STEPS[n] for n in space.names})
    one.propose(history[:_TRIALS])  # what is loaded and compiled once, and the first of a generation
    taken = []
    with threadpool_limits(1):
        for count in range(_TRIALS, _TRIALS + _PROPOSALS):
            begun = time.thread_time()
            one.propose(history[:count])
            taken.append(time.thread_time() - begun)
    return min(taken)


def _shown(needed: Sequence[float], most: int) -> str:
    said = [f"{number:.0f}" if math.isfinite(number) else f"> {most}" for number in (median(needed), max(needed))]
    return " | ".join(said)


def _line(algorithm: str, studies: int, most: int) -> str:
    cells = [_shown(swims_needed(algorithm, name, studies, most), most) for name in SPACES]
    taken = proposal_time(algorithm, "4 parameters")
    return f"| `{algorithm}` | {' | '.join(cells)} | {taken * 1e3:.2g} ms |"


def _print(line: str) -> None:
    """Print a line at once: the next one may take minutes."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


@command("compare_searches")
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 0, or 2 if it cannot be."""
    parser = argparse.ArgumentParser(
        prog="compare_searches",
        description="Print how many simulated swims each search needs until a fin is within 1 % of the fastest known.",
    )
    add = parser.add_argument
    add("searches", nargs="*", metavar="SEARCH", help=f"all, or some of: {', '.join(ALGORITHMS)}")
    add("--studies", type=checks.read_whole_number, default=11, help="of each search (default: %(default)s)")
    add("--most", type=checks.read_whole_number, default=400, help="swims of a study (default: %(default)s)")
    given = parser.parse_args(arguments)
    names = [checks.choice("search", name, ALGORITHMS) for name in given.searches] or list(ALGORITHMS)
    checks.whole_number("--studies", given.studies, 1)
    checks.whole_number("--most", given.most, 1)
    for name in SPACES:
        _print(f"{name}: the fastest known swims {100.0 * highest(name):.3f} cm/s")
    _print("| search | " + " | ".join(f"{name}: median | slowest" for name in SPACES) + " | a proposal |")
    _print("|---" * (2 * len(SPACES) + 2) + "|")
    for name in names:
        _print(_line(name, given.studies, given.most))
    return 0


if __name__ == "__main__":
    sys.exit(main())
