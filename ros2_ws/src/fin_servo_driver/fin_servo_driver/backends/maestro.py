"""Pololu Maestro servo controllers, compact protocol (Pololu Maestro User's Guide, sections 5.c and 5.e).

Its serial timeout is off unless it is set in the maker's Control Center; docs/robot.md has it on the checklist.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_servo_driver.backends.backend import NOTHING, Backend, Feedback, LifeSign
from fin_servo_driver.line import WrongDeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

GO_HOME = b"\xa2"
GET_ERRORS = b"\xa1"
BAUD_INDICATION = b"\xaa"
"""In the mode "UART, detect baud rate" the device listens only after this byte."""
SERIAL_TIMEOUT = 1 << 5
"""The bit of the errors."""
STOP_PULSES = 0
"""As a target: the channel sends no pulses."""
QUARTERS = 4
"""Targets are in quarters of a microsecond."""
_ERRORS = (
    "serial signal error",
    "serial overrun",
    "serial buffer full",
    "serial CRC error",
    "serial protocol error",
    "serial timeout: the device went to its own safe state",
    "script stack error",
    "script call stack error",
    "script program counter error",
)
_ANSWER_BYTES = 2
_ANSWER_SECONDS = 0.5
_ASK_EVERY, _SILENCE = 0.2, 3.0
"""s. Questions keep its serial timeout, 0.5 s by the checklist, from running out while the tail is at rest."""


def target(channel: int, quarters: int) -> bytes:
    """Return the frame that sets one target in quarters of a us: ``84 channel low high``."""
    return bytes((0x84, channel, *_pair(quarters)))


def targets(first_channel: int, quarters: Sequence[int]) -> bytes:
    """Return the frame for several channels in a row: ``9F count first low high ...`` (Mini Maestro only)."""
    return bytes((0x9F, len(quarters), first_channel, *(byte for value in quarters for byte in _pair(value))))


def speed(channel: int, value: int) -> bytes:
    """Return the frame that limits a channel's speed, in 0.25 us / 10 ms: ``87 channel low high``."""
    return bytes((0x87, channel, *_pair(value)))


def errors(answer: bytes) -> list[str]:
    """Return the errors that the two bytes answered to ``A1`` stand for."""
    bits = answer[0] | answer[1] << 8
    return [text for position, text in enumerate(_ERRORS) if bits >> position & 1]


def _pair(value: int) -> tuple[int, int]:
    return value & 0x7F, value >> 7 & 0x7F


class Maestro(Backend):
    """The back end. Option ``model``: number of channels, 6, 12, 18 or 24; ``detect_baud``: send AA first."""

    drives = "servos"
    unit = "us"
    channels = range(24)
    lowest = 64.0
    highest = 3280.0
    rate = 50.0
    baud = 115200
    options = ("model", "detect_baud")

    def __init__(self, robot: Robot) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints or options that this device cannot have.
        """
        super().__init__(robot)
        model = checks.choice("options: model", str(robot.options.get("model", 6)), ("6", "12", "18", "24"))
        used = [joint.channel for joint in robot.servos]
        if max(used) >= int(model):
            msg = f"channel {max(used)} is not one of a Maestro with {model} channels: set options: model to yours"
            raise ValueError(msg)
        # The Micro Maestro with its 6 channels does not know the frame for several.
        in_a_row = used == list(range(used[0], used[0] + len(used)))
        self._together = model != "6" and in_a_row and len(used) > 1
        self._answer = bytearray()
        self._life = LifeSign(_ASK_EVERY, _SILENCE)

    def identify(self, line: Line) -> str:
        """Ask for the errors, which every Maestro answers with two bytes."""
        if self.robot.options.get("detect_baud"):
            line.write(BAUD_INDICATION)
        line.read(0.0)
        line.write(GET_ERRORS)
        answer = bytearray()
        deadline = time.monotonic() + _ANSWER_SECONDS
        while len(answer) < _ANSWER_BYTES and time.monotonic() < deadline:
            answer += line.read(0.05)
        if len(answer) != _ANSWER_BYTES or answer[1] >> 1:
            msg = (
                f"no Maestro answers: asked for its errors it sent {answer.hex(' ') or 'nothing'}, expected are two "
                "bytes; in the Control Center choose USB Dual Port and its Command Port, or UART with this baud "
                f"rate ({self.robot.baud or self.baud}) and without CRC"
            )
            raise WrongDeviceError(msg)
        self._life = LifeSign(_ASK_EVERY, _SILENCE)
        self._answer = bytearray()
        complaints = errors(bytes(answer))
        return f"Maestro, errors before: {', '.join(complaints) or 'none'}"

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Send neutral, which starts the pulses."""
        self._answer = bytearray()
        self.send(line, neutral)

    def send(self, line: Line, outputs: Outputs) -> None:
        """Send a target to each channel, in one frame where the model has it."""
        quarters = {channel: round(width * QUARTERS) for channel, width in outputs.items()}
        if self._together:
            line.write(targets(min(quarters), list(quarters.values())))
        else:
            line.write(b"".join(target(channel, value) for channel, value in quarters.items()))

    def disable(self, line: Line) -> None:
        """Stop the pulses."""
        line.write(b"".join(target(joint.channel, STOP_PULSES) for joint in self.robot.servos))

    def read(self, line: Line) -> Feedback:
        """Ask for errors five times a second; return those that came."""
        self._answer += line.read(0.0)
        feedback = NOTHING
        if len(self._answer) >= _ANSWER_BYTES:
            feedback = Feedback(fault=", ".join(errors(bytes(self._answer[:_ANSWER_BYTES]))))
            self._answer = bytearray()
            self._life.heard()
        if self._life.due():
            self._answer = bytearray()
            line.write(GET_ERRORS)
        return feedback
