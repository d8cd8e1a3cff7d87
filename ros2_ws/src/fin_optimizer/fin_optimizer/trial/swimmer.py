"""One fish and the trial that it swims: turns a trial's actions into messages, calls and files."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Float64

from fin_optimizer.bags.messages import BagError, decode
from fin_optimizer.score.mean_speed import NotThisSwimError, ScoreError
from fin_optimizer.score.swim import scored_swim, start_of_swim
from fin_optimizer.trial.facts import Observation
from fin_optimizer.trial.plant_client import PlantClient
from fin_optimizer.trial.recorder import LONGEST_PAUSE, Recorder
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.trial import PHASES_OF_VELOCITY, Action, Trial
from fin_optimizer.words import show_speed, show_values, trial_name
from fin_plant import topics
from fin_plant.messages import key_values
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from fin_optimizer.plan import Plan
    from fin_optimizer.study.candidate import TrialRecord
    from fin_plant.topics import Topic

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


class Lane:
    """A fish by its namespace, with its recorder, and the trial under way.

    Attributes:
        namespace: Of the fish, for example ``/tank_a/fish``.
        plant: How it is spoken to.
        trial: The one under way, None between trials.
        record: What the journal says of it.
        unusable_stamps: Number of recorded messages by topic whose stamp cannot be believed.
        notes: What is to be said of the fish, once.
    """

    def __init__(
        self,
        node: Node,
        namespace: str,
        plan: Plan,
        metadata: Mapping[str, str],
        meet: Callable[[Mapping[str, object]], Sequence[str]],
    ) -> None:
        """Listen to the fish.

        Args:
            node: The optimiser's.
            namespace: Of the fish, absolute.
            plan: What the study asks for.
            metadata: What describes the study, for every bag.
            meet: Tells in what a fish differs from the study's, see `Study.keep_or_compare`.
        """
        self.namespace = namespace
        self.plant = PlantClient(node, namespace)
        self.trial: Trial | None = None
        self.record: TrialRecord | None = None
        self._plan = plan
        self._metadata = metadata
        self._meet = meet
        self._recorder = Recorder(node, namespace=namespace, minimum_free=plan.number("disk.minimum_free"))
        self._facts = Observation(node, self.plant, self._recorder, namespace, plan.gait)
        self._gait_due: float | None = None
        self._look_due = 0.0
        self._fast = self._was_fast = False
        self._waiting, self._waiting_since = "", 0.0
        self._recorded: dict[str, str] = {}
        self.unusable_stamps: dict[str, int] = {}
        self.notes: list[str] = []
        self._folder: Path | None = None

        def publisher(topic: Topic[Any]) -> Publisher:
            return node.create_publisher(topic.type, topic.name_in(namespace), topic.qos)

        self._candidate_topic = publisher(topics.CANDIDATE)
        self._score_topic = publisher(topics.SCORE)

    @property
    def trouble(self) -> str:
        """Why the fish cannot be given a trial now, or empty."""
        plants, state = self.plant.plants(), self.plant.state
        topic = topics.PLANT_STATE.name_in(self.namespace)
        if len(plants) > 1:
            return f"{len(plants)} plants publish {topic} ({', '.join(plants)}): leave only one"
        if state is None:
            return self._facts.nothing_on(topic)
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
        return self._facts.other_fish or ""

    @property
    def cut_gait(self) -> str:
        """What the plant's limits would make of the study's gait, or empty."""
        return self._facts.cut_gait

    @property
    def phase(self) -> str:
        """Phase of the trial under way, or empty."""
        return self.trial.phase if self.trial is not None else ""

    @property
    def note(self) -> str:
        """How far the fish has swum, or empty."""
        swims = self.trial is not None and self.trial.window is not None
        return f"{self.trial.swum:.0f} s" if self.trial is not None and swims else ""

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

    def begin(self, record: TrialRecord, folder: Path) -> None:
        """Begin a trial that the journal knows as RUNNING; its bag goes into the study's folder."""
        self.record, self._folder = record, folder
        self._facts.bag_error, self._facts.result, self._facts.other_fish = "", None, None
        self.trial = Trial(
            self.namespace, self._plan.fin_of(record.values), self._plan.measurement, self._plan.timeouts
        )
        self._facts.trial = self.trial
        self._look_due = 0.0
        self._was_fast, self._fast = self._fast, False
        self.publish_candidate(record)

    def end(self) -> None:
        """Forget the trial, which has its result."""
        self.trial = self._facts.trial = self.record = None

    def advance(self, now: float) -> float:
        """Take the trial as far as the facts allow; return how long to wait for new ones, in s."""
        taken = self._recorder.listen()
        trial = self.trial
        if trial is None:
            return LONGEST_PAUSE
        self._repeat_gait(now)
        if self.plant.changed or now >= self._look_due:
            self.plant.changed = False
            self._compare_fish()
            before = None
            while trial.result is None and trial.phase != before:
                before = trial.phase
                for action in trial.update(now, self._facts):
                    self._carry_out(action, trial)
            self._fast = self._fast or taken > _MANY
            fast = self._fast or self._was_fast
            self._look_due = time.monotonic() + (_FAST_LOOK_PERIOD if fast else _LOOK_PERIOD)
        if trial.result is not None:
            trial.result = self._diagnosed(trial.result)
            return 0.0
        return max(0.0, self._look_due - time.monotonic())

    def _diagnosed(self, result: Result) -> Result:
        """Return a result for which a want of velocity may be the cause with what its estimator complained about."""
        trouble = self.plant.velocity_trouble
        wanted = result.outcome in {Outcome.FAILED, Outcome.INTERRUPTED} and self.phase in PHASES_OF_VELOCITY
        if not wanted or not trouble:
            return result
        return replace(
            result, reason=f"{result.reason}; the velocity estimator said since the bag was opened: {trouble}"
        )

    def cancel(self, reason: str) -> None:
        """End the trial because somebody stopped it: the gait off, the bag closed."""
        if self.trial is not None:
            for action in self.trial.cancel(reason):
                self._carry_out(action, self.trial)

    def destroy(self) -> None:
        """Close the bag and stop listening.

        Raises:
            BagError: The bag's end could not be written.
        """
        self._recorder.destroy()

    def publish_candidate(self, record: TrialRecord) -> None:
        """Say which fin swims, or how it ended."""
        values: dict[str, object] = {
            "trial": record.number,
            "fin": record.candidate + 1,
            **record.values,
            "outcome": record.outcome.value,
        }
        known = {"score [m/s]": record.score, "cost of transport [J/m]": record.cost, "reason": record.reason or None}
        values |= {name: value for name, value in known.items() if value is not None}
        level = DiagnosticStatus.WARN if record.reason else DiagnosticStatus.OK
        shown = f"{trial_name(record.number)}: {show_values(record.values)}"
        self._candidate_topic.publish(
            DiagnosticStatus(level=level, name="candidate", message=shown, values=key_values(values))
        )
        if record.score is not None:
            self._score_topic.publish(Float64(data=record.score))

    # -- a trial's actions -------------------------------------------------------------------------------------------

    def _carry_out(self, action: Action, trial: Trial) -> None:
        match action:
            case Action.SET_FIN:
                self.plant.ask_parameters()
                self.plant.set_fin(trial.fin)
            case Action.RESET | Action.RECOVER:
                self.plant.request_reset()
            case Action.GAIT_ON:
                self._gait_due, self.plant.applied = 0.0, None
                self._repeat_gait(time.monotonic())
            case Action.GAIT_OFF:
                self._gait_due = None
                self.plant.send(self._plan.no_gait)
            case Action.OPEN_BAG:
                self.plant.velocity_trouble = ""
                self._with_bag(self._open_bag)
            case Action.CLOSE_BAG:
                self._with_bag(self._close_bag)
            case Action.SCORE:
                self._facts.result = self._scored(trial)

    def _fish(self) -> dict[str, object]:
        """Return what swims, as far as the plant has told: all that decides a swim, the fin and the gait excepted."""
        kind = {"plant": self.plant.state.plant} if self.plant.state is not None else {}
        return {**kind, **(self.plant.parameters or {})}

    def _compare_fish(self) -> None:
        if self.plant.parameters is not None and self._facts.other_fish is None:
            different = "; ".join(self._meet(self._fish()))
            self._facts.other_fish = different and f"the study was begun with another fish: {different}"

    def _repeat_gait(self, now: float) -> None:
        if self._gait_due is not None and now >= self._gait_due:
            self._gait_due = now + _GAIT_PERIOD
            self.plant.send(self._plan.gait)

    def _with_bag(self, work: Callable[[], object]) -> None:
        try:
            work()
        except BagError as error:
            self._facts.bag_error = str(error)

    def _open_bag(self) -> None:
        if self.record is not None and self._folder is not None:
            self._recorded = self._bag_metadata(self.record)
            self._recorder.open(self._folder / self.record.bag, self._recorded, self._plan.measurement)

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

    def _bag_metadata(self, record: TrialRecord) -> dict[str, str]:
        state = self.plant.state
        trial = {
            "trial.number": str(record.number),
            "trial.candidate": str(record.candidate),
            "trial.started": record.started.isoformat() if record.started is not None else "",
            "plant.namespace": self.namespace,
        }
        fin = state.fin if state is not None else {}
        fish = {name: value if isinstance(value, str) else json.dumps(value) for name, value in self._fish().items()}
        return {**trial, **fish, **fin, **self._metadata}

    def _scored(self, trial: Trial) -> Result:
        if trial.window is None:
            return Result(Outcome.FAILED, "the fish never swam")
        joints = self._recorder.messages(topics.JOINT_STATES) if self._plan.wants_cost else None
        velocity = self._recorder.velocity_samples()
        states = (decode(data, topics.PLANT_STATE.type_name) for data in self._recorder.messages(topics.PLANT_STATE))
        try:
            window = self._plan.measurement.window(start_of_swim(states, self._recorded))  # as the bag will tell it
            scored, cost = scored_swim(velocity, joints, window, self._plan.measurement)
        except NotThisSwimError as error:
            return Result(Outcome.INTERRUPTED, error.reason)
        except ScoreError as error:
            return Result(Outcome.FAILED, error.reason)
        if self._plan.wants_cost and cost is None:
            reason = f"swims {show_speed(scored.value)}: without headway there is no cost of transport"
            return Result(Outcome.INFEASIBLE, reason)
        spread = scored.spread if math.isfinite(scored.spread) else None
        return Result(Outcome.OK, score=scored.value, spread=spread, cost=cost, samples=scored.samples)
