"""What a study tells of itself, gathered for its page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, cast

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.report.film import film_of
from fin_optimizer.report.simulated import (
    DEFAULT_FISH,
    KeptSpeeds,
    Simulated,
    curves_through,
    key_of,
    map_of,
    numbers_of,
    to_swim_again,
)
from fin_optimizer.report.transfer import Transfer, transfer
from fin_optimizer.study.candidate import best_of, candidates
from fin_optimizer.study.simulated_curve import TOLD, SimulatedFish, can_be_computed
from fin_optimizer.trial.result import Outcome
from fin_plant.fin import node_table
from fin_sim.source_digest import simulator_digest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.goals import Measure
    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.settings import Settings
    from fin_plant.parameters import Value


@dataclass(frozen=True)
class StudyFacts:
    """What a study tells of itself.

    Attributes:
        name: What it is called: its folder's name.
        settings: Of the study.
        trials: All of them.
        fish: What swam, as the journal has it; empty if it is not known.
        versions: What made the scores, by name; of a bag of the study, or of the program that writes the page.
        versions_of: Whose they are.
        bags: Bags that lie in the folder, as the trials name them.
        simulated: What the simulator says, None where it can say nothing.
        notes: What reading the study told.
    """

    name: str
    settings: Settings
    trials: Sequence[TrialRecord]
    fish: Mapping[str, object] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    versions_of: str = ""
    bags: frozenset[str] = frozenset()
    simulated: Simulated | None = None
    notes: Sequence[str] = ()

    @cached_property
    def tried(self) -> list[Candidate]:
        """Its candidates in the order they were proposed."""
        return candidates(self.trials, self.settings.goals)

    @cached_property
    def scored(self) -> list[Candidate]:
        """Those with a score."""
        return [candidate for candidate in self.tried if candidate.score is not None]

    @cached_property
    def best(self) -> Candidate | None:
        """The best by the first goal, of those that meet the constraints if any does."""
        return best_of(self.tried)

    @property
    def goal(self) -> Measure:
        """What is looked for first."""
        return self.settings.goals.measures[0]

    @cached_property
    def without_score(self) -> list[TrialRecord]:
        """Trials that ended without one."""
        ended = {Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE}
        return [trial for trial in self.trials if trial.outcome in ended]

    @cached_property
    def pairs(self) -> list[tuple[Candidate, float, float]]:
        """Candidates with what is compared, as simulated and as measured, in SI."""
        if self.simulated is None:
            return []
        again = self.simulated.again
        name = self.simulated.measure.name
        found = [(c, again.get(c.number, math.nan), c.measured[name]) for c in self.scored]
        return [pair for pair in found if math.isfinite(pair[1])]

    @cached_property
    def transfer(self) -> Transfer:
        """How simulated and measured values compare."""
        return transfer([pair[1] for pair in self.pairs], [pair[2] for pair in self.pairs])


def simulate(
    settings: Settings,
    trials: Sequence[TrialRecord],
    fish: Mapping[str, object],
    cache: Path | None = None,
    versions: Mapping[str, str] | None = None,
    fitted: tuple[str, Mapping[str, Value]] | None = None,
) -> Simulated | None:
    """Return what the simulator says of a study; None of one without a score, or that does not tell fin and gait.

    Where another plant than the simulator swam, its candidates are swum again by the fish that was fitted to it, or by
    the simulator's default one.

    Args:
        settings: Of the study.
        trials: All of them.
        fish: What swam, as the journal has it.
        cache: Where speeds once computed are kept; nowhere if left out.
        versions: Of what computes them; others are computed anew.
        fitted: What to call the fish that was fitted to the plant, and its parameters.

    Raises:
        ValueError: There is a fitted fish, but the simulator swam the study with its own.
    """
    tried = candidates(trials, settings.goals)
    best = best_of(tried)
    swum_by = SimulatedFish.of(settings, fish)
    if can_be_computed(fish) and fitted is not None:
        msg = f"the simulator swam this study, with a fish that the study tells: leave {fitted[0]} out"
        raise ValueError(msg)
    default = cast("Mapping[str, Value]", node_table("fin_sim", "simulator").checked({}))
    name, fish_parameters = fitted or (DEFAULT_FISH, default)
    swimmer = swum_by if can_be_computed(fish) else SimulatedFish.of(settings, fish_parameters)
    if best is None or swimmer is None:
        return None
    try:
        swum = swimmer.swim(best.values)
    except (ArithmeticError, ValueError) as error:
        return Simulated({}, None, {}, None, (), swum_by is not None, trouble=str(error), swimmer=name)
    goal = settings.goals.measures[0]
    measure = goal if goal.name in TOLD else MEASURES[MEAN_SPEED]
    key = key_of(settings.flat(), swimmer.parameters, versions, simulator_digest(), measure.name)
    speeds = KeptSpeeds(partial(swimmer.told, measure.name), key)
    if cache is not None:
        speeds.read(cache)
    curves, chart = {}, None
    if swum_by is not None and measure is goal:
        curves = curves_through(settings.space, best.values, speeds)
        chart = map_of(settings.space, best.values, speeds)
    scores = {c.number: measure.direction * c.measured[measure.name] for c in tried if c.measured}
    values = {c.number: c.values for c in tried}
    chosen = to_swim_again(scores)
    again = dict(zip(chosen, speeds([values[number] for number in chosen]), strict=True))
    if cache is not None:
        speeds.write(cache)
    number = cast("Mapping[str, float]", swimmer.parameters)
    film = film_of(swum, (number["body.length"], number["body.width"]))
    return Simulated(
        curves, chart, again, film, numbers_of(swum, swimmer.settle), swum_by is not None, measure, swimmer=name
    )
