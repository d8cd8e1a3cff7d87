"""Which buttons a page has, and whether a press counts: the guards of the terminal program, for several pages at once.

A press names its button by a key that stands for all that the question is about: the page's server, the processes of
the graph, the state that began at that moment. So what was on a screen before a restart presses nothing after it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_optimizer.mode import Mode
from fin_plant.plant_state import EMERGENCY, PlantState, State
from fin_servo_driver.next_step import Controls, next_step, question, too_new

if TYPE_CHECKING:
    from collections.abc import Iterable

BUTTONS = Controls("press the button", "hold the button down", "EMERGENCY STOP")
_LABELS = {
    "configure": "Open the port",
    "confirm_fin": "The fin is mounted",
    "activate": "ARM",
    "confirm_mark": "The fish is at its mark",
}
RELEASE, DISARM, START, PAUSE, REPEAT = "release", "deactivate", "start", "pause", "repeat"
_HELD = {"activate", RELEASE, REPEAT}
"""Of which a touch is not enough: they are held down for a moment."""
_CALM = {*_LABELS, RELEASE, START}
"""After which something may move: they count only after they were seen for a second, as in a terminal."""
_ANSWERED = 3.0
"""s after its answer for which a button that is still there is not pressed again."""
OLD = "that is asked no more: look again"


@dataclass(frozen=True)
class Offer:
    """A button.

    Attributes:
        key: Names this very question.
        action: What it asks for.
        label: What stands on it.
        about: ``fish`` or ``study``.
    """

    key: str
    action: str
    label: str
    about: str

    @property
    def calm(self) -> bool:
        """Whether it counts only after it was seen for a second."""
        return self.action in _CALM

    def told(self) -> dict[str, object]:
        """Return it as JSON has it."""
        held = self.action in _HELD
        return {"key": self.key, "action": self.action, "label": self.label, "about": self.about, "hold": held}


def _key(*facts: object) -> str:
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:16]


def of_plant(state: PlantState | None, session: str) -> list[Offer]:
    """Return the buttons of a fish in this state, that which is waited for first.

    Args:
        state: What it said last; None where it says nothing now.
        session: Stands for the page's server, for the processes of the graph, and for how often a question came up.
    """
    if state is None:
        return []
    asked = question(state)
    actions = [(action, _LABELS[action]) for action in (next_step(state)[1],) if action]
    if state.state is State.FAULT and EMERGENCY in state.reason:
        actions.append((RELEASE, "Release the stop"))
    elif state.details.get("waiting_for") == "mark" or _may_move(state):
        actions.append((DISARM, "Disarm"))
    return [Offer(_key(session, action, asked), action, label, "fish") for action, label in actions]


def _may_move(state: PlantState) -> bool:
    """Whether an armed robot waits for a gait or swims; a simulated fish, which nobody arms, tells its slowest pace."""
    return state.state in {State.READY, State.SWIMMING} and "waiting_for" in state.details


def _start(trials: int) -> str:
    return "Go on" if trials else "Start"


def mode_shown(mode: str, trials: int) -> str:
    """Return the mode of an optimiser, arguments as for `of_study`, in the words of a page."""
    return f"stands still: press {_start(trials)}" if mode == Mode.HOLDING.value else mode


def of_study(mode: str, trial: int | None, trials: int, session: str) -> list[Offer]:
    """Return the buttons of a study.

    Args:
        mode: Of its optimiser, as `Mode` has it; empty where nothing is known now.
        trial: The trial that was told last, None before any.
        trials: How many there are.
        session: Stands for the page's server and for the processes of the graph.
    """
    offers = []
    if mode in {Mode.HOLDING.value, Mode.PAUSING.value}:
        offers.append(Offer(_key(session, START, mode), START, _start(trials), "study"))
    if mode == Mode.RUNNING.value:
        offers.append(Offer(_key(session, PAUSE), PAUSE, "Pause after this trial", "study"))
    if trial is not None and mode in {Mode.HOLDING.value, Mode.PAUSING.value, Mode.RUNNING.value}:
        offers.append(Offer(_key(session, REPEAT, trial), REPEAT, f"Repeat trial {trial:04d}", "study"))
    return offers


class Guard:
    """Whether a press counts. Time is handed in, so that nothing here waits."""

    def __init__(self) -> None:
        self._seen: dict[tuple[int, str], float] = {}
        self._pressed: dict[str, str] = {}
        self._again_at: dict[str, float] = {}

    def seen(self, viewer: int, keys: Iterable[str], now: float) -> None:
        """Note at ``now`` s which buttons a page shows; the others are gone from it."""
        shown = set(keys)
        before = self._seen
        self._seen = {each: since for each, since in before.items() if each[0] != viewer or each[1] in shown}
        for key in shown:
            self._seen.setdefault((viewer, key), now)

    def leave(self, viewer: int) -> None:
        """Forget a page."""
        self.seen(viewer, (), 0.0)

    def refusal(self, viewer: int, key: str, offers: Iterable[Offer], now: float) -> str:
        """Return why a press at ``now`` s does not count, or an empty text."""
        offer = next((each for each in offers if each.key == key), None)
        if offer is None:
            return OLD
        if self._again_at.get(key, now) < now:
            del self._again_at[key], self._pressed[key]
        if key in self._pressed:
            return f"{offer.label}: already pressed, by {self._pressed[key]}"
        since = self._seen.get((viewer, key))
        return too_new(0.0 if since is None else now - since, BUTTONS) if offer.calm else ""

    def press(self, key: str, by: str) -> None:
        """Note a press that counts: until its answer no other does."""
        self._pressed[key] = by
        self._again_at.pop(key, None)

    def answered(self, key: str, now: float, *, accepted: bool) -> None:
        """Note the answer: what was refused may be pressed again once it was seen for a second since."""
        if key in self._pressed:
            self._again_at[key] = now + (_ANSWERED if accepted else 0.0)
        self._seen = {each: now if each[1] == key else since for each, since in self._seen.items()}
