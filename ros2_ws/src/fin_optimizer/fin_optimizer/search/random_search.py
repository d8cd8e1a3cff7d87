"""Candidates drawn evenly: what any other search must be better than."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_optimizer.search.space import generator, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.search.space import Evaluation, Space, Values


@dataclass(frozen=True)
class RandomSearch:
    """Draws every candidate evenly from the space.

    Attributes:
        space: Where to search.
        seed: Of all its random numbers, 0 or more.

    Raises:
        ValueError: A seed that cannot be.
    """

    space: Space
    seed: int

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: no score decides anything."""
        return 0

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``."""
        return uniform(self.space, generator(self.seed, len(history)))
