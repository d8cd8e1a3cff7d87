"""The recorder and a plant that sends as fast as its listeners acknowledge: every message is in the bag."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import Twist
from rclpy.qos import qos_profile_sensor_data

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag, read_velocity
from fin_optimizer.score.mean_speed import Measurement, score
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.trial.recorder import Recorder
from fin_plant import topics
from fin_plant.discovery import End, look_around
from support.waiting import PATIENCE, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rclpy.node import Node

pytestmark = pytest.mark.graph

SAMPLES = 5000
STREAMS = (topics.JOINT_STATES, topics.POSE, topics.VELOCITY, topics.THRUST)
PLANT = """
import sys, time
import rclpy
from rclpy.duration import Duration
from fin_plant import topics
from fin_plant.messages import plant_state_message, time_message
from fin_plant.plant_state import PlantState, State

START, STEP, SLICE = 1_700_000_000 * 10**9, 10**7, 50
rclpy.init()
node = rclpy.create_node("simulator", namespace=topics.NAMESPACE)
make = lambda topic: node.create_publisher(topic.type, topic.name, topic.qos)
streams = [make(topic) for topic in (topics.JOINT_STATES, topics.POSE, topics.VELOCITY, topics.THRUST)]
state = make(topics.PLANT_STATE)
say = lambda name: state.publish(plant_state_message(PlantState(name, "simulator", START, fin={"fin.length": "0.08"})))
say(State.READY)
messages = [publisher.msg_type() for publisher in streams]
messages[0].position, messages[0].name = [0.1] * 10, [f"joint_{index}" for index in range(10)]
for line in sys.stdin:
    while any(publisher.get_subscription_count() < 1 for publisher in [*streams, state]):
        time.sleep(0.01)
    say(State.SWIMMING)
    for index in range(int(line)):
        for publisher, message in zip(streams, messages):
            message.header.stamp = time_message(START + index * STEP)
            message.header.frame_id = "base_link"
            if publisher is streams[2]:
                message.twist.linear.x = 0.1 * index / (index + 30)
            publisher.publish(message)
        if index % SLICE == SLICE - 1:
            for publisher in streams:
                assert publisher.wait_for_all_acked(Duration(seconds=20))
    say(State.READY)
    assert state.wait_for_all_acked(Duration(seconds=20))
    print("sent", line.strip(), flush=True)
"""


class Plant:
    """A process that publishes a swim of so many samples whenever asked to."""

    def __init__(self, domain: int) -> None:
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "PYTHONPATH": os.pathsep.join(sys.path)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", PLANT],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        self.sent = threading.Event()

    def send(self, samples: int) -> None:
        """Start to publish so many samples of each stream; ``sent`` is set when all are acknowledged."""
        assert self._process.stdin is not None
        self.sent.clear()
        self._process.stdin.write(f"{samples}\n")
        self._process.stdin.flush()
        threading.Thread(target=self._wait, daemon=True).start()

    def _wait(self) -> None:
        assert self._process.stdout is not None
        if self._process.stdout.readline().startswith("sent"):
            self.sent.set()

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def plant(ros_domain: int) -> Iterator[Plant]:
    process = Plant(ros_domain)
    yield process
    process.close()


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = rclpy.create_node("optimizer", namespace=topics.NAMESPACE, context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def listen_until(recorder: Recorder, condition: Callable[[], object], what: str) -> None:
    def turn() -> None:
        recorder.listen()
        time.sleep(0.002)

    wait_until(condition, 30.0, what, meanwhile=turn)


def recorded(plant: Plant, recorder: Recorder, path: Path, samples: int, measurement: Measurement | None = None) -> Any:
    """Record a swim of the plant; return the bag's summary."""
    listen_until(recorder, lambda: not recorder.unmatched([*STREAMS, topics.PLANT_STATE]), "publisher")
    listen_until(recorder, lambda: recorder.received(topics.PLANT_STATE), "plant_state")
    recorder.open(path, (measurement or Measurement()).metadata(), measurement)
    plant.send(samples)
    listen_until(recorder, plant.sent.is_set, "end of the swim")
    return recorder.close()


def test_every_message_of_a_fast_swim_is_in_the_bag_and_scores_the_same(
    plant: Plant, node: Node, tmp_path: Path
) -> None:
    recorder = Recorder(node)
    summary = recorded(plant, recorder, tmp_path / "trial_0001", SAMPLES)
    assert {topic.name: summary.counts[f"/fish/{topic.name}"] for topic in STREAMS} == dict.fromkeys(
        (topic.name for topic in STREAMS), SAMPLES
    )
    assert recorder.newest_stamp() == 1_700_000_000 * 10**9 + (SAMPLES - 1) * 10**7
    bag = read_bag(summary.path)
    assert bag.counts == summary.counts
    states = [message.message for _, message in bag.decoded("plant_state")]
    assert states[:2] == ["READY", "SWIMMING"]  # what was latched before the bag was opened comes first
    stamps, speed = recorder.velocity_samples()
    assert np.array_equal(stamps, read_velocity(summary.path)[0])
    live = score(stamps, speed, Measurement().window(1_700_000_000 * 10**9))
    assert score_bag(summary.path)[0] == live
    recorder.destroy()


def test_a_bag_ends_shortly_after_the_window_however_far_the_plant_goes_on(
    plant: Plant, node: Node, tmp_path: Path
) -> None:
    recorder = Recorder(node)
    measurement = Measurement(settle=0.5, duration=1.0)
    summary = recorded(plant, recorder, tmp_path / "trial_0001", 1000, measurement)
    assert recorder.received(topics.VELOCITY) == 1000
    assert summary.duration_ns == 2 * 10**9  # half a second to settle, one that counts, half a second more
    assert {summary.counts[f"/fish/{topic.name}"] for topic in STREAMS} == {201}
    assert summary.counts["/fish/plant_state"] == 3
    live = score(*recorder.velocity_samples(), measurement.window(1_700_000_000 * 10**9))
    assert score_bag(summary.path)[0] == live
    recorder.destroy()


def test_one_recorder_writes_bag_after_bag(plant: Plant, node: Node, tmp_path: Path) -> None:
    recorder = Recorder(node)
    for number in (1, 2, 3):
        summary = recorded(plant, recorder, tmp_path / f"trial_{number}", 100 * number)
        assert summary.counts["/fish/velocity"] == 100 * number
        assert recorder.velocity_samples()[0].size == 100 * number
        assert recorder.failure is None
    recorder.destroy()


def test_a_disk_that_fills_up_is_told_and_the_next_bag_works(
    plant: Plant, node: Node, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(node)
    recorder.open(tmp_path / "lost", {})

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        plant.send(100)
        listen_until(recorder, lambda: recorder.failure, "failure")
        assert "lost: No space left on device" in str(recorder.failure)
        listen_until(recorder, plant.sent.is_set, "end of the swim: a full disk must not hold the plant back")
        with pytest.raises(BagError, match="lost: No space left on device"):
            recorder.close()
    assert recorder.failure is None
    assert recorded(plant, recorder, tmp_path / "next", 100).counts["/fish/velocity"] == 100
    recorder.destroy()


FORGETFUL = """
import sys
from pathlib import Path
import rclpy
from fin_optimizer.trial.recorder import Recorder
rclpy.init()
node = rclpy.create_node("optimizer")
recorder = Recorder(node)
recorder.open(Path(sys.argv[1]), {"trial.number": "1"})
sys.exit(3)
"""


def test_a_program_that_forgets_to_close_still_ends_and_leaves_a_whole_bag(ros_domain: int, tmp_path: Path) -> None:
    environment = os.environ | {"ROS_DOMAIN_ID": str(ros_domain), "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", FORGETFUL, str(tmp_path / "bag")]
    assert subprocess.run(command, env=environment, check=False, timeout=PATIENCE).returncode == 3
    bag = read_bag(tmp_path / "bag")
    assert (bag.complete, bag.metadata) == (True, {"trial.number": "1"})


LESS_THAN_USUAL = """
import sys, time
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from fin_plant import topics
from fin_plant.messages import time_message

rclpy.init()
node = rclpy.create_node("tracker", namespace=topics.NAMESPACE)
qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
publishers = [node.create_publisher(topic.type, topic.name, qos) for topic in (topics.POSE, topics.VELOCITY)]
publishers += [node.create_publisher(topics.GAIT_APPLIED.type, topics.GAIT_APPLIED.name, QoSProfile(depth=1))]
while True:
    for publisher in publishers:
        message = publisher.msg_type()
        if publisher is not publishers[2]:
            message.header.stamp = time_message(time.time_ns())
        publisher.publish(message)
    time.sleep(0.01)
"""


@pytest.mark.parametrize("late", [False, True])
def test_publishers_that_offer_less_than_is_usual_are_recorded(
    node: Node, tmp_path: Path, ros_domain: int, late: bool
) -> None:
    """As many trackers do; also one that is seen only after the bag was opened."""
    less = (topics.POSE, topics.VELOCITY, topics.GAIT_APPLIED)
    recorder = Recorder(node)
    environment = os.environ | {"ROS_DOMAIN_ID": str(ros_domain), "PYTHONPATH": os.pathsep.join(sys.path)}
    tracker = subprocess.Popen([sys.executable, "-c", LESS_THAN_USUAL], env=environment, start_new_session=True)
    try:
        if not late:
            wait_until(lambda: all(map(recorder.received, less)), 20, "what a tracker sends", recorder.listen)
        recorder.open(tmp_path / "bag", {})
        wait_until(lambda: not recorder.unmatched(less), 20, "publishers", recorder.listen)
        before = {topic.name: recorder.received(topic) for topic in less}
        wait_until(
            lambda: all(recorder.received(topic) > before[topic.name] + 20 for topic in less),
            20,
            "messages in the bag",
            recorder.listen,
        )
        recorder.close()
    finally:
        tracker.kill()
        tracker.communicate()
        recorder.destroy()
    bag = read_bag(tmp_path / "bag")
    assert all(bag.counts[f"/fish/{topic.name}"] > 20 for topic in less)
    if not late:
        offered = bag.offered("/fish/pose")
        assert (offered.reliability.name, offered.durability.name) == ("BEST_EFFORT", "VOLATILE")


def test_what_others_publish_is_seen_with_its_type_and_quality_of_service(node: Node, ros_domain: int) -> None:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    other = rclpy.create_node("mocap", namespace="/tank", context=context)
    hidden = rclpy.create_node("_hidden", context=context)
    try:
        node.create_publisher(topics.VELOCITY.type, "/tank/velocity", topics.VELOCITY.qos)
        other.create_publisher(Twist, "/tank/velocity", qos_profile_sensor_data)
        expected = [End("/tank/mocap", "geometry_msgs/msg/Twist", reliable=False)]

        def arrived() -> bool:
            sight = look_around(node)
            return sight.publishers.get("/tank/velocity") == expected and sight.nodes == ["/tank/mocap"]

        wait_until(arrived, 20, lambda: f"the other node, seen is {look_around(node)}")
        assert "/tank/mocap/get_parameters" in look_around(node).services
    finally:
        for each in (other, hidden):
            each.destroy_node()
        rclpy.shutdown(context=context)


def test_the_recorder_says_what_is_missing_and_refuses_wrong_use(node: Node, tmp_path: Path) -> None:
    recorder = Recorder(node, topics=(topics.VELOCITY, topics.PLANT_STATE))
    assert recorder.unmatched([topics.VELOCITY, topics.PLANT_STATE]) == ["velocity", "plant_state"]
    assert recorder.newest_stamp() is None
    with pytest.raises(ValueError, match="topic pose is not recorded: recorded are velocity, plant_state"):
        recorder.received(topics.POSE)
    with pytest.raises(ValueError, match=r"messages of plant_state .* have no header"):
        recorder.newest_stamp(topics.PLANT_STATE)
    with pytest.raises(BagError, match="no bag is open"):
        recorder.close()
    recorder.open(tmp_path / "bag", {})
    with pytest.raises(BagError, match="still writes another one"):
        recorder.open(tmp_path / "other", {})
    recorder.destroy()
    assert read_bag(tmp_path / "bag").complete
