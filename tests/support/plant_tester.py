"""A client of a plant for tests: waits on conditions, keeps what arrives, speaks the contract's topics and services."""

from __future__ import annotations

import time
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Self

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import HistoryPolicy, QoSProfile
from std_srvs.srv import SetBool, Trigger

from fin_plant import ros_environment, topics
from fin_plant.messages import gait_message, nanoseconds_of, plant_state_from_message
from fin_plant.plant_state import PlantState, State
from support.waiting import PATIENCE, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_plant.gait import Gait

LISTENED = (
    topics.GAIT_APPLIED,
    topics.JOINT_STATES,
    topics.POSE,
    topics.VELOCITY,
    topics.THRUST,
    topics.PLANT_STATE,
    topics.DIAGNOSTICS,
)
GAIT_PERIOD = 0.2
TIMEOUT = PATIENCE


def _every_message_of(topic: topics.Topic[Any]) -> QoSProfile:
    """Return how a topic is heard so that a test which is put aside misses nothing that was said meanwhile."""
    return QoSProfile(
        reliability=topic.qos.reliability, durability=topic.qos.durability, history=HistoryPolicy.KEEP_ALL
    )


class PlantTester:
    """Everything a test asks of a plant, on a ROS domain of its own; a context manager."""

    def __init__(self, domain: int, plant: str = "simulator", namespace: str = topics.NAMESPACE) -> None:
        ros_environment.prepare()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("plant_client", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._arrivals: defaultdict[str, list[tuple[int, Any]]] = defaultdict(list)
        for topic in LISTENED:
            self._node.create_subscription(topic.type, topic.name, self._keep(topic.name), _every_message_of(topic))
        self._gait_topic = self._node.create_publisher(topics.GAIT.type, topics.GAIT.name, topics.GAIT.qos)
        self._gait: Any = None
        self._gait_sent = 0.0
        self._plant = plant

    def _keep(self, name: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self._arrivals[name].append((time.time_ns(), message))

        return keep

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    # -- waiting -----------------------------------------------------------------------------------------------------

    def wait_until(self, condition: Callable[[], object], what: str, timeout: float = TIMEOUT) -> None:
        """Spin, repeating the gait, until the condition holds; fail with what was awaited, after `PATIENCE` or more."""
        wait_until(condition, timeout, lambda: f"{what}; last state: {self.state()}", self._spin_once)

    def spin(self, seconds: float) -> None:
        """Listen, and repeat the gait, for so long: where a test is about time that passes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin_once()

    def _spin_once(self) -> None:
        if self._gait is not None and time.monotonic() - self._gait_sent > GAIT_PERIOD:
            self._gait_sent = time.monotonic()
            self._gait_topic.publish(self._gait)
        self._executor.spin_once(timeout_sec=0.02)

    def wait_for_state(self, state: State, timeout: float = TIMEOUT) -> PlantState:
        """Wait until the newest plant_state is this one; return it."""
        self.wait_until(lambda: (now := self.state()) is not None and now.state is state, str(state), timeout)
        found = self.state()
        assert found is not None
        return found

    # -- what arrived ------------------------------------------------------------------------------------------------

    def arrivals(self, topic: topics.Topic[Any]) -> list[tuple[int, Any]]:
        """Return the messages of a topic with their time of arrival in ns."""
        return self._arrivals[topic.name]

    def received(self, topic: topics.Topic[Any]) -> list[Any]:
        """Return the messages of a topic; waits for the first one."""
        self.wait_until(lambda: self._arrivals[topic.name], f"message on {topic.name}")
        return [message for _, message in self._arrivals[topic.name]]

    def listen(self, topic: topics.Topic[Any]) -> list[Any]:
        """Listen to another topic from now on; return the list that its messages are put into."""
        heard: list[Any] = []
        self._node.create_subscription(topic.type, topic.name, heard.append, _every_message_of(topic))
        return heard

    def state(self) -> PlantState | None:
        """Return the newest plant_state."""
        arrived = self._arrivals[topics.PLANT_STATE.name]
        return plant_state_from_message(arrived[-1][1]) if arrived else None

    def diagnostic(self, key: str) -> str | None:
        """Return a value of the plant's newest diagnostics."""
        for _, message in reversed(self._arrivals[topics.DIAGNOSTICS.name]):
            for status in message.status:
                for item in status.values:
                    if item.key == key:
                        return str(item.value)
        return None

    # -- asking ------------------------------------------------------------------------------------------------------

    def publish_gait(self, message: Any, *, repeat: bool = False) -> None:
        """Publish a gait's message once, or from now on whenever the client waits; None ends the repetition."""
        self._gait = message if repeat else None
        self.wait_until(lambda: self._gait_topic.get_subscription_count() > 0, "plant listening to gait")
        if message is not None:
            self._gait_topic.publish(message)

    def swim(self, gait: Gait, seconds: float) -> int:
        """Swim and wait until all streams have passed ``seconds`` of plant time; return the start's stamp in ns."""
        self.publish_gait(gait_message(gait.rows()), repeat=True)
        since = self.wait_for_state(State.SWIMMING).stamp
        streams = [topic for topic in LISTENED if topic.qos is topics.STREAM and topic is not topics.DIAGNOSTICS]

        def passed() -> bool:
            newest = [self._arrivals[topic.name][-1:] for topic in streams]
            end = since + int(seconds * 1e9)
            return all(last and nanoseconds_of(last[0][1].header.stamp) >= end for last in newest)

        self.wait_until(passed, f"{seconds} s of swimming", timeout=TIMEOUT + 2 * seconds)
        return since

    def stop_swimming(self) -> None:
        """Send a gait of no amplitude and wait for READY."""
        state = self.state()
        assert state is not None
        self.publish_gait(gait_message([[0.0, 0.0, 0.0, 0.0]]))
        self.wait_for_state(State.READY)

    def _call(self, service_type: Any, name: str, request: Any) -> Any:
        client = self._node.create_client(service_type, f"{self._plant}/{name}")
        self.wait_until(client.service_is_ready, f"service {name}")
        future = client.call_async(request)
        self.wait_until(future.done, f"answer of {name}")
        self._node.destroy_client(client)
        return future.result()

    def request_reset(self) -> Any:
        """Call ~/request_reset."""
        return self._call(Trigger, topics.REQUEST_RESET_SERVICE, Trigger.Request())

    def emergency_stop(self, *, on: bool) -> Any:
        """Call ~/estop."""
        return self._call(SetBool, topics.EMERGENCY_STOP_SERVICE, SetBool.Request(data=on))

    def set_parameters(self, values: Mapping[str, Any]) -> Any:
        """Set parameters atomically; return the result."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        return self._call(SetParametersAtomically, topics.SET_PARAMETERS_SERVICE, request).result

    def get_parameter(self, name: str) -> Any:
        """Return a parameter's value."""
        answer = self._call(GetParameters, "get_parameters", GetParameters.Request(names=[name]))
        return parameter_value_to_python(answer.values[0])
