"""The searches by name, and what each of them can do. A search is loaded when it is asked for: some take a second."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Choice

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_optimizer.search.genetic import PopulationSearch
    from fin_optimizer.search.space import Search, Space, Values
    from fin_plant.fin import Fin
    from fin_plant.gait import Gait


@dataclass(frozen=True)
class Swimming:
    """What a candidate stands for, for a search that simulates it.

    Attributes:
        swum: Returns fin and gait of a candidate.
        settle: Time from a swim's start to the window of its score, s.
        duration: Of that window, s.
        around: What is known of the fish, as `plausible.Fins` names it; the simulator's default if None.
    """

    swum: Callable[[Values], tuple[Fin, Gait]]
    settle: float
    duration: float
    around: Mapping[str, Any] | None = None


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
"""Every search that a study may name and that knows no more than the space. All of them know constraints: see
`Evaluation.violation` and each search."""

FOR_FINS = {"cloud": Ability(several_objectives=False)}
"""Those that a study may name besides, which must know what fin and gait a candidate stands for."""


def search(
    name: str,
    space: Space,
    seed: int,
    deviations: Mapping[str, float],
    population: int = 0,
    *,
    objectives: int = 1,
    constraints: int = 0,
    swimming: Swimming | None = None,
) -> Search:
    """Return a search.

    Args:
        name: One of `ALGORITHMS` or of `FOR_FINS`.
        space: Where to search.
        seed: Of all its random numbers, 0 or more.
        deviations: Standard deviations of the steps of hill climber and genetic algorithm, by parameter.
        population: Candidates of a generation, where there are generations; 0 takes the search's own number.
        objectives: How many there are.
        constraints: How many there are.
        swimming: What a candidate stands for; one of `FOR_FINS` needs it.

    Raises:
        ValueError: The search cannot do what is asked for; with the names of those that can.
    """
    _check(name, space, objectives)
    if name == "cloud":
        return _cloud(space, seed, constraints, swimming)
    if name == "hill_climber":
        return HillClimber(space, seed, deviations)
    if name in {"random", "quasi_random"}:
        return _unscored(name, space, seed)
    if name == "tpe":
        from fin_optimizer.search.tpe import Tpe  # noqa: PLC0415

        return Tpe(space, seed, objectives, constraints)
    if name == "gp":
        from fin_optimizer.search.gp import GpSearch  # noqa: PLC0415

        return GpSearch(space, seed)
    return OneByOne(_by_generations(name, space, seed, deviations, population))


def _unscored(name: str, space: Space, seed: int) -> Search:
    if name == "random":
        from fin_optimizer.search.random_search import RandomSearch  # noqa: PLC0415

        return RandomSearch(space, seed)
    from fin_optimizer.search.quasi_random import QuasiRandom  # noqa: PLC0415

    return QuasiRandom(space, seed)


def _cloud(space: Space, seed: int, constraints: int, swimming: Swimming | None) -> Search:
    from fin_optimizer.search.cloud_search import CloudSearch, kept_clouds  # noqa: PLC0415

    if constraints:
        msg = "search.algorithm = cloud knows no constraints: use gp"
        raise ValueError(msg)
    if swimming is None:
        needed = "it needs objective speed, and each candidate's fin and gait"
        msg = f"search.algorithm = cloud simulates the mean speed: {needed}"
        raise ValueError(msg)
    return CloudSearch(
        space, seed, swimming.swum, swimming.duration, swimming.settle, kept=kept_clouds(), around=swimming.around
    )


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
    ability, several = (ALGORITHMS | FOR_FINS)[name], objectives > 1
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
