"""A trial goes through its phases in order, says what was missing when time runs out, and always cleans up."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.trial.facts import LOOKED_UP, Facts, Reply
from fin_optimizer.trial.phases import PHASES, STRAIGHT, Action, Rule, Timeouts, same_value
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.trial import Trial
from fin_plant.plant_state import PlantState, State

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence

    from fin_plant.parameters import Value

SECOND = 1_000_000_000
FIN: dict[str, Value] = {"fin.young_modulus": 1.5e9, "fin.segments": 3, "fin.hinges": "between"}
SHOWN = {name: value if isinstance(value, str) else repr(value) for name, value in FIN.items()}
OTHER_FIN = {**SHOWN, "fin.young_modulus": "1200000000.0"}
TIMEOUTS = Timeouts(find=30.0, plant=10.0, reply=20.0, silence=5.0, people=0.0)
OK = Result(Outcome.OK, measured={"mean_speed": 0.02}, samples=1000)


class Seen:
    """The facts, as the test sets them; a snapshot of them holds what a phase looks up, and no more."""

    def __init__(self) -> None:
        self.__dict__.update({each.name: each.default for each in fields(Facts)})
        self.publishers = frozenset({"first"})
        self.other_fish: str | None = ""
        self.tail_angle: float | None = 0.0
        self.unmatched_topics: Sequence[str] = ("/fish/velocity",)
        self.drift: float | None = 0.0
        self.nothing_on = "nobody publishes topic {}; no other node is seen".format
        self.deaf_to_gait = lambda: "nobody listens to topic /fish/gait"

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in Facts.__dataclass_fields__, name
        super().__setattr__(name, value)

    def facts(self, looks_up: Container[str]) -> Facts:
        """Return what the swimmer would hand to the trial."""
        return Facts(**{name: value for name, value in vars(self).items() if name not in LOOKED_UP or name in looks_up})


def says(state: State, stamp: int, fin: dict[str, str]) -> PlantState:
    return PlantState(state, "simulator", stamp * SECOND, fin=fin)


# What a plant does that works, in each phase: the state that it says, and the facts that change.
PLANT_DOES: dict[str, tuple[PlantState | None, dict[str, object]]] = {
    "find the plant": (says(State.SWIMMING, 1, OTHER_FIN), {"plants": ("/fish/simulator",)}),
    "wait until it is at rest": (says(State.READY, 2, OTHER_FIN), {}),
    "set the fin": (None, {"fin_reply": Reply(accepted=True)}),
    "wait for the fin": (says(State.READY, 3, SHOWN), {}),
    "reset": (None, {"reset_reply": Reply(accepted=True)}),
    "wait at the start": (says(State.READY, 4, SHOWN), {}),
    "open the bag": (None, {"unmatched_topics": (), "drift": None}),
    "wait until the water is still": (None, {"drift": 0.001}),
    "start the gait": (says(State.SWIMMING, 10, SHOWN), {"follows_a_gait": True}),
    "settle": (None, {"newest_velocity": 12 * SECOND}),
    "measure": (None, {"newest_velocity": 22 * SECOND}),
    "stop the gait": (says(State.READY, 23, SHOWN), {}),
}


@dataclass
class Rehearsal:
    """A trial with a plant that does what it should up to a phase."""

    timeouts: Timeouts = TIMEOUTS
    seen: Seen = field(default_factory=Seen)
    actions: list[Action] = field(default_factory=list)
    now: float = 100.0
    looks: int = 0

    def __post_init__(self) -> None:
        self.trial = Trial("/fish", FIN, Measurement(settle=2.0, duration=10.0), self.timeouts)

    def say(self, state: State, stamp: int, reason: str = "", fin: dict[str, str] | None = None) -> None:
        """Let the plant say this state."""
        self.seen.plant = PlantState(state, "simulator", stamp, reason, OTHER_FIN if fin is None else fin)

    def update(self, seconds: float = 0.0, until: str = "") -> None:
        """Let time pass and look, as often as the facts carry the trial on, to the beginning of a phase at most."""
        self.now += seconds
        phase = ""
        while self.trial.phase not in (phase, until) and self.trial.result is None:
            phase = self.trial.phase
            self.looks += 1
            assert self.looks < 10_000, "the phases go round in a circle"
            self.actions += self.trial.update(self.now, self.seen.facts(self.trial.looks_up))

    def reach(self, phase: str) -> None:
        """Let the plant do what ends each phase, up to the beginning of this one."""
        self.update()
        while self.trial.phase != phase:
            before = self.trial.phase
            self._fulfil(before)
            self.update(0.01, until=phase)
            assert self.trial.phase != before, f"'{before}' does not end"

    def _fulfil(self, phase: str) -> None:
        state, facts = PLANT_DOES.get(phase, (None, {}))
        for name, value in facts.items():
            setattr(self.seen, name, value)
        if state is not None:
            self.seen.plant = state

    def wait_for_people(self, phase: str, state: State) -> None:
        """Let a plant wait for somebody in this phase."""
        self.reach(phase)
        self.say(state, 50 * SECOND, "mount the fin")

    @property
    def phase(self) -> str:
        """The phase under way, or how the trial ended."""
        return self.trial.phase if self.trial.result is None else self.trial.result.outcome.name

    @property
    def failure(self) -> str:
        """Why the trial FAILED or was INTERRUPTED."""
        return self._failed.reason

    @property
    def is_attempt(self) -> bool:
        """Whether the trial counts as an attempt at its fin."""
        return self._failed.outcome is not Outcome.INTERRUPTED

    @property
    def _failed(self) -> Result:
        assert self.trial.result is not None, f"still in '{self.trial.phase}'"
        assert self.trial.result.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}
        return self.trial.result


def test_a_trial_that_goes_well_does_everything_once_and_in_order() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("score")
    assert rehearsal.trial.result is None
    rehearsal.seen.result = OK
    rehearsal.update()
    assert rehearsal.trial.result == OK
    expected = "SET_FIN RESET OPEN_BAG GAIT_ON GAIT_OFF CLOSE_BAG SCORE"
    assert " ".join(action.name for action in rehearsal.actions) == expected


def test_the_window_starts_after_the_settling_time_from_the_plants_own_start() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("settle")
    window = rehearsal.trial.window
    assert window is not None
    assert (window.start_ns, window.end_ns) == (12 * SECOND, 22 * SECOND)


def test_one_velocity_short_of_the_windows_end_is_not_enough() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("measure")
    rehearsal.seen.newest_velocity = 22 * SECOND - 1
    rehearsal.update()
    assert rehearsal.phase == "measure"


def test_one_velocity_short_of_the_windows_start_leaves_the_swim_settling() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("settle")
    rehearsal.seen.newest_velocity = 12 * SECOND - 1
    rehearsal.update()
    assert rehearsal.phase == "settle"


# Phase, how long it is waited, and what the reason must name.
SILENT_PLANT = [
    ("find the plant", 30.0, "nobody publishes topic /fish/plant_state"),
    ("wait until it is at rest", 10.0, "topic /fish/plant_state says SWIMMING"),
    ("set the fin", 20.0, "no answer from service /fish/simulator/set_parameters_atomically"),
    ("wait for the fin", 10.0, "the fin mounted has fin.young_modulus = 1200000000.0 instead of 1500000000.0"),
    ("reset", 20.0, "no answer from service /fish/simulator/request_reset"),
    ("wait at the start", 10.0, "topic /fish/plant_state says READY"),
    ("open the bag", 10.0, "nothing to record on topic /fish/velocity: nobody publishes topic /fish/velocity; no "),
    ("wait until the water is still", 60.0, "too few messages on topic /fish/velocity tell whether"),
    ("start the gait", 5.0, "the gait on topic /fish/gait had no effect: topic /fish/plant_state says READY; nobody"),
    ("settle", 5.0, "no message on topic /fish/velocity"),
    ("measure", 5.0, "no message on topic /fish/velocity after 2.00 s of the swim"),
    ("stop the gait", 15.0, "the gait is off, but topic /fish/plant_state says SWIMMING"),
]


@pytest.mark.parametrize(("phase", "patience", "reason"), SILENT_PLANT)
def test_a_plant_that_falls_silent_fails_the_trial_and_the_reason_names_what_was_missing(
    phase: str, patience: float, reason: str
) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.update(patience - 0.01)
    assert rehearsal.trial.result is None, "too early"
    rehearsal.update(0.1)
    assert rehearsal.failure.startswith(f"{phase}: ")
    assert reason in rehearsal.failure
    assert f"waited {patience:g} s" in rehearsal.failure


def test_a_plant_that_says_nothing_is_told_from_one_that_lacks_services() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("find the plant")
    rehearsal.seen.plants = ("/fish/mine",)
    rehearsal.seen.missing_services = ("/fish/mine/request_reset",)
    rehearsal.update(30.1)
    assert "service /fish/mine/request_reset missing; nobody publishes topic /fish/plant_state" in rehearsal.failure


def test_a_plant_that_says_nothing_and_lacks_nothing_has_no_more_said_of_it() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.plants = ("/fish/mine",)
    rehearsal.update()
    rehearsal.update(30.1)
    assert "find the plant: nobody publishes topic /fish/plant_state" in rehearsal.failure


def test_no_plant_at_all_lacks_no_services() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.missing_services = ("/fish/mine/request_reset",)
    rehearsal.update()
    rehearsal.update(30.1)
    assert "missing" not in rehearsal.failure


@pytest.mark.parametrize(
    ("phase", "reason"),
    [
        ("wait until it is at rest", "nothing was said on topic /fish/plant_state, needed is READY"),
        ("set the fin", "no answer from service the plant/set_parameters_atomically"),
        ("reset", "no answer from service the plant/request_reset"),
        ("wait at the start", "nothing was said on topic /fish/plant_state, needed is READY; the fin mounted has"),
    ],
)
def test_a_plant_that_is_lost_from_sight_is_none_of_which_anything_is_known(phase: str, reason: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.plants, rehearsal.seen.plant = (), None
    rehearsal.update(60.1)
    assert rehearsal.failure.startswith(f"{phase}: {reason}")


def test_a_plant_that_is_ready_but_has_not_been_reset_is_told_without_more() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait at the start")
    rehearsal.update(10.1)
    assert rehearsal.failure == ("wait at the start: topic /fish/plant_state says READY, needed is READY (waited 10 s)")


def test_every_difference_of_the_fin_mounted_is_named() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait for the fin")
    rehearsal.say(State.READY, 3 * SECOND, fin={**OTHER_FIN, "fin.segments": "2"})
    rehearsal.update(10.1)
    differs = "fin.young_modulus = 1200000000.0 instead of 1500000000.0, fin.segments = 2 instead of 3"
    assert rehearsal.failure.endswith(f"says READY, needed is READY; the fin mounted has {differs} (waited 10 s)")


def test_every_topic_without_a_stream_is_named() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("open the bag")
    rehearsal.seen.unmatched_topics = ("/fish/velocity", "/fish/pose")
    rehearsal.update(10.1)
    nobody = [f"nobody publishes topic {topic}; no other node is seen" for topic in rehearsal.seen.unmatched_topics]
    assert f"nothing to record on topic /fish/velocity, /fish/pose: {'; '.join(nobody)} (" in rehearsal.failure


def test_a_plant_that_must_be_reset_again_is_told_before_the_water() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait until the water is still")
    rehearsal.say(State.WAITING_FOR_RESET, 5 * SECOND, fin=SHOWN)
    rehearsal.seen.drift = 0.0
    rehearsal.update(60.1)
    assert rehearsal.failure.startswith(
        "wait until the water is still: topic /fish/plant_state says WAITING_FOR_RESET, needed is READY (waited"
    )


@pytest.mark.parametrize(
    ("newest", "reason"),
    [
        (9.5, "the last one stamped 0.5 s before the start"),
        (-989.9, "the last one stamped 1e+03 s before the start"),
        (-990.0, "the last one stamped 1000 s before the start"),
        (12.25, "their stamps advanced by only 0.25 s: needed are 0.5 s"),
        (None, "no message on topic /fish/velocity after 2.00 s of the swim"),
    ],
)
def test_velocities_that_stand_still_are_told_with_their_times(newest: float | None, reason: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.least_pace = 0.1
    rehearsal.reach("measure")
    rehearsal.seen.velocities = 500
    rehearsal.seen.newest_velocity = None if newest is None else round(newest * SECOND)
    rehearsal.update(5.1)
    assert reason in rehearsal.failure


def test_velocities_are_counted_from_the_last_progress_on() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("settle")
    rehearsal.seen.velocities = 200
    rehearsal.reach("measure")
    rehearsal.seen.velocities = 205
    rehearsal.update(5.1)
    assert rehearsal.failure.startswith("measure: 5 messages came on topic /fish/velocity")


def test_a_gait_that_is_heard_and_has_no_effect_is_told_without_more() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("start the gait")
    rehearsal.seen.deaf_to_gait = str
    rehearsal.update(5.1)
    reason = "the gait on topic /fish/gait had no effect: topic /fish/plant_state says READY (waited 5 s)"
    assert rehearsal.failure == f"start the gait: {reason}"


def test_a_plant_that_swims_on_is_told_before_what_has_not_come() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("stop the gait")
    rehearsal.seen.late_topics = ("/fish/pose", "/fish/velocity")
    rehearsal.update(15.1)
    assert "the gait is off, but topic /fish/plant_state says SWIMMING" in rehearsal.failure
    rehearsal = Rehearsal()
    rehearsal.reach("stop the gait")
    rehearsal.seen.late_topics = ("/fish/pose", "/fish/velocity")
    rehearsal.say(State.WAITING_FOR_RESET, 23 * SECOND, fin=SHOWN)
    rehearsal.update(5.1)
    assert "no message up to the end of the window on topic /fish/pose, /fish/velocity (" in rehearsal.failure


def test_a_plant_that_stops_without_a_reason_is_told_from_one_that_gives_one() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("measure")
    rehearsal.say(State.READY, 20 * SECOND, fin=SHOWN)
    rehearsal.update()
    assert "without a reason: did the gait on /fish/gait reach it?" in rehearsal.failure


NOT_TO_THE_END = {
    Rule.VELOCITY: ["open the bag", "wait until the water is still", "settle", "measure", "stop the gait", "score"],
    Rule.SWIMS: ["settle", "measure"],
}


@pytest.mark.parametrize("rule", Rule)
def test_a_rule_that_begins_to_hold_holds_to_the_end(rule: Rule) -> None:
    """What happens to a plant is never undone; the fish alone stops to swim, and velocities come in parts."""
    holds = [rule in phase.rules for phase in PHASES]
    if rule in NOT_TO_THE_END:
        assert [phase.name for phase in PHASES if rule in phase.rules] == NOT_TO_THE_END[rule]
    else:
        assert holds == sorted(holds)
        assert not holds[0]
        assert holds[-1]


def test_what_a_phase_looks_up_is_a_fact_and_every_such_fact_is_looked_up_by_one_phase() -> None:
    assert {field.name for field in fields(Facts)} > LOOKED_UP
    looked_up = sorted(fact for phase in PHASES for fact in phase.looks_up if fact != "cut_gait")
    assert looked_up == sorted(LOOKED_UP - {"cut_gait"})


def test_nobody_writes_into_the_facts() -> None:
    with pytest.raises(AttributeError):
        Facts().drift = 0.0  # type: ignore[misc]


def test_every_phase_that_waits_for_the_plant_is_in_the_list_above() -> None:
    at_once = {"close the bag", "score"}
    assert [phase.name for phase in PHASES if phase.name not in at_once] == [phase for phase, _, _ in SILENT_PLANT]


@pytest.mark.parametrize("phase", [phase.name for phase in PHASES])
def test_cancelling_in_any_phase_switches_the_gait_off_and_closes_the_bag(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    on = rehearsal.actions.count(Action.GAIT_ON) - rehearsal.actions.count(Action.GAIT_OFF)
    is_open = rehearsal.actions.count(Action.OPEN_BAG) - rehearsal.actions.count(Action.CLOSE_BAG)
    expected = [Action.GAIT_OFF] * on + [Action.CLOSE_BAG] * is_open
    assert rehearsal.trial.cancel("somebody pressed Ctrl-C") == expected
    assert rehearsal.trial.result is not None
    assert rehearsal.trial.result.outcome is Outcome.INTERRUPTED
    assert f"in phase '{phase}': somebody pressed Ctrl-C" in rehearsal.failure
    assert rehearsal.trial.cancel("again") == []
    assert rehearsal.trial.update(rehearsal.now, rehearsal.seen.facts(LOOKED_UP)) == []


def test_a_trial_may_be_cancelled_before_its_first_phase() -> None:
    rehearsal = Rehearsal()
    assert rehearsal.trial.looks_up == frozenset()
    assert rehearsal.trial.cancel("somebody pressed Ctrl-C") == []
    assert rehearsal.failure == "in phase 'begin': somebody pressed Ctrl-C"


@pytest.mark.parametrize("phase", [phase.name for phase in PHASES][2:])
def test_a_fault_in_any_phase_fails_the_trial_with_the_plants_reason(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.actions.clear()
    swims = phase in {"settle", "measure"}
    rehearsal.say(State.FAULT, 99 * SECOND, "the state is not finite at 3.2 s")
    rehearsal.update()
    assert f"{phase}: topic /fish/plant_state says FAULT (the state is not finite at 3.2 s)" in rehearsal.failure
    if swims:
        assert rehearsal.actions == [Action.GAIT_OFF, Action.CLOSE_BAG]


@pytest.mark.parametrize("phase", ["open the bag", "settle", "measure", "stop the gait"])
def test_a_bag_that_cannot_be_written_fails_the_trial(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.recorder_failure = "disk full"
    rehearsal.update()
    assert rehearsal.failure == f"{phase}: disk full"


def test_an_emergency_stop_is_no_attempt_at_the_fin_and_its_release_is_waited_for() -> None:
    latched = PlantState(
        State.FAULT, "robot", 50 * SECOND, "the emergency stop is latched", SHOWN, {"waiting_for": "release"}
    )
    swimming, next_one = Rehearsal(), Rehearsal()
    swimming.reach("measure")
    swimming.seen.plant = latched
    swimming.update()
    assert "the emergency stop is latched" in swimming.failure
    assert not swimming.is_attempt
    next_one.reach("wait until it is at rest")
    next_one.seen.plant = latched
    next_one.update(1e6)
    assert next_one.phase == "wait until it is at rest"
    next_one.reach("measure")


def test_a_fault_of_an_earlier_trial_is_cleared_first() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.plants = ("/fish/simulator",)
    rehearsal.say(State.FAULT, 1 * SECOND, "not finite")
    rehearsal.update()
    assert rehearsal.actions == [Action.RECOVER]
    rehearsal.update(11.0)
    assert "says FAULT (not finite), needed is READY" in rehearsal.failure


@pytest.mark.parametrize(
    ("said", "value", "same"),
    [
        ("1200000000.0", 1.2e9, True),
        ("3", 3, True),
        ("between", "between", True),
        ("[]", [], True),
        ("[0.25, 0.5]", (0.25, 0.5), True),
        ("[0.25]", [0.5], False),
        ("1200000000.1", 1.2e9, False),
        ("", 1.0, False),
        ("nan", 1.0, False),
    ],
)
def test_the_fin_mounted_is_compared_value_by_value(said: str, value: Any, same: bool) -> None:
    assert same_value(said, value) is same


def test_a_refused_fin_is_infeasible_with_the_plants_reason() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("set the fin")
    rehearsal.seen.fin_reply = Reply(accepted=False, reason="fin.thickness = 0.2 m must be less than fin.length")
    rehearsal.update()
    assert rehearsal.trial.result == Result(Outcome.INFEASIBLE, "fin.thickness = 0.2 m must be less than fin.length")
    assert rehearsal.actions == [Action.SET_FIN]
    assert rehearsal.trial.phase == "set the fin", "it ends at once"


def test_a_fin_that_is_refused_without_a_reason_is_infeasible_all_the_same() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("set the fin")
    rehearsal.seen.fin_reply = Reply(accepted=False, reason="")
    rehearsal.update()
    assert rehearsal.trial.result == Result(Outcome.INFEASIBLE, "the plant refused the fin without a reason")


def test_a_trial_that_has_ended_is_not_cancelled_any_more() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("score")
    rehearsal.seen.result = OK
    rehearsal.update()
    assert rehearsal.trial.cancel("somebody pressed Ctrl-C") == []
    assert rehearsal.trial.result == OK


def test_a_limit_is_over_when_more_than_its_time_has_passed() -> None:
    rehearsal = Rehearsal()
    rehearsal.update()
    rehearsal.update(30.0)
    assert rehearsal.phase == "find the plant"
    rehearsal.update(2.0**-40)
    assert rehearsal.phase == "INTERRUPTED"


def test_the_time_of_the_first_phase_runs_from_its_beginning() -> None:
    trial, facts = Rehearsal().trial, Seen().facts(frozenset())
    assert trial.update(100.0, facts) == []
    assert trial.update(130.1, facts) == []
    assert trial.result is not None


def test_a_plant_out_of_sight_since_the_fin_was_set_may_come_back() -> None:
    lost, back = Rehearsal(), Rehearsal()
    for rehearsal in (lost, back):
        rehearsal.reach("set the fin")
        rehearsal.seen.publishers = frozenset()
        rehearsal.reach("wait for the fin")
        rehearsal.say(State.WAITING_FOR_FIN, 3 * SECOND, "mount the fin")
        rehearsal.update(0.5)
        rehearsal.update(29.5)
        assert rehearsal.phase == "wait for the fin"
    back.seen.publishers = frozenset({"second"})
    back.reach("measure")
    lost.update(1.0)
    assert lost.failure == "wait for the fin: nobody publishes topic /fish/plant_state any more (waited 30 s)"


def test_exactly_the_least_pace_is_progress() -> None:
    """Half of real time: 2.5 s of the swim in a silence of 5 s."""
    rehearsal = Rehearsal()
    rehearsal.seen.least_pace = 0.5
    rehearsal.reach("measure")
    for newest in (14.5, 17.0, 19.5):
        rehearsal.seen.newest_velocity = round(newest * SECOND)
        rehearsal.update(4.9)
        assert rehearsal.phase == "measure"
    rehearsal.seen.velocities, rehearsal.seen.newest_velocity = 1, 22 * SECOND - 1  # a nanosecond less
    rehearsal.update(4.9)
    rehearsal.update(0.2)
    assert "advanced by only 2.5 s: needed are 2.5 s" in rehearsal.failure


def test_a_refused_reset_fails_the_trial() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("reset")
    rehearsal.seen.reset_reply = Reply(accepted=False, reason="disarmed")
    rehearsal.update()
    assert rehearsal.failure == "reset: the plant refused: disarmed"


def test_a_state_said_before_the_reset_does_not_count_as_being_at_the_start() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait at the start")
    rehearsal.say(State.READY, 3 * SECOND, fin=SHOWN)
    rehearsal.update()
    assert rehearsal.phase == "wait at the start"
    rehearsal.say(State.READY, 3 * SECOND + 1, fin=SHOWN)
    rehearsal.update()
    assert rehearsal.phase == "open the bag"
    assert rehearsal.trial.course.reset_after == 3 * SECOND


AFTER_THE_FIN = [phase.name for phase in PHASES[3:12]]
"""From "wait for the fin" to "stop the gait"."""
WAITING_FOR_PEOPLE = [("wait for the fin", State.WAITING_FOR_FIN), ("wait at the start", State.WAITING_FOR_RESET)]


@pytest.mark.parametrize(("phase", "state"), WAITING_FOR_PEOPLE)
def test_people_get_the_time_they_need(phase: str, state: State) -> None:
    rehearsal = Rehearsal()
    rehearsal.wait_for_people(phase, state)
    rehearsal.update(1e6)
    assert rehearsal.phase == phase
    impatient = Rehearsal(timeouts=replace(TIMEOUTS, people=3600.0))
    impatient.wait_for_people(phase, state)
    impatient.update(3601.0)
    assert f"says {state} (mount the fin)" in impatient.failure


@pytest.mark.parametrize(("phase", "state"), WAITING_FOR_PEOPLE)
def test_nobody_is_waited_for_once_the_plant_is_gone(phase: str, state: State) -> None:
    rehearsal = Rehearsal()
    rehearsal.wait_for_people(phase, state)
    rehearsal.update(1e6)
    rehearsal.seen.plants, rehearsal.seen.publishers = (), frozenset()
    rehearsal.update(1.0)
    rehearsal.update(30.0)
    assert rehearsal.trial.result is None, "too early"
    rehearsal.update(0.1)
    assert rehearsal.failure == f"{phase}: nobody publishes topic /fish/plant_state any more (waited 30 s)"
    assert not rehearsal.is_attempt


@pytest.mark.parametrize(("phase", "state"), WAITING_FOR_PEOPLE)
def test_a_plant_that_is_out_of_sight_for_a_moment_is_waited_for(phase: str, state: State) -> None:
    rehearsal = Rehearsal()
    rehearsal.wait_for_people(phase, state)
    for _ in range(10):
        for publishers in (frozenset[str](), frozenset({"first"})):
            rehearsal.seen.publishers = publishers
            rehearsal.update(20.0)
    assert rehearsal.phase == phase


@pytest.mark.parametrize("phase", [phase.name for phase in PHASES[:7]])
def test_what_fails_before_the_gait_is_on_is_no_attempt_at_the_fin(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.update(60.0)
    assert not rehearsal.is_attempt


@pytest.mark.parametrize("phase", [phase.name for phase in PHASES[8:12]])
def test_silence_under_way_is_an_attempt_at_the_fin(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.update(15.1)
    assert rehearsal.is_attempt


def test_a_swim_that_nobody_scores_fails() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("score")
    rehearsal.update(19.9)
    assert rehearsal.phase == "score"
    rehearsal.update(0.2)
    assert rehearsal.failure == "score: no score (waited 20 s)"


def test_a_swim_of_another_gait_than_the_one_asked_for_is_no_ok_trial() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.other_gait = "joint 1: frequency 8 Hz asked, 5 Hz swum"
    rehearsal.reach("stop the gait")
    rehearsal.seen.other_gait = ""  # the tail is still
    rehearsal.update()
    assert rehearsal.failure == "stop the gait: joint 1: frequency 8 Hz asked, 5 Hz swum"
    assert not rehearsal.is_attempt


def test_a_swim_counts_only_once_the_plant_has_said_which_gait_it_swims() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("start the gait")
    rehearsal.say(State.SWIMMING, 10 * SECOND, fin=SHOWN)
    rehearsal.update(4.9)
    assert rehearsal.phase == "start the gait"
    rehearsal.update(0.2)
    assert "it is not told which gait the plant swims: nobody publishes topic /fish/gait_applied" in rehearsal.failure
    assert rehearsal.actions[-2:] == [Action.GAIT_OFF, Action.CLOSE_BAG]


# A driver tells what its joints can do only once somebody has configured it, which it may wait for in any of these.
@pytest.mark.parametrize("phase", ["wait until it is at rest", "wait for the fin", "wait at the start"])
def test_a_gait_that_the_plant_would_cut_never_starts(phase: str) -> None:
    assert "cut_gait" in next(each for each in PHASES if each.name == phase).looks_up
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.cut_gait = "the plant's limits would cut the gait"
    rehearsal.update()
    assert rehearsal.failure == f"{phase}: the plant's limits would cut the gait"
    assert not rehearsal.is_attempt
    assert Action.GAIT_ON not in rehearsal.actions


def test_another_fish_than_the_studys_swims_nothing() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait for the fin")
    rehearsal.seen.other_fish = "the study was begun with another fish: body.mass is 1.0 there and 2.0 here"
    rehearsal.update()
    assert rehearsal.failure == f"wait for the fin: {rehearsal.seen.other_fish}"
    assert not rehearsal.is_attempt
    assert Action.GAIT_ON not in rehearsal.actions


def test_no_swim_begins_before_it_is_known_which_fish_it_is() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.other_fish = None
    rehearsal.reach("wait at the start")
    rehearsal.say(State.READY, 4 * SECOND, fin=SHOWN)
    rehearsal.update(5.0)
    assert rehearsal.phase == "wait at the start"
    rehearsal.update(5.1)
    assert "no answer from service /fish/simulator/get_parameters" in rehearsal.failure


def test_a_swim_begins_with_a_straight_tail() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait at the start")
    rehearsal.say(State.READY, 4 * SECOND, fin=SHOWN)
    rehearsal.seen.tail_angle = 0.2
    rehearsal.update(5.0)
    assert rehearsal.phase == "wait at the start"
    rehearsal.seen.tail_angle = STRAIGHT
    rehearsal.update(0.1, until="open the bag")
    assert rehearsal.phase == "open the bag"


def test_a_tail_that_stays_bent_is_named() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait at the start")
    rehearsal.say(State.READY, 4 * SECOND, fin=SHOWN)
    rehearsal.seen.tail_angle = 0.2
    rehearsal.update(10.1)
    assert "the tail stands at 11.5 degrees" in rehearsal.failure
    assert "straighten it by hand" in rehearsal.failure


@pytest.mark.parametrize("phase", AFTER_THE_FIN)
@pytest.mark.parametrize("seen", [{"first", "second"}, {"second"}])  # the graph remembers a dead one for a while
def test_a_plant_that_was_started_anew_knows_nothing_of_the_trial(phase: str, seen: set[str]) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.publishers = frozenset(seen)
    rehearsal.update(0.01)
    assert f"{phase}: who publishes topic /fish/plant_state now was started after the fin" in rehearsal.failure
    assert not rehearsal.is_attempt


@pytest.mark.parametrize("phase", AFTER_THE_FIN[AFTER_THE_FIN.index("open the bag") :])
def test_a_swim_with_another_fin_is_never_taken_for_the_trials(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    stamp = rehearsal.seen.plant.stamp if rehearsal.seen.plant is not None else 0
    rehearsal.say(State.SWIMMING, stamp, fin=OTHER_FIN)
    rehearsal.update(0.01)
    assert f"{phase}: the fin mounted has fin.young_modulus = 1200000000.0 instead of 1500000000.0" in rehearsal.failure
    assert not rehearsal.is_attempt


def test_a_plant_that_was_started_anew_before_it_got_the_fin_is_as_good_as_the_one_before() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("set the fin")
    rehearsal.seen.publishers = frozenset({"first", "second"})
    rehearsal.reach("wait for the fin")
    rehearsal.seen.publishers = frozenset({"second"})
    rehearsal.reach("measure")


def test_a_plant_that_waits_for_people_must_answer_its_services_all_the_same() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("set the fin")
    rehearsal.say(State.WAITING_FOR_FIN, 2 * SECOND)
    rehearsal.update(20.1)
    assert "no answer from service" in rehearsal.failure


def test_a_simulated_swim_may_be_a_hundred_times_slower_than_real_time() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.least_pace = 0.01
    rehearsal.reach("measure")
    for tenth in range(100):
        rehearsal.seen.newest_velocity = 12 * SECOND + tenth * SECOND // 10
        rehearsal.update(4.0)
    assert rehearsal.phase == "measure"


# Stamps in s of a velocity's clock after so many s of the swim, which began at 10 s; and what the trial says of them.
USELESS_STAMPS: list[tuple[Callable[[float], float], str]] = [
    (lambda time: 10.0 + 0.001 * time, "their stamps advanced by only"),
    (lambda time: 11.0 + math.sin(time), "their stamps advanced by only"),
    (lambda time: 10.5 - 0.001 * time, "their stamps advanced by only"),
    (lambda _: 10.0, "their stamps advanced by only 0 s"),
    (lambda time: 11.0 - time, "before the start of the swim: its clock is not the plant's"),
    (lambda _: 0.0, "the last one stamped 10 s before the start of the swim"),
    (lambda time: time - 1e5, "the last one stamped 100005 s before"),
]


@pytest.mark.parametrize("phase", ["settle", "measure"])
@pytest.mark.parametrize(("clock", "reason"), USELESS_STAMPS)
def test_velocities_whose_stamps_do_not_carry_the_swim_on_keep_no_tail_beating(
    clock: Callable[[float], float], reason: str, phase: str
) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    begin = rehearsal.now
    while rehearsal.trial.result is None:
        rehearsal.seen.velocities += 1
        rehearsal.seen.newest_velocity = round(clock(rehearsal.now - begin) * SECOND)
        rehearsal.update(0.01)
        assert rehearsal.now < begin + 15.1, "the tail beats on"
    assert reason in rehearsal.failure
    assert "messages came on topic /fish/velocity" in rehearsal.failure
    assert rehearsal.actions[-2:] == [Action.GAIT_OFF, Action.CLOSE_BAG]


@given(pace=st.sampled_from([0.01, 0.5]), data=st.data())
def test_whatever_the_stamps_do_a_swim_ends(pace: float, data: st.DataObject) -> None:
    """Its 12 s at the least pace, and a silence in each of its two phases, are the most that it can last."""
    rehearsal = Rehearsal()
    rehearsal.seen.least_pace = pace
    rehearsal.reach("settle")
    begin = rehearsal.now
    step = st.one_of(st.floats(-100.0, 100.0), st.floats(-0.1, 0.1), st.just(0.0))
    stamp = 10.0
    while rehearsal.trial.phase in {"settle", "measure"} and rehearsal.trial.result is None:
        rehearsal.seen.velocities += 1
        stamp += data.draw(step) if rehearsal.now < begin + 20.0 else 0.0
        rehearsal.seen.newest_velocity = round(stamp * SECOND)
        rehearsal.update(0.5)
        assert rehearsal.now <= begin + 12.0 / pace + 2 * TIMEOUTS.silence + 1.0


def test_a_velocity_that_stands_still_says_how_long_ago_it_was_stamped() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("measure")
    rehearsal.seen.velocities, rehearsal.seen.newest_velocity = 500, -90 * SECOND
    rehearsal.update(5.1)
    assert rehearsal.failure == (
        "measure: 500 messages came on topic /fish/velocity, the last one stamped 100 s before the start of the swim: "
        "its clock is not the plant's (waited 5 s)"
    )


def test_a_fish_that_drifts_is_waited_for_before_its_gait_starts() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait until the water is still")
    rehearsal.seen.drift = 0.012
    rehearsal.update(59.0)
    assert rehearsal.phase == "wait until the water is still"
    assert Action.GAIT_ON not in rehearsal.actions
    rehearsal.seen.drift = -0.004
    rehearsal.update(0.1)
    assert rehearsal.phase == "start the gait"


def test_a_fish_that_drifts_for_too_long_swims_nothing() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("wait until the water is still")
    rehearsal.seen.drift = 0.012
    rehearsal.update(60.1)
    assert "the fish drifts at 1.2 cm/s before the gait starts" in rehearsal.failure
    assert Action.GAIT_ON not in rehearsal.actions
    assert not rehearsal.is_attempt


@pytest.mark.parametrize(("phase", "state"), WAITING_FOR_PEOPLE)
def test_the_clock_of_a_phase_starts_anew_when_people_are_done(phase: str, state: State) -> None:
    rehearsal = Rehearsal()
    rehearsal.wait_for_people(phase, state)
    rehearsal.update(600.0)
    rehearsal.say(State.READY, 1 * SECOND)  # said before the reset, with the fin of before: not yet what is needed
    rehearsal.update(9.9)
    rehearsal.update(9.9)
    assert rehearsal.trial.result is None
    rehearsal.update(0.2)
    assert "waited 10 s" in rehearsal.failure


def test_a_plant_that_stops_swimming_early_interrupts_the_trial() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("measure")
    rehearsal.seen.newest_velocity = 15 * SECOND
    rehearsal.say(State.READY, 16 * SECOND, "no fresh gait", fin=SHOWN)
    rehearsal.update()
    assert "the plant went to READY 5.00 s into a swim of 12 s (no fresh gait)" in rehearsal.failure
    assert not rehearsal.is_attempt


@pytest.mark.parametrize("phase", ["settle", "measure", "stop the gait"])
def test_a_plant_that_begins_its_swim_anew_fails_the_trial(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.newest_velocity = 22 * SECOND  # what the phase waits for does not make up for it
    rehearsal.say(State.SWIMMING, 10 * SECOND + 1, fin=SHOWN)
    rehearsal.update()
    assert rehearsal.failure.startswith(f"{phase}: topic /fish/plant_state says SWIMMING anew")
    assert rehearsal.actions.count(Action.GAIT_ON) == rehearsal.actions.count(Action.GAIT_OFF)
    assert rehearsal.actions[-1] is Action.CLOSE_BAG


def test_a_state_that_is_said_again_with_its_stamp_changes_nothing() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("measure")
    rehearsal.say(State.SWIMMING, 10 * SECOND, fin=SHOWN)
    rehearsal.update()
    assert rehearsal.phase == "measure"


def test_two_plants_in_one_namespace_are_refused_by_name() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.plants = ("/fish/servo_driver", "/fish/simulator")
    rehearsal.update()
    rehearsal.update(30.1)
    assert "has 2 publishers (/fish/servo_driver, /fish/simulator): leave only one plant" in rehearsal.failure


@pytest.mark.parametrize("phase", [phase.name for phase in PHASES][1:])
def test_a_second_plant_that_turns_up_fails_the_trial(phase: str) -> None:
    rehearsal = Rehearsal()
    rehearsal.reach(phase)
    rehearsal.seen.plants = ("/fish/servo_driver", "/fish/simulator")
    rehearsal.update()
    assert rehearsal.failure.startswith(f"{phase}: topic /fish/plant_state has 2 publishers")
    assert not rehearsal.is_attempt


def test_a_missing_service_is_named() -> None:
    rehearsal = Rehearsal()
    rehearsal.seen.plants = ("/fish/simulator",)
    rehearsal.seen.missing_services = ("/fish/simulator/request_reset",)
    rehearsal.update()
    rehearsal.update(30.1)
    assert "service /fish/simulator/request_reset missing" in rehearsal.failure


def test_the_bag_stays_open_until_every_stream_has_reached_the_windows_end() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("stop the gait")
    rehearsal.seen.late_topics = ("/fish/pose",)
    rehearsal.say(State.READY, 23 * SECOND, fin=SHOWN)
    rehearsal.update(5.0)
    assert rehearsal.phase == "stop the gait"
    rehearsal.update(0.1)
    assert "no message up to the end of the window on topic /fish/pose" in rehearsal.failure


def test_a_swim_without_a_score_fails_with_the_scores_reason() -> None:
    rehearsal = Rehearsal()
    rehearsal.reach("score")
    rehearsal.seen.result = Result(Outcome.FAILED, "no velocity for 0.7 s")
    rehearsal.update()
    assert rehearsal.failure == "no velocity for 0.7 s"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"outcome": Outcome.OK}, "mean_speed of an OK trial"),
        ({"outcome": Outcome.OK, "measured": {"mean_speed": 0.1, "power": math.inf}}, "power of an OK trial = inf"),
        ({"outcome": Outcome.FAILED}, "has a reason and no score"),
        ({"outcome": Outcome.INFEASIBLE, "reason": "no", "measured": {"mean_speed": 1.0}}, "has a reason and no score"),
        ({"outcome": Outcome.RUNNING, "reason": "no"}, "cannot end as RUNNING"),
    ],
)
def test_a_result_that_contradicts_itself_is_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Result(**arguments)  # type: ignore[arg-type]


def test_only_people_may_be_waited_for_without_an_end() -> None:
    with pytest.raises(ValueError, match=r"timeout\.people = -1 s"):
        Timeouts(people=-1.0)
    assert Timeouts(0.5, 0.5, 0.5, 0.5, 0.5, people=0.5).people == 0.5


@pytest.mark.parametrize("name", ["find", "plant", "reply", "silence", "rest"])
def test_a_timeout_of_zero_is_refused_where_it_would_fail_every_trial(name: str) -> None:
    with pytest.raises(ValueError, match=f"timeout.{name} = 0 s"):
        Timeouts(**{name: 0.0})
