"""The node `live`: serves the graph to Foxglove and Lichtblick, without any part of a ROS desktop.

A viewer connects to ws://localhost:8765. It sees every topic whose type is known, byte for byte as it is published, may
see and set parameters, and call services, save those by which a person confirms, or releases a stop; it publishes
nothing. Where no node publishes ``/tf``, because its type is not
installed, the frames are computed here as they are for bags.
"""

from __future__ import annotations

import argparse
import math
import secrets
import sys
import time
from collections import Counter
from concurrent.futures import Future
from functools import partial
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import foxglove
from foxglove.websocket import Capability, ServerListener
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from std_srvs.srv import Empty as EmptyService
from std_srvs.srv import SetBool, Trigger

from fin_bringup.live_gate import Gate
from fin_optimizer.bags.log_time import LogTime
from fin_optimizer.bags.messages import definition, header_stamp, is_known, tells_plants_time
from fin_optimizer.bags.model_messages import DESCRIPTION, JOINT_STATES, POSE, ModelMessages
from fin_plant import checks, node_process, topics
from fin_plant.command import tell_error
from fin_plant.frames import frame_prefix
from fin_plant.services import not_for_viewers

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from foxglove.websocket import ChannelView, Client

PORT = 8765
HERE = frozenset({"localhost", "127.0.0.1", "::1"})
_HIGHEST_PORT = 65535
_LOOK_PERIOD = 1.0
"""s between two looks at the graph."""
_STEP = 0.05
_PATIENCE = 5.0
"""s in which a node must answer a viewer's call."""
_DEPTH = 100
"""Messages of a topic that may wait for the viewer; older ones are dropped, so that no viewer holds a fish back."""
_SERVICES: dict[str, Any] = {
    "std_srvs/srv/Trigger": Trigger,
    "std_srvs/srv/SetBool": SetBool,
    "std_srvs/srv/Empty": EmptyService,
}
_GET_PARAMETERS = "/get_parameters"


class Live(ServerListener):
    """The node: offers what the graph has, and listens only to what a viewer looks at."""

    def __init__(self, given: argparse.Namespace) -> None:
        """Serve.

        Raises:
            ValueError: The address cannot be listened at.
        """
        self.node = Node("live", namespace=topics.NAMESPACE)
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._types: dict[str, str] = {}
        self._lookers: Counter[str] = Counter()
        self._changes: SimpleQueue[tuple[str, int]] = SimpleQueue()
        self._calls: SimpleQueue[tuple[Any, str, Any, Future[Any]]] = SimpleQueue()
        self._listening: dict[str, list[Any]] = {}
        self._clients: dict[str, Any] = {}
        self._offered: set[str] = set()
        self._nodes: list[str] = []
        self._times = LogTime()
        self._look_due = -math.inf
        self._gate: Gate | None = None
        local = given.host in HERE
        try:
            self._server = foxglove.start_server(
                name=f"fin: {self.node.get_namespace()}",
                host=given.host if local else "127.0.0.1",
                port=given.port if local else 0,
                capabilities=[Capability.Services, Capability.Parameters],
                supported_encodings=["cdr"],
                server_listener=self,
                context=self._context,
            )
            if not local:
                self._gate = Gate(given.host, given.port, self._server.port, given.token)
        except (OSError, RuntimeError) as error:
            msg = f"cannot listen at {given.host}:{given.port}: {error}. Is another live server there? Give --port"
            raise ValueError(msg) from error
        port = self._server.port if self._gate is None else self._gate.port
        query = "" if local else f"/?token={given.token}"
        self.node.get_logger().info(f"open ws://{given.host}:{port}{query} in Foxglove or Lichtblick")

    # -- what the server calls, in threads of its own ----------------------------------------------------------------

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002  (so named by the server)
        """Note that somebody looks at a topic."""
        self._changes.put((channel.topic, 1))

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002  (likewise)
        """Note that somebody looks no more, or is gone."""
        self._changes.put((channel.topic, -1))

    def on_get_parameters(
        self,
        client: Client,  # noqa: ARG002
        param_names: list[str],
        request_id: str | None = None,  # noqa: ARG002
    ) -> list[foxglove.Parameter]:
        """Return the parameters asked for, ``/fish/simulator.fin.length`` for example; all of them if none is named."""
        names, found = param_names, []
        for node in list(self._nodes):
            own = [name.removeprefix(f"{node}.") for name in names if name.startswith(f"{node}.")]
            if not names:
                listed = self._ask(ListParameters, f"{node}/list_parameters", ListParameters.Request())
                own = list(listed.result.names)
            if own:
                found += self._values(node, own)
        return found

    def on_set_parameters(
        self,
        client: Client,  # noqa: ARG002
        parameters: list[foxglove.Parameter],
        request_id: str | None = None,  # noqa: ARG002
    ) -> list[foxglove.Parameter]:
        """Set parameters, and return those that they are then: a node may have refused one."""
        done = []
        for node in list(self._nodes):
            own = {p.name.removeprefix(f"{node}."): p for p in parameters if p.name.startswith(f"{node}.")}
            if not own:
                continue
            wanted = [Parameter(name, value=p.get_value()).to_parameter_msg() for name, p in own.items()]
            answer = self._ask(SetParameters, f"{node}/set_parameters", SetParameters.Request(parameters=wanted))
            for name, result in zip(own, answer.results, strict=True):
                if not result.successful:
                    self._server.publish_status(f"{node}.{name}: {result.reason}", foxglove.StatusLevel.Warning)
            done += self._values(node, list(own))
        return done

    def _values(self, node: str, names: Sequence[str]) -> list[foxglove.Parameter]:
        answer = self._ask(GetParameters, f"{node}{_GET_PARAMETERS}", GetParameters.Request(names=list(names)))
        found = []
        for name, told in zip(names, answer.values, strict=True):
            value = parameter_value_to_python(told)
            if value is not None:
                kind = foxglove.ParameterType.Float64 if isinstance(value, float) else None
                value = list(value) if isinstance(value, list | tuple) or hasattr(value, "tolist") else value
                found.append(foxglove.Parameter(f"{node}.{name}", value=value, type=kind))
        return found

    def _ask(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service from a thread that is not the node's.

        Raises:
            TimeoutError: No answer in time.
            RuntimeError: The service is not there.
        """
        answer: Future[Any] = Future()
        self._calls.put((kind, service, request, answer))
        return answer.result(_PATIENCE)

    def _serve(self, kind: Any, service: str, request: foxglove.ServiceRequest) -> bytes:
        asked = deserialize_message(request.payload, kind.Request)
        if kind is SetBool and (refusal := not_for_viewers(service, releases=not asked.data)):
            return bytes(serialize_message(SetBool.Response(success=False, message=refusal)))
        return bytes(serialize_message(self._ask(kind, service, asked)))

    # -- the node's own thread ---------------------------------------------------------------------------------------

    def step(self) -> float:
        """Do what viewers ask for; return how long the executor may wait."""
        now = time.monotonic()
        if now >= self._look_due:
            self._look_due = now + _LOOK_PERIOD
            self._offer_topics()
            self._offer_services()
        self._take_changes()
        self._make_calls()
        return _STEP

    def _offer_topics(self) -> None:
        found = {name: kinds[0] for name, kinds in self.node.get_topic_names_and_types() if len(kinds) == 1}
        if any(name.endswith(f"/{DESCRIPTION}") for name in found):
            found.setdefault(topics.TF, topics.TF_TYPE)
        for name, kind in found.items():
            if name in self._channels or not is_known(kind):
                continue
            schema = foxglove.Schema(name=kind, encoding="ros2msg", data=definition(kind))
            self._channels[name] = foxglove.Channel(name, schema=schema, message_encoding="cdr", context=self._context)
            self._types[name] = kind

    def _offer_services(self) -> None:
        found = {name: kinds[0] for name, kinds in self.node.get_service_names_and_types()}
        own = self.node.get_fully_qualified_name()
        self._nodes = sorted(
            name.removesuffix(_GET_PARAMETERS)
            for name in found
            if name.endswith(_GET_PARAMETERS) and name != f"{own}{_GET_PARAMETERS}"
        )
        wanted = {name for name, kind in found.items() if kind in _SERVICES and not not_for_viewers(name)}
        if gone := self._offered - wanted:
            self._server.remove_services(sorted(gone))
        new = [self._service(name, found[name]) for name in sorted(wanted - self._offered)]
        if new:
            self._server.add_services(new)
        self._offered = wanted

    def _service(self, name: str, kind: str) -> foxglove.Service:
        found = _SERVICES[kind]
        parts = [_service_schema(kind, part, getattr(found, part)) for part in ("Request", "Response")]
        schema = foxglove.ServiceSchema(kind, request=parts[0], response=parts[1])
        return foxglove.Service(name, schema=schema, handler=partial(self._serve, found, name))

    def _take_changes(self) -> None:
        while True:
            try:
                topic, change = self._changes.get_nowait()
            except Empty:
                break
            self._lookers[topic] += change
        for topic in self._channels:
            looked_at = self._lookers[topic] > 0
            if looked_at and topic not in self._listening:
                self._listening[topic] = self._listen(topic)
            elif not looked_at and topic in self._listening:
                for subscription in self._listening.pop(topic):
                    self.node.destroy_subscription(subscription)

    def _listen(self, topic: str) -> list[Any]:
        if topic == topics.TF and not self.node.count_publishers(topic):
            return self._listen_for_frames()
        return [self._raw(topic, self._types[topic], partial(self._log, topic))]

    def _listen_for_frames(self) -> list[Any]:
        """Compute the frames of each fish that describes itself."""
        subscriptions = []
        for name in list(self._channels):
            if not name.endswith(f"/{DESCRIPTION}"):
                continue
            namespace = name.removesuffix(f"/{DESCRIPTION}")
            model = ModelMessages(namespace, frame_prefix(namespace, topics.NAMESPACE))
            for each in (DESCRIPTION, JOINT_STATES, POSE):
                topic = f"{namespace}/{each}"
                if topic in self._types:
                    taken = partial(self._log_frames, model, topic)
                    subscriptions.append(self._raw(topic, self._types[topic], taken))
        return subscriptions

    def _raw(self, topic: str, kind: str, callback: Callable[[bytes], None]) -> Any:
        package, _, name = kind.partition("/msg/")
        message = getattr(__import__(f"{package}.msg", fromlist=[name]), name)
        offers = [end.qos_profile for end in self.node.get_publishers_info_by_topic(topic)]
        latched = bool(offers) and all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offers)
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        return self.node.create_subscription(message, topic, callback, qos, raw=True)

    def _time(self, topic: str, data: bytes) -> int:
        """Return the plant's time at which a message is shown, in ns; the wall's where nobody tells it."""
        stamp = header_stamp(data) if tells_plants_time(self._types[topic]) else None
        return self._times.of(topic, stamp) or time.time_ns()

    def _log(self, topic: str, data: bytes) -> None:
        self._channels[topic].log(bytes(data), log_time=self._time(topic, data))

    def _log_frames(self, model: ModelMessages, topic: str, data: bytes) -> None:
        stamp = self._time(topic, data)
        for name, message in model.take(topic, stamp, bytes(data)):
            if name == topics.TF:
                self._channels[name].log(message, log_time=stamp)

    def _make_calls(self) -> None:
        while True:
            try:
                kind, service, request, answer = self._calls.get_nowait()
            except Empty:
                return
            client = self._clients.get(service)
            if client is None:
                client = self._clients[service] = self.node.create_client(kind, service)
            if not client.service_is_ready() and not client.wait_for_service(1.0):
                answer.set_exception(RuntimeError(f"nobody offers service {service}"))
                continue
            client.call_async(request).add_done_callback(partial(_hand_over, answer))

    def finished(self) -> int | None:
        """Return None: it serves until it is stopped."""
        return None

    def close(self) -> None:
        """Serve no more."""
        if self._gate is not None:
            self._gate.close()
        self._server.stop()


def _hand_over(answer: Future[Any], done: Any) -> None:
    if answer.set_running_or_notify_cancel():
        answer.set_result(done.result())


def _service_schema(kind: str, part: str, message: Any) -> foxglove.MessageSchema:
    """Return the schema of a service's request or response, whose fields are all of simple types."""
    fields = {
        name: "bool" if what == "boolean" else what for name, what in message.get_fields_and_field_types().items()
    }
    text = "".join(f"{what} {name}\n" for name, what in fields.items() if name != "structure_needs_at_least_one_member")
    schema = foxglove.Schema(name=f"{kind}_{part}", encoding="ros2msg", data=text.encode())
    return foxglove.MessageSchema(encoding="cdr", schema=schema)


def parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    words = argparse.ArgumentParser(
        prog="live",
        description="Serve the graph to Foxglove and Lichtblick, which connect to ws://localhost:8765. A viewer sees "
        "every topic, may call services and set parameters; it publishes nothing.",
        epilog="namespace as for every node: --ros-args -r __ns:=/tank_a/fish",
    )
    words.add_argument(
        "--host",
        default="localhost",
        help="address to listen at (default: %(default)s); any other than this computer's own asks viewers for a token",
    )
    words.add_argument("--port", type=checks.read_whole_number, default=PORT, help="default: %(default)s; 0: any")
    words.add_argument("--token", default="", help="for another --host; one is drawn and shown if left out")
    return words


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; return 2 if the address cannot be listened at."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = parser().parse_args(words[: words.index("--ros-args")] if "--ros-args" in words else words)
    try:
        checks.whole_number("--port", given.port, 0, _HIGHEST_PORT, advice="0 takes any that is free")
    except ValueError as error:
        tell_error("live", error)
        return 2
    given.token = given.token or secrets.token_urlsafe(12)
    return node_process.run(partial(Live, given), [sys.argv[0], *words])


if __name__ == "__main__":
    sys.exit(main())
