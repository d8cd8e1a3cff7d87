"""The fish as a page draws it, seen from above, and its forward speed from where it is."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    Point = tuple[float, float]

_NANOSECONDS = 1e9
_DIGITS = 4
_SWUM = 0.5
"""s of the fish's time over which its speed is taken, at least: half a beat of the tail or more."""
_JUMP = 2.0
"""m/s. What is faster than that was put somewhere."""


@dataclass(frozen=True)
class Piece:
    """A part of the fish as a marker shows it: its middle in m, its heading in rad, length and width in m."""

    x: float
    y: float
    heading: float
    length: float
    width: float

    def end(self, side: float) -> Point:
        """Return its front (1) or its rear (-1)."""
        half = 0.5 * side * self.length
        return self.x + half * math.cos(self.heading), self.y + half * math.sin(self.heading)


@dataclass(frozen=True)
class Shape:
    """The fish at a moment.

    Attributes:
        stamp: ns of its own time.
        body: The ellipse.
        tail: Points from the body's joint to the fin's end.
        driven: How many links of the tail a servo moves; the others are the fin.
    """

    stamp: int
    body: Piece
    tail: tuple[Point, ...]
    driven: int

    @property
    def is_finite(self) -> bool:
        """Whether it can be drawn: a fish whose computation broke off is nowhere."""
        body = (self.body.x, self.body.y, self.body.heading, self.body.length, self.body.width)
        return all(map(math.isfinite, (*body, *(each for point in self.tail for each in point))))

    def told(self) -> dict[str, object]:
        """Return it as JSON has it, to a tenth of a mm."""
        body = self.body
        return {
            "body": [round(value, _DIGITS) for value in (body.x, body.y, body.heading, body.length, body.width)],
            "tail": [[round(x, _DIGITS), round(y, _DIGITS)] for x, y in self.tail],
            "driven": self.driven,
        }


def from_pieces(stamp: int, body: Piece, links: Sequence[Piece], driven: int) -> Shape:
    """Return the fish whose body and links, from the head to the tail, are markers."""
    points = [links[0].end(1.0), *(link.end(-1.0) for link in links)] if links else []
    return Shape(stamp, body, tuple(points), driven)


def from_joints(stamp: int, body: Piece, offset: float, lengths: Sequence[float], angles: Sequence[float]) -> Shape:
    """Return the fish of which the angles of the driven joints are known.

    Args:
        stamp: ns.
        body: The ellipse.
        offset: From the middle of the body back to the first joint, m.
        lengths: Of the links, m, the fin last.
        angles: Of the joints, each against the link before it, rad.
    """
    heading = body.heading
    x, y = body.x - offset * math.cos(heading), body.y - offset * math.sin(heading)
    points = [(x, y)]
    for length, angle in zip(lengths, angles, strict=False):
        heading += angle
        x, y = x - length * math.cos(heading), y - length * math.sin(heading)
        points.append((x, y))
    return Shape(stamp, body, tuple(points), max(len(points) - 2, 0))


class Speedometer:
    """Forward speed from where the fish was: its way along its heading over the last half second of its own time."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float, float, float]] = deque()

    def forget(self) -> None:
        """Start anew: the fish was put somewhere."""
        self._seen.clear()

    def speed(self, shape: Shape) -> float | None:
        """Return the speed in m/s up to this moment; None while too little is known."""
        body, time = shape.body, shape.stamp / _NANOSECONDS
        if self._seen and time <= self._seen[-1][0]:
            self.forget()
        self._seen.append((time, body.x, body.y, body.heading))
        while len(self._seen) > 2 and time - self._seen[1][0] >= _SWUM:  # noqa: PLR2004  (two make a speed)
            self._seen.popleft()
        begin, x, y, heading = self._seen[0]
        if time - begin < _SWUM:
            return None
        # The mean of the two headings as a direction, so that it may pass through half a turn.
        along_x, along_y = math.cos(heading) + math.cos(body.heading), math.sin(heading) + math.sin(body.heading)
        length = math.hypot(along_x, along_y) or 1.0
        speed = ((body.x - x) * along_x + (body.y - y) * along_y) / (length * (time - begin))
        if abs(speed) > _JUMP:
            self.forget()
            return None
        return speed
