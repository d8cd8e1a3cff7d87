"""The paper's genetic algorithm and the yardstick, as pure functions of seed and history."""

from __future__ import annotations

import math
import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cmaes import CMAwM

from fin_optimizer.search import cma_es, genetic
from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import Generation, GeneticAlgorithm, PopulationSearch, mutated
from fin_optimizer.search.space import Dimension, Space, generator

if TYPE_CHECKING:
    from collections.abc import Callable

    import cmaes
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
    assert following.shape == (100, 1)
    assert np.array_equal(following[:10], best)
    assert following.min() >= 0.5
    assert following.max() <= 4.0
    assert abs(np.median(following) - 2.0) < 0.3


def test_a_child_that_is_refused_is_drawn_again_near_its_parent() -> None:
    space = Space((Dimension("x", 0.0, 1.0),), lambda values: "" if float(values["x"]) >= 0.5 else "too small")
    children = mutated(space, np.full((200, 1), 0.5), np.array([0.01]), np.random.default_rng(1))
    assert children.min() >= 0.5
    assert children.max() < 0.56


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
    ("wrong", "message"),
    [
        (lambda: GeneticAlgorithm(LINE, -1, {"fin.young_modulus": 1.0}), "seed = -1"),
        (lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 0.0}), "mutation of fin.young_modulus = 0"),
        (lambda: GeneticAlgorithm(LINE, 1, {"fin.length": 1.0}), "mutations are given for"),
        (lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, population=1), "population = 1"),
        (lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, tournament=0), "tournament = 0"),
        (lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, elite=1.5), "elite = 1.5"),
        (lambda: CmaEs(LINE, 1), "at least 2 parameters"),
        (lambda: CmaEs(PLANE, -1), "seed = -1"),
        (lambda: CmaEs(PLANE, 1, population=4), "population = 4"),
        (lambda: CmaEs(PLANE, 1, deviation=0.0), "deviation = 0"),
        (lambda: CmaEs(PLANE, 1, deviation=1.5), "deviation = 1.5"),
        (lambda: CmaEs(PLANE, 1).propose([Generation(np.zeros((2, 2)), np.zeros(2))]), "2 scores, 6 candidates"),
        (lambda: Generation(np.zeros((2, 1)), np.zeros(3)), "do not fit"),
        (lambda: Generation(np.zeros((2, 1)), np.zeros(2), np.zeros((3, 1))), r"others of shape \(3, 1\) do not fit"),
        (lambda: Generation(np.zeros((1, 1)), np.array([np.inf])), "candidate 0 is infinite"),
    ],
)
def test_what_cannot_be_is_refused(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()


@pytest.mark.parametrize(
    "right",
    [
        lambda: GeneticAlgorithm(LINE, 0, {"fin.young_modulus": 1.0}, population=2, tournament=1, elite=0.0),
        lambda: GeneticAlgorithm(LINE, 1, {"fin.young_modulus": 1.0}, elite=1.0),
        lambda: CmaEs(PLANE, 0, population=5, deviation=1.0),
    ],
)
def test_the_ends_of_what_can_be_are_allowed(right: Callable[[], PopulationSearch]) -> None:
    assert len(right().propose([])) > 1


def mutated_one_by_one(
    space: Space, parents: NDArray[np.float64], deviations: NDArray[np.float64], seed: int, redraws: int
) -> NDArray[np.float64]:
    """Do as `mutated` says, gene by gene."""
    random = np.random.default_rng(seed)
    children = np.array(
        [[gene + each * random.standard_normal() for gene, each in zip(p, deviations, strict=True)] for p in parents]
    )
    for draw in range(redraws + 1):
        for row, column in np.ndindex(children.shape):
            dimension = space.ranges[column]
            if not dimension.minimum <= children[row, column] <= dimension.maximum:
                again = parents[row, column] + deviations[column] * random.standard_normal() if draw < redraws else None
                even = random.uniform(dimension.minimum, dimension.maximum) if again is None else again
                children[row, column] = even
    return children


@pytest.mark.parametrize("redraws", [0, 1, 1000])
def test_a_gene_outside_is_drawn_again_and_at_last_evenly(redraws: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(genetic, "_REDRAWS", redraws)
    parents = np.tile([[0.6, 5.0], [9.0, 13.5], [5.0, 9.0]], (5, 1))
    deviations = np.array([4.0, 6.0])
    children = mutated(PLANE, parents, deviations, np.random.default_rng(4))
    assert np.array_equal(children, mutated_one_by_one(PLANE, parents, deviations, 4, redraws))


@pytest.mark.parametrize("redraws", [0, 1000])
def test_a_mutation_too_small_for_a_float_stays_on_the_bound(redraws: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(genetic, "_REDRAWS", redraws)
    bounds = np.array([[0.5], [4.0]])
    assert np.array_equal(mutated(LINE, bounds, np.array([1e-20]), np.random.default_rng(1)), bounds)


def test_a_gene_on_the_bound_takes_no_draw_from_those_outside() -> None:
    parents = np.array([[0.5, 13.9], [10.0, 4.1]] * 5)
    deviations = np.array([1e-20, 6.0])
    children = mutated(PLANE, parents, deviations, np.random.default_rng(2))
    assert np.array_equal(children, mutated_one_by_one(PLANE, parents, deviations, 2, 1000))


def test_crossover_cuts_three_genes_behind_the_first_or_the_second() -> None:
    """The first parent's genes stand before the cut, drawn in the order that the docstrings tell."""
    space = Space(tuple(Dimension(name, 0.0, 10.0) for name in "abc"))
    values = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [3.0, 3.0, 3.0]])
    steps = dict.fromkeys("abc", 1e-9)
    search = GeneticAlgorithm(space, 1, steps, population=50, elite=0.0, tournament=1, crossover=True)
    children = search.propose([Generation(values, np.zeros(3))])
    random = generator(1, 1)
    first, second = (random.integers(0, 3, (50, 1))[:, 0] + 1.0 for _ in range(2))
    cuts = random.integers(1, 3, 50)
    expected = [[a] * cut + [b] * (3 - cut) for a, b, cut in zip(first, second, cuts, strict=True)]
    assert np.round(children, 3).tolist() == expected
    assert {1, 2} == set(cuts.tolist())


def test_with_one_gene_crossover_has_nothing_to_cut() -> None:
    steps = {"fin.young_modulus": 1e-9}
    search = GeneticAlgorithm(LINE, 1, steps, population=20, crossover=True)
    children = search.propose([Generation(np.full((20, 1), 2.0), np.zeros(20))])
    assert children.shape == (20, 1)
    assert children == pytest.approx(2.0)


def test_without_a_score_a_candidate_ranks_behind_any_other() -> None:
    assert Generation(np.zeros((3, 1)), np.array([np.nan, -5.0, 3.0])).ranked().tolist() == [-np.inf, -5.0, 3.0]


def test_cma_counts_a_missing_score_as_the_worst_of_its_generation() -> None:
    values = CmaEs(PLANE, 3).propose([])
    missing = Generation(values, np.array([np.nan, 4.0, 2.0, 6.0, 5.0, 3.0]))
    worst = Generation(values, np.array([2.0, 4.0, 2.0, 6.0, 5.0, 3.0]))
    assert np.array_equal(CmaEs(PLANE, 3).propose([missing]), CmaEs(PLANE, 3).propose([worst]))


def test_cma_begins_anywhere_in_the_box_and_puts_nothing_on_its_border() -> None:
    starts = np.vstack([CmaEs(PLANE, seed).propose([]) for seed in range(40)])
    assert ((starts > [0.5, 4.0]) & (starts < [10.0, 14.0])).all()
    means = np.array([CmaEs(PLANE, seed)._optimiser().mean for seed in range(40)])
    assert 0.0 < means.min() < 0.1
    assert 0.9 < means.max() < 1.0


def test_cma_goes_on_from_what_it_was_told_and_begins_again_for_another_history(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[int] = []
    begin = CmaEs._optimiser

    def noted(search: CmaEs, generation: int = 0) -> cmaes.CMA:
        begun.append(search.seed)
        return begin(search, generation)

    monkeypatch.setattr(CmaEs, "_optimiser", noted)
    search = CmaEs(PLANE, 7)
    history = played(search, 5)
    assert np.array_equal(search.propose(history), search.propose(history))
    search.propose(history[:3])
    assert len(begun) == 1
    other = [scored(history[0].values + 0.1), *history[1:]]
    proposed = search.propose(other)
    assert len(begun) == 2
    assert np.array_equal(proposed, CmaEs(PLANE, 7).propose(other))


def test_a_pickled_search_carries_no_random_numbers() -> None:
    search = CmaEs(PLANE, 7)
    played(search, 2)
    assert pickle.dumps(search) == pickle.dumps(CmaEs(PLANE, 7))


STEPPED = Space(
    (
        Dimension("x", 0.0, 1.0),
        Dimension("n", 3, 40, whole=True),
        Dimension("y", 1.0, 100.0, log=True),
        Dimension("s", 0.04, 0.14, step=0.02),
        Dimension("w", 1, 200, whole=True, log=True),
    )
)


def on_steps(values: NDArray[np.float64]) -> Generation:
    """Return scores with their top at x = 0.7, n = 17, y = 10, s = 0.06, w = 30."""
    x, n, y, s, w = values.T
    missed = (x - 0.7) ** 2 + ((n - 17.0) / 20.0) ** 2 + (np.log10(y) - 1.0) ** 2 + ((s - 0.06) / 0.1) ** 2
    return Generation(values, -missed - ((w - 30.0) / 50.0) ** 2)


def stepped(seed: int, generations: int) -> list[Generation]:
    search = CmaEs(STEPPED, seed)
    history: list[Generation] = []
    for _ in range(generations):
        history.append(on_steps(search.propose(history)))
    return history


def test_cma_finds_the_best_steps_and_whole_numbers() -> None:
    history = stepped(1, 80)
    for values in np.vstack([generation.values for generation in history]).tolist():
        STEPPED.check(STEPPED.values(values))
    best = max(history, key=lambda generation: float(generation.scores.max()))
    found = best.values[int(np.argmax(best.scores))]
    assert found[[1, 3, 4]].tolist() == [17.0, 0.06, 30.0]
    assert found[[0, 2]] == pytest.approx([0.7, 10.0], rel=0.01)


def test_cma_with_margin_never_stops_trying_the_steps_beside() -> None:
    """Without the margin the last generations would hold one step only, and a wrong one would stay for ever."""
    last = np.vstack([generation.values for generation in stepped(1, 100)[-15:]])
    assert [len(set(last[:, column].tolist())) > 1 for column in (1, 3, 4)] == [True] * 3
    assert np.ptp(last[:, 0]) < 0.1, "where any number goes, the steps have become small"


def test_cma_on_steps_goes_on_after_any_generation() -> None:
    history = stepped(2, 6)
    for count in (0, 2, 5):
        assert np.array_equal(CmaEs(STEPPED, 2).propose(history[:count]), history[count].values)


@pytest.mark.parametrize("space", ["PLANE", "STEPPED"])
def test_where_nothing_is_left_to_find_it_begins_again_and_a_resumed_one_does_too(space: str) -> None:
    """On flat ground: candidates fill the space again, instead of an optimiser that grows or shrinks without end."""
    given = {"PLANE": PLANE, "STEPPED": STEPPED}[space]
    search, history = CmaEs(given, 2, population=12), list[Generation]()
    means = []
    while len(history) < 40:
        values = search.propose(history)
        means.append(search._replays[-1].optimiser)
        history.append(Generation(values, np.zeros(len(values))))
    began = [number for number in range(1, 40) if means[number] is not means[number - 1]]
    assert began
    for number in (began[0], began[0] + 1, 39):
        assert np.array_equal(CmaEs(given, 2, population=12).propose(history[:number]), history[number].values)


def test_each_beginning_has_a_mean_of_its_own_drawn_by_the_seed_and_its_generation() -> None:
    """The first one's seed is the study's alone: a study of any age goes on with the candidates that it had."""
    for generation, key in ((0, ()), (9, (9,))):
        random = np.random.default_rng(np.random.SeedSequence(7, spawn_key=key))
        assert CmaEs(PLANE, 7)._optimiser(generation).mean.tolist() == random.uniform(size=2).tolist()


@pytest.mark.parametrize("space", ["PLANE", "STEPPED"])
def test_an_optimiser_whose_numbers_are_none_is_done(space: str) -> None:
    given = {"PLANE": PLANE, "STEPPED": STEPPED}[space]
    sound, without_step = (CmaEs(given, 7)._optimiser() for _ in range(2))
    getattr(without_step, "_cma", without_step)._sigma = math.nan
    assert [cma_es._is_done(each) for each in (sound, without_step)] == [False, True]
    if isinstance(sound, CMAwM):
        sound._A[1] = math.inf
        assert cma_es._is_done(sound)


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_of_whole_numbers_hundreds_of_generations_stay_numbers() -> None:
    """A whole number's axis shrinks to nothing once its best value is found, which the library divides by."""
    space = Space((Dimension("a", 0, 3, whole=True), Dimension("b", 0, 10, whole=True)))
    search, history = CmaEs(space, 1), list[Generation]()
    while len(history) < 500:
        values = search.propose(history)
        assert (values == np.round(values)).all()
        assert ((values >= 0) & (values <= [3, 10])).all()
        history.append(Generation(values, -((values - 0.37) ** 2).sum(axis=1)))


def test_cma_on_steps_draws_again_what_is_refused_and_tells_what_it_drew_evenly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    space = Space(STEPPED.dimensions, lambda values: "" if float(values["w"]) < 20 and values["s"] < 0.1 else "no")
    assert CmaEs(space, 1).propose([])[:, 4].max() < 20
    monkeypatch.setattr(cma_es, "_REDRAWS", 0)
    search = CmaEs(space, 1)
    drawn = search.propose([])
    for values in drawn.tolist():
        assert space.judge(space.check(space.values(values))) == ""
    for row in drawn:
        assert search._numbers(search._scaled(row)[None, :])[0] == pytest.approx(row, rel=1e-12)
        assert ((search._scaled(row) > 0.0) & (search._scaled(row) < 1.0)).all()
    assert search._scaled(np.array([0.25, 3.0, 10.0, 0.14, 100.0])) == pytest.approx(
        [0.25, 0.5 / 38, 0.5, 5.5 / 6, 99.5 / 200]
    )


def test_cma_begins_inside_the_steps_and_moves_by_shares_of_the_range() -> None:
    optimiser = CmaEs(STEPPED, 1, deviation=0.2)._optimiser()
    assert isinstance(optimiser, CMAwM)
    assert optimiser._cma._sigma == pytest.approx(0.2)
    assert optimiser._discrete_space_low == pytest.approx([0.5 / 38, 0.5 / 6, 0.5 / 200])
    assert optimiser._discrete_space_step == pytest.approx([1 / 38, 1 / 6, 1 / 200])
    assert optimiser._discrete_space_size.tolist() == [38, 6, 200]
    two = Space((Dimension("a", 0, 1, whole=True), Dimension("b", 0.0, 1.0)))
    means = np.array([CmaEs(two, seed)._optimiser().mean for seed in range(60)])
    assert [means[:, 0].min(), means[:, 0].max()] == [0.25, 0.75]
    assert means[:, 1].min() < 0.1
    assert means[:, 1].max() > 0.9
