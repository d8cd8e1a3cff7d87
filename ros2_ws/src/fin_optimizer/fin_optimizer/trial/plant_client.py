"""The plant as the optimiser sees it over ROS: its state, its services, and the gait sent to it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParametersAtomically
from rclpy.duration import Duration
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import Trigger

from fin_optimizer.trial.facts import Reply
from fin_plant import topics
from fin_plant.discovery import NAME_TO_COME
from fin_plant.messages import gait_from_message, gait_message, plant_state_from_message
from fin_plant.node_parameters import decides_swim
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.task import Future
    from std_msgs.msg import Float64MultiArray

    from fin_plant.gait import Gait
    from fin_plant.parameters import Value
    from fin_plant.plant_state import PlantState

_ESTIMATOR = "velocity_estimator"
"""Name of the node that turns a tracker's poses into the velocity of a robot."""
_LISTEN_PERIOD = 0.005
_LOOK_PERIOD = 0.05
"""s between two looks at the graph, which take longer than a look at a variable."""
_ARRIVAL = Duration(seconds=0.5)
_ASK_AGAIN = 2.0
"""s after which a question that changes nothing is asked again: of a node that has just been found, an answer can be
lost before it knows who listens for it."""
_START_SECONDS = 1.0
"""s in which a plant says that it swims a gait that has just been sent."""
_REST_SECONDS = 12.0
"""s in which a plant is at rest after its gait's end: a robot's tail takes 10 s at most to neutral."""


@dataclass(eq=False)
class _Question:
    """What is asked of a service; the first answer counts.

    Attributes:
        client: Of the service.
        request: The service's request.
        note: Takes the response.
        changes_nothing: Whether it may be asked again.
        due: When it is sent (again), s of a monotonic clock; None where it was sent and no look has told the time yet.
    """

    client: Client
    request: Any
    note: Callable[[Any], None]
    changes_nothing: bool
    due: float | None = -math.inf


class PlantClient:
    """Finds the one plant of a namespace and speaks to it. Nothing here waits but `farewell`.

    Attributes:
        plants: Full names of the nodes that published a plant's state in this namespace when `look` looked last.
        publishers: Their ids: a node that is started anew has the name of the one before, but another id.
        state: What the plant said last, None before.
        fin_reply: Answer to the last `set_fin`, None before it has come.
        reset_reply: Answer to the last `request_reset`, None before it has come.
        unreadable: Why what came last on ``plant_state`` is no state of a plant; empty if it was one.
        changed: Something new has come; the owner sets it back.
        velocity_trouble: What the estimator of the velocity complained about last; the owner sets it back.
        applied: The gait that the plant said last it follows, None before; the owner sets it back.
        parameters: What `ask_parameters` learnt, by name, None before the answers have come.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self.state: PlantState | None = None
        self.fin_reply: Reply | None = None
        self.reset_reply: Reply | None = None
        self.unreadable = ""
        self.changed = False
        self.parameters: dict[str, Value] | None = None
        self.applied: Gait | None = None
        self._newest: dict[Client | None, _Question] = {}
        self._node = node
        self.plants: list[str] = []
        self.publishers: frozenset[str] = frozenset()
        self._look_due = 0.0
        self._name = ""
        self._set_parameters: Client | None = None
        self._request_reset: Client | None = None
        self._list_parameters: Client | None = None
        self._describe_parameters: Client | None = None
        self._get_parameters: Client | None = None
        self._gait = node.create_publisher(topics.GAIT.type, topics.GAIT.name_in(namespace), topics.GAIT.qos)
        self._gait_is_new = False
        self._states = node.create_subscription(
            topics.PLANT_STATE.type, topics.PLANT_STATE.name_in(namespace), self._on_state, topics.PLANT_STATE.qos
        )
        self._state_topic = str(self._states.topic_name)
        self.velocity_trouble = ""
        self._estimator = f"{namespace.rstrip('/')}/{_ESTIMATOR}: "
        diagnostics = topics.DIAGNOSTICS
        node.create_subscription(diagnostics.type, diagnostics.name, self._on_diagnostics, diagnostics.qos)
        applied = topics.GAIT_APPLIED
        node.create_subscription(applied.type, applied.name_in(namespace), self._on_applied, applied.qos)

    def _on_state(self, message: DiagnosticStatus) -> None:
        self.changed = True
        try:
            self.state, self.unreadable = plant_state_from_message(message), ""
        except ValueError as error:
            self.unreadable = str(error)
            self._node.get_logger().error(self.unreadable)
            return
        self._gait_is_new = self._gait_is_new and not self.swims

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._estimator) and status.level != DiagnosticStatus.OK:
                self.velocity_trouble = str(status.message)

    def _on_applied(self, message: Float64MultiArray) -> None:
        self.changed = True
        try:
            self.applied = gait_from_message(message)
        except ValueError as error:
            self._node.get_logger().error(f"gait_applied: {error}")

    def look(self, now: float) -> None:
        """Look, not too often, at who publishes a plant's state; ``now`` is the time of a monotonic clock in s."""
        if now < self._look_due:
            return
        self._look_due = now + _LOOK_PERIOD
        found = self._node.get_publishers_info_by_topic(self._state_topic)
        named = [end for end in found if end.node_name != NAME_TO_COME]
        self.plants = sorted({f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in named})
        self.publishers = frozenset(bytes(end.endpoint_gid).hex() for end in found)
        self._ask_again(now)

    def _ask_again(self, now: float) -> None:
        """Ask what could not be asked yet, and what has had no answer for long, as far as it changes nothing."""
        for question in list(self._newest.values()):
            if not question.changes_nothing:
                continue
            if question.due is None:
                question.due = now + _ASK_AGAIN
            if now >= question.due and question.client.service_is_ready():
                self._send_question(question)
                question.due = now + _ASK_AGAIN

    def missing_services(self) -> list[str]:
        """Return the full names of the services that the plant should offer and does not; first make its clients."""
        if len(self.plants) != 1:
            return []
        if self.plants[0] != self._name:
            self._connect(self.plants[0])
        clients = [client for client in (self._set_parameters, self._request_reset) if client is not None]
        return [str(client.service_name) for client in clients if not client.service_is_ready()]

    def _connect(self, name: str) -> None:
        for client in (self._set_parameters, self._request_reset, *self._of_parameters):
            if client is not None:
                self._node.destroy_client(client)
        self._newest.clear()
        self._name = name
        self._set_parameters = self._node.create_client(
            SetParametersAtomically, f"{name}/{topics.SET_PARAMETERS_SERVICE}"
        )
        self._request_reset = self._node.create_client(Trigger, f"{name}/{topics.REQUEST_RESET_SERVICE}")
        self._list_parameters = self._node.create_client(ListParameters, f"{name}/list_parameters")
        self._describe_parameters = self._node.create_client(DescribeParameters, f"{name}/describe_parameters")
        self._get_parameters = self._node.create_client(GetParameters, f"{name}/get_parameters")

    @property
    def _of_parameters(self) -> tuple[Client | None, ...]:
        return self._list_parameters, self._describe_parameters, self._get_parameters

    def set_fin(self, fin: Mapping[str, Value]) -> None:
        """Ask for this fin, all its parameters at once; `fin_reply` will tell."""
        self.fin_reply = None
        request = SetParametersAtomically.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in fin.items()]
        )

        def note(response: Any) -> None:
            self.fin_reply = Reply(response.result.successful, response.result.reason)

        self._ask(self._set_parameters, request, note)

    def request_reset(self) -> None:
        """Ask for the fish at rest at its start; `reset_reply` will tell."""
        self.reset_reply = None

        def note(response: Any) -> None:
            self.reset_reply = Reply(response.success, response.message)

        self._ask(self._request_reset, Trigger.Request(), note)

    def ask_parameters(self) -> None:
        """Ask for the parameters that decide how the fish swims, the fin excepted; `parameters` will tell them."""
        self.parameters = None
        for client in self._of_parameters:
            self._newest.pop(client, None)  # answers to an earlier question
        descriptions: dict[str, str] = {}

        def note_names(response: Any) -> None:
            names = sorted(response.result.names)
            request = DescribeParameters.Request(names=names)
            self._ask(self._describe_parameters, request, note_descriptions, changes_nothing=True)

        def note_descriptions(response: Any) -> None:
            found = {entry.name: entry.description for entry in response.descriptors}
            descriptions.update({name: text for name, text in found.items() if decides_swim(name, text)})
            request = GetParameters.Request(names=list(descriptions))
            self._ask(self._get_parameters, request, note_values, changes_nothing=True)

        def note_values(response: Any) -> None:
            values = [parameter_value_to_python(value) for value in response.values]
            told = zip(descriptions, values, strict=False)
            self.parameters = {name: value for name, value in told if value is not None}

        self._ask(self._list_parameters, ListParameters.Request(), note_names, changes_nothing=True)

    def _ask(
        self, client: Client | None, request: Any, note: Callable[[Any], None], *, changes_nothing: bool = False
    ) -> None:
        if client is None:
            msg = "the plant was not found before it was spoken to"
            raise RuntimeError(msg)
        question = self._newest[client] = _Question(client, request, note, changes_nothing)
        if not changes_nothing or client.service_is_ready():  # what is asked of a service not found yet is lost
            self._send_question(question)

    def _send_question(self, question: _Question) -> None:
        def answered(future: Future) -> None:
            if self._newest.get(question.client) is question:  # others are answers to an earlier one, or come twice
                del self._newest[question.client]
                self.changed = True
                question.note(future.result())

        question.due = None
        question.client.call_async(question.request).add_done_callback(answered)

    @property
    def swims(self) -> bool:
        """Whether the plant said last that it swims."""
        return self.state is not None and self.state.state is State.SWIMMING

    def send(self, gait: Gait) -> None:
        """Send a gait."""
        self._gait_is_new = self._gait_is_new or (gait.moves and not self.swims)
        self._gait.publish(gait_message(gait.rows()))

    def farewell(
        self, clock: Callable[[], float] = time.monotonic, pause: Callable[[float], None] = time.sleep
    ) -> None:
        """Wait, as the process is about to end, until the last gait has arrived and the plant swims no more.

        Who started both ends the plant next, and a robot's driver that is ended takes the force from its tail wherever
        that stands. No executor has a part in it.
        """
        self._gait.wait_for_all_acked(_ARRIVAL)
        self._listen_while(lambda: self._gait_is_new, _START_SECONDS, clock, pause)
        self._listen_while(lambda: self.swims, _REST_SECONDS, clock, pause)

    def _listen_while(
        self,
        condition: Callable[[], bool],
        seconds: float,
        clock: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """Take what the plant says of its state while the condition holds and a plant is there, at most so long."""
        until = clock() + seconds
        while True:
            while (taken := self._states.handle.take_message(topics.PLANT_STATE.type, False)) is not None:  # noqa: FBT003  (not raw; a C++ function)
                self._on_state(taken[0])
            self.look(clock())
            if not condition() or not self.publishers or clock() > until:
                return
            pause(_LISTEN_PERIOD)
