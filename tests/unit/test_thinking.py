"""What a search that simulates does between two trials, and what is said of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from fin_optimizer.search.random_search import RandomSearch
from fin_optimizer.search.space import Choice, Evaluation, Space
from fin_optimizer.search.told import Told
from fin_optimizer.thinking import Thinking

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.study.candidate import Candidate, TrialRecord

STOCK = Space((Choice("stock", ("thin", "thick")),))
SWUM = [Evaluation({"stock": "thin"}, None), Evaluation({"stock": "thick"}, 0.03)]
KNOWN = (
    "expected to be fastest: stock thick, 3.10 +- 0.20 cm/s, 80% sure within 2% of the fastest, expected to miss 1.0%; "
    "12 fish of the cloud still count"
)


class Noted:
    """A display that keeps what it is given."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.shown: list[tuple[str, str]] = []

    def begin(self, trial: TrialRecord) -> None:
        """Trials are not looked at here."""

    def show(self, phase: str, note: str) -> None:
        """Keep it."""
        self.shown.append((phase, note))

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Trials are not looked at here."""

    def say(self, text: str) -> None:
        """Keep it."""
        self.said.append(text)

    def close(self) -> None:
        """There is nothing to give back."""


class Quarters:
    """A search with four slices of work, which misses 1 %."""

    def __init__(self) -> None:
        self.done = 0.0

    def prepare(self, history: Sequence[Evaluation]) -> float:
        """Do a quarter."""
        del history
        self.done = min(1.0, self.done + 0.25)
        return self.done

    def told(self, history: Sequence[Evaluation]) -> Told:
        """Return what is known once all is done."""
        del history
        assert self.done == 1.0, "asked too early"
        return Told({"stock": "thick"}, 0.031, 0.002, 0.004, 0.01, 0.8, 12.0)


def test_work_is_done_in_slices_said_once_and_shown_with_each() -> None:
    display = Noted()
    thinking = Thinking(Quarters(), 0.02, display)
    assert [thinking.goes_on([]) for _ in range(5)] == [True, True, True, False, False]
    assert display.shown == [("simulating", f"{part} of the cloud of fish") for part in ("25%", "50%", "75%")]
    assert display.said == ["simulating a cloud of fish with every fin first: some minutes, once for these fins"]


@pytest.mark.parametrize(("stop_regret", "enough"), [(0.0101, True), (0.01, False), (0.0, False)])
def test_enough_is_known_where_the_best_misses_less_than_a_trial_is_worth(stop_regret: float, *, enough: bool) -> None:
    thinking = Thinking(Quarters(), stop_regret, Noted())
    while thinking.goes_on(SWUM):
        pass
    assert thinking.knows_enough(SWUM) is enough
    assert not thinking.knows_enough(SWUM[:1]), "nothing has a score yet"
    assert not thinking.knows_enough([])


def test_a_search_that_simulated_says_how_sure_it_is_and_one_that_is_not_through_says_nothing() -> None:
    search = Quarters()
    thinking = Thinking(search, 0.02, Noted())
    assert thinking.conclusion(SWUM) == ""
    search.done = 1.0
    assert thinking.conclusion(SWUM) == KNOWN


def test_a_search_that_simulates_nothing_has_nothing_to_do_and_never_knows_enough() -> None:
    display = Noted()
    thinking = Thinking(RandomSearch(STOCK, 1), 1.0, display)
    assert not thinking.goes_on(SWUM)
    assert not thinking.knows_enough(SWUM)
    assert thinking.conclusion(SWUM) == ""
    assert not display.said
    assert not display.shown
