"""Messages of one kind in bulk: serialised once, then filled with numbers row by row.

Building and converting a Python message object for every sample would take most of the time of a swim that runs
faster than real time. Here ROS serialises one message of the kind, with a mark in the place of each number; the marks
give the places, and numpy fills a whole slice of messages at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rclpy.serialization import serialize_message

from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from numpy.typing import NDArray

# A message that starts with a header starts with its stamp, right behind the four bytes that name the encoding.
_STAMP = slice(4, 12)


class MessageTemplate:
    """Serialised messages that differ in their header's stamp and in some numbers."""

    def __init__(self, build: Callable[[Sequence[float]], Any], numbers: int) -> None:
        """Learn where the numbers lie.

        Args:
            build: Makes a message with a header from so many numbers of type float64.
            numbers: How many.

        Raises:
            ValueError: ``build`` drops or repeats a number.
        """
        # No message of ours holds such numbers by chance.
        marks = -1.234567890123e-200 * (1.0 + np.arange(numbers))
        pattern: bytes = serialize_message(build(marks.tolist()))
        self._row = np.frombuffer(pattern, dtype=np.uint8)
        self._places: list[int] = []
        for mark in marks:
            if pattern.count(mark.tobytes()) != 1:
                msg = f"number {len(self._places) + 1} of {numbers} must stand in the message exactly once"
                raise ValueError(msg)
            self._places.append(pattern.index(mark.tobytes()))

    def fill(self, stamps: NDArray[np.int64], numbers: NDArray[np.float64]) -> list[bytes]:
        """Return serialised messages.

        Args:
            stamps: ns since the epoch, shape (messages,).
            numbers: Shape (messages, numbers).
        """
        count = len(stamps)
        rows = np.tile(self._row, (count, 1))
        halves = np.stack(np.divmod(stamps, NANOSECONDS), axis=1).astype("<u4")
        rows[:, _STAMP] = halves.view(np.uint8).reshape(count, 8)
        values = np.ascontiguousarray(numbers, dtype="<f8").view(np.uint8).reshape(count, -1, 8)
        for index, place in enumerate(self._places):
            rows[:, place : place + 8] = values[:, index]
        return [row.tobytes() for row in rows]
