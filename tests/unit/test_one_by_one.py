"""A search by generations that is asked for one candidate at a time proposes what it does as a whole."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import Generation, GeneticAlgorithm
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Dimension, Evaluation, Space

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import PopulationSearch

SPACE = Space((Dimension("a", 0.0, 1.0), Dimension("b", 0.0, 2.0)))
SIZE = 5


def genetic() -> GeneticAlgorithm:
    return GeneticAlgorithm(SPACE, 3, {"a": 0.1, "b": 0.1}, population=SIZE)


def cma() -> CmaEs:
    return CmaEs(SPACE, 3, population=SIZE)


def score(a: float, b: float) -> float | None:
    """None for a part of the box."""
    return None if a + b > 1.0 else a - b


def as_a_whole(search: PopulationSearch, generations: int) -> list[list[float]]:
    history: list[Generation] = []
    for _ in range(generations):
        values = search.propose(history)
        scores = [np.nan if (each := score(*row)) is None else each for row in values.tolist()]
        history.append(Generation(values, np.array(scores)))
    return [row for generation in history for row in generation.values.tolist()]


def asked(search: OneByOne, count: int) -> list[Evaluation]:
    history: list[Evaluation] = []
    while len(history) < count:
        values = search.propose(history)
        history.append(Evaluation(values, score(values["a"], values["b"])))
    return history


@pytest.mark.parametrize("make", [genetic, cma])
def test_the_candidates_are_the_generations_ones(make: Callable[[], PopulationSearch]) -> None:
    history = asked(OneByOne(make()), 4 * SIZE)
    assert any(entry.score is None for entry in history)
    assert [list(entry.values.values()) for entry in history] == as_a_whole(make(), 4)
    assert [list(entry.values) for entry in history] == [["a", "b"]] * len(history)


def test_a_generation_begins_when_the_one_before_is_settled() -> None:
    assert [OneByOne(genetic()).needed(number) for number in range(11)] == [0] * 5 + [5] * 5 + [10]


@pytest.mark.parametrize("make", [genetic, cma])
def test_another_history_gives_another_generation_whatever_was_asked_before(
    make: Callable[[], PopulationSearch],
) -> None:
    search = OneByOne(make())
    history = asked(search, 3 * SIZE)
    for changed in range(len(history)):
        other = list(history)
        other[changed] = Evaluation(other[changed].values, 9.0)
        assert search.propose(other) == OneByOne(make()).propose(other)
        assert search.propose(history) == OneByOne(make()).propose(history)


def test_a_generation_is_asked_for_once_and_stays_the_same_object() -> None:
    @dataclass
    class Noting:
        """A genetic algorithm that notes what it is told."""

        search: GeneticAlgorithm
        told: list[tuple[Generation, ...]] = field(default_factory=list)

        @property
        def space(self) -> Space:
            return self.search.space

        def propose(self, history: Sequence[Generation]) -> NDArray[np.float64]:
            self.told.append(tuple(history))
            return self.search.propose(history)

    noting = Noting(genetic())
    asked(OneByOne(noting), 3 * SIZE)
    assert [len(told) for told in noting.told] == [0, 0, 1, 2], "the first one also for its size"
    assert noting.told[3][0] is noting.told[2][0]
