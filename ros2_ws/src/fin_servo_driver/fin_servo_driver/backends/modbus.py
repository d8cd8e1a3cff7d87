"""Modbus RTU relay boards (Modbus Application Protocol 1.1b3, sections 6.1, 6.5 and 6.11).

Every frame is answered; the answer is awaited, since the next frame must not come before it. Only a stop does not wait:
one frame, function 0F, switches all relays off. A board knows where a frame ends by a pause, and on two wires it may be
answering: so the frame goes out at once, and again when the line is quiet.

The answer to function 05, write single coil, is the question itself: a two-wire adapter that hears itself gives it
without a board. So it confirms nothing. What only the board can know is the state of its coils, function 01: the answer
is no echo, its length follows from how many coils were asked for, and questions of two lengths come in random order, so
that neither the same answer for ever nor answers recorded earlier fit them.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_servo_driver.backends.backend import NOTHING, ONLY_AN_ECHO, Feedback, LifeSign, RelayBackend
from fin_servo_driver.line import LineLostError, LineStalledError, WrongDeviceError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

STANDARD_ON = 0xFF00
CLONE_ON = 0x0100
"""What some clones take for on."""
_READ_COILS, _WRITE_COIL, _WRITE_COILS, _EXCEPTION = 0x01, 0x05, 0x0F, 0x80
_EXCEPTION_BYTES, _WRITE_BYTES, _BESIDE_DATA = 5, 8, 5
_COILS_A_BYTE = 8
_ANSWER_SECONDS = 0.1
_QUIET, _QUIET_WITHIN = 0.006, 0.05
"""s without a byte, more than the 3.5 characters that end a frame at 9600 baud, and s in which that must have come."""
_TRIES = 3
_ASK_EVERY, _SILENCE = 1.0, 3.0
_LOOK_EVERY = 0.1
"""s between two looks at coils that are on: a board that starts anew has them off."""
_UNANSWERED = 3
"""Looks in a row without an answer after which a board with coils that are on counts as lost."""
_QUESTIONS_TO_IDENTIFY, _QUESTIONS_TO_CONFIRM = 8, 6
"""Of either length: answers recorded earlier fit one order out of 12,870, and one out of 924."""
_LOST_AT_MOST = 2
"""Answers, of all to such a row of questions."""
_COILS, _REFUSAL = "coils", "a refusal"


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


def write_coils_off(unit: int, first: int, count: int) -> bytes:
    """Return the frame that writes 0 to coils in a row: ``unit 0F first count bytes 00 ... crc``."""
    zeros = bytes(-(-count // _COILS_A_BYTE))
    body = bytes((unit, _WRITE_COILS)) + first.to_bytes(2, "big") + count.to_bytes(2, "big")
    body += bytes((len(zeros),)) + zeros
    return body + crc16(body)


def runs_of(channels: Iterable[int]) -> list[tuple[int, int]]:
    """Return first channel and length of each run of neighbours."""
    runs: list[tuple[int, int]] = []
    for channel in sorted(channels):
        first, count = runs[-1] if runs else (channel, 0)
        if first + count == channel:
            runs[-1:] = [(first, count + 1)]
        else:
            runs.append((channel, 1))
    return runs


def read_coils(unit: int, first: int, count: int) -> bytes:
    """Return the frame that asks for coils: ``unit 01 first count crc``."""
    body = bytes((unit, _READ_COILS)) + first.to_bytes(2, "big") + count.to_bytes(2, "big")
    return body + crc16(body)


def answer_in(data: bytes, question: bytes) -> bytes | None:
    """Return the first answer to a question in what has come, or None; bytes around it are skipped.

    An answer comes from the same unit, is of the same function or refuses it, and is as long as its function says. The
    echo of a question for coils is none: it would be an answer with no coils.
    """
    unit, function = question[:2]
    for start in range(len(data) - _EXCEPTION_BYTES + 1):
        length = _answer_bytes(data[start + 1 : start + 3], function)
        answer = data[start : start + length]
        if answer and answer[0] == unit and len(answer) == length and crc16(answer[:-2]) == answer[-2:]:
            return answer
    return None


def _answer_bytes(head: bytes, function: int) -> int:
    """Return how long an answer is that begins so after its unit, 0 for what is no answer to this function."""
    if head[0] == function | _EXCEPTION:
        return _EXCEPTION_BYTES
    if head[0] != function:
        return 0
    if function in {_WRITE_COIL, _WRITE_COILS}:
        return _WRITE_BYTES
    return _BESIDE_DATA + head[1] if head[1] else 0


class Modbus(RelayBackend):
    """The back end. Options ``unit``: the board's address; ``on_value``: what switches a relay on."""

    channels = range(64)
    rate = 50.0  # a frame and its answer take 17 ms at 9600 baud
    baud = 9600
    frame_bytes = _WRITE_BYTES
    confirms = True
    options = ("unit", "on_value")

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints or options that this device cannot have.
        """
        super().__init__(robot, clock)
        self._unit = checks.whole_number("options: unit", robot.options.get("unit", 1), 1, 247)
        self._on_value = checks.whole_number("options: on_value", robot.options.get("on_value", STANDARD_ON), 1, 0xFFFF)
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        used = [channel for joint in robot.relays for channel in joint.channels]
        self._first = min(used)
        self._count = max(used) - self._first + 1
        self._echoes = False
        self._off_frames = [write_coils_off(self._unit, *run) for run in runs_of(used)]
        self._together: bool | None = None
        self._is_asking = False
        self._long_gets = _REFUSAL
        self._looked = 0.0
        self._unanswered = 0
        self._random = random.SystemRandom()

    def identify(self, line: Line) -> str:
        """Ask for the coils often enough that only something that understands the questions gives such answers."""
        self._life = LifeSign(_ASK_EVERY, _SILENCE, self._clock)
        self._unanswered = 0
        self._together = None
        self._echoes = False
        self._echoes = self._hears_itself(line)
        for left in reversed(range(_TRIES)):
            try:
                gets = (self._told(line, is_long=True)[0] for _ in range(_TRIES))
                self._long_gets = next(filter(None, gets), "")
                self._told_coils(line, _QUESTIONS_TO_IDENTIFY)
                break
            except LineStalledError as error:
                if not left:
                    raise WrongDeviceError(str(error)) from error
                line.read(_ANSWER_SECONDS)
        echo = ", on an adapter that hears itself" if self._echoes else ""
        return f"Modbus relays, unit {self._unit}{echo}"

    def _hears_itself(self, line: Line) -> bool:
        """Whether each frame comes back before its answer, as on two wires where the receiver stays on.

        Raises:
            WrongDeviceError: There is no answer.
        """
        frame, heard = read_coils(self._unit, self._first, self._count), b""
        for _ in range(_TRIES):
            answer, heard = self._ask(line, frame)
            if answer is not None:
                return frame in heard.partition(answer)[0]
            if frame in heard:
                msg = (
                    f"{ONLY_AN_ECHO}; check the power of Modbus unit {self._unit}, its address and baud rate, and that "
                    "A and B are not swapped"
                )
                raise WrongDeviceError(msg)
        got = f"{len(heard)} other bytes came" if heard else "not a byte came"
        msg = (
            f"no answer from Modbus unit {self._unit} at {self.robot.baud or self.baud} baud, {got}: check address and "
            "baud rate, and that A and B are not swapped"
        )
        raise WrongDeviceError(msg)

    def _told_coils(self, line: Line, questions: int) -> set[int]:
        """Return which coils between the lowest and the highest of the joints are on, by the last of many answers.

        Of the questions of either length, in random order, each must get the answer that fits it: a short one its
        coils, a long one more coils, or a refusal where the board has no more, always the same. Few answers may be
        lost. A board that says nothing to a long one is asked twice as often.

        Raises:
            LineStalledError: The answers do not fit the questions, or do not come.
        """
        if not self._long_gets:
            questions *= 2
        on: set[int] = set()
        left = _LOST_AT_MOST
        for is_long in self._random.sample((False, True), counts=(questions, questions), k=2 * questions):
            expected = self._long_gets if is_long else _COILS
            gets, told = self._told(line, is_long=is_long)
            while not gets and expected and left:
                left -= 1
                gets, told = self._told(line, is_long=is_long)
            if gets != expected:
                asked = "more coils than it may have" if is_long else "its coils"
                msg = (
                    f'Modbus unit {self._unit} does not tell its coils (function 01), by which alone an "off" is '
                    f"confirmed: asked for {asked} it gave {gets or 'no answer'}; is options: unit right, and are the "
                    "relays of this board coils?"
                )
                raise LineStalledError(msg)
            on = on if is_long else told
        return on

    def _told(self, line: Line, *, is_long: bool) -> tuple[str, set[int]]:
        """Ask for the coils of the joints, or for a byte more; return what was answered, and which are on.

        Raises:
            LineStalledError: The answer is that to another question.
        """
        count = self._count + _COILS_A_BYTE * is_long
        answer, heard = self._ask(line, read_coils(self._unit, self._first, count))
        if answer is None:
            return "", set()
        if answer[1] != _READ_COILS:
            return _REFUSAL, set()
        if answer[2] != -(-count // _COILS_A_BYTE):
            msg = (
                f"the answers of Modbus unit {self._unit} do not fit the questions: asked for {count} coils, got "
                f"{heard[:12].hex(' ')}; is it a relay board?"
            )
            raise LineStalledError(msg)
        bits = int.from_bytes(answer[3:-2], "little")
        return _COILS, {self._first + index for index in range(self._count) if bits >> index & 1}

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Switch all relays off, unless the board has said that they are: that is the neutral of a relay tail."""
        if any(self._on.get(channel) != 0.0 for channel in neutral):
            self.disable(line)

    def switch(self, line: Line, channel: int, *, on: bool) -> None:
        """Switch one relay and wait for the answer, which says that the line is free, no more.

        Raises:
            LineStalledError: No answer, or a refusal, after three tries.
        """
        for left in reversed(range(_TRIES)):
            try:
                self._write(line, channel, on=on)
                break
            except LineStalledError:
                if not left:
                    raise

    def _write(self, line: Line, channel: int, *, on: bool) -> None:
        frame = write_coil(self._unit, channel, self._on_value if on else 0)
        answer, _ = self._ask(line, frame)
        if answer != frame:
            got = answer.hex(" ") if answer else "nothing"
            msg = (
                f"Modbus unit {self._unit} did not switch relay {channel}: sent {frame.hex(' ')}, got {got}; check "
                "options: unit, that the board has this relay, and the cable"
            )
            raise LineStalledError(msg)

    def disable(self, line: Line) -> None:
        """Switch all relays off, then have the board tell that they are.

        Neighbours are switched by one frame, unless the board has refused it when it was told so first, before any of
        its relays was on.

        Raises:
            LineStalledError: One is not, or the board does not tell.
        """
        if self._together is not False:
            self._switch_off_together(line)
        if self._together is not True:
            super().disable(line)
        channels = self._on.keys()
        still_on = sorted(self._told_coils(line, _QUESTIONS_TO_CONFIRM) & channels)
        if still_on:
            self._switch_off(line, still_on)
            for channel in still_on:
                del self._on[channel]
            msg = f"Modbus unit {self._unit} was told to switch off, and says that relays {still_on} are on"
            raise LineStalledError(msg)

    def _switch_off_together(self, line: Line) -> None:
        """Write 0 to all coils of the joints, once more if that may have met another frame.

        Raises:
            LineStalledError: No answer.
        """
        if self._is_asking:
            for frame in self._off_frames:
                line.write(frame)
            self._await_quiet(line)
        for frame in self._off_frames:
            if self._ask_surely(line, frame)[1] != _WRITE_COILS:
                self._together = False
                return
        self._together = True
        now = self._clock.monotonic()
        for channel in self._partner:
            if self._on.get(channel) != 0.0:
                self._off_since[channel] = now
            self._on[channel] = 0.0

    def _await_quiet(self, line: Line) -> None:
        deadline = self._clock.monotonic() + _QUIET_WITHIN
        while line.read(_QUIET) and self._clock.monotonic() < deadline:
            pass

    def _ask_surely(self, line: Line, frame: bytes) -> bytes:
        for _ in range(_TRIES):
            answer, _ = self._ask(line, frame)
            if answer is not None:
                return answer
        msg = f"Modbus unit {self._unit} did not answer to {frame.hex(' ')}; check the cable, and its power"
        raise LineStalledError(msg)

    def read(self, line: Line) -> Feedback:
        """Look whether the relays stand as they were switched.

        Raises:
            LineLostError: They do not, or the board has fallen silent.
        """
        is_on = any(self._on.values())
        if self._clock.monotonic() - self._looked >= _LOOK_EVERY if is_on else self._life.due():
            self._require_as_switched(line)
        if is_on and self._unanswered >= _UNANSWERED:
            msg = f"Modbus unit {self._unit} has fallen silent: it does not tell its coils; has it power?"
            raise LineLostError(msg)
        return NOTHING

    def send(self, line: Line, outputs: Outputs) -> None:
        """Switch what has changed; before a relay goes off make sure that it was still on.

        Raises:
            LineLostError: It was not.
        """
        if any(self._on.get(channel) and not value for channel, value in outputs.items()):
            self._require_as_switched(line)
        super().send(line, outputs)

    def _require_as_switched(self, line: Line) -> None:
        """Make sure that the relays are as they were switched, as far as the board answers.

        Raises:
            LineLostError: They are not, or the answer does not fit the question.
        """
        if self._strange(line) and (strange := self._strange(line)):  # an answer may be late: ask twice
            msg = (
                f"Modbus unit {self._unit} says that relays {sorted(strange)} are not as they were switched: has it "
                "started anew by itself? Does a coil draw its supply down?"
            )
            raise LineLostError(msg)

    def _strange(self, line: Line) -> set[int]:
        """Return the relays that are not as they were switched; none without an answer.

        Raises:
            LineLostError: The answer does not fit the question.
        """
        self._looked = self._clock.monotonic()
        try:
            gets, told = self._told(line, is_long=False)
        except LineStalledError as error:
            raise LineLostError(str(error)) from error
        self._unanswered = 0 if gets == _COILS else self._unanswered + 1
        if gets != _COILS:
            return set()
        self._life.heard()
        return {channel for channel, value in self._on.items() if (channel in told) != (value > 0.0)}

    def _ask(self, line: Line, frame: bytes) -> tuple[bytes | None, bytes]:
        """Return the answer, None without one, and all that came."""
        line.read(0.0)
        self._is_asking = True  # until an answer has come, or none comes any more
        line.write(frame)
        heard = b""
        deadline = self._clock.monotonic() + _ANSWER_SECONDS
        while (left := deadline - self._clock.monotonic()) > 0.0:
            heard += line.read(left)
            after_echo = heard.partition(frame)[2] if self._echoes else heard
            answer = answer_in(after_echo, frame)
            if answer is not None:
                self._is_asking = False
                return answer, heard
        self._is_asking = False
        return None, heard
