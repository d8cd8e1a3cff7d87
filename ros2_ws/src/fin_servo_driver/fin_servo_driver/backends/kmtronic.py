"""KMTronic relay boards: ``FF channel state``. They answer nothing to it and stay in their last state.

So nothing tells the board from an echo or from nothing: it is taken on trust, no "off" is confirmed, and a restart,
after which all relays are off, is not noticed. Frames are repeated while the tail is at rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_servo_driver.backends.backend import RelayBackend

if TYPE_CHECKING:
    from fin_servo_driver.line import Line


def switch_frame(channel: int, *, on: bool) -> bytes:
    """Return the frame that switches a relay."""
    return bytes((0xFF, channel, int(on)))


class Kmtronic(RelayBackend):
    """The back end."""

    channels = range(1, 9)
    baud = 9600
    frame_bytes = 3

    def identify(self, line: Line) -> str:
        """Take the board on trust: it has no way to answer, so a wrong device is not noticed."""
        del line
        return "KMTronic relays (they never answer: make sure by the click of a relay)"

    def switch(self, line: Line, channel: int, *, on: bool) -> None:
        """Switch one relay."""
        line.write(switch_frame(channel, on=on))
