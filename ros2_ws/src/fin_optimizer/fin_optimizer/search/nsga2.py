"""NSGA-II: a genetic algorithm for several objectives, the next generation as a pure function of those before.

Deb, Pratap, Agarwal & Meyarivan, A Fast and Elitist Multiobjective Genetic Algorithm: NSGA-II, IEEE Trans. Evolutionary
Computation 6, 2002, with its rule for constraints (section VI). Simulated binary crossover and polynomial mutation in
their form for bounded numbers, as in the authors' own program; a choice is inherited from either parent or chosen anew.
Arrays hold a whole generation.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.pareto import crowding, ranks
from fin_optimizer.search.space import Choice, generator, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import Generation
    from fin_optimizer.search.space import Space

    Array = NDArray[np.float64]

_REDRAWS = 100
"""How often a child is made again that the space refuses or that is there already."""
_CROSSED, _GENE_CROSSED = 0.9, 0.5
"""Share of the pairs, and of a pair's genes, that are crossed (Deb et al. 2002, and the authors' program)."""
_SMALLEST_DIFFERENCE = 1e-14


@dataclass(frozen=True)
class _Survivors:
    """Those of all generations so far that may become parents: by front, and in a front the least crowded first.

    Attributes:
        values: Shape (population, parameters).
        objectives: Shape (population, objectives), each to be small; infinite for those without a score.
        violations: How much they miss of all constraints, shape (population,).
    """

    values: Array
    objectives: Array
    violations: Array


@dataclass(frozen=True)
class Nsga2:
    """Looks for candidates of which none is better in all objectives.

    Attributes:
        space: Where to search; ranges, steps and choices.
        seed: Of all its random numbers, 0 or more.
        population: Individuals of a generation, an even number.
        crossover_index: Of the crossover; the larger, the nearer are children to their parents.
        mutation_index: Of the mutation, likewise.

    Raises:
        ValueError: A number that cannot be.
    """

    space: Space
    seed: int
    population: int = 20
    crossover_index: float = 15.0
    mutation_index: float = 20.0
    _known: list[tuple[Generation, _Survivors]] = field(default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
        checks.whole_number("population", self.population, 4)
        if self.population % 2:
            msg = f"population = {self.population} must be even: two parents have two children"
            raise ValueError(msg)
        for name in ("crossover_index", "mutation_index"):
            checks.number(name, getattr(self, name), 0.0)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_known": []}

    def propose(self, history: Sequence[Generation]) -> Array:
        """Return the next generation, shape (population, parameters)."""
        random = generator(self.seed, len(history))
        survivors = self._survivors(history)
        there = set() if survivors is None else set(map(tuple, survivors.values.tolist()))
        made: list[tuple[float, ...]] = []
        for _ in range(_REDRAWS):
            numbers = self.space.numbers(self._drawn(survivors, random))
            for row in map(tuple, np.delete(numbers, self.space.refused(numbers), axis=0).tolist()):
                if row not in there:  # swum again, it would tell nothing that is not known
                    there.add(row)
                    made.append(row)
            if len(made) >= self.population:
                return np.array(made[: self.population])
        # A space with few candidates, or few that can be: the rest are any.
        rest = [self.space.row(uniform(self.space, random)) for _ in range(self.population - len(made))]
        return np.array([*made, *rest])

    def _survivors(self, history: Sequence[Generation]) -> _Survivors | None:
        """Return the best of all generations so far, which are the last ones' and those that survived before."""
        same = 0
        while same < min(len(self._known), len(history)) and self._known[same][0] is history[same]:
            same += 1
        del self._known[same:]
        for generation in history[same:]:
            before = self._known[-1][1] if self._known else None
            self._known.append((generation, self._selected(before, generation)))
        return self._known[-1][1] if self._known else None

    @staticmethod
    def _objectives(generation: Generation) -> Array:
        """Return what is to be small, shape (candidates, objectives); infinite where a candidate lacks any of it."""
        scores = generation.scores[:, None]
        objectives = -(scores if generation.others is None else np.hstack((scores, generation.others)))
        return np.where(np.isnan(objectives).any(axis=1, keepdims=True), np.inf, objectives)

    def _selected(self, before: _Survivors | None, generation: Generation) -> _Survivors:
        values, objectives, violations = generation.values, self._objectives(generation), generation.violations
        if before is not None:
            values = np.vstack((before.values, values))
            objectives = np.vstack((before.objectives, objectives))
            violations = np.concatenate((before.violations, violations))
        known = np.isfinite(objectives).all(axis=1)
        front = np.full(len(values), len(values), dtype=np.intp)  # those without a score come last
        meets = known & (violations == 0.0)
        front[meets] = ranks(objectives[meets])
        # Those that miss a constraint come behind, the ones that miss less first (Deb et al. 2002, definition 1).
        misses = known & ~meets
        front[misses] = front[meets].max(initial=-1) + 1 + np.unique(violations[misses], return_inverse=True)[1]
        order: list[int] = []
        for number in range(len(values) + 1):
            members = np.flatnonzero(front == number)
            if number < len(values) and members.size:
                apart = crowding(objectives[members])
                members = members[np.argsort(-apart, kind="stable")]
            order += members.tolist()
            if len(order) >= self.population:
                break
        chosen = np.array(order[: self.population])
        return _Survivors(values[chosen], objectives[chosen], violations[chosen])

    def _drawn(self, survivors: _Survivors | None, random: np.random.Generator) -> Array:
        """Return coordinates of as many candidates as a generation has: drawn evenly, or children of survivors."""
        low, high = self.space.bounds
        if survivors is None:
            return random.uniform(low, high, (self.population, len(low)))
        # The survivors are sorted, so of two the better one is the one that stands first.
        drawn = random.integers(0, len(survivors.values), (2, self.population, 2)).min(axis=2)
        unit = (self.space.coordinates(survivors.values) - low) / (high - low)
        first, second = unit[drawn[0, : self.population // 2]], unit[drawn[1, : self.population // 2]]
        is_choice = np.array([isinstance(dimension, Choice) for dimension in self.space.dimensions])
        children = np.vstack(_crossed(first, second, is_choice, self.crossover_index, random))
        return low + (high - low) * _mutated(children, is_choice, self.mutation_index, random)


def _crossed(
    first: Array, second: Array, is_choice: NDArray[np.bool_], index: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Return two children of each pair of parents, all of shape (pairs, parameters) and from 0 to 1.

    Simulated binary crossover for bounded numbers (Deb & Agrawal 1995; bounds as in the program of Deb et al. 2002).
    """
    shape = first.shape
    small, large = np.minimum(first, second), np.maximum(first, second)
    width = np.maximum(large - small, _SMALLEST_DIFFERENCE)
    drawn = random.random(shape)

    def spread(room: Array) -> Array:
        alpha = 2.0 - (1.0 + 2.0 * room / width) ** -(index + 1.0)
        inside = drawn * alpha <= 1.0
        base = np.where(inside, drawn * alpha, 1.0 / (2.0 - drawn * alpha))
        return np.asarray(base ** (1.0 / (index + 1.0)))

    middle = 0.5 * (small + large)
    lower = np.clip(middle - 0.5 * spread(small) * width, 0.0, 1.0)
    upper = np.clip(middle + 0.5 * spread(1.0 - large) * width, 0.0, 1.0)
    # A choice has no places between two of it: the children get the parents'.
    lower, upper = np.where(is_choice, first, lower), np.where(is_choice, second, upper)
    swapped = random.random(shape) < 0.5  # noqa: PLR2004  (either way as often)
    lower, upper = np.where(swapped, upper, lower), np.where(swapped, lower, upper)
    crossed = (random.random(shape) < _GENE_CROSSED) & (random.random((shape[0], 1)) < _CROSSED)
    return np.where(crossed, lower, first), np.where(crossed, upper, second)


def _mutated(children: Array, is_choice: NDArray[np.bool_], index: float, random: np.random.Generator) -> Array:
    """Return ``children``, shape (n, parameters) and from 0 to 1, each gene of which mutates with 1 / parameters.

    Polynomial mutation for bounded numbers (Deb & Agrawal 1999; as in the program of Deb et al. 2002); a choice is
    drawn anew.
    """
    shape = children.shape
    drawn = random.random(shape)
    down = drawn <= 0.5  # noqa: PLR2004  (either way as often)
    power = index + 1.0
    below = 2.0 * drawn + (1.0 - 2.0 * drawn) * (1.0 - children) ** power
    above = 2.0 * (1.0 - drawn) + (2.0 * drawn - 1.0) * children**power
    step = np.where(down, np.abs(below) ** (1.0 / power) - 1.0, 1.0 - np.abs(above) ** (1.0 / power))
    moved = np.where(is_choice, random.random(shape), np.clip(children + step, 0.0, 1.0))
    mutates = random.random(shape) < 1.0 / shape[1]
    return np.asarray(np.where(mutates, moved, children))
