"""Every frame that the devices' makers document, byte for byte, and our own codecs against other people's."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import minimalmodbus
import numpy as np
import pytest
from dynamixel_sdk import GroupSyncRead, GroupSyncWrite
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st
from pymodbus import FramerType
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.bit_message import WriteSingleCoilRequest

from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends import dynamixel, firmata, kmtronic, lcus, maestro, modbus
from fin_servo_driver.emulator import devices, packets
from support.wire import OwnClock

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.backends.backend import Backend


class Wire:
    """A line that keeps what is written; it answers like one Dynamixel, or not at all."""

    def __init__(self, answer: Callable[[bytes], bytes] = lambda _: b"") -> None:
        self.written = b""
        self._answer = answer
        self._waiting = b""

    def write(self, data: bytes) -> None:
        self.written += data
        self._waiting += self._answer(data)

    def read(self, timeout: float) -> bytes:
        del timeout
        data, self._waiting = self._waiting, b""
        return data


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize(
    ("ours", "documented"),
    [
        pytest.param(firmata.servo_mode(9), "F4 09 04", id="firmata, pin 9 to servo mode"),
        pytest.param(firmata.pulse(9, 1500), "E9 5C 0B", id="firmata, 1500 us on pin 9"),
        pytest.param(firmata.servo_range(9, 544, 2400), "F0 70 09 20 04 60 12 F7", id="firmata, range of pin 9"),
        pytest.param(firmata.pulse(16, 1500), "F0 6F 10 5C 0B F7", id="firmata, pin over 15"),
        pytest.param(firmata.pulse(15, 1500), "EF 5C 0B", id="firmata, last short pin"),
        pytest.param(firmata.SYSTEM_RESET, "FF", id="firmata, reset"),
        pytest.param(firmata.ASK_VERSION, "F9", id="firmata, version"),
        pytest.param(maestro.target(0, 6000), "84 00 70 2E", id="maestro, channel 0 to 1500 us"),
        pytest.param(maestro.target(2, 6000), "84 02 70 2E", id="maestro, channel 2 to 1500 us"),
        pytest.param(maestro.speed(5, 140), "87 05 0C 01", id="maestro, speed"),
        pytest.param(maestro.GO_HOME, "A2", id="maestro, all home"),
        pytest.param(maestro.targets(0, [6000, 6620, 5380]), "9F 03 00 70 2E 5C 33 04 2A", id="maestro, several"),
        pytest.param(lcus.switch_frame(1, on=True), "A0 01 01 A2", id="lcus on"),
        pytest.param(lcus.switch_frame(1, on=False), "A0 01 00 A1", id="lcus off"),
        pytest.param(modbus.write_coil(1, 0, modbus.STANDARD_ON), "01 05 00 00 FF 00 8C 3A", id="modbus on"),
        pytest.param(modbus.write_coil(1, 0, 0), "01 05 00 00 00 00 CD CA", id="modbus off"),
        pytest.param(modbus.write_coil(1, 0, modbus.CLONE_ON)[:6], "01 05 00 00 01 00", id="modbus on, clones"),
        pytest.param(kmtronic.switch_frame(1, on=True), "FF 01 01", id="kmtronic on"),
        pytest.param(kmtronic.switch_frame(1, on=False), "FF 01 00", id="kmtronic off"),
        pytest.param(
            packets.encode(1, packets.WRITE, frame("74 00 00 02 00 00")),
            "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
            id="dynamixel, goal position 512",
        ),
        pytest.param(
            packets.encode(1, packets.WRITE, frame("40 00 01")),
            "FF FF FD 00 01 06 00 03 40 00 01 DB 66",
            id="dynamixel, torque on",
        ),
        pytest.param(
            packets.encode(1, packets.WRITE, frame("62 00 0A")),
            "FF FF FD 00 01 06 00 03 62 00 0A 4A E4",
            id="dynamixel, bus watchdog 200 ms",
        ),
    ],
)
def test_frames_are_those_of_the_makers(ours: bytes, documented: str) -> None:
    assert ours.hex(" ") == frame(documented).hex(" ")


def status_of_servo_1(_: bytes) -> bytes:
    return packets.encode(1, packets.STATUS, b"\x00")


@pytest.mark.parametrize(
    ("register", "value", "documented"),
    [
        (dynamixel.GOAL_POSITION, 512, "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89"),
        (dynamixel.TORQUE_ENABLE, 1, "FF FF FD 00 01 06 00 03 40 00 01 DB 66"),
        (dynamixel.BUS_WATCHDOG, 10, "FF FF FD 00 01 06 00 03 62 00 0A 4A E4"),
    ],
)
def test_the_makers_sdk_on_our_port_sends_the_documented_packets(
    register: tuple[int, int], value: int, documented: str
) -> None:
    wire = Wire(status_of_servo_1)
    port = dynamixel.SdkPort(wire, 57600, OwnClock())
    address, length = register
    result, error = Protocol2PacketHandler().writeTxRx(port, 1, address, length, list(value.to_bytes(length, "little")))
    assert (result, error) == (0, 0)
    assert wire.written == frame(documented)


def test_the_makers_packets_equal_ours() -> None:
    """The SDK and the codec of the emulator know nothing of each other.

    Over the positions that the driver can send: SDK 4.1.0 loses its own byte stuffing, which only FF FF FD would need.
    """
    handler, random = Protocol2PacketHandler(), np.random.default_rng(5)
    for _ in range(500):
        wire = Wire()
        port = dynamixel.SdkPort(wire, 57600, OwnClock())
        servos = random.choice(250, size=random.integers(1, 6), replace=False)
        goals = {int(servo): int(random.integers(0, 4096)).to_bytes(4, "little") for servo in servos}
        write = GroupSyncWrite(port, handler, *dynamixel.GOAL_POSITION)
        for servo, data in goals.items():
            write.addParam(servo, list(data))
        write.txPacket()
        body = frame("74 00 04 00") + b"".join(bytes((servo,)) + data for servo, data in goals.items())
        assert wire.written.hex() == packets.encode(packets.BROADCAST, packets.SYNC_WRITE, body).hex()
        wire.written = b""
        read = GroupSyncRead(port, handler, *dynamixel.PRESENT_POSITION)
        for servo in goals:
            read.addParam(servo)
        port.is_using = False
        read.txPacket()
        body = frame("84 00 04 00") + bytes(goals)
        assert wire.written.hex() == packets.encode(packets.BROADCAST, packets.SYNC_READ, body).hex()


@given(st.integers(0, 252), st.binary(min_size=0, max_size=60))
def test_dynamixel_packets_survive_the_way_through_garbage(servo: int, parameters: bytes) -> None:
    parser = packets.Parser()
    stream = b"\x12\xff\xff" + packets.encode(servo, packets.WRITE, parameters) + b"\xff"
    found = list(itertools.chain.from_iterable(parser.feed(bytes((byte,))) for byte in stream))
    assert packets.Packet(servo, packets.WRITE, parameters) in found


@given(st.integers(1, 247), st.integers(0, 63), st.sampled_from([0, modbus.STANDARD_ON]))
def test_modbus_frames_equal_those_of_pymodbus(unit: int, coil: int, value: int) -> None:
    request = WriteSingleCoilRequest(address=coil, bits=[value > 0], dev_id=unit)
    framer = FramerRTU(DecodePDU(is_server=False))
    assert FramerType.RTU.value == "rtu"
    assert modbus.write_coil(unit, coil, value) == framer.buildFrame(request)


@given(st.binary(min_size=2, max_size=40))
def test_the_crc_of_modbus_equals_that_of_minimalmodbus(data: bytes) -> None:
    assert modbus.crc16(data) == minimalmodbus._calculate_crc(data)


def test_maestro_errors_are_named() -> None:
    assert maestro.errors(frame("00 00")) == []
    assert maestro.errors(frame("10 00")) == ["serial protocol error"]
    assert "serial timeout" in maestro.errors(frame("20 00"))[0]
    assert maestro.errors(frame("00 01")) == ["script program counter error"]


def test_a_maestro_at_rest_is_asked_more_often_than_its_serial_timeout_of_the_checklist() -> None:
    board, clock = devices.Maestro(serial_timeout=0.5), OwnClock()
    wire = Wire(lambda data: board.feed(data, clock.now))
    backend = backends.make(robot_file.load(robot_file.find("maestro")), clock)
    assert backend.identify(wire) == "Maestro, errors before: none"
    backend.disable(wire)
    for _ in range(500):
        clock.sleep(1.0 / backend.rate)
        board.tick(clock.now)
        assert backend.read(wire).fault == ""
    assert board.questions > 40


def test_a_maestro_that_nobody_asks_complains_and_stops_its_pulses() -> None:
    board = devices.Maestro(serial_timeout=0.5)
    board.feed(maestro.target(0, 6000), 0.0)
    board.tick(0.4)
    assert board.outputs == {0: 1500.0}
    board.tick(0.6)
    assert board.outputs == {0: None}
    assert "serial timeout" in maestro.errors(board.feed(maestro.GET_ERRORS, 0.6))[0]
    assert maestro.errors(board.feed(maestro.GET_ERRORS, 0.6)) == []


def test_firmata_banner_is_found_between_other_bytes() -> None:
    parser = firmata.Parser()
    for byte in frame("00 12 F9 02 F0 79 02 05 41 00 F7 F9 02 05 E0"):
        parser.feed(bytes((byte,)))
    assert parser.version == (2, 5)


def test_firmata_text_is_decoded() -> None:
    parser = firmata.Parser()
    parser.feed(frame("F0 71") + bytes(itertools.chain.from_iterable((ord(c), 0) for c in "Unknown mode")) + b"\xf7")
    assert parser.text == "Unknown mode"


ENABLE = firmata.servo_range(9, 1056, 1892) + firmata.servo_mode(9) + firmata.pulse(9, 1500)


def firmata_board() -> tuple[devices.Firmata, Wire, Backend]:
    """Return an emulated board that pulses, a line to it and its back end."""
    board = devices.Firmata()
    board.opened(0.0)
    wire = Wire(lambda data: board.feed(data, 0.0))
    backend = backends.make(robot_file.load(robot_file.find("firmata")))
    backend.enable(wire, {9: 1500.0})
    assert board.outputs == {9: 1500.0}
    return board, wire, backend


@pytest.mark.parametrize("length", range(1, len(ENABLE)))
def test_a_board_in_the_midst_of_any_frame_is_silenced(length: int) -> None:
    board, wire, backend = firmata_board()
    wire.write(ENABLE[:length])
    backend.disable(wire)
    assert board.outputs == {}


def test_an_unfinished_sysex_swallows_a_bare_reset_as_in_the_firmware() -> None:
    board, wire, _ = firmata_board()
    wire.write(ENABLE[:5] + firmata.SYSTEM_RESET + firmata.ASK_VERSION + firmata.pulse(9, 1600))
    assert board.outputs == {9: 1500.0}


def test_set_points_go_on_after_a_sysex_that_has_lost_its_end() -> None:
    """Without an end its 64th byte would overrun the firmware's memory."""
    board, wire, backend = firmata_board()
    wire.write(ENABLE[:5])
    for width in np.linspace(1400.0, 1600.0, 101):
        backend.send(wire, {9: float(width)})
        assert board.outputs == {9: round(width)}
    backend.disable(wire)
    assert board.outputs == {}


def test_a_sysex_without_end_makes_the_firmware_deaf() -> None:
    board, wire, backend = firmata_board()
    wire.write(ENABLE[:5] + bytes(100))
    backend.disable(wire)
    assert board.outputs == {9: 1500.0}
    board.opened(0.0)
    assert board.outputs == {}


@given(st.lists(st.binary(max_size=50), max_size=20))
def test_garbage_never_breaks_a_parser(chunks: list[bytes]) -> None:
    ours, theirs = firmata.Parser(), packets.Parser()
    for chunk in chunks:
        ours.feed(chunk)
        theirs.feed(chunk)
        modbus.answer_in(chunk, modbus.read_coils(1, 0, 8))
        modbus.answer_in(chunk, modbus.write_coil(1, 0, 0))
