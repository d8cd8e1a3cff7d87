"""The node that publishes a recorded trial again, byte for byte, with the quality of service of its publishers.

The rounds of a loop after the first are later: their clock and the stamps in the messages' headers go on, so that
who keeps a history by time (tf2, a plotter) need not forget it. Stamps inside a message stay.

A topic is not played beside another publisher: a second plant fails a trial that is under way.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

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

from fin_optimizer.bags.messages import has_header, is_known, shift_header
from fin_optimizer.player.choice import choose, message_class
from fin_optimizer.player.display import PlayDisplay
from fin_plant import topics
from fin_plant.command import EXIT_FAILURE, EXIT_OK, tell_error
from fin_plant.discovery import End, ends_of, nobody_hears, policies
from fin_plant.messages import time_message
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


@dataclass(frozen=True)
class Options:
    """How a bag is played.

    Attributes:
        topics: Played, also those that are left out unasked; none for all others.
        rate: Times the fish's pace; 0 for as fast as listeners take it.
        start: s after the bag's beginning at which it begins.
        loop: Whether it begins again at the end.
        paused: Whether it waits for ``~/resume``.
        quiet: Whether it prints errors only.
    """

    topics: tuple[str, ...] = ()
    rate: float = 1.0
    start: float = 0.0
    loop: bool = False
    paused: bool = False
    quiet: bool = False


class Player:
    """The node: plays a bag at a pace, and can be paused."""

    def __init__(self, bag: Bag, options: Options) -> None:
        """Offer the bag's topics, and the services ``~/pause`` and ``~/resume``.

        Raises:
            BagError: A topic that the bag does not have, or damaged bytes.
            ValueError: Nothing to play, a start behind its end, or a topic that another node publishes.
        """
        choice = choose(bag, options.topics, options.start)
        names, playback = choice.names, choice.playback
        self.node = Node("player")
        self._rate = options.rate
        self._loop = options.loop
        self._playback = playback
        self._types = {name: bag.topics[name] for name in names}
        self._start = round(options.start * NANOSECONDS)
        self._with_header = {name for name in names if is_known(bag.topics[name]) and has_header(bag.topics[name])}
        time.sleep(_DISCOVERY)
        if not options.topics:
            self._refuse_second_publishers(names)
        self._publishers = {
            name: self.node.create_publisher(message_class(bag.topics[name]), name, _quality(bag.offered(name)))
            for name in names
        }
        self._wait_for_listeners()
        self._clock = self.node.create_publisher(topics.CLOCK.type, topics.CLOCK.name, topics.CLOCK.qos)
        self._backlog = self._round = self._sent = 0
        self._clock_due: float = 0.0
        self._paused = options.paused
        self._code: int | None = None
        self._rewind()
        self.node.create_service(Trigger, "~/pause", self._on_pause)
        self.node.create_service(Trigger, "~/resume", self._on_resume)
        self._display = PlayDisplay(playback.length / NANOSECONDS, quiet=options.quiet)
        self._display.say(f"playing {bag.name}: {len(playback.messages)} messages of {', '.join(names)}")
        for line in choice.told:
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


def _quality(qos: Qos) -> QoSProfile:
    """Return a quality of service that a bag holds, for a publisher."""
    # What a late listener gets of a latched topic is as much as was offered; of others, nothing on its way is dropped.
    latched = qos.durability.name == DurabilityPolicy.TRANSIENT_LOCAL.name
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth if latched else max(qos.depth, topics.STREAM.depth),
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )
