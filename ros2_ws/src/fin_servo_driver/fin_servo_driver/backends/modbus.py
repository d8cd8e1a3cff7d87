"""Modbus RTU relay boards: function 05, write single coil (Modbus Application Protocol 1.1b3, section 6.5).

Every frame is answered; the answer is awaited, since the next frame must not come before it.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_servo_driver.backends.backend import NOTHING, Feedback, LifeSign, RelayBackend
from fin_servo_driver.line import LineStalledError, WrongDeviceError

if TYPE_CHECKING:
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot

STANDARD_ON = 0xFF00
CLONE_ON = 0x0100
"""What some clones take for on."""
_READ_COILS, _WRITE_COIL, _EXCEPTION = 0x01, 0x05, 0x80
_SHORTEST_ANSWER = 5
_WRITE_ANSWER = 8
_ANSWER_SECONDS = 0.1
_TRIES = 3
_ASK_EVERY, _SILENCE = 1.0, 3.0


def crc16(data: bytes) -> bytes:
    """Return the CRC of Modbus over serial line (V1.02, appendix B), low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


def write_coil(unit: int, coil: int, value: int) -> bytes:
    """Return the frame that writes one coil: ``unit 05 coil value crc``."""
    body = bytes((unit, _WRITE_COIL)) + coil.to_bytes(2, "big") + value.to_bytes(2, "big")
    return body + crc16(body)


def read_coils(unit: int, first: int, count: int) -> bytes:
    """Return the frame that asks for coils: ``unit 01 first count crc``."""
    body = bytes((unit, _READ_COILS)) + first.to_bytes(2, "big") + count.to_bytes(2, "big")
    return body + crc16(body)


def answer_in(data: bytes, unit: int) -> bytes | None:
    """Return the first valid frame from this unit in what has come, or None; bytes around it are skipped."""
    for start in range(len(data)):
        if data[start] != unit:
            continue
        for end in range(start + _SHORTEST_ANSWER, len(data) + 1):
            if crc16(data[start : end - 2]) == data[end - 2 : end]:
                return data[start:end]
    return None


class Modbus(RelayBackend):
    """The back end. Options ``unit``: the board's address; ``on_value``: what switches a relay on."""

    channels = range(64)
    rate = 50.0  # a frame and its answer take 17 ms at 9600 baud
    baud = 9600
    confirms = True
    options = ("unit", "on_value")

    def __init__(self, robot: Robot) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints or options that this device cannot have.
        """
        super().__init__(robot)
        self._unit = checks.whole_number("options: unit", robot.options.get("unit", 1), 1, 247)
        self._on_value = checks.whole_number("options: on_value", robot.options.get("on_value", STANDARD_ON), 1, 0xFFFF)
        self._life = LifeSign(_ASK_EVERY, _SILENCE)

    def identify(self, line: Line) -> str:
        """Ask for the coils; any valid answer of this unit, a refusal too, is a sign of life."""
        frame = read_coils(self._unit, 0, 8)
        self._life = LifeSign(_ASK_EVERY, _SILENCE)
        for _ in range(_TRIES):
            answer = self._ask(line, frame)
            if answer is not None:
                return f"Modbus relays, unit {self._unit}"
        msg = (
            f"no answer from Modbus unit {self._unit} at {self.robot.baud or self.baud} baud: check address and baud "
            "rate, and that A and B are not swapped"
        )
        raise WrongDeviceError(msg)

    def switch(self, line: Line, channel: int, *, on: bool) -> None:
        """Switch one relay and wait for the answer.

        Raises:
            LineStalledError: No answer, or a refusal, after three tries.
        """
        frame = write_coil(self._unit, channel, self._on_value if on else 0)
        answer = None
        for _ in range(_TRIES):
            answer = self._ask(line, frame)
            if answer == frame:
                return
        got = answer.hex(" ") if answer else "nothing"
        msg = (
            f"Modbus unit {self._unit} did not switch relay {channel}: sent {frame.hex(' ')}, got {got}; check "
            "options: unit, that the board has this relay, and the cable"
        )
        raise LineStalledError(msg)

    def read(self, line: Line) -> Feedback:
        """Ask for a sign of life while nothing is switched; every switch is answered anyway."""
        if not any(self._on.values()) and self._life.due():
            self._ask(line, read_coils(self._unit, 0, 8))
        return NOTHING

    def _ask(self, line: Line, frame: bytes) -> bytes | None:
        line.read(0.0)
        line.write(frame)
        received = bytearray()
        deadline = time.monotonic() + _ANSWER_SECONDS
        while (left := deadline - time.monotonic()) > 0.0 and len(received) < 4 * _WRITE_ANSWER:
            received += line.read(left)
            answer = answer_in(bytes(received), self._unit)
            if answer is not None:
                self._life.heard()
                return answer
        return None
