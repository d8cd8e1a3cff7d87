"""At which time a message is logged in a bag: at its own stamp where that can be believed. Without ROS."""

from __future__ import annotations

from fin_optimizer.score import NANOSECONDS

FAR = 10 * NANOSECONDS
"""ns. Further from its topic's last stamp and from the newest of all, a stamp is of another clock, or of none."""
_AGREEING = 3
"""Far stamps near each other that every topic must bring until time itself has jumped: one alone is an error."""


class LogTime:
    """Follows the time of a plant by the stamps in its messages, and tells stamps that are none.

    A stamp that was never set is zero, a camera that counts from its own start is decades behind, and one message may
    be wrong by an hour. None of them may decide when the messages behind it were logged. But where all topics jump
    together, as after a computer slept, the plant's time has jumped.

    Attributes:
        newest: Latest stamp in ns that was believed; None before the first.
        unusable: Number of messages by topic whose stamp was not believed.
    """

    def __init__(self, newest: int | None = None) -> None:
        """Begin at the time in ns that the plant is known to have, if it is known."""
        self.newest = newest
        self.unusable: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._far: dict[str, tuple[int, int]] = {}

    def of(self, topic: str, stamp: int | None) -> int | None:
        """Return the time in ns at which a message is logged, None while no time is known.

        Args:
            topic: Of the message.
            stamp: In its header, in ns; None for a message without a header.
        """
        if stamp is None:
            return self.newest
        if stamp > 0 and (self._is_near(topic, stamp) or self._has_jumped(topic, stamp)):
            self.newest = stamp if self.newest is None else max(stamp, self.newest)
            self._last[topic] = stamp
            self._far.clear()
            return stamp
        self.unusable[topic] = self.unusable.get(topic, 0) + 1
        return self.newest

    def _is_near(self, topic: str, stamp: int) -> bool:
        if self.newest is None:
            return True
        return abs(stamp - self.newest) <= FAR or abs(stamp - self._last.get(topic, -FAR)) <= FAR

    def _has_jumped(self, topic: str, stamp: int) -> bool:
        """Whether all topics that were believed bring stamps near this one now; the newest is then forgotten."""
        count, before = self._far.get(topic, (0, stamp))
        self._far[topic] = (count + 1 if abs(stamp - before) <= FAR else 1, stamp)
        agree = {name for name, (count, last) in self._far.items() if count >= _AGREEING and abs(last - stamp) <= FAR}
        if topic not in agree or not self._last.keys() <= agree:
            return False
        self.newest = None
        self._last.clear()
        return True
