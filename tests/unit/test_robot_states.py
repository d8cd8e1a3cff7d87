"""What a robot waits for: programs ask, people confirm, and no call of a program is taken for a person's act."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_plant.fin import Fin
from fin_plant.plant_state import State
from fin_servo_driver.health import ENDED
from fin_servo_driver.robot_states import (
    LEAST_SIGHT,
    LONGEST_BLINK,
    NOT_THERE,
    Device,
    RobotStates,
    Waiting,
    other_plants,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.robot_states import Answer, Standing

FIN = Fin().as_parameters()
OTHER_FIN = Fin(length=0.07).as_parameters()


class Robot:
    """The states with a device and a clock; a second passes before each act."""

    def __init__(self) -> None:
        self.states = RobotStates(FIN)
        self.device: Device | None = None
        self.now = 0.0

    def wait(self, seconds: float = 1.0) -> Standing:
        self.now += seconds
        return self.look()

    def look(self) -> Standing:
        return self.states.look(self.device, self.now)

    def configure(self) -> None:
        self.states.new_device()
        self.device = Device()
        self.wait()

    def lose(self, reason: str = "unplugged", *, alive: bool = True) -> None:
        self.device = Device(
            connected=False, reason=reason, reconnects=self.device.reconnects if self.device else 0, alive=alive
        )

    def reconnect(self) -> None:
        assert self.device is not None
        self.device = Device(reconnects=self.device.reconnects + 1)

    # what an optimiser may call

    def request_reset(self) -> Answer:
        return self.states.request_reset(self.device, self.now)

    def want(self) -> None:
        self.states.want_fin(FIN)

    def want_another(self) -> None:
        self.states.want_fin(OTHER_FIN)

    # what a person may call

    def confirm_fin(self) -> Answer:
        self.wait()
        return self.states.confirm_fin(self.device, self.now)

    def confirm_mark(self) -> Answer:
        self.wait()
        return self.states.confirm_mark(self.device, self.now)

    def become_ready(self) -> None:
        self.configure()
        assert self.confirm_fin().accepted
        self.states.armed = True
        assert self.wait().state is State.READY


def stopped(robot: Robot) -> None:
    robot.states.emergency = True
    robot.wait()
    assert robot.states.release().accepted


def stopped_unseen(robot: Robot) -> None:
    """The stop is released before anybody has looked at the state."""
    robot.states.emergency = True
    robot.states.release()


def unplugged(robot: Robot) -> None:
    robot.lose()
    assert robot.wait().waiting is Waiting.DEVICE
    robot.reconnect()


def unplugged_unseen(robot: Robot) -> None:
    robot.reconnect()


def failed_and_configured_anew(robot: Robot) -> None:
    robot.lose("the driver's I/O thread has failed", alive=False)
    assert robot.wait().state is State.FAULT
    robot.device = None
    robot.states.armed = False
    robot.configure()
    robot.states.armed = True


def asked_for_a_reset(robot: Robot) -> None:
    assert robot.request_reset().accepted


def stopped_while_a_reset_was_asked_for(robot: Robot) -> None:
    asked_for_a_reset(robot)
    stopped(robot)


def unplugged_during_a_stop(robot: Robot) -> None:
    robot.states.emergency = True
    robot.lose()
    robot.wait()
    robot.reconnect()
    robot.states.release()


WAYS_BACK: list[Callable[[Robot], None]] = [
    stopped,
    stopped_unseen,
    unplugged,
    unplugged_unseen,
    failed_and_configured_anew,
    asked_for_a_reset,
    stopped_while_a_reset_was_asked_for,
    unplugged_during_a_stop,
]
OPTIMISERS_CALLS: list[Callable[[Robot], object]] = [Robot.request_reset, Robot.want, Robot.want_another, Robot.wait]


@pytest.mark.parametrize("way_back", WAYS_BACK)
def test_after_each_fault_no_call_of_an_optimiser_leads_to_ready(way_back: Callable[[Robot], None]) -> None:
    for calls in product(OPTIMISERS_CALLS, repeat=4):
        robot = Robot()
        robot.become_ready()
        way_back(robot)
        for call in calls:
            call(robot)
            assert robot.look().state not in {State.READY, State.SWIMMING}, (way_back, calls)
        if robot.wait().waiting is Waiting.FIN:
            assert not robot.confirm_mark().accepted
            assert robot.confirm_fin().accepted
        assert robot.wait().waiting is Waiting.MARK
        assert robot.confirm_mark().accepted
        assert robot.look().state is State.READY


def test_a_fin_that_was_asked_off_is_confirmed_even_if_it_is_wanted_again() -> None:
    robot = Robot()
    robot.become_ready()
    robot.want_another()
    robot.want()
    assert robot.wait().waiting is Waiting.FIN
    assert robot.confirm_fin().accepted
    assert robot.look().state is State.READY


def test_a_confirmation_of_what_nobody_asked_for_does_not_count() -> None:
    robot = Robot()
    assert not robot.confirm_fin().accepted
    robot.become_ready()
    assert not robot.confirm_mark().accepted
    assert not robot.confirm_fin().accepted
    robot.request_reset()
    assert robot.confirm_mark().accepted
    answer = robot.confirm_mark()
    assert not answer.accepted
    assert "no mark is waited for, the plant is in READY" in answer.text


@pytest.mark.parametrize("seconds", [0.0, 0.5 * LEAST_SIGHT])
def test_an_answer_that_came_before_anybody_could_see_the_question_does_not_count(seconds: float) -> None:
    robot = Robot()
    robot.become_ready()
    robot.want_another()
    robot.wait(0.0)
    robot.wait(LEAST_SIGHT)
    robot.want()  # another question: the fin to mount has changed under the operator's finger
    robot.wait(0.0)
    robot.wait(seconds)
    early = robot.states.confirm_fin(robot.device, robot.now)
    assert not early.accepted
    assert "look at the robot" in early.text
    assert robot.confirm_fin().accepted


@pytest.mark.parametrize("fault", [stopped_unseen, unplugged_unseen])
def test_an_answer_to_a_question_from_before_an_unseen_fault_does_not_count(fault: Callable[[Robot], None]) -> None:
    robot = Robot()
    robot.become_ready()
    robot.request_reset()
    robot.wait(5.0)
    fault(robot)
    assert not robot.states.confirm_mark(robot.device, robot.now).accepted
    assert robot.confirm_mark().accepted


def test_beside_another_plant_nothing_is_confirmed_and_afterwards_the_mark_is_owed() -> None:
    """Two drivers of one name: what is confirmed to a rehearsal, by its emulated operator, reaches the robot too."""
    both = other_plants("/fish/plant_state", ["/fish/servo_driver", "/fish/servo_driver"])
    assert not other_plants("/fish/plant_state", ["/fish/servo_driver"])
    robot = Robot()
    robot.configure()
    robot.states.others = both
    assert "2 plants publish topic /fish/plant_state" in robot.confirm_fin().text
    robot.states.others = ""
    robot.wait()
    assert robot.confirm_fin().accepted
    robot.states.armed = True
    robot.wait()
    assert robot.confirm_mark().accepted
    assert robot.look().state is State.READY
    robot.states.swimming_since = 1
    robot.states.others = both
    assert robot.look().waiting is Waiting.BEING_ALONE
    assert not robot.confirm_mark().accepted
    assert robot.request_reset().accepted
    robot.states.rest()
    robot.states.others = ""
    assert robot.look().waiting is Waiting.MARK
    assert not robot.states.confirm_mark(robot.device, robot.now).accepted


def test_a_stop_of_a_device_that_is_away_says_that_it_may_not_have_been_told() -> None:
    robot = Robot()
    robot.become_ready()
    robot.states.emergency = True
    assert NOT_THERE not in robot.look().reason
    robot.lose("/dev/x was lost")
    said = robot.look()
    assert said.waiting is Waiting.RELEASE
    assert said.reason.endswith(f"{NOT_THERE}: /dev/x was lost")
    robot.reconnect()  # which disables it first
    assert NOT_THERE not in robot.look().reason


def test_a_stop_is_answered_by_what_became_of_the_device() -> None:
    states = Robot().states
    assert states.stop(Device()).text.startswith("stopped")
    away = states.stop(Device(connected=False, reason="/dev/x was lost"))
    assert (away.accepted, away.text) == (False, f"latched, but {NOT_THERE}, use its switch: /dev/x was lost")
    # A driver that was being shut down disables the device, and has it closed before the answer is written.
    assert states.stop(Device(connected=False, reason=ENDED, alive=False)).text.startswith("stopped")
    assert "no device was told" in states.stop(None).text


def test_an_answer_that_a_driver_finds_after_it_hung_does_not_count() -> None:
    robot = Robot()
    robot.become_ready()
    robot.request_reset()
    robot.wait(1.0)
    robot.now += LONGEST_BLINK + 1.0
    assert not robot.states.confirm_mark(robot.device, robot.now).accepted
    assert robot.confirm_mark().accepted


def test_a_reset_that_is_asked_for_again_and_again_can_still_be_answered() -> None:
    robot = Robot()
    robot.become_ready()
    for _ in range(100):
        robot.request_reset()
        robot.wait(0.05)
    assert robot.states.confirm_mark(robot.device, robot.now).accepted


def test_while_a_person_mounts_the_fin_or_nothing_is_connected_a_reset_is_refused_with_the_reason() -> None:
    robot = Robot()
    assert robot.request_reset().text == "the driver is not configured"
    robot.configure()
    assert "mount the fin" in robot.request_reset().text
    robot.lose("unplugged")
    assert robot.request_reset().text == "unplugged"


ACTS: list[Callable[[Robot], object]] = [
    *OPTIMISERS_CALLS,
    Robot.confirm_fin,
    Robot.confirm_mark,
    stopped_unseen,
    unplugged_unseen,
]


@given(st.lists(st.sampled_from(ACTS), max_size=30))
def test_ready_follows_only_from_a_confirmation_that_is_younger_than_every_fault_and_question(
    acts: list[Callable[[Robot], object]],
) -> None:
    robot = Robot()
    robot.become_ready()
    mark_owed = fin_owed = False
    for act in acts:
        result = act(robot)
        if act in {stopped_unseen, unplugged_unseen}:
            mark_owed = True
        elif act is Robot.request_reset:
            mark_owed = mark_owed or not fin_owed
        elif act is Robot.want_another:
            fin_owed = fin_owed or robot.states.mounted != OTHER_FIN
        elif act is Robot.want:
            fin_owed = fin_owed or robot.states.mounted != FIN
        elif act is Robot.confirm_fin:
            fin_owed = fin_owed and not getattr(result, "accepted", False)
        elif act is Robot.confirm_mark:
            mark_owed = mark_owed and not getattr(result, "accepted", False)
        assert (robot.look().state is State.READY) == (not mark_owed and not fin_owed)
