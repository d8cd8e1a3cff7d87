"""The paper's genetic algorithm: the next generation as a pure function of the seed and of the generations before.

Raja Mohamed & Raviraj: 100 individuals, uniform start, tournaments of three, Gaussian mutation only, the best tenth
kept. Clark et al. 2012: 125 individuals, and one-point crossover where shape and stiffness evolve together. Arrays hold
a whole generation, so that its fins swim side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fin_optimizer.search.space import Choice, generator, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Space

_REDRAWS = 1000  # as `search.gaussian_step`


@dataclass(frozen=True)
class Generation:
    """Candidates that were tried together.

    Attributes:
        values: Shape (candidates, parameters), the parameters in the order of the space; of a choice its place.
        scores: Shape (candidates,), more is better; NaN for a candidate that has none. With several objectives the
            first of them.
        others: The further objectives, shape (candidates, objectives - 1), more of each is better; NaN where a
            candidate has none; None with one objective.
        excesses: By how much a candidate misses each constraint, 0 or less where it meets it, shape (candidates,
            constraints); not looked at without a score; None without constraints.

    Raises:
        ValueError: Shapes that do not fit, or an infinite score.
    """

    values: NDArray[np.float64]
    scores: NDArray[np.float64]
    others: NDArray[np.float64] | None = None
    excesses: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.scores.shape != self.values.shape[:1]:  # noqa: PLR2004
            msg = f"scores of shape {self.scores.shape} do not fit values of shape {self.values.shape}: give one a row"
            raise ValueError(msg)
        for name in ("others", "excesses"):
            more = getattr(self, name)
            if more is not None and (more.ndim != 2 or len(more) != len(self.scores)):  # noqa: PLR2004
                msg = f"{name} of shape {more.shape} do not fit scores of shape {self.scores.shape}: give a row each"
                raise ValueError(msg)
        if np.isinf(self.scores).any():
            msg = (
                f"score of candidate {int(np.argmax(np.isinf(self.scores)))} is infinite: give NaN where there is none"
            )
            raise ValueError(msg)

    def ranked(self) -> NDArray[np.float64]:
        """Return what is larger for a better candidate, shape (candidates,): its score, minus infinity without one.

        Where any misses a constraint it is a candidate's place instead: one that meets all is better than one that
        misses any, and of two that miss some the one that misses less is (Deb, Computer Methods in Applied Mechanics
        and Engineering 186, 2000).
        """
        known = ~np.isnan(self.scores)
        if not self.violations[known].any():
            return np.where(known, self.scores, -np.inf)
        result = np.full(len(known), -np.inf)
        both = np.column_stack((-self.violations, self.scores))[known]
        result[known] = np.unique(both, axis=0, return_inverse=True)[1].ravel()
        return result

    @cached_property
    def violations(self) -> NDArray[np.float64]:
        """How much each candidate misses of all constraints, shape (candidates,); see `Evaluation.violation`."""
        if self.excesses is None:
            return np.zeros(len(self.scores))
        return np.asarray(np.maximum(self.excesses, 0.0).sum(axis=1))


class PopulationSearch(Protocol):
    """A search that proposes a generation at a time."""

    @property
    def space(self) -> Space:
        """Where it searches."""

    def propose(self, history: Sequence[Generation]) -> NDArray[np.float64]:
        """Return what follows ``history``, shape (candidates, parameters); the same for the same history."""


def mutated(
    space: Space, parents: NDArray[np.float64], deviations: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.float64]:
    """Return ``parents``, shape (n, parameters), each moved by a Gaussian step that is drawn again while outside.

    What does not fall inside in a thousand draws is drawn uniformly, as is a child that the space refuses a thousand
    times; see `search.gaussian_step` for the reasons, and for choices, whose deviations are not looked at.
    """
    result = _stepped(space, parents, deviations, random)
    rows = space.refused(result)
    for _ in range(_REDRAWS):
        if not rows.size:
            return result
        result[rows] = _stepped(space, parents[rows], deviations, random)
        rows = rows[space.refused(result[rows])]
    for row in rows:
        result[row] = space.row(uniform(space, random))
    return result


def _stepped(
    space: Space, parents: NDArray[np.float64], deviations: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.float64]:
    """Return what `mutated` does, whether or not the space refuses it."""
    low, high = space.bounds
    start = space.coordinates(parents)
    # x' = x + sigma N(0, 1), every gene (Clark et al. 2012: Gaussian mutation, sigma^2 = 0.1)
    result = start + deviations * random.standard_normal(parents.shape)
    for column, dimension in enumerate(space.dimensions):
        if isinstance(dimension, Choice):
            changed = random.random(len(parents)) < 1.0 / len(space.dimensions)
            others = (parents[:, column] + random.integers(1, dimension.count, len(parents))) % dimension.count
            result[:, column] = np.where(changed, others, parents[:, column])
    for _ in range(_REDRAWS):
        rows, columns = np.nonzero((result < low) | (result > high))
        if not rows.size:
            return space.numbers(result)
        result[rows, columns] = start[rows, columns] + deviations[columns] * random.standard_normal(rows.size)
    rows, columns = np.nonzero((result < low) | (result > high))
    result[rows, columns] = random.uniform(low[columns], high[columns])
    return space.numbers(result)


@dataclass(frozen=True)
class GeneticAlgorithm:
    """The papers' genetic algorithm.

    Attributes:
        space: Where to search.
        seed: Of all its random numbers, 0 or more.
        deviations: Standard deviation of a mutation, as for `search.gaussian_step`, of every parameter that is no
            choice; every gene of a child mutates.
        population: Individuals of a generation.
        tournament: Individuals drawn for each parent, the best of which becomes it.
        elite: Share of a generation, its best, that goes on unchanged.
        crossover: Whether a child takes its first genes from one parent and the others from a second one.

    Raises:
        ValueError: A number that cannot be, or deviations for other parameters than the space's.
    """

    space: Space
    seed: int
    deviations: Mapping[str, float]
    population: int = 100
    tournament: int = 3
    elite: float = 0.1
    crossover: bool = False

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
        checks.whole_number("population", self.population, 2)
        checks.whole_number("tournament", self.tournament, 1)
        checks.number("elite", self.elite, 0.0, 1.0)
        ranges = [dimension.name for dimension in self.space.ranges]
        if set(self.deviations) != set(ranges):
            msg = f"mutations are given for {sorted(self.deviations)}, but the space has {sorted(ranges)}"
            raise ValueError(msg)
        for name, deviation in self.deviations.items():
            checks.number(f"mutation of {name}", deviation, 0.0, exclusive_minimum=True)

    def propose(self, history: Sequence[Generation]) -> NDArray[np.float64]:
        """Return the next generation, shape (population, parameters): the elite first, then the children."""
        random = generator(self.seed, len(history))
        low, high = self.space.bounds
        if not history:
            return self._first(random.uniform(low, high, (self.population, len(low))), random)
        last = history[-1]
        ranked = last.ranked()
        # Elitism: the best tenth goes on (Raja Mohamed & Raviraj).
        elite = np.argsort(-ranked, kind="stable")[: round(self.elite * self.population)]
        children = self.population - len(elite)
        parents = last.values[self._winners(ranked, children, random)]
        if self.crossover:
            others = last.values[self._winners(ranked, children, random)]
            # One-point crossover (Clark et al. 2012): genes before the cut from the one, behind it from the other.
            cut = random.integers(1, len(low), children) if len(low) > 1 else np.ones(children, dtype=int)
            parents = np.where(np.arange(len(low)) < cut[:, None], parents, others)
        deviations = np.array([self.deviations.get(name, 0.0) for name in self.space.names])
        return np.vstack((last.values[elite], mutated(self.space, parents, deviations, random)))

    def _first(self, coordinates: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        """Return the candidates at coordinates, those that the space refuses drawn again."""
        result = self.space.numbers(coordinates)
        for row in self.space.refused(result):
            result[row] = self.space.row(uniform(self.space, random))
        return result

    def _winners(self, ranked: NDArray[np.float64], count: int, random: np.random.Generator) -> NDArray[np.intp]:
        """Return the best of each of ``count`` tournaments, as indices."""
        # Tournament of three, drawn with replacement (Raja Mohamed & Raviraj).
        drawn = random.integers(0, len(ranked), (count, self.tournament))
        best = np.argmax(ranked[drawn], axis=1)
        return np.asarray(drawn[np.arange(count), best])
