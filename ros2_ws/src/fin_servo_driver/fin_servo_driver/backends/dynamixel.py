"""ROBOTIS Dynamixel X servos, protocol 2, through the maker's own SDK on a port of ours.

The SDK's port handler opens the port without `exclusive` and without a write timeout, so `SdkPort` takes its place. The
servos' bus watchdog is armed with the torque: they stop by themselves when the host is gone.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from fin_servo_driver.backends.backend import NOTHING, Backend, Feedback, LifeSign
from fin_servo_driver.line import LineStalledError, WrongDeviceError

if TYPE_CHECKING:
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs

# Control table of the X series (ROBOTIS e-Manual): address and length.
OPERATING_MODE = (11, 1)
TORQUE_ENABLE = (64, 1)
HARDWARE_ERROR = (70, 1)
BUS_WATCHDOG = (98, 1)
GOAL_POSITION = (116, 4)
PRESENT_POSITION = (132, 4)
PRESENT_VOLTAGE_AND_TEMPERATURE = (144, 3)
POSITION_MODE = 3
WATCHDOG_UNIT = 0.02
WATCHDOG_SECONDS = 0.2
XL320_MODEL = 350
_ERRORS = {0: "input voltage", 2: "overheating", 3: "encoder", 4: "electrical shock", 5: "overload"}
_SYNC_READ_SECONDS = 0.006
_HEALTH_EVERY, _SILENCE = 1.0, 0.5
# The SDK reads until its own timeout says stop, which a stream of garbage can put off for ever.
_LONGEST_READ = 0.25


class SdkPort:
    """The port as the SDK wants it (its `PortHandler`), on a line of ours. Names are the SDK's."""

    def __init__(self, line: Line, baud: int) -> None:
        self.is_using = False
        self.baudrate = baud
        self._line = line
        self._waiting = bytearray()
        self._deadline = self._end = 0.0

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
        """Return up to ``length`` bytes, empty if none comes within a millisecond.

        Raises:
            LineStalledError: Garbage has come for so long that no answer is to be expected.
        """
        if time.monotonic() > self._end:
            msg = "only garbage comes from the Dynamixel bus: check the baud rate, and that each id is there once"
            raise LineStalledError(msg)
        if not self._waiting:
            self._waiting += self._line.read(0.001)
        result = bytes(self._waiting[:length])
        del self._waiting[:length]
        return result

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Write a packet."""
        self._line.write(bytes(packet))
        self._end = time.monotonic() + _LONGEST_READ
        return len(packet)

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Wait for a packet as long as its bytes take, and 20 ms for an adapter that hands them on late."""
        self.setPacketTimeoutMillis(packet_length * 10_000.0 / self.baudrate + 20.0)

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        """Wait so many ms."""
        self._deadline = time.monotonic() + msec / 1000.0

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the wait is over."""
        return time.monotonic() > self._deadline


def signed(value: int) -> int:
    """Return a register of four bytes as the signed number that it holds."""
    return value - (1 << 32) if value >= 1 << 31 else value


class Dynamixel(Backend):
    """The back end. Positions are ticks, 4096 a turn."""

    drives = "servos"
    unit = "ticks"
    channels = range(253)
    lowest = 0.0
    highest = 4095.0
    rate = 100.0
    baud = 57600
    measures = True
    confirms = True

    def __init__(self, robot: Robot) -> None:
        """Take the robot's joints.

        Raises:
            ValueError: Joints that this device cannot have.
        """
        super().__init__(robot)
        self._packets = Protocol2PacketHandler()
        self._port: SdkPort | None = None
        self._life = LifeSign(_HEALTH_EVERY, _SILENCE)
        self._asked_health = 0

    def _open(self, line: Line) -> SdkPort:
        if self._port is None or self._port._line is not line:  # noqa: SLF001 - one file, two classes
            self._port = SdkPort(line, self.robot.baud or self.baud)
        self._port.is_using = False  # an exception out of our port leaves the SDK's flag behind
        return self._port

    def identify(self, line: Line) -> str:
        """Ping every id, and see to it that it is in position mode."""
        port, found = self._open(line), []
        for joint in self.robot.servos:
            servo = joint.channel
            model, result, _ = self._packets.ping(port, servo)
            if result != COMM_SUCCESS:
                msg = (
                    f"no Dynamixel with id {servo} answers a ping at {self.robot.baud or self.baud} baud "
                    f"({self._packets.getTxRxResult(result)}): check power, id and baud rate with the Dynamixel Wizard"
                )
                raise WrongDeviceError(msg)
            if model == XL320_MODEL:
                msg = f"id {servo} is an XL-320, with another control table and no bus watchdog: it is not supported"
                raise WrongDeviceError(msg)
            mode = self._read(line, servo, OPERATING_MODE)
            if mode != POSITION_MODE:
                msg = f"id {servo} is in operating mode {mode}: set position control mode (3) with the Dynamixel Wizard"
                raise WrongDeviceError(msg)
            found.append(f"id {servo} model {model}")
        self._life = LifeSign(_HEALTH_EVERY, _SILENCE)
        return f"Dynamixel {', '.join(found)}"

    def _read(self, line: Line, servo: int, register: tuple[int, int]) -> int:
        """Return a register's value.

        Raises:
            LineStalledError: No valid answer.
        """
        data, result, _ = self._packets.readTxRx(self._open(line), servo, *register)
        if result != COMM_SUCCESS or len(data) < register[1]:
            msg = f"id {servo} does not answer: {self._packets.getTxRxResult(result)}"
            raise LineStalledError(msg)
        return int.from_bytes(bytes(data[: register[1]]), "little")

    def _write(self, line: Line, servo: int, register: tuple[int, int], value: int) -> None:
        """Write a register and wait for the answer.

        Raises:
            LineStalledError: No answer, or a refusal.
        """
        address, length = register
        data = list(value.to_bytes(length, "little"))
        result, error = self._packets.writeTxRx(self._open(line), servo, address, length, data)
        if result != COMM_SUCCESS or error & 0x7F:
            reason = self._packets.getTxRxResult(result) if result else self._packets.getRxPacketError(error & 0x7F)
            msg = f"id {servo} did not take {value} at address {address}: {reason}"
            raise LineStalledError(msg)

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Clear and arm the bus watchdog, and switch the torque on; the servo then holds where it stands."""
        del neutral  # the driver leads the tail there from where it stands, at the joint's rate
        for joint in self.robot.servos:
            self._write(line, joint.channel, BUS_WATCHDOG, 0)
            self._write(line, joint.channel, TORQUE_ENABLE, 1)
            self._write(line, joint.channel, BUS_WATCHDOG, round(WATCHDOG_SECONDS / WATCHDOG_UNIT))

    def send(self, line: Line, outputs: Outputs) -> None:
        """Write all goal positions in one packet."""
        group = GroupSyncWrite(self._open(line), self._packets, *GOAL_POSITION)
        for servo, position in outputs.items():
            group.addParam(servo, list(round(position).to_bytes(4, "little")))
        result = group.txPacket()
        if result != COMM_SUCCESS:
            msg = f"the goal positions were not sent: {self._packets.getTxRxResult(result)}"
            raise LineStalledError(msg)

    def disable(self, line: Line) -> None:
        """Switch the torque off, of all servos even if one of them does not answer.

        Raises:
            LineStalledError: One did not confirm it.
        """
        failures = []
        for joint in self.robot.servos:
            try:
                self._write(line, joint.channel, TORQUE_ENABLE, 0)
                self._write(line, joint.channel, BUS_WATCHDOG, 0)
            except LineStalledError as error:
                failures.append(str(error))
        if failures:
            raise LineStalledError("; ".join(failures))

    def read(self, line: Line) -> Feedback:
        """Read all positions; once a second voltage, temperature and errors of one servo in turn."""
        group = GroupSyncRead(self._open(line), self._packets, *PRESENT_POSITION)
        for joint in self.robot.servos:
            group.addParam(joint.channel)
        port = self._open(line)
        try:
            group.txPacket()
            port.setPacketTimeoutMillis(1000.0 * _SYNC_READ_SECONDS * len(self.robot.servos))
            group.rxPacket()
        except IndexError:  # the SDK's reaction to a packet that is cut short
            self._life.due()
            return NOTHING
        finally:
            port.is_using = False
        positions = {
            joint.channel: float(signed(group.getData(joint.channel, *PRESENT_POSITION)))
            for joint in self.robot.servos
            if group.isAvailable(joint.channel, *PRESENT_POSITION)
        }
        if positions:
            self._life.heard()
        return self._health(line, positions) if self._life.due() else Feedback(positions)

    def _health(self, line: Line, positions: dict[int, float]) -> Feedback:
        servo = self.robot.servos[self._asked_health % len(self.robot.servos)].channel
        self._asked_health += 1
        try:
            packed = self._read(line, servo, PRESENT_VOLTAGE_AND_TEMPERATURE)
            bits = self._read(line, servo, HARDWARE_ERROR)
        except LineStalledError as error:
            return Feedback(positions, fault=str(error))
        faults = [text for bit, text in _ERRORS.items() if bits >> bit & 1]
        fault = f"id {servo}: {', '.join(faults)}" if faults else ""
        return Feedback(positions, (packed & 0xFFFF) / 10.0, float(packed >> 16), fault)
