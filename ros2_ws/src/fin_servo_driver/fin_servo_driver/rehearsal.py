"""The rehearsal node: all of a robot that is not software of this package, emulated.

A device on a pty that the servo driver opens like any other, the hidden fish that it moves, the camera that sees the
fish and publishes ``pose``, and the operator who mounts fins and brings the fish back.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State as LifecycleState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from fin_plant import node_process, topics
from fin_plant.fin import Fin, node_table
from fin_plant.messages import plant_state_from_message, time_message
from fin_plant.node_parameters import NodeParameters, create_node
from fin_servo_driver import robot_file
from fin_servo_driver.emulator.emulate import device_for, targets
from fin_servo_driver.emulator.hidden_fish import SAMPLE_TIME, Camera, Deviation, HiddenFish
from fin_servo_driver.emulator.pty_port import PtyPort
from fin_servo_driver.fin_instruction import wanted_fin
from fin_servo_driver.robot_states import LEAST_SIGHT
from fin_servo_driver.wall_clock import stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.node import Node

    from fin_plant.parameters import Value
    from fin_plant.plant_state import PlantState

PARAMETERS = node_table("fin_servo_driver", "rehearsal")
DRIVER = "servo_driver"
PLANT = "rehearsal"
"""What the driver of a rehearsal calls itself."""
# More than this behind real time is given up, as in the simulator.
_LARGEST_LAG = 0.25
_LOOK = 0.1
_PATIENCE = 2.0
_SIGHT = 1.25 * LEAST_SIGHT
"""s that pass at least before an answer: what is answered at once nobody can have seen, and the driver refuses it."""


class Operator:
    """Does at the driver what a person does at the robot, one thing at a time.

    Where a person answers the driver instead, the hands are still this one's: the wanted fin is on, and the fish at its
    mark, before anybody can say so.

    Attributes:
        acts: Whether it answers the driver.
        delay: s after which it does.
    """

    def __init__(
        self, node: Node, port: str, robot: str, mount: Callable[[Fin], None], put_back: Callable[[], None]
    ) -> None:
        """Listen to the driver.

        Args:
            node: Of the rehearsal.
            port: To tell the driver.
            robot: Robot file to tell the driver.
            mount: Puts a fin on the fish.
            put_back: Brings the fish to its mark.
        """
        self.acts = True
        self.delay = 0.0
        self._node = node
        self._port = port
        self._robot = robot
        self._mount = mount
        self._put_back = put_back
        self._state: PlantState | None = None
        self._since = time.monotonic()
        self._busy_until = 0.0
        self._get_state = node.create_client(GetState, f"{DRIVER}/get_state")
        self._change_state = node.create_client(ChangeState, f"{DRIVER}/change_state")
        self._set = node.create_client(SetParametersAtomically, f"{DRIVER}/{topics.SET_PARAMETERS_SERVICE}")
        self._confirm_fin = node.create_client(Trigger, f"{DRIVER}/{topics.CONFIRM_FIN_SERVICE}")
        self._confirm_mark = node.create_client(Trigger, f"{DRIVER}/{topics.CONFIRM_MARK_SERVICE}")
        node.create_subscription(
            topics.PLANT_STATE.type, topics.PLANT_STATE.name, self._on_state, topics.PLANT_STATE.qos
        )

    def _on_state(self, message: DiagnosticStatus) -> None:
        try:
            self._state = plant_state_from_message(message)
        except ValueError as error:
            self._node.get_logger().error(str(error))
        self._since = time.monotonic()
        self._busy_until = 0.0

    def step(self) -> None:
        """Do what the driver waits for, if it has waited long enough."""
        now = time.monotonic()
        state = self._state
        if state is None or state.plant != PLANT or now < self._busy_until:
            return  # never a robot's driver that was started beside it
        if self._node.count_publishers(topics.PLANT_STATE.name) != 1:
            return  # under the same name it would get whatever this one is asked
        if now - self._since < max(self.delay, _SIGHT):
            return
        waiting = state.details.get("waiting_for", "")
        self._busy_until = now + _PATIENCE
        if waiting == "configuring":
            self._call(self._get_state, GetState.Request(), self._set_up)
        elif waiting == "fin":
            self._mount(wanted_fin(state.details))
            self._answer(self._confirm_fin, Trigger.Request())
        elif waiting == "arming":
            self._change(Transition.TRANSITION_ACTIVATE)
        elif waiting == "mark":
            self._put_back()
            self._answer(self._confirm_mark, Trigger.Request())
        else:
            self._busy_until = 0.0

    def _set_up(self, response: GetState.Response) -> None:
        """Tell the driver its port and configure it."""
        if response.current_state.id != LifecycleState.PRIMARY_STATE_UNCONFIGURED:
            return
        values = {"port": self._port, "robot_file": self._robot}
        request = SetParametersAtomically.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        )
        self._call(self._set, request, lambda _: self._change(Transition.TRANSITION_CONFIGURE))

    def _change(self, transition: int) -> None:
        self._answer(self._change_state, ChangeState.Request(transition=Transition(id=transition)))

    def _answer(self, client: Any, request: Any) -> None:
        if self.acts:
            self._call(client, request, self._note)

    def _note(self, response: Any) -> None:
        if not response.success:
            self._node.get_logger().warning(f"the driver refused: {getattr(response, 'message', 'see its log')}")

    def _call(self, client: Any, request: Any, then: Callable[[Any], None]) -> None:
        if client.service_is_ready():
            client.call_async(request).add_done_callback(lambda future: then(future.result()))


class Rehearsal:
    """The emulated robot."""

    def __init__(self) -> None:
        """Plug the device in and put the fish into its tank.

        Raises:
            ValueError: A start parameter or a robot file that is refused.
        """
        self.node = create_node("rehearsal")
        self._parameters = NodeParameters(self.node, PARAMETERS, on_change=self._changed)
        values = self._parameters.values
        self._robot = robot_file.load(robot_file.find(str(values["robot_file"])))
        names = ("mass", "drag", "stiffness", "servo_lag")
        seed = cast("int", values["hidden.seed"])
        chosen = {name: cast("float", values[f"hidden.{name}"]) for name in names}
        deviation = Deviation.drawn(seed) if seed else Deviation(**chosen)
        peduncle = {name: value for name, value in values.items() if name in PARAMETERS.group("peduncle")}
        self._fish = HiddenFish(Fin(), len(self._robot.joints), deviation, peduncle)
        self._every = _divisor(cast("float", values["camera.rate"]))
        self._latency = cast("float", values["camera.latency"])
        self._random = np.random.default_rng(cast("int", values["seed"]))
        self._folder = tempfile.TemporaryDirectory(prefix="fin_rehearsal_")
        device = device_for(self._robot, self._fish.angle)
        path = Path(self._folder.name) / "port"
        self._port = PtyPort(device, path, seed=cast("int", values["seed"]))
        robot = str(values["robot_file"])
        self._operator = Operator(self.node, str(path), robot, self._fish.mount, self._fish.put_at_origin)
        self._poses = self.node.create_publisher(topics.POSE.type, topics.POSE.name, topics.POSE.qos)
        self._seen: deque[tuple[float, PoseStamped]] = deque()
        self._samples = 0
        self._fish.advance(targets(self._robot, device))  # compiles the kernel
        self._fish.put_at_origin()
        self._begin = time.monotonic()
        self._changed(values)
        self.node.get_logger().info(f"an emulated {self._robot.device} is on {path}")

    def _changed(self, values: Mapping[str, Value]) -> None:
        number = {name: cast("float", value) for name, value in values.items()}
        names = ("position_noise", "heading_noise", "dropouts", "outliers")
        self._camera = Camera(**{name: number[f"camera.{name}"] for name in names})
        self._operator.acts = bool(values["operator.acts"])
        self._operator.delay = number["operator.delay"]
        self._port.drop_rate = number["fault.drop_rate"]
        self._port.silent = bool(values["fault.silent"])
        if values["fault.unplugged"]:
            self._port.unplug()
        else:
            self._port.plug()

    def step(self) -> float:
        """Let the fish swim up to now and publish what the camera has seen."""
        now = time.monotonic()
        if now - self._begin - self._samples * SAMPLE_TIME > _LARGEST_LAG:
            self._begin, self._samples = now, 0
        while self._begin + (self._samples + 1) * SAMPLE_TIME <= now:
            self._samples += 1
            pose = self._fish.advance(targets(self._robot, self._port.device))
            if self._samples % self._every == 0:
                self._look(pose, self._begin + self._samples * SAMPLE_TIME)
        while self._seen and self._seen[0][0] <= now:
            self._poses.publish(self._seen.popleft()[1])
        self._operator.step()
        return min(_LOOK, max(0.0, self._begin + (self._samples + 1) * SAMPLE_TIME - time.monotonic()))

    def _look(self, pose: tuple[float, float, float], at: float) -> None:
        seen = self._camera.see(pose, self._random)
        if seen is None:
            return
        x, y, heading = seen
        message = PoseStamped()
        message.header.frame_id = topics.TANK_FRAME
        message.header.stamp = time_message(stamp_of(at))
        message.pose.position.x, message.pose.position.y = x, y
        message.pose.orientation.z, message.pose.orientation.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
        self._seen.append((at + self._latency, message))

    def finished(self) -> int | None:
        """Return None: the rehearsal runs until it is stopped."""
        return None

    def close(self) -> None:
        """Unplug the device."""
        self._port.close()
        self._folder.cleanup()


def _divisor(rate: float) -> int:
    """Return after how many samples of the fish the camera looks.

    Raises:
        ValueError: The camera's rate does not divide that of the samples.
    """
    every = round(1.0 / (rate * SAMPLE_TIME))
    if abs(every * rate * SAMPLE_TIME - 1.0) > 1e-6:  # noqa: PLR2004 - rounding
        msg = f"camera.rate = {rate:g} Hz must divide {1.0 / SAMPLE_TIME:g} Hz, at which the fish is computed"
        raise ValueError(msg)
    return every


def main(args: list[str] | None = None) -> int:
    """Run the rehearsal node."""
    return node_process.run(Rehearsal, args)


if __name__ == "__main__":
    sys.exit(main())
