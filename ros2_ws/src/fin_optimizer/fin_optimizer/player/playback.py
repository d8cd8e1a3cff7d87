"""When the messages of a bag are played: silences are cut short, and every round goes on in time. Without ROS."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Iterable

LONGEST_SILENCE = 10 * NANOSECONDS
"""ns without a message after which a player steps to the next one."""
STEP = NANOSECONDS // 10
"""ns that a longer silence takes, and that lies between two rounds."""
_UNITS = ((365.25 * 86_400.0, "years"), (86_400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))


@dataclass(frozen=True)
class Jump:
    """A silence that is cut short: where it stands in the playing and how long it was, in s."""

    position: float
    length: float

    def __str__(self) -> str:
        """Say what was left out, and where."""
        size, unit = next(entry for entry in _UNITS if self.length >= entry[0])
        return f"{self.length / size:.1f} {unit} without a message after {self.position:.1f} s"


class Playback:
    """The messages of a bag in the order of their time, each with its position in the playing in ns.

    A message that was logged years before or after all others, because its sender's clock was not set, costs no years.

    Attributes:
        messages: Log time in ns, topic and serialised message.
        jumps: The silences that are cut short.
    """

    def __init__(self, messages: Iterable[tuple[str, int, bytes]]) -> None:
        """Order the messages, given as topic, log time in ns and bytes."""
        self.messages = sorted(((stamp, topic, data) for topic, stamp, data in messages), key=lambda item: item[0])
        self._at = [0] if self.messages else []
        self.jumps: list[Jump] = []
        for (before, *_), (after, *_) in pairwise(self.messages):
            silence = after - before
            if silence > LONGEST_SILENCE:
                self.jumps.append(Jump(self._at[-1] / NANOSECONDS, silence / NANOSECONDS))
                silence = STEP
            self._at.append(self._at[-1] + silence)

    @property
    def length(self) -> int:
        """Position in ns of the last message."""
        return self._at[-1] if self._at else 0

    def first_at(self, position: int) -> int:
        """Return the number of the first message at a position in ns or after it."""
        return bisect_left(self._at, position)

    def position(self, number: int) -> int:
        """Return the position of a message in ns."""
        return self._at[number]

    def clock(self, position: int) -> int:
        """Return the bag's time in ns at a position; it rises with the position, from the first message's on."""
        number = max(0, bisect_right(self._at, position) - 1)
        return self.messages[number][0] + position - self._at[number] if self.messages else 0

    def round_length(self, start: int) -> int:
        """Return by how many ns the times of each further round are later, if it begins at the position ``start``."""
        return self.clock(self.length) - self.clock(start) + STEP
