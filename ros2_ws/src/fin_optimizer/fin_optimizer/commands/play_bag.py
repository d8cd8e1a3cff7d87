"""Command ``play_bag``: publishes a recorded trial again, byte for byte, with the quality of service of its publishers.

The rounds of ``--loop`` after the first are later: their clock and the stamps in the messages' headers go on, so that
who keeps a history by time (tf2, a plotter) need not forget it. Stamps inside a message stay.

`gait` is left out unless it is asked for by name: a recorded command must not move a fish because somebody wanted to
look at a plot. Likewise a topic is not played beside another publisher: a second plant fails a trial that is under way.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
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

from fin_optimizer.bags.integrity import UNGUARDED
from fin_optimizer.bags.messages import BagError, decode, has_header, is_known, shift_header
from fin_optimizer.bags.playback import Playback
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.play_display import PlayDisplay
from fin_plant import checks, node_process, topics
from fin_plant.command import EXIT_FAILURE, EXIT_OK, tell_error
from fin_plant.discovery import End, ends_of, nobody_hears, policies
from fin_plant.messages import time_message
from fin_plant.paths import given_path
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosbags.interfaces import Qos

    from fin_optimizer.bags.reader import Bag

_SLICE = 100
"""Messages published between two looks at the callbacks."""
_LARGEST_BACKLOG = topics.STREAM.depth // 2
"""Messages that may be on their way to the slowest listener, as the simulator has it."""
_ACKNOWLEDGE_WAIT = Duration(seconds=0.1)
_AT_ONCE = Duration(seconds=0.0)
_FAREWELL = Duration(seconds=5.0)
_CLOCK_PERIOD = 0.01
_IDLE = 0.1
_DISCOVERY = 0.5
"""s in which whoever listens or publishes already is discovered."""
_LONGEST_MATCHING = 5.0
"""s that the listeners discovered may take until they hear the player."""
_LATEST_CLOCK = (2**31 - 1) * NANOSECONDS
"""ns; a ROS time holds no later second."""
_OF_OTHERS = ("/rosout", "/parameter_events", topics.DIAGNOSTICS.name, topics.CLOCK.name)
"""What every node says of itself, and the clock, which the player offers itself: played only by name."""
_JUMPS_TOLD = 3


def chosen_topics(bag: Bag, asked: Sequence[str] | None) -> list[str]:
    """Return the absolute names of the topics to play: those asked for, or all but ``gait`` and what nodes say.

    Raises:
        BagError: The bag has no such topic.
    """
    if asked:
        return [bag.topic(name) for name in asked]
    return [name for name in bag.topics if not name.endswith(f"/{topics.GAIT.name}") and name not in _OF_OTHERS]


def message_class(type_name: str) -> type[Any]:
    """Return the class of a message type.

    Raises:
        ValueError: It is not installed here.
    """
    package, _, kind = type_name.partition("/msg/")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError, TypeError):
        msg = f"its type {type_name} is not installed here"
        raise ValueError(msg) from None
    return found


def unplayable(bag: Bag, names: Sequence[str], playback: Playback) -> dict[str, str]:
    """Return why topics cannot be played, by name: no listener could understand what would be sent."""
    first: dict[str, bytes] = {}
    for _, name, data in playback.messages:
        first.setdefault(name, data)
    reasons = {}
    for name in names:
        type_name = bag.topics[name]
        try:
            message_class(type_name)
            if name in first and is_known(type_name):
                decode(first[name], type_name)
        except (ValueError, BagError) as error:
            reasons[name] = str(error)
    return reasons


class Player:
    """The node: plays a bag at a pace, and can be paused."""

    def __init__(self, bag: Bag, given: argparse.Namespace) -> None:
        """Offer the bag's topics, and the services ``~/pause`` and ``~/resume``.

        Raises:
            BagError: A topic that the bag does not have, or damaged bytes.
            ValueError: Nothing to play, a start behind its end, or a topic that another node publishes.
        """
        names, playback, left_out = _what_to_play(bag, given)
        self.node = Node("player")
        self._rate: float = given.rate
        self._loop: bool = given.loop
        self._playback = playback
        self._types = {name: bag.topics[name] for name in names}
        self._start = round(given.start * NANOSECONDS)
        self._with_header = {name for name in names if is_known(bag.topics[name]) and has_header(bag.topics[name])}
        time.sleep(_DISCOVERY)
        if not given.topics:
            self._refuse_second_publishers(names)
        self._publishers = {
            name: self.node.create_publisher(message_class(bag.topics[name]), name, quality(bag.offered(name)))
            for name in names
        }
        self._wait_for_listeners()
        self._clock = self.node.create_publisher(topics.CLOCK.type, topics.CLOCK.name, topics.CLOCK.qos)
        self._backlog = self._round = self._sent = 0
        self._clock_due: float = 0.0
        self._paused: bool = given.paused
        self._code: int | None = None
        self._rewind()
        self.node.create_service(Trigger, "~/pause", self._on_pause)
        self.node.create_service(Trigger, "~/resume", self._on_resume)
        self._display = PlayDisplay(playback.length / NANOSECONDS, quiet=given.quiet)
        self._display.say(f"playing {bag.name}: {len(playback.messages)} messages of {', '.join(names)}")
        for line in left_out:
            self._display.say(line)

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
        self._next = self._playback.first_at(self._start)
        self._position_ns = self._start
        self._released = self._start - 1
        self._seen: float = time.monotonic()
        last = {name: data for _, name, data in self._playback.messages[: self._next]}
        for name, data in last.items():
            if self._publishers[name].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                self._publish(name, data)

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
        seconds: float = self._position_ns / NANOSECONDS
        return seconds

    @property
    def _later(self) -> int:
        """By how many ns the times of this round are later than the bag's."""
        return self._round * self._playback.round_length(self._start)

    def step(self) -> float:
        """Publish what is due; return how long the executor may wait for a callback."""
        now: float = time.monotonic()
        passed, self._seen = now - self._seen, now
        if self._code is not None:
            return 0.0
        self._display.show(now, self._position, self._round, paused=self._paused)
        if self._paused:
            return _IDLE
        if self._backlog >= _LARGEST_BACKLOG and not self._acknowledged(_ACKNOWLEDGE_WAIT):
            return 0.0
        self._advance(passed)
        if self._position_ns > self._released and (self._rate == 0.0 or now >= self._clock_due):
            self._release(now)
        self._publish_released()
        if self._next == len(self._playback.messages):
            self._end()
            return 0.0
        if self._rate == 0.0 or self._playback.position(self._next) <= self._released:
            return 0.0
        return min(max(0.0, self._clock_due - now), _CLOCK_PERIOD)

    def _advance(self, passed: float) -> None:
        """Go on by so many s of the wall clock; without a pace, by a backlog once all that was released is sent."""
        if self._rate > 0.0:
            position = self._position_ns + round(passed * self._rate * NANOSECONDS)
            self._position_ns = min(position, self._playback.length)
        elif self._playback.position(self._next) > self._released:
            ahead = min(self._next + _LARGEST_BACKLOG, len(self._playback.messages)) - 1
            self._position_ns = self._playback.position(ahead)

    def _release(self, now: float) -> None:
        """Say what time it is, and only then let messages of that time go: who waits for a time has it first."""
        self._clock_due = now + _CLOCK_PERIOD
        self._released = self._position_ns
        clock = min(self._playback.clock(self._position_ns) + self._later, _LATEST_CLOCK)
        self._clock.publish(Clock(clock=time_message(clock)))

    def _publish_released(self) -> None:
        last = min(self._next + _SLICE, len(self._playback.messages))
        while self._next < last and self._playback.position(self._next) <= self._released:
            _, name, data = self._playback.messages[self._next]
            self._publish(name, data)
            self._next += 1

    def _publish(self, name: str, data: bytes) -> None:
        moved = shift_header(data, self._later) if self._round and name in self._with_header else data
        self._publishers[name].publish(moved)
        self._backlog += 1
        self._sent += 1

    def _acknowledged(self, wait: Duration) -> bool:
        """Whether every listener has everything; faster than they are, the player waits for them."""
        if all(publisher.wait_for_all_acked(wait) for publisher in self._publishers.values()):
            self._backlog = 0
        return self._backlog == 0

    def _end(self) -> None:
        if self._loop:
            self._round += 1
            self._rewind()
            return
        heard = [name for name, publisher in self._publishers.items() if publisher.get_subscription_count()]
        if self._acknowledged(_FAREWELL):
            self._code = EXIT_OK
            nobody = "" if heard else f"; {self._who_was_deaf()}"
            self._display.end(f"played {self._sent} messages, {self._position:.1f} s{nobody}")
        else:
            self._code = EXIT_FAILURE
            self._display.end("")
            late = [name for name, publisher in self._publishers.items() if not publisher.wait_for_all_acked(_AT_ONCE)]
            tell_error(
                "play_bag",
                f"what was played was not taken within {_FAREWELL.nanoseconds / NANOSECONDS:g} s by every listener of "
                f"{', '.join(late) or 'its topics'}",
            )

    def _who_was_deaf(self) -> str:
        """Return why nothing that was played was heard."""
        deaf = []
        for name, publisher in self._publishers.items():
            full = self.node.resolve_topic_name(name)
            offered = End("", self._types[name], *policies(publisher.qos_profile))
            if ends := ends_of(self.node.get_subscriptions_info_by_topic(full)):
                deaf.append(nobody_hears(full, offered, ends))
        return "; ".join(filter(None, deaf)) or "nobody listened"

    def finished(self) -> int | None:
        """Return 0 once everything is played and was taken by who listens, 1 if it was not taken."""
        return self._code

    def close(self) -> None:
        """Leave the terminal as it was."""
        self._display.end("" if self._code is not None else f"stopped at {self._position:.1f} s")


def _what_to_play(bag: Bag, given: argparse.Namespace) -> tuple[list[str], Playback, list[str]]:
    """Return the topics to play, their messages, and what to say about everything else.

    Raises:
        BagError: A topic that the bag does not have, or damaged bytes.
        ValueError: Nothing to play, or a start behind the bag's end.
    """
    chosen = chosen_topics(bag, given.topics)
    reasons = unplayable(bag, chosen, Playback(bag.messages(*chosen)))
    if given.topics and reasons:
        raise ValueError("; ".join(f"{name} cannot be played: {why}" for name, why in reasons.items()))
    names = [name for name in chosen if name not in reasons]
    playback = Playback(bag.messages(*names))
    reasons = {**bag.left_out, **reasons}
    told = [f"left out: {name}: {why}" for name, why in reasons.items()]
    if unasked := [name for name in bag.topics if name not in chosen]:
        told.append(f"left out: {', '.join(unasked)}; --topics plays what it names")
    if not playback.messages:
        msg = "; ".join([f"bag {bag.name} holds no message to play", *told])
        raise ValueError(msg)
    if given.start * NANOSECONDS > playback.length:
        length = playback.length / NANOSECONDS
        msg = f"--start {given.start:g} s is behind the end of the bag, which is {length:g} s long"
        raise ValueError(msg)
    told += [f"steps over {jump}" for jump in playback.jumps[:_JUMPS_TOLD]]
    if (more := len(playback.jumps) - _JUMPS_TOLD) > 0:
        told.append(f"steps over {more} more silences of that kind")
    return names, playback, told


def quality(qos: Qos) -> QoSProfile:
    """Return a quality of service that a bag holds, for a publisher."""
    # What a late listener gets of a latched topic is as much as was offered; of others, nothing on its way is dropped.
    latched = qos.durability.name == DurabilityPolicy.TRANSIENT_LOCAL.name
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth if latched else max(qos.depth, topics.STREAM.depth),
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


def _positive(text: str) -> float:
    value = checks.read_number(text)
    if not (math.isfinite(value) and value >= 0.0):
        msg = f"{text} must be a finite number, 0 or more"
        raise argparse.ArgumentTypeError(msg)
    return value


def parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    words = argparse.ArgumentParser(
        prog="play_bag",
        description="Publish a recorded bag again. gait, /clock and what all nodes say of themselves are left out, and "
        "a topic that another node publishes is refused, unless --topics names it. /clock comes before the messages of "
        "its time; more than 10 s without a message are stepped over.",
        epilog="remaps and namespaces as for every node, for example --ros-args -r /fish/velocity:=/replay/velocity; "
        "services ~/pause and ~/resume",
    )
    words.add_argument("bag", type=given_path, metavar="BAG", help="folder of the bag, or its .mcap file")
    words.add_argument(
        "--rate", type=_positive, default=1.0, help="times the fish's pace; 0: as fast as listeners take it"
    )
    words.add_argument(
        "--start", type=_positive, default=0.0, metavar="S", help="begin so many s after the bag's beginning"
    )
    words.add_argument(
        "--loop", action="store_true", help="begin again at the end; clock and header stamps go on rising"
    )
    words.add_argument("--paused", action="store_true", help="wait for ~/resume")
    words.add_argument("--quiet", action="store_true", help="print errors only")
    words.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these, by their last name or in full")
    return words


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a bag; return 0 at its end, 2 if it cannot be played."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    own = words[: words.index("--ros-args")] if "--ros-args" in words else words
    given = parser().parse_args(own)

    def player() -> Any:
        try:
            bag = read_bag(given.bag)
            if not bag.guarded:
                sys.stderr.write(f"note: {bag.name} was {UNGUARDED}\n")
            return Player(bag, given)
        except BagError as error:
            raise ValueError(str(error)) from error

    return node_process.run(player, [sys.argv[0], *words])


if __name__ == "__main__":
    sys.exit(main())
