"""One trial, from a proposed fin to a scored swim, as a state machine that knows neither ROS nor a clock.

It goes through the table of `fin_optimizer.trial.phases`, one phase at most at each look at the facts. A phase that
takes too long, a fault of the plant or of the recorder, a refused fin or a cancelled trial end it at once, with a
reason that names what was missing; then the gait is switched off and the bag is closed, whatever the phase was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.trial.phases import PHASES, Action, Course, Rule, because, fin_differences, is_in, no_plant, says
from fin_optimizer.trial.result import Outcome, Result
from fin_plant.gait_follower import LONGEST_RAMP
from fin_plant.plant_state import State
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_optimizer.score.mean_speed import Measurement, Window
    from fin_optimizer.trial.facts import Facts
    from fin_optimizer.trial.phases import Phase, Timeouts
    from fin_plant.parameters import Value


class Trial:
    """A trial under way.

    Attributes:
        course: What it remembers, for the guards of its table.
        result: How it ended, None before.
    """

    def __init__(self, namespace: str, fin: Mapping[str, Value], measurement: Measurement, timeouts: Timeouts) -> None:
        """Begin before the first phase.

        Args:
            namespace: Of the fish, for example ``/fish``; only for messages.
            fin: The fin to try, by the plant's parameters, in SI units.
            measurement: Which part of the swim is scored.
            timeouts: How long to wait for what.
        """
        self.course = Course(namespace, fin, measurement, timeouts)
        self.result: Result | None = None
        self._index = -1
        self._progress_at = 0.0
        self._waited_for_people = False
        self._gait_is_on = False
        self._other_gait = ""
        self._bag_is_open = False
        self._spoken_to: frozenset[str] = frozenset()
        self._gone_since: float | None = None

    @property
    def phase(self) -> str:
        """Name of the phase under way."""
        return "begin" if self._index < 0 else PHASES[self._index].name

    @property
    def window(self) -> Window | None:
        """Window over which the swim is scored, None until the fish swims."""
        return self.course.window

    @property
    def looks_up(self) -> frozenset[str]:
        """Facts of `LOOKED_UP` that the phase under way asks for."""
        return frozenset() if self._index < 0 else PHASES[self._index].looks_up

    def has(self, rule: Rule) -> bool:
        """Whether a rule holds in the phase under way."""
        return self._index >= 0 and rule in PHASES[self._index].rules

    def update(self, now: float, facts: Facts) -> list[Action]:
        """Go on as far as the facts allow, one phase at most, and return what must be done now, in order.

        Call it again after the actions, whenever a fact has changed, and every now and then for the timeouts.

        Args:
            now: Time of a monotonic clock in s.
            facts: What is seen now.
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
        if phase.done(self.course, facts):
            return self._next(now, facts)
        if failure := self._stopped_swimming(facts) or self._overdue(now, facts):
            return self._end(failure)
        return []

    def cancel(self, reason: str) -> list[Action]:
        """End the trial because somebody stopped it, and return what must be done now, in order."""
        if self.result is not None:
            return []
        return self._end(Result(Outcome.INTERRUPTED, f"in phase '{self.phase}': {reason}"))

    def _next(self, now: float, facts: Facts) -> list[Action]:
        if PHASES[self._index].action is Action.GAIT_ON and facts.plant is not None:
            self.course.swimming_since = facts.plant.stamp
            self.course.window = self.course.measurement.window(facts.plant.stamp)
        if self._index + 1 < len(PHASES):
            return self._enter(self._index + 1, now, facts)
        self.result = facts.result
        return []

    def _enter(self, index: int, now: float, facts: Facts) -> list[Action]:
        self._index = index
        self._mark_progress(now, facts)
        if self.has(Rule.SAME_PLANT):
            self._spoken_to = self._spoken_to or facts.publishers
        action = PHASES[index].action
        chosen = action if isinstance(action, Action) or action is None else action(facts)
        if chosen is None:
            return []
        if chosen is Action.RESET and facts.plant is not None:
            self.course.reset_after = facts.plant.stamp
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
        return [*actions, Action.CLOSE_BAG] if self._bag_is_open else actions

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
            not self.has(Rule.ATTEMPT)
            or len(facts.plants) > 1
            or (facts.plant is not None and facts.plant.waits_for_people)
            or bool(facts.recorder_failure or facts.other_fish or self._other_gait or self._changed(facts))
        )
        return Result(Outcome.INTERRUPTED if no_attempt else Outcome.FAILED, f"{self.phase}: {trouble}")

    def _trouble(self, phase: Phase, facts: Facts) -> str:
        if facts.recorder_failure:
            return facts.recorder_failure
        if self.has(Rule.ONE_PLANT) and len(facts.plants) > 1:
            return no_plant(self.course, facts)
        if other := facts.other_fish or facts.cut_gait or (not self._gait_is_on and self._other_gait):
            return other
        if self.has(Rule.NO_FAULT) and is_in(facts, State.FAULT):
            return says(self.course, facts)
        if phase.action is Action.RESET and facts.reset_reply is not None and not facts.reset_reply.accepted:
            return f"the plant refused: {facts.reset_reply.reason}"
        return self._changed(facts)

    def _changed(self, facts: Facts) -> str:
        """Return what makes this swim another one than the trial's, or an empty text."""
        if self.has(Rule.SAME_FIN) and (differs := fin_differences(self.course, facts)):
            return f"the fin mounted has {differs}: was the plant started anew, or its fin changed by somebody else?"
        if self.window is not None and is_in(facts, State.SWIMMING) and not self._is_this_swim(facts):
            return (
                f"topic {self.course.topic('plant_state')} says SWIMMING anew, {self.course.swum:.2f} s into the swim: "
                "the plant got other parameters, or stopped and began again; leave it alone while it swims"
            )
        return ""

    def _is_this_swim(self, facts: Facts) -> bool:
        """Whether the plant speaks of the swim of which the window is a part: a score needs one start."""
        return facts.plant is not None and facts.plant.stamp == self.course.swimming_since

    def _lost(self, now: float, facts: Facts) -> Result | None:
        """Return how the trial ends because the plant that got the fin is there no more, whoever is waited for."""
        if not self.has(Rule.SAME_PLANT):
            return None
        here = facts.publishers
        self._spoken_to = self._spoken_to or here
        if here - self._spoken_to:  # one that was killed is seen for some seconds more, beside its successor
            topic = self.course.topic("plant_state")
            reason = f"who publishes topic {topic} now was started after the fin had been set, and does not know it"
            return Result(Outcome.INTERRUPTED, f"{self.phase}: {reason}")
        if here:
            self._gone_since = None
            return None
        self._gone_since = now if self._gone_since is None else self._gone_since
        limit = self.course.timeouts.find  # discovery may lose sight of a plant for a moment
        if now - self._gone_since <= limit:
            return None
        reason = f"nobody publishes topic {self.course.topic('plant_state')} any more (waited {limit:g} s)"
        return Result(Outcome.INTERRUPTED, f"{self.phase}: {reason}")

    def _overdue(self, now: float, facts: Facts) -> Result | None:
        phase = PHASES[self._index]
        limit = self._limit(phase, facts)
        if not limit or now - self._progress_at <= limit:
            return None
        return self._failed(f"{phase.missing(self.course, facts)} (waited {limit:g} s)", facts)

    def _stopped_swimming(self, facts: Facts) -> Result | None:
        if not self.has(Rule.SWIMS) or facts.plant is None or facts.plant.state is State.SWIMMING:
            return None
        measurement = self.course.measurement
        why = because(facts.plant) or f", without a reason: did the gait on {self.course.topic('gait')} reach it?"
        reason = (
            f"{self.phase}: the plant went to {facts.plant.state} {self.course.swum:.2f} s into a swim of "
            f"{measurement.settle + measurement.duration:g} s{why}"
        )
        return Result(Outcome.INTERRUPTED, reason)  # gaits came too late, or a person had a part in it; never the fin

    def _note_progress(self, now: float, facts: Facts) -> None:
        """Note what carries the phase on: in a swim, which may be slow or fast, only time that the fish has swum.

        Messages are none: stamps that creep, stand, run back or lie before the swim keep a tail beating for ever.
        """
        course = self.course
        if course.window is not None and facts.newest_velocity is not None:
            newest = min(facts.newest_velocity, course.window.end_ns)
            course.swum = max(course.swum, (newest - course.swimming_since) / NANOSECONDS)
        waits = facts.plant is not None and facts.plant.waits_for_people
        people_are_done = self._waited_for_people and not waits
        self._waited_for_people = waits
        due = facts.least_pace * course.timeouts.silence
        if people_are_done or (self.has(Rule.SWIMS) and course.swum - course.swum_before >= due):
            self._mark_progress(now, facts)

    def _mark_progress(self, now: float, facts: Facts) -> None:
        self._progress_at = now
        self.course.swum_before, self.course.velocities_before = self.course.swum, facts.velocities

    def _limit(self, phase: Phase, facts: Facts) -> float:
        """Return the seconds that the phase may last without progress, 0 for no limit."""
        if phase.patience == "plant" and facts.plant is not None and facts.plant.waits_for_people:
            return self.course.timeouts.people
        limit = float(getattr(self.course.timeouts, phase.patience))
        # A robot's tail is led to neutral as slowly as its joints are.
        return limit + LONGEST_RAMP if phase.action is Action.GAIT_OFF and is_in(facts, State.SWIMMING) else limit
