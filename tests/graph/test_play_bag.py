"""A played bag is the trial again: same messages, same score for who listens; and it moves nothing by itself."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
import yaml
import zstandard
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from fin_optimizer.bags.messages import header_stamp
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.player.display import PlayDisplay
from fin_optimizer.player.node import Options, Player
from fin_optimizer.score.mean_speed import Measurement, score
from fin_optimizer.score.recorded import recorded_swim, score_bag
from fin_optimizer.score.swim import start_of_swim
from fin_optimizer.trial.recorder import Recorder
from fin_plant import topics
from support.bags import START, STATE, STEP, gait, state, write_swim
from support.foreign_bags import RECORDED_QOS, plain_mcap
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
SWIM = 1.0


class Listener:
    """A node that records what a namespace offers, and calls the player's services."""

    def __init__(self, domain: int, namespace: str) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node("listener", context=self._context)
        self.recorder = Recorder(self.node, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def wait(self, condition: Callable[[], object], what: str) -> None:
        """Spin until the condition holds."""
        wait_until(condition, 20, what, self._turn)

    def _turn(self) -> None:
        self._executor.spin_once(timeout_sec=0.02)
        self.recorder.listen()

    def call(self, name: str) -> Any:
        """Call a service of the player."""
        client = self.node.create_client(Trigger, f"/player/{name}")
        self.wait(client.service_is_ready, f"service {name}")
        future = client.call_async(Trigger.Request())
        self.wait(future.done, f"answer of {name}")
        self.node.destroy_client(client)
        return future.result()

    def close(self) -> None:
        """Leave the graph."""
        self.recorder.destroy()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Callable[[str], Listener]]:
    listeners: list[Listener] = []

    def listen(namespace: str) -> Listener:
        listeners.append(Listener(ros_domain, namespace))
        return listeners[-1]

    yield listen
    for each in listeners:
        each.close()


@pytest.fixture
def swim(tmp_path: Path) -> Path:
    return write_swim(tmp_path / "trial_0007", SWIM)


def test_a_played_bag_gives_a_listener_every_message_and_the_same_score(
    start: Start, swim: Path, tmp_path: Path, listener: Callable[[str], Listener]
) -> None:
    listening = listener("/replay")
    remaps = [w for n in ("velocity", "plant_state") for w in ("-r", f"/fish/{n}:=/replay/{n}")]
    player = start("fin_optimizer", "play_bag", str(swim), "--paused", "--rate", "0", "--ros-args", *remaps)
    listening.wait(
        lambda: not listening.recorder.unmatched([topics.VELOCITY, topics.PLANT_STATE]), "the player's topics"
    )
    assert listening.recorder.unmatched([topics.GAIT]) == ["gait"]
    listening.recorder.open(tmp_path / "again", read_bag(swim).metadata)
    assert listening.call("pause").message == "it is paused already"
    assert listening.call("resume").message == "playing from 0.000 s"
    listening.wait(lambda: not player.running, "the end of the bag")
    assert player.wait() == 0
    assert "left out: /fish/gait; --topics plays what it names" in player.output()
    listening.recorder.close()
    live, recorded = score_bag(swim)
    begun = start_of_swim(recorded_swim(recorded, {}).states, recorded.metadata)
    window = Measurement.from_metadata(recorded.metadata).window(begun)
    assert score(*listening.recorder.velocity_samples(), window) == live
    assert score_bag(tmp_path / "again")[0] == live
    sent = [(stamp, data) for _, stamp, data in recorded.messages("velocity")]
    assert [(s, d) for _, s, d in read_bag(tmp_path / "again").messages("velocity")] == sent


@pytest.mark.parametrize("rate", ["0", "1", "20"])
def test_a_listener_that_was_there_before_hears_every_message_and_the_same_score(
    start: Start, swim: Path, tmp_path: Path, listener: Callable[[str], Listener], rate: str
) -> None:
    listening = listener("/fish")
    listening.recorder.open(tmp_path / "again", read_bag(swim).metadata)
    player = start("fin_optimizer", "play_bag", str(swim), "--rate", rate)
    listening.wait(lambda: not player.running, "the end of the bag")
    assert player.wait() == 0
    listening.recorder.close()
    live, recorded = score_bag(swim)
    again, bag = score_bag(tmp_path / "again")
    assert again == live
    assert {name: bag.counts[name] for name in recorded.counts} == {**recorded.counts, "/fish/gait": 0}
    assert f"played {sum(recorded.counts.values()) - 1} messages, 1.0 s\n" in player.output()


def test_a_listener_that_asks_for_more_than_was_offered_is_named(
    start: Start, swim: Path, listener: Callable[[str], Listener]
) -> None:
    node = listener("/elsewhere").node
    node.create_subscription(topics.VELOCITY.type, "/fish/velocity", lambda _: None, topics.LATCHED)
    player = start("fin_optimizer", "play_bag", str(swim), "--rate", "0")
    assert player.wait() == 0
    assert (
        "; /listener listens to topic /fish/velocity and asks for transient local (it is volatile)" in player.output()
    )


def test_a_topic_that_somebody_publishes_already_is_played_only_elsewhere_or_by_name(
    start: Start, swim: Path, tmp_path: Path, listener: Callable[[str], Listener]
) -> None:
    listening = listener("/fish")
    listening.node.create_publisher(topics.PLANT_STATE.type, "/fish/plant_state", topics.PLANT_STATE.qos)
    player = start("fin_optimizer", "play_bag", str(swim), "--rate", "0", "--paused")
    assert player.wait() == 2
    assert "play_bag: error: /fish/plant_state: published already by /listener." in player.output()
    assert "-r /fish/plant_state:=/replay/plant_state" in player.output()
    assert "ROS_DOMAIN_ID" in player.output()
    for words in (
        ("--ros-args", "-r", "/fish/plant_state:=/replay/plant_state"),
        ("--topics", "plant_state", "velocity"),
    ):
        player = start("fin_optimizer", "play_bag", str(swim), "--rate", "0", *words)
        listening.wait(lambda: not player.running, "the end of the bag")  # noqa: B023
        assert player.wait() == 0


def test_the_gait_is_played_only_by_name_from_where_it_is_asked_and_again_and_again(
    start: Start, swim: Path, tmp_path: Path, listener: Callable[[str], Listener]
) -> None:
    listening = listener("/fish")
    listening.recorder.open(tmp_path / "gaits", {})
    words = ("--topics", "gait", "plant_state", "--rate", "20", "--loop")
    player = start("fin_optimizer", "play_bag", str(swim), *words)
    listening.wait(lambda: listening.recorder.received(topics.GAIT) >= 3, "the gait a third time")
    assert listening.recorder.received(topics.VELOCITY) == 0
    assert player.interrupt() == 130
    listening.recorder.close()
    assert {data for _, _, data in read_bag(tmp_path / "gaits").messages("gait")} == {gait()}


def test_a_bag_is_played_at_its_own_pace_with_a_clock_from_the_middle(
    start: Start, swim: Path, ros_domain: int, listener: Callable[[str], Listener]
) -> None:
    listening = listener("/fish")
    clocks: list[int] = []

    def note(message: Any) -> None:
        clocks.append(message.clock.sec * 10**9 + message.clock.nanosec)

    listening.node.create_subscription(topics.CLOCK.type, "/clock", note, topics.CLOCK.qos)
    player = start("fin_optimizer", "play_bag", str(swim), "--start", "0.5", "--rate", "0.5", "--paused")
    listening.wait(lambda: not listening.recorder.unmatched([topics.VELOCITY]), "the player's topics")
    assert listening.call("resume").success
    listening.wait(lambda: not player.running, "the end of the bag")
    stamps = listening.recorder.newest_stamp(topics.VELOCITY)
    assert stamps == START + round(SWIM * 10**9)
    assert listening.recorder.received(topics.VELOCITY) == 51
    assert clocks == sorted(clocks)
    assert clocks[0] >= START + 0.5e9


@pytest.mark.parametrize("rate", ["0", "50"])
def test_the_clock_comes_before_the_messages_of_its_time_and_every_round_is_later(
    swim: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch, rate: str
) -> None:
    said: list[tuple[str, int]] = []

    class Witness:
        """Stands for a publisher, so that the order of all that is said can be seen."""

        def __init__(self, publisher: Any, name: str) -> None:
            self._publisher, self._name = publisher, name

        def __getattr__(self, name: str) -> Any:
            return getattr(self._publisher, name)

        def publish(self, message: Any) -> None:
            clock = self._name == "clock"
            stamp = message.clock.sec * 10**9 + message.clock.nanosec if clock else header_stamp(message)
            said.append((self._name, stamp))

    rclpy.init(domain_id=ros_domain)
    try:
        player = Player(read_bag(swim), Options(("velocity",), float(rate), loop=True, quiet=True))
        publishers = {name: Witness(each, "velocity") for name, each in player._publishers.items()}
        monkeypatch.setattr(player, "_publishers", publishers)
        monkeypatch.setattr(player, "_clock", Witness(player._clock, "clock"))
        wait_until(lambda: len([1 for name, _ in said if name == "velocity"]) > 303, 30, "a fourth round", player.step)
        player.node.destroy_node()
    finally:
        rclpy.shutdown()
    for name in ("clock", "velocity"):
        stamps = [stamp for each, stamp in said if each == name]
        assert stamps == sorted(stamps)
    clock = 0
    for name, stamp in said:
        clock = stamp if name == "clock" else clock
        assert stamp <= clock
    velocities = [stamp for name, stamp in said if name == "velocity"]
    assert velocities[:101] == [START + index * STEP for index in range(101)]
    assert len(set(velocities)) == len(velocities)


def test_what_a_listener_cannot_understand_is_not_played_and_the_rest_is(
    start: Start, swim: Path, tmp_path: Path, listener: Callable[[str], Listener]
) -> None:
    own = read_bag(swim)
    types = {**own.topics, "/rosout": "rcl_interfaces/msg/Log", "/camera": "mocap4r2_msgs/msg/Markers"}
    types["/fish/pose"] = "geometry_msgs/msg/PoseStamped"
    messages = [
        ("/fish/pose", 0, b"\0\1\0\0no pose"),
        *((name, stamp, zstandard.compress(data)) for name, stamp, data in own.messages(*own.topics)),
    ]
    latched = yaml.safe_dump([{**RECORDED_QOS, "durability": "transient_local"}])
    plain_mcap(tmp_path / "foreign.mcap", types, messages, qos=latched)
    listening = listener("/fish")
    listening.recorder.open(tmp_path / "again", own.metadata)
    player = start("fin_optimizer", "play_bag", str(tmp_path / "foreign.mcap"), "--rate", "0")
    listening.wait(lambda: not player.running, "the end of the bag")
    assert player.wait() == 0
    listening.recorder.close()
    assert score_bag(tmp_path / "again")[0] == score_bag(swim)[0]
    assert "left out: /camera: its type mocap4r2_msgs/msg/Markers is not installed here" in player.output()
    assert "left out: /fish/pose: a message of 11 bytes is no geometry_msgs/msg/PoseStamped" in player.output()
    assert "left out: /fish/gait, /rosout; --topics plays what it names" in player.output()


class Terminal(io.StringIO):
    """A screen that keeps what was written to it."""

    def isatty(self) -> bool:
        """Say that a person looks at it."""
        return True


@pytest.mark.parametrize(("quiet", "shown"), [(False, "playing, round 2 5.0 of 10.0 s"), (True, "")])
def test_a_terminal_shows_how_far_the_playing_is_unless_it_is_to_be_quiet(
    monkeypatch: pytest.MonkeyPatch, quiet: bool, shown: str
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    screen = Terminal()
    monkeypatch.setattr("sys.stdout", screen)
    display = PlayDisplay(10.0, quiet=quiet)
    display.say("playing a bag")
    display.show(1.0, 5.0, 1, paused=False)
    display.end("played 7 messages")
    text = re.sub("\x1b\\[[0-9;?]*[A-Za-z]|[^ -~]", "", screen.getvalue())
    assert shown in re.sub(" +", " ", text)
    assert ("played 7 messages" in text) != quiet
    assert (text == "") == quiet


def test_a_bag_with_nothing_to_play_is_refused(start: Start, tmp_path: Path) -> None:
    plain_mcap(tmp_path / "b.mcap", {"/camera": "mocap4r2_msgs/msg/Markers"}, [("/camera", 1, b"")])
    player = start("fin_optimizer", "play_bag", str(tmp_path / "b.mcap"))
    assert player.wait() == 2
    assert player.output() == (
        f"play_bag: error: bag {tmp_path} holds no message to play; left out: /camera: its type "
        "mocap4r2_msgs/msg/Markers is not installed here\n"
    )


def test_a_bag_without_velocity_is_not_played_to_who_wants_velocities(start: Start, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "dry", (STATE,), {}) as writer:
        writer.write(STATE.name, state("SWIMMING", START))
    player = start("fin_optimizer", "play_bag", str(tmp_path / "dry"), "--topics", "velocity", "plant_state")
    assert player.wait() == 2
    assert "has 0 topics 'velocity', needed is one: it has /fish/plant_state" in player.output()


def test_a_topic_or_a_start_that_the_bag_does_not_have_is_refused(start: Start, swim: Path) -> None:
    player = start("fin_optimizer", "play_bag", str(swim), "--topics", "pose")
    assert player.wait() == 2
    assert "has 0 topics 'pose', needed is one" in player.output()
    player = start("fin_optimizer", "play_bag", str(swim), "--start", "5")
    assert player.wait() == 2
    assert "--start 5 s is behind the end of the bag, which is 1 s long" in player.output()
