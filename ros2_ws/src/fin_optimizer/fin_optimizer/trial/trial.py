"""One trial, from a proposed fin to a scored swim, as a state machine that knows neither ROS nor a clock.

The table ``PHASES`` is the trial. A phase begins with an action, which the node carries out, and lasts until its
condition holds; what the conditions look at are `Facts`, which the node observes. A phase that takes too long, a fault
of the plant or of the recorder, a refused fin or a cancelled trial end it at once, with a reason that names what was
missing; then the gait is switched off and the bag is closed, whatever the phase was.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol

from fin_optimizer.trial.result import Outcome, Result
from fin_plant import checks
from fin_plant.gait import LONGEST_RAMP
from fin_plant.plant_state import State
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fin_optimizer.score.mean_speed import Measurement, Window
    from fin_plant.parameters import Value
    from fin_plant.plant_state import PlantState

_WAITING = (State.WAITING_FOR_FIN, State.WAITING_FOR_RESET)
STRAIGHT = 0.05
"""rad. In a rehearsal a tail that began at 0.06 rad changed a score by 1.4 %, at 0.2 rad by 8 %."""
_LONG = 1000.0
"""s. From here on whole seconds tell enough."""


class Action(Enum):
    """What the node does when a phase begins."""

    RECOVER = "ask the plant for a reset, which clears a simulator's fault"
    SET_FIN = "set the candidate's parameters, all at once"
    RESET = "ask the plant for the fish at rest at its start"
    OPEN_BAG = "open the trial's bag"
    GAIT_ON = "send the gait, and repeat it"
    GAIT_OFF = "send a gait of zero amplitude"
    CLOSE_BAG = "close the trial's bag"
    SCORE = "score the swim"


@dataclass(frozen=True)
class Reply:
    """What a service answered."""

    accepted: bool
    reason: str = ""


class Facts(Protocol):
    """What the node sees. Replies and result are None from the moment that their action is carried out anew."""

    @property
    def plants(self) -> Sequence[str]:
        """Full names of the nodes that publish ``plant_state`` in the namespace."""

    @property
    def publishers(self) -> frozenset[str]:
        """What tells each publisher of ``plant_state`` from one that is started later under the same name."""

    def nothing_on(self, topic: str) -> str:
        """Return what the graph shows of a topic, by its full name, on which nothing comes."""

    @property
    def deaf_to_gait(self) -> str:
        """Why nobody hears the gait, or empty."""

    @property
    def missing_services(self) -> Sequence[str]:
        """Full names of the plant's services that are not there."""

    @property
    def plant(self) -> PlantState | None:
        """Newest state of the plant."""

    @property
    def fin_reply(self) -> Reply | None:
        """Answer to SET_FIN."""

    @property
    def reset_reply(self) -> Reply | None:
        """Answer to RESET or RECOVER."""

    @property
    def other_fish(self) -> str | None:
        """Why the plant's fish is not the one of the study, or empty; None until the plant has told what swims."""

    @property
    def cut_gait(self) -> str:
        """What the plant's limits would make of the gait, or empty."""

    @property
    def follows_a_gait(self) -> bool:
        """Whether the plant has said, since GAIT_ON, which gait it follows."""

    @property
    def other_gait(self) -> str:
        """Why the plant swims another gait than the one asked for, or empty."""

    @property
    def tail_angle(self) -> float | None:
        """Largest angle of a driven joint in rad, as said last; None before."""

    @property
    def unmatched_topics(self) -> Sequence[str]:
        """Full names of the topics to record from which nothing can arrive yet."""

    @property
    def newest_velocity(self) -> int | None:
        """Stamp in ns of the velocity that came last."""

    @property
    def velocities(self) -> int:
        """Number of velocities that have come."""

    @property
    def least_pace(self) -> float:
        """Seconds of its own time that the plant swims at least in a second of the wall clock."""

    @property
    def drift(self) -> float | None:
        """Mean forward speed in m/s of late, 0 for a plant that is at rest by nature; None before it is known."""

    @property
    def late_topics(self) -> Sequence[str]:
        """Full names of the recorded streams whose newest stamp is before the end of the trial's window."""

    @property
    def recorder_failure(self) -> str:
        """Why the bag cannot be written, or empty."""

    @property
    def result(self) -> Result | None:
        """Outcome of SCORE."""


@dataclass(frozen=True)
class Timeouts:
    """How long a phase may last without a sign of progress, in s of the wall clock.

    Attributes:
        find: Until a plant is found with its services.
        plant: Until the plant is at rest, ready and matched.
        reply: Until a service answers.
        silence: Until velocities have carried a swim on, or until the next state around it.
        rest: Until the water is still, and the fish with it.
        people: Until somebody has mounted a fin or brought the fish back to its mark; 0 waits for ever.
    """

    find: float = 60.0
    plant: float = 10.0
    reply: float = 10.0
    silence: float = 5.0
    rest: float = 60.0
    people: float = 0.0

    def __post_init__(self) -> None:
        for name in ("find", "plant", "reply", "silence", "rest"):
            checks.number(f"timeout.{name}", getattr(self, name), 0.0, unit="s", exclusive_minimum=True)
        checks.number("timeout.people", self.people, 0.0, unit="s")


@dataclass(frozen=True)
class Phase:
    """A row of the trial's table.

    Attributes:
        name: As it is shown.
        action: What begins it; None for phases that only wait. A function chooses by the facts.
        done: Whether it is over.
        patience: Name of the timeout that bounds it.
        missing: What was missing if time runs out.
    """

    name: str
    action: Action | Callable[[Facts], Action | None] | None
    done: Callable[[Trial, Facts], bool]
    patience: str
    missing: Callable[[Trial, Facts], str]


class Trial:
    """A trial under way.

    Attributes:
        fin: The fin that is tried, by the plant's parameters.
        measurement: Which part of the swim is scored, and what a swim must be to be scored.
        result: How it ended, None before.
        window: Over which it is scored, None until the fish swims.
    """

    def __init__(self, namespace: str, fin: Mapping[str, Value], measurement: Measurement, timeouts: Timeouts) -> None:
        """Begin before the first phase.

        Args:
            namespace: Of the fish, for example ``/fish``; only for messages.
            fin: The fin to try, by the plant's parameters, in SI units.
            measurement: Which part of the swim is scored.
            timeouts: How long to wait for what.
        """
        self.fin = fin
        self.result: Result | None = None
        self.window: Window | None = None
        self._topic_prefix = namespace.rstrip("/")
        self.measurement = measurement
        self._timeouts = timeouts
        self._index = -1
        self._progress_at = 0.0
        self._reached = 0.0
        self._reached_before = 0.0
        self._velocities_before = 0
        self._waited_for_people = False
        self._swimming_since = 0
        self._reset_after = -1
        self._gait_is_on = False
        self._other_gait = ""
        self._bag_is_open = False
        self._spoken_to: frozenset[str] = frozenset()
        self._gone_since: float | None = None

    @property
    def phase(self) -> str:
        """Name of the phase under way."""
        return "begin" if self._index < 0 else PHASES[self._index].name

    def topic(self, name: str) -> str:
        """Return the full name of one of the fish's topics."""
        return f"{self._topic_prefix}/{name}"

    def update(self, now: float, facts: Facts) -> list[Action]:
        """Go on as far as the facts allow, one phase at most, and return what the node must do now, in order.

        Call it again after the actions, whenever a fact has changed, and every now and then for the timeouts.

        Args:
            now: Time of a monotonic clock in s.
            facts: What the node sees.
        """
        if self.result is not None:
            return []
        if self._index < 0:
            return self._enter(0, now, facts)
        phase = PHASES[self._index]
        if self._gait_is_on and facts.other_gait:
            self._other_gait = facts.other_gait
        if failure := self._failure(facts) or self._lost(now, facts):
            return self._end(failure)
        self._note_progress(now, facts)
        if phase.done(self, facts):
            return self._next(now, facts)
        if failure := self._stopped_swimming(facts) or self._overdue(now, facts):
            return self._end(failure)
        return []

    def cancel(self, reason: str) -> list[Action]:
        """End the trial because somebody stopped it, and return what the node must do now, in order."""
        if self.result is not None:
            return []
        return self._end(Result(Outcome.INTERRUPTED, f"in phase '{self.phase}': {reason}"))

    def _next(self, now: float, facts: Facts) -> list[Action]:
        if PHASES[self._index].action is Action.GAIT_ON and facts.plant is not None:
            self._swimming_since = facts.plant.stamp
            self.window = self.measurement.window(facts.plant.stamp)
        if self._index + 1 < len(PHASES):
            return self._enter(self._index + 1, now, facts)
        self.result = facts.result
        return []

    def _enter(self, index: int, now: float, facts: Facts) -> list[Action]:
        self._index = index
        self._mark_progress(now, facts)
        if index == _FIN_IS_SET + 1:
            self._spoken_to = facts.publishers
        action = PHASES[index].action
        chosen = action if isinstance(action, Action) or action is None else action(facts)
        if chosen is None:
            return []
        if chosen is Action.RESET and facts.plant is not None:
            self._reset_after = facts.plant.stamp
        self._note_switches(chosen)
        return [chosen]

    def _note_switches(self, action: Action) -> None:
        if action in {Action.GAIT_ON, Action.GAIT_OFF}:
            self._gait_is_on = action is Action.GAIT_ON
        if action in {Action.OPEN_BAG, Action.CLOSE_BAG}:
            self._bag_is_open = action is Action.OPEN_BAG

    def _end(self, result: Result) -> list[Action]:
        self.result = result
        actions = [Action.GAIT_OFF] if self._gait_is_on else []
        actions += [Action.CLOSE_BAG] if self._bag_is_open else []
        for action in actions:
            self._note_switches(action)
        return actions

    def _failure(self, facts: Facts) -> Result | None:
        """Return how the trial ends because of something that may happen in any phase."""
        phase = PHASES[self._index]
        if phase.action is Action.SET_FIN and facts.fin_reply is not None and not facts.fin_reply.accepted:
            return Result(Outcome.INFEASIBLE, facts.fin_reply.reason or "the plant refused the fin without a reason")
        trouble = self._trouble(phase, facts)
        return self._failed(trouble, facts) if trouble else None

    def _failed(self, trouble: str, facts: Facts) -> Result:
        """Return how the trial ends: FAILED as an attempt at its fin, else INTERRUPTED."""
        no_attempt = (
            self._index < _GAIT_IS_ON
            or len(facts.plants) > 1
            or (facts.plant is not None and facts.plant.waits_for_people)
            or bool(facts.recorder_failure or facts.other_fish or self._other_gait or self._changed(facts))
        )
        return Result(Outcome.INTERRUPTED if no_attempt else Outcome.FAILED, f"{self.phase}: {trouble}")

    def _trouble(self, phase: Phase, facts: Facts) -> str:
        if facts.recorder_failure:
            return facts.recorder_failure
        if self._index > 0 and len(facts.plants) > 1:
            return _no_plant(self, facts)
        cut = facts.cut_gait if self._index == _AT_REST else ""
        if other := facts.other_fish or cut or (not self._gait_is_on and self._other_gait):
            return other
        if self._index > _AT_REST and _is(facts, State.FAULT):
            return _says(self, facts)
        if phase.action is Action.RESET and facts.reset_reply is not None and not facts.reset_reply.accepted:
            return f"the plant refused: {facts.reset_reply.reason}"
        return self._changed(facts)

    def _changed(self, facts: Facts) -> str:
        """Return what makes this swim another one than the trial's, or an empty text."""
        if self._index > _AT_START and (differs := _differences(self, facts)):
            return f"the fin mounted has {differs}: was the plant started anew, or its fin changed by somebody else?"
        if self.window is not None and _is(facts, State.SWIMMING) and not self._is_this_swim(facts):
            return (
                f"topic {self.topic('plant_state')} says SWIMMING anew, {self.swum:.2f} s into the swim: the "
                "plant got other parameters, or stopped and began again; leave it alone while it swims"
            )
        return ""

    def _is_this_swim(self, facts: Facts) -> bool:
        """Whether the plant speaks of the swim of which the window is a part: a score needs one start."""
        return facts.plant is not None and facts.plant.stamp == self._swimming_since

    def _lost(self, now: float, facts: Facts) -> Result | None:
        """Return how the trial ends because the plant that got the fin is there no more, whoever is waited for."""
        if self._index <= _FIN_IS_SET:
            return None
        here = facts.publishers
        self._spoken_to = self._spoken_to or here
        if here - self._spoken_to:  # one that was killed is seen for some seconds more, beside its successor
            topic = self.topic("plant_state")
            reason = f"who publishes topic {topic} now was started after the fin had been set, and does not know it"
            return Result(Outcome.INTERRUPTED, f"{self.phase}: {reason}")
        if here:
            self._gone_since = None
            return None
        self._gone_since = now if self._gone_since is None else self._gone_since
        limit = self._timeouts.find  # discovery may lose sight of a plant for a moment
        if now - self._gone_since <= limit:
            return None
        reason = f"nobody publishes topic {self.topic('plant_state')} any more (waited {limit:g} s)"
        return Result(Outcome.INTERRUPTED, f"{self.phase}: {reason}")

    def _overdue(self, now: float, facts: Facts) -> Result | None:
        phase = PHASES[self._index]
        limit = self._limit(phase, facts)
        if not limit or now - self._progress_at <= limit:
            return None
        return self._failed(f"{phase.missing(self, facts)} (waited {limit:g} s)", facts)

    def _stopped_swimming(self, facts: Facts) -> Result | None:
        if (
            PHASES[self._index].name not in _SWIMMING_PHASES
            or facts.plant is None
            or facts.plant.state is State.SWIMMING
        ):
            return None
        why = _because(facts.plant) or f", without a reason: did the gait on {self.topic('gait')} reach it?"
        reason = (
            f"{self.phase}: the plant went to {facts.plant.state} {self.swum:.2f} s into a swim of "
            f"{self.measurement.settle + self.measurement.duration:g} s{why}"
        )
        return Result(Outcome.INTERRUPTED, reason)  # gaits came too late, or a person had a part in it; never the fin

    @property
    def swum(self) -> float:
        """How far into the swim the velocities reach, in s of the plant's time."""
        return self._reached

    def was_reset(self, plant: PlantState) -> bool:
        """Whether the state was said after the trial's reset."""
        return plant.stamp > self._reset_after

    def _note_progress(self, now: float, facts: Facts) -> None:
        """Note what carries the phase on: in a swim, which may be slow or fast, only time that the fish has swum.

        Messages are none: stamps that creep, stand, run back or lie before the swim keep a tail beating for ever.
        """
        if self.window is not None and facts.newest_velocity is not None:
            newest = min(facts.newest_velocity, self.window.end_ns)
            self._reached = max(self._reached, (newest - self._swimming_since) / NANOSECONDS)
        waits = facts.plant is not None and facts.plant.waits_for_people
        people_are_done = self._waited_for_people and not waits
        self._waited_for_people = waits
        due = facts.least_pace * self._timeouts.silence
        if people_are_done or (
            PHASES[self._index].name in _SWIMMING_PHASES and self._reached - self._reached_before >= due
        ):
            self._mark_progress(now, facts)

    def _mark_progress(self, now: float, facts: Facts) -> None:
        self._progress_at, self._reached_before, self._velocities_before = now, self._reached, facts.velocities

    def no_progress(self, facts: Facts) -> str:
        """Return what is wrong with the velocities of a swim that does not go on."""
        topic, came = self.topic("velocity"), facts.velocities - self._velocities_before
        if not came or facts.newest_velocity is None:
            return f"no message on topic {topic} after {self._reached:.2f} s of the swim"
        behind = (self._swimming_since - facts.newest_velocity) / NANOSECONDS
        if behind > 0.0:
            return (
                f"{came} messages came on topic {topic}, the last one stamped {_seconds(behind)} before the start of "
                "the swim: its clock is not the plant's"
            )
        advanced = max(0.0, self._reached - self._reached_before)
        return (
            f"{came} messages came on topic {topic}, but their stamps advanced by only {_seconds(advanced)}: needed "
            f"are {_seconds(facts.least_pace * self._timeouts.silence)}"
        )

    def _limit(self, phase: Phase, facts: Facts) -> float:
        """Return the seconds that the phase may last without progress, 0 for no limit."""
        if phase.patience == "plant" and facts.plant is not None and facts.plant.waits_for_people:
            return self._timeouts.people
        limit = float(getattr(self._timeouts, phase.patience))
        # A robot's tail is led to neutral as slowly as its joints are.
        return limit + LONGEST_RAMP if phase.action is Action.GAIT_OFF and _is(facts, State.SWIMMING) else limit


def _because(plant: PlantState) -> str:
    return f" ({plant.reason})" if plant.reason else ""


def _says(trial: Trial, facts: Facts) -> str:
    if facts.plant is None:
        return f"nothing was said on topic {trial.topic('plant_state')}"
    return f"topic {trial.topic('plant_state')} says {facts.plant.state}{_because(facts.plant)}"


def _is(facts: Facts, *states: State) -> bool:
    return facts.plant is not None and facts.plant.state in states


def _no_plant(trial: Trial, facts: Facts) -> str:
    topic = trial.topic("plant_state")
    if not facts.plants:
        return facts.nothing_on(topic)
    if len(facts.plants) > 1:
        return f"topic {topic} has {len(facts.plants)} publishers ({', '.join(facts.plants)}): leave only one plant"
    missing = [f"service {' and '.join(facts.missing_services)} missing"] if facts.missing_services else []
    if facts.plant is None:
        missing.append(facts.nothing_on(topic))
    return "; ".join(missing) or _says(trial, facts)


def _same(text: str, value: Value) -> bool:
    """Whether a key-value of the plant's state, which has all digits of a number, says ``value``."""
    if isinstance(value, str):
        return text == value
    try:
        said = json.loads(text)
    except ValueError:
        return False
    return bool(said == (list(value) if isinstance(value, list | tuple) else value))


def _wrong(trial: Trial, facts: Facts) -> list[str]:
    """Return the names of the fin's parameters in which the fin mounted differs from the trial's."""
    mounted = facts.plant.fin if facts.plant is not None else {}
    return [name for name, value in trial.fin.items() if not _same(mounted.get(name, ""), value)]


def _differences(trial: Trial, facts: Facts) -> str:
    mounted = facts.plant.fin if facts.plant is not None else {}
    wrong = _wrong(trial, facts)
    return ", ".join(f"{name} = {mounted.get(name, 'nothing')} instead of {trial.fin[name]}" for name in wrong)


def _fin_not_ready(trial: Trial, facts: Facts) -> str:
    differs = _differences(trial, facts)
    return f"{_says(trial, facts)}, needed is READY" + (f"; the fin mounted has {differs}" if differs else "")


def _at_start(trial: Trial, facts: Facts) -> bool:
    """Whether the plant is ready and said so after the reset, not in a message still on its way."""
    return (
        _is(facts, State.READY)
        and facts.plant is not None
        and trial.was_reset(facts.plant)
        and not _wrong(trial, facts)
        and _is_straight(facts)
        and facts.other_fish is not None
    )


def _is_straight(facts: Facts) -> bool:
    return facts.tail_angle is None or facts.tail_angle <= STRAIGHT


def _not_at_start(trial: Trial, facts: Facts) -> str:
    if facts.other_fish is None:
        return _service(facts, "get_parameters")
    if _is_straight(facts):
        return _fin_not_ready(trial, facts)
    angle = math.degrees(facts.tail_angle or 0.0)
    return (
        f"the tail stands at {angle:.1f} degrees, and a swim begins with a straight one, within "
        f"{math.degrees(STRAIGHT):.0f} degrees: straighten it by hand"
    )


def _service(facts: Facts, name: str) -> str:
    plant = facts.plants[0] if len(facts.plants) == 1 else "the plant"
    return f"no answer from service {plant}/{name}"


def _velocity_after(trial: Trial, facts: Facts, end: int) -> bool:
    return trial.window is not None and facts.newest_velocity is not None and facts.newest_velocity >= end


def _seconds(time: float) -> str:
    return f"{time:.3g} s" if time < _LONG else f"{time:.0f} s"


def _at_rest(trial: Trial, facts: Facts) -> bool:
    return _is(facts, State.READY) and facts.drift is not None and not trial.measurement.no_rest(facts.drift)


def _no_rest(trial: Trial, facts: Facts) -> str:
    if not _is(facts, State.READY):
        return f"{_says(trial, facts)}, needed is READY"
    if facts.drift is None:
        return f"too few messages on topic {trial.topic('velocity')} tell whether the fish is at rest"
    return f"{trial.measurement.no_rest(facts.drift)}: wait until the water is still, then bring it to its mark again"


def _still_swimming(trial: Trial, facts: Facts) -> str:
    if facts.late_topics and _is(facts, State.READY, *_WAITING):
        return f"no message up to the end of the window on topic {', '.join(facts.late_topics)}"
    return f"the gait is off, but {_says(trial, facts)}"


def _nothing_to_record(_: Trial, facts: Facts) -> str:
    seen = "; ".join(facts.nothing_on(topic) for topic in facts.unmatched_topics)
    return f"nothing to record on topic {', '.join(facts.unmatched_topics)}: {seen}"


def _no_effect(trial: Trial, facts: Facts) -> str:
    if _is(facts, State.SWIMMING):
        return f"it is not told which gait the plant swims: {facts.nothing_on(trial.topic('gait_applied'))}"
    deaf = f"; {facts.deaf_to_gait}" if facts.deaf_to_gait else ""
    return f"the gait on topic {trial.topic('gait')} had no effect: {_says(trial, facts)}{deaf}"


PHASES: tuple[Phase, ...] = (
    Phase(
        "find the plant",
        action=None,
        done=lambda _, facts: len(facts.plants) == 1 and not facts.missing_services and facts.plant is not None,
        patience="find",
        missing=_no_plant,
    ),
    Phase(
        "wait until it is at rest",
        action=lambda facts: Action.RECOVER if _is(facts, State.FAULT) else None,
        done=lambda _, facts: _is(facts, State.READY, *_WAITING),
        patience="plant",
        missing=lambda trial, facts: f"{_says(trial, facts)}, needed is READY",
    ),
    Phase(
        "set the fin",
        action=Action.SET_FIN,
        done=lambda _, facts: facts.fin_reply is not None,
        patience="reply",
        missing=lambda _, facts: _service(facts, "set_parameters_atomically"),
    ),
    Phase(
        "wait for the fin",
        action=None,
        done=lambda trial, facts: _is(facts, State.READY, State.WAITING_FOR_RESET) and not _wrong(trial, facts),
        patience="plant",
        missing=_fin_not_ready,
    ),
    Phase(
        "reset",
        action=Action.RESET,
        done=lambda _, facts: facts.reset_reply is not None,
        patience="reply",
        missing=lambda _, facts: _service(facts, "request_reset"),
    ),
    Phase(
        "wait at the start",
        action=None,
        done=_at_start,
        patience="plant",
        missing=_not_at_start,
    ),
    Phase(
        "open the bag",
        action=Action.OPEN_BAG,
        done=lambda _, facts: not facts.unmatched_topics,
        patience="plant",
        missing=_nothing_to_record,
    ),
    Phase(
        "wait until the water is still",
        action=None,
        done=_at_rest,
        patience="rest",
        missing=_no_rest,
    ),
    Phase(
        "start the gait",
        action=Action.GAIT_ON,
        done=lambda _, facts: _is(facts, State.SWIMMING) and facts.follows_a_gait,
        patience="silence",
        missing=_no_effect,
    ),
    Phase(
        "settle",
        action=None,
        done=lambda trial, facts: _velocity_after(trial, facts, trial.window.start_ns if trial.window else 0),
        patience="silence",
        missing=Trial.no_progress,
    ),
    Phase(
        "measure",
        action=None,
        done=lambda trial, facts: _velocity_after(trial, facts, trial.window.end_ns if trial.window else 0),
        patience="silence",
        missing=Trial.no_progress,
    ),
    Phase(
        "stop the gait",
        action=Action.GAIT_OFF,
        done=lambda _, facts: _is(facts, State.READY, *_WAITING) and not facts.late_topics,
        patience="silence",
        missing=_still_swimming,
    ),
    Phase(
        "close the bag",
        action=Action.CLOSE_BAG,
        done=lambda *_: True,
        patience="reply",
        missing=lambda *_: "the bag was not closed",
    ),
    Phase(
        "score",
        action=Action.SCORE,
        done=lambda _, facts: facts.result is not None,
        patience="reply",
        missing=lambda *_: "no score",
    ),
)
_AT_REST = 1
"""A fault counts after this phase: before, it is an earlier trial's, and the trial's first care is to clear it."""
_FIN_IS_SET = 2
"""The plant that took the fin in this phase is the trial's from then on."""
_GAIT_IS_ON = 8
"""Before this phase nothing has happened that could tell anything of the fin."""
_AT_START = 5
"""From the end of this phase on the fin stays mounted until the trial is over."""
_SWIMMING_PHASES = ("settle", "measure")
PHASES_OF_VELOCITY = ("open the bag", "wait until the water is still", *_SWIMMING_PHASES, "stop the gait", "score")
"""In these a trial may fail for want of velocity."""
