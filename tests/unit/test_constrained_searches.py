"""Every search under constraints: what meets all comes first, then what misses least, then what has no score."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fin_optimizer.search.algorithms import ALGORITHMS, search
from fin_optimizer.search.genetic import Generation, GeneticAlgorithm
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.pareto import front
from fin_optimizer.search.space import Dimension, Evaluation, Space, Values, best, pareto_front

PLANE = Space((Dimension("x", 0.0, 1.0), Dimension("y", 0.0, 1.0)))
STEPS = {"x": 0.1, "y": 0.1}


def tried(values: Values) -> Evaluation:
    """Return a fin the better the larger x, which must not be beyond 0.5; some have no score."""
    if 0.2 < values["y"] < 0.25:
        return Evaluation(values, None)
    return Evaluation(values, values["x"], (), (values["x"] - 0.5, -values["y"]))


def at(score: float | None, *excesses: float) -> Evaluation:
    return Evaluation({"x": 0.5, "y": 0.5}, score, (), excesses)


def test_what_meets_all_is_better_than_what_misses_any_and_less_missed_is_better() -> None:
    good, better, slow = at(1.0, -1.0), at(2.0, 0.0), at(0.1, -3.0)
    bad, worse, none = at(9.0, 0.2), at(9.0, 0.3), at(None)
    assert best([none, worse, bad, slow, good, better]) is better
    assert best([none, worse, bad]) is bad
    assert best([none]) is None
    assert at(1.0, 0.25, -9.0, 0.5).violation == 0.75
    numbers = [(1.0, 1.0, -1.0), (9.0, 9.0, 0.1), (0.5, 2.0, 0.0)]
    several = [Evaluation({}, score, (other,), (excess,)) for score, other, excess in numbers]
    assert pareto_front(several) == [0, 2]


def test_a_generation_is_ranked_likewise_and_equals_stay_equal() -> None:
    excesses = np.array([[-1.0, 0.0], [0.5, 0.0], [-1.0, -1.0], [0.2, 0.3], [0.1, 0.1], [np.nan, np.nan]])
    generation = Generation(np.zeros((6, 2)), np.array([1.0, 9.0, 2.0, 9.0, 1.0, np.nan]), None, excesses)
    ranked = generation.ranked()
    assert np.argsort(-ranked, kind="stable").tolist() == [2, 0, 4, 1, 3, 5]
    assert ranked[1] == ranked[3]
    assert ranked[5] == -np.inf
    met = Generation(generation.values, generation.scores, None, np.minimum(excesses, 0.0))
    assert met.ranked().tolist() == [1.0, 9.0, 2.0, 9.0, 1.0, -np.inf]


@pytest.mark.parametrize("name", [name for name in ALGORITHMS if name not in {"random", "quasi_random"}])
def test_a_search_finds_the_best_that_may_be_and_goes_on_as_it_would_have_when_it_is_begun_again(name: str) -> None:
    def begun() -> object:
        return search(name, PLANE, 5, STEPS, 8 if name in {"genetic", "nsga2", "cma_es"} else 0, constraints=2)

    chosen, history = begun(), list[Evaluation]()
    for _ in range(18 if name == "gp" else 64):
        history.append(tried(chosen.propose(history)))  # type: ignore[attr-defined]
    found = best(history)
    assert found is not None
    assert found.violation == 0.0
    assert found.values["x"] > 0.42
    late = history[2 * len(history) // 3 :]
    assert np.mean([entry.values["x"] for entry in late]) < 0.75, "it does not stay where nothing may be"
    for number in (9, 16, 17):
        assert begun().propose(history[:number]) == history[number].values  # type: ignore[attr-defined]


def test_parents_are_those_that_meet_the_constraints() -> None:
    values = np.column_stack([np.linspace(0.0, 1.0, 40)] * 2)
    excesses = values[:, :1] - 0.5
    children = GeneticAlgorithm(PLANE, 1, {"x": 1e-6, "y": 1e-6}, population=40).propose(
        [Generation(values, values[:, 0], None, excesses)]
    )
    assert np.mean(children[:, 0] <= 0.5 + 1e-4) > 0.85, "of three drawn one in eight is none that meets them"
    history = [Evaluation({"x": x, "y": 0.5}, x, (), (x - 0.5,)) for x in (0.2, 0.45, 0.9)]
    child = HillClimber(PLANE, 3, {"x": 1e-6, "y": 1e-6}).propose(history)
    assert child["x"] == pytest.approx(0.45, abs=1e-4)


def test_excesses_pass_a_search_by_generations_and_a_fin_without_a_score_has_none() -> None:
    asked: list[Generation] = []

    class Watching:
        space = PLANE

        def propose(self, history: list[Generation]) -> np.ndarray:
            asked[:] = history
            return np.zeros((2, 2))

    one = OneByOne(Watching())  # type: ignore[arg-type]
    scored = Evaluation({"x": 0.0, "y": 0.0}, 1.0, (2.0, 3.0), (0.5,))
    one.propose([scored, Evaluation({"x": 0.0, "y": 0.0}, None)])
    (generation,) = asked
    assert generation.others is not None
    assert generation.others.tolist()[0] == [2.0, 3.0]
    assert np.isnan(generation.others[1]).all()
    assert generation.violations[0] == 0.5
    assert math.isnan(generation.violations[1])
    one.propose([Evaluation({"x": 0.0, "y": 0.0}, score) for score in (1.0, None)])
    (generation,) = asked
    assert generation.others is None
    assert generation.excesses is None


@pytest.mark.parametrize("sides", [1, 2, 3])
def test_the_front_is_what_none_beats_in_every_objective(sides: int) -> None:
    points = np.random.default_rng(sides).integers(0, 6, (60, sides)).astype(float)
    unbeaten = [
        place
        for place, mine in enumerate(points)
        if not any(
            (other <= mine).all() and ((other < mine).any() or number < place)
            for number, other in enumerate(points)
            if number != place
        )
    ]
    assert front(points) == unbeaten


@pytest.mark.parametrize("name", ["others", "excesses"])
def test_a_number_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} = nan"):
        Evaluation({"x": 0.5}, 1.0, **{name: (math.nan,)})  # type: ignore[arg-type]
