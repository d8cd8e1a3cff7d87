"""Devices as their makers describe them, without a port: bytes in, bytes out, and what they make their servos do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol

from fin_servo_driver.backends import dynamixel, firmata, maestro, modbus
from fin_servo_driver.emulator import packets

if TYPE_CHECKING:
    from collections.abc import Callable

_LONGEST_MESSAGE = 64
_MODBUS_BYTES = 8
"""Of coils that are written at once."""
_PINS = 20
"""Of an Uno."""
_SYSEX_ROOM = 64
"""Bytes that StandardFirmata keeps of a message between F0 and F7; more overrun its memory."""


class SwitchFrame(Protocol):
    """Makes the frame that switches a relay."""

    def __call__(self, channel: int, *, on: bool) -> bytes:
        """Return its bytes."""


class Device(ABC):
    """An emulated device.

    Attributes:
        outputs: What each channel does: a servo's position, None without force; 1 or 0 for a relay.
        frames: How many frames were understood.
    """

    def __init__(self) -> None:
        self.outputs: dict[int, float | None] = {}
        self.frames = 0

    def opened(self, now: float) -> bytes:
        """Return what the device says when its port is opened at ``now`` s."""
        del now
        return b""

    @abstractmethod
    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes at ``now`` s and return what is answered."""

    def tick(self, now: float) -> None:
        """Let time pass."""
        del now

    def lose_power(self) -> None:
        """Lose the supply for a moment, and start anew: all outputs off, and nothing is said of it unasked."""
        self.outputs = dict.fromkeys(self.outputs)


class Firmata(Device):
    """An Uno with StandardFirmata: opening the port resets it, and it goes on pulsing when the host is silent.

    Between F0 and F7 it takes every byte for data, a reset too, and has room for 64 of them; then it is deaf.
    """

    def __init__(self) -> None:
        super().__init__()
        self._message = bytearray()
        self._deaf = False
        self._ranges: dict[int, tuple[int, int]] = {}

    def opened(self, now: float) -> bytes:
        """Reset: all pins without pulses; then the banner and the firmware's name."""
        del now
        self.outputs = {}
        self._message = bytearray()
        self._deaf = False
        name = b"".join(bytes((ord(letter), 0)) for letter in "StandardFirmata.ino")
        return b"\xf9\x02\x05\xf0\x79\x02\x05" + name + b"\xf7"

    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes."""
        del now
        return b"".join(self._take(byte) for byte in data)

    def _take(self, byte: int) -> bytes:
        """Take a byte and return what is answered."""
        if self._deaf:
            return b""
        if self._message[:1] == b"\xf0":
            self._message.append(byte)
            self._deaf = byte != 0xF7 and len(self._message) > 1 + _SYSEX_ROOM  # noqa: PLR2004
            if byte == 0xF7:  # noqa: PLR2004
                return self._complete()
        elif byte == firmata.SYSTEM_RESET[0]:
            self.outputs = {}
            self._message = bytearray()
            self.frames += 1
        elif byte == firmata.ASK_VERSION[0]:
            return b"\xf9\x02\x05"
        elif byte >= 0x80 and byte != 0xF7:  # noqa: PLR2004 - commands have the eighth bit
            self._message = bytearray((byte,))
        elif byte < 0x80 and self._message and len(self._message) < _LONGEST_MESSAGE:  # noqa: PLR2004
            self._message.append(byte)
            return self._complete()
        return b""

    def _complete(self) -> bytes:
        """Carry the message out if it is whole, and return what is answered."""
        answer = b""
        match list(self._message):
            case [0xF0, 0x6D, pin, 0xF7]:
                answer = bytes((0xF0, 0x6E, pin, *self._pin_state(pin), 0xF7))
            case [0xF4, pin, firmata.SERVO_MODE]:
                self.outputs.setdefault(pin, float(firmata.FIRST_PULSE))
            case [command, low, high] if command & 0xF0 == 0xE0:  # noqa: PLR2004 - the pin is in the other bits
                self._pulse(command & 0x0F, low | high << 7)
            case [0xF0, 0x6F, pin, low, high, 0xF7]:
                self._pulse(pin, low | high << 7)
            case [0xF0, 0x70, pin, low, low_high, high, high_high, 0xF7]:
                self._ranges[pin] = (low | low_high << 7, high | high_high << 7)
                self.outputs.setdefault(pin, float(firmata.FIRST_PULSE))
            case [*_, 0xF7] | [0xF4, _, _]:
                pass
            case _:
                return b""
        self.frames += 1
        self._message = bytearray()
        return answer

    def _pin_state(self, pin: int) -> bytes:
        """Return mode and value of a pin; nothing for one that an Uno has not."""
        if pin >= _PINS:
            return b""
        width = self.outputs.get(pin)
        return b"\x01\x00" if width is None else bytes((firmata.SERVO_MODE, round(width) & 0x7F, round(width) >> 7))

    def _pulse(self, pin: int, width: int) -> None:
        if pin in self.outputs:
            in_degrees = width < firmata.LOWEST_MICROSECONDS
            wanted = 544.0 + width * 1856.0 / 180.0 if in_degrees else float(width)
            low, high = self._ranges.get(pin, (544, 2400))
            self.outputs[pin] = min(max(wanted, low), high)


class Maestro(Device):
    """A Maestro: pulses go on until the target is 0.

    Attributes:
        questions: How often it was asked for its errors.
    """

    def __init__(self, serial_timeout: float = 0.0) -> None:
        """Take the serial timeout in s, after which it complains and stops all pulses; 0, as it is bought, is never."""
        super().__init__()
        self.questions = 0
        self._serial_timeout = serial_timeout
        self._heard: float | None = None
        self._errors = 0
        self._message = bytearray()

    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes."""
        self._heard = now
        answer = b""
        for byte in data:
            if byte == maestro.GET_ERRORS[0]:
                self.questions += 1
                answer += self._errors.to_bytes(2, "little")
                self._errors = 0
            elif byte == maestro.GET_MOVING[0]:
                answer += b"\x00"
            elif byte >= 0x80:  # noqa: PLR2004 - commands have the eighth bit
                self._message = bytearray((byte,))
            elif self._message and len(self._message) < _LONGEST_MESSAGE:
                self._message.append(byte)
                answer += self._complete()
        return answer

    def lose_power(self) -> None:
        """Lose the supply for a moment, and start anew: no pulses, no errors, and deaf to the end of a frame."""
        super().lose_power()
        self._errors = 0
        self._heard = None
        self._message = bytearray()

    def tick(self, now: float) -> None:
        """Let the serial timeout run."""
        if self._serial_timeout and self._heard is not None and now - self._heard > self._serial_timeout:
            self._errors |= maestro.SERIAL_TIMEOUT
            self.outputs = dict.fromkeys(self.outputs)

    def _complete(self) -> bytes:
        """Carry the command out if it is whole, and return what is answered."""
        answer = b""
        match list(self._message):
            case [0x90, channel]:
                answer = round((self.outputs.get(channel) or 0.0) * maestro.QUARTERS).to_bytes(2, "little")
            case [0x84, channel, low, high]:
                self._set(channel, low | high << 7)
            case [0x9F, count, first, *pairs] if len(pairs) == 2 * count:
                for index in range(count):
                    self._set(first + index, pairs[2 * index] | pairs[2 * index + 1] << 7)
            case [0x87, _, _, _]:
                pass
            case _:
                return b""
        self.frames += 1
        self._message = bytearray()
        return answer

    def _set(self, channel: int, quarters: int) -> None:
        self.outputs[channel] = quarters / maestro.QUARTERS if quarters else None


class Dynamixel(Device):
    """A bus with Dynamixel X servos: control table, status packets, bus watchdog."""

    # Registers of the control table that a restart clears.
    _RAM = slice(64, 116)

    def __init__(self, servos: list[int], present: Callable[[int], float]) -> None:
        """Put servos on the bus; ``present`` tells where one stands, in ticks."""
        super().__init__()
        self.tables = {servo: bytearray(200) for servo in servos}
        for servo, table in self.tables.items():
            # An XL430-W250: model, firmware, id, 57,600 baud, return delay, drive mode; secondary id, protocol 2.
            table[:14] = b"\x24\x04\x00\x00\x00\x00\x2d" + bytes((servo, 1, 250, 0, 3, 0xFF, 2))
            table[dynamixel.OPERATING_MODE[0]] = dynamixel.POSITION_MODE
            table[144:147] = (120).to_bytes(2, "little") + bytes((35,))  # 12.0 V, 35 degrees Celsius
        self._present = present
        self._parser = packets.Parser()
        self._heard = 0.0

    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes."""
        answer = b""
        for packet in self._parser.feed(data):
            self._heard = now
            self.frames += 1
            answer += self._execute(packet)
        return answer

    def tick(self, now: float) -> None:
        """Let the bus watchdogs run."""
        for servo, table in self.tables.items():
            limit = table[98]
            if 0 < limit < 128 and table[64] and now - self._heard > limit * dynamixel.WATCHDOG_UNIT:  # noqa: PLR2004
                table[98] = 0xFF  # it holds where it is, and refuses goals until somebody writes 0
                self.outputs[servo] = self._present(servo)

    def reboot(self, servo: int) -> None:
        """Start a servo anew, as after a dip of its supply: no torque, no watchdog."""
        self.tables[servo][self._RAM] = bytes(len(self.tables[servo][self._RAM]))
        self.outputs[servo] = None

    def shut_down(self, servo: int, errors: int) -> None:
        """Let a servo shut itself down with these bits of its hardware error status; the bus goes on as before."""
        self.tables[servo][dynamixel.TORQUE_ENABLE[0]] = 0
        self.tables[servo][70] = errors
        self.outputs[servo] = None

    def lose_power(self) -> None:
        """Start all servos anew."""
        for servo in self.tables:
            self.reboot(servo)

    def _execute(self, packet: packets.Packet) -> bytes:
        data = packet.parameters
        first, second = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:4], "little")
        own = packet.servo in self.tables
        if packet.instruction == packets.PING:
            asked = list(self.tables) if packet.servo == packets.BROADCAST else [packet.servo] * own
            return b"".join(
                self._status(servo, bytes(self.tables[servo][index] for index in (0, 1, 6))) for servo in asked
            )
        if packet.instruction == packets.READ and own:
            return self._status(packet.servo, self._read(packet.servo, first, second))
        if packet.instruction == packets.WRITE and own:
            return self._status(packet.servo, b"", error=self._write(packet.servo, first, data[2:]))
        if packet.instruction == packets.SYNC_READ:
            return b"".join(self._status(s, self._read(s, first, second)) for s in data[4:] if s in self.tables)
        if packet.instruction == packets.SYNC_WRITE:
            for start in range(4, len(data) - second, second + 1):
                if data[start] in self.tables:
                    self._write(data[start], first, data[start + 1 : start + 1 + second])
        return b""

    def _status(self, servo: int, parameters: bytes, error: int = 0) -> bytes:
        return packets.encode(servo, packets.STATUS, bytes((error,)) + parameters)

    def _read(self, servo: int, address: int, length: int) -> bytes:
        position = round(self._present(servo))
        self.tables[servo][132:136] = position.to_bytes(4, "little", signed=True)
        return bytes(self.tables[servo][address : address + length])

    def _write(self, servo: int, address: int, data: bytes) -> int:
        """Write to the control table; return the error number of the status packet."""
        table = self.tables[servo]
        tripped = table[98] >= 128  # noqa: PLR2004
        if address == dynamixel.GOAL_POSITION[0] and tripped:
            return 0x04
        table[address : address + len(data)] = data
        if address == dynamixel.TORQUE_ENABLE[0]:
            self.outputs[servo] = self._present(servo) if data[0] else None
        elif address == dynamixel.GOAL_POSITION[0] and table[64]:
            self.outputs[servo] = float(int.from_bytes(data, "little", signed=True))
        return 0


class Relays(Device):
    """A relay board: stays in its last state, and has all relays off when it starts."""

    def lose_power(self) -> None:
        """Lose the supply for a moment, and start anew: all relays off."""
        self.outputs = dict.fromkeys(self.outputs, 0.0)


class SilentRelays(Relays):
    """A relay board that answers nothing: LCUS, KMTronic."""

    def __init__(self, switch_frame: SwitchFrame) -> None:
        """Take what the board understands: the frame that switches a channel."""
        super().__init__()
        self._frame = switch_frame
        self._length = len(switch_frame(1, on=True))
        self._waiting = bytearray()

    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes; what is no frame is skipped byte by byte."""
        del now
        self._waiting += data
        while len(self._waiting) >= self._length:
            channel, state = self._waiting[1], self._waiting[2]  # in both makers' frames
            if state in {0, 1} and self._waiting[: self._length] == self._frame(channel, on=bool(state)):
                self.outputs[channel] = float(state)
                self.frames += 1
                del self._waiting[: self._length]
            else:
                del self._waiting[:1]
        return b""


class Modbus(Relays):
    """A Modbus RTU board with eight relays.

    Attributes:
        refuses_several: Whether it knows no function 0F, as cheap boards do.
    """

    def __init__(self, unit: int) -> None:
        super().__init__()
        self._unit = unit
        self.refuses_several = False
        self._waiting = bytearray()
        self.outputs = dict.fromkeys(range(8), 0.0)

    def feed(self, data: bytes, now: float) -> bytes:
        """Take bytes."""
        del now
        self._waiting += data
        answer = b""
        while len(self._waiting) >= 8:  # noqa: PLR2004 - the shortest request
            writes_several = self._waiting[0] == self._unit and self._waiting[1] == 0x0F  # noqa: PLR2004
            length = 9 + self._waiting[6] if writes_several and self._waiting[6] <= _MODBUS_BYTES else 8
            if len(self._waiting) < length:
                return answer
            frame = bytes(self._waiting[:length])
            if frame[0] != self._unit or modbus.crc16(frame[:-2]) != frame[-2:]:
                del self._waiting[:1]
                continue
            del self._waiting[:length]
            self.frames += 1
            answer += self._execute(frame)
        return answer

    def _execute(self, frame: bytes) -> bytes:
        coil = int.from_bytes(frame[2:4], "big")
        if frame[1] == 0x05 and coil in self.outputs:  # noqa: PLR2004
            self.outputs[coil] = float(frame[4] != 0)
            return frame
        count = int.from_bytes(frame[4:6], "big")
        if frame[1] == 0x0F and self.refuses_several:  # noqa: PLR2004
            body = bytes((self._unit, 0x8F, 0x01))
            return body + modbus.crc16(body)
        if frame[1] == 0x0F and count and coil + count <= len(self.outputs) and frame[6] == (count + 7) // 8:  # noqa: PLR2004
            bits = int.from_bytes(frame[7:-2], "little")
            self.outputs.update({coil + number: float(bits >> number & 1) for number in range(count)})
            return frame[:6] + modbus.crc16(frame[:6])
        if frame[1] == 0x01 and count and coil + count <= len(self.outputs):
            bits = sum(1 << number for number in range(count) if self.outputs[coil + number])
            length = (count + 7) // 8
            body = bytes((self._unit, 0x01, length)) + bits.to_bytes(length, "little")
            return body + modbus.crc16(body)
        body = bytes((self._unit, frame[1] | 0x80, 0x02))
        return body + modbus.crc16(body)
