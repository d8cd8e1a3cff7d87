"""The simulator node keeps the contract of a plant: topics, units, refusals, states."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_plant import topics
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, carangiform
from fin_plant.messages import gait_message, nanoseconds_of, plant_state_from_message
from fin_plant.plant_state import EMERGENCY, SERVO_TORQUE, TELLS, State
from fin_sim import simulator as simulator_node
from fin_sim.fish import Water
from fin_sim.motor import Motor
from fin_sim.swim import PAPER_FISH, swim
from support.paper_fish import FIN
from support.plant_tester import PlantTester

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.graph
CLOCK_STEP = 0.02e9
"""ns by which a wall clock that is being set may go back in a swim."""
STREAMS = (topics.JOINT_STATES, topics.POSE, topics.VELOCITY, topics.THRUST)
HINGES = Fin().segments
"""Of the fin as it comes, one in the middle of each segment."""
PATIENT = {"command_timeout": 10.0}
"""s: a swim that is to be whole is not broken off where the machine puts aside the test that commands it."""
QUICK = {"speed": 5.0, **PATIENT}
"""Faster than real time, and not so fast that the test listens to all that swims on until it says stop."""


@pytest.fixture
def client(ros_domain: int) -> Iterator[PlantTester]:
    with PlantTester(ros_domain) as tester:
        yield tester


@pytest.fixture(scope="module")
def simulator(shared_start: Callable[..., Any]) -> Any:
    """The simulator that most tests of this file share; its stamps may be ahead of the wall clock."""
    return shared_start("fin_sim", "simulator")


AS_IT_COMES = {
    name: parameter.default for name, parameter in simulator_node.PARAMETERS.items() if not parameter.read_only
}


@pytest.fixture
def fish(simulator: Any, shared_domain: int) -> Iterator[PlantTester]:
    """A client of the shared simulator, at rest and as it comes; afterwards it is so again."""
    with PlantTester(shared_domain) as tester:
        tester.wait_for_state(State.READY)  # the latched state of a fish at rest
        yield tester
        tester.publish_gait(gait_message([[0.0, 0.0, 0.0, 0.0]]))
        assert tester.emergency_stop(on=False).success
        assert tester.set_parameters(AS_IT_COMES).successful
        assert tester.request_reset().success  # also of a fish whose fin has folded
        tester.wait_for_state(State.READY)
        assert simulator.running


def start_simulator(start: Callable[..., Any], *parameters: str) -> Any:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    return start("fin_sim", "simulator", *(["--ros-args", *arguments] if arguments else []))


def test_a_swim_faster_than_real_time_loses_no_message(start: Callable[..., Any], client: PlantTester) -> None:
    start_simulator(start, "speed:=0.0", "command_timeout:=10.0")
    client.wait_for_state(State.READY)
    since = client.swim(PAPER_GAIT, seconds=10.0)
    for topic in STREAMS:
        stamps = np.array([nanoseconds_of(message.header.stamp) for message in client.received(topic)])
        inside = stamps[(stamps >= since) & (stamps <= since + 10 * 10**9)]
        assert len(inside) == 1001, topic.name
        assert inside[0] == since, topic.name
        assert np.allclose(np.diff(inside), 1e7), topic.name


def test_what_the_topics_say_is_consistent_and_in_si_units(fish: PlantTester) -> None:
    assert fish.set_parameters(QUICK).successful
    since = fish.swim(PAPER_GAIT, seconds=10.0)
    velocity = [m for m in fish.received(topics.VELOCITY) if nanoseconds_of(m.header.stamp) > since]
    pose = [m for m in fish.received(topics.POSE) if nanoseconds_of(m.header.stamp) > since]
    joints = fish.received(topics.JOINT_STATES)[-1]
    assert velocity[0].header.frame_id == "base_link"
    assert pose[0].header.frame_id == "tank"
    assert list(joints.name) == ["tail_joint_1", *(f"fin_hinge_{number + 1}" for number in range(HINGES))]
    count = min(len(velocity), len(pose), 1000)
    forward = np.array([m.twist.linear.x for m in velocity[:count]])
    left = np.array([m.twist.linear.y for m in velocity[:count]])
    heading = np.array([2 * math.atan2(m.pose.orientation.z, m.pose.orientation.w) for m in pose[:count]])
    x = np.array([m.pose.position.x for m in pose[:count]])
    in_tank = forward * np.cos(heading) - left * np.sin(heading)
    # The trapezoidal sum of the velocity's own samples misses by its curvature over 10 ms, far below a millimetre.
    assert np.cumsum(0.005 * (in_tank[1:] + in_tank[:-1])) == pytest.approx(x[1:] - x[0], abs=2e-4)
    assert x[-1] > 0.2
    largest = max(abs(m.position[0]) for m in fish.received(topics.JOINT_STATES))
    assert largest == pytest.approx(math.radians(15.0), rel=1e-3)


def test_drag_by_amplitude_and_a_current_swim_as_in_the_command(fish: PlantTester) -> None:
    """Both while the node runs: the drag follows the gait, a small one's coefficient is half as much more."""
    water = Water(PAPER_FISH.water.density, 1.0, 8.0, 0.02, -0.01)
    given = {name: getattr(water, name) for name in ("normal_drag", "oscillating_drag", "current_x", "current_y")}
    assert fish.set_parameters({**QUICK, **{f"water.{name}": value for name, value in given.items()}}).successful
    fish.swim(carangiform(math.radians(5.0), 0.9), seconds=0.5)
    fish.stop_swimming()
    assert fish.request_reset().success
    since = fish.swim(PAPER_GAIT, seconds=3.0)
    velocity = [m for m in fish.received(topics.VELOCITY) if nanoseconds_of(m.header.stamp) >= since][:301]
    expected = swim(Fin(), replace(PAPER_FISH, water=water), PAPER_GAIT, 3.0)
    assert [m.twist.linear.x for m in velocity] == pytest.approx(expected.surge, abs=2e-5)
    assert [m.twist.linear.y for m in velocity] == pytest.approx(expected.sway, abs=2e-5)


def test_a_weak_servo_swims_as_in_the_command_and_joint_states_tell_where_it_really_is(fish: PlantTester) -> None:
    motor = Motor(3e-4, 7.0, 10.0, 0.02, 0.02)
    given = FIN.as_parameters() | {f"servo.{name}": value for name, value in vars(motor).items()}
    assert fish.set_parameters({**QUICK, **given}).successful
    since = fish.swim(PAPER_GAIT, seconds=3.0)
    joints = [m for m in fish.received(topics.JOINT_STATES) if nanoseconds_of(m.header.stamp) >= since][:301]
    expected = swim(FIN, replace(PAPER_FISH, motor=motor), PAPER_GAIT, 3.0, sample_time=0.01)
    assert [m.position[0] for m in joints] == pytest.approx(expected.joint_angles[:, 0], abs=1e-6)
    assert [m.velocity[0] for m in joints] == pytest.approx(expected.joint_rates[:, 0], abs=1e-5)
    assert [m.effort[0] for m in joints] == pytest.approx(expected.joint_torques[:, 0], abs=1e-8)
    commanded = math.radians(15.0) * np.sin(2.0 * math.pi * 0.9 * expected.time)
    assert np.abs(expected.joint_angles[100:, 0] - commanded[100:]).max() > 0.03


def test_a_swim_repeats_bit_for_bit_after_a_reset(fish: PlantTester) -> None:
    assert fish.set_parameters(QUICK).successful
    runs = []
    for _ in range(2):
        assert fish.request_reset().success
        since = fish.swim(PAPER_GAIT, seconds=3.0)
        after = [m for m in fish.received(topics.VELOCITY) if nanoseconds_of(m.header.stamp) > since]
        runs.append([m.twist.linear.x for m in after[:300]])
        fish.stop_swimming()
    assert runs[0] == runs[1]


def test_in_real_time_the_stamps_follow_the_wall_clock(start: Callable[..., Any], client: PlantTester) -> None:
    start_simulator(start)
    client.wait_for_state(State.READY)
    late = math.inf
    deadline = time.monotonic() + 120.0
    # On a busy machine a swim may lose time, which it does not make up for; the next one begins on time again.
    while late > 0.2e9:
        assert time.monotonic() < deadline, f"the stamps are {late / 1e9} s late in every swim"
        client.swim(PAPER_GAIT, seconds=1.5)
        lags = [arrival - nanoseconds_of(m.header.stamp) for arrival, m in client.arrivals(topics.VELOCITY)]
        late = float(np.median(lags[-100:]))
        assert min(lags) > -CLOCK_STEP, "ahead of the wall clock"
        client.stop_swimming()


def test_a_bad_parameter_is_refused_with_its_name_value_and_range_and_nothing_changes(fish: PlantTester) -> None:
    before = fish.wait_for_state(State.READY)
    bad: tuple[tuple[dict[str, Any], tuple[str, ...]], ...] = (
        ({"fin.young_modulus": -1.0}, ("fin.young_modulus", "-1.0", "10000000")),
        ({"fin.young_modulus": math.nan}, ("fin.young_modulus", "nan", "10000000")),
        ({"fin.length": 0.01, "fin.thickness": 0.015}, ("fin.thickness", "0.015", "fin.length")),
        ({"fin.yung": 1.0}, ("fin.yung", "not a parameter")),
        ({"fin.hinges": "soft"}, ("fin.hinges", "soft", "between")),
        ({"sample_rate": 50.0}, ("sample_rate",)),
    )
    for change, words in bad:
        result = fish.set_parameters({"fin.height": 0.03, **change})
        assert not result.successful, change
        for word in words:
            assert word in result.reason
        assert fish.get_parameter("fin.height") == 0.025, change
        assert fish.state() == before, change


def test_a_modulus_is_taken_as_people_type_it(fish: PlantTester) -> None:
    for typed in (2_000_000_000, "2.1e9"):  # what `ros2 param set` makes of 2000000000 and of 2.1e9
        assert fish.set_parameters({"fin.young_modulus": typed}).successful
        assert fish.get_parameter("fin.young_modulus") == float(typed)
    assert fish.set_parameters({"fin.segments": 4.0}).successful
    assert fish.get_parameter("fin.segments") == 4
    refused = fish.set_parameters({"fin.young_modulus": "stiff"})
    assert not refused.successful
    assert "fin.young_modulus must be a number, got 'stiff'" in refused.reason


def reached(fish: PlantTester, topic: topics.Topic[Any], count: int) -> bool:
    return len(fish.received(topic)) >= count


def test_a_swim_begins_anew_with_another_fish_but_not_with_another_pace(fish: PlantTester) -> None:
    assert fish.set_parameters(PATIENT).successful
    fish.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    begin = fish.wait_for_state(State.SWIMMING).stamp
    for values, same in (({"speed": 2.0, "command_timeout": 9.0}, True), ({"fin.density": 1100.0}, False)):
        told = len(fish.received(topics.PLANT_STATE)) + 1
        assert fish.set_parameters(values).successful
        fish.wait_until(partial(reached, fish, topics.PLANT_STATE, told), "the state said again")
        state = fish.state()
        assert state is not None
        assert state.state is State.SWIMMING
        assert (state.stamp == begin) is same


def test_a_new_fin_is_built_and_announced(fish: PlantTester) -> None:
    before = fish.wait_for_state(State.READY)
    assert fish.set_parameters({"fin.young_modulus": 2.5e9, "fin.segments": 5}).successful
    fish.wait_until(lambda: fish.state() != before, "plant_state after the new fin")
    state = fish.state()
    assert state is not None
    assert (state.fin["fin.young_modulus"], state.fin["fin.segments"]) == ("2500000000.0", "5")
    assert state.stamp > before.stamp
    fish.wait_until(
        lambda: len(fish.received(topics.JOINT_STATES)[-1].name) == 6,
        "joint_states of the five-segment fin",
    )


def test_a_peduncle_is_set_list_by_list_while_the_fish_swims_on_without_it(fish: PlantTester) -> None:
    fish.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    fish.wait_for_state(State.SWIMMING)
    peduncle = {"length": 0.03, "root_height": 0.03, "tip_height": 0.02, "mass_per_area": 1.0}
    for name, value in peduncle.items():
        assert len(fish.received(topics.JOINT_STATES)[-1].name) == 1 + HINGES
        assert fish.set_parameters({f"peduncle.{name}": [value]}).successful
        awaited = name != "mass_per_area"
        fish.wait_until(
            lambda: (s := fish.state()) is not None and ("peduncle.mass_per_area 0" in s.reason) is awaited,  # noqa: B023
            "the state with what is awaited",
        )
    fish.wait_until(
        lambda: len(fish.received(topics.JOINT_STATES)[-1].name) == 2 + HINGES, "joint_states of the longer tail"
    )


@pytest.mark.parametrize("parameter", ["fin.thickness:=0.5", "fin.young_modulus:=.nan", "fin.yung:=1.0"])
def test_a_bad_start_value_ends_the_process_with_2_and_says_why(
    start: Callable[..., Any], ros_domain: int, parameter: str
) -> None:
    process = start_simulator(start, parameter)
    assert process.wait(timeout=20) == 2
    assert parameter.split(":=", maxsplit=1)[0] in process.output()


def test_an_argument_that_is_none_starts_no_node(start: Callable[..., Any]) -> None:
    process = start("fin_sim", "simulator", "--bogus")
    assert process.wait(timeout=20) == 2
    assert "--ros-args -p PARAMETER:=VALUE" in process.output()


def test_a_gait_that_is_refused_moves_nothing_and_does_not_feed_the_watchdog(fish: PlantTester) -> None:
    bad = gait_message([[math.nan, 0.9, 0.0, 0.0]])
    fish.wait_until(lambda: fish.diagnostic("gaits_refused"), "diagnostics")
    before = int(fish.diagnostic("gaits_refused") or 0)
    for count in (before + 1, before + 2):
        fish.publish_gait(bad)
        fish.wait_until(lambda count=count: fish.diagnostic("gaits_refused") == str(count), f"{count} refusals")  # type: ignore[misc]
    state = fish.state()
    assert state is not None
    assert state.state is State.READY
    assert "gait amplitude = nan" in str(fish.diagnostic("last_refusal"))


def test_without_a_fresh_gait_the_tail_returns_to_neutral(fish: PlantTester) -> None:
    fish.publish_gait(gait_message(PAPER_GAIT.rows()))
    fish.wait_for_state(State.SWIMMING)
    state = fish.wait_for_state(State.READY)
    assert "command_timeout" in state.reason
    fish.wait_until(lambda: fish.received(topics.JOINT_STATES)[-1].position[0] == 0.0, "the driven joint at neutral")


def test_a_gait_beyond_the_limits_is_limited_and_reported_so(fish: PlantTester) -> None:
    fish.publish_gait(gait_message([[1.0, 50.0, 0.0, 0.1]]), repeat=True)
    fish.wait_for_state(State.SWIMMING)
    fish.wait_until(lambda: fish.received(topics.GAIT_APPLIED)[-1].data[0] > 0.0, "gait_applied")
    amplitude, frequency, _, bias = fish.received(topics.GAIT_APPLIED)[-1].data
    assert amplitude + bias == pytest.approx(math.radians(15.0))
    assert (frequency, bias) == (5.0, 0.1)


def test_a_fold_that_only_too_long_a_step_sees_is_none(start: Callable[..., Any], client: PlantTester) -> None:
    # Worked out finely it bends by 87 degrees: swim --amplitude 85.94 --frequency 20 --fin.young_modulus 2.947e9.
    limits = ("limits.sweep:=1.5", "limits.frequency:=20.0", "drive.ramp_time:=0.02")
    start_simulator(start, *limits, "step:=0.01", "fin.young_modulus:=2.947e9", "command_timeout:=10.0")
    client.wait_for_state(State.READY)
    client.swim(PAPER_GAIT, 1.0)
    client.swim(Gait((JointDrive(1.5, 20.0),)), 3.0)
    state = client.state()
    assert state is not None
    assert state.state is State.SWIMMING, state
    assert float(client.diagnostic("largest_hinge_angle") or "nan") < 1.6


def test_a_fin_that_folds_is_a_fault_with_its_angle_and_reset_clears_it(
    start: Callable[..., Any], client: PlantTester
) -> None:
    # A short, high fin without mass: steps of 0.01 and 0.0025 s fail, and a shorter one finds that it folds.
    process = start_simulator(start, *FLUTTERING)
    client.wait_for_state(State.READY)
    client.publish_gait(gait_message([[1.5, 2.4, 0.0, 0.0]]), repeat=True)
    state = client.wait_for_state(State.FAULT)
    assert "degrees, more than 180" in state.reason
    process.wait_for_output("step shortened")
    assert plant_state_from_message(client.received(topics.PLANT_STATE)[-1]).state is State.FAULT
    client.publish_gait(None)
    assert client.request_reset().success
    client.wait_for_state(State.READY)


FLUTTERING = (
    "speed:=0.0",
    "command_timeout:=10.0",
    "step:=0.01",
    "limits.sweep:=1.5",
    "fin.length:=0.0067",
    "fin.height:=0.368",
    "fin.tip_height:=0.0",
    "fin.young_modulus:=2.4e7",
    "fin.segments:=5",
    "fin.thickness:=4.54e-5",
    "fin.density:=0.0",
    "fin.damping_time:=0.0",
)


IN_THE_PLANE = (
    "water.preset:=bht",
    "fin.segments:=3",
    "fin.hinges:=between",
    "fin.thickness:=2.08e-4",
    "speed:=0.0",
    "command_timeout:=10.0",
)


def test_in_a_plane_ideal_flow_the_fish_swims_and_a_fold_beyond_its_table_is_a_fault(
    start: Callable[..., Any], client: PlantTester
) -> None:
    start_simulator(start, *IN_THE_PLANE, "fin.young_modulus:=3.0e9", "fin.damping_time:=0.1")
    assert client.wait_for_state(State.READY).details[TELLS] == SERVO_TORQUE
    since = client.swim(PAPER_GAIT, 3.0)
    poses = [pose for pose in client.received(topics.POSE) if nanoseconds_of(pose.header.stamp) >= since]
    assert max(abs(pose.pose.position.x) for pose in poses) > 1e-4
    client.stop_swimming()
    assert client.set_parameters({"fin.young_modulus": 1.33e9, "fin.damping_time": 0.0}).successful
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    state = client.wait_for_state(State.FAULT)
    assert "the plane flow holds from -1.2 to 1.2 rad" in state.reason


def test_an_emergency_stop_is_latched_and_only_its_release_leads_on(fish: PlantTester) -> None:
    fish.swim(PAPER_GAIT, seconds=0.5)
    assert fish.emergency_stop(on=True).success
    stopped = fish.wait_for_state(State.FAULT)
    assert stopped.reason == EMERGENCY
    assert stopped.waits_for_people  # so an optimiser waits
    answer = fish.request_reset()
    assert not answer.success
    assert answer.message == EMERGENCY
    fish.publish_gait(gait_message(PAPER_GAIT.rows()))
    fish.spin(0.2)
    assert fish.wait_for_state(State.FAULT).stamp == stopped.stamp
    assert fish.emergency_stop(on=False).success
    assert not fish.wait_for_state(State.READY).waits_for_people
