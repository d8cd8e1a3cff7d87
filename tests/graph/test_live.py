"""A viewer connects to the live server, sees the fish, calls a service, sets a parameter; it may go and come again."""

from __future__ import annotations

import json
import re
import struct
import time
from typing import TYPE_CHECKING, Any, Self

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from fin_optimizer.bags.messages import decode
from fin_plant.frames import Frames
from support.waiting import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
SUBPROTOCOLS = [Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1")]
MESSAGE, CALL, ANSWER = 1, 2, 3


class Viewer:
    """What Foxglove and Lichtblick do, as far as a test needs it."""

    def __init__(self, address: str) -> None:
        self._connection = connect(address, subprotocols=SUBPROTOCOLS, max_size=None)
        self.channels: dict[str, Any] = {}
        self.services: dict[str, Any] = {}
        self.said: list[Any] = []
        self._topics: dict[int, str] = {}
        self.messages: list[tuple[str, bytes]] = []
        self.answers: list[bytes] = []

    def __enter__(self) -> Self:
        self._socket = self._connection.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._connection.__exit__(*error)  # type: ignore[arg-type]

    def send(self, **what: Any) -> None:
        self._socket.send(json.dumps(what))

    def wait_until(self, condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"{what}; heard: {[each.get('op') for each in self.said]}"
            try:
                data = self._socket.recv(timeout=1.0)
            except TimeoutError:
                continue
            if isinstance(data, str):
                self._take(json.loads(data))
            elif data[0] == MESSAGE:
                (number, _) = struct.unpack_from("<IQ", data, 1)
                self.messages.append((self._topics[number], data[13:]))
            elif data[0] == ANSWER:
                self.answers.append(data)

    def _take(self, said: Any) -> None:
        self.said.append(said)
        if said["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in said["channels"]}
        elif said["op"] == "advertiseServices":
            self.services |= {service["name"]: service for service in said["services"]}
        elif said["op"] == "status" and said["message"].startswith("Unknown channel ID:"):
            # The library advertises a channel a moment before who is quick can subscribe to it.
            unknown = int(said["message"].rpartition(":")[2])
            for number, topic in self._topics.items():
                if self.channels[topic]["id"] == unknown:
                    self._ask_for(number)

    def _ask_for(self, number: int) -> None:
        channel = self.channels[self._topics[number]]["id"]
        self.send(op="subscribe", subscriptions=[{"id": number, "channelId": channel}])

    def subscribe(self, topic: str) -> None:
        self.wait_until(lambda: topic in self.channels, topic)
        number = len(self._topics) + 1
        self._topics[number] = topic
        self._ask_for(number)

    def call(self, service: int, request: bytes) -> None:
        """Call a service with a serialised request, and wait for its answer."""
        known = len(self.answers)
        self._socket.send(struct.pack("<BIII", CALL, service, known + 1, 3) + b"cdr" + request)
        self.wait_until(lambda: len(self.answers) > known, "an answer of the service")

    def newest(self, topic: str) -> bytes:
        """Return the last message of a topic; waits for one."""
        self.wait_until(lambda: any(name == topic for name, _ in self.messages), f"message of {topic}")
        return [data for name, data in self.messages if name == topic][-1]


def start_live(start: Start, *words: str) -> tuple[StartedProcess, str]:
    live = start("fin_bringup", "live", *words)
    live.wait_for_output("in Foxglove or Lichtblick")
    (address,) = re.findall(r"open (ws://\S+) in", live.output())
    return live, address


def test_a_viewer_sees_the_fish_calls_a_service_and_sets_a_parameter(start: Start) -> None:
    start("fin_sim", "simulator").wait_for_output("kernel ready", 250.0)
    live, address = start_live(start, "--port", "0")
    with Viewer(address) as viewer:
        for topic in ("/fish/robot_description", "/fish/joint_states", "/tf", "/fish/pose"):
            viewer.subscribe(topic)
        frames = Frames.from_urdf(decode(viewer.newest("/fish/robot_description"), "std_msgs/msg/String").data)
        transforms = decode(viewer.newest("/tf"), "tf2_msgs/msg/TFMessage").transforms
        assert [each.header.frame_id for each in transforms][:2] == ["tank", "base_link"]
        assert len(transforms) == 1 + len(frames.joints)
        assert viewer.channels["/tf"]["schemaEncoding"] == "ros2msg"
        joints = decode(viewer.newest("/fish/joint_states"), "sensor_msgs/msg/JointState")
        assert joints.name == [joint.name for joint in frames.joints]
        name = "/fish/simulator/request_reset"
        viewer.wait_until(lambda: name in viewer.services, "services")
        service = viewer.services[name]
        assert service["response"]["schema"] == "bool success\nstring message\n"
        viewer.call(service["id"], b"\x00\x01\x00\x00\x00")
        assert b"the fish is at rest at the origin" in viewer.answers[-1]
        viewer.send(op="getParameters", parameterNames=["/fish/simulator.fin.length"], id="one")
        viewer.wait_until(lambda: [each for each in viewer.said if each["op"] == "parameterValues"], "a parameter")
        (told,) = [each for each in viewer.said if each["op"] == "parameterValues"][-1]["parameters"]
        assert (told["name"], told["value"]) == ("/fish/simulator.fin.length", 0.08)
        told["value"] = 0.06
        viewer.said.clear()
        viewer.send(op="setParameters", parameters=[told], id="two")
        viewer.wait_until(lambda: [each for each in viewer.said if each["op"] == "parameterValues"], "the new value")
        (told,) = [each for each in viewer.said if each["op"] == "parameterValues"][-1]["parameters"]
        assert told["value"] == 0.06
        viewer.call(viewer.services["/fish/simulator/estop"]["id"], b"\x00\x01\x00\x00\x00")
        assert b"a viewer only stops" in viewer.answers[-1]
    with Viewer(address) as again:  # the first one is gone without a word
        again.subscribe("/fish/velocity")
        again.newest("/fish/velocity")
    assert live.running


def test_a_second_live_server_on_one_port_says_so_and_the_first_goes_on(start: Start) -> None:
    live, address = start_live(start, "--port", "0")
    port = address.rpartition(":")[2]
    second = start("fin_bringup", "live", "--port", port)
    assert second.wait() == 2
    assert f"cannot listen at localhost:{port}" in second.output()
    assert "Give --port" in second.output()
    with Viewer(address) as viewer:
        viewer.wait_until(lambda: viewer.said, "the first server")
    assert live.running


def test_beyond_this_computer_a_viewer_needs_the_token(start: Start) -> None:
    _, address = start_live(start, "--host", "0.0.0.0", "--port", "0")  # noqa: S104  (what is tested)
    reached = address.replace("0.0.0.0", "127.0.0.1")  # noqa: S104
    with Viewer(reached) as viewer:
        viewer.wait_until(lambda: viewer.said, "the server")
    with pytest.raises(InvalidStatus, match="401"), Viewer(reached.partition("?")[0]):
        pass
