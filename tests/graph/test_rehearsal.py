"""The rehearsal: the optimiser against a hidden fish through the real serial path, with every device."""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import NodeNameNonExistentError

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from fin_plant import topics
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_plant.messages import gait_message, nanoseconds_of
from fin_plant.plant_state import State
from fin_servo_driver.emulator.hidden_fish import SAMPLE_TIME, Deviation, HiddenFish, Servo
from support.robot_client import UNCONFIGURED, RobotClient

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support.processes import StartedProcess

pytestmark = pytest.mark.graph
OTHER_DEVICES = ("dynamixel", "modbus", "maestro", "lcus", "kmtronic")


def play_a_thrust_of_long_ago(domain: int) -> None:
    """Do what a bag of the simulator does that is played for a moment: a robot has no thrust."""
    with RobotClient(domain) as client:
        publisher = client._node.create_publisher(topics.THRUST.type, topics.THRUST.name, topics.THRUST.qos)
        client.wait_until(publisher.get_subscription_count, "recorder")
        publisher.publish(topics.THRUST.type())
        assert publisher.wait_for_all_acked()


def clients_while(domain: int, study: StartedProcess) -> dict[str, set[str]]:
    """Return the services, without their folders, of which each node has ever held a client while the study ran."""
    held: dict[str, set[str]] = {}
    with RobotClient(domain) as client:
        while study.running:
            for name, namespace in client._node.get_node_names_and_namespaces():
                with contextlib.suppress(NodeNameNonExistentError):  # it has just ended
                    services = client._node.get_client_names_and_types_by_node(name, namespace)
                    held.setdefault(name, set()).update(service.rpartition("/")[2] for service, _ in services)
            client.spin(0.1)
    return held


@pytest.mark.timeout(600)
def test_the_optimiser_works_against_the_hidden_fish_as_against_a_robot(
    start: Callable[..., StartedProcess], tmp_path: Path, ros_domain: int
) -> None:
    study = tmp_path / "study"
    # A busy machine takes a picture of the tracker too late for a swim: as often as it does, the swim is made again.
    again = ("attempts:=10", "failures_in_a_row:=10")
    words = ("plant:=rehearsal", "trials:=2", "measurement.duration:=3.0", f"study_folder:={study}", *again)
    bringup = start("fin_optimizer", "bringup", *words)
    play_a_thrust_of_long_ago(ros_domain)
    held = clients_while(ros_domain, bringup)
    assert bringup.wait() == 0, bringup.tail()
    # A program asks, a person confirms: the rehearsal plays the person, and what it needs the optimiser has not.
    person = {topics.CONFIRM_FIN_SERVICE, topics.CONFIRM_MARK_SERVICE, "change_state"}
    assert person <= held["rehearsal"]
    assert {topics.REQUEST_RESET_SERVICE, topics.SET_PARAMETERS_SERVICE} <= held["optimizer"]
    assert not held["optimizer"] & {*person, topics.EMERGENCY_STOP_SERVICE}
    trials = read_trials(study)  # a swim that a busy machine has broken off is swum again
    assert len([trial for trial in trials if trial.outcome is Outcome.OK]) == 2
    assert len(list((study / "bags").iterdir())) == len(trials)
    # The bag of a robot shows its fish too: a body at the tracker's pose, and the tail that the driver tells.
    bag = read_bag(study / next(trial.bag for trial in trials if trial.outcome is Outcome.OK))
    frames = [[each.child_frame_id for each in message.transforms] for _, message in bag.decoded("/tf")]
    assert len(frames) > 50
    assert set(map(tuple, frames)) == {("base_link", "tail_link_1")}
    assert all(bag.counts[f"/fish/{name}"] for name in ("robot_description", "markers", "path"))


@pytest.mark.timeout(180)
@pytest.mark.long
@pytest.mark.parametrize("device", OTHER_DEVICES)
def test_other_devices_swim_too_and_faults_are_survived(
    start: Callable[..., StartedProcess], ros_domain: int, device: str
) -> None:
    start("fin_servo_driver", "rehearsal", "--ros-args", "-p", f"robot_file:={device}")
    start("fin_servo_driver", "servo_driver", "--ros-args", "-p", "plant:=rehearsal")
    start("fin_servo_driver", "velocity_estimator")
    with RobotClient(ros_domain) as client:
        client.wait_for_state(State.READY)
        client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
        begin = client.wait_for_state(State.SWIMMING).stamp
        client.wait_until(
            lambda: nanoseconds_of(client.received(topics.VELOCITY)[-1].header.stamp) > begin + 4e9, "4 s of swimming"
        )
        assert np.mean([m.twist.linear.x for m in client.received(topics.VELOCITY)[-50:]]) > 0.01
        kinds = {m.header.frame_id for m in client.received(topics.JOINT_STATES)}
        assert ("measured" in kinds) is (device == "dynamixel")
        client._plant = "rehearsal"
        assert client.set_parameters({"fault.unplugged": True}).successful
        client.wait_for_state(State.FAULT)
        assert client.set_parameters({"fault.unplugged": False}).successful
        client.wait_for_state(State.SWIMMING, timeout=6.0)  # the gait is still repeated: a fresh one has come
        if device not in {"lcus", "kmtronic"}:  # those never answer, so their silence cannot be heard
            assert client.set_parameters({"fault.silent": True}).successful
            client.wait_for_state(State.FAULT)
            assert client.set_parameters({"fault.silent": False}).successful
            client.wait_for_state(State.SWIMMING)
        assert client.set_parameters({"fault.drop_rate": 0.05}).successful
        client.spin(1.0)
        assert client.set_parameters({"fault.drop_rate": 0.0}).successful
        client.wait_for_state(State.SWIMMING)
        client._plant = "servo_driver"


@pytest.mark.long
@pytest.mark.timeout(120)
def test_an_emergency_stop_costs_a_study_its_trial_and_nothing_else(
    start: Callable[..., StartedProcess], tmp_path: Path, ros_domain: int
) -> None:
    folder = tmp_path / "study"
    words = ("trials:=1", "attempts:=1", "failures_in_a_row:=2", "timeout.plant:=1.0", "measurement.duration:=1.0")
    study = start("fin_optimizer", "bringup", "plant:=rehearsal", "repeats:=1", f"study_folder:={folder}", *words)
    with RobotClient(ros_domain) as client:
        client.wait_for_state(State.SWIMMING, timeout=60.0)
        assert client.emergency_stop(on=True).success
        study.wait_for_output("trial 0000")
        study.wait_for_output("waits: the emergency stop is latched")  # for longer than timeout.plant
        assert client.emergency_stop(on=False).success
    assert study.wait(60.0) == 0
    trials = read_trials(folder)
    assert [(trial.candidate, trial.outcome) for trial in trials] == [(0, Outcome.INTERRUPTED), (0, Outcome.OK)]
    assert "the emergency stop is latched" in trials[0].reason


@pytest.mark.long
def test_a_person_may_answer_the_driver_in_a_rehearsal(start: Callable[..., StartedProcess], ros_domain: int) -> None:
    start("fin_servo_driver", "rehearsal", "--ros-args", "-p", "operator.acts:=false")
    start("fin_servo_driver", "servo_driver", "--ros-args", "-p", "plant:=rehearsal")
    start("fin_servo_driver", "velocity_estimator")
    with RobotClient(ros_domain) as client:
        client.wait_until(lambda: client.get_parameter("port"), "port that the rehearsal has told the driver")
        client.spin(0.5)
        assert client.life_cycle() == UNCONFIGURED, "the person configures it"
        client.make_ready()
        client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
        begin = client.wait_for_state(State.SWIMMING).stamp
        client.wait_until(
            lambda: nanoseconds_of(client.received(topics.VELOCITY)[-1].header.stamp) > begin + 3e9, "3 s of swimming"
        )
        assert np.mean([m.twist.linear.x for m in client.received(topics.VELOCITY)[-50:]]) > 0.01


# -- the hidden fish itself ------------------------------------------------------------------------------------------


def test_servos_lag_without_overshoot_and_arrive() -> None:
    servo = Servo(1, 0.03)
    times = np.linspace(0.0, 0.5, 501)
    motion = servo.motion([0.2], times)[:, 0]
    assert motion[0] == pytest.approx([0.0, 0.0, 0.2 / 0.03**2])
    assert np.all(np.diff(motion[:, 0]) >= 0.0)
    assert motion[-1, 0] == pytest.approx(0.2, abs=1e-6)
    assert np.gradient(motion[:, 0], times)[5:-5] == pytest.approx(motion[5:-5, 1], abs=0.02)
    assert np.gradient(motion[:, 1], times)[5:-5] == pytest.approx(motion[5:-5, 2], abs=2.0)


def test_a_servo_without_force_stays_where_it_is() -> None:
    servo = Servo(1, 0.03)
    servo.motion([0.2], np.linspace(0.0, 1.0, 11))
    motion = servo.motion([None], np.linspace(0.0, 1.0, 11))
    assert motion[-1, 0, 0] == pytest.approx(0.2, abs=1e-6)


def swim(deviation: Deviation, seconds: float = 6.0) -> float:
    fish = HiddenFish(Fin(), 1, deviation)
    x = 0.0
    for number in range(round(seconds / SAMPLE_TIME)):
        target = math.radians(15.0) * math.sin(2.0 * math.pi * 0.9 * number * SAMPLE_TIME)
        x, _, _ = fish.advance([target])
    return x / seconds


def test_the_hidden_fish_swims_but_not_as_the_simulators() -> None:
    known = swim(Deviation(1.0, 1.0, 1.0, 0.001))
    hidden = swim(Deviation())
    assert known > 0.01
    assert hidden > 0.01
    assert abs(hidden / known - 1.0) > 0.02
