"""Candidates that no score decides, and Optuna's estimator asked with a history that is given."""

from __future__ import annotations

import math
import pickle
from typing import TYPE_CHECKING

import numpy as np
import optuna
import pytest
from scipy.stats import qmc

from fin_optimizer.search import quasi_random, tpe
from fin_optimizer.search.distributions import distributions
from fin_optimizer.search.quasi_random import QuasiRandom
from fin_optimizer.search.random_search import RandomSearch
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, generator, uniform
from fin_optimizer.search.tpe import Tpe

if TYPE_CHECKING:
    from fin_optimizer.search.space import Search

PLANE = Space((Dimension("x", 0.0, 1.0), Dimension("y", 1.0, 100.0, log=True)))
MIXED = Space((*PLANE.dimensions, Dimension("n", 2, 9, whole=True), Choice("c", ("p", "q", "r"))))


def spread(search: Search, count: int) -> list[Evaluation]:
    history: list[Evaluation] = []
    while len(history) < count:
        history.append(Evaluation(search.propose(history), None))
    return history


def test_random_candidates_are_drawn_evenly_each_by_itself() -> None:
    history = spread(RandomSearch(MIXED, 5), 3)
    assert [entry.values for entry in history] == [uniform(MIXED, generator(5, number)) for number in range(3)]


def test_quasi_random_candidates_leave_no_gap() -> None:
    """Of 64 points of a scrambled sequence one lies in each of 64 equal boxes, whichever way the square is cut."""
    history = spread(QuasiRandom(PLANE, 5), 64)
    unit = np.array([[float(e.values["x"]), math.log(float(e.values["y"])) / math.log(100.0)] for e in history])
    for columns, rows in ((64, 1), (8, 8), (1, 64), (16, 4)):
        boxes = {(int(x * columns), int(y * rows)) for x, y in unit}
        assert len(boxes) == 64
    one_after_another = spread(QuasiRandom(MIXED, 5), 48)
    assert sorted({entry.values["n"] for entry in one_after_another}) == list(range(2, 10))
    assert {entry.values["c"] for entry in one_after_another} == {"p", "q", "r"}


def test_the_points_are_those_of_scipys_sequence_and_no_copy_carries_them() -> None:
    search = QuasiRandom(PLANE, 5)
    points = qmc.Sobol(2, rng=generator(5, 0)).random(4)
    assert [entry.values["x"] for entry in spread(search, 4)] == points[:, 0].tolist()
    assert pickle.dumps(search) == pickle.dumps(QuasiRandom(PLANE, 5))


def test_a_point_asked_for_at_once_is_the_one_reached_step_by_step() -> None:
    history = spread(QuasiRandom(PLANE, 5), 200)
    for number in (199, 130, 64, 63, 0):
        assert QuasiRandom(PLANE, 5).propose(history[:number]) == history[number].values
    assert len({entry.values["x"] for entry in history}) == 200


def test_what_the_space_refuses_is_left_out_of_the_sequence() -> None:
    half = Space(PLANE.dimensions, lambda values: "" if float(values["x"]) < 0.5 else "too large")
    whole = [entry.values for entry in spread(QuasiRandom(PLANE, 5), 300)]
    kept = [values for values in whole if values["x"] < 0.5]
    assert [entry.values for entry in spread(QuasiRandom(half, 5), 100)] == kept[:100]


def test_a_space_that_refuses_everything_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quasi_random, "_MOST_REFUSED", 128)
    nothing = Space(PLANE.dimensions, lambda values: f"x = {values['x']!r} is not enough")
    last = spread(QuasiRandom(PLANE, 5), 128)[-1].values["x"]
    with pytest.raises(ValueError, match=f"none of 128 candidates spread .* can be; the last one: x = {last!r} is not"):
        QuasiRandom(nothing, 5).propose([])
    asked: list[int] = []

    def every_second_block(_: object) -> str:
        asked.append(1)
        return "" if len(asked) % 128 == 0 else "no"

    rare = Space(PLANE.dimensions, every_second_block)
    assert len(spread(QuasiRandom(rare, 5), 1)) == 1, "refused in one block, not in the second"


def by_optuna(history: list[Evaluation], seed: int, *, several: bool, limited: bool) -> dict[str, object]:
    """Ask Optuna's own study, filled with the history, for the next candidate; the second objective is a cost."""
    sampler = optuna.samplers.TPESampler(seed=seed, constant_liar=True)
    study = optuna.create_study(sampler=sampler, directions=["maximize", "minimize"] if several else ["maximize"])
    state = optuna.trial.TrialState
    for entry in history:
        known = entry.score is not None
        numbers = [entry.score, *(-other for other in entry.others)]
        none = {"0": math.inf, "1": math.inf}
        study.add_trial(
            optuna.create_trial(
                state=state.COMPLETE if known else state.RUNNING if entry.pending else state.PRUNED,
                params=dict(entry.values),
                distributions=distributions(MIXED),
                values=numbers if known else None,  # type: ignore[arg-type]
                constraints=None if not limited else dict(zip("01", entry.excesses, strict=True)) if known else none,
            )
        )
    return study.ask(distributions(MIXED)).params


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("count", [9, 10, 11, 30])
def test_a_candidate_is_the_one_that_optuna_proposes_after_the_same_trials(
    count: int, several: bool, limited: bool
) -> None:
    search = Tpe(MIXED, 7, 1 + several, 2 * limited)
    history = []
    for number, entry in enumerate(spread(QuasiRandom(MIXED, 3), count)):
        x, n = float(entry.values["x"]), float(entry.values["n"])
        others, excesses = (-x,) if several else (), (0.5 - x, n - 3.0) if limited else ()
        known = number % 6 != 4
        score = -((x - 0.3) ** 2) - n
        scored = Evaluation(entry.values, score, others, excesses)
        history.append(scored if known else Evaluation(entry.values, None, pending=number % 12 == 4))
    seed = int(generator(7, count).integers(2**32))
    found = search.propose(history)
    expected = by_optuna(history, seed, several=several, limited=limited)
    assert {name: found[name] for name in ("n", "c")} == {name: expected[name] for name in ("n", "c")}
    assert [found["x"], found["y"]] == pytest.approx([expected["x"], expected["y"]], rel=1e-12)


@pytest.mark.parametrize("limited", [False, True])
def test_where_nothing_has_a_score_what_failed_is_told_from_what_swims_as_optuna_does(limited: bool) -> None:
    spread_out = spread(QuasiRandom(MIXED, 3), 30)
    history = [Evaluation(entry.values, None, pending=number % 2 == 0) for number, entry in enumerate(spread_out)]
    seed = int(generator(7, 30).integers(2**32))
    found = Tpe(MIXED, 7, 1, 2 * limited).propose(history)
    expected = by_optuna(history, seed, several=False, limited=limited)
    assert [found["x"], found["y"]] == pytest.approx([expected["x"], expected["y"]], rel=1e-12)


def test_trials_are_told_by_their_state_and_all_of_them_if_none_is_named() -> None:
    state = optuna.trial.TrialState
    history = tpe._History([optuna.study.StudyDirection.MAXIMIZE])
    history.trials = [optuna.trial.create_trial(state=each) for each in (state.PRUNED, state.RUNNING, state.PRUNED)]
    assert history.get_all_trials(0, states=(state.PRUNED,)) == [history.trials[0], history.trials[2]]
    assert history.get_all_trials(0) == history.trials


def test_a_copy_has_the_same_objectives() -> None:
    history = [Evaluation(e.values, float(e.values["x"]), (-1.0,), (0.5,)) for e in spread(QuasiRandom(MIXED, 3), 12)]
    both = Tpe(MIXED, 7, 2, 1)
    copied = pickle.loads(pickle.dumps(both))  # noqa: S301  (our own)
    assert copied == both
    assert copied.propose(history) == both.propose(history) != Tpe(MIXED, 7).propose(history)
    assert pickle.dumps(both) == pickle.dumps(Tpe(MIXED, 7, 2, 1)), "no copy carries the trials"


def test_a_trial_is_made_anew_only_for_what_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    make = Tpe._new_trial

    def noted(search: Tpe, number: int, entry: Evaluation) -> optuna.trial.FrozenTrial:
        made.append(number)
        return make(search, number, entry)

    monkeypatch.setattr(Tpe, "_new_trial", noted)
    search = Tpe(MIXED, 7)
    history = spread(search, 5)
    assert made == [0, 1, 2, 3]
    history[1] = Evaluation(history[1].values, 3.0)
    search.propose(history)
    assert made == [0, 1, 2, 3, 1, 4]


def test_a_candidate_that_is_refused_is_drawn_again_and_at_last_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    large = Space(MIXED.dimensions, lambda values: "" if float(values["x"]) > 0.6 else "too small")
    assert min(float(entry.values["x"]) for entry in spread(Tpe(large, 7), 20)) > 0.6
    monkeypatch.setattr(tpe, "_REDRAWS", 0)
    random = generator(7, 0)
    random.integers(2**32)
    assert Tpe(large, 7).propose([]) == uniform(large, random)


def test_steps_have_their_own_digits() -> None:
    space = Space((Dimension("fin.length", 0.04, 0.14, "m", step=0.005), Dimension("x", 0.0, 1.0)))
    lengths = [entry.values["fin.length"] for entry in spread(Tpe(space, 7), 30)]
    assert set(lengths) <= {round(0.04 + 0.005 * place, 3) for place in range(21)}
