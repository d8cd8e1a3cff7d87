"""A candidate and its trials as the journal has them, and what follows from them: score, settled, best, front."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from fin_optimizer.goals import MEAN_SPEED, Goals
from fin_optimizer.search.space import Evaluation, Values, pareto_front
from fin_optimizer.trial.result import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from datetime import datetime

    from fin_optimizer.goals import Measure
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
        measured: What was asked for, by measure in SI, the mean speed among it; nothing unless OK.
        spread: Standard deviation of the speed between blocks of the swim in m/s, None unless OK and known.
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
    measured: Mapping[str, float]
    spread: float | None
    samples: int
    plant: str
    bag: str
    started: datetime | None
    ended: datetime | None

    @property
    def score(self) -> float | None:
        """Mean forward speed in m/s, None unless OK."""
        return self.measured.get(MEAN_SPEED)


@dataclass(frozen=True)
class Candidate:
    """A candidate and all its trials, in order, and what the study looks for."""

    number: int
    values: Values
    trials: tuple[TrialRecord, ...]
    goals: Goals = field(default_factory=Goals, repr=False)

    @cached_property
    def measured(self) -> Mapping[str, float]:
        """Mean of its OK trials by measure in SI; nothing without any."""
        known = [trial.measured for trial in self.trials if trial.measured]
        return {name: statistics.fmean(each[name] for each in known) for name in (known[0] if known else ())}

    @property
    def score(self) -> float | None:
        """Mean speed of its OK trials in m/s, None without any."""
        return self.measured.get(MEAN_SPEED)

    @cached_property
    def spread(self) -> float | None:
        """Standard deviation of its OK trials' scores in m/s (n - 1 in the denominator), None with fewer than two."""
        scores = [trial.score for trial in self.trials if trial.score is not None]
        return statistics.stdev(scores) if len(scores) > 1 else None

    @property
    def evaluation(self) -> Evaluation:
        """What a search is told of it."""
        if not self.measured:
            return Evaluation(self.values, None)
        first, *others = self.goals.objectives(self.measured)
        return Evaluation(self.values, first, tuple(others), self.goals.excesses(self.measured))

    @property
    def shown(self) -> str:
        """How good it is, in words: each goal's value."""
        return self.goals.shown(self.measured)

    @property
    def missed_measures(self) -> list[str]:
        """Names of the measures of which it misses the limit."""
        limits = self.goals.constraints if self.measured else ()
        return [each.measure.name for each in limits if each.excess(self.measured[each.measure.name]) > 0.0]

    @property
    def missed(self) -> list[str]:
        """Which constraints it misses, in words."""
        return self.goals.missed(self.measured) if self.measured else []

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


def candidates(trials: Iterable[TrialRecord], goals: Goals | None = None) -> list[Candidate]:
    """Return the candidates of these trials in their order, of a study with these goals; for speed if left out."""
    groups: dict[int, list[TrialRecord]] = {}
    for trial in trials:
        groups.setdefault(trial.candidate, []).append(trial)
    goals = goals or Goals()
    return [Candidate(number, group[0].values, tuple(group), goals) for number, group in sorted(groups.items())]


def is_for_another(candidate: Candidate, plant: str, plants: Iterable[str]) -> bool:
    """Return whether the candidate FAILED or was INTERRUPTED on this fish and not yet on every other one.

    Args:
        candidate: What is to be swum.
        plant: Namespace of the fish that could swim it now.
        plants: Namespaces of all fish that take part.
    """
    failed_on = {trial.plant for trial in candidate.trials if trial.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}}
    return plant in failed_on and any(other not in failed_on for other in plants)


def rank(candidate: Candidate) -> tuple[float, float, int]:
    """Return what sorts candidates, the best last: by constraints, then by the first goal, of equals the first one."""
    evaluation = candidate.evaluation
    score = -math.inf if evaluation.score is None else evaluation.score
    return (-evaluation.violation if evaluation.score is not None else -math.inf, score, -candidate.number)


def best_of(tried: Iterable[Candidate], goal: Measure | None = None) -> Candidate | None:
    """Return the best candidate by a goal, the first if left out, of equals the first; None if none has a score.

    One that misses a constraint is best only where all do.
    """

    def place(candidate: Candidate) -> tuple[float, float, int]:
        missed, score, number = rank(candidate)
        return missed, score if goal is None else goal.direction * candidate.measured[goal.name], number

    return max((c for c in tried if c.measured), key=place, default=None)


def front(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates of the Pareto front of all goals, the best by the first goal first."""
    chosen = [tried[index] for index in pareto_front([candidate.evaluation for candidate in tried])]
    return sorted(chosen, key=rank, reverse=True)


def improvements(goal: Measure, scored: Iterable[TrialRecord]) -> Iterator[TrialRecord]:
    """Yield the trials with a score that are better than all before them."""
    best = -math.inf
    for trial in scored:
        good = goal.direction * trial.measured[goal.name]
        if good > best:
            best = good
            yield trial
