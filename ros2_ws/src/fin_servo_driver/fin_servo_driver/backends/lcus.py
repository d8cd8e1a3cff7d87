"""LCUS relay boards (USB, CH340): ``A0 channel state sum``. They answer nothing and stay in their last state.

So nothing tells the board from an echo or from nothing: it is taken on trust, no "off" is confirmed, and a restart,
after which all relays are off, is not noticed. Frames are repeated while the tail is at rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_servo_driver.backends.backend import RelayBackend

if TYPE_CHECKING:
    from fin_servo_driver.line import Line

_START = 0xA0


def switch_frame(channel: int, *, on: bool) -> bytes:
    """Return the frame that switches a relay; its fourth byte is the sum of the others."""
    return bytes((_START, channel, int(on), (_START + channel + int(on)) & 0xFF))


class Lcus(RelayBackend):
    """The back end."""

    channels = range(1, 17)
    baud = 9600
    frame_bytes = 4

    def identify(self, line: Line) -> str:
        """Take the board on trust: it has no way to answer, so a wrong device is not noticed."""
        del line
        return "LCUS relays (they never answer: make sure by the click of a relay)"

    def switch(self, line: Line, channel: int, *, on: bool) -> None:
        """Switch one relay."""
        line.write(switch_frame(channel, on=on))
