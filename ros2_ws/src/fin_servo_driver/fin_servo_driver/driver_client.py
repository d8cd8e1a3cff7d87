"""The servo driver as a terminal program sees it: its state and diagnostics, and what an operator asks of it.

Nothing here waits for an answer: an emergency stop goes out at once, whatever else was asked before.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from fin_plant import topics
from fin_plant.discovery import look_around, nothing_on, wanted
from fin_plant.messages import plant_state_from_message

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from fin_plant.plant_state import PlantState

TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
SERVICES = (topics.CONFIRM_FIN_SERVICE, topics.CONFIRM_MARK_SERVICE)
_ANSWER_SECONDS = 15.0
"""Configuring waits up to 5 s for a board's banner."""
_STOP_SECONDS = 3.0
"""A driver that disarms at that moment takes 2 s."""


@dataclass
class _Request:
    """A question to the driver.

    Attributes:
        name: What it asks for.
        client: Of the service.
        message: The service's request.
        deadline: s of the monotonic clock, after which nobody waits for the answer.
        without_answer: What is said then.
        to: The state that a confirmation answers; it is not sent any more once the driver is in another one.
        future: Of the answer, None until the service was found.
    """

    name: str
    client: Any
    message: Any
    deadline: float
    without_answer: str
    to: PlantState | None = None
    future: Any = None


class DriverClient:
    """Listens to the driver of a namespace and asks it for things.

    Attributes:
        state: What the driver said last, None before.
        device: Values of its device's diagnostics.
        answer: Of the driver, to what was asked last.
    """

    def __init__(self, driver: str = "servo_driver", namespace: str = topics.NAMESPACE) -> None:
        """Start to listen; rclpy must be initialised."""
        self.state: PlantState | None = None
        self.device: dict[str, str] = {}
        self.answer = ""
        self.node = Node("operator", namespace=namespace)
        self._name = f"{self.node.get_namespace().rstrip('/')}/{driver}"
        self._heard: float | None = None
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        state, diagnostics = topics.PLANT_STATE, topics.DIAGNOSTICS
        self.node.create_subscription(state.type, state.name, self._on_state, state.qos)
        self.node.create_subscription(diagnostics.type, diagnostics.name, self._on_diagnostics, diagnostics.qos)
        # All of them now: an emergency stop must not wait until its service is found.
        self._change_state = self.node.create_client(ChangeState, f"{driver}/change_state")
        self._stop = self.node.create_client(SetBool, f"{driver}/{topics.EMERGENCY_STOP_SERVICE}")
        self._triggers = {name: self.node.create_client(Trigger, f"{driver}/{name}") for name in SERVICES}
        self._requests: list[_Request] = []

    def _on_state(self, message: DiagnosticStatus) -> None:
        self._heard = time.monotonic()
        try:
            self.state = plant_state_from_message(message)
        except ValueError as error:
            self.answer = str(error)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(f"{self._name}: "):
                self._heard = time.monotonic()
            if status.name == f"{self._name}: device":
                self.device = {item.key: item.value for item in status.values}

    def silence(self) -> float:
        """Return for how many s the driver, which speaks once a second, has said nothing; 0 before its first word."""
        return 0.0 if self._heard is None else time.monotonic() - self._heard

    def seen(self) -> str:
        """Return what is seen instead of the driver's word."""
        state = topics.PLANT_STATE
        name = self.node.resolve_topic_name(state.name)
        return nothing_on(name, wanted(state), look_around(self.node), advice="give --namespace {namespace}")

    def spin(self, seconds: float) -> None:
        """Listen for so long, and see to what was asked."""
        end = time.monotonic() + seconds
        while True:
            self._see_to_requests()
            if (left := end - time.monotonic()) <= 0.0:
                return
            self._executor.spin_once(timeout_sec=min(left, 0.02))

    def ask(self, action: str) -> None:
        """Ask for a transition or a service by its name; `answer` tells what came of it."""
        if self._requests:
            self.answer = f"{self._requests[0].name}: the driver has not answered yet"
            return
        client, message = self._triggers.get(action), Trigger.Request()
        if client is None:
            client, message = self._change_state, ChangeState.Request(transition=Transition(id=TRANSITIONS[action]))
        lost = f"{action}: no answer from {self._name} within {_ANSWER_SECONDS:g} s"
        asked = self.state if action in SERVICES else None
        self._send(_Request(action, client, message, time.monotonic() + _ANSWER_SECONDS, lost, asked))

    def emergency_stop(self, *, on: bool) -> None:
        """Latch the emergency stop at once, or release it."""
        name, lost = "release", "the emergency stop was not released: no answer"
        if on:
            self._requests = [request for request in self._requests if request.future is not None]
            name, lost = "STOP", "NO ANSWER TO THE EMERGENCY STOP: switch the servos off"
        message = SetBool.Request(data=on)
        self._send(_Request(name, self._stop, message, time.monotonic() + _STOP_SECONDS, lost))

    def _send(self, request: _Request) -> None:
        self.answer = f"{request.name} ..."
        self._requests.append(request)
        self._see_to_requests()

    def _see_to_requests(self) -> None:
        """Send what can be sent, and take the answers."""
        waiting = []
        for request in self._requests:
            if request.future is None and request.to is not None and request.to != self.state:
                self.answer = f"{request.name}: the driver waits for something else now, look again"
                continue
            if request.future is None and request.client.service_is_ready():
                request.future = request.client.call_async(request.message)
            if request.future is not None and request.future.done():
                self.answer = _text(request.name, request.future.result())
            elif time.monotonic() > request.deadline:
                self.answer = request.without_answer
            else:
                waiting.append(request)
        self._requests = waiting

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


def _text(name: str, response: Any) -> str:
    """Return an answer as a person reads it; why a transition was refused is in the state's reason."""
    if isinstance(response, ChangeState.Response):
        return f"{name}: {'done' if response.success else 'refused'}"
    return str(response.message)
