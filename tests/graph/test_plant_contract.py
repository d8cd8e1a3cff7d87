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
from rcl_interfaces.srv import DescribeParameters, GetParameters
from rclpy.parameter import parameter_value_to_python
from std_msgs.msg import Float64MultiArray

from fin_plant import topics
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS
from fin_plant.frames import Frames
from fin_plant.gait import PAPER_GAIT, Gait, carangiform
from fin_plant.messages import as_text, gait_from_message, gait_message, nanoseconds_of
from fin_plant.plant_state import EMERGENCY, RELEASE, SERVO_TORQUE, THRUST, State
from fin_servo_driver.emulator.devices import Firmata
from support.domains import locked_domain
from support.plant_tester import GAIT_PERIOD
from support.processes import StartedProcess, start_executable, workspace_environment
from support.robot_client import ACTIVATE, CONFIGURE, RobotClient, plugged_in
from support.steady import on_time

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from numpy.typing import NDArray

    from fin_plant.plant_state import PlantState

pytestmark = pytest.mark.graph
STREAMS = (topics.JOINT_STATES, topics.POSE, topics.VELOCITY)
"""What every plant offers; thrust is the simulator's alone."""
FIN = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
COMMAND_TIMEOUT = {"command_timeout": PLANT_PARAMETERS["command_timeout"].default}
"""As a plant comes."""
PROFILE = {"fin.profile_position": [0.25, 0.5], "fin.profile_height": [0.02, 0.03]}
STRAIGHT: dict[str, Any] = {name: [] for name in PROFILE}


class ContractClient(RobotClient):
    """A client that also plays the operator where the plant has nobody else."""

    def __init__(self, domain: int, plant: str, *, operator: bool) -> None:
        super().__init__(domain)
        self._plant = plant
        self.operator = operator

    def lead_to(self, wanted: Callable[[PlantState], object], what: str) -> None:
        """Do what an operator would do, where nobody else does, until the plant is READY and as it is wanted."""

        def reached() -> bool:
            state = self.state()
            if state is not None and self.operator:
                self._answer(state.details.get("waiting_for", ""))
            return state is not None and state.state is State.READY and bool(wanted(state))

        self.wait_until(reached, what)

    def _answer(self, waiting: str) -> None:
        """Do what a robot waits for; it may have come to wait for something else meanwhile."""
        if waiting == "configuring":
            self.change_state(CONFIGURE)
        elif waiting == "fin":
            self.confirm_fin()
        elif waiting == "arming":
            self.change_state(ACTIVATE)
        elif waiting == "mark":
            self.confirm_mark()

    def set_fin(self, fin: Mapping[str, Any]) -> None:
        """Have this fin mounted, and wait until the plant is ready with it and waits for no other value."""
        assert self.set_parameters(fin).successful
        wanted = {name: as_text(value) for name, value in fin.items()}
        self.lead_to(
            lambda state: (
                {name: state.fin[name] for name in wanted} == wanted
                and not any(name in state.reason for name in PROFILE)
            ),
            f"READY with {wanted}",
        )

    def put_back(self) -> int:
        """Bring the fish to its start, as a trial does; return the stamp before."""
        before = self.wait_for_state(State.READY).stamp
        assert self.request_reset().success
        self.lead_to(lambda state: state.stamp > before, "READY at the start")
        return before

    def recover(self) -> None:
        """Bring the plant to rest with the fin that it starts with, whatever a test has left behind."""
        self.publish_gait(None)
        state = self.state()
        if state is not None and state.state is State.FAULT:
            assert self.emergency_stop(on=False).success
            self.request_reset()
        if self.values_of(COMMAND_TIMEOUT) != COMMAND_TIMEOUT:
            assert self.set_parameters(COMMAND_TIMEOUT).successful
        if self.values_of(FIN) != FIN:
            self.set_fin(FIN)
        self.lead_to(lambda _: True, "READY")

    def values_of(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the values of parameters."""
        names = list(names)
        answer = self._call(GetParameters, "get_parameters", GetParameters.Request(names=names))
        values = (parameter_value_to_python(value) for value in answer.values)
        return {name: list_or_value(value) for name, value in zip(names, values, strict=True)}

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
        client.lead_to(lambda _: True, "READY")
        yield kind, client
        complaints = [complaint for process in reversed(started) for complaint in process.end()]
        assert complaints == []


def list_or_value(value: Any) -> Any:
    """Return an array parameter's value as a list, others as they are."""
    return list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value


@pytest.fixture
def plant(running: tuple[PlantKind, ContractClient]) -> tuple[PlantKind, ContractClient]:
    """Return the plant at rest, with the fin that it starts with."""
    running[1].recover()
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


def settled(stamps: NDArray[np.int64], angles: NDArray[np.float64], since: int, rate: float) -> NDArray[np.bool_]:
    """Return which samples show how the gait of a swim is followed, shape (n,).

    Those that came on time, after the ramp of 0.5 s, which counts from when the gait was taken.

    Args:
        stamps: Of successive samples in ns, shape (n,).
        angles: Of the driven joint in rad, shape (n,).
        since: The swim's stamp in ns.
        rate: Samples a second.
    """
    moving = stamps[(stamps >= since) & (angles != 0.0)]
    if moving.size == 0:
        return np.zeros(stamps.shape, dtype=np.bool_)
    inside: NDArray[np.bool_] = stamps > moving[0] + 700_000_000
    return inside & on_time(stamps, rate)


def test_a_swim_is_one_of_the_contract_from_reset_to_rest(plant: Plant) -> None:
    kind, client = plant
    # The swim is whole where the machine puts aside the test that commands it.
    assert client.set_parameters({"command_timeout": 10.0}).successful
    client.put_back()
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    since = client.wait_for_state(State.SWIMMING).stamp

    def tail() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        told = client.received(topics.JOINT_STATES)
        return stamps_of(client, topics.JOINT_STATES), np.array([message.position[0] for message in told])

    def swum() -> bool:
        newest = [nanoseconds_of(client.received(topic)[-1].header.stamp) for topic in STREAMS]
        return min(newest) > since + 4_000_000_000 and bool(settled(*tail(), since, kind.rate).sum() > kind.rate)

    client.wait_until(swum, "4 s of swimming, a second of it on time")
    stamps, angles = tail()
    expected = math.radians(15.0) * np.sin(2.0 * math.pi * 0.9 * (stamps - since) / 1e9)
    off = np.abs(angles - expected)[settled(stamps, angles, since, kind.rate)]
    # A set-point that was handed over late shortens a robot's next step; on simulated time test_device_loop.py asks for
    # all, and test_simulator.py for every sample of the simulator.
    assert np.quantile(off, 0.9) < 0.005  # a third of a degree
    client.wait_until(
        lambda: newest_gait(client).joints[0].amplitude == pytest.approx(math.radians(15.0)), "the gait in gait_applied"
    )
    if kind.name != "robot":  # whose fish nobody moves
        forward = [m.twist.linear.x for m in client.received(topics.VELOCITY)][-50:]
        assert 0.01 < np.mean(forward) < 0.08
    client.stop_swimming()
    client.wait_until(lambda: not newest_gait(client).moves, "gait_applied of no amplitude")


def newest_gait(client: ContractClient) -> Gait:
    return gait_from_message(client.received(topics.GAIT_APPLIED)[-1])


def test_the_gait_applied_is_inside_the_limits(plant: Plant) -> None:
    _, client = plant
    client.publish_gait(gait_message(carangiform(1.0, 0.9).rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    client.wait_until(lambda: newest_gait(client).moves, "gait_applied")
    assert newest_gait(client).joints[0].amplitude == pytest.approx(math.radians(15.0))


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
    client.wait_until(lambda: client.diagnostic("last_refusal"), "the refusal's reason")
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
    client.set_fin({"fin.young_modulus": 2.0e9, "fin.length": 0.06})


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
    client.set_fin({second: PROFILE[second]})
    state = client.state()
    assert state is not None
    assert {name: state.fin[name] for name in PROFILE} == {name: as_text(value) for name, value in PROFILE.items()}
    client.set_fin(STRAIGHT)


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
    client.wait_until(lambda: not newest_gait(client).moves, "gait_applied of no amplitude")
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
    client.set_fin({"fin.length": 0.05})
    client.wait_until(lambda: length_of(descriptions[-1].data) == pytest.approx(0.05), "the new fin's description")


def length_of(text: str) -> float:
    """Return the length in m of the fin that is described, which may be of several links."""
    return sum(joint.size[0] for joint in Frames.from_urdf(text).joints)
