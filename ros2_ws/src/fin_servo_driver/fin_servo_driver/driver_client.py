"""The servo driver as a person's program sees it: its state and diagnostics, and what an operator asks of it.

Nothing here waits for an answer: an emergency stop goes out at once, whatever else was asked before.
"""

from __future__ import annotations

import time
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
from fin_servo_driver.requests import Answer, Request, Requests

if TYPE_CHECKING:
    from collections.abc import Callable

    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from fin_plant.plant_state import PlantState

TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
SERVICES = (topics.CONFIRM_FIN_SERVICE, topics.CONFIRM_MARK_SERVICE)
DRIVER = "servo_driver"
STOP, RELEASE = "STOP", "release"
_ANSWER_SECONDS = 15.0
"""Configuring waits up to 5 s for a board's banner."""
_STOP_SECONDS = 3.0
"""A driver that disarms at that moment takes 2 s."""


def stop_request(client: Any, *, on: bool) -> Request:
    """Return the request that latches the emergency stop of a plant, or releases it, by a client of its service."""
    name, lost = RELEASE, "the emergency stop was not released: no answer"
    if on:
        name, lost = STOP, "NO ANSWER TO THE EMERGENCY STOP: switch the servos off"
    return Request(name, client, SetBool.Request(data=on), time.monotonic() + _STOP_SECONDS, lost)


class DriverClient:
    """Listens to the driver and asks it for things, as part of a node that somebody else spins.

    Attributes:
        state: What the driver said last, None before.
        device: Values of its device's diagnostics.
        answer: Of the driver, to what was asked last.
        node: Listens and asks.
    """

    def __init__(self, node: Node, driver: str = DRIVER, answered: Callable[[Answer], object] | None = None) -> None:
        """Start to listen.

        Args:
            node: In the driver's namespace.
            driver: Name of the driver's node.
            answered: Called with each answer, and where none comes.
        """
        self.state: PlantState | None = None
        self.device: dict[str, str] = {}
        self.answer = ""
        self.node = node
        self._name = f"{self.node.get_namespace().rstrip('/')}/{driver}"
        self._heard: float | None = None
        self._tell = answered
        state, diagnostics = topics.PLANT_STATE, topics.DIAGNOSTICS
        self.node.create_subscription(state.type, state.name, self._on_state, state.qos)
        self.node.create_subscription(diagnostics.type, diagnostics.name, self._on_diagnostics, diagnostics.qos)
        # All of them now: an emergency stop must not wait until its service is found.
        self._change_state = self.node.create_client(ChangeState, f"{driver}/change_state")
        self._stop = self.node.create_client(SetBool, f"{driver}/{topics.EMERGENCY_STOP_SERVICE}")
        self._triggers = {name: self.node.create_client(Trigger, f"{driver}/{name}") for name in SERVICES}
        self._requests = Requests(self._on_answer)

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

    def _on_answer(self, answer: Answer) -> None:
        self.answer = answer.text
        if self._tell is not None:
            self._tell(answer)

    def silence(self) -> float:
        """Return for how many s the driver, which speaks once a second, has said nothing; 0 before its first word."""
        return 0.0 if self._heard is None else time.monotonic() - self._heard

    def seen(self) -> str:
        """Return what is seen instead of the driver's word."""
        state = topics.PLANT_STATE
        name = self.node.resolve_topic_name(state.name)
        return nothing_on(name, wanted(state), look_around(self.node), advice="give --namespace {namespace}")

    def see_to_requests(self) -> None:
        """Send what can be sent, and take the answers; to be called some times a second."""
        self._requests.see_to()

    def ask(self, action: str) -> bool:
        """Ask for a transition or a service by its name; `answer` tells what came of it.

        Returns:
            Whether it was asked: not while something else is not answered yet.
        """
        if self._requests.names:
            self.answer = f"{self._requests.names[0]}: the driver has not answered yet"
            return False
        client, message = self._triggers.get(action), Trigger.Request()
        if client is None:
            client, message = self._change_state, ChangeState.Request(transition=Transition(id=TRANSITIONS[action]))
        lost = f"{action}: no answer from {self._name} within {_ANSWER_SECONDS:g} s"
        asked = self.state

        def still_asked() -> bool:
            return action not in SERVICES or self.state == asked

        self._send(Request(action, client, message, time.monotonic() + _ANSWER_SECONDS, lost, still_asked))
        return True

    def emergency_stop(self, *, on: bool) -> None:
        """Latch the emergency stop at once, or release it."""
        if on:
            self.drop_unsent()
        self._send(stop_request(self._stop, on=on))

    def drop_unsent(self) -> None:
        """Forget what waits for the driver to be found: after a stop nobody asks for it any more."""
        self._requests.drop_unsent()

    def _send(self, request: Request) -> None:
        self.answer = f"{request.name} ..."
        self._requests.send(request)


class SpunDriverClient(DriverClient):
    """The same with a node of its own, for a program that looks at its screen between two slices of listening."""

    def __init__(self, namespace: str = topics.NAMESPACE) -> None:
        """Start to listen; rclpy must be initialised."""
        super().__init__(Node("operator", namespace=namespace))
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Listen for so long, and see to what was asked."""
        end = time.monotonic() + seconds
        while True:
            self.see_to_requests()
            if (left := end - time.monotonic()) <= 0.0:
                return
            self._executor.spin_once(timeout_sec=min(left, 0.02))

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
