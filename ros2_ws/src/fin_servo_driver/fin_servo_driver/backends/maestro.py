"""Pololu Maestro servo controllers, compact protocol (Pololu Maestro User's Guide, sections 5.c and 5.e).

What only the device can know is where its channels stand (90 channel: two bytes, 0 without pulses). Its answers have no
frame; questions that are answered with one byte (93, whether a channel moves) and with two come in random order, so
that neither an echo, nor the same answer for ever, nor answers recorded earlier fit them.

What waits in the port at a stop is left there: a frame that is cut is a protocol error, at which a Maestro leads its
channels to where its settings say ("On startup or error"), and that may be a motion.

Its serial timeout is off unless it is set in the maker's Control Center; docs/robot.md has it on the checklist.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_servo_driver.backends.backend import HEARS_ITSELF, NOTHING, ONLY_AN_ECHO, Backend, Feedback, LifeSign
from fin_servo_driver.line import LineLostError, LineStalledError, WrongDeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

GO_HOME = b"\xa2"
GET_ERRORS = b"\xa1"
GET_MOVING = b"\x93"
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
_CONFIRM_SECONDS = 0.05
_QUIET = 0.005
"""s after an answer in which nothing more comes."""
_QUESTIONS_TO_IDENTIFY, _QUESTIONS_TO_CONFIRM = 8, 5
"""Of either length: answers recorded earlier fit one order out of 12,870, and one out of 252 or less."""
_TRIES_TO_IDENTIFY, _TRIES_TO_CONFIRM = 3, 2
_ASK_EVERY, _SILENCE = 0.2, 3.0
_WAITED, _UNANSWERED = 2, 12
"""Ticks in which an answer is waited for; questions in a row without one, half a second, after which a device under
force counts as lost."""
_SLACK = 4
"""Quarters of a us by which a position that is told may differ."""
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


def get_position(channel: int) -> bytes:
    """Return the frame that asks where a channel stands, in quarters of a us: ``90 channel``."""
    return bytes((0x90, channel))


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
    confirms = True
    options = ("model", "detect_baud")

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints or options that this device cannot have.
        """
        super().__init__(robot, clock)
        model = checks.choice("options: model", str(robot.options.get("model", 6)), ("6", "12", "18", "24"))
        used = [joint.channel for joint in robot.servos]
        if max(used) >= int(model):
            msg = f"channel {max(used)} is not one of a Maestro with {model} channels: set options: model to yours"
            raise ValueError(msg)
        # The Micro Maestro with its 6 channels does not know the frame for several.
        in_a_row = used == list(range(used[0], used[0] + len(used)))
        self._together = model != "6" and in_a_row and len(used) > 1
        self._channels = used
        self.can_be_disabled_unseen = not robot.options.get("detect_baud")  # then the first byte must be AA
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        self._random = random.SystemRandom()
        self._asked: list[int | None] = []  # one at most: a channel, or None for the errors
        self._answer = bytearray()
        self._waited = 0
        self._unanswered = 0
        self._turn = 0
        self._sent: dict[int, list[int]] = {}
        self._sent_before: list[int] = []

    def identify(self, line: Line) -> str:
        """Ask for the errors, and then questions of two lengths, which only a Maestro answers as they are asked."""
        if self.robot.options.get("detect_baud"):
            line.write(BAUD_INDICATION)
        self._forget(line)
        line.write(GET_ERRORS)
        answer = self._bytes_of_answer(line, _ANSWER_BYTES, _ANSWER_SECONDS)
        if answer == GET_ERRORS:
            raise WrongDeviceError(ONLY_AN_ECHO)
        if answer[:1] == GET_ERRORS and len(answer) > _ANSWER_BYTES:
            raise WrongDeviceError(HEARS_ITSELF)
        if len(answer) != _ANSWER_BYTES or answer[1] >> 1:
            msg = (
                f"no Maestro answers: asked for its errors it sent {answer.hex(' ') or 'nothing'}, expected are two "
                "bytes; in the Control Center choose USB Dual Port and its Command Port, or UART with this baud "
                f"rate ({self.robot.baud or self.baud}) and without CRC"
            )
            raise WrongDeviceError(msg)
        try:
            self._positions(line, _QUESTIONS_TO_IDENTIFY, _TRIES_TO_IDENTIFY)
        except LineStalledError as error:
            raise WrongDeviceError(str(error)) from error
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        complaints = errors(bytes(answer))
        return f"Maestro, errors before: {', '.join(complaints) or 'none'}"

    def _bytes_of_answer(self, line: Line, length: int, seconds: float) -> bytes:
        """Return so many bytes, less if they do not come in time, more if they come."""
        answer = b""
        deadline = self._clock.monotonic() + seconds
        while len(answer) < length and (left := deadline - self._clock.monotonic()) > 0.0:
            answer += line.read(left)
        return answer + line.read(_QUIET)

    def _positions(self, line: Line, questions: int, tries: int) -> dict[int, int]:
        """Return where each channel stands in quarters of a us, by the last of many answers.

        Raises:
            LineStalledError: The answers do not fit the questions, or do not come.
        """
        for left in reversed(range(tries)):
            try:
                return self._told_positions(line, questions)
            except LineStalledError:
                if not left:
                    raise
                line.read(_CONFIRM_SECONDS)
        raise AssertionError

    def _told_positions(self, line: Line, questions: int) -> dict[int, int]:
        wanted = [self._channels[index % len(self._channels)] for index in range(max(questions, len(self._channels)))]
        positions: dict[int, int] = {}
        for is_moving in self._random.sample((False, True), counts=(len(wanted), questions), k=len(wanted) + questions):
            channel = 0 if is_moving else wanted.pop()
            question, length = (GET_MOVING, 1) if is_moving else (get_position(channel), _ANSWER_BYTES)
            line.write(question)
            answer = self._bytes_of_answer(line, length, _CONFIRM_SECONDS)
            if len(answer) != length or (is_moving and answer[0] > 1):
                got = answer.hex(" ") or "nothing"
                msg = f"the answers do not fit a Maestro's: asked {question.hex(' ')}, got {got}"
                raise LineStalledError(msg)
            if not is_moving:
                positions[channel] = int.from_bytes(answer, "little")
        return positions

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Send neutral, which starts the pulses."""
        self._forget(line)
        self._write_targets(line, b"", neutral)

    def send(self, line: Line, outputs: Outputs) -> None:
        """Send a target to each channel, in one frame where the model has it; before it ask where one of them stands.

        Before, because a device that has started anew takes the next target as if nothing had been.
        """
        if self._asked:  # an answer is still awaited: positions are told in the order of the questions
            self._write_targets(line, b"", outputs)
            return
        self._turn += 1
        channel = self._channels[self._turn % len(self._channels)]
        self._asked = [channel]
        self._sent_before, self._sent[channel] = self._sent.get(channel, []), []
        self._write_targets(line, get_position(channel), outputs)

    def _write_targets(self, line: Line, question: bytes, outputs: Outputs) -> None:
        quarters = {channel: round(width * QUARTERS) for channel, width in outputs.items()}
        self._write_frames(line, question, quarters)
        for channel, value in quarters.items():
            sent = self._sent.setdefault(channel, [])
            self._sent[channel] = [min([*sent, value]), max([*sent, value])]

    def _write_frames(self, line: Line, question: bytes, quarters: dict[int, int]) -> None:
        """Write a question, and targets for all channels, in one frame where the model has it."""
        if self._together:
            frames = targets(min(quarters), [quarters[channel] for channel in self._channels])
        else:
            frames = b"".join(target(channel, value) for channel, value in quarters.items())
        line.write(question + frames)

    def disable(self, line: Line) -> None:
        """Stop the pulses, then have the device tell that no channel has any.

        Raises:
            LineStalledError: One has, or the device does not tell.
        """
        self._write_frames(line, b"", dict.fromkeys(self._channels, STOP_PULSES))
        self._forget(line)
        positions = self._positions(line, _QUESTIONS_TO_CONFIRM, _TRIES_TO_CONFIRM)
        pulsing = sorted(channel for channel, position in positions.items() if position != STOP_PULSES)
        if pulsing:
            msg = f"the Maestro was told to stop its pulses, and says that channels {pulsing} have some"
            raise LineStalledError(msg)

    def _forget(self, line: Line) -> None:
        """Forget what was asked, and what has come."""
        self._asked = []
        self._answer = bytearray()
        self._waited = self._unanswered = 0
        self._sent = {}
        line.read(0.0)

    def read(self, line: Line) -> Feedback:
        """Ask for errors five times a second; return those that came.

        Raises:
            LineLostError: A channel stands where nobody has sent it, or the device has fallen silent.
        """
        self._answer += line.read(0.0)
        feedback = NOTHING
        if self._asked and len(self._answer) == _ANSWER_BYTES:
            feedback = self._take_answer(self._asked[0], bytes(self._answer))
        elif self._asked or self._answer:
            self._wait()
        if self._sent and self._unanswered > _UNANSWERED:
            msg = f"the device has fallen silent: {self._unanswered} questions were not answered; has it power?"
            raise LineLostError(msg)
        if self._life.due() and not self._asked and not self._sent:  # under force each tick asks for a position
            self._asked = [None]
            line.write(GET_ERRORS)
        return feedback

    def _wait(self) -> None:
        """Give an answer that is on its way another tick, and give it up then, or if too much came."""
        self._waited += 1
        if self._waited < _WAITED and len(self._answer) < _ANSWER_BYTES:
            return
        for channel in self._asked:
            self._unanswered += 1
            if channel is not None:
                self._sent[channel] = [*self._sent.get(channel, []), *self._sent_before]
        self._asked, self._answer, self._waited = [], bytearray(), 0

    def _take_answer(self, channel: int | None, answer: bytes) -> Feedback:
        """Take an answer about errors (None) or to where a channel stands.

        Raises:
            LineLostError: It is not on its way to where it was sent, quick or slow.
        """
        self._life.heard()
        self._asked, self._answer, self._waited, self._unanswered = [], bytearray(), 0, 0
        if channel is None:
            return Feedback(fault=", ".join(errors(answer)))
        position = int.from_bytes(answer, "little")
        sent = self._sent_before or [position]
        if not min(sent) - _SLACK <= position <= max(sent) + _SLACK:
            stands = f"stands at {position / QUARTERS:g} us, where nobody has sent it" if position else "has no pulses"
            msg = f"channel {channel} {stands}: has the Maestro started anew by itself? Give it a supply of its own"
            raise LineLostError(msg)
        self._sent[channel] = [*self._sent.get(channel, []), position]
        return NOTHING
