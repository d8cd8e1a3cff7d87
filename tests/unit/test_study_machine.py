"""A study under any order of events, beside a model of it that is written from the documented rules.

The model knows a trial's outcome and score and nothing else; what is settled, the best, the front and the next
candidate are computed from it anew each time, where `Study` keeps them up to date.
"""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from fin_optimizer.goals import OF_OBJECTIVE, Goals
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Dimension, Evaluation, Space
from fin_optimizer.study.candidate import Candidate, front, is_for_another
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.settings import Policy, Settings
from fin_optimizer.trial.result import Outcome, Result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import Generation
    from fin_optimizer.search.space import Search, Values

MODULUS = "fin.young_modulus"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
PLANTS = ("", "/left", "/right")
OPEN = (Outcome.PROPOSED, Outcome.RUNNING)
TOTAL = 6
MEMORY = Path("/dev/shm")  # noqa: S108  (a disk that takes its time to write through is not what is asked about)
# Few different numbers, so that scores are equal often.
SCORES = st.sampled_from([-0.01, 0.0, 0.01, 0.02, 0.03])
COSTS = st.sampled_from([1.0, 2.0, 3.0])


@dataclass(frozen=True)
class Threes:
    """Generations of three, the next one around the last one's best: what needs all before it settled."""

    space: Space = SPACE

    def propose(self, history: Sequence[Generation]) -> NDArray[np.float64]:
        ranks = [generation.ranked().argmax() for generation in history]
        return np.array([[1e9 + 1e8 * (len(history) + int(sum(ranks))) + 1e6 * place] for place in range(3)])


@dataclass
class Swim:
    """A trial as the model has it."""

    candidate: int
    plant: str
    outcome: Outcome = Outcome.PROPOSED
    score: float | None = None
    cost: float | None = None


class Studies(RuleBasedStateMachine):
    """A study that is begun, swum by up to three fish, killed and gone on with."""

    study: Study

    def __init__(self) -> None:
        super().__init__()
        self.place = tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None)
        self.folder = Path(self.place.name) / "study"
        self.swims: list[Swim] = []
        self.values: list[Values] = []
        self.killed: set[int] = set()

    @initialize(
        repeats=st.integers(1, 2),
        attempts=st.integers(1, 3),
        objective=st.sampled_from([*OF_OBJECTIVE]),
        in_threes=st.booleans(),
    )
    def begin(self, repeats: int, attempts: int, objective: str, *, in_threes: bool) -> None:
        self.policy = Policy(repeats, attempts)
        self.settings = Settings(SPACE, self.policy, {"seed": 1}, Goals.of_objective(objective))
        self.in_threes = in_threes
        self.study = Study.create(self.folder, self.settings)
        self.search = self.new_search()

    def new_search(self) -> Search:
        return OneByOne(Threes()) if self.in_threes else HillClimber(SPACE, 1, {MODULUS: 3e8})

    # The model.

    def of(self, candidate: int) -> list[Swim]:
        return [swim for swim in self.swims if swim.candidate == candidate]

    def given_up(self, candidate: int) -> bool:
        outcomes = [swim.outcome for swim in self.of(candidate)]
        return Outcome.INFEASIBLE in outcomes or outcomes.count(Outcome.FAILED) >= self.policy.attempts

    def is_settled(self, candidate: int) -> bool:
        outcomes = [swim.outcome for swim in self.of(candidate)]
        if any(outcome in OPEN for outcome in outcomes):
            return False
        return self.given_up(candidate) or outcomes.count(Outcome.OK) >= self.policy.repeats

    def evaluation(self, candidate: int) -> Evaluation:
        good = [swim for swim in self.of(candidate) if swim.score is not None]
        costs = [swim.cost for swim in good if swim.cost is not None]
        return Evaluation(
            self.values[candidate],
            statistics.fmean(swim.score or 0.0 for swim in good) if good else None,
            (-statistics.fmean(costs),) if costs else (),
            pending=not good and not self.is_settled(candidate),
        )

    def expected(self, plant: str) -> tuple[int, Values] | None:
        """What the rules say is next for a fish."""
        for number, values in enumerate(self.values):
            outcomes = [swim.outcome for swim in self.of(number)]
            begun = sum(outcome in {Outcome.OK, *OPEN} for outcome in outcomes)
            if not self.given_up(number) and begun < self.policy.repeats and not self.is_left(number, plant):
                return number, values
        number = len(self.values)
        all_settled = all(self.is_settled(before) for before in range(number))
        if number >= TOTAL or (self.in_threes and number % 3 == 0 and not all_settled):
            return None
        return number, self.new_search().propose([self.evaluation(before) for before in range(number)])

    def is_left(self, candidate: int, plant: str) -> bool:
        failed_on = {s.plant for s in self.of(candidate) if s.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}}
        return plant in failed_on and not failed_on.issuperset(PLANTS)

    def following(self, plant: str) -> tuple[int, Values] | None:
        def left(candidate: Candidate) -> bool:
            return is_for_another(candidate, plant, PLANTS)

        return self.study.next_candidate(self.search, TOTAL, is_left=left)

    # What happens.

    @rule(plant=st.sampled_from(PLANTS))
    def propose(self, plant: str) -> None:
        found = self.following(plant)
        assert found == self.expected(plant)
        if found is None:
            return
        number, values = found
        record = self.study.propose(number, values, plant)
        assert (record.number, record.candidate, record.plant) == (len(self.swims), number, plant)
        if number == len(self.values):
            self.values.append(values)
        self.swims.append(Swim(number, plant))

    def under_way(self, *outcomes: Outcome) -> list[int]:
        return [number for number, swim in enumerate(self.swims) if swim.outcome in outcomes]

    @precondition(lambda self: self.under_way(Outcome.PROPOSED))
    @rule(data=st.data())
    def start(self, data: st.DataObject) -> None:
        number = data.draw(st.sampled_from(self.under_way(Outcome.PROPOSED)))
        self.study.start(number)
        self.swims[number].outcome = Outcome.RUNNING

    @precondition(lambda self: self.under_way(*OPEN))
    @rule(data=st.data(), score=SCORES, cost=COSTS)
    def finish_well(self, data: st.DataObject, score: float, cost: float) -> None:
        number = data.draw(st.sampled_from(self.under_way(*OPEN)))
        both = len(self.settings.goals.measures) > 1
        measured = {"mean_speed": score, "energy_per_metre": cost}
        self.study.finish(number, Result(Outcome.OK, measured=measured, spread=0.001, samples=100))
        swim = self.swims[number]
        swim.outcome, swim.score, swim.cost = Outcome.OK, score, cost if both else None

    @precondition(lambda self: self.under_way(*OPEN))
    @rule(
        data=st.data(),
        outcome=st.sampled_from([Outcome.FAILED, Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE]),
    )
    def finish_badly(self, data: st.DataObject, outcome: Outcome) -> None:
        number = data.draw(st.sampled_from(self.under_way(*OPEN)))
        self.study.finish(number, Result(outcome, "for a reason"))
        self.swims[number].outcome = outcome

    @precondition(lambda self: self.under_way(*OPEN) and len(self.settings.goals.measures) > 1)
    @rule(data=st.data())
    def finish_without_the_second_number(self, data: st.DataObject) -> None:
        number = data.draw(st.sampled_from(self.under_way(*OPEN)))
        with pytest.raises(StudyError, match="this study is about"):
            self.study.finish(number, Result(Outcome.OK, measured={"mean_speed": 0.01}))

    @rule()
    def be_refused_to_a_second_process(self) -> None:
        with pytest.raises(StudyError, match="another optimiser is working on"):
            Study.open(self.folder, self.settings)

    @rule()
    def be_killed_and_gone_on_with(self) -> None:
        """Drop the lock as the end of a process does, whatever is under way."""
        self.study.close()
        begun = self.under_way(*OPEN)
        for number in begun:
            self.swims[number].outcome = Outcome.INTERRUPTED
        self.killed |= set(begun)
        self.study = Study.open(self.folder, self.settings)
        assert [note.partition(" was")[0] for note in self.study.notes] == [f"trial {n:04d}" for n in begun]
        self.search = self.new_search()

    # What holds at any time.

    @invariant()
    def nothing_is_lost(self) -> None:
        trials = self.study.trials
        assert [trial.number for trial in trials] == list(range(len(self.swims)))
        assert [
            Swim(trial.candidate, trial.plant, trial.outcome, trial.score, trial.measured.get("energy_per_metre"))
            for trial in trials
        ] == self.swims
        assert all(trial.values == self.values[trial.candidate] for trial in trials)
        assert all(
            bool(trial.reason) == (trial.outcome in {Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE})
            for trial in trials
        )
        assert all(("process ended" in trial.reason) == (trial.number in self.killed) for trial in trials)

    @invariant()
    def candidates_are_dense_and_their_history_is_what_was_scored(self) -> None:
        assert [candidate.number for candidate in self.study.candidates] == list(range(len(self.values)))
        assert self.study.history == [self.evaluation(number) for number in range(len(self.values))]

    @invariant()
    def settled_best_and_front_follow_the_rules(self) -> None:
        numbers = range(len(self.values))
        assert self.study.settled() == sum(self.is_settled(number) for number in numbers)
        known = [(each.score, -number) for number in numbers if (each := self.evaluation(number)).score is not None]
        best = self.study.best()
        assert (None if best is None else best.number) == (-max(known)[1] if known else None)
        scored = [(each.objectives, n) for n in numbers if (each := self.evaluation(n)).objectives]
        unbeaten = [
            number
            for mine, number in scored
            if not any(
                all(other >= own for own, other in zip(mine, others, strict=True))
                and (others != mine or before < number)
                for others, before in scored
                if before != number
            )
        ]
        assert sorted(each.number for each in front(self.study.candidates)) == unbeaten

    @invariant()
    def the_next_candidate_is_the_rules_and_asking_changes_nothing(self) -> None:
        for plant in PLANTS:
            assert self.following(plant) == self.following(plant) == self.expected(plant)

    @invariant()
    def a_reader_beside_it_sees_the_same(self) -> None:
        notes: list[str] = []
        assert tuple(read_trials(self.folder, notes.append)) == self.study.trials
        assert notes == []

    def teardown(self) -> None:
        """Open the study a last time: what was known is known."""
        if hasattr(self, "study"):
            self.be_killed_and_gone_on_with()
            self.nothing_is_lost()
            self.study.close()
        self.place.cleanup()


TestStudies = Studies.TestCase
TestStudies.settings = settings(
    max_examples=25, stateful_step_count=25, deadline=None, suppress_health_check=list(HealthCheck)
)
