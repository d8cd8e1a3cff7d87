"""The paper's genetic algorithm and the yardstick, as pure functions of seed and history."""

from __future__ import annotations

import math
import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import Generation, GeneticAlgorithm, PopulationSearch, mutated
from fin_optimizer.search.space import Dimension, Space

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

LINE = Space((Dimension("fin.young_modulus", 0.5, 4.0, "GPa"),))
PLANE = Space((Dimension("fin.young_modulus", 0.5, 10.0, "GPa"), Dimension("fin.length", 4.0, 14.0, "cm")))
STEPS = {"fin.young_modulus": math.sqrt(0.1), "fin.length": math.sqrt(0.1)}


def line(seed: int = 1) -> GeneticAlgorithm:
    return GeneticAlgorithm(LINE, seed, {"fin.young_modulus": math.sqrt(0.1)})


def scored(values: NDArray[np.float64]) -> Generation:
    return Generation(values, -np.sum((values - 2.0) ** 2, axis=1))


def played(search: PopulationSearch, generations: int) -> list[Generation]:
    history: list[Generation] = []
    for _ in range(generations):
        history.append(scored(search.propose(history)))
    return history


@pytest.mark.parametrize("make", [lambda: line(7), lambda: CmaEs(PLANE, 7), lambda: GeneticAlgorithm(PLANE, 7, STEPS)])
def test_the_same_history_gives_the_same_candidates_to_the_last_bit(make: Callable[[], PopulationSearch]) -> None:
    history = played(make(), 8)
    for count in (0, 3, 8, 5):
        expected = make().propose(history[:count])
        assert np.array_equal(make().propose(history[:count]), expected)
        copied = pickle.loads(pickle.dumps(make()))  # noqa: S301  (our own)
        copied.propose(history[:2])
        assert np.array_equal(pickle.loads(pickle.dumps(copied)).propose(history[:count]), expected)  # noqa: S301


def test_the_start_is_uniform_and_the_population_is_the_papers() -> None:
    start = line().propose([])
    assert start.shape == (100, 1)
    assert start.min() < 0.8
    assert start.max() > 3.7
    assert not np.array_equal(start, line(2).propose([]))


def test_the_best_tenth_goes_on_unchanged_and_nothing_leaves_the_range() -> None:
    history = played(line(), 5)
    best = history[-1].values[np.argsort(-history[-1].scores, kind="stable")[:10]]
    following = line().propose(history)
    assert np.array_equal(following[:10], best)
    assert following.min() >= 0.5
    assert following.max() <= 4.0
    assert abs(np.median(following) - 2.0) < 0.3


def test_parents_win_tournaments_of_three() -> None:
    count = 20000
    values = np.linspace(0.5, 4.0, count)[:, None]
    search = GeneticAlgorithm(LINE, 3, {"fin.young_modulus": 1e-9}, population=count, elite=0.0)
    children = search.propose([Generation(values, np.arange(count, dtype=float))])
    ranks = (children[:, 0] - 0.5) / 3.5
    assert np.mean(ranks) == pytest.approx(3.0 / 4.0, abs=0.01)  # the largest of three uniform numbers
    assert np.mean(ranks**2) == pytest.approx(3.0 / 5.0, abs=0.01)


def test_mutation_is_gaussian_with_the_given_variance() -> None:
    parents = np.full((20000, 1), 2.25)
    children = mutated(LINE, parents, np.array([math.sqrt(0.1)]), np.random.default_rng(0))
    assert np.var(children) == pytest.approx(0.1, rel=0.03)
    narrow = Space((Dimension("x", 0.0, 1e-9),))
    assert 0.0 <= mutated(narrow, np.zeros((3, 1)), np.array([1.0]), np.random.default_rng(0)).max() <= 1e-9


def test_crossover_takes_the_first_genes_from_one_parent_and_the_rest_from_another() -> None:
    values = np.array([[1.0, 5.0], [9.0, 13.0]])
    tiny = {"fin.young_modulus": 1e-9, "fin.length": 1e-9}
    search = GeneticAlgorithm(PLANE, 1, tiny, population=200, elite=0.0, tournament=1, crossover=True)
    children = {tuple(np.round(child, 3)) for child in search.propose([Generation(values, np.zeros(2))])}
    assert children == {(1.0, 5.0), (9.0, 13.0), (1.0, 13.0), (9.0, 5.0)}
    plain = GeneticAlgorithm(PLANE, 1, tiny, population=200, elite=0.0, tournament=1)
    assert len({tuple(np.round(child, 3)) for child in plain.propose([Generation(values, np.zeros(2))])}) == 2


def test_a_candidate_without_a_score_never_wins() -> None:
    values = np.linspace(0.5, 4.0, 100)[:, None]
    scores = np.where(np.arange(100) < 90, np.nan, 1.0)
    assert line().propose([Generation(values, scores)])[:10].min() >= values[90, 0]
    unscored = line().propose([Generation(values, np.full(100, np.nan))])
    assert np.isfinite(unscored).all()


def test_cma_finds_the_optimum_and_ranks_a_missing_score_last() -> None:
    search = CmaEs(PLANE, 3)
    history: list[Generation] = []
    for _ in range(60):
        generation = scored(search.propose(history))
        missing = np.where(generation.values[:, 0] > 6.0, np.nan, generation.scores)
        history.append(Generation(generation.values, missing))
    assert history[-1].values == pytest.approx(2.0 + np.array([0.0, 2.0]) * np.ones((6, 2)), abs=2e-2)
    assert np.isfinite(CmaEs(PLANE, 3).propose([Generation(history[0].values, np.full(6, np.nan))])).all()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: GeneticAlgorithm(LINE, -1, {"fin.young_modulus": 1.0}),
        lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 0.0}),
        lambda: GeneticAlgorithm(LINE, 1, {"fin.length": 1.0}),
        lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, population=1),
        lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, elite=1.5),
        lambda: CmaEs(LINE, 1),
        lambda: CmaEs(PLANE, 1, deviation=0.0),
        lambda: CmaEs(PLANE, 1).propose([Generation(np.zeros((2, 2)), np.zeros(2))]),
        lambda: Generation(np.zeros((2, 1)), np.zeros(3)),
        lambda: Generation(np.zeros((1, 1)), np.array([np.inf])),
    ],
)
def test_what_cannot_be_is_refused(wrong: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r".+"):
        wrong()
