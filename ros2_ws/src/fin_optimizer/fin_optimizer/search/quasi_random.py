"""Candidates that fill the space evenly, whatever they score: a start for what learns, and a map of a landscape."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from fin_optimizer.search.space import generator
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.search.space import Evaluation, Space, Values

_BLOCK = 64
"""Points that are made at once, a power of two as the sequence wants it."""
_MOST_REFUSED = 10_000
"""Points one after another that the space may refuse."""


@dataclass(frozen=True)
class QuasiRandom:
    """Spreads the candidates over the space so that any number of them leaves no large gap: a Sobol sequence.

    Scrambled by the seed (Owen 1998; directions of Joe & Kuo 2008; both by SciPy). Points that the space refuses are
    left out.

    Attributes:
        space: Where to search.
        seed: Of the scrambling, 0 or more.

    Raises:
        ValueError: A seed that cannot be.
    """

    space: Space
    seed: int
    _made: list[list[float]] = field(default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_made": []}

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: no score decides anything."""
        return 0

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``.

        Raises:
            ValueError: None of ten thousand points one after another can be.
        """
        if len(self._made) <= len(history):
            self._make(len(history) + 1)
        return self.space.values(self._made[len(history)])

    def _make(self, count: int) -> None:
        """Make all points anew, in blocks: at least so many, and twice as many as there were."""
        wanted = max(count, 2 * len(self._made))
        low, high = self.space.bounds
        sequence = qmc.Sobol(len(low), rng=generator(self.seed, 0))
        made: list[list[float]] = []
        refused = 0
        while len(made) < wanted:
            numbers = self.space.numbers(low + (high - low) * sequence.random(_BLOCK))
            allowed = np.delete(numbers, self.space.refused(numbers), axis=0)
            refused = 0 if len(allowed) else refused + _BLOCK
            if refused >= _MOST_REFUSED:
                why = self.space.judge(self.space.values(numbers[-1].tolist()))
                msg = f"none of {refused} candidates spread over the space can be; the last one: {why}"
                raise ValueError(msg)
            made += allowed.tolist()
        self._made[:] = made
