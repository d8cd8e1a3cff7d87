"""One contract, every plant: the same assertions against simulator, rehearsal, and robot with an emulated device."""

from __future__ import annotations

import contextlib
import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters
from std_msgs.msg import Float64MultiArray

from fin_plant import topics
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS
from fin_plant.frames import Frames
from fin_plant.gait import PAPER_GAIT, carangiform
from fin_plant.messages import gait_from_message, gait_message, nanoseconds_of
from fin_plant.plant_state import EMERGENCY, RELEASE, SERVO_TORQUE, THRUST, State
from fin_servo_driver.emulator.devices import Firmata
from support.domains import locked_domain
from support.plant_tester import GAIT_PERIOD
from support.processes import StartedProcess, start_executable, workspace_environment
from support.robot_client import ACTIVATE, RobotClient, plugged_in
from support.steady import on_time

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

pytestmark = pytest.mark.graph
STREAMS = (topics.JOINT_STATES, topics.POSE, topics.VELOCITY)
"""What every plant offers; thrust is the simulator's alone."""


class ContractClient(RobotClient):
    """A client that also plays the operator where the plant has nobody else."""

    def __init__(self, domain: int, plant: str, *, operator: bool) -> None:
        super().__init__(domain)
        self._plant = plant
        self.operator = operator

    def _call(self, service_type: Any, name: str, request: Any) -> Any:
        self._told = len(self.arrivals(topics.PLANT_STATE))
        return super()._call(service_type, name, request)

    def become_ready(self) -> None:
        """Wait for READY, doing what an operator would do."""
        if self.operator:
            self.configure()
            self.settle()
            assert self.change_state(ACTIVATE), self.reason()
        self.wait_for_state(State.READY)

    def settle(self) -> None:
        """Confirm what the plant waits for, and wait until it is ready or needs to be armed."""
        if not self.operator:
            self.wait_for_state(State.READY)
            return
        self.wait_until(lambda: len(self.arrivals(topics.PLANT_STATE)) > self._told, "the state after what was asked")
        state = self.state()
        if state is not None and state.state is State.WAITING_FOR_FIN:
            assert self.confirm_fin().success
        elif state is not None and state.details.get("waiting_for") == "mark":
            assert self.confirm_mark().success

    def put_back(self) -> int:
        """Bring the fish to its start, as a trial does; return the stamp before."""
        before = self.wait_for_state(State.READY).stamp
        assert self.request_reset().success
        self.settle()
        self.wait_until(
            lambda: (s := self.state()) is not None and s.state is State.READY and s.stamp > before, "READY"
        )
        return before

    def publishers(self, topic: topics.Topic[Any]) -> list[Any]:
        """Return who publishes a topic."""
        name = self._node.resolve_topic_name(topic.name)
        return list(self._node.get_publishers_info_by_topic(name))

    def describe(self, names: list[str]) -> list[Any]:
        """Return the descriptors of parameters."""
        answer = self._call(DescribeParameters, "describe_parameters", DescribeParameters.Request(names=names))
        return list(answer.descriptors)


@dataclass(frozen=True)
class PlantKind:
    """A plant as a test starts it."""

    name: str
    node: str
    rate: float


KINDS = (
    PlantKind("simulator", "simulator", 100.0),
    PlantKind("rehearsal", "servo_driver", 50.0),
    PlantKind("robot", "servo_driver", 50.0),
)


@pytest.fixture(params=KINDS, ids=lambda kind: kind.name, scope="module")
def running(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[PlantKind, ContractClient]]:
    """Start a plant once for all tests of this file, and yield it ready, with its client."""
    kind = request.param
    folder = tmp_path_factory.mktemp(kind.name)
    started: list[StartedProcess] = []
    with locked_domain() as domain, contextlib.ExitStack() as stack:
        environment = workspace_environment() | {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder)}

        def start(package: str, executable: str, *parameters: str) -> None:
            words = [word for parameter in parameters for word in ("-p", parameter)]
            arguments = ["--ros-args", *words] if words else []
            log = folder / f"{executable}.log"
            started.append(
                start_executable(package, executable, *arguments, log=log, environment=environment, folder=folder)
            )

        client = stack.enter_context(ContractClient(domain, kind.node, operator=kind.name == "robot"))
        if kind.name == "simulator":
            start("fin_sim", "simulator")
        elif kind.name == "rehearsal":
            start("fin_servo_driver", "rehearsal")
            start("fin_servo_driver", "servo_driver", "plant:=rehearsal")
        else:
            port = stack.enter_context(plugged_in(Firmata(), folder))
            # The tracker and the fish of this robot are a rehearsal's, whose own device nobody opens.
            start("fin_servo_driver", "rehearsal", "operator.acts:=false")
            start("fin_servo_driver", "servo_driver", "robot_file:=firmata", f"port:={port.path}")
        if kind.name != "simulator":
            start("fin_servo_driver", "velocity_estimator")
        client.become_ready()
        yield kind, client
        complaints = [complaint for process in reversed(started) for complaint in process.end()]
        assert complaints == []


def list_or_value(value: Any) -> Any:
    """Return an array parameter's value as a list, others as they are."""
    return list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value


@pytest.fixture
def plant(running: tuple[PlantKind, ContractClient]) -> tuple[PlantKind, ContractClient]:
    """Return the plant at rest, with the fin that it starts with."""
    _, client = running
    client.publish_gait(None)
    state = client.state()
    assert state is not None
    if state.state is State.SWIMMING:
        client.wait_for_state(State.READY)
    defaults = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
    if any(list_or_value(client.get_parameter(name)) != value for name, value in defaults.items()):
        assert client.set_parameters(defaults).successful
        client.settle()
    client.wait_for_state(State.READY)
    return running


Plant = tuple[PlantKind, ContractClient]


def test_topics_have_the_names_types_and_qualities_of_the_contract(plant: Plant) -> None:
    _, client = plant
    for topic in (*STREAMS, topics.PLANT_STATE, topics.GAIT_APPLIED, topics.DIAGNOSTICS):
        client.wait_until(functools.partial(client.publishers, topic), f"publisher of {topic.name}")
        for publisher in client.publishers(topic):
            assert publisher.topic_type == topic.type_name
            assert publisher.qos_profile.reliability == topic.qos.reliability
            assert publisher.qos_profile.durability == topic.qos.durability
    assert len(client.publishers(topics.PLANT_STATE)) == 1


def test_parameters_of_fin_and_limits_are_described_alike(plant: Plant) -> None:
    _, client = plant
    types = {
        "double": ParameterType.PARAMETER_DOUBLE,
        "integer": ParameterType.PARAMETER_INTEGER,
        "string": ParameterType.PARAMETER_STRING,
        "double_array": ParameterType.PARAMETER_DOUBLE_ARRAY,
    }
    for name, found in zip(PLANT_PARAMETERS, client.describe(list(PLANT_PARAMETERS)), strict=True):
        parameter = PLANT_PARAMETERS[name]
        if parameter.default != []:  # of an empty array rclpy cannot tell the type
            assert found.type == types[parameter.kind], name
        assert found.description.startswith(parameter.description), name
        assert f"[{parameter.unit or '-'}]" in found.description, name


def test_the_state_carries_the_fin_and_a_stamp(plant: Plant) -> None:
    kind, client = plant
    state = client.wait_for_state(State.READY)
    assert state.plant == kind.name
    assert set(state.fin) == set(FIN_PARAMETERS)
    assert float(state.fin["fin.length"]) == 0.08
    assert state.stamp > 0
    # Of a rehearsal the optimiser learns nothing that a robot would not tell.
    assert (state.slowest_pace, state.starts_at_rest) == ((0.01, True) if kind.name == "simulator" else (0.5, False))
    assert state.tells == frozenset((SERVO_TORQUE, THRUST) if kind.name == "simulator" else ())


def test_streams_flow_before_a_swim_at_their_rates_with_frames_and_rising_stamps(plant: Plant) -> None:
    kind, client = plant
    client.wait_until(
        lambda: all(len(client.arrivals(topic)) > 60 for topic in STREAMS), "sixty messages of each stream"
    )
    for topic in STREAMS:
        client.wait_until(lambda topic=topic: on_time(stamps_of(client, topic), kind.rate).sum() > 20, "a busy machine")  # type: ignore[misc]
        stamps = stamps_of(client, topic)
        assert np.all(np.diff(stamps) > 0), topic.name
        steady = np.diff(stamps)[on_time(stamps, kind.rate)[1:]]
        assert 1e9 / np.median(steady) == pytest.approx(kind.rate, rel=0.1), topic.name
    assert client.received(topics.POSE)[-1].header.frame_id == "tank"
    assert client.received(topics.VELOCITY)[-1].header.frame_id == "base_link"
    assert client.received(topics.JOINT_STATES)[-1].name[0] == "tail_joint_1"


def stamps_of(client: ContractClient, topic: topics.Topic[Any]) -> NDArray[np.int64]:
    """Return the stamps of what has come, in ns."""
    return np.array([nanoseconds_of(message.header.stamp) for message in client.received(topic)])


def swim_for_four_seconds(client: ContractClient, rate: float) -> int:
    """Return the stamp of a swim that was not broken off; a client that is put aside may repeat its gait too late.

    It goes on until a second of it came on time, at this rate of samples.
    """

    def goes_on(since: int) -> bool:
        state = client.state()
        return state is not None and state.state is State.SWIMMING and state.stamp == since

    def over(since: int) -> bool:
        end = since + 4_000_000_000
        if not all(nanoseconds_of(client.received(topic)[-1].header.stamp) > end for topic in STREAMS):
            return False
        stamps = stamps_of(client, topics.JOINT_STATES)
        return bool(on_time(stamps[stamps >= since], rate).sum() > rate)

    for _ in range(10):
        since = client.wait_for_state(State.SWIMMING).stamp
        client.wait_until(lambda since=since: over(since) or not goes_on(since), "4 s of swimming")  # type: ignore[misc]
        if goes_on(since):
            return since
    pytest.fail("no swim of ten lasted for 4 s")


def test_a_swim_is_one_of_the_contract_from_reset_to_rest(plant: Plant) -> None:
    kind, client = plant
    client.put_back()
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    since = swim_for_four_seconds(client, kind.rate)
    applied = gait_from_message(client.received(topics.GAIT_APPLIED)[-1])
    assert applied.joints[0].amplitude == pytest.approx(math.radians(15.0))
    joint = [
        (nanoseconds_of(m.header.stamp), m.position[0])
        for m in client.received(topics.JOINT_STATES)
        if nanoseconds_of(m.header.stamp) >= since
    ]
    times = np.array([stamp - since for stamp, _ in joint]) / 1e9
    angles = np.array([angle for _, angle in joint])
    # A gait that is taken late, at most by command_timeout = 0.5 s, is ramped from then on, for 0.5 s.
    settled = (times > 1.2) & on_time([stamp for stamp, _ in joint], kind.rate)
    expected = math.radians(15.0) * np.sin(2.0 * math.pi * 0.9 * times)
    assert np.max(np.abs(angles - expected)[settled]) < 0.005  # a third of a degree
    if kind.name != "robot":  # whose fish nobody moves
        forward = [m.twist.linear.x for m in client.received(topics.VELOCITY)][-50:]
        assert 0.01 < np.mean(forward) < 0.08
    client.stop_swimming()
    client.wait_until(lambda: client.received(topics.GAIT_APPLIED)[-1].data[0] == 0.0, "gait_applied of no amplitude")


def test_the_gait_applied_is_inside_the_limits(plant: Plant) -> None:
    _, client = plant
    client.publish_gait(gait_message(carangiform(1.0, 0.9).rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    client.wait_until(lambda: client.received(topics.GAIT_APPLIED)[-1].data[0] > 0.0, "gait_applied")
    assert client.received(topics.GAIT_APPLIED)[-1].data[0] == pytest.approx(math.radians(15.0))


def test_without_a_fresh_gait_it_comes_to_rest_and_says_why(plant: Plant) -> None:
    _, client = plant
    client.publish_gait(gait_message(PAPER_GAIT.rows()))
    client.wait_for_state(State.SWIMMING)
    state = client.wait_for_state(State.READY)
    assert "command_timeout" in state.reason


@pytest.mark.parametrize("data", [[math.nan, 0.9, 0.0, 0.0], [0.1, 0.9], [], [0.1, 0.9, 0.0, 0.0] * 3, [-0.1, 1, 0, 0]])
def test_a_bad_gait_is_refused_and_counted(plant: Plant, data: list[float]) -> None:
    _, client = plant
    client.wait_until(lambda: client.diagnostic("gaits_refused"), "diagnostics")
    before = int(client.diagnostic("gaits_refused") or 0)
    client.publish_gait(Float64MultiArray(data=[float(value) for value in data]))
    client.wait_until(lambda: int(client.diagnostic("gaits_refused") or 0) > before, "count of refusals")
    assert client.diagnostic("last_refusal")
    state = client.state()
    assert state is not None
    assert state.state is State.READY


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"fin.young_modulus": -1.0}, "fin.young_modulus"),
        ({"fin.length": math.nan}, "fin.length"),
        ({"fin.segments": 0}, "fin.segments"),
        ({"fin.hinges": "sideways"}, "fin.hinges"),
        ({"fin.thickness": 0.02, "fin.height": 0.01}, "fin.thickness"),
        ({"fin.lenght": 0.1}, "fin.length"),
        ({"fin.young_modulus": 2e9, "fin.length": 1e-9}, "fin.length"),
    ],
)
def test_a_bad_fin_is_refused_with_the_reason_and_nothing_changes(
    plant: Plant, values: dict[str, Any], named: str
) -> None:
    _, client = plant
    before = client.wait_for_state(State.READY)
    result = client.set_parameters(values)
    assert not result.successful
    assert named in result.reason
    client.spin(0.2)
    assert client.state() == before
    assert client.get_parameter("fin.young_modulus") == FIN_PARAMETERS["fin.young_modulus"].default


def test_a_fin_is_taken_whole_and_then_in_the_state(plant: Plant) -> None:
    _, client = plant
    fin = {"fin.young_modulus": 2.0e9, "fin.length": 0.06}
    assert client.set_parameters(fin).successful
    client.settle()
    client.wait_until(
        lambda: (
            (s := client.state()) is not None
            and s.state is State.READY
            and {name: float(s.fin[name]) for name in fin} == fin
        ),
        "READY with the new fin",
    )


PROFILE = {"fin.profile_position": [0.25, 0.5], "fin.profile_height": [0.02, 0.03]}
STRAIGHT: dict[str, Any] = {name: [] for name in PROFILE}


def wait_for_fin(client: ContractClient, fin: dict[str, Any]) -> None:
    """Wait until the plant is ready, waits for no other value, and has this fin."""
    client.wait_until(
        lambda: (
            (s := client.state()) is not None
            and s.state is State.READY
            and not any(name in s.reason for name in PROFILE)
            and {name: s.fin[name] for name in fin} == {name: repr(value) for name, value in fin.items()}
        ),
        "READY with the fin",
    )


@pytest.mark.parametrize("order", [("fin.profile_position", "fin.profile_height")[::step] for step in (1, -1)])
def test_a_profile_is_set_in_either_order_and_by_half_it_is_told_and_no_gait_starts(
    plant: Plant, order: tuple[str, str]
) -> None:
    _, client = plant
    before = client.wait_for_state(State.READY)
    first, second = order
    assert client.set_parameters({first: PROFILE[first]}).successful
    client.wait_until(lambda: (s := client.state()) is not None and second in s.reason, "what is awaited")
    state = client.state()
    assert state is not None
    assert (state.state, state.fin) == (State.READY, before.fin)
    client.publish_gait(gait_message(PAPER_GAIT.rows()))
    client.wait_until(lambda: second in (client.diagnostic("last_refusal") or ""), "refusal of the gait")
    state = client.state()
    assert state is not None
    assert state.state is State.READY
    # A list as long as the other one is taken only if a fin can be made of both.
    bad = client.set_parameters({second: [0.6, 7.0]})
    assert not bad.successful
    assert second in bad.reason
    assert client.set_parameters({second: PROFILE[second]}).successful
    client.settle()
    wait_for_fin(client, PROFILE)
    assert client.set_parameters(STRAIGHT).successful
    client.settle()
    wait_for_fin(client, STRAIGHT)


def test_a_reset_is_followed_by_a_state_with_a_later_stamp(plant: Plant) -> None:
    _, client = plant
    before = client.put_back()
    state = client.wait_for_state(State.READY)
    assert state.stamp > before


def test_diagnostics_come_once_a_second_from_the_plant(plant: Plant) -> None:
    kind, client = plant
    name = f"/fish/{kind.node}: plant"

    def once_a_second() -> bool:
        arrivals = [at for at, m in client.arrivals(topics.DIAGNOSTICS) if any(s.name == name for s in m.status)]
        return len(arrivals) >= 3 and bool(np.median(np.diff(arrivals)) == pytest.approx(1e9, rel=0.2))

    client.wait_until(once_a_second, "diagnostics, most of them a second after the ones before")


def test_one_button_stops_every_plant_and_only_its_release_leads_on(plant: Plant) -> None:
    kind, client = plant
    client.put_back()
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    assert client.emergency_stop(on=True).success
    stopped = client.wait_for_state(State.FAULT)
    assert (stopped.reason, stopped.details["waiting_for"]) == (EMERGENCY, RELEASE)
    client.wait_until(lambda: client.received(topics.GAIT_APPLIED)[-1].data[0] == 0.0, "gait_applied of no amplitude")
    refused = int(client.diagnostic("gaits_refused") or 0)
    answer = client.request_reset()
    assert (answer.success, answer.message) == (False, EMERGENCY)
    client.spin(2 * GAIT_PERIOD)  # the gait goes on, and moves nothing
    assert client.state() == stopped
    assert int(client.diagnostic("gaits_refused") or 0) >= refused
    assert client.emergency_stop(on=True).success  # pressed again: nothing changes
    client.publish_gait(None)
    assert client.emergency_stop(on=False).success
    client.wait_until(lambda: (s := client.state()) is not None and s.state is not State.FAULT, "the release")
    if kind.name == "robot":  # where no program but a person says that the fish is back
        state = client.state()
        assert state is not None
        assert (state.state, state.details["waiting_for"]) == (State.WAITING_FOR_RESET, "mark")
        assert client.confirm_mark().success
    client.wait_for_state(State.READY)
    assert client.emergency_stop(on=False).success
    client.wait_for_state(State.READY)


def test_every_plant_describes_its_fish_and_shows_it_anew_with_each_fin(plant: Plant) -> None:
    _, client = plant
    client.put_back()
    heard = [client.listen(topic) for topic in (topics.ROBOT_DESCRIPTION, topics.MARKERS, topics.PATH)]
    descriptions, markers, paths = heard
    client.wait_until(lambda: all(heard), "description, markers and path")
    frames = Frames.from_urdf(descriptions[-1].data)
    assert [joint.name for joint in frames.joints] == client.received(topics.JOINT_STATES)[-1].name
    client.wait_until(lambda: len(markers[-1].markers) == 2 + len(frames.joints), "floor, body and links")
    pose = client.received(topics.POSE)[-1].pose.position
    client.wait_until(lambda: abs(markers[-1].markers[1].pose.position.x - pose.x) < 0.05, "the body at its place")
    assert markers[-1].markers[1].header.frame_id == paths[-1].header.frame_id == "tank"
    assert paths[-1].poses
    assert client.set_parameters({"fin.length": 0.05}).successful
    client.settle()
    client.wait_until(lambda: length_of(descriptions[-1].data) == pytest.approx(0.05), "the new fin's description")


def length_of(text: str) -> float:
    """Return the length in m of the fin that is described, which may be of several links."""
    return sum(joint.size[0] for joint in Frames.from_urdf(text).joints)
