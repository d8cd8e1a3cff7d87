"""The tree-structured Parzen estimator of Optuna, asked for each candidate with the whole history and its own seed.

Bergstra, Bardenet, Bengio & Kegl, Algorithms for Hyper-Parameter Optimization, 2011; with several objectives Ozaki et
al. 2022. A candidate that misses a constraint is worse than all that miss none, and one that misses less is better.
The library draws its random numbers from one stream, so a study that is gone on with would go on elsewhere in it. Here
every candidate has a sampler of its own, and Optuna's study is the history and nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import optuna
from optuna.samplers import TPESampler
from optuna.storages import InMemoryStorage
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState

from fin_optimizer.search.distributions import distributions
from fin_optimizer.search.space import generator, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Container, Sequence

    from optuna.distributions import BaseDistribution

    from fin_optimizer.search.space import Evaluation, Space, Values

optuna.logging.set_verbosity(optuna.logging.WARNING)

_NAME = "history"
_REDRAWS = 20
"""How often a candidate that the space refuses is drawn again, before one is drawn evenly."""
_LARGEST_SEED = 2**32


class _History(InMemoryStorage):
    """A storage whose trials are given, not made: to make one takes Optuna longer than to propose the next."""

    def __init__(self, directions: Sequence[StudyDirection]) -> None:
        super().__init__()
        self.create_new_study(directions, _NAME)
        self.trials: list[FrozenTrial] = []

    def get_all_trials(
        self,
        study_id: int,  # noqa: ARG002  (as the class above has it)
        deepcopy: bool = True,  # noqa: ARG002  (likewise)
        states: Container[TrialState] | None = None,
    ) -> list[FrozenTrial]:
        """Return the given trials of these states."""
        return [trial for trial in self.trials if states is None or trial.state in states]

    def set_trial_system_attr(self, trial_id: int, key: str, value: Any) -> None:
        """Keep nothing: that is for other processes, which there are not."""


@dataclass(frozen=True)
class Tpe:
    """Proposes what is likely among the good candidates and unlikely among the others.

    The first ten are drawn evenly. A candidate without a score counts as worse than any other, one that still swims
    as not good.

    Attributes:
        space: Where to search; ranges, steps and choices.
        seed: Of all its random numbers, 0 or more.
        objectives: How many objectives there are.
        constraints: How many constraints there are.

    Raises:
        ValueError: A seed that cannot be.
    """

    space: Space
    seed: int
    objectives: int = 1
    constraints: int = 0
    _trials: dict[int, tuple[Evaluation, FrozenTrial]] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)

    def __getstate__(self) -> dict[str, object]:
        return {**{field.name: getattr(self, field.name) for field in fields(self)}, "_trials": {}}

    @cached_property
    def _distributions(self) -> dict[str, BaseDistribution]:
        return distributions(self.space)

    @cached_property
    def _storage(self) -> _History:
        return _History([StudyDirection.MAXIMIZE] * self.objectives)

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: what still swims counts as not good until it has a score."""
        return 0

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``."""
        random = generator(self.seed, len(history))
        self._storage.trials = [self._trial(number, entry) for number, entry in enumerate(history)]
        study = optuna.Study(_NAME, self._storage)  # a new one, since it remembers what trials there were
        trial = FrozenTrial(
            number=len(history),
            state=TrialState.RUNNING,
            value=None,
            datetime_start=None,
            datetime_complete=None,
            params={},
            distributions={},
            user_attrs={},
            system_attrs={},
            intermediate_values={},
            trial_id=len(history),
        )
        sampler = TPESampler(seed=int(random.integers(_LARGEST_SEED)), constant_liar=True)
        for _ in range(_REDRAWS):
            # In one go for one objective, one by one for several, as Optuna does.
            together = {} if self.objectives > 1 else dict(sorted(self._distributions.items()))
            drawn = sampler.sample_relative(study, trial, together)
            for name, distribution in self._distributions.items():
                if name not in drawn:
                    drawn[name] = sampler.sample_independent(study, trial, name, distribution)
            numbers = np.array([self.space.row(drawn)])
            numbers = self.space.numbers(self.space.coordinates(numbers))  # with the digits of a step
            if not self.space.refused(numbers).size:
                return self.space.values(numbers[0].tolist())
        return uniform(self.space, random)

    def _trial(self, number: int, entry: Evaluation) -> FrozenTrial:
        known = self._trials.get(number)
        if known is None or known[0] is not entry:
            known = self._trials[number] = (entry, self._new_trial(number, entry))
        return known[1]

    def _new_trial(self, number: int, entry: Evaluation) -> FrozenTrial:
        scored = entry.score is not None
        trial = FrozenTrial(
            number=number,
            state=TrialState.COMPLETE if scored else TrialState.RUNNING if entry.pending else TrialState.PRUNED,
            value=None,
            values=list(entry.objectives[: self.objectives]) if scored else None,
            datetime_start=None,
            datetime_complete=None,
            params=dict(entry.values),
            distributions=self._distributions,
            user_attrs={},
            system_attrs={},
            intermediate_values={},
            trial_id=number,
        )
        # To Optuna a trial without constraints meets them all: one that has no score is worse than those that miss any.
        for place in range(self.constraints):
            trial.set_constraint(str(place), entry.excesses[place] if scored else math.inf)
        return trial
