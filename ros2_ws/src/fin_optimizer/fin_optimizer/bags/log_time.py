"""At which time a message is logged in a bag: at its own stamp where that can be believed. Without ROS."""

from __future__ import annotations

from fin_plant.stamps import NANOSECONDS

FAR = 10 * NANOSECONDS
"""ns. Further from its topic's last stamp and from the newest of all, a stamp is of another clock, or of none."""
_YEAR = 365 * 86400 * NANOSECONDS
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
        first_unusable: What the first such stamp of a topic is.
    """

    def __init__(self, newest: int | None = None) -> None:
        """Begin at the time in ns that the plant is known to have, if it is known."""
        self.newest = newest
        self.unusable: dict[str, int] = {}
        self.first_unusable: dict[str, str] = {}
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
        self.first_unusable.setdefault(topic, _told(stamp, self.newest))
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


def _told(stamp: int, newest: int | None) -> str:
    """Return what a stamp in ns is that is not believed, against the newest one that was."""
    if stamp <= 0 or newest is None:
        return "zero, it was never set" if stamp == 0 else f"{stamp / NANOSECONDS:g} s, before 1970"
    apart = abs(stamp - newest)
    where = "before" if stamp < newest else "after"
    if apart > _YEAR:
        return f"{stamp / NANOSECONDS:.0f} s, decades from the plant's time: does its clock count from 1970?"
    return f"{apart / NANOSECONDS:.0f} s {where} the plant's time: do the two clocks agree?"
