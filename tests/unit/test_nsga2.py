"""NSGA-II: by its authors' formulas gene by gene, and on a front that is known."""

from __future__ import annotations

import math
from functools import cache
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
import pytest
from optuna._hypervolume import compute_hypervolume

from fin_optimizer.search import nsga2
from fin_optimizer.search.genetic import Generation
from fin_optimizer.search.nsga2 import Nsga2
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.random_search import RandomSearch
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, generator, uniform

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Scalar, Search

    Array = NDArray[np.float64]

PLANE = Space((Dimension("x", 0.0, 1.0), Dimension("y", -3.0, 5.0)))


def crossed_gene(first: float, second: float, index: float, drawn: float) -> tuple[float, float]:
    """Return both children of a gene as the program of Deb et al. 2002 makes them, the smaller one first."""
    y1, y2 = min(first, second), max(first, second)
    if y2 - y1 < 1e-14:
        return first, second

    def betaq(beta: float) -> float:
        alpha = 2.0 - math.pow(beta, -(index + 1.0))
        base = drawn * alpha if drawn <= 1.0 / alpha else 1.0 / (2.0 - drawn * alpha)
        return math.pow(base, 1.0 / (index + 1.0))

    low = 0.5 * ((y1 + y2) - betaq(1.0 + 2.0 * y1 / (y2 - y1)) * (y2 - y1))
    high = 0.5 * ((y1 + y2) + betaq(1.0 + 2.0 * (1.0 - y2) / (y2 - y1)) * (y2 - y1))
    return min(max(low, 0.0), 1.0), min(max(high, 0.0), 1.0)


@pytest.mark.parametrize("index", [0.0, 2.0, 15.0])
def test_parents_are_crossed_as_in_the_authors_program(index: float) -> None:
    random = np.random.default_rng(1)
    first, second = random.random((400, 3)), random.random((400, 3))
    first[0], second[1], first[2] = second[0], 1.0, 0.0
    is_choice = np.array([False, True, False])
    found = nsga2._crossed(first, second, is_choice, index, np.random.default_rng(7))
    again = np.random.default_rng(7)
    drawn, swapped = again.random(first.shape), again.random(first.shape) < 0.5
    genes, pairs = again.random(first.shape) < 0.5, again.random((400, 1)) < 0.9
    for pair, gene in np.ndindex(first.shape):
        parents = float(first[pair, gene]), float(second[pair, gene])
        children = parents if is_choice[gene] else crossed_gene(*parents, index, float(drawn[pair, gene]))
        if swapped[pair, gene]:
            children = children[1], children[0]
        if not (genes[pair, gene] and pairs[pair, 0]):
            children = parents
        assert [each[pair, gene] for each in found] == pytest.approx(children, abs=1e-12)


def mutated_gene(gene: float, index: float, drawn: float) -> float:
    """Return a gene mutated as the program of Deb et al. 2002 does."""
    power = index + 1.0
    if drawn <= 0.5:
        step = math.pow(2.0 * drawn + (1.0 - 2.0 * drawn) * math.pow(1.0 - gene, power), 1.0 / power) - 1.0
    else:
        step = 1.0 - math.pow(2.0 * (1.0 - drawn) + 2.0 * (drawn - 0.5) * math.pow(gene, power), 1.0 / power)
    return min(max(gene + step, 0.0), 1.0)


@pytest.mark.parametrize("index", [0.0, 20.0])
def test_genes_mutate_as_in_the_authors_program(index: float) -> None:
    children = np.random.default_rng(2).random((300, 4))
    children[0], children[1] = 0.0, 1.0
    is_choice = np.array([False, False, True, False])
    found = nsga2._mutated(children, is_choice, index, np.random.default_rng(8))
    again = np.random.default_rng(8)
    drawn, anew, mutates = (again.random(children.shape) for _ in range(3))
    for place in np.ndindex(children.shape):
        moved = anew[place] if is_choice[place[1]] else mutated_gene(float(children[place]), index, float(drawn[place]))
        assert found[place] == pytest.approx(moved if mutates[place] < 0.25 else children[place], abs=1e-12)


def scored(values: Array, *objectives: Callable[[Array], Array]) -> Generation:
    first, *others = (objective(values) for objective in objectives)
    return Generation(values, first, np.column_stack(others) if others else None)


def test_the_survivors_are_the_best_fronts_and_of_the_last_the_least_crowded() -> None:
    search = Nsga2(PLANE, 1, 4)
    values = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0], [0.4, 0.0]])
    first = Generation(values, np.array([1.0, 2.0, np.nan, 3.0]), -np.array([[1.0], [2.0], [1.0], [9.0]]))
    second = Generation(values + 0.5, np.array([2.0, 2.5, 0.5, 2.9]), -np.array([[2.5], [2.2], [0.9], [np.nan]]))
    survivors = search._survivors([first, second])
    assert survivors is not None
    # front 0: (1, 1), (2, 2), (3, 9), (2.5, 2.2), (0.5, 0.9); of these (1, 1) has the nearest neighbours
    assert survivors.values[:, 0].tolist() == [0.4, 0.8, 0.7, 0.2]
    assert survivors.objectives.tolist() == [[-3.0, 9.0], [-0.5, 0.9], [-2.5, 2.2], [-2.0, 2.0]]
    before = search._survivors([first])
    assert before is not None
    assert before.values[:, 0].tolist() == [0.1, 0.4, 0.2, 0.3], "the one without a score stands last"
    assert np.isinf(before.objectives[3]).all()


def test_those_that_meet_the_constraints_survive_first_and_then_those_that_miss_least() -> None:
    values = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0], [0.4, 0.0]])
    excesses = np.array([[-1.0, 0.5], [0.2, 0.1], [-3.0, 0.0], [np.nan, np.nan]])
    first = Generation(values, np.array([4.0, 3.0, 1.0, np.nan]), None, excesses)
    second = Generation(values + 0.5, np.array([0.5, 9.0, 5.0, 2.0]), None, np.array([[-1.0], [2.0], [0.25], [0.0]]))
    survivors = Nsga2(PLANE, 1, 6)._survivors([first, second])
    assert survivors is not None
    assert survivors.values[:, 0].tolist() == [0.9, 0.3, 0.6, 0.8, 0.2, 0.1]
    assert survivors.violations.tolist() == pytest.approx([0.0, 0.0, 0.0, 0.25, 0.3, 0.5])


def test_the_better_of_two_drawn_survivors_is_a_parent() -> None:
    count = 4000
    space = Space((Dimension("x", 0.0, 1.0), Dimension("y", 0.0, 1.0)))
    search = Nsga2(space, 3, count, mutation_index=1e9, crossover_index=1e9)
    values = np.column_stack([np.linspace(0.0, 1.0, count)] * 2)
    children = search.propose([Generation(values, np.arange(count, dtype=float))])
    # the larger of two even numbers; a gene of a pair hardly moves, so it is a parent's
    assert np.mean(children) == pytest.approx(2.0 / 3.0, abs=0.015)
    assert np.mean(children**2) == pytest.approx(1.0 / 2.0, abs=0.015)


def test_every_survivor_is_a_parent_as_often_as_it_is_the_better_of_two() -> None:
    """The first of four is the better of two in 7 of 16 draws; 4000 draws know that within 0.008."""
    search = Nsga2(Space((Dimension("x", 0.0, 1.0),)), 3, 4000, mutation_index=1e9, crossover_index=1e9)
    values = np.array([[0.2], [0.4], [0.6], [0.8]])
    survivors = nsga2._Survivors(values, -values, np.zeros(4))
    children = search._drawn(survivors, np.random.default_rng(1))
    shares = [np.mean(np.abs(children - value) < 0.01) for value in values[:, 0]]
    assert shares == pytest.approx([7 / 16, 5 / 16, 3 / 16, 1 / 16], abs=0.04)


def test_no_candidate_is_swum_again_while_there_is_another() -> None:
    space = Space((Dimension("x", 1, 5, whole=True), Choice("c", ("a", "b", "d"))))
    search = Nsga2(space, 2, 6)
    history: list[Generation] = []
    seen = []
    for _ in range(2):
        history.append(scored(search.propose(history), lambda values: values[:, 0]))
        seen.append(set(map(tuple, history[-1].values.tolist())))
    assert [len(each) for each in seen] == [6, 6]
    assert not seen[1] & {tuple(row) for row in history[0].values.tolist()}
    tiny = Space((Choice("c", ("a", "b")), Choice("d", ("a", "b"))))
    assert Nsga2(tiny, 1, 6).propose([]).shape == (6, 2), "of four candidates some are there twice"


def test_a_space_of_which_little_can_be_is_filled_with_what_can() -> None:
    space = Space(PLANE.dimensions, lambda values: "" if float(values["y"]) < -2.9 else "too much")
    first = Nsga2(space, 2, 6).propose([])
    following = Nsga2(space, 2, 6).propose([scored(first, lambda values: values[:, 1])])
    assert first.shape == following.shape == (6, 2)
    assert max(first[:, 1].max(), following[:, 1].max()) < -2.9


def zdt1(values: Mapping[str, Scalar]) -> Evaluation:
    """Return Zitzler, Deb & Thiele's first problem: its front is y = 1 - sqrt(x) where all but the first are 0."""
    first, *others = (float(each) for each in values.values())
    slope = 1.0 + 9.0 * sum(others) / len(others)
    return Evaluation(values, -first, (slope * (math.sqrt(first / slope) - 1.0),))


BOX = Space(tuple(Dimension(name, 0.0, 1.0) for name in "abcd"))
WHOLE = 11.0 - 1.0 / 3.0
"""Area between the whole front and (1.1, 10)."""


@cache
def area(name: str, seed: int) -> float:
    """Return the area between what 400 candidates found and (1.1, 10)."""
    search: Search = RandomSearch(BOX, seed) if name == "random" else OneByOne(Nsga2(BOX, seed))
    history: list[Evaluation] = []
    while len(history) < 400:
        history.append(zdt1(search.propose(history)))
    points = np.array([[-entry.score, -entry.others[0]] for entry in history if entry.score is not None])
    return float(compute_hypervolume(points, np.array([1.1, 10.0])))


def test_a_known_front_is_found() -> None:
    found = [area("nsga2", seed) for seed in range(3)]
    assert max(found) < WHOLE
    assert WHOLE - median(found) < 0.3
    assert WHOLE - max(area("random", seed) for seed in range(3)) > 0.7


def test_a_generation_known_by_identity_is_not_sorted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sorted_ones: list[Generation] = []
    select = Nsga2._selected

    def noted(search: Nsga2, before: nsga2._Survivors | None, generation: Generation) -> nsga2._Survivors:
        sorted_ones.append(generation)
        return select(search, before, generation)

    monkeypatch.setattr(Nsga2, "_selected", noted)
    search = Nsga2(PLANE, 1, 6)
    history: list[Generation] = []
    for _ in range(4):
        history.append(scored(search.propose(history), lambda values: -(values[:, 1] ** 2)))
    assert [id(each) for each in sorted_ones] == [id(each) for each in history[:3]]
    other = [history[0], scored(history[1].values, lambda values: values[:, 0]), history[2]]
    assert np.array_equal(search.propose(other), Nsga2(PLANE, 1, 6).propose(other))
    assert np.array_equal(search.propose(history[:1]), Nsga2(PLANE, 1, 6).propose(history[:1]))
    assert np.array_equal(search.propose([]), Nsga2(PLANE, 1, 6).propose([]))


def test_the_first_generation_is_drawn_evenly() -> None:
    first = Nsga2(PLANE, 4, 2000).propose([])
    assert first.mean(axis=0) == pytest.approx([0.5, 1.0], abs=0.2)
    assert first.min(axis=0) == pytest.approx([0.0, -3.0], abs=0.02)
    assert first.max(axis=0) == pytest.approx([1.0, 5.0], abs=0.02)
    few = Space(PLANE.dimensions, lambda values: "" if float(values["x"]) < 1e-3 else "wide")
    random = generator(5, 0)
    for _ in range(nsga2._REDRAWS):
        random.random((4, 2))
    made = Nsga2(few, 5, 4).propose([])
    assert len(made) == 4
    assert made[-1].tolist() == few.row(uniform(few, random)) or made[:, 0].max() < 1e-3


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Nsga2(PLANE, -1), "seed = -1"),
        (lambda: Nsga2(PLANE, 1, 3), "population = 3 is outside"),
        (lambda: Nsga2(PLANE, 1, 5), "population = 5 must be even"),
        (lambda: Nsga2(PLANE, 1, crossover_index=-1.0), "crossover_index = -1"),
        (lambda: Nsga2(PLANE, 1, mutation_index=-1.0), "mutation_index = -1"),
        (lambda: Generation(np.zeros((2, 1)), np.zeros(2), np.zeros(2)), "others of shape .* do not fit"),
        (lambda: Generation(np.zeros((2, 1)), np.zeros(2), None, np.zeros((3, 1))), "excesses of shape .* do not fit"),
    ],
)
def test_what_cannot_be_is_refused(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()


def test_the_ends_of_what_can_be_are_allowed() -> None:
    assert Nsga2(PLANE, 0, 4, crossover_index=0.0, mutation_index=0.0).propose([]).shape == (4, 2)
