"""The servo driver as a terminal program sees it: its state and diagnostics, and what an operator asks of it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, cast

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from fin_plant import topics
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
_ANSWER_SECONDS = 15.0


class DriverClient:
    """Listens to the driver of a namespace and asks it for things.

    Attributes:
        state: What the driver said last, None before.
        device: Values of its device's diagnostics.
    """

    def __init__(self, driver: str = "servo_driver", namespace: str = topics.NAMESPACE) -> None:
        """Start to listen; rclpy must be initialised."""
        self.state: PlantState | None = None
        self.device: dict[str, str] = {}
        self.node = Node("operator", namespace=namespace)
        self._driver = driver
        self._clients: dict[str, Any] = {}
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        state, diagnostics = topics.PLANT_STATE, topics.DIAGNOSTICS
        self.node.create_subscription(state.type, state.name, self._on_state, state.qos)
        self.node.create_subscription(diagnostics.type, diagnostics.name, self._on_diagnostics, diagnostics.qos)

    def _on_state(self, message: DiagnosticStatus) -> None:
        try:
            self.state = plant_state_from_message(message)
        except ValueError as error:
            self.node.get_logger().error(str(error))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        name = f"{self.node.get_namespace().rstrip('/')}/{self._driver}: device"
        for status in message.status:
            if status.name == name:
                self.device = {item.key: item.value for item in status.values}

    def spin(self, seconds: float) -> None:
        """Listen for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=min(left, 0.1))

    def change_state(self, transition: str) -> str:
        """Ask for a transition by name; return what came of it."""
        request = ChangeState.Request(transition=Transition(id=TRANSITIONS[transition]))
        answer = self._ask(ChangeState, "change_state", request)
        if answer is None:
            return self._absent()
        self.spin(0.2)
        reason = self.state.reason if self.state is not None else ""
        return f"{transition}: done" if answer.success else f"{transition}: refused; {reason}"

    def trigger(self, service: str) -> str:
        """Call one of the driver's services without arguments; return its answer."""
        answer = self._ask(Trigger, service, Trigger.Request())
        return self._absent() if answer is None else cast("str", answer.message)

    def emergency_stop(self, *, on: bool) -> str:
        """Latch or release the emergency stop; return its answer."""
        answer = self._ask(SetBool, topics.EMERGENCY_STOP_SERVICE, SetBool.Request(data=on))
        return self._absent() if answer is None else cast("str", answer.message)

    def _absent(self) -> str:
        return f"no answer from {self._driver}: is it running in {self.node.get_namespace()}?"

    def _ask(self, service_type: Any, name: str, request: Any) -> Any:
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self.node.create_client(service_type, f"{self._driver}/{name}")
        end = time.monotonic() + _ANSWER_SECONDS
        while not client.service_is_ready():
            if time.monotonic() > end:
                return None
            self.spin(0.05)
        future = client.call_async(request)
        while not future.done():
            if time.monotonic() > end:
                return None
            self.spin(0.02)
        return future.result()

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
