"""Fronts by several objectives are what their definitions say."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.search.pareto import crowding, ranks
from fin_optimizer.search.space import Evaluation, pareto_front

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

small = st.integers(0, 4)


def dominates(first: Array, second: Array) -> bool:
    return bool((first <= second).all() and (first < second).any())


def ranks_by_definition(objectives: Array) -> list[int]:
    result = [-1] * len(objectives)
    left = set(range(len(objectives)))
    front = 0
    while left:
        best = {i for i in left if not any(dominates(objectives[j], objectives[i]) for j in left)}
        for i in best:
            result[i] = front
        left -= best
        front += 1
    return result


@given(st.integers(1, 4).flatmap(lambda count: st.lists(st.tuples(*[small] * count), min_size=1, max_size=30)))
def test_fronts_are_what_is_left_when_the_fronts_before_are_taken_away(points: list[tuple[int, ...]]) -> None:
    objectives = np.array(points, dtype=float)
    assert ranks(objectives).tolist() == ranks_by_definition(objectives)


def test_a_point_of_the_first_front_leaves_the_second_as_it_is() -> None:
    assert ranks(np.array([[0.0, 1.0], [1.0, 5.0], [2.0, 0.5], [3.0, 6.0]])).tolist() == [0, 1, 0, 2]


def test_no_points_have_no_fronts() -> None:
    assert [ranks(np.empty((0, count))).size for count in (2, 3)] == [0, 0]


@given(st.lists(st.tuples(small, small), min_size=1, max_size=20))
def test_the_first_front_is_the_pareto_front_of_a_history(points: list[tuple[int, int]]) -> None:
    history = [Evaluation({"x": 0.0}, -float(a), (-float(b),)) for a, b in points]
    first = {points[place] for place in np.flatnonzero(ranks(np.array(points, dtype=float)) == 0)}
    assert {points[place] for place in pareto_front(history)} == first


def test_a_point_is_as_crowded_as_its_neighbours_are_near() -> None:
    objectives = 0.1 * np.array([[2.0, 9.0], [6.0, 1.0], [3.0, 7.0], [5.0, 2.0]])
    #                            neighbours along each objective, as shares of 4 and of 8
    shares = [math.inf, math.inf, 3.0 / 4.0 + 7.0 / 8.0, 3.0 / 4.0 + 6.0 / 8.0]
    assert crowding(objectives).tolist() == pytest.approx(shares)
    assert crowding(np.array([[1.0, 1.0]] * 3)).tolist() == [math.inf, 0.0, math.inf]
    assert crowding(np.array([[1.0, 1.0]])).tolist() == [math.inf]
    apart = crowding(np.array([[0.0, 9.0, 1.0], [5.0, 5.0, 1.0], [10.0, 0.0, 1.0]]))
    assert apart.tolist() == [math.inf, 2.0, math.inf], "an objective in which all are equal keeps none apart"
