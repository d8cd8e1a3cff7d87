"""Arduino boards with StandardFirmata.

Frames: Firmata protocol 2.5, "servos" and "message types". The firmware goes on pulsing the last value for ever when
the host falls silent; only a system reset (FF) stops it.

A banner is always the same, so it proves nothing: what only a board can know is which of 128 pins it was asked for
just now. It tells the state of a pin (F0 6E pin mode state F7) when asked for it (F0 6D pin F7). It confirms nothing
of a reset: `disable` is repeated.

Between F0 and F7 (a sysex message) the firmware takes every byte for data, FF too, and the 65th overruns its memory. A
message whose F7 was lost must not do that: what is written begins with F7, which outside a message means nothing. So a
frame may also be cut anywhere: each other message begins with its command's byte, at which the firmware forgets what
it has of the one before.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from fin_servo_driver.backends.backend import HEARS_ITSELF, NOTHING, ONLY_AN_ECHO, Backend, Feedback, LifeSign
from fin_servo_driver.line import LineLostError, WrongDeviceError

if TYPE_CHECKING:
    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

SYSTEM_RESET = b"\xff"
END_SYSEX = b"\xf7"
ASK_VERSION = b"\xf9"
SERVO_MODE = 4
LOWEST_MICROSECONDS = 544
"""A smaller value is taken for degrees by the firmware's servo library."""
HIGHEST_MICROSECONDS = 2400
FIRST_PULSE = 1500
"""us. The servo library starts a servo with this pulse before the first set-point arrives."""
_LARGEST_MINIMUM, _SMALLEST_MAXIMUM = 1056, 1892
"""us. The firmware keeps a servo's range as its distance from 544 and 2400 us, in steps of 4 us in one signed byte: a
narrower range overflows it and bounds nothing."""
_LAST_SHORT_PIN = 15
_VERSION = 0xF9
_START_SYSEX, _END_SYSEX, _EXTENDED_ANALOG, _SERVO_CONFIG, _STRING = 0xF0, END_SYSEX[0], 0x6F, 0x70, 0x71
_FIRMWARE = 0x79
_ASK_PIN, _PIN = 0x6D, 0x6E
_PINS = 128
_PINS_ASKED = 4
"""To identify the board."""
_PIN_SECONDS = 0.25
_TRIES = 3
_NAMELESS = 5
"""Bytes of ``F0 79 major minor F7``: a firmware's name follows the numbers, in garbage hardly ever."""
_STATUS = 0x80
_LONGEST_MESSAGE = 256
# An Uno resets when its port is opened and stays in its boot loader for up to 2 s, where it must not be spoken to;
# a board without that reset is asked for its version afterwards.
_BOOT_SECONDS = 2.5
_BANNER_SECONDS = 5.0
_ASK_EVERY, _SILENCE = 1.0, 3.0
# After its banner a board tells its firmware's name at once. Later it does so only if it has started anew.
_NAME_SECONDS = 1.0


def servo_mode(pin: int) -> bytes:
    """Return the frame that makes a pin a servo's: ``F4 pin 04``."""
    return bytes((0xF4, pin, SERVO_MODE))


def servo_range(pin: int, lowest: int, highest: int) -> bytes:
    """Return the frame that attaches a servo with its range in us: ``F0 70 pin minL minM maxL maxM F7``."""
    return bytes((_START_SYSEX, _SERVO_CONFIG, pin, *_pair(lowest), *_pair(highest), _END_SYSEX))


def pulse(pin: int, microseconds: int) -> bytes:
    """Return the frame that sets a pulse width: ``E0+pin lsb msb``, pins over 15 ``F0 6F pin lsb msb F7``."""
    if pin <= _LAST_SHORT_PIN:
        return bytes((0xE0 | pin, *_pair(microseconds)))
    return bytes((_START_SYSEX, _EXTENDED_ANALOG, pin, *_pair(microseconds), _END_SYSEX))


def ask_pin(pin: int) -> bytes:
    """Return the frame that asks for the state of a pin, one that the board has or not: ``F0 6D pin F7``."""
    return bytes((_START_SYSEX, _ASK_PIN, pin, _END_SYSEX))


def _pair(value: int) -> tuple[int, int]:
    return value & 0x7F, value >> 7 & 0x7F


def _write(line: Line, frames: bytes) -> None:
    """Write frames behind what ends a message that was cut short."""
    line.write(END_SYSEX + frames)


class Parser:
    """Takes the board's bytes in any portions; keeps the version and the last text. Garbage is skipped.

    Attributes:
        version: Major and minor number of the protocol, None before the banner.
        text: Last text that the board has sent.
        starts: How often the board has told its firmware's name, which it does when it starts.
        pin: The last pin whose state it has told, None before the first.
    """

    def __init__(self) -> None:
        self.version: tuple[int, int] | None = None
        self.text = ""
        self.starts = 0
        self.pin: int | None = None
        self._message = bytearray()

    def feed(self, data: bytes) -> None:
        """Take bytes."""
        for byte in data:
            in_sysex = self._message[:1] == bytes((_START_SYSEX,))
            if byte >= _STATUS and not (in_sysex and byte == _END_SYSEX):
                self._message = bytearray((byte,))
            elif self._message and len(self._message) < _LONGEST_MESSAGE:
                self._message.append(byte)
                self._complete()

    def _complete(self) -> None:
        message = self._message
        if message[0] == _VERSION and len(message) == 3:  # noqa: PLR2004 - F9 major minor
            self.version = message[1], message[2]
            self._message = bytearray()
        elif message[-1] == _END_SYSEX:
            self.starts += message[1] == _FIRMWARE and len(message) > _NAMELESS
            if message[1] == _PIN:
                self.pin = message[2]
            if message[1] == _STRING:
                pairs = zip(message[2:-1:2], message[3:-1:2], strict=False)
                self.text = "".join(chr(low | high << 7) for low, high in pairs)
            self._message = bytearray()


class Firmata(Backend):
    """The back end."""

    drives = "servos"
    unit = "us"
    channels = range(2, 70)
    lowest = LOWEST_MICROSECONDS
    highest = HIGHEST_MICROSECONDS
    rate = 50.0
    baud = 57600
    takes_cut_frames = True

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints that this device cannot have.
        """
        super().__init__(robot, clock)
        for number, joint in enumerate(robot.servos, start=1):
            if not joint.lowest <= FIRST_PULSE <= joint.highest:
                msg = (
                    f"joint {number}: [lowest, highest] = [{joint.lowest:g}, {joint.highest:g}] us does not contain "
                    f"{FIRST_PULSE} us, with which StandardFirmata starts every servo: turn the horn on its shaft"
                )
                raise ValueError(msg)
        self.can_be_disabled_unseen = False  # its boot loader must not be spoken to
        self._parser = Parser()
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        self._identified = 0.0
        self._random = random.SystemRandom()
        self._asked_pin: int | None = None

    def identify(self, line: Line) -> str:
        """Wait for the banner ``F9 major minor``, at most 5 s, then ask for some pins."""
        self._await_banner(line)
        for pin in self._random.sample(range(_PINS), _PINS_ASKED):
            self._require_pin(line, pin)
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        self._asked_pin = None
        version = self._parser.version or ()
        return f"Firmata protocol {'.'.join(map(str, version))}"

    def _await_banner(self, line: Line) -> None:
        self._parser = Parser()
        received = bytearray()
        start = self._clock.monotonic()
        asked = False
        while (elapsed := self._clock.monotonic() - start) < _BANNER_SECONDS:
            if elapsed > _BOOT_SECONDS and not asked:
                _write(line, ASK_VERSION)
                asked = True
            data = line.read(0.05)
            received += data
            self._parser.feed(data)
            if self._parser.version is not None:
                self._identified = self._clock.monotonic()
                return
        if received == END_SYSEX + ASK_VERSION:
            raise WrongDeviceError(ONLY_AN_ECHO)
        got = f"{len(received)} other bytes came ({received[:8].hex(' ')} ...)" if received else "not a byte came"
        msg = (
            f"no Firmata banner within {_BANNER_SECONDS:g} s, {got}: load StandardFirmata onto the board, and give its "
            f"baud rate (now {self.robot.baud or self.baud})"
        )
        raise WrongDeviceError(msg)

    def _require_pin(self, line: Line, pin: int) -> None:
        heard = b""
        for _ in range(_TRIES):
            self._parser.pin = None
            _write(line, ask_pin(pin))
            deadline = self._clock.monotonic() + _PIN_SECONDS
            while (left := deadline - self._clock.monotonic()) > 0.0:
                data = line.read(left)
                heard += data
                self._parser.feed(data)
                if self._parser.pin == pin:
                    if ask_pin(pin) in heard:
                        raise WrongDeviceError(HEARS_ITSELF)
                    return
        if ask_pin(pin) in heard:
            raise WrongDeviceError(ONLY_AN_ECHO)
        got = heard[:8].hex(" ") or "nothing"
        msg = (
            f"a Firmata banner came, but the state of pin {pin} was asked for and {got} came: is it "
            "another device? Load StandardFirmata 2.3 or newer onto the board"
        )
        raise WrongDeviceError(msg)

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Attach the servos and send neutral in the same breath, so that neutral is the first pulse but one at most."""
        frames = b""
        for joint in self.robot.servos:
            lowest = min(round(joint.lowest), _LARGEST_MINIMUM)
            highest = max(round(joint.highest), _SMALLEST_MAXIMUM)
            frames += servo_range(joint.channel, lowest, highest)
            frames += servo_mode(joint.channel) + pulse(joint.channel, round(neutral[joint.channel]))
        _write(line, frames)

    def send(self, line: Line, outputs: Outputs) -> None:
        """Send pulse widths to all pins."""
        _write(line, b"".join(pulse(pin, round(width)) for pin, width in outputs.items()))

    def disable(self, line: Line) -> None:
        """Stop all pulses."""
        _write(line, SYSTEM_RESET)

    def read(self, line: Line) -> Feedback:
        """Return the board's texts as faults: StandardFirmata sends them for what it refuses.

        Raises:
            LineLostError: The board has started anew, and pulses no more.
        """
        self._parser.text, self._parser.starts = "", 0
        self._parser.pin = None
        self._parser.feed(line.read(0.0))
        if self._asked_pin is not None and self._parser.pin == self._asked_pin:
            self._life.heard()
            self._asked_pin = None
        if self._parser.starts and self._clock.monotonic() - self._identified > _NAME_SECONDS:
            msg = "the board has started anew by itself: does the servo draw its supply down? Give it one of its own"
            raise LineLostError(msg)
        if self._life.due():
            self._asked_pin = self._random.randrange(_PINS)
            _write(line, ask_pin(self._asked_pin))
        return Feedback(fault=self._parser.text) if self._parser.text else NOTHING
