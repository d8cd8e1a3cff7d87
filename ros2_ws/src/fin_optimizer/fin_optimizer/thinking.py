"""What a search that simulates does between two trials, and what is said of it; any other search has nothing to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.search.told import Simulating
from fin_optimizer.words import show_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.progress import Display
    from fin_optimizer.search.space import Evaluation


class Thinking:
    """A search's work between two trials.

    Args:
        search: Any; only one that is `Simulating` has some.
        stop_regret: Expected regret, a share of the best speed, below which no further trial is worth its time.
        display: Where the work is shown.
    """

    def __init__(self, search: object, stop_regret: float, display: Display) -> None:
        self._search = search if isinstance(search, Simulating) else None
        self._stop_regret = stop_regret
        self._display = display
        self._is_said = False

    def goes_on(self, history: Sequence[Evaluation]) -> bool:
        """Do a slice of what the search simulates before it proposes; return whether there is more of it."""
        if self._search is None or (done := self._search.prepare(history)) >= 1.0:
            return False
        if not self._is_said:
            self._display.say("simulating a cloud of fish with every fin first: some minutes, once for these fins")
        self._is_said = True
        self._display.show("simulating", f"{done:.0%} of the cloud of fish")
        return True

    def knows_enough(self, history: Sequence[Evaluation]) -> bool:
        """Return whether the best fin is expected to miss less than another trial is worth; never without a score."""
        if self._search is None or all(entry.score is None for entry in history):
            return False
        return self._search.told(history).regret < self._stop_regret

    def conclusion(self, history: Sequence[Evaluation]) -> str:
        """Return what is expected to be fastest and how sure that is; empty where the search knows neither."""
        if self._search is None or self._search.prepare(history) < 1.0:
            return ""
        told = self._search.told(history)
        return f"expected to be fastest: {show_values(told.best)}, {told.text}"
