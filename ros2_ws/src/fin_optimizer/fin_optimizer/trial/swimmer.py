"""One fish and the trial that it swims: the loop from a fin to a result.

    begin(number, fin, bag) -> advance(now) ... advance(now) -> Result
                                  |
        recorder.listen, observer.look -> Facts -> Trial.update -> Actions -> plant, recorder, score

Whoever gives it fins is not known here: neither the study nor its journal.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fin_optimizer.bags.messages import BagError
from fin_optimizer.goals import VELOCITY, YAW_RATE
from fin_optimizer.trial.gait_check import cut_gait
from fin_optimizer.trial.observer import Observer
from fin_optimizer.trial.phases import Action, Rule
from fin_optimizer.trial.plant_client import PlantClient
from fin_optimizer.trial.recorder import LONGEST_PAUSE, Recorder
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.scored import result_of
from fin_optimizer.trial.trial import Trial
from fin_plant import topics
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from rclpy.node import Node

    from fin_optimizer.goals import Goals
    from fin_optimizer.score.mean_speed import Measurement
    from fin_optimizer.trial.facts import Facts
    from fin_optimizer.trial.phases import Timeouts
    from fin_plant.gait import Gait
    from fin_plant.parameters import Value

_GAIT_PERIOD = 0.25
"""s; the plant's command_timeout is twice that."""
_LOOK_PERIOD = 0.02
"""s between two looks at facts that come without a callback: the graph, and time itself."""
_FAST_LOOK_PERIOD = 0.002
"""s, while a plant swims far faster than real time: it must not go on long after its window."""
_MOMENT = 3.0
"""s after which a person is told that the fish waits; an emulated operator answers within one."""
_MANY = 20
"""Messages at one look that tell such a plant; in real time some ten come in a look period."""


@dataclass(frozen=True)
class Conditions:
    """What all trials of a fish have in common.

    Attributes:
        gait: What it swims.
        still: The gait of a tail that is led to its middle.
        measurement: Which part of a swim is scored.
        timeouts: How long to wait for what.
        goals: What is asked of a swim.
        differences: Tells in what a fish, by its parameters, is not the one that swims here.
    """

    gait: Gait
    still: Gait
    measurement: Measurement
    timeouts: Timeouts
    goals: Goals
    differences: Callable[[Mapping[str, object]], Sequence[str]]


class Swimmer:
    """A fish by its namespace, and the trial under way.

    Attributes:
        namespace: Of the fish, for example ``/tank_a/fish``.
        plant: How it is spoken to.
        trial: The one under way, None between trials.
        unusable_stamps: Number of recorded messages by topic whose stamp cannot be believed.
        notes: What is to be said of the fish, once.
    """

    def __init__(
        self, namespace: str, conditions: Conditions, plant: PlantClient, recorder: Recorder, observer: Observer
    ) -> None:
        self.namespace = namespace
        self.plant = plant
        self.trial: Trial | None = None
        self.unusable_stamps: dict[str, int] = {}
        self.notes: list[str] = []
        self._conditions = conditions
        self._widest_gait = conditions.gait
        self._recorder = recorder
        self._observer = observer
        self._gait_due: float | None = None
        self._look_due = 0.0
        self._fast = self._was_fast = False
        self._waiting, self._waiting_since = "", 0.0
        self._number = 0
        self._bag: Path | None = None
        self._told: Mapping[str, str] = {}
        self._bag_error = ""
        self._scored_as: Result | None = None
        self._other_fish: str | None = None

    @classmethod
    def of(
        cls,
        node: Node,
        namespace: str,
        conditions: Conditions,
        minimum_free: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> Swimmer:
        """Return the swimmer of a namespace's fish, which a node listens to.

        Args:
            node: Node that listens and speaks.
            namespace: Of the fish, absolute.
            conditions: What all its trials have in common, of several gaits the widest.
            minimum_free: Bytes that must stay free on the disk of a bag.
            clock: Time in s.
        """
        plant = PlantClient(node, namespace)
        recorder = Recorder(node, namespace=namespace, minimum_free=minimum_free, clock=clock)
        return cls(namespace, conditions, plant, recorder, Observer(node, plant, recorder, namespace, conditions.gait))

    # -- one trial ---------------------------------------------------------------------------------------------------

    def begin(
        self,
        number: int,
        fin: Mapping[str, Value],
        bag: Path,
        told: Mapping[str, str],
        swims: tuple[Gait, Measurement] | None = None,
    ) -> None:
        """Begin a trial.

        Args:
            number: Of the trial.
            fin: The fin to try, by the plant's parameters, in SI units.
            bag: Folder of its bag, which must not exist.
            told: What the bag's metadata tell besides the trial's number and what the plant says of itself.
            swims: Its gait, and which part of its swim counts; None for those that all trials have in common.
        """
        if swims is not None:
            self._conditions = replace(self._conditions, gait=swims[0], measurement=swims[1])
            self._observer.gait = swims[0]
        self._number, self._bag, self._told = number, bag, told
        self._bag_error, self._scored_as, self._other_fish = "", None, None
        self._look_due = 0.0
        self._was_fast, self._fast = self._fast, False
        self.trial = Trial(self.namespace, fin, self._conditions.measurement, self._conditions.timeouts)

    def advance(self, now: float) -> Result | None:
        """Take the trial as far as the facts allow; return how it ended, once, or None while it goes on.

        Args:
            now: Time of a monotonic clock in s.
        """
        taken = self._recorder.listen()
        self.plant.look(now)
        if self.trial is None:
            return None
        self._repeat_gait(now)
        self._fast = self._fast or taken > _MANY
        if self.plant.changed or now >= self._look_due:
            self.plant.changed = False
            self._compare_fish()
            before = None
            while self.trial.result is None and self.trial.phase != before:
                before = self.trial.phase
                for action in self.trial.update(now, self._look(self.trial)):
                    self._carry_out(action, self.trial, now)
            self._look_due = now + (_FAST_LOOK_PERIOD if self._fast or self._was_fast else _LOOK_PERIOD)
            self._diagnosed(self.trial)
        return self._ended()

    def cancel(self, reason: str, now: float) -> Result | None:
        """End the trial because somebody stopped it: the gait off, the bag closed; return how it ended, if any was."""
        if self.trial is None:
            return None
        for action in self.trial.cancel(reason):
            self._carry_out(action, self.trial, now)
        return self._ended()

    def pause(self, now: float) -> float:
        """Return how long may be waited, in s, before `advance` is called again."""
        return LONGEST_PAUSE if self.trial is None else max(0.0, self._look_due - now)

    def destroy(self) -> None:
        """Close the bag and stop listening.

        Raises:
            BagError: The bag's end could not be written.
        """
        self._recorder.destroy()

    def _look(self, trial: Trial) -> Facts:
        """Return what is seen now."""
        seen = self._observer.look(trial.looks_up, trial.window)
        return replace(
            seen,
            other_fish=self._other_fish,
            recorder_failure=self._bag_error or seen.recorder_failure,
            result=self._scored_as,
        )

    def _ended(self) -> Result | None:
        """Return the trial's result, and forget the trial, if it has one."""
        result = self.trial.result if self.trial is not None else None
        if result is not None:
            self.trial = None
        return result

    def _diagnosed(self, trial: Trial) -> None:
        """Where a want of velocity may be the cause of a result, add what its estimator complained about."""
        result, trouble = trial.result, self.plant.velocity_trouble
        if result is None or result.outcome not in {Outcome.FAILED, Outcome.INTERRUPTED}:
            return
        if trouble and trial.has(Rule.VELOCITY):
            told = f"{result.reason}; the velocity estimator said since the bag was opened: {trouble}"
            trial.result = replace(result, reason=told)

    # -- a trial's actions -------------------------------------------------------------------------------------------

    def _carry_out(self, action: Action, trial: Trial, now: float) -> None:
        match action:
            case Action.SET_FIN:
                self.plant.ask_parameters()
                self.plant.set_fin(trial.course.fin)
            case Action.RESET | Action.RECOVER:
                self.plant.request_reset()
            case Action.GAIT_ON:
                self._gait_due, self.plant.applied = now, None
                self._repeat_gait(now)
            case Action.GAIT_OFF:
                self._gait_due = None
                self.plant.send(self._conditions.still)
            case Action.OPEN_BAG:
                self.plant.velocity_trouble = ""
                self._with_bag(self._open_bag)
            case Action.CLOSE_BAG:
                self._with_bag(self._close_bag)
            case Action.SCORE:
                self._scored_as = self._scored(trial)

    def _fish(self) -> dict[str, object]:
        """Return what swims, as far as the plant has told: all that decides a swim, the fin and the gait excepted."""
        kind = {"plant": self.plant.state.plant} if self.plant.state is not None else {}
        return {**kind, **(self.plant.parameters or {})}

    def _compare_fish(self) -> None:
        if self.plant.parameters is not None and self._other_fish is None:
            different = "; ".join(self._conditions.differences(self._fish()))
            self._other_fish = different and f"the study was begun with another fish: {different}"

    def _repeat_gait(self, now: float) -> None:
        if self._gait_due is not None and now >= self._gait_due:
            self._gait_due = now + _GAIT_PERIOD
            self.plant.send(self._conditions.gait)

    def _with_bag(self, work: Callable[[], object]) -> None:
        try:
            work()
        except BagError as error:
            self._bag_error = str(error)

    def _open_bag(self) -> None:
        if self._bag is not None:
            self._told = self._bag_metadata()
            self._recorder.open(self._bag, self._told, self._conditions.measurement)

    def _close_bag(self) -> None:
        summary = self._recorder.close()
        for topic, count in summary.unusable_stamps.items():
            if topic not in self.unusable_stamps:
                said = "message of {topic} has a stamp" if count == 1 else "messages of {topic} have a stamp"
                self.notes.append(
                    f"warning: {count} {said.format(topic=topic)} that cannot be believed, the first is "
                    f"{summary.first_unusable[topic]}. The bag has them at the newest time known; more of them are "
                    "counted in /diagnostics"
                )
            self.unusable_stamps[topic] = self.unusable_stamps.get(topic, 0) + count

    def _bag_metadata(self) -> dict[str, str]:
        state = self.plant.state
        trial = {"trial.number": str(self._number), "plant.namespace": self.namespace}
        fin = state.fin if state is not None else {}
        fish = {name: value if isinstance(value, str) else json.dumps(value) for name, value in self._fish().items()}
        return {**trial, **fish, **fin, **self._conditions.measurement.metadata(), **self._told}

    def _scored(self, trial: Trial) -> Result:
        if trial.window is None:
            return Result(Outcome.FAILED, "the fish never swam")
        return result_of(self._recorder.swim(self._told), self._conditions.goals)

    # -- how the fish is ---------------------------------------------------------------------------------------------

    @property
    def trouble(self) -> str:
        """Why the fish cannot be given a trial now, or empty."""
        plants, state = self.plant.plants, self.plant.state
        topic = topics.PLANT_STATE.name_in(self.namespace)
        if len(plants) > 1:
            return f"{len(plants)} plants publish {topic} ({', '.join(plants)}): leave only one"
        if state is None:
            return self._observer.nothing_on(topic)
        if not plants:
            return f"nobody publishes topic {topic} any more"
        if state.state is State.FAULT:
            return f"{plants[0]} is in FAULT{f' ({state.reason})' if state.reason else ''}"
        if state.state is State.SWIMMING and self.trial is None:  # of one that was killed, this was the last word
            return f"{plants[0]} still says SWIMMING after its trial"
        return ""

    @property
    def other_fish(self) -> str:
        """Why the fish is not the study's, or empty."""
        return self._other_fish or ""

    @property
    def cut_gait(self) -> str:
        """What the plant's limits would make of the study's gait, the widest of several, or empty."""
        return cut_gait(self.plant.state, self._widest_gait)

    @property
    def untold(self) -> str:
        """What the study is about and the plant says that it does not tell, or empty."""
        state = self.plant.state
        if state is None or state.tells is None:
            return ""
        return self._conditions.goals.cannot_be_told({VELOCITY, YAW_RATE, *state.tells}, state.plant)

    @property
    def phase(self) -> str:
        """Phase of the trial under way, or empty."""
        return self.trial.phase if self.trial is not None else ""

    @property
    def note(self) -> str:
        """How far the fish has swum, or empty."""
        swims = self.trial is not None and self.trial.window is not None
        return f"{self.trial.course.swum:.0f} s" if self.trial is not None and swims else ""

    def waits_for(self, now: float) -> str:
        """Return, once, what a person has to do if the fish waits for one longer than for a moment; else nothing."""
        state = self.plant.state
        waiting = ""
        if self.trial is not None and state is not None and state.waits_for_people:
            waiting = state.reason or state.state.value
        if waiting != self._waiting:
            self._waiting, self._waiting_since = waiting, now
        if not waiting or now - self._waiting_since < _MOMENT:
            return ""
        self._waiting_since = math.inf
        return waiting
