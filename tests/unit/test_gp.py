"""Bayesian optimisation where it is more than its model: what still swims, what failed, noise, steps and choices."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.search import gp
from fin_optimizer.search.features import Features
from fin_optimizer.search.gaussian_process import GaussianProcess, Kernel, Likelihood, log_improvement, log_met
from fin_optimizer.search.gp import GpSearch
from fin_optimizer.search.quasi_random import QuasiRandom
from fin_optimizer.search.random_search import RandomSearch
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, best, pareto_front, uniform
from fin_optimizer.search.stock import Sheet, sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.space import Scalar

    Array = NDArray[np.float64]

PLANE = Space((Dimension("x", 0.0, 1.0), Dimension("y", 10.0, 30.0)))
MODULUS = Dimension("fin.young_modulus", 1e8, 1e10, "Pa", log=True)
LENGTH = Dimension("fin.length", 0.04, 0.14, "m", step=0.005)
SEGMENTS = Dimension("fin.segments", 1, 1000, whole=True)
HINGES = Choice("fin.hinges", ("between", "midpoint", "root"))
THICKNESS = Choice("fin.thickness", (3e-4, 1e-3, 5e-4), "m")
MIXED = Space((MODULUS, HINGES, LENGTH, THICKNESS, SEGMENTS))


def hill(values: Mapping[str, Scalar]) -> float:
    """Return a smooth hill over `PLANE` with its top, 0, at (0.3, 24)."""
    return -((float(values["x"]) - 0.3) ** 2) - ((float(values["y"]) - 24.0) / 20.0) ** 2


def climbed(search: GpSearch, count: int, score: Callable[[Mapping[str, Scalar]], float | None]) -> list[Evaluation]:
    history: list[Evaluation] = []
    while len(history) < count:
        values = search.propose(history)
        history.append(Evaluation(values, score(values)))
    return history


def test_the_first_candidates_are_spread_over_the_space() -> None:
    search, spread = GpSearch(PLANE, 3), QuasiRandom(PLANE, 3)
    history = climbed(search, 7, hill)
    assert search.first == 6
    assert [entry.values for entry in history[:6]] == [spread.propose(history[:number]) for number in range(6)]
    assert history[6].values != spread.propose(history[:6])


def test_before_three_have_a_score_nothing_is_modelled() -> None:
    spread = QuasiRandom(PLANE, 3)
    history = [Evaluation(spread.propose([None] * number), None) for number in range(8)]  # type: ignore[list-item]
    scored = [Evaluation(entry.values, hill(entry.values)) for entry in history]
    assert GpSearch(PLANE, 3).propose([*history[:6], *scored[6:]]) == spread.propose(history)
    assert GpSearch(PLANE, 3).propose([*history[:5], *scored[5:]]) != spread.propose(history)


def test_what_still_swims_is_believed_and_not_proposed_again() -> None:
    history = climbed(GpSearch(PLANE, 3), 9, hill)
    for _ in range(4):
        values = GpSearch(PLANE, 3).propose(history)
        history.append(Evaluation(values, None, pending=True))
    places = np.array([[float(entry.values["x"]), float(entry.values["y"]) / 20.0] for entry in history])
    apart = np.linalg.norm(places[:, None] - places[None, :], axis=2)[np.triu_indices(len(places), 1)]
    assert apart.min() > 0.01
    assert len({tuple(entry.values.values()) for entry in history}) == len(history)


def test_what_failed_is_kept_away_from_and_what_still_swims_is_not() -> None:
    history = climbed(GpSearch(PLANE, 3), 9, hill)
    top = {"x": 0.35, "y": 23.0}
    pending = GpSearch(PLANE, 3).propose([*history, Evaluation(top, None, pending=True)])
    failed = GpSearch(PLANE, 3).propose([*history, Evaluation(top, None)])
    far = [abs(each["x"] - 0.35) + abs(each["y"] - 23.0) / 20.0 for each in (pending, failed)]
    assert far[0] < 0.12
    assert far[1] > far[0]


def test_a_peak_behind_what_cannot_be_measured_is_approached() -> None:
    """Beyond x = 0.25 nothing has a score: the best that has one lies there, at the height of the top."""
    history = climbed(GpSearch(PLANE, 4), 30, lambda values: hill(values) if float(values["x"]) < 0.25 else None)
    best = max(entry.score for entry in history if entry.score is not None)
    assert best > -(0.05**2) - 5e-3
    assert sum(entry.score is None for entry in history[15:]) < 12


def test_noise_is_not_climbed() -> None:
    """Scores are off by 0.05; what is found after 30 candidates is where the hill is less than that below its top."""
    random = np.random.default_rng(1)
    history = climbed(GpSearch(PLANE, 5), 30, lambda values: hill(values) + 0.05 * random.standard_normal())
    assert np.median([hill(entry.values) for entry in history[-8:]]) > -0.05


def test_what_a_condition_refuses_is_not_proposed_and_its_edge_is_found() -> None:
    space = Space(PLANE.dimensions, lambda values: "too far" if float(values["x"]) > 0.2 else "")
    history = climbed(GpSearch(space, 2), 20, hill)
    assert max(float(entry.values["x"]) for entry in history) <= 0.2
    # At the edge the hill is 0.01 below its top.
    assert max(entry.score for entry in history if entry.score is not None) > -0.013


def test_the_best_of_many_choices_is_found_by_what_they_have_in_common() -> None:
    """Of 4 * 3 * 21 * 3 = 756 candidates 40 are tried: the best hinges, thickness, length and count."""
    space = Space((HINGES, LENGTH, THICKNESS, Dimension("fin.segments", 1, 4, whole=True)))

    def score(values: Mapping[str, Scalar]) -> float:
        length, thickness, segments = (float(values[name]) for name in ("fin.length", "fin.thickness", "fin.segments"))
        hinges = {"between": 0.0, "midpoint": 0.3, "root": -0.2}[str(values["fin.hinges"])]
        return hinges - ((length - 0.09) / 0.05) ** 2 - (thickness * 1e3 - 0.5) ** 2 - 0.1 * (segments - 3.0) ** 2

    history = climbed(GpSearch(space, 1), 40, score)
    assert max(entry.score for entry in history if entry.score is not None) == pytest.approx(0.3, abs=1e-9)
    first = GpSearch(space, 1).first
    assert len({tuple(entry.values.values()) for entry in history[first:]}) == len(history) - first


def test_what_was_tried_is_tried_again_only_where_there_is_nothing_else() -> None:
    space = Space((Choice("a", ("p", "q")), Choice("b", ("r", "s"))))
    history = climbed(GpSearch(space, 1), 12, lambda values: float(values["a"] == "q") + float(values["b"] == "s"))
    assert len({tuple(entry.values.values()) for entry in history}) == 4


def test_what_is_next_to_what_was_tried_is_as_good_as_tried_and_a_step_is_not() -> None:
    stepped = Space((Dimension("x", 0.0, 1.0, "", step=0.25), Dimension("y", 10.0, 30.0)))
    promised = promise(stepped, [[0.5, 20.0], [0.25, 12.0]], [1.0, 0.0])
    rows = [[0.5, 20.0], [0.5, 20.019], [0.5, 20.021], [0.75, 20.0], [0.25, 20.0]]
    assert promised._new(np.array(rows)).tolist() == [False, False, True, True, True]
    letters = Space((Choice("a", ("p", "q")), Dimension("y", 10.0, 30.0)))
    rows = [[0.0, 20.001], [1.0, 20.0]]
    assert promise(letters, [[0.0, 20.0], [1.0, 12.0]], [1.0, 0.0])._new(np.array(rows)).tolist() == [False, True]


def test_weights_count_on_the_front_whatever_is_far_behind_it() -> None:
    """A candidate that is a hundred times worse in the second objective moves no share of the front's."""
    front = [Evaluation({"x": x, "y": 10.0}, x, (1.0 - x,)) for x in (0.0, 0.5, 1.0)]
    behind = Evaluation({"x": 0.5, "y": 30.0}, 0.1, (-100.0,))
    alone = gp._single_scores(front, np.random.default_rng(1))
    beside = gp._single_scores([*front, behind], np.random.default_rng(1))
    assert beside[:3] == alone
    last = beside[3]
    assert last is not None
    assert last < min(score for score in alone if score is not None)


def test_what_was_not_tried_is_tried_before_anything_again() -> None:
    space = Space((Choice("a", tuple("pqrstu")),))
    history = [
        Evaluation({"a": letter}, score) for letter, score in zip("pqrst", (1.0, 3.0, 2.0, 2.5, 1.5), strict=True)
    ]
    assert GpSearch(space, 1).propose(history) == {"a": "u"}


def test_of_very_many_the_best_and_the_latest_are_modelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gp, "_MOST", 6)
    scores = [5.0, None, 1.0, 9.0, 2.0, 9.0, 3.0, 4.0, None, 0.0, 7.0]
    history = [Evaluation({"x": 0.0, "y": 10.0}, score) for score in scores]
    assert gp._chosen([entry.score for entry in history]) == [0, 3, 5, 7, 9, 10]
    assert gp._chosen([entry.score for entry in history[:7]]) == [0, 2, 3, 4, 5, 6]
    assert gp._chosen([entry.score for entry in history[:8]]) == [0, 3, 5, 5, 6, 7][:0] + sorted({0, 3, 4} | {5, 6, 7})


@pytest.mark.long
def test_with_more_scores_than_are_climbed_with_at_first_all_count_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel from a part of the scores is near that from all, and the last climb makes it likelier."""
    random = np.random.default_rng(1)
    features = random.random((60, 2))
    scores = np.sin(5.0 * features[:, 0]) + 0.05 * random.standard_normal(60)
    scores = (scores - scores.mean()) / scores.std()
    groups = np.array([0, 1])
    whole = gp._likely_kernel(features, scores, groups, np.random.default_rng(2))
    monkeypatch.setattr(gp, "_MOST_FOR_START", 20)
    part = gp._likely_kernel(features, scores, groups, np.random.default_rng(2))
    assert part.logarithms == pytest.approx(whole.logarithms, abs=0.1)


class Climbed:
    """A likelihood that notes what it is climbed with and stays where it begins."""

    made: list[tuple[Array, list[Array], int]]
    start = np.log([0.5, 0.6, 1.0, 1e-3])
    bounds = Likelihood(np.array([[0.0, 0.0], [1.0, 0.5]]), np.array([0.0, 1.0]), np.array([0, 1])).bounds

    def __init__(self, features: Array, scores: Array, groups: Array) -> None:
        assert groups.tolist() == [0, 1]
        assert features[:, 0].tolist() == scores.tolist(), "each with its own"
        self._scores = scores

    def best(self, starts: list[Array], steps: int) -> Array:
        """Return the first start."""
        self.made.append((self._scores, starts, steps))
        return starts[0]


def test_the_likelihood_is_climbed_with_the_best_scores_and_some_others_from_several_starts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half of those with which it begins are the best; at last it is climbed with all, from the best end."""
    monkeypatch.setattr(gp, "Likelihood", Climbed)
    monkeypatch.setattr(gp, "_MOST_FOR_START", 4)
    scores = np.array([0.5, 3.0, -1.0, 7.0, 0.0, 1.0, 2.0])
    groups = np.array([0, 1])
    low, high = np.array(Climbed.bounds).T
    for seed in range(20):
        Climbed.made = []
        few = gp._likely_kernel(np.column_stack((scores, scores))[:4], scores[:4], groups, np.random.default_rng(seed))
        ((used, starts, steps),) = Climbed.made
        assert used.tolist() == scores[:4].tolist()
        assert steps == 30
        spread = 2.0 * np.random.default_rng(seed).standard_normal((2, 4))
        assert np.array(starts) == pytest.approx(np.vstack((Climbed.start, np.clip(Climbed.start + spread, low, high))))
        assert few.logarithms == pytest.approx(Climbed.start)
        Climbed.made = []
        gp._likely_kernel(np.column_stack((scores, scores)), scores, groups, np.random.default_rng(seed))
        (first, _, _), (last, ends, steps) = Climbed.made
        assert len(set(first.tolist())) == 4
        assert {3.0, 7.0} < set(first.tolist())
        assert (last.tolist(), len(ends), steps) == (scores.tolist(), 1, 12)


KERNEL = Kernel(np.array([0.01, 0.01]), 1.0, 0.5)
"""Of which places of `PLANE` that are far from each other tell nothing of each other."""


def at(x: float, score: float | None, *, excesses: tuple[float, ...] = (), pending: bool = False) -> Evaluation:
    return Evaluation({"x": x, "y": 20.0}, score, (), excesses, pending=pending)


def promised(history: Sequence[Evaluation], monkeypatch: pytest.MonkeyPatch) -> gp._Promise:
    """Return what is promised after a history, with `KERNEL` for scores and excesses."""
    made: list[gp._Promise] = []

    def noted(promise: gp._Promise, pool: Array) -> Array:
        made.append(promise)
        return np.asarray(pool[0])

    monkeypatch.setattr(gp, "_likely_kernel", lambda *_: KERNEL)
    monkeypatch.setattr(gp._Promise, "best_of", noted)
    GpSearch(PLANE, 3)._most_promising(history, np.random.default_rng(1))
    return made[0]


def alone(process: GaussianProcess, score: float, times: int) -> float:
    """Return what is expected where a score was told so often, and of which no other place tells."""
    return process.mean + (score - process.mean) * times / (times + 0.5)


def places(*x: float) -> Array:
    return np.column_stack((x, np.full(len(x), 0.5)))


def test_the_best_is_the_one_that_is_surely_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """At x = 0.9 one swim was the fastest, but at 0.1 eight were nearly as fast."""
    history = [at(0.5, 0.0), *(at(0.1, 2.0) for _ in range(8)), at(0.9, 2.4), at(0.3, -1.0)]
    found = promised(history, monkeypatch)
    scores = np.array([0.0, *[2.0] * 8, 2.4, -1.0])
    standard = (scores - scores.mean()) / scores.std()
    assert found.best == pytest.approx(alone(found.process, standard[1], 8))
    assert alone(found.process, standard[9], 1) < alone(found.process, standard[1], 8) < standard[9]
    assert found.limits == ()
    assert found.tried.tolist() == places(0.5, *[0.1] * 8, 0.9, 0.3).tolist()
    assert found.process.predict(places(0.9))[0] == pytest.approx(alone(found.process, standard[9], 1))


def test_equal_scores_are_no_reason_to_divide_by_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert promised([at(x, 0.02) for x in (0.1, 0.5, 0.9)], monkeypatch).best == pytest.approx(0.0)


def test_what_failed_is_as_bad_as_the_worst_and_what_swims_is_as_it_is_expected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    history = [at(0.1, 1.0), at(0.3, -1.0), at(0.5, None), at(0.7, None, pending=True), at(0.9, 0.0)]
    process = promised(history, monkeypatch).process
    worst = -1.0 / np.std([1.0, -1.0, 0.0])
    assert process.predict(places(0.5))[0] == pytest.approx(alone(process, worst, 1))
    # The believed score is what was expected before: the mean, 0, of what had a score.
    assert process.predict(places(0.7))[0] == pytest.approx(alone(process, 0.0, 1))
    only = promised([*history[:2], history[3], history[4]], monkeypatch).process
    assert only.mean == pytest.approx(0.0), "and nothing failed"
    assert only.predict(places(0.5))[1][0] > only.predict(places(0.7))[1][0]


def test_the_best_is_one_that_meets_the_constraints_and_each_has_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    told = [(0.1, 5.0, 2.0), (0.3, 1.0, -1.0), (0.5, 0.0, -2.0), (0.9, 4.0, 0.2)]
    history = [at(x, score, excesses=(excess, 3.0 * excess)) for x, score, excess in told]
    swims = at(0.7, None, pending=True)
    found = promised([*history, swims], monkeypatch)
    scores = np.array([score for _, score, _ in told])
    standard = (scores - scores.mean()) / scores.std()
    assert found.best == pytest.approx(alone(found.process, standard[1], 1))
    for limit, factor in zip(found.limits, (1.0, 3.0), strict=True):
        raw = np.arcsinh(factor * np.array([excess for _, _, excess in told]))
        told_of = raw / raw.std()
        expected = [alone(limit, each, 1) for each in told_of]
        assert limit.predict(places(0.1, 0.3, 0.5, 0.9))[0] == pytest.approx(expected)
        assert limit.mean == pytest.approx(told_of.mean()), "what swims is believed to miss as expected"
        assert limit.predict(places(0.7))[1][0] < 0.6, "as at a place that was measured"
    none = [at(x, score, excesses=(abs(excess), 0.0)) for x, score, excess in told]
    assert promised(none, monkeypatch).best is None
    met = [at(x, score, excesses=(-1.0, -1.0)) for x, score, _ in told]
    limits = promised(met, monkeypatch).limits
    assert limits[0].mean == pytest.approx(-math.asinh(1.0)), "of one excess it is the number itself"


def test_climbs_begin_near_the_best_that_meet_the_constraints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gp, "_CLIMBS", 2)
    given: list[Array] = []
    drawn = GpSearch._pool

    def noted(search: GpSearch, good: Array, random: np.random.Generator) -> Array:
        given.append(good)
        return drawn(search, good, random)

    monkeypatch.setattr(GpSearch, "_pool", noted)
    promised([at(0.1, 5.0, excesses=(1.0,)), *(at(x, x, excesses=(-1.0,)) for x in (0.3, 0.5, 0.7))], monkeypatch)
    assert given[0].tolist() == [[0.7, 20.0], [0.5, 20.0]]


def test_candidates_are_drawn_everywhere_and_near_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    good = np.array([[0.5, 20.0], [0.5, 20.0]])
    pool = GpSearch(PLANE, 1)._pool(good, np.random.default_rng(1))
    assert pool.shape == (1400, 2)
    unit = (pool - [0.0, 10.0]) / [1.0, 20.0]
    assert [unit[:1000].std(), unit[1000:1200].std(), unit[1200:].std()] == pytest.approx([0.289, 0.1, 0.01], rel=0.07)
    edge = GpSearch(PLANE, 1)._pool(np.array([[1.0, 10.0]]), np.random.default_rng(1))
    assert [edge[:, 0].max(), edge[:, 1].min()] == [1.0, 10.0]
    half = Space(PLANE.dimensions, lambda values: "no" if float(values["x"]) > 0.5 else "")
    less = GpSearch(half, 1)._pool(good, np.random.default_rng(1))
    assert less.tolist() == pool[pool[:, 0] <= 0.5].tolist()
    monkeypatch.setattr(gp, "_POOL", 0)
    monkeypatch.setattr(gp, "_NEAR", 0)
    assert GpSearch(half, 1)._pool(good, np.random.default_rng(1)).tolist() == [
        half.row(uniform(half, np.random.default_rng(1)))
    ]


def limited_promise(best: float | None) -> gp._Promise:
    """Return a promise over `PLANE` with two constraints."""
    rows = np.random.default_rng(2).uniform([0.0, 10.0], [1.0, 30.0], (8, 2))
    features = Features(PLANE)
    kernel = Kernel(np.full(2, 0.4), 1.0, 1e-4)
    x, y = features.unit(rows).T
    process, first, second = (
        GaussianProcess(features.of(rows), told, features.groups, kernel) for told in (x - y, 0.3 - x, y - 0.6)
    )
    return gp._Promise(PLANE, features, process, best, (first, second), features.unit(rows))


@pytest.mark.parametrize("best", [None, 0.2])
def test_a_promise_is_what_is_improved_and_how_likely_each_constraint_is_met(best: float | None) -> None:
    given = limited_promise(best)
    rows = np.array([[0.25, 15.0], [0.6, 22.0], [0.9, 28.0]])
    points = given.features.unit(rows)
    expected = sum(log_met(*limit.predict(points)) for limit in given.limits)
    if best is not None:
        expected = expected + log_improvement(*given.process.predict(points), best, 1e-4)
    assert given.of(rows) == pytest.approx(expected)
    tried = np.array([given.tried[0] * [1.0, 20.0] + [0.0, 10.0]])
    assert given.of(tried)[0] < -1e29
    for row, point in zip(rows, points, strict=True):
        value, slope = given._with_slope(point)
        assert value == pytest.approx(given.of(row[None, :])[0])
        for column, width in enumerate((1.0, 20.0)):
            aside = np.zeros(2)
            aside[column] = 1e-5 * width
            rise = (given.of((row + aside)[None, :]) - given.of((row - aside)[None, :]))[0]
            assert slope[column] == pytest.approx(rise / 2e-5, rel=1e-4)


def test_the_most_promising_of_a_pool_are_climbed_from_and_the_best_end_or_start_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = limited_promise(0.2)
    pool = np.random.default_rng(3).uniform([0.0, 10.0], [1.0, 30.0], (12, 2))
    order = pool[np.argsort(-given.of(pool))]
    begun: list[list[float]] = []

    def down(_: gp._Promise, start: Array) -> Array:
        begun.append(start.tolist())
        return np.asarray(order[-1])

    monkeypatch.setattr(gp._Promise, "_climbed", down)
    assert given.best_of(pool).tolist() == order[0].tolist()
    assert begun == order[:4].tolist()
    monkeypatch.setattr(gp._Promise, "_climbed", lambda _, start: order[0] if start[0] == order[3, 0] else order[-1])
    assert given.best_of(pool[1:] if pool[0, 0] == order[0, 0] else pool).tolist() == order[0].tolist()


@pytest.mark.parametrize(
    ("space", "last", "rounds"), [(PLANE, 9.0, 1), (MIXED, 9.0, 3), (MIXED, 1.0, 2), (MIXED, 0.0, 1)]
)
def test_a_climb_goes_round_while_it_leads_on_and_there_are_values_to_change(
    space: Space, last: float, rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    moves: list[float] = []

    def moved(_: gp._Promise, start: Array) -> Array:
        moves.append(float(start[0]))
        return np.asarray(np.minimum(start + 0.5, last))

    monkeypatch.setattr(gp._Promise, "_moved", moved)
    monkeypatch.setattr(gp._Promise, "_switched", lambda _, start: np.minimum(start + 0.5, last))
    features = Features(space)
    given = gp._Promise(space, features, None, None, (), np.zeros((0, 1)))  # type: ignore[arg-type]
    assert given._climbed(np.zeros(1))[0] == min(float(rounds), last)
    assert len(moves) == rounds


def test_a_climb_stops_where_the_space_refuses_its_end() -> None:
    rows = np.random.default_rng(2).uniform([0.0, 10.0], [1.0, 30.0], (8, 2))
    scores = [hill({"x": x, "y": y}) for x, y in rows.tolist()]
    start = np.array([0.9, 12.0])
    way = promise(PLANE, rows.tolist(), scores)._moved(start) - start
    assert way[0] == pytest.approx(0.1), "it ends at the edge of the range"
    for most, share in ((0.9, 0.5), (0.4, 0.25), (0.2, 0.125), (0.1, 0.0)):
        within = Space(
            PLANE.dimensions,
            lambda values, most=most: "" if abs(float(values["x"]) - 0.9) <= most * abs(way[0]) else "no",  # type: ignore[misc]
        )
        moved = promise(within, rows.tolist(), scores)._moved(start)
        assert moved == pytest.approx(start + share * way)


def test_weighted_scores_are_costs_as_shares_of_the_front() -> None:
    """The front is (0, 3), (1, 2), (2, 1): costs from 0 to 1; what is behind it costs more, as a logarithm."""
    values = [(0.0, 3.0), (1.0, 2.0), (2.0, 1.0), (-1.0, 0.0), (0.2, -97.0)]
    history = [Evaluation({"x": 0.5, "y": 20.0}, first, (second,)) for first, second in values]
    history.insert(2, at(0.5, None))
    costs = np.array(
        [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [1.0 + np.log(1.5), 1.0 + np.log(1.5)], [0.9, 1 + np.log(50)]]
    )
    weights = np.random.default_rng(1).dirichlet([1.0, 1.0])
    expected = [-max(weights * cost) - 0.05 * sum(weights * cost) for cost in costs]
    found = gp._single_scores(history, np.random.default_rng(1))
    assert found[2] is None
    assert [each for each in found if each is not None] == pytest.approx(expected)


def test_where_the_front_is_one_fin_or_none_costs_are_shares_of_all_that_is_known() -> None:
    weights = np.random.default_rng(1).dirichlet([1.0, 1.0])
    one = [Evaluation({"x": 0.5, "y": 20.0}, first, (5.0,)) for first in (1.0, 0.5)]
    assert gp._single_scores(one, np.random.default_rng(1)) == pytest.approx([0.0, -1.05 * weights[0]])
    missed = [Evaluation({"x": 0.5, "y": 20.0}, first, (second,), (9.0,)) for first, second in ((1.0, 2.0), (3.0, 1.0))]
    expected = [-1.05 * weights[0], -1.05 * weights[1]]
    assert gp._single_scores(missed, np.random.default_rng(1)) == pytest.approx(expected)


def test_one_objective_is_the_score_itself() -> None:
    assert gp._single_scores([at(0.1, 3.0), at(0.2, None), at(0.3, 1.0)], np.random.default_rng(1)) == [3.0, None, 1.0]


def promise(space: Space, rows: list[list[float]], scores: list[float]) -> gp._Promise:
    features = Features(space)
    kernel = Kernel(np.full(len(space.names), 0.4), 1.0, 1e-4)
    process = GaussianProcess(features.of(np.array(rows)), np.array(scores), features.groups, kernel)
    return gp._Promise(space, features, process, max(scores), (), features.unit(np.array(rows)))


def test_a_climb_leads_up() -> None:
    rows = np.random.default_rng(2).uniform([0.0, 10.0], [1.0, 30.0], (8, 2))
    scores = [hill({"x": x, "y": y}) for x, y in rows.tolist()]
    promised = promise(PLANE, rows.tolist(), scores)
    starts = np.array([[0.1, 12.0], [0.9, 12.0], [0.1, 28.0], [0.9, 28.0]])
    ends = np.array([promised._moved(start) for start in starts])
    assert (promised.of(ends) > promised.of(starts) + 0.1).all()
    aside = np.array([0.01, 0.0])
    assert all(
        (promised.of(ends) >= promised.of(np.clip(ends + d, [0, 10], [1, 30])) - 1e-4).all() for d in (aside, -aside)
    )


def test_halfway_between_two_fins_that_are_alike_most_is_promised() -> None:
    middle = promise(Space((Dimension("x", 0.0, 1.0),)), [[0.0], [1.0]], [0.0, 0.0])
    ends = [middle._moved(np.array([start]))[0] for start in (0.2, 0.9)]
    assert ends == pytest.approx([0.5, 0.5], abs=1e-3)


def test_of_few_values_the_most_promising_that_can_be_is_taken() -> None:
    every = np.array([[round(0.04 + 0.005 * place, 3)] for place in range(21)])
    rows, scores = [[0.04], [0.09], [0.14]], [0.0, 1.0, 0.2]
    free = promise(Space((LENGTH,)), rows, scores)
    best = every[int(np.argmax(free.of(every)))]
    assert best not in (0.04, 0.09, 0.14)
    assert free._switched(np.array([0.04])) == pytest.approx(best)
    refusing = Space((LENGTH,), lambda values: "no" if float(values["fin.length"]) == best[0] else "")
    other = promise(refusing, rows, scores)
    second = every[int(np.argsort(-free.of(every))[1])]
    assert other._switched(np.array([0.04])) == pytest.approx(second)


def limited(values: Mapping[str, Scalar]) -> Evaluation:
    """Return the hill of `hill`, of which only the part with x from 0.55 on may be: the best is (0.55, 24)."""
    return Evaluation(values, hill(values), (), (0.55 - float(values["x"]), float(values["y"]) - 100.0))


def test_a_constraint_is_learnt_and_the_best_that_meets_it_is_found() -> None:
    search, history = GpSearch(PLANE, 3), list[Evaluation]()
    while len(history) < 20:
        history.append(limited(search.propose(history)))
    found = best(history)
    assert found is not None
    assert found.violation == 0.0
    assert float(found.values["x"]) == pytest.approx(0.55, abs=0.02)
    assert float(found.values["y"]) == pytest.approx(24.0, abs=1.0)
    late = [entry.violation for entry in history[10:]]
    assert sum(miss > 0.1 for miss in late) <= 2, "what surely misses by much is not swum"


def test_while_nothing_meets_the_constraints_the_likeliest_is_proposed() -> None:
    """Each excess falls towards y = 30, beyond which it would be met, whatever the score says."""
    spread = QuasiRandom(PLANE, 3)
    history: list[Evaluation] = []
    for number in range(8):
        values = spread.propose([None] * number)  # type: ignore[list-item]
        history.append(Evaluation(values, hill(values), (), (31.0 - float(values["y"]),)))
    assert float(GpSearch(PLANE, 3).propose(history)["y"]) > 29.0


def test_a_fin_whose_excess_is_not_known_yet_is_not_proposed_again() -> None:
    history = [limited(QuasiRandom(PLANE, 3).propose([None] * number)) for number in range(8)]  # type: ignore[list-item]
    first = GpSearch(PLANE, 3).propose(history)
    second = GpSearch(PLANE, 3).propose([*history, Evaluation(first, None, pending=True)])
    assert abs(float(first["x"]) - float(second["x"])) + abs(float(first["y"]) - float(second["y"])) / 20.0 > 0.01


def zdt1(values: Mapping[str, Scalar]) -> Evaluation:
    """Return ZDT1 (Zitzler, Deb & Thiele 2000) with two parameters; its front is f2 = 1 - sqrt(f1) at y = 10."""
    first, slope = float(values["x"]), 1.0 + 9.0 * (float(values["y"]) - 10.0) / 20.0
    return Evaluation(values, -first, (slope * (math.sqrt(first / slope) - 1.0),))


def covered(history: Sequence[Evaluation]) -> float:
    """Return the area between the front and (1, 1), of which the whole front of `zdt1` covers 2/3."""
    points = sorted({(-e.score, -e.others[0]) for e in history if e.score is not None})
    area, height = 0.0, 1.0
    for first, second in points:
        area += max(0.0, 1.0 - first) * max(0.0, height - second)
        height = min(height, second)
    return area


def nearest(history: Sequence[Evaluation]) -> float:
    """Return how far the two candidates that are most alike are apart in `PLANE`, in the parameter that differs most.

    As a share of its range.
    """
    places = np.array([[float(entry.values["x"]), (float(entry.values["y"]) - 10.0) / 20.0] for entry in history])
    apart = np.abs(places[:, None] - places[None, :]).max(axis=2)
    return float(apart[np.triu_indices(len(places), 1)].min())


def test_two_objectives_lead_to_their_front_with_few_swims_and_a_resumed_search_does_the_same() -> None:
    search, history = GpSearch(PLANE, 5), list[Evaluation]()
    while len(history) < 24:
        history.append(zdt1(search.propose(history)))
    drawn = [zdt1(RandomSearch(PLANE, 5).propose([None] * number)) for number in range(24)]  # type: ignore[list-item]
    assert covered(history) > 0.6, "of 0.667"
    assert nearest(history) >= 0.999e-3, "a swim that is known by another is lost"
    assert covered(drawn) < 0.4
    assert len(pareto_front(history)) >= 10
    for number in (8, 17, 23):
        assert GpSearch(PLANE, 5).propose(history[:number]) == history[number].values


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
def test_the_front_of_two_objectives_is_covered_well_with_every_seed(seed: int) -> None:
    history: list[Evaluation] = []
    while len(history) < 40:
        history.append(zdt1(GpSearch(PLANE, seed).propose(history)))
    assert covered(history) > 0.62, "measured were 0.630 to 0.643 of 0.667"
    assert nearest(history) >= 0.999e-3


def of_1200(name: str, modulus: float, thickness: float) -> Sheet:
    return sheet(name, {"young_modulus": modulus, "thickness": thickness, "density": 1200.0})


def test_sheets_that_are_alike_by_stiffness_thickness_and_density_are_near_each_other() -> None:
    sheets = [of_1200(f"s{n}", modulus, thickness) for n, (modulus, thickness) in enumerate(SHEETS)]
    stock = Choice("stock", tuple(each.name for each in sheets), traits=tuple(each.traits for each in sheets))
    features = Features(Space((stock, MODULUS)))
    points = features.of(np.array([[float(n), 1e9] for n in range(4)]))
    assert points.shape == (4, 3), "the density is the same for all"
    assert features.groups.tolist() == [0, 1, 2], "stiffness and thickness have a length each"
    assert features.columns == [2]
    stiffness = [math.log(e * h**3) for e, h in SHEETS]
    expected = (np.array(stiffness) - min(stiffness)) / (max(stiffness) - min(stiffness))
    assert points[:, 0] == pytest.approx(expected)
    twins = Choice("stock", ("a", "b", "c"), traits=((1.0, 2.0), (1.0, 2.0), (0.0, 2.0)))
    assert Features(Space((twins,))).groups.tolist() == [0, 0, 0], "a and b cannot be told apart by what is known"


SHEETS = ((1e9, 5e-4), (2e9, 5e-4), (3e9, 1e-3), (1e9, 2e-3))


def test_a_drawer_of_thirty_sheets_is_searched_with_few_swims() -> None:
    """The speed depends on the stiffness alone: 8 sheets tell enough to find the best of 30, or one beside it."""
    sheets = [of_1200(f"s{n}", 1e9 + 2e8 * (7 * n % 13), 2e-4 + 5e-5 * (n % 10)) for n in range(30)]
    stock = Choice("stock", tuple(each.name for each in sheets), traits=tuple(each.traits for each in sheets))
    search, history = GpSearch(Space((stock,)), 4), list[Evaluation]()
    speeds = {each.name: -((each.traits[0] - math.log(0.1)) ** 2) for each in sheets}
    while len(history) < 12:
        values = search.propose(history)
        history.append(Evaluation(values, speeds[values["stock"]]))
    better = sorted(speeds.values(), reverse=True)
    assert max(entry.score or -9.0 for entry in history) >= better[1]


class TestFeatures:
    """A space as a model sees it."""

    def test_a_range_is_one_feature_and_so_is_a_choice_among_numbers(self) -> None:
        features = Features(MIXED)
        assert features.groups.tolist() == [0, 1, 1, 1, 2, 3, 4]
        assert (features.counts, features.moving, features.columns) == ([0, 3, 21, 3, 1000], [0], [0])
        rows = np.array([[1e9, 1.0, 0.04, 0.0, 1.0], [1e10, 2.0, 0.14, 1.0, 1000.0], [1e8, 0.0, 0.09, 2.0, 500.0]])
        apart = np.sqrt(0.5)
        found = features.of(rows)
        assert found[0] == pytest.approx([0.5, 0.0, apart, 0.0, 0.5 / 21, 0.0, 0.5e-3])
        assert found[1] == pytest.approx([1.0, 0.0, 0.0, apart, 20.5 / 21, 1.0, 0.9995])
        assert found[2] == pytest.approx([0.0, apart, 0.0, 0.0, 0.5, 2.0 / 7.0, 0.4995])

    def test_places_in_the_box_are_candidates_and_back(self) -> None:
        features = Features(MIXED)
        unit = np.random.default_rng(1).random((50, 5))
        numbers = features.numbers(unit)
        for row in numbers:
            MIXED.check(MIXED.values(row.tolist()))
        assert features.unit(numbers)[:, 0] == pytest.approx(unit[:, 0])
        assert abs(features.unit(numbers) - unit).max(axis=0)[1:] == pytest.approx(
            [1 / 6, 1 / 42, 1 / 6, 5e-4], rel=0.1
        )
        assert features.numbers(features.unit(numbers)) == pytest.approx(numbers)
        outside = features.numbers(np.array([[-0.1] * 5, [1.1] * 5]))
        assert outside[0] == pytest.approx([1e8, 0.0, 0.04, 0.0, 1.0])
        assert outside[1] == pytest.approx([1e10, 2.0, 0.14, 2.0, 1000.0])

    def test_alternatives_are_all_values_or_the_nearest(self) -> None:
        features = Features(MIXED)
        assert features.alternatives(1, 2.0, 2).tolist() == [0.0, 1.0, 2.0]
        assert features.alternatives(2, 0.07, 4).tolist() == [0.06, 0.065, 0.07, 0.075]
        assert features.alternatives(2, 0.07, 50).tolist() == [round(0.04 + 0.005 * i, 3) for i in range(21)]
        assert features.alternatives(2, 0.14, 25).tolist() == features.alternatives(2, 0.07, 50).tolist()
        assert features.alternatives(4, 1.0, 4).tolist() == [1.0, 2.0, 3.0, 4.0]
        assert features.alternatives(4, 999.0, 4).tolist() == [997.0, 998.0, 999.0, 1000.0]
        assert features.alternatives(4, 1000.0, 4).tolist() == [997.0, 998.0, 999.0, 1000.0]

    def test_a_number_among_names_is_one_of_the_names(self) -> None:
        features = Features(Space((Choice("a", ("thin", 2.0)),)))
        assert features.of(np.array([[1.0]]))[0] == pytest.approx([0.0, np.sqrt(0.5)])

    def test_truth_values_are_no_numbers(self) -> None:
        features = Features(Space((Choice("a", (False, True)), Choice("b", (2.0, 6.0, 3.0)))))
        assert features.of(np.array([[1.0, 2.0]]))[0] == pytest.approx([0.0, np.sqrt(0.5), 0.25])
