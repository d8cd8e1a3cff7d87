"""What the optimiser makes of a plant's words and of the graph, with time handed in and a graph that the test holds."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from rcl_interfaces.msg import (
    ListParametersResult,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParametersAtomically
from rclpy.task import Future
from std_srvs.srv import Trigger

from fin_optimizer.trial.facts import Reply
from fin_optimizer.trial.plant_client import PlantClient
from fin_plant.gait import PAPER_GAIT, Gait
from fin_plant.messages import gait_message, plant_state_message
from fin_plant.plant_state import PlantState, State

if TYPE_CHECKING:
    from collections.abc import Callable

STILL = Gait.from_rows([[0.0, 0.9, 0.0, 0.0]])


@dataclass(eq=False)
class Service:
    """A client."""

    service_name: str
    kind: type
    call_async: Callable[[Any], Future]
    lacking: set[str]

    def service_is_ready(self) -> bool:
        return self.service_name.rpartition("/")[2] not in self.lacking


class Graph:
    """A node's view of ROS: who is there is set by the test, what is asked is answered when the test says so."""

    def __init__(self) -> None:
        self.publishers: list[Any] = []
        self.looks = 0
        self.asked: list[tuple[str, Any, Future]] = []
        self.hears: dict[str, Callable[[Any], None]] = {}
        self.waiting: list[Any] = []
        self.sent: list[Any] = []
        self.lacking = {"request_reset"}

    def create_publisher(self, *_: object) -> Any:
        return SimpleNamespace(publish=self.sent.append, wait_for_all_acked=lambda _: True)

    def create_subscription(self, _: type, name: str, hear: Callable[[Any], None], __: object) -> Any:
        self.hears[name.rpartition("/")[2]] = hear
        take = SimpleNamespace(take_message=lambda *_: (self.waiting.pop(0), None) if self.waiting else None)
        return SimpleNamespace(topic_name=name, handle=take)

    def create_client(self, kind: type, name: str) -> Any:
        def call(request: Any) -> Future:
            self.asked.append((name, request, Future()))
            return self.asked[-1][2]

        return Service(name, kind, call, self.lacking)

    def destroy_client(self, _: object) -> None:
        pass

    def get_publishers_info_by_topic(self, _: str) -> list[Any]:
        self.looks += 1
        return self.publishers

    def get_logger(self) -> Any:
        return SimpleNamespace(error=lambda _: None)

    def appear(self, name: str, identity: int) -> None:
        self.publishers = [SimpleNamespace(node_name=name, node_namespace="/fish", endpoint_gid=[identity])]


@pytest.fixture
def graph() -> Graph:
    return Graph()


@pytest.fixture
def client(graph: Graph) -> PlantClient:
    return PlantClient(cast("Any", graph), "/fish")


def connected(graph: Graph, client: PlantClient) -> PlantClient:
    graph.appear("simulator", 1)
    client.look(0.0)
    client.missing_services()
    return client


def answer(graph: Graph, index: int, response: Any) -> None:
    future = graph.asked[index][2]
    future.set_result(response)
    for callback in future._callbacks:  # no executor has a part in it
        callback(future)


def test_the_graph_is_looked_at_every_50_ms_at_most(graph: Graph, client: PlantClient) -> None:
    for millisecond in range(0, 201, 10):
        client.look(millisecond / 1000)
    assert graph.looks == pytest.approx(5, abs=1)


def test_a_plant_that_is_started_anew_has_its_name_and_another_id(graph: Graph, client: PlantClient) -> None:
    connected(graph, client)
    before = client.publishers
    graph.appear("simulator", 2)
    client.look(1.0)
    assert client.plants == ["/fish/simulator"]
    assert not client.publishers & before


def test_a_service_that_is_not_there_is_named(graph: Graph, client: PlantClient) -> None:
    connected(graph, client)
    assert client.missing_services() == ["/fish/simulator/request_reset"]
    graph.publishers *= 2
    graph.publishers[1] = SimpleNamespace(node_name="driver", node_namespace="/fish", endpoint_gid=[9])
    client.look(1.0)
    assert client.missing_services() == [], "of two plants it is not known which to ask"


def test_an_answer_to_an_earlier_question_is_none_to_the_last(graph: Graph, client: PlantClient) -> None:
    connected(graph, client)
    for modulus in (1e9, 2e9):
        client.set_fin({"fin.young_modulus": modulus})
    late = SetParametersAtomically.Response(result=SetParametersResult(successful=False, reason="the first"))
    answer(graph, 0, late)
    assert client.fin_reply is None
    answer(graph, 1, SetParametersAtomically.Response(result=SetParametersResult(successful=True)))
    assert client.fin_reply == Reply(accepted=True)
    assert client.changed


NAMES = ListParameters.Response(result=ListParametersResult(names=["body.mass"]))
DESCRIPTIONS = DescribeParameters.Response(descriptors=[ParameterDescriptor(name="body.mass", description="kg")])
VALUES = GetParameters.Response(values=[ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.3)])


def test_a_question_that_changes_nothing_is_asked_again_until_it_is_answered(graph: Graph, client: PlantClient) -> None:
    connected(graph, client).ask_parameters()
    answer(graph, 0, NAMES)
    for tenth in range(101):
        client.look(1.0 + tenth / 10.0)
    asked = [name.rpartition("/")[2] for name, *_ in graph.asked]
    assert asked == ["list_parameters", *(["describe_parameters"] * 6)], "at once, and every 2 s of 10 s"
    answer(graph, 2, DESCRIPTIONS)  # a late answer to an earlier asking counts
    assert graph.asked[-1][0].endswith("get_parameters")
    answer(graph, 6, DescribeParameters.Response())
    answer(graph, 7, VALUES)
    assert client.parameters == {"body.mass": 0.3}
    client.look(60.0)
    assert len(graph.asked) == 8, "what was answered is asked no more"


def test_a_question_to_a_service_that_is_not_found_yet_waits_for_it(graph: Graph, client: PlantClient) -> None:
    graph.lacking.add("list_parameters")
    connected(graph, client).ask_parameters()
    client.look(1.0)
    assert graph.asked == []
    graph.lacking.clear()
    client.look(1.1)
    assert [name for name, *_ in graph.asked] == ["/fish/simulator/list_parameters"]


def test_what_changes_a_plant_is_asked_once(graph: Graph, client: PlantClient) -> None:
    connected(graph, client).set_fin({"fin.young_modulus": 1e9})
    client.request_reset()
    for second in range(1, 20):
        client.look(float(second))
    assert len(graph.asked) == 2


def test_a_reset_that_is_refused_says_why(graph: Graph, client: PlantClient) -> None:
    connected(graph, client).request_reset()
    answer(graph, 0, Trigger.Response(success=False, message="disarmed"))
    assert client.reset_reply == Reply(accepted=False, reason="disarmed")


def test_what_is_no_state_keeps_the_last_one_and_is_told(graph: Graph, client: PlantClient) -> None:
    message = plant_state_message(PlantState(State.READY, "simulator", 5))
    graph.hears["plant_state"](message)
    message.message = "HUNGRY"
    graph.hears["plant_state"](message)
    assert client.state is not None
    assert client.state.state is State.READY
    assert "HUNGRY" in client.unreadable


def test_who_leaves_waits_for_the_start_of_a_gait_just_sent_and_for_the_tails_rest(
    graph: Graph, client: PlantClient
) -> None:
    connected(graph, client)
    said = {0.2: State.SWIMMING, 7.0: State.READY}
    now = 0.0

    def pause(seconds: float) -> None:
        nonlocal now
        before, now = now, now + seconds
        due = [state for at, state in said.items() if before < at <= now]
        graph.waiting += [plant_state_message(PlantState(state, "simulator", 1)) for state in due]

    client.send(PAPER_GAIT)
    client.send(STILL)
    client.farewell(lambda: now, pause)
    assert now == pytest.approx(7.0, abs=0.01)
    client.farewell(lambda: now, pause)
    assert now == pytest.approx(7.0, abs=0.01), "a tail at rest is waited for by nobody"


def test_a_plant_that_never_rests_is_waited_for_12_s_and_one_that_is_gone_not_at_all(
    graph: Graph, client: PlantClient
) -> None:
    connected(graph, client)
    now = 0.0

    def pause(seconds: float) -> None:
        nonlocal now
        now += seconds

    graph.hears["plant_state"](plant_state_message(PlantState(State.SWIMMING, "simulator", 1)))
    client.farewell(lambda: now, pause)
    assert now == pytest.approx(12.0, abs=0.02)
    graph.publishers = []
    client.farewell(lambda: now, pause)
    assert now == pytest.approx(12.0, abs=0.1), "gone at the next look at the graph"


def test_the_gait_that_the_plant_follows_is_noted(graph: Graph, client: PlantClient) -> None:
    graph.hears["gait_applied"](gait_message(PAPER_GAIT.rows()))
    assert client.applied is not None
    assert client.applied.same_as(PAPER_GAIT, 1e-12)
