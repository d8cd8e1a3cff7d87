"""Command ``play_bag``: publishes a recorded trial again, byte for byte, with the quality of service of its publishers.

`gait` is left out unless it is asked for by name: a recorded command must not move a fish because somebody wanted to
look at a plot. Likewise a topic is not played beside another publisher: a second plant fails a trial that is under way.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from fin_optimizer.bag import BagError
from fin_optimizer.bag_reader import read_bag
from fin_plant import node_process, topics
from fin_plant.messages import NANOSECONDS, time_message

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.publisher import Publisher
    from rosbags.interfaces import Qos

    from fin_optimizer.bag_reader import Bag

_SLICE = 100
"""Messages published between two looks at the callbacks."""
_LARGEST_BACKLOG = topics.STREAM.depth // 2
"""Messages that may be on their way to the slowest listener, as the simulator has it."""
_ACKNOWLEDGE_WAIT = Duration(seconds=0.1)
_FAREWELL = Duration(seconds=5.0)
_CLOCK_PERIOD = 0.01
_IDLE = 0.1
_DISCOVERY = 0.5
"""s in which whoever listens or publishes already is discovered."""
_LONGEST_MATCHING = 5.0
"""s that the listeners discovered may take until they hear the player."""


def chosen_topics(bag: Bag, asked: Sequence[str] | None) -> list[str]:
    """Return the absolute names of the topics to play: those asked for, or all but ``gait``.

    Raises:
        BagError: The bag has no such topic.
    """
    if asked:
        return [bag.topic(name) for name in asked]
    return [name for name in bag.topics if not name.endswith(f"/{topics.GAIT.name}")]


class Player:
    """The node: plays a bag at a pace, and can be paused."""

    def __init__(self, bag: Bag, given: argparse.Namespace) -> None:
        """Offer the bag's topics, and the services ``~/pause`` and ``~/resume``.

        Raises:
            BagError: A topic that the bag does not have.
            ValueError: A start behind its end, or a topic that another node publishes.
        """
        self.node = Node("player")
        names = chosen_topics(bag, given.topics)
        self._rate: float = given.rate
        self._loop: bool = given.loop
        self._messages = sorted(
            ((stamp, name, data) for name, stamp, data in bag.messages(*names)), key=lambda item: item[0]
        )
        self._start = (self._messages[0][0] if self._messages else 0) + round(given.start * NANOSECONDS)
        if self._messages and self._start > self._messages[-1][0]:
            length = (self._messages[-1][0] - self._messages[0][0]) / NANOSECONDS
            msg = f"--start {given.start:g} s is behind the end of the bag, which is {length:g} s long"
            raise ValueError(msg)
        time.sleep(_DISCOVERY)
        if not given.topics:
            self._refuse_second_publishers(names)
        self._publishers = {name: self._publisher(bag, name) for name in names}
        self._wait_for_listeners()
        self._clock = self.node.create_publisher(topics.CLOCK.type, topics.CLOCK.name, topics.CLOCK.qos)
        self._backlog = 0
        self._clock_due = 0.0
        self._paused: bool = given.paused
        self._done = not self._messages
        self._rewind()
        self.node.create_service(Trigger, "~/pause", self._on_pause)
        self.node.create_service(Trigger, "~/resume", self._on_resume)
        left_out = [name for name in bag.topics if name not in names]
        print(f"playing {bag.path.parent}: {len(self._messages)} messages of {', '.join(names)}", flush=True)  # noqa: T201
        if left_out:
            print(f"left out: {', '.join(left_out)}; --topics plays what it names", flush=True)  # noqa: T201

    def _publisher(self, bag: Bag, name: str) -> Publisher:
        package, _, kind = bag.topics[name].split("/")
        message = getattr(importlib.import_module(f"{package}.msg"), kind)
        return self.node.create_publisher(message, name, quality(bag.offered(name)))

    def _refuse_second_publishers(self, names: Sequence[str]) -> None:
        """Look for topics that another node publishes.

        Raises:
            ValueError: There is one.
        """
        publishers = {name: self.node.get_publishers_info_by_topic(name) for name in names}
        if taken := [name for name in names if publishers[name]]:
            ends = [end for name in taken for end in publishers[name]]
            nodes = ", ".join(sorted({f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends}))
            msg = (
                f"{', '.join(map(self.node.resolve_topic_name, taken))}: published already by {nodes}. A second "
                "publisher would mislead who listens, and fail a trial that is under way. Play it under another name "
                f"(--ros-args -r {taken[0]}:=/replay/{taken[0].rpartition('/')[2]}, for each) or with another "
                "ROS_DOMAIN_ID; --topics plays what it names all the same"
            )
            raise ValueError(msg)

    def _wait_for_listeners(self) -> None:
        """Wait until the listeners that were discovered hear what is published from now on."""
        end = time.monotonic() + _LONGEST_MATCHING
        while not all(self._is_heard(name) for name in self._publishers) and time.monotonic() < end:
            time.sleep(_CLOCK_PERIOD)

    def _is_heard(self, name: str) -> bool:
        publisher = self._publishers[name]
        listeners = [
            listener
            for listener in self.node.get_subscriptions_info_by_topic(name)
            if qos_check_compatible(publisher.qos_profile, listener.qos_profile)[0] != QoSCompatibility.ERROR
        ]
        return bool(publisher.get_subscription_count() >= len(listeners))

    def _rewind(self) -> None:
        """Go to the start; what a latched topic said last before it is said again, since it still held."""
        self._next = next((i for i, item in enumerate(self._messages) if item[0] >= self._start), 0)
        self._now_ns = self._start
        self._seen = time.monotonic()
        last = {name: data for _, name, data in self._messages[: self._next]}
        for name, data in last.items():
            if self._publishers[name].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                self._publishers[name].publish(data)

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, self._paused = not self._paused, True
        response.message = f"paused at {self._position:.3f} s" if response.success else "it is paused already"
        return response

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, self._paused = self._paused, False
        response.message = f"playing from {self._position:.3f} s" if response.success else "it plays already"
        return response

    @property
    def _position(self) -> float:
        """Time in s since the bag's beginning."""
        return (self._now_ns - self._messages[0][0]) / NANOSECONDS if self._messages else 0.0

    def step(self) -> float:
        """Publish what is due; return how long the executor may wait for a callback."""
        now = time.monotonic()
        passed, self._seen = now - self._seen, now
        if self._done:
            return 0.0
        if self._paused:
            return _IDLE
        if self._backlog >= _LARGEST_BACKLOG and not self._acknowledged(_ACKNOWLEDGE_WAIT):
            return 0.0
        self._now_ns += round(passed * self._rate * NANOSECONDS)
        self._publish_due()
        self._publish_clock(now)
        if self._next == len(self._messages):
            self._end()
            return 0.0
        if self._rate == 0.0:
            return 0.0
        ahead: float = (self._messages[self._next][0] - self._now_ns) / NANOSECONDS / self._rate
        return min(max(0.0, ahead), _CLOCK_PERIOD)

    def _publish_due(self) -> None:
        last = min(self._next + _SLICE, len(self._messages))
        while self._next < last and (self._rate == 0.0 or self._messages[self._next][0] <= self._now_ns):
            stamp, name, data = self._messages[self._next]
            self._publishers[name].publish(data)
            self._next += 1
            self._backlog += 1
            if self._rate == 0.0:
                self._now_ns = stamp

    def _publish_clock(self, now: float) -> None:
        if now >= self._clock_due:
            self._clock_due = now + _CLOCK_PERIOD
            self._clock.publish(Clock(clock=time_message(self._now_ns)))

    def _acknowledged(self, wait: Duration) -> bool:
        """Whether every listener has everything; faster than they are, the player waits for them."""
        if all(publisher.wait_for_all_acked(wait) for publisher in self._publishers.values()):
            self._backlog = 0
        return self._backlog == 0

    def _end(self) -> None:
        if self._loop:
            self._rewind()
            return
        self._acknowledged(_FAREWELL)
        self._done = True

    def finished(self) -> int | None:
        """Return 0 once everything is played."""
        return node_process.EXIT_OK if self._done else None

    def close(self) -> None:
        """Nothing is left open."""


def quality(qos: Qos) -> QoSProfile:
    """Return a quality of service that a bag holds, for a publisher."""
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


def _positive(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and value >= 0.0):
        msg = f"{text} must be a finite number, 0 or more"
        raise argparse.ArgumentTypeError(msg)
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="play_bag",
        description="Publish a recorded trial again. gait is left out, and a topic that another node publishes is "
        "refused, unless --topics names it.",
        epilog="remaps and namespaces as for every node, for example --ros-args -r /fish/velocity:=/replay/velocity; "
        "services ~/pause and ~/resume",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of the bag, or its .mcap file")
    parser.add_argument(
        "--rate", type=_positive, default=1.0, help="times the fish's pace; 0: as fast as listeners take it"
    )
    parser.add_argument(
        "--start", type=_positive, default=0.0, metavar="S", help="begin so many s after the bag's beginning"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end, with the same stamps")
    parser.add_argument("--paused", action="store_true", help="wait for ~/resume")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these, by their last name or in full")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a bag; return 0 at its end, 2 if it cannot be played."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    own = words[: words.index("--ros-args")] if "--ros-args" in words else words
    given = _parser().parse_args(own)

    def player() -> Any:
        try:
            return Player(read_bag(given.bag), given)
        except BagError as error:
            raise ValueError(str(error)) from error

    return node_process.run(player, [sys.argv[0], *words])


if __name__ == "__main__":
    sys.exit(main())
