"""A candidate and its trials as the journal has them, and what follows from them: score, settled, fastest, front."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from fin_optimizer.search.space import Evaluation, Values, pareto_front
from fin_optimizer.trial.result import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from datetime import datetime

    from fin_optimizer.study.settings import Policy


@dataclass(frozen=True)
class TrialRecord:
    """One trial as the journal has it.

    Attributes:
        number: Of the trial, from 0; Optuna's number.
        candidate: Which candidate it tried, from 0; several trials repeat one candidate.
        values: The candidate, in SI units.
        outcome: What became of it.
        reason: Why it FAILED, was INTERRUPTED or is INFEASIBLE, else empty.
        score: Mean forward speed in m/s, None unless OK.
        spread: Standard deviation of the speed between blocks of the swim in m/s, None unless OK and known.
        cost: Energy per metre in J/m, None unless OK and asked for.
        samples: Number of velocities in the score.
        plant: Namespace of the fish that swam it, empty if unknown.
        bag: Its bag, relative to the study's folder.
        started: When it was begun, None while PROPOSED.
        ended: When its outcome was written, None before.
    """

    number: int
    candidate: int
    values: Values
    outcome: Outcome
    reason: str
    score: float | None
    spread: float | None
    cost: float | None
    samples: int
    plant: str
    bag: str
    started: datetime | None
    ended: datetime | None


@dataclass(frozen=True)
class Candidate:
    """A candidate and all its trials, in order."""

    number: int
    values: Values
    trials: tuple[TrialRecord, ...]

    @cached_property
    def score(self) -> float | None:
        """Mean score of its OK trials in m/s, None without any."""
        return _mean([trial.score for trial in self.trials])

    @cached_property
    def cost(self) -> float | None:
        """Mean energy per metre of its OK trials in J/m, None without any."""
        return _mean([trial.cost for trial in self.trials])

    @cached_property
    def spread(self) -> float | None:
        """Standard deviation of its OK trials' scores in m/s (n - 1 in the denominator), None with fewer than two."""
        scores = [trial.score for trial in self.trials if trial.score is not None]
        return statistics.stdev(scores) if len(scores) > 1 else None

    @property
    def evaluation(self) -> Evaluation:
        """What a search is told of it."""
        return Evaluation(self.values, self.score, self.cost)

    def wants_trial(self, policy: Policy) -> bool:
        """Whether one more trial should be begun, now that some may be under way."""
        outcomes = [trial.outcome for trial in self.trials]
        begun = outcomes.count(Outcome.OK) + outcomes.count(Outcome.RUNNING) + outcomes.count(Outcome.PROPOSED)
        return not self._given_up(policy) and begun < policy.repeats

    def settled(self, policy: Policy) -> bool:
        """Whether it needs no further trial, and none is under way: what is known of it changes no more."""
        outcomes = [trial.outcome for trial in self.trials]
        if Outcome.RUNNING in outcomes or Outcome.PROPOSED in outcomes:
            return False
        return self._given_up(policy) or outcomes.count(Outcome.OK) >= policy.repeats

    def _given_up(self, policy: Policy) -> bool:
        """Whether it is infeasible, or has failed too often."""
        outcomes = [trial.outcome for trial in self.trials]
        return Outcome.INFEASIBLE in outcomes or outcomes.count(Outcome.FAILED) >= policy.attempts


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None


def candidates(trials: Iterable[TrialRecord]) -> list[Candidate]:
    """Return the candidates of these trials in the order they were proposed."""
    groups: dict[int, list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(trial.candidate, []).append(trial)
    return [Candidate(number, group[0].values, tuple(group)) for number, group in sorted(groups.items())]


def is_for_another(candidate: Candidate, plant: str, plants: Iterable[str]) -> bool:
    """Return whether the candidate FAILED or was INTERRUPTED on this fish and not yet on every other one.

    Args:
        candidate: What is to be swum.
        plant: Namespace of the fish that could swim it now.
        plants: Namespaces of all fish that take part.
    """
    failed_on = {trial.plant for trial in candidate.trials if trial.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}}
    return plant in failed_on and any(other not in failed_on for other in plants)


def rank(candidate: Candidate) -> tuple[float, int]:
    """Return what sorts candidates with a score, the best last; of equals the first one is the best."""
    return (candidate.score if candidate.score is not None else float("-inf"), -candidate.number)


def fastest(tried: Iterable[Candidate]) -> Candidate | None:
    """Return the candidate with the highest speed, of equals the first; None if none has a score."""
    return max((c for c in tried if c.score is not None), key=rank, default=None)


def front(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates of the Pareto front of speed and energy per metre, the fastest first."""
    chosen = [tried[index] for index in pareto_front([candidate.evaluation for candidate in tried])]
    return sorted(chosen, key=rank, reverse=True)
