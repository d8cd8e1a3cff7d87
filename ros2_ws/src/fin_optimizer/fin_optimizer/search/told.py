"""What a search that simulates ahead says of its best candidate, and how it works in slices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.search.space import Evaluation, Values

NEAR = 0.02
"""Share of the best speed by which a fin may be slower and still count as best."""


@dataclass(frozen=True)
class Told:
    """What the search is sure of.

    Attributes:
        best: Candidate that is expected to be fastest.
        speed: Its expected speed, m/s.
        deviation: Standard deviation of that, m/s.
        gain: What the best next trial is expected to add, as a share of that speed.
        regret: By what share of the best speed it is expected to be slower than the truly fastest.
        sure: How likely it is within `NEAR` of the truly fastest.
        effective_fish: How many fish of the cloud still count.
    """

    best: Values
    speed: float
    deviation: float
    gain: float
    regret: float
    sure: float
    effective_fish: float

    @property
    def text(self) -> str:
        """How sure it is, in a sentence without the candidate."""
        return (
            f"{100.0 * self.speed:.2f} +- {100.0 * self.deviation:.2f} cm/s, {self.sure:.0%} sure within {NEAR:.0%} of "
            f"the fastest, expected to miss {self.regret:.1%}; {self.effective_fish:.0f} fish of the cloud still count"
        )


@runtime_checkable
class Simulating(Protocol):
    """A search that simulates before it proposes, slice by slice, and says how sure it is."""

    def prepare(self, history: Sequence[Evaluation]) -> float:
        """Do a slice of the work that `propose` waits for; return which part is done, 1 when all is."""

    def told(self, history: Sequence[Evaluation]) -> Told:
        """Return what is believed after ``history``, and how sure that is."""
