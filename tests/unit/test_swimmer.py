"""A fish and its trial without a node: the loop, the observer's facts and the score, with time and a fish handed in.

The fish swims in steps of the test's clock and speaks as a simulator does; Trial, Observer and score are the real ones.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest

from fin_optimizer.bags.messages import BagError, decode, velocity_samples
from fin_optimizer.goals import Goals
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.score.swim import SwimRecord
from fin_optimizer.trial.facts import Reply
from fin_optimizer.trial.observer import Observer
from fin_optimizer.trial.phases import Timeouts
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.swimmer import Conditions, Swimmer
from fin_plant import topics
from fin_plant.gait import PAPER_GAIT, Gait
from fin_plant.plant_state import PlantState, State
from fin_plant.stamps import NANOSECONDS
from support import bags

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

STILL = Gait.from_rows([[0.0, 0.9, 0.0, 0.0]])
FIN = {"fin.young_modulus": 1.5e9}
SHOWN = {"fin.young_modulus": "1500000000.0"}
STEP = 0.02
ACCELERATION = 0.01  # m/s^2, so that the mean speed from 1 s to 3 s of the swim is 0.02 m/s
MEASUREMENT = Measurement(settle=1.0, duration=2.0, block=1.0)


class Fish:
    """A plant and its recorder, as the swimmer sees them: PlantClient and Recorder in one."""

    def __init__(self) -> None:
        self.now = 0.0
        self.plants: Sequence[str] = ("/fish/simulator",)
        self.publishers = frozenset({"first"})
        self.unreadable = self.velocity_trouble = ""
        self.changed = False
        self.applied: Gait | None = None
        self.fin_reply: Reply | None = None
        self.reset_reply: Reply | None = None
        self.parameters: dict[str, object] | None = None
        self.state: PlantState | None = None
        self.state_messages: list[bytes] = []
        self.velocities: list[bytes] = []
        self.sent: list[tuple[float, bool]] = []
        self.opened: Mapping[str, str] | None = None
        self.is_open = False
        self.failure = ""
        self.refuses_the_bag = ""
        self.unusable: dict[str, int] = {}
        self.mounted: dict[str, str] = {}
        self.waits_for_a_person = False
        self._say(State.READY)

    @property
    def stamp(self) -> int:
        return round(self.now * NANOSECONDS)

    def _say(self, state: State, **details: str) -> None:
        self.changed = True
        self.state = PlantState(state, "simulator", self.stamp, fin=self.mounted, details=details)
        self.state_messages.append(bags.state(state.value, self.stamp, **self.mounted))

    # -- as PlantClient ----------------------------------------------------------------------------------------------

    def look(self, _: float) -> None:
        pass

    def missing_services(self) -> list[str]:
        return []

    def ask_parameters(self) -> None:
        self.parameters = {"body.length": 0.14}

    def set_fin(self, fin: Mapping[str, Any]) -> None:
        self.mounted = {name: repr(value) for name, value in fin.items()}
        self.fin_reply = Reply(accepted=True)
        self._say(State.WAITING_FOR_FIN if self.waits_for_a_person else State.READY)

    def request_reset(self) -> None:
        self.now += STEP
        self.reset_reply = Reply(accepted=True)
        self._say(State.READY)

    def send(self, gait: Gait) -> None:
        self.sent.append((self.now, gait.moves))
        self.applied = gait
        swims = self.state is not None and self.state.state is State.SWIMMING
        if gait.moves != swims:
            self._say(State.SWIMMING if gait.moves else State.READY)

    # -- as Recorder -------------------------------------------------------------------------------------------------

    def listen(self) -> int:
        begun = self.state.stamp if self.swims and self.state is not None else self.stamp
        self.velocities.append(bags.velocity(self.stamp, ACCELERATION * (self.stamp - begun) / NANOSECONDS))
        return 1

    @property
    def swims(self) -> bool:
        return self.state is not None and self.state.state is State.SWIMMING

    def received(self, _: object) -> int:
        return len(self.velocities)

    def newest(self, _: object) -> None:
        return None

    def newest_stamp(self, _: object) -> int:
        return self.stamp

    def unmatched(self, _: object) -> list[str]:
        return []

    def messages(self, _: object) -> list[bytes]:
        return self.velocities

    def open(self, _: Path, metadata: Mapping[str, str], __: Measurement) -> None:
        if self.refuses_the_bag:
            raise BagError(self.refuses_the_bag)
        self.opened, self.is_open = metadata, True
        self.velocities, self.state_messages = [], self.state_messages[-1:]

    def close(self) -> Any:
        self.is_open = False
        return SimpleNamespace(unusable_stamps=self.unusable, first_unusable=dict.fromkeys(self.unusable, "0 s"))

    def swim(self, metadata: Mapping[str, str]) -> SwimRecord:
        states = [decode(data, topics.PLANT_STATE.type_name) for data in self.state_messages]
        return SwimRecord(velocity_samples(self.velocities), states, None, metadata)


class Tank:
    """A swimmer with its fish, and the clock of both."""

    def __init__(self, folder: Path, differences: Sequence[str] = (), goals: Goals | None = None) -> None:
        self.fish = Fish()
        timeouts = Timeouts(find=5.0, plant=5.0, reply=5.0, silence=5.0, rest=5.0)
        conditions = Conditions(
            PAPER_GAIT, STILL, MEASUREMENT, timeouts, goals or Goals(), differences=lambda _: differences
        )
        graph = cast("Any", SimpleNamespace(count_publishers=lambda _: 0))
        fish = cast("Any", self.fish)
        self.swimmer = Swimmer("/fish", conditions, fish, fish, Observer(graph, fish, fish, "/fish", PAPER_GAIT))
        self.swimmer.begin(7, FIN, folder / "bag", {"study.seed": "1"})

    def advance(self) -> Result | None:
        self.fish.now += STEP
        return self.swimmer.advance(self.fish.now)

    def end(self, seconds: float = 30.0) -> Result:
        """Go on until the trial has its result."""
        until = self.fish.now + seconds
        while self.fish.now < until:
            if result := self.advance():
                return result
        pytest.fail(f"still in '{self.swimmer.phase}' after {seconds:g} s")

    def reach(self, phase: str) -> None:
        until = self.fish.now + 30.0
        while self.swimmer.phase != phase:
            assert self.advance() is None
            assert self.fish.now < until, f"still in '{self.swimmer.phase}'"


@pytest.fixture
def tank(tmp_path: Path) -> Tank:
    return Tank(tmp_path)


def test_a_fish_that_swims_gets_the_speed_that_it_swam(tank: Tank) -> None:
    result = tank.end()
    assert result.outcome is Outcome.OK
    assert result.score == pytest.approx(0.02, rel=1e-9)
    assert result.samples == 101  # 2 s at 50 Hz, both ends
    assert tank.swimmer.trial is None
    assert tank.advance() is None  # once


def test_its_bag_tells_the_trial_the_fish_the_fin_and_what_was_told(tank: Tank) -> None:
    tank.end()
    assert tank.fish.opened is not None
    told = {"trial.number": "7", "plant": "simulator", "body.length": "0.14", "study.seed": "1", **SHOWN}
    assert told.items() <= tank.fish.opened.items()
    assert Measurement.from_metadata(tank.fish.opened) == MEASUREMENT
    assert not tank.fish.is_open


def test_the_gait_is_repeated_four_times_a_second_while_the_fish_swims_and_ends_with_it(tank: Tank) -> None:
    tank.end()
    swims = [time for time, moves in tank.fish.sent if moves]
    assert len(swims) == pytest.approx(3.0 / 0.25, abs=1)
    assert max(later - sooner for sooner, later in pairwise(swims)) < 0.25 + 1.5 * STEP
    assert [moves for _, moves in tank.fish.sent][-1] is False


def test_a_trial_that_is_cancelled_leaves_a_still_tail_and_a_closed_bag(tank: Tank) -> None:
    tank.reach("measure")
    result = tank.swimmer.cancel("somebody pressed Ctrl-C", tank.fish.now)
    assert result is not None
    assert result.outcome is Outcome.INTERRUPTED
    assert result.reason == "in phase 'measure': somebody pressed Ctrl-C"
    assert tank.fish.sent[-1][1] is False
    assert not tank.fish.is_open
    assert tank.swimmer.cancel("again", tank.fish.now) is None


def test_a_bag_that_cannot_be_opened_is_no_attempt_at_the_fin(tank: Tank) -> None:
    tank.fish.refuses_the_bag = "the disk is full"
    result = tank.end()
    assert (result.outcome, result.reason) == (Outcome.INTERRUPTED, "open the bag: the disk is full")
    assert tank.fish.sent == []


def test_another_fish_is_refused_before_it_swims(tmp_path: Path) -> None:
    tank = Tank(tmp_path, ["body.length is 0.14 here and 0.2 there"])
    result = tank.end()
    assert result.outcome is Outcome.INTERRUPTED
    assert "the study was begun with another fish: body.length is 0.14 here and 0.2 there" in result.reason
    assert tank.swimmer.other_fish != ""
    assert tank.fish.sent == []


def test_a_gait_that_the_plant_swims_otherwise_is_no_score(tank: Tank) -> None:
    tank.reach("measure")
    tank.fish.applied = PAPER_GAIT.limited(100.0, 0.5)
    tank.fish.changed = True
    result = tank.end()
    assert result.outcome is Outcome.INTERRUPTED
    assert "the plant swims another gait than the one asked for: joint 1: frequency 0.9 Hz asked, 0.5 Hz swum" in (
        result.reason
    )


def test_what_the_estimator_complained_about_is_told_where_velocity_may_be_missing(tank: Tank) -> None:
    tank.reach("settle")
    tank.fish.velocity_trouble = "the tracker's clock is 5 s behind"
    tank.fish._say(State.FAULT)
    assert tank.end().reason.endswith(
        "; the velocity estimator said since the bag was opened: the tracker's clock is 5 s behind"
    )


def test_a_fish_that_waits_for_somebody_is_told_once_after_a_moment(tank: Tank) -> None:
    tank.fish.waits_for_a_person = True
    tank.reach("wait for the fin")
    since = tank.fish.now
    assert tank.swimmer.waits_for(since) == ""
    assert tank.swimmer.waits_for(since + 2.9) == ""
    assert tank.swimmer.waits_for(since + 3.1) == "WAITING_FOR_FIN"
    assert tank.swimmer.waits_for(since + 60.0) == ""


def test_stamps_that_cannot_be_believed_are_told_once_and_counted(tank: Tank) -> None:
    tank.fish.unusable = {"/fish/velocity": 2}
    tank.end()
    assert tank.swimmer.unusable_stamps == {"/fish/velocity": 2}
    assert len(tank.swimmer.notes) == 1
    assert (
        "2 messages of /fish/velocity have a stamp that cannot be believed, the first is 0 s" in tank.swimmer.notes[0]
    )


def test_facts_that_cost_much_are_taken_only_in_phases_that_ask_for_them(tank: Tank) -> None:
    observer = tank.swimmer._observer
    tank.fish.state = PlantState(State.READY, "simulator", 1, details={"limits.sweep": "20", "limits.frequency": "0.5"})
    assert observer.look(frozenset(), None).cut_gait == ""
    assert "limits.frequency = 0.5 Hz) would cut the gait" in observer.look({"cut_gait"}, None).cut_gait


@pytest.mark.parametrize("kind", ["simulator", "robot", "another"])
@pytest.mark.parametrize(
    ("told", "pace", "drift"),
    [
        ({}, 0.5, 0.2),
        ({"slowest_pace": "0.01"}, 0.01, 0.2),
        ({"starts_at_rest": "false"}, 0.5, 0.2),
        ({"starts_at_rest": "true"}, 0.5, 0.0),
    ],
)
def test_pace_and_rest_are_what_the_plant_tells_whatever_its_kind(
    tank: Tank, kind: str, told: dict[str, str], pace: float, drift: float
) -> None:
    tank.fish.state = PlantState(State.READY, kind, 1, details=told)
    tank.fish.velocities = [bags.velocity(number * NANOSECONDS // 100, 0.2) for number in range(1, 101)]
    facts = tank.swimmer._observer.look({"drift"}, None)
    assert facts.least_pace == pace
    assert facts.drift == pytest.approx(drift)


@pytest.mark.parametrize("told", ["", "fast", "nan", "inf", "-1", "0", "0,01"])
def test_a_pace_that_is_none_is_refused_with_its_name(told: str) -> None:
    with pytest.raises(ValueError, match="slowest_pace"):
        PlantState(State.READY, "another", 1, details={"slowest_pace": told})


@pytest.mark.parametrize("told", ["", "wide", "nan", "-1"])
@pytest.mark.parametrize("name", ["limits.sweep", "limits.frequency"])
def test_a_limit_that_is_none_is_refused_with_its_name(name: str, told: str) -> None:
    with pytest.raises(ValueError, match=name):
        PlantState(State.READY, "another", 1, details={name: told})


@pytest.mark.parametrize(
    ("details", "refusal"),
    [
        ({"tells": "torque in joint_states, thrust"}, ""),
        ({}, ""),
        (
            {"tells": "torque in joint_states"},
            "simulator cannot tell what the study is about: efficiency needs thrust. It",
        ),
        (
            {"tells": ""},
            "efficiency needs torque in joint_states and thrust; power needs torque in joint_states. It can",
        ),
    ],
)
def test_a_plant_that_says_that_it_cannot_tell_a_goal_is_refused_by_its_name(
    tmp_path: Path, details: dict[str, str], refusal: str
) -> None:
    tank = Tank(tmp_path, goals=Goals.of(["efficiency"], ["power <= 0.5 W"]))
    tank.fish.state = PlantState(State.READY, "simulator", 1, details=details)
    assert refusal in tank.swimmer.untold
    assert bool(refusal) == bool(tank.swimmer.untold)
    tank.swimmer._conditions = replace(tank.swimmer._conditions, goals=Goals.of(["turning_rate"]))
    assert tank.swimmer.untold == ""
