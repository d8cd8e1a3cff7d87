"""A client of the servo driver for tests: what an operator does, besides what every plant's client does."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.msg import State as LifecycleState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from fin_plant import topics
from fin_plant.plant_state import State
from fin_servo_driver.robot_states import LEAST_SIGHT
from support.plant_tester import PlantTester

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from fin_servo_driver.emulator.devices import Device
    from fin_servo_driver.emulator.pty_port import PtyPort

CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEAN_UP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
SHUT_DOWN = Transition.TRANSITION_ACTIVE_SHUTDOWN
UNCONFIGURED, INACTIVE = LifecycleState.PRIMARY_STATE_UNCONFIGURED, LifecycleState.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = LifecycleState.PRIMARY_STATE_ACTIVE, LifecycleState.PRIMARY_STATE_FINALIZED


class RobotClient(PlantTester):
    """Everything a test asks of the servo driver."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain, "servo_driver")

    def change_state(self, transition: int) -> bool:
        """Ask for a transition of the life cycle; return whether it was made."""
        answer = self._call(ChangeState, "change_state", ChangeState.Request(transition=Transition(id=transition)))
        return bool(answer.success)

    def ask_for_state(self, transition: int) -> Any:
        """Ask for a transition and do not wait; return the future of the answer."""
        client = self._node.create_client(ChangeState, f"{self._plant}/change_state")
        self.wait_until(client.service_is_ready, "service change_state")
        return client.call_async(ChangeState.Request(transition=Transition(id=transition)))

    def life_cycle(self) -> int:
        """Return the state of the life cycle."""
        return int(self._call(GetState, "get_state", GetState.Request()).current_state.id)

    def confirm_fin(self) -> Any:
        """Call ~/confirm_fin when the question has stood long enough to be seen."""
        return self._confirm(topics.CONFIRM_FIN_SERVICE)

    def confirm_mark(self) -> Any:
        """Call ~/confirm_mark when the question has stood long enough to be seen."""
        return self._confirm(topics.CONFIRM_MARK_SERVICE)

    def _confirm(self, service: str) -> Any:
        """Answer a question that has stood long enough; again where a busy driver had only just come to ask it."""
        while True:
            self.spin(1.5 * LEAST_SIGHT)
            answer = self._call(Trigger, service, Trigger.Request())
            if "was asked for only" not in answer.message:
                return answer

    def configure(self) -> None:
        """Open the port, again where a good device's answers come too late: an emulated one shares the processor."""
        self.wait_until(lambda: self.change_state(CONFIGURE), "an open port")

    def activate(self) -> None:
        """Arm, again where the machine has kept the device waiting."""
        self.wait_until(lambda: self.change_state(ACTIVATE), "an armed driver")

    def make_ready(self) -> None:
        """Configure, mount the fin asked for, arm."""
        self.configure()
        self.wait_until(lambda: self.confirm_fin().success, "a mounted fin")
        self.activate()
        self.wait_until(self._stands_ready, "a plant that is ready")

    def _stands_ready(self) -> bool:
        """Whether the plant is ready; the mark is owed where the machine has kept the device waiting meanwhile."""
        state = self.state()
        if state is not None and state.details["waiting_for"] == "mark":
            self.confirm_mark()
        return state is not None and state.state is State.READY

    @contextlib.contextmanager
    def another_plant(self) -> Iterator[None]:
        """Have another plant in the driver's namespace, as far as the graph tells."""
        state = topics.PLANT_STATE
        publisher = self._node.create_publisher(state.type, state.name, state.qos)
        try:
            yield
        finally:
            self._node.destroy_publisher(publisher)

    def reason(self) -> str:
        """Return the reason in the newest plant_state."""
        self.spin(0.1)
        state = self.state()
        return state.reason if state else "no plant_state"


@contextlib.contextmanager
def plugged_in(device: Device, folder: Path, *, keep: bool = False) -> Iterator[PtyPort]:
    """Yield a device on a pty in this folder."""
    from fin_servo_driver.emulator.pty_port import PtyPort  # noqa: PLC0415 - only where a robot is emulated

    port = PtyPort(device, folder / "port", keep=keep)
    try:
        yield port
    finally:
        port.close()
