"""A space of ranges, grids, whole numbers and choices: every search stays inside it and meets its conditions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.distributions import distribution, distributions
from fin_optimizer.search.genetic import GeneticAlgorithm, mutated
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, dimension_from, generator, uniform, written

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_optimizer.search.space import AnyDimension, Search

MODULUS = Dimension("fin.young_modulus", 1e7, 2e11, "Pa", log=True)
LENGTH = Dimension("fin.length", 0.04, 0.142, "m", step=0.005)
SEGMENTS = Dimension("fin.segments", 1, 20, whole=True)
HINGES = Choice("fin.hinges", ("between", "midpoint"))
FREQUENCY = Dimension("gait.frequency", 0.5, 3.0, "Hz")
MIXED = (MODULUS, LENGTH, SEGMENTS, HINGES, FREQUENCY)

seeds = st.integers(0, 2**63)
scores = st.lists(st.none() | st.floats(-1.0, 1.0), min_size=8, max_size=8)


def deviations(space: Space) -> dict[str, float]:
    return {d.name: 0.1 * (d.high - d.low) for d in space.ranges}


def climber(space: Space, seed: int) -> Search:
    return HillClimber(space, seed, deviations(space))


def genetic(space: Space, seed: int) -> Search:
    return OneByOne(GeneticAlgorithm(space, seed, deviations(space), population=4))


def evolution_strategy(space: Space, seed: int) -> Search:
    return OneByOne(CmaEs(Space((MODULUS, FREQUENCY), space.judge), seed))


def tried(search: Search, given_scores: list[float | None]) -> list[Evaluation]:
    history: list[Evaluation] = []
    for score in given_scores:
        history.append(Evaluation(search.propose(history), score))
    return history


def fast_fins_are_short(values: Mapping[str, Any]) -> str:
    number = float(values["gait.frequency"]) * math.log10(float(values["fin.young_modulus"]))
    return "" if number <= 12.0 else f"{number:g} is above 12"


@pytest.mark.parametrize("kind", [climber, genetic, evolution_strategy])
@given(seed=seeds, given_scores=scores)
@settings(max_examples=25)
def test_every_candidate_lies_in_the_space_and_is_never_one_that_it_refuses(
    kind: Callable[[Space, int], Search], seed: int, given_scores: list[float | None]
) -> None:
    search = kind(Space(MIXED, fast_fins_are_short), seed)
    history = tried(search, given_scores)
    for entry in history:
        assert search.space.check(entry.values) == entry.values
        assert not fast_fins_are_short(entry.values)
    assert [entry.values for entry in tried(kind(Space(MIXED, fast_fins_are_short), seed), given_scores)] == [
        entry.values for entry in history
    ]


def test_each_value_has_its_own_type() -> None:
    values = uniform(Space(MIXED), generator(1, 0))
    assert [type(value) for value in values.values()] == [float, float, int, str, float]


def test_a_grid_has_short_numbers_from_the_minimum_to_the_last_step_before_the_maximum() -> None:
    drawn = {uniform(Space((LENGTH,)), generator(1, n))["fin.length"] for n in range(400)}
    assert sorted(drawn) == [
        *(float(f"{0.04 + 0.005 * place:.3f}") for place in range(21)),
    ]
    assert (LENGTH.count, LENGTH.last) == (21, 0.14)


def test_the_ends_of_a_grid_are_drawn_as_often_as_what_lies_between() -> None:
    segments = Dimension("fin.segments", 1, 3, whole=True)
    drawn = [uniform(Space((segments,)), generator(2, n))["fin.segments"] for n in range(3000)]
    # A third of 3000 has a standard deviation of 26.
    assert all(abs(drawn.count(value) - 1000) < 130 for value in (1, 2, 3))


def test_every_choice_is_drawn_as_often() -> None:
    drawn = [uniform(Space((Choice("stock", ("a", "b", "c")),)), generator(2, n))["stock"] for n in range(3000)]
    assert all(abs(drawn.count(value) - 1000) < 130 for value in "abc")


def test_a_grid_from_nothing_on_has_short_numbers_too() -> None:
    grid = Dimension("fin.length", 0.0, 0.3, "m", step=0.1)
    drawn = {uniform(Space((grid,)), generator(1, n))["fin.length"] for n in range(100)}
    assert sorted(drawn) == [0.0, 0.1, 0.2, 0.3]


def test_choices_of_a_list_are_those_of_a_tuple() -> None:
    assert Choice("stock", ["a", "b"]) == Choice("stock", ("a", "b"))  # type: ignore[arg-type]  # as from a file


def test_a_range_that_ends_at_nothing_is_written_with_its_end() -> None:
    below = Dimension("gait.bias", -0.1, 0.0, "rad")
    assert dimension_from(written(below)) == below


def test_whole_numbers_that_no_float_holds_are_refused() -> None:
    with pytest.raises(ValueError, match="maximum of x"):
        Dimension("x", 1.0, 2.0**53 + 2.0, whole=True)


def test_a_logarithm_draws_each_decade_alike() -> None:
    drawn = [uniform(Space((MODULUS,)), generator(3, n))["fin.young_modulus"] for n in range(2000)]
    share = sum(value < 1e9 for value in drawn) / 2000.0
    assert share == pytest.approx(2.0 / math.log10(2e4), abs=0.05)


def test_the_end_of_a_logarithm_stays_the_end() -> None:
    """The exponential of the logarithm of 3 is more than 3 by rounding."""
    dimension = Dimension("x", 1.0, 3.0, log=True)
    assert np.exp(np.log(3.0)) > 3.0
    assert dimension.numbers(dimension.coordinates(np.array([3.0]))) == [3.0]


def test_a_space_is_countable_where_each_of_its_parameters_is() -> None:
    assert Space((LENGTH, HINGES)).is_countable
    assert not Space((LENGTH, FREQUENCY)).is_countable


def test_what_judges_many_at_once_is_asked_where_there_is_one() -> None:
    def alone(_: Mapping[str, Any]) -> str:
        pytest.fail("one by one")

    space = Space((FREQUENCY,), alone, lambda numbers: numbers[:, 0] < 2.0)
    assert space.refused(np.array([[2.5], [1.0], [3.0]])).tolist() == [0, 2]


def test_whole_numbers_may_be_searched_in_the_logarithm() -> None:
    segments = Dimension("fin.segments", 1, 20, whole=True, log=True)
    drawn = {uniform(Space((segments,)), generator(4, n))["fin.segments"] for n in range(3000)}
    assert drawn == set(range(1, 21))


def test_a_climber_among_few_fins_never_tries_the_best_one_again() -> None:
    space = Space((Dimension("fin.length", 0.04, 0.08, "m", step=0.02), HINGES))
    best = {"fin.length": 0.06, "fin.hinges": "midpoint"}
    for seed in range(50):
        assert HillClimber(space, seed, {"fin.length": 1e-6}).propose([Evaluation(best, 1.0)]) != best


def test_a_choice_becomes_any_other_one_in_as_many_as_there_are_parameters() -> None:
    space = Space((Choice("stock", ("a", "b", "c")), FREQUENCY, HINGES))
    best = Evaluation({"stock": "b", "gait.frequency": 1.0, "fin.hinges": "midpoint"}, 1.0)
    drawn = [HillClimber(space, seed, {"gait.frequency": 0.1}).propose([best])["stock"] for seed in range(2000)]
    # Two thirds of 2000 stay, a sixth each changes; standard deviations of 21 and 17.
    assert drawn.count("b") == pytest.approx(1333, abs=105)
    assert drawn.count("a") == pytest.approx(333, abs=85)


@pytest.mark.parametrize("dimension", MIXED)
def test_what_is_written_of_a_dimension_is_read_again(dimension: AnyDimension) -> None:
    assert dimension_from(written(dimension)) == dimension


def test_a_plain_range_is_written_as_it_always_was() -> None:
    plain = Dimension("fin.length", 0.0, 0.1, "m")
    assert written(plain) == {"name": "fin.length", "minimum": 0.0, "maximum": 0.1, "unit": "m"}


@given(seeds)
def test_optuna_takes_every_candidate(seed: int) -> None:
    space = Space(MIXED)
    values = uniform(space, generator(seed, 0))
    for name, each in distributions(space).items():
        assert each._contains(each.to_internal_repr(values[name]))
        assert each.to_external_repr(each.to_internal_repr(values[name])) == values[name]


def test_optuna_is_told_what_kind_of_number_each_is() -> None:
    kinds = [type(distribution(dimension)).__name__.removesuffix("Distribution") for dimension in MIXED]
    assert kinds == ["Float", "Float", "Int", "Categorical", "Float"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            lambda: Dimension("x", 0.0, 1.0, "m", log=True),
            r"minimum of x = 0 m is outside the allowed",
        ),
        (lambda: Dimension("x", 1.0, 2.0, "m", step=2.0), r"step of x = 2 m is outside the allowed range \[0, 1\] m"),
        (lambda: Dimension("x", 1.0, 2.0, "m", step=-1.0), "step of x = -1 m"),
        (lambda: Dimension("x", 1.0, 2.0, "m", step=0.1, log=True), "has log and step = 0.1 m: choose one"),
        (lambda: Dimension("x", 1.5, 4.0, whole=True), "minimum of x = 1.5 must be a whole number"),
        (lambda: Choice("x", ("a",)), "choices of x must be two or more, each once, got"),
        (lambda: Choice("x", (1.0, 2.0, 1.0)), "choices of x must be two or more, each once"),
        (lambda: CmaEs(Space((HINGES, FREQUENCY)), 1), "CMA-ES cannot choose, as fin.hinges wants it"),
        (lambda: LENGTH.check(0.0425), "fin.length = 0.0425 m lies between two steps of 0.005 m from 0.04 m"),
        (lambda: HINGES.check("beside"), "fin.hinges = 'beside' is not one of between, midpoint"),
        (lambda: uniform(Space(MIXED, lambda _: "too thin"), generator(1, 0)), "none of 10000 .* too thin"),
    ],
)
def test_what_cannot_be_searched_is_refused(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()


def test_a_generation_that_the_space_refuses_throughout_is_drawn_from_what_it_allows() -> None:
    """No step of this size leads from where the parents are to where a child may be."""
    space = Space((Dimension("x", 0.0, 1.0),), lambda values: "" if values["x"] > 0.9 else "too small")
    children = mutated(space, np.full((3, 1), 0.1), np.array([1e-6]), np.random.default_rng(1))
    assert (children > 0.9).all()


def test_a_child_s_choice_becomes_any_other_one_in_as_many_as_there_are_parameters() -> None:
    space = Space((Choice("stock", ("a", "b", "c")), FREQUENCY, HINGES))
    parents = np.tile([1.0, 1.5, 0.0], (2000, 1))
    children = mutated(space, parents, np.array([0.0, 0.1, 0.0]), np.random.default_rng(1))
    places = children[:, 0].tolist()
    # As for the climber: two thirds of 2000 stay, a sixth each changes; standard deviations of 21 and 17.
    assert places.count(1.0) == pytest.approx(1333, abs=105)
    assert places.count(0.0) == pytest.approx(333, abs=85)
    assert places.count(2.0) == pytest.approx(333, abs=85)
