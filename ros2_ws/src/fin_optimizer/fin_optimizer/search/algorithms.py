"""The searches by name, and what each of them can do. A search is loaded when it is asked for: some take a second."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Choice

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_optimizer.search.genetic import PopulationSearch
    from fin_optimizer.search.space import Search, Space


@dataclass(frozen=True)
class Ability:
    """What a search can do.

    Attributes:
        several_objectives: Look for a Pareto front.
        choices: Choose among things that have no order.
    """

    several_objectives: bool = True
    choices: bool = True


ALGORITHMS = {
    "hill_climber": Ability(),
    "genetic": Ability(several_objectives=False),
    "cma_es": Ability(several_objectives=False, choices=False),
    "tpe": Ability(),
    "gp": Ability(),
    "nsga2": Ability(),
    "random": Ability(),
    "quasi_random": Ability(),
}
"""Every search that a study may name. All of them know constraints: see `Evaluation.violation` and each search."""


def search(
    name: str,
    space: Space,
    seed: int,
    deviations: Mapping[str, float],
    population: int = 0,
    *,
    objectives: int = 1,
    constraints: int = 0,
) -> Search:
    """Return a search.

    Args:
        name: One of `ALGORITHMS`.
        space: Where to search.
        seed: Of all its random numbers, 0 or more.
        deviations: Standard deviations of the steps of hill climber and genetic algorithm, by parameter.
        population: Candidates of a generation, where there are generations; 0 takes the search's own number.
        objectives: How many there are.
        constraints: How many there are.

    Raises:
        ValueError: The search cannot do what is asked for; with the names of those that can.
    """
    _check(name, space, objectives)
    if name == "hill_climber":
        return HillClimber(space, seed, deviations)
    if name == "random":
        from fin_optimizer.search.random_search import RandomSearch  # noqa: PLC0415

        return RandomSearch(space, seed)
    if name == "quasi_random":
        from fin_optimizer.search.quasi_random import QuasiRandom  # noqa: PLC0415

        return QuasiRandom(space, seed)
    if name == "tpe":
        from fin_optimizer.search.tpe import Tpe  # noqa: PLC0415

        return Tpe(space, seed, objectives, constraints)
    if name == "gp":
        from fin_optimizer.search.gp import GpSearch  # noqa: PLC0415

        return GpSearch(space, seed)
    return OneByOne(_by_generations(name, space, seed, deviations, population))


def _by_generations(
    name: str, space: Space, seed: int, deviations: Mapping[str, float], population: int
) -> PopulationSearch:
    if name == "cma_es":
        from fin_optimizer.search.cma_es import CmaEs  # noqa: PLC0415

        return CmaEs(space, seed, population or None)
    if name == "nsga2":
        from fin_optimizer.search.nsga2 import Nsga2  # noqa: PLC0415

        nsga2 = Nsga2(space, seed)
        return replace(nsga2, population=population or nsga2.population)
    from fin_optimizer.search.genetic import GeneticAlgorithm  # noqa: PLC0415

    genetic = GeneticAlgorithm(space, seed, deviations)
    return replace(genetic, population=population or genetic.population)


def _check(name: str, space: Space, objectives: int) -> None:
    ability, several = ALGORITHMS[name], objectives > 1
    choices = [dimension.name for dimension in space.dimensions if isinstance(dimension, Choice)]
    able = [other for other, each in ALGORITHMS.items() if _can(each, choices=bool(choices), several=several)]
    if several and not ability.several_objectives:
        msg = f"search.algorithm = {name} knows one objective only: for several use {', '.join(able)}"
        raise ValueError(msg)
    if choices and not ability.choices:
        msg = f"search.algorithm = {name} cannot choose ({', '.join(choices)}): for choices use {', '.join(able)}"
        raise ValueError(msg)


def _can(ability: Ability, *, choices: bool, several: bool) -> bool:
    return (ability.choices or not choices) and (ability.several_objectives or not several)
