"""ROBOTIS Dynamixel X servos, protocol 2, through the maker's own SDK on a port of ours.

The SDK's port handler opens the port without `exclusive` and without a write timeout, so `SdkPort` takes its place. The
servos' bus watchdog is armed with the torque: they stop by themselves when the host is gone.

What only a servo can know is its control table, read in parts or lengths drawn anew each time: an echo has the
instruction of the question, and neither the same answer for ever nor answers recorded earlier have the lengths that
were asked for.
"""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

from dynamixel_sdk import COMM_SUCCESS, GroupSyncWrite
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from fin_servo_driver.backends.backend import NOTHING, ONLY_AN_ECHO, Backend, Feedback
from fin_servo_driver.line import LineLostError, LineStalledError, WrongDeviceError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

# Control table of the X series (ROBOTIS e-Manual): address and length.
OPERATING_MODE = (11, 1)
TORQUE_ENABLE = (64, 1)
TORQUE_TO_HARDWARE_ERROR = (64, 7)
BUS_WATCHDOG = (98, 1)
GOAL_POSITION = (116, 4)
PRESENT_POSITION = (132, 4)
IDENTITY = (0, 14)
"""Model, id, baud rate, up to the protocol's version; the id is at 7."""
PRESENT_VOLTAGE_AND_TEMPERATURE = (144, 3)
POSITION_MODE = 3
WATCHDOG_UNIT = 0.02
WATCHDOG_SECONDS = 0.2
XL320_MODEL = 350
_WATCHDOG_ARMED = round(WATCHDOG_SECONDS / WATCHDOG_UNIT)
_WATCHDOG_TRIPPED = 0xFF
_ERRORS = {0: "input voltage", 2: "overheating", 3: "encoder", 4: "electrical shock", 5: "overload"}
_LOWEST_TOLD, _HIGHEST_TOLD = -2048, 6144
"""Ticks: a turn, and half of one to either side for a homing offset or a horn that was turned by hand."""
# Answers of different lengths cannot be taken for one another; those to one question after another for positions differ
# too: what follows the position is asked for with it.
_POSITION_BYTES = (4, 5, 6, 8)
_POSITION_BYTES_MEAN = sum(_POSITION_BYTES) / len(_POSITION_BYTES)
_WINDOWS_TO_IDENTIFY, _LENGTHS_TO_CONFIRM = 5, 5
"""Parts of `IDENTITY` at random, one of 56 each; lengths from the torque on in random order, one of 2,520."""
_LOST_AT_MOST = 2
"""Answers to one of those."""
_ID_REGISTER = 7
_HEALTH = (TORQUE_TO_HARDWARE_ERROR, BUS_WATCHDOG, PRESENT_VOLTAGE_AND_TEMPERATURE)
_HEALTH_EVERY = 1.0 / len(_HEALTH)
_SILENCE, _SILENCE_UNDER_FORCE = 0.5, 0.15
"""s without an answer. Under force less than the bus watchdog's time, after which the servo stands still."""
# Bytes of packets: sync write and sync read without their servos, a status packet without data, a ping, a goal.
_SYNC_BYTES, _STATUS_BYTES, _PING_BYTES, _GOAL_BYTES = 14, 11, 10, 5
_PING, _PING_DATA = 1, 3
_ID_AT, _LENGTH_AT, _INSTRUCTION_AT, _ERROR_AT = 4, 5, 7, 8
_STATUS = 0x55
"""The instruction of an answer; an echo has that of the question."""
_LENGTH_BESIDE_DATA = 4
_BITS_A_BYTE = 10
_BAUDS = (57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
_RATES = (100.0, 50.0)
_RETURN_DELAY, _ADAPTER_DELAY = 0.0005, 0.001
"""s: of a servo as it is bought, and of a USB adapter that hands bytes on at once."""
_LOAD, _LOAD_AT_WORST = 0.8, 0.9
"""Part of a tick that questions and answers take by calculation, and for which answers are waited for."""
_DISABLE_TRIES = 3
"""Times that servos are asked whether their torque is off: one late answer is no servo that holds on."""
_QUIET = 0.003
"""s without a byte after which no answer comes any more: an adapter's delay and some servos' return delays."""
_PATIENCE_AT_REST = 0.02
"""s beyond the time of the bytes, where no tick waits: also for an adapter that hands bytes on late."""


def tick_seconds(baud: int, servos: int, *answers: float) -> float:
    """Return how long goals take on a line, and one question after another with answers of so many bytes a servo."""
    seconds = (_SYNC_BYTES + _GOAL_BYTES * servos) * _BITS_A_BYTE / baud
    for length in answers:
        read = _SYNC_BYTES + servos + (_STATUS_BYTES + length) * servos
        seconds += read * _BITS_A_BYTE / baud + _ADAPTER_DELAY + servos * _RETURN_DELAY
    return seconds


def highest_rate(baud: int, servos: int) -> float:
    """Return how many set-points a second a line carries with the positions that are read back, 0 for too few."""
    tick = tick_seconds(baud, servos, _POSITION_BYTES_MEAN)
    return next((rate for rate in _RATES if tick <= _LOAD / rate), 0.0)


class SdkPort:
    """The port as the SDK wants it (its `PortHandler`), on a line of ours. Names are the SDK's."""

    def __init__(self, line: Line, baud: int, clock: Clock) -> None:
        self._clock = clock
        self.is_using = False
        self.baudrate = baud
        self._line = line
        self._waiting = bytearray()
        self._heard = self._written = b""
        self._deadline = 0.0
        self._over = False

    @property
    def heard_itself(self) -> bool:
        """Whether the packet that was written last has come back."""
        return self._written in self._heard

    def getBaudRate(self) -> int:  # noqa: N802
        """Return the bits a second."""
        return self.baudrate

    def clearPort(self) -> None:  # noqa: N802
        """Forget what has come."""
        self._waiting = bytearray()
        self._line.read(0.0)

    def getBytesAvailable(self) -> int:  # noqa: N802
        """Return how many bytes can be read at once."""
        self._waiting += self._line.read(0.0)
        return len(self._waiting)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Return up to ``length`` bytes, empty if none comes within a millisecond or the time is over.

        What has come when the time is over still counts, and nothing later: garbage cannot put the end off.
        """
        if not self._waiting and not self._over:
            self._over = self._clock.monotonic() > self._deadline
            data = self._line.read(0.0 if self._over else 0.001)
            self._waiting += data
            self._heard += data
        result = bytes(self._waiting[: max(0, length)])
        del self._waiting[: len(result)]
        return result

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Write a packet."""
        self._heard, self._written = b"", bytes(packet)
        self._line.write(self._written)
        return len(packet)

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Wait for a packet as long as its bytes take, and for an adapter that hands them on late."""
        self.setPacketTimeoutMillis(1000.0 * (packet_length * _BITS_A_BYTE / self.baudrate + _PATIENCE_AT_REST))

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        """Wait so many ms."""
        self._deadline = self._clock.monotonic() + msec / 1000.0
        self._over = False

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the wait is over, and nothing is left that came in time."""
        return self._over and not self._waiting


class Dynamixel(Backend):
    """The back end. Positions are ticks, 4096 a turn."""

    drives = "servos"
    unit = "ticks"
    channels = range(253)
    lowest = 0.0
    highest = 4095.0
    baud = 57600
    measures = True
    confirms = True

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints that this device cannot have, or more than the line carries.
        """
        super().__init__(robot, clock)
        self._servos = [joint.channel for joint in robot.servos]
        self._baud = robot.baud or self.baud
        self.rate = highest_rate(self._baud, len(self._servos))
        if not self.rate:
            needed = next(baud for baud in _BAUDS if highest_rate(baud, len(self._servos)))
            msg = (
                f"{self._baud} baud carry no {_RATES[-1]:g} set-points a second for {len(self._servos)} Dynamixel: set "
                f"them to {needed} or more with the Dynamixel Wizard, and write baud: {needed} into the robot file"
            )
            raise ValueError(msg)
        self._wait = _LOAD_AT_WORST / self.rate
        longest = (max(_POSITION_BYTES), max(length for _, length in _HEALTH))
        self._asks_both = tick_seconds(self._baud, len(self._servos), *longest) <= _LOAD_AT_WORST / self.rate
        self._packets = Protocol2PacketHandler()
        self._port: SdkPort | None = None
        self._under_force = False
        self._heard: dict[int, float] = {}
        self._asked_health = 0.0
        self._knows_positions = False
        self._turn = 0
        self._is_asking = False
        self._random = random.SystemRandom()
        self._misfit = False
        self._position_bytes = [PRESENT_POSITION[1]] * 2

    def identify(self, line: Line) -> str:
        """Ping every id, and see to it that it is in position mode."""
        found = []
        for servo in self._servos:
            answer = self._ping(line, servo)
            if answer is None and self._open(line).heard_itself:
                msg = f"{ONLY_AN_ECHO}; check the power of id {servo}, its id and baud rate"
                raise WrongDeviceError(msg)
            if answer is None:
                msg = (
                    f"no Dynamixel with id {servo} answers a ping at {self._baud} baud: check power, id and baud rate "
                    f"with the Dynamixel Wizard (as bought: id 1, {self.baud} baud)"
                )
                raise WrongDeviceError(msg)
            model = int.from_bytes(answer[:2], "little")
            if model == XL320_MODEL:
                msg = f"id {servo} is an XL-320, with another control table and no bus watchdog: it is not supported"
                raise WrongDeviceError(msg)
            mode = self._read(line, [servo], OPERATING_MODE).get(servo)
            if mode is None:
                msg = f"id {servo} answers a ping, but does not tell its operating mode"
                raise LineStalledError(msg)
            if mode[0] != POSITION_MODE:
                msg = (
                    f"id {servo} is in operating mode {mode[0]}: set position control mode (3) with the Dynamixel "
                    "Wizard"
                )
                raise WrongDeviceError(msg)
            self._require_own_answers(line, servo, answer[:2])
            found.append(f"id {servo} model {model}")
        self._under_force = self._misfit = False
        self._heard_all()
        return f"Dynamixel {', '.join(found)}"

    def _require_own_answers(self, line: Line, servo: int, model: bytes) -> None:
        """Read parts of the control table at random, which answers recorded earlier do not fit.

        Raises:
            WrongDeviceError: The answers do not fit the questions.
        """
        whole = self._read_surely(line, servo, IDENTITY)
        fits = whole[:2] == model and whole[_ID_REGISTER] == servo
        for _ in range(_WINDOWS_TO_IDENTIFY):
            first = self._random.randint(0, _ID_REGISTER)
            end = self._random.randint(_ID_REGISTER + 1, IDENTITY[1])
            fits = fits and self._read_surely(line, servo, (first, end - first)) == whole[first:end]
        if not fits:
            msg = f"what answers for id {servo} gives answers that do not fit the questions: is it a Dynamixel X?"
            raise WrongDeviceError(msg)

    def _read_surely(self, line: Line, servo: int, register: tuple[int, int]) -> bytes:
        for _ in range(1 + _LOST_AT_MOST):
            told = self._read(line, [servo], register).get(servo)
            if told is not None:
                return told
        msg = f"id {servo} answers a ping, but does not tell what it is asked for: is it a Dynamixel X?"
        raise WrongDeviceError(msg)

    # -- packets -----------------------------------------------------------------------------------------------------

    def _open(self, line: Line) -> SdkPort:
        if self._port is None or self._port._line is not line:  # noqa: SLF001 - one file, two classes
            self._port = SdkPort(line, self._baud, self._clock)
        self._port.is_using = False  # an exception out of our port leaves the SDK's flag behind
        return self._port

    def _ping(self, line: Line, servo: int) -> bytes | None:
        """Return the data of the answer to a ping, None without one."""
        port = self._open(line)
        packet = [0] * _PING_BYTES
        packet[_ID_AT], packet[_LENGTH_AT], packet[_LENGTH_AT + 2] = servo, 3, _PING
        self._packets.txPacket(port, packet)
        port.setPacketTimeout(_PING_BYTES + _STATUS_BYTES + _PING_DATA)
        answer = self._answers(port, [servo], _PING_DATA).get(servo)
        return None if answer is None else answer[1:]

    def _read(
        self, line: Line, servos: Sequence[int], register: tuple[int, int], wait: float | None = None
    ) -> dict[int, bytes]:
        """Return what the servos have in a register; missing are those that have not answered after ``wait`` s."""
        port = self._open(line)
        address, length = register
        self._packets.syncReadTx(port, address, length, servos, len(servos), False)  # noqa: FBT003 - the SDK's own
        if wait is not None:
            port.setPacketTimeoutMillis(1000.0 * wait)
        return {servo: answer[1:] for servo, answer in self._answers(port, servos, length).items()}

    def _write(self, line: Line, servo: int, register: tuple[int, int], value: int) -> None:
        """Write a register and wait for the answer.

        Raises:
            LineStalledError: No answer, or a refusal.
        """
        port = self._open(line)
        address, length = register
        self._packets.writeTxOnly(port, servo, address, length, list(value.to_bytes(length, "little")))
        port.setPacketTimeout(2 * _STATUS_BYTES + length)
        answer = self._answers(port, [servo], 0).get(servo)
        if answer is None or answer[0] & 0x7F:
            reason = "no answer" if answer is None else self._packets.getRxPacketError(answer[0] & 0x7F)
            msg = f"id {servo} did not take {value} at address {address}: {reason}"
            raise LineStalledError(msg)

    def _answers(self, port: SdkPort, servos: Collection[int], length: int) -> dict[int, bytes]:
        """Return error number and data of the status packets, by id, until all have come or the time is over.

        A packet of another length is a late answer to another question, and passed over, as are the echoes on two wires
        where the receiver stays on.
        """
        self._is_asking = True
        found: dict[int, bytes] = {}
        while len(found) < len(servos) and not port.isPacketTimeout():
            packet, result = self._packets.rxPacket(port, False)  # noqa: FBT003 - the SDK's own
            if result != COMM_SUCCESS or packet[_ID_AT] not in servos or packet[_INSTRUCTION_AT] != _STATUS:
                continue
            if packet[_LENGTH_AT] | packet[_LENGTH_AT + 1] << 8 != length + _LENGTH_BESIDE_DATA:
                self._misfit = True
            else:
                found[packet[_ID_AT]] = bytes(packet[_ERROR_AT : _ERROR_AT + 1 + length])
        self._is_asking = False
        return found

    # -- the tail ----------------------------------------------------------------------------------------------------

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Clear and arm the bus watchdog, and switch the torque on; the servo then holds where it stands."""
        del neutral  # the driver leads the tail there from where it stands, at the joint's rate
        self._under_force = True  # before it is: what fails half-way must show
        self._knows_positions = False  # somebody may have moved them
        for servo in self._servos:
            self._write(line, servo, BUS_WATCHDOG, 0)
            self._write(line, servo, TORQUE_ENABLE, 1)
            self._write(line, servo, BUS_WATCHDOG, _WATCHDOG_ARMED)
        self._heard_all()

    def send(self, line: Line, outputs: Outputs) -> None:
        """Write all goal positions in one packet."""
        self._write_together(line, GOAL_POSITION, {servo: round(position) for servo, position in outputs.items()})

    def _write_together(self, line: Line, register: tuple[int, int], values: Mapping[int, int]) -> None:
        """Write a register of several servos in one packet, which none of them answers.

        Raises:
            LineStalledError: It was not sent.
        """
        address, length = register
        group = GroupSyncWrite(self._open(line), self._packets, address, length)
        for servo, value in values.items():
            group.addParam(servo, list(value.to_bytes(length, "little")))
        result = group.txPacket()
        if result != COMM_SUCCESS:
            msg = f"{dict(values)} for address {address} were not sent: {self._packets.getTxRxResult(result)}"
            raise LineStalledError(msg)

    def disable(self, line: Line) -> None:
        """Switch the torque of all servos off in one packet, then ask each of them whether it has.

        Raises:
            LineStalledError: One did not confirm it.
        """
        self._under_force = False
        off = dict.fromkeys(self._servos, 0)
        self._write_together(line, TORQUE_ENABLE, off)
        if self._is_asking:
            # On a two-wire line the packet may have met answers to a question that was cut short: once more when they
            # are through.
            self._let_answers_pass(line)
            self._write_together(line, TORQUE_ENABLE, off)
        self._write_together(line, BUS_WATCHDOG, off)
        for _ in range(_DISABLE_TRIES):
            unsure = self._not_surely_off(line)
            if not unsure:
                return
            self._let_answers_pass(line)
            self._write_together(line, TORQUE_ENABLE, off)
        servos = ", ".join(map(str, unsure))
        msg = f"id {servos} did not confirm that the torque is off; has it power?"
        raise LineStalledError(msg)

    def _not_surely_off(self, line: Line) -> list[int]:
        """Return the servos that have not told, with each of several lengths, that their torque is off."""
        address, longest = TORQUE_TO_HARDWARE_ERROR
        for length in self._random.sample(range(1, longest + 1), _LENGTHS_TO_CONFIRM):
            told = self._read(line, self._servos, (address, length))
            unsure = [servo for servo in self._servos if servo not in told or told[servo][0] != 0]
            if unsure:
                return unsure
        return []

    def _let_answers_pass(self, line: Line) -> None:
        """Read away what comes until nothing does, for as long as answers to one question take at most."""
        deadline = self._clock.monotonic() + self._wait
        while self._clock.monotonic() < deadline and line.read(_QUIET):
            pass
        self._is_asking = False

    def read(self, line: Line) -> Feedback:
        """Read all positions; once a second also whether the servos have force, their errors, voltage, temperature.

        Where a tick has no time for both, the positions are left out of the three ticks a second with another question.

        Raises:
            LineLostError: A servo has fallen silent, or has let go by itself.
        """
        is_due = self._clock.monotonic() - self._asked_health >= _HEALTH_EVERY
        if is_due and not self._asks_both and self._knows_positions:
            self._knows_positions = False
            return replace(self._health(line), positions_asked=False)
        self._knows_positions = True
        answers = self._ask_positions(line)
        self._note_answers(answers)
        told = {servo: int.from_bytes(data[:4], "little", signed=True) for servo, data in answers.items()}
        positions = {servo: float(ticks) for servo, ticks in told.items() if _LOWEST_TOLD <= ticks <= _HIGHEST_TOLD}
        health = self._health(line) if is_due and self._asks_both else NOTHING
        strange = [f"id {servo} stands at {told[servo]}, outside a turn" for servo in told.keys() - positions.keys()]
        faults = [*strange, *([health.fault] if health.fault else [])]
        return replace(health, positions=positions, fault="; ".join(faults))

    def _ask_positions(self, line: Line) -> dict[int, bytes]:
        """Return what the servos tell of their positions; nothing where an answer before did not fit its question.

        The length is none of the last two, so an answer that is one or two questions old fits no more.
        """
        before, self._misfit = self._misfit, False
        length = self._random.choice([length for length in _POSITION_BYTES if length not in self._position_bytes])
        self._position_bytes = [self._position_bytes[-1], length]
        answers = self._read(line, self._servos, (PRESENT_POSITION[0], length), self._wait)
        return {} if before else answers

    def _heard_all(self) -> None:
        self._heard = dict.fromkeys(self._servos, self._clock.monotonic())

    def _note_answers(self, answered: Collection[int]) -> None:
        """Note who has answered just now.

        Raises:
            LineLostError: A servo was silent for too long. Under force one that answers again counts too: its bus
                watchdog may have tripped.
        """
        now = self._clock.monotonic()
        longest = _SILENCE_UNDER_FORCE if self._under_force else _SILENCE
        for servo, heard in self._heard.items():
            if now - heard > longest and (self._under_force or servo not in answered):
                msg = (
                    f"id {servo} has fallen silent: no answer for {now - heard:.2f} s; has it power, and is the "
                    "adapter's latency_timer 1 ms?"
                )
                raise LineLostError(msg)
        self._heard.update(dict.fromkeys(answered, now))

    def _health(self, line: Line) -> Feedback:
        """Ask all servos for the next part of their health; ask again in the next tick if not all answer."""
        register = _HEALTH[self._turn % len(_HEALTH)]
        told = self._read(line, self._servos, register, self._wait)
        if len(told) == len(self._servos):
            self._asked_health = self._clock.monotonic()
            self._turn += 1
        if register is BUS_WATCHDOG:
            self._require_watchdog(told)
        elif register is TORQUE_TO_HARDWARE_ERROR:
            return Feedback(fault=self._errors(told))
        elif told:
            voltage = min(int.from_bytes(data[:2], "little") for data in told.values()) / 10.0
            return Feedback(voltage=voltage, temperature=float(max(data[2] for data in told.values())))
        return NOTHING

    def _errors(self, told: Mapping[int, bytes]) -> str:
        """Return what the servos complain about.

        Raises:
            LineLostError: One has no torque that should have.
        """
        faults = []
        for servo, data in told.items():
            errors = ", ".join(text for bit, text in _ERRORS.items() if data[-1] >> bit & 1)
            if self._under_force and data[0] != 1:
                raise LineLostError(_has_let_go(servo, errors))
            faults += [f"id {servo}: {errors}"] if errors else []
        return "; ".join(faults)

    def _require_watchdog(self, told: Mapping[int, bytes]) -> None:
        """Make sure that the bus watchdogs are armed while the servos have force.

        Raises:
            LineLostError: One is not.
        """
        for servo, (value,) in told.items():
            if self._under_force and value == _WATCHDOG_TRIPPED:
                msg = (
                    f"id {servo} stands still: its bus watchdog has tripped, not a packet came through for "
                    f"{WATCHDOG_SECONDS:g} s; check cable and adapter"
                )
                raise LineLostError(msg)
            if self._under_force and value != _WATCHDOG_ARMED:
                raise LineLostError(_has_let_go(servo, ""))


def _has_let_go(servo: int, errors: str) -> str:
    cause = errors or "it has started anew"
    return f"id {servo} has let go: {cause}; does the tail move freely, and is the supply strong enough?"
