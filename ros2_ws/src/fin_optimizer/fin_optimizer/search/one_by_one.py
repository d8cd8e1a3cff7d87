"""A search by generations, asked for one candidate at a time, as a study asks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.genetic import Generation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import PopulationSearch
    from fin_optimizer.search.space import Evaluation, Space, Values


@dataclass(frozen=True)
class OneByOne:
    """Hands out a generation candidate by candidate; the next one begins when all of the last are settled.

    So its candidates depend on seed and scores alone, also where several fish swim at once and finish in any order.

    Attributes:
        search: Proposes whole generations.
    """

    search: PopulationSearch
    _generations: list[tuple[tuple[Evaluation, ...], Generation]] = field(
        default_factory=list, repr=False, compare=False
    )
    _proposed: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def space(self) -> Space:
        """Where it searches."""
        return self.search.space

    @cached_property
    def population(self) -> int:
        """Candidates of a generation."""
        return len(self.search.propose(()))

    def needed(self, number: int) -> int:
        """Return how many of the first candidates must be settled before candidate ``number`` can be proposed."""
        return number - number % self.population

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``."""
        size = self.population
        done, place = divmod(len(history), size)
        for index in range(done):
            tried = tuple(history[index * size : (index + 1) * size])
            if index == len(self._generations) or self._generations[index][0] != tried:
                # A search may know a generation by its identity, so the same one stays the same object.
                del self._generations[index:]
                self._generations.append((tried, self._generation(tried)))
                self._proposed.clear()
        values = self._proposal(tuple(generation for _, generation in self._generations[:done]))[place]
        return self.space.values(values.tolist())

    def _proposal(self, generations: tuple[Generation, ...]) -> NDArray[np.float64]:
        number = len(generations)
        if number not in self._proposed:
            self._proposed[number] = self.search.propose(generations)
        return self._proposed[number]

    def _generation(self, tried: Sequence[Evaluation]) -> Generation:
        values = np.array([self.space.row(entry.values) for entry in tried])
        scores = np.array([entry.score for entry in tried], dtype=float)  # None becomes NaN
        return Generation(values, scores, _rows([e.others for e in tried]), _rows([e.excesses for e in tried]))


def _rows(numbers: Sequence[tuple[float, ...]]) -> NDArray[np.float64] | None:
    """Return numbers of candidates as rows, NaN where one has none; None where no candidate has any."""
    width = max(map(len, numbers))
    return np.array([each or (math.nan,) * width for each in numbers]) if width else None
