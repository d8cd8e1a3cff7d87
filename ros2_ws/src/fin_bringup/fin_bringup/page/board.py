"""What a page is told, from what was heard of the graph. Time is handed in, and nothing here knows ROS or a socket.

A value counts as long as its node says its word in ``/diagnostics``, once a second: ``plant_state``, ``candidate`` and
``progress`` come only when something changes, so their age tells nothing.
"""

from __future__ import annotations

import json
import math
from collections import deque
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

from fin_bringup.page import offers
from fin_bringup.page.offers import BUTTONS, Offer
from fin_optimizer.goals import BETWEEN_CONSTRAINTS, MEAN_SPEED, Goals
from fin_plant.plant_state import PlantState, State
from fin_servo_driver.fin_instruction import sizes, wanted_fin
from fin_servo_driver.next_step import SWITCH, advice_says_all, next_step, question

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    Measured = Mapping[str, float]
    """What a trial achieved in SI, by measure; nothing where it has no score."""

SILENT = 2.0
"""s without a word from a node after which what it said is not shown as true: one word is missing, for a second."""
STREAM_SILENT = 1.0
"""s without anything at all after which the graph counts as lost, while the fish was seen to swim."""
MISSED = 5.0
"""s for which a trial has not been heard after which it is looked up in the study's folder."""
_FLOWING = 5
"""Pictures of the fish in one state after which they are missed."""
_EVENTS = 12
_SHOWN_DEVICE = ("connected", "identity", "reconnects", "missed_ticks", "voltage", "temperature", "fault")
_MOST_POINTS = 400
NO_FISH = "Waiting for a fish: start a study with bringup."


@dataclass
class Node:
    """A node of the graph as it was heard.

    Attributes:
        said: s at which it said its last word, None before.
        there: Whether it is seen on the graph; None before anybody looked.
        incarnation: Stands for its process.
    """

    said: float | None = None
    there: bool | None = None
    incarnation: str = ""

    def silence(self, now: float) -> float:
        """Return for how many s it has said nothing."""
        return math.inf if self.said is None else now - self.said

    def alive(self, now: float) -> bool:
        """Whether what it said still counts."""
        return self.there is not False and self.silence(now) <= SILENT


@dataclass
class Stop:
    """An emergency stop from a page.

    Attributes:
        number: Which of all that were pressed.
        time: When it was pressed, as a clock shows it.
        address: Of the page.
        waiting: Plants that have not answered.
        late: s for which it could not be sent, 0 where it came at once.
        heard: What each plant that has heard it said, and after how many ms.
        lost: What is said where no answer came.
    """

    number: int
    time: str
    address: str
    waiting: list[str]
    late: int = 0
    heard: dict[str, str] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)

    def told(self) -> dict[str, object]:
        """Return it as JSON has it."""
        state = "lost" if self.lost else "waiting" if self.waiting or not self.heard else "heard"
        late = [f"SENT LATE, {self.late} s after it was pressed"] if self.late else []
        text = "; ".join([*late, *self.lost, *(f"heard by {node}, {said}" for node, said in self.heard.items())])
        return {"number": self.number, "state": state, "time": self.time, "address": self.address, "text": text}


def to_stop(ready: Mapping[str, bool], plants: Iterable[str], last: str) -> list[str]:
    """Return which plants an emergency stop is for.

    One that is seen is asked though its service is not found yet: else the stop would count as heard by the others.

    Args:
        ready: Whether the service of each plant that was ever known is found.
        plants: That are seen on the graph.
        last: The plant that is shown, empty where none ever was.
    """
    there = [name for name, is_found in ready.items() if is_found]
    asked = [*there, *(name for name in plants if name not in there)]
    return asked or ([last] if last else [*ready])


class Missed:
    """When a study is read for the trials that were not heard."""

    def __init__(self) -> None:
        self._folder, self._known, self._since = "", 0.0, -math.inf

    def due(self, folder: str, lacking: int, now: float) -> bool:
        """Return whether to read a study now, of which so many trials are lacking; it then counts as being read.

        What was before anybody listened is read at once. Later a trial whose word comes a moment late is not missed.
        """
        if folder != self._folder:
            self._folder, self._known, self._since = folder, 0.0, -math.inf
        if lacking <= self._known:
            self._since = now
            return False
        if now - self._since < MISSED:
            return False
        self._known = math.inf
        return True

    def were_read(self, lacking: int) -> None:
        """Note how many are still lacking: for those it is not read again."""
        self._known = lacking


class Board:
    """What is known of one fish and its study."""

    def __init__(self, session: str) -> None:
        """Start with nothing known.

        Args:
            session: Stands for the page's server.
        """
        self._session = session
        self.plant_name = ""
        self.plants: list[str] = []
        self.plant, self.study = Node(), Node()
        self.state: PlantState | None = None
        self.device: Mapping[str, str] = {}
        self.seen = ""
        self.stop: Stop | None = None
        self.events: deque[dict[str, object]] = deque(maxlen=_EVENTS)
        self.progress: Mapping[str, str] = {}
        self._progress_text = ""
        self.candidate: Mapping[str, str] = {}
        self._candidate_text = ""
        self._unscored = (-1, "")
        self._search: dict[int, Measured] = {}
        self.search_version = 0
        self._heard: float | None = None
        self._pictures = self._questions = 0

    # -- what was heard ----------------------------------------------------------------------------------------------

    def plant_is(self, state: PlantState, now: float) -> None:
        """Take the plant's word."""
        self._heard = self.plant.said = now
        self.plant.there = True
        if question(state) != question(self.state):
            self._questions += 1
        if self.state is None or state.state is not self.state.state:
            self._pictures = 0
        self.state = state

    def plant_says(self, now: float) -> None:
        """Take the plant's word in its diagnostics."""
        self._heard = self.plant.said = now

    def study_is(self, values: Mapping[str, str], text: str, now: float) -> None:
        """Take the optimiser's word on the study: its ``progress``, or the same in its diagnostics."""
        self._heard = self.study.said = now
        self.study.there = True
        if values.get("folder") != self.progress.get("folder"):
            self._search, self.search_version = {}, self.search_version + 1
            self._unscored = (-1, "")
        self.progress, self._progress_text = dict(values), text

    def trial_is(self, values: Mapping[str, str], text: str, now: float) -> None:
        """Take the optimiser's word on the trial under way, or that has just ended."""
        self._heard = now
        self.candidate, self._candidate_text = dict(values), text
        number = self.trial
        if number is not None and values.get("outcome") not in {"PROPOSED", "RUNNING"}:
            measured = self._measured()
            self.trials_were({number: measured})
            if not measured:
                why = ": ".join(filter(None, (values.get("outcome", "").lower(), values.get("reason", ""))))
                self._unscored = (number, f"{text} {why}")

    def trials_were(self, trials: Mapping[int, Measured]) -> None:
        """Take what trials that have ended achieved, by number."""
        self._search.update(trials)
        self.search_version += 1

    def other_heard(self, now: float) -> None:
        """Note that something else was heard."""
        self._heard = now

    def picture(self, now: float) -> None:
        """Note that the fish was seen."""
        self._heard = now
        self._pictures += 1

    def see(self, plants: Mapping[str, str], studies: Mapping[str, str], seen: str) -> None:
        """Take which processes are on the graph: each node's name, and what stands for its process.

        Args:
            plants: That tell a plant's state in the fish's namespace.
            studies: That tell a study's progress there.
            seen: What is seen instead, in words.
        """
        self.plants = sorted(plants)
        self.plant_name = next(iter(self.plants), self.plant_name)
        for node, names in ((self.plant, plants), (self.study, studies)):
            node.there = bool(names)
            if names:
                node.incarnation = repr(sorted(names.items()))
        self.seen = seen

    def happened(self, time: str, address: str, text: str, *, good: bool) -> None:
        """Note what somebody did, or what came of it, for every page to show."""
        self.events.append({"time": time, "address": address, "text": text, "good": good})

    # -- what follows ------------------------------------------------------------------------------------------------

    @property
    def trial(self) -> int | None:
        """Number of the trial that was told last; None before any."""
        text = self.candidate.get("trial", "")
        return int(text) if text.isdecimal() else None

    @property
    def _trials(self) -> int:
        """How many trials have begun, as the study says."""
        return int(_number(self.progress.get("trials")) or 0)

    @property
    def goals(self) -> Goals:
        """What the study looks for, as it says."""
        return _goals(self.progress.get("objective", ""), self.progress.get("constraints", ""))

    def _measured(self) -> Measured:
        """Return what the trial that was told last achieved; nothing where it is not told whole."""
        columns = {each.name: "score [m/s]" if each.name == MEAN_SPEED else each.column for each in self.goals.asked}
        found = {name: _number(self.candidate.get(column)) for name, column in columns.items()}
        whole = {name: value for name, value in found.items() if value is not None}
        return whole if len(whole) == len(columns) else {}

    @property
    def folder(self) -> str:
        """The study's folder, empty while it is not known."""
        return self.progress.get("folder", "")

    @property
    def lacking(self) -> int:
        """How many earlier trials were not heard."""
        return max(0, self._trials - 1 - len(self._search))

    def lost(self, now: float) -> bool:
        """Whether nothing is heard of the graph any more."""
        if self._heard is None:
            return True
        if not self.plant.alive(now) and not self.study.alive(now):
            return True
        swims = self.state is not None and self.state.state is not State.FAULT
        return swims and self._pictures >= _FLOWING and now - self._heard > STREAM_SILENT

    def offers(self, now: float) -> list[Offer]:
        """Return the buttons that there are now."""
        if self.lost(now):
            return []
        # Only of processes that were seen: what stands for them is part of each button's key.
        state = self.state if self.plant.alive(now) and self.plant.incarnation else None
        mode = self.progress.get("mode", "") if self.study.alive(now) and self.study.incarnation else ""
        return [
            *offers.of_plant(state, f"{self._session} {self.plant.incarnation} {self._questions}"),
            *offers.of_study(mode, self.trial, self._trials, f"{self._session} {self.study.incarnation} {self.folder}"),
        ]

    def snapshot(self, now: float) -> dict[str, object]:
        """Return all but the fish's picture and the search, as JSON has it."""
        lost = self.lost(now)
        return {
            "kind": "snapshot",
            "graph": {"lost": lost, "text": self._graph_text(now) if lost else ""},
            "plant": self._plant(now, lost=lost),
            "study": self._study(now, lost=lost),
            "trial": self._trial(now, lost=lost),
            "offers": [offer.told() for offer in self.offers(now)],
            "stop": self.stop.told() if self.stop else None,
            "events": list(self.events),
        }

    def search(self) -> dict[str, object]:
        """Return the search so far, as JSON has it, the best of each stretch where trials are many.

        ``scores`` are number, value of the first goal in the unit of ``label``, whether all constraints are met; in
        ``best`` is the best value up to each of them, None before any.
        """
        goal, trials = self.goals.measures[0], sorted(self._search.items())
        stride = math.ceil(len(trials) / _MOST_POINTS) or 1
        groups = (trials[start : start + stride] for start in range(0, len(trials), stride))
        thinned = [max(group, key=lambda trial: self._rank(trial[1])) for group in groups]
        scores: list[tuple[int, float | None, bool]] = []
        best: list[float | None] = []
        for number, measured in thinned:
            met, rank = self._rank(measured)
            value = goal.direction * rank / goal.shown_in[1] if math.isfinite(rank) else None
            scores.append((number, value, met))
            known = [each for each in (*best[-1:], value if met else None) if each is not None]
            best.append(max(known, key=lambda each: goal.direction * each, default=None))
        return {"kind": "search", "scores": scores, "best": best, "trials": len(trials), "label": goal.axis}

    def _rank(self, measured: Measured) -> tuple[bool, float]:
        """Return whether a trial meets all constraints, and its first goal, more being better; -inf without a score."""
        goals = self.goals
        if any(each.name not in measured for each in goals.asked):
            return False, -math.inf
        return not goals.missed(measured), float(goals.objectives(measured)[0])

    def _graph_text(self, now: float) -> str:
        if self._heard is None:
            return f"Nothing is heard of a fish or a study yet: {self.seen}" if self.seen else NO_FISH
        return f"Nothing has come from the graph for {now - self._heard:.0f} s. {SWITCH}"

    def _plant(self, now: float, *, lost: bool) -> dict[str, object]:
        state, live = self.state, self.plant.alive(now) and not lost
        told: dict[str, object] = {"live": live, "name": self.plant_name, "said": _age(self.plant, now)}
        if state is None:
            return {**told, "state": "NO FISH", "reason": self.seen, "advice": NO_FISH, "mount": {}, "fin": {}}
        advice = next_step(state, BUTTONS)[0]
        if not live:
            gone = "is gone" if self.plant.there is False else f"has said nothing for {self.plant.silence(now):.0f} s"
            advice = f"{self.plant_name or 'The fish'} {gone}. {SWITCH}"
        wanted = state.details if state.details.get("waiting_for") == "fin" else {}
        return {
            **told,
            "state": state.state.value,
            "reason": "" if advice_says_all(state) else state.reason,
            "advice": advice,
            "mount": _sizes(wanted),
            "fin": _sizes({f"wanted.{name}": text for name, text in state.fin.items()}),
            "kind": state.plant,
            "device": {
                n: self.device[n] for n in _SHOWN_DEVICE if self.device.get(n) not in {None, "", "not reported"}
            },
        }

    def _study(self, now: float, *, lost: bool) -> dict[str, object]:
        values = self.progress
        return {
            "live": self.study.alive(now) and not lost,
            "said": _age(self.study, now),
            "known": bool(values),
            "text": self._progress_text,
            "mode": offers.mode_shown(values.get("mode", ""), self._trials),
            "settled": values.get("candidates_settled", ""),
            "wanted": values.get("candidates_wanted", ""),
            "folder": self.folder,
        }

    def _trial(self, now: float, *, lost: bool) -> dict[str, object]:
        values = self.candidate
        measured = self._measured()
        return {
            "live": self.study.alive(now) and not lost,
            "known": bool(values),
            "text": self._candidate_text,
            "outcome": values.get("outcome", ""),
            "phase": self.progress.get("phase", "") if values.get("outcome") == "RUNNING" else "",
            "score": ", ".join([self.goals.shown(measured), *self.goals.missed(measured)]) if measured else "",
            "reason": values.get("reason", ""),
            "unscored": self._unscored[1] if self._unscored[0] != self.trial else "",
        }


def _age(node: Node, now: float) -> float | None:
    return None if node.said is None else round(node.silence(now), 1)


def _number(text: str | None) -> float | None:
    """Return a number as messages tell it; None where it is none, or no finite one."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _sizes(details: Mapping[str, str]) -> dict[str, str]:
    """Return a fin as a person would cut it; empty where it is not told whole."""
    try:
        return sizes(wanted_fin(details))
    except (KeyError, ValueError):
        return {}


@cache
def _goals(objective: str, constraints: str) -> Goals:
    """Return the goals that an optimiser tells; those of the speed where it tells none that are known here."""
    try:
        return Goals.of_objective(objective, constraints.split(BETWEEN_CONSTRAINTS) if constraints else ())
    except ValueError:
        return Goals()


def ended(trials: Iterable[tuple[int, str, Measured]]) -> dict[int, Measured]:
    """Return the trials that have ended, from their numbers, outcomes and what they achieved."""
    return {number: measured for number, outcome, measured in trials if outcome not in {"PROPOSED", "RUNNING"}}


def as_json(told: Mapping[str, object]) -> str:
    """Return what is told as the text that goes over the socket; a number that JSON does not know is an error."""
    return json.dumps(told, allow_nan=False, separators=(",", ":"))
