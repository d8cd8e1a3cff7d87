"""Command ``bench_search``: which search finds a hidden fish's best fin in so many trials on a robot.

Twenty hidden fish in each of four worlds, a stock of sixty fins, five materials in three thicknesses at four lengths,
and twelve trials with noise. The worlds: fish that the simulator can be; other segments and hinges; another form of the
water's force besides; and effects that no variant of the simulator has.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.algorithms import search
from fin_optimizer.search.space import Choice, Evaluation, Space
from fin_plant import checks
from fin_plant.command import command
from fin_plant.figures import check_picture, new_figure, own_style
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_plant.paths import check_output, given_path
from fin_sim.swim import PAPER_FISH

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_optimizer.search.cloud_search import CloudSearch
    from fin_optimizer.search.plausible import Fins
    from fin_optimizer.search.space import Search, Values
    from fin_plant.gait import Gait

    Array = NDArray[np.float64]

MODULI = (0.9e9, 1.6e9, 2.4e9, 3.3e9, 9.0e9)
THICKNESSES = (2e-4, 3e-4, 5e-4)
LENGTHS = (0.06, 0.08, 0.10, 0.12)
SPACE = Space(
    (
        Choice("fin.young_modulus", MODULI, "Pa"),
        Choice("fin.thickness", THICKNESSES, "m"),
        Choice("fin.length", LENGTHS, "m"),
    )
)
WORLDS = {
    "simulator's kind": (0, False),
    "other hinges": (6, False),
    "other force": (7, False),
    "other effects": (6, True),
}
"""Kind of the simulated fin (`plausible.KINDS`), and whether there are effects that no variant has."""
METHODS = ("random", "hill_climber", "tpe", "gp", "cloud")
HIDDEN_WIDTH = 0.6
"""Spread of the hidden fish, in standard deviations of what the cloud believes."""
DURATION = 10.0
_NEAR, _FAIRLY_NEAR = 0.02, 0.03


def swum(values: Values) -> tuple[Fin, Gait]:
    """Return the fin and the gait of a candidate of the stock."""
    return Fin(**{name.removeprefix("fin."): value for name, value in values.items()}), PAPER_GAIT


@cache
def _cloud_search(seed: int) -> CloudSearch:
    from fin_optimizer.search.cloud_search import CloudSearch, kept_clouds  # noqa: PLC0415

    return CloudSearch(SPACE, seed, swum, DURATION, kept=kept_clouds())


def _fins(*, with_effects: bool) -> tuple[list[Values], Fins]:
    """Return the stock and its fins; ``with_effects`` resistance by amplitude, viscous drag and hinges that damp."""
    from fin_optimizer.search.plausible import Fins  # noqa: PLC0415

    candidates = list(_cloud_search(0).candidates)
    fins, gaits = zip(*map(swum, candidates), strict=True)
    if not with_effects:
        return candidates, Fins(tuple(fins), tuple(gaits), DURATION)
    fish = replace(
        PAPER_FISH,
        body=replace(PAPER_FISH.body, linear_drag=0.01),
        water=replace(PAPER_FISH.water, oscillating_drag=6.0),
    )
    return candidates, Fins(tuple(replace(fin, hinge_damping=1e-4) for fin in fins), tuple(gaits), DURATION, fish=fish)


def true_speeds(world: str, fish: int) -> tuple[list[Values], Array]:
    """Return the stock and the speed of each hidden fish of a world with each of its fins, m/s, (fish, fins)."""
    from fin_optimizer.search.plausible import speeds  # noqa: PLC0415

    kind, with_effects = WORLDS[world]
    candidates, fins = _fins(with_effects=with_effects)
    numbers = HIDDEN_WIDTH * np.random.default_rng([2012, kind]).standard_normal((fish, fins.numbers))
    return candidates, speeds(fins, numbers, np.full(fish, kind, dtype=np.intp))


def _one(method: str, seed: int) -> Search:
    return _cloud_search(seed) if method == "cloud" else search(method, SPACE, seed, {})


def regrets(method: str, candidates: Sequence[Values], true: Array, trials: int, noise: float, seed: int) -> Array:
    """Return by what share the fin that is thought best after each trial is slower than the best, (trials,).

    Args:
        method: One of `METHODS`.
        candidates: The stock.
        true: Speeds of one fish with them, m/s, (fins,).
        trials: Number of them.
        noise: Of a trial, as a share of the speed.
        seed: Of noise and search.
    """
    number = {tuple(SPACE.row(values)): place for place, values in enumerate(candidates)}
    from fin_optimizer.search.cloud_search import CloudSearch  # noqa: PLC0415

    random, one = np.random.default_rng([seed, 1]), _one(method, seed)
    history: list[Evaluation] = []
    result = np.empty(trials)
    for trial in range(trials):
        values = one.propose(history)
        speed = true[number[tuple(SPACE.row(values))]]
        history.append(Evaluation(values, float(max(speed * (1.0 + noise * random.standard_normal()), 0.0))))
        best = one.best(history) if isinstance(one, CloudSearch) else _best_scored(history)
        result[trial] = 1.0 - true[number[tuple(SPACE.row(best))]] / np.nanmax(true)
    return result


def _best_scored(history: Sequence[Evaluation]) -> Values:
    scores: dict[tuple[float, ...], list[float]] = {}
    for entry in history:
        scores.setdefault(tuple(SPACE.row(entry.values)), []).append(entry.score or 0.0)
    means = {row: sum(told) / len(told) for row, told in scores.items()}
    return SPACE.values(max(means.items(), key=lambda item: item[1])[0])


def bench(
    methods: Sequence[str], worlds: Sequence[str], fish: int, trials: int, noise: float, seeds: int
) -> dict[str, dict[str, dict[str, object]]]:
    """Return for each method and world how many fish were served well after all trials, and regrets by trial.

    Numbers of fish are means over the seeds. Regrets are shares of the best speed.
    """
    result: dict[str, dict[str, dict[str, object]]] = {method: {} for method in methods}
    for world in worlds:
        candidates, true = true_speeds(world, fish)
        for method in methods:
            found = np.array(
                [
                    [
                        regrets(method, candidates, true[place], trials, noise, 1000 * seed + place)
                        for place in range(fish)
                    ]
                    for seed in range(seeds)
                ]
            )
            last = found[:, :, -1]
            result[method][world] = {
                "within_2_percent": float((last <= _NEAR).sum(axis=1).mean()),
                "within_3_percent": float((last <= _FAIRLY_NEAR).sum(axis=1).mean()),
                "median_regret": float(np.median(last)),
                "quartiles_by_trial": np.percentile(found, (25, 50, 75), axis=(0, 1)).T.round(5).tolist(),
            }
            sys.stderr.write(f"{world}, {method}: {result[method][world]['within_2_percent']:.1f} of {fish}\n")
    return result


@own_style(font_size=8)
def draw(path: Path, found: dict[str, dict[str, dict[str, object]]]) -> None:
    """Draw regret over trials, median and quartiles, a panel for each world."""
    worlds = list(next(iter(found.values())))
    figure, axes = new_figure(3.2 * len(worlds), 3.2, 1, len(worlds))
    for panel, world in zip(axes.flat, worlds, strict=True):
        for method, by_world in found.items():
            low, middle, high = 100.0 * np.array(by_world[world]["quartiles_by_trial"]).T
            trial = np.arange(1, len(middle) + 1)
            (line,) = panel.plot(trial, middle, label=method, lw=1.4)
            panel.fill_between(trial, low, high, color=line.get_color(), alpha=0.12, lw=0.0)
        panel.set(title=world, xlabel="trial", ylim=(0.0, 40.0))
    axes[0, 0].set_ylabel("slower than the best fin, %")
    axes[0, -1].legend(frameon=False)
    figure.savefig(path, dpi=120)


def _table(found: dict[str, dict[str, dict[str, object]]], fish: int) -> str:
    lines = [
        f"| method | {' | '.join(next(iter(found.values())))} |",
        f"|---|{'---|' * len(WORLDS)}",
    ]
    for method, by_world in found.items():
        cells = (
            f"{each['within_2_percent']:.1f}, {each['within_3_percent']:.1f}, {each['median_regret']:.2%}"
            for each in by_world.values()
        )
        lines.append(f"| `{method}` | {' | '.join(cells)} |")
    return "\n".join([f"of {fish} fish: within 2 %, within 3 %; median regret", *lines]) + "\n"


@command("bench_search")
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 0, 2 for bad input, 130 for Ctrl-C."""
    parser = argparse.ArgumentParser(
        prog="bench_search",
        description="Compare searches on hidden fish: how near the best fin of a stock each is after some trials.",
    )
    whole = checks.read_whole_number
    parser.add_argument("--fish", type=whole, default=20, metavar="N", help="hidden fish in each world (default 20)")
    parser.add_argument("--trials", type=whole, default=12, metavar="N", help="swims that each search has (default 12)")
    parser.add_argument("--seeds", type=whole, default=3, metavar="N", help="of the noise (default 3)")
    parser.add_argument(
        "--noise", type=checks.read_number, default=0.05, help="of a swim, share of speed (default 0.05)"
    )
    parser.add_argument("--methods", default=",".join(METHODS), help=f"some of {', '.join(METHODS)}")
    parser.add_argument("--json", action="store_true", help="as JSON instead of a table")
    parser.add_argument("--plot", type=given_path, metavar="FILE", help="draw regret over trials, .png, .pdf or .svg")
    given = parser.parse_args(arguments)
    for name in ("fish", "trials", "seeds"):
        checks.whole_number(f"--{name}", getattr(given, name), 1, 1000)
    noise = checks.number("--noise", given.noise, 0.0, 1.0, exclusive_minimum=True)
    methods = [checks.choice("--methods", each.strip(), METHODS) for each in given.methods.split(",")]
    if given.plot:
        check_picture(given.plot)
        check_output(given.plot)
    found = bench(methods, list(WORLDS), given.fish, given.trials, noise, given.seeds)
    sys.stdout.write(json.dumps(found, indent=2) + "\n" if given.json else _table(found, given.fish))
    if given.plot:
        draw(given.plot, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
