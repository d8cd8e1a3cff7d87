"""What is made of a candidate's trials: its score and spread, and whether it needs one more."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from fin_optimizer.goals import Goals
from fin_optimizer.study.candidate import Candidate, TrialRecord, best_of, candidates, front, is_for_another, rank
from fin_optimizer.study.settings import Policy
from fin_optimizer.trial.result import Outcome

TWICE = Policy(repeats=2, attempts=2)
OUTCOMES = {
    "P": Outcome.PROPOSED,
    "R": Outcome.RUNNING,
    "O": Outcome.OK,
    "F": Outcome.FAILED,
    "I": Outcome.INTERRUPTED,
    "X": Outcome.INFEASIBLE,
}


def trial(
    number: int, outcome: Outcome, score: float | None = None, candidate: int = 0, plant: str = ""
) -> TrialRecord:
    measured = {} if score is None else {"mean_speed": score, "energy_per_metre": 10.0 * score}
    return TrialRecord(number, candidate, {}, outcome, "", measured, None, 0, plant, "", None, None)


def with_outcomes(letters: str) -> Candidate:
    return Candidate(0, {}, tuple(trial(number, OUTCOMES[letter]) for number, letter in enumerate(letters)))


def with_scores(*scores: float | None, number: int = 0) -> Candidate:
    return Candidate(number, {}, tuple(trial(place, Outcome.OK, score) for place, score in enumerate(scores)))


def test_a_candidates_score_and_spread_are_those_of_its_ok_trials() -> None:
    """Of 1, 2 and 6 the mean is 3, the squares of the differences are 4 + 1 + 9 = 14, and 14 / 2 = 7."""
    candidate = with_scores(1.0, None, 2.0, 6.0)
    assert candidate.score == 3.0
    assert candidate.measured == {"mean_speed": 3.0, "energy_per_metre": 30.0}
    assert candidate.spread == pytest.approx(7.0**0.5, rel=1e-15)
    assert with_scores(1.0, 3.0).spread == pytest.approx(2.0**0.5, rel=1e-15)
    assert with_scores(1.0, None).spread is None
    assert (with_scores().score, with_scores().measured, with_scores().spread) == (None, {}, None)


@pytest.mark.parametrize("letters", ["", "O", "R", "P", "F", "I", "III", "OF", "OI", "FR"])
def test_a_candidate_wants_as_many_trials_as_are_asked_for(letters: str) -> None:
    assert with_outcomes(letters).wants_trial(TWICE)


@pytest.mark.parametrize("letters", ["OO", "OR", "OP", "RP", "PP", "RR", "FF", "FIF", "X", "OX", "OFF"])
def test_a_candidate_with_enough_trials_under_way_or_given_up_wants_none(letters: str) -> None:
    assert not with_outcomes(letters).wants_trial(TWICE)


SETTLED = ("OO", "OOO", "FF", "X", "OFF")
NOT_SETTLED = ("", "O", "OF", "OOR", "OOP", "FFR", "XP")


@pytest.mark.parametrize("letters", [*SETTLED, *NOT_SETTLED])
def test_a_candidate_is_settled_when_nothing_changes_it_any_more(letters: str) -> None:
    assert with_outcomes(letters).settled(TWICE) is (letters in SETTLED)


def test_a_candidate_goes_to_a_fish_on_which_it_has_not_failed() -> None:
    trials = (trial(0, Outcome.FAILED, plant="/a"), trial(1, Outcome.INTERRUPTED, plant="/b"))
    tried = Candidate(0, {}, (*trials, trial(2, Outcome.OK, 1.0, plant="/c")))
    assert is_for_another(tried, "/a", ["/a", "/b", "/c"])
    assert is_for_another(tried, "/b", ["/a", "/b", "/c"])
    assert not is_for_another(tried, "/c", ["/a", "/b", "/c"])
    assert not is_for_another(tried, "/a", ["/a", "/b"])


def test_trials_are_put_together_by_candidate_and_the_first_of_equals_is_the_best_of() -> None:
    mixed = [trial(0, Outcome.OK, 1.0, 1), trial(1, Outcome.OK, 3.0), trial(2, Outcome.OK, 5.0, 1)]
    found = candidates(mixed)
    assert [(each.number, [one.number for one in each.trials]) for each in found] == [(0, [1]), (1, [0, 2])]
    assert best_of(found) is found[0]
    assert best_of([with_scores(None)]) is None


def test_candidates_are_ranked_by_speed_then_by_number_and_those_without_a_score_come_last() -> None:
    slow, fast, same, none = (with_scores(score, number=n) for n, score in enumerate((-1.0, 2.0, 2.0, None)))
    assert sorted([fast, none, slow, same], key=rank, reverse=True) == [fast, same, slow, none]


def test_the_front_is_shown_from_the_fastest_on() -> None:
    """A trial's energy is ten times its speed here, so that none is better than another in both."""
    goals = Goals.of_objective("speed_and_cost_of_transport")
    tried = [replace(with_scores(score, number=n), goals=goals) for n, score in enumerate((1.0, 3.0, None, 2.0))]
    assert [each.number for each in front(tried)] == [1, 3, 0]


def test_without_a_score_a_candidate_is_behind_all_others_and_misses_nothing() -> None:
    goals = Goals.of(["mean_speed"], ["energy_per_metre <= 20 J/m"])
    at_the_limit, beyond, none, too = (
        replace(with_scores(score, number=n), goals=goals) for n, score in enumerate((2.0, 2.5, None, None))
    )
    assert sorted([too, beyond, none, at_the_limit], key=rank, reverse=True) == [at_the_limit, beyond, none, too]
    assert rank(too) == (-math.inf, -math.inf, -3)
    assert [each.missed_measures for each in (at_the_limit, beyond, none)] == [[], ["energy_per_metre"], []]
    assert [len(each.missed) for each in (at_the_limit, beyond, none)] == [0, 1, 0]
