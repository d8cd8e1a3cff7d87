"""The Modbus back end against pymodbus' server, a relay board that nobody here wrote."""

from __future__ import annotations

import asyncio
import os
import pty
import select
import threading
import time
import tty
from typing import TYPE_CHECKING

import minimalmodbus
import pytest
from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from fin_servo_driver import backends, port, robot_file
from fin_servo_driver.backends import modbus
from fin_servo_driver.backends.modbus import Modbus
from fin_servo_driver.line import LineStalledError, WrongDeviceError
from fin_servo_driver.port import SerialLine
from support.waiting import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fin_servo_driver.clock import Clock

UNIT = 1


class Cable:
    """Two ptys joined: a serial cable between two ports."""

    def __init__(self) -> None:
        pairs = [pty.openpty() for _ in range(2)]
        for _, slave in pairs:
            tty.setraw(slave)
        self._descriptors = [descriptor for pair in pairs for descriptor in pair]
        self.ends = [os.ttyname(slave) for _, slave in pairs]
        self._masters = [master for master, _ in pairs]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def _carry(self) -> None:
        one, other = self._masters
        while not self._ended.is_set():
            for ready in select.select(self._masters, [], [], 0.02)[0]:
                os.write(other if ready == one else one, os.read(ready, 4096))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for descriptor in self._descriptors:
            os.close(descriptor)


class RelayBoard:
    """pymodbus' server in a thread of its own, with eight coils."""

    def __init__(self, port: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._running = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(port,))
        self._thread.start()
        assert self._running.wait(PATIENCE)

    def _serve(self, port: str) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._main(port))
        self._loop.close()

    async def _main(self, port: str) -> None:
        coils = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
        registers = [SimData(0, values=0, datatype=DataType.REGISTERS)]
        device = SimDevice(UNIT, simdata=(coils, coils, registers, registers))
        self.server = ModbusSerialServer(device, framer=FramerType.RTU, port=port, baudrate=9600)
        await self.server.serve_forever(background=True)
        self._stop = asyncio.Event()
        self._running.set()
        await self._stop.wait()
        await self.server.shutdown()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()


@pytest.fixture
def board() -> Iterator[str]:
    """Serve a relay board; yield the driver's end of the cable."""
    cable = Cable()
    server = RelayBoard(cable.ends[1])
    yield cable.ends[0]
    server.close()
    cable.close()


class AheadClock:
    """This machine's clock, but for what was slept, which is skipped."""

    def __init__(self) -> None:
        self._ahead = 0.0

    def monotonic(self) -> float:
        """Return the time in s."""
        return time.monotonic() + self._ahead

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""
        self._ahead += seconds


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take no process that was put aside for a port that takes no bytes."""
    monkeypatch.setattr(port, "WRITE_TIMEOUT", PATIENCE)


def backend(clock: Clock = time) -> Modbus:
    made = backends.make(robot_file.load(robot_file.find("modbus")), clock)
    assert isinstance(made, Modbus)
    return made


def read_with_somebody_elses_client(port: str) -> list[int]:
    instrument = minimalmodbus.Instrument(port, UNIT)
    instrument.serial.baudrate = 9600
    instrument.serial.timeout = PATIENCE
    bits = instrument.read_bits(0, 2, functioncode=1)
    instrument.serial.close()
    return list(bits)


def test_relays_switch_on_and_off_as_a_foreign_client_reads_them(board: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modbus, "_ANSWER_SECONDS", PATIENCE)  # all answers come, on a busy machine late
    clock = AheadClock()
    subject = backend(clock)
    for outputs, expected in (({0: 1.0, 1: 0.0}, [1, 0]), ({0: 0.0, 1: 1.0}, [0, 1]), ({0: 0.0, 1: 0.0}, [0, 0])):
        line = SerialLine(board, 9600)
        assert "Modbus relays, unit 1" in subject.identify(line)
        subject.enable(line, {0: 0.0, 1: 0.0})
        subject.send(line, dict(outputs))
        clock.sleep(max(subject.robot.timing.dead_time, subject.robot.timing.shortest_on))
        subject.send(line, dict(outputs))
        line.close()
        assert read_with_somebody_elses_client(board) == expected
    line = SerialLine(board, 9600)
    subject.send(line, {0: 1.0, 1: 0.0})
    assert read_with_somebody_elses_client(board) == [1, 0]
    subject.disable(line)
    line.close()
    assert read_with_somebody_elses_client(board) == [0, 0]


def test_a_relay_that_the_board_has_not_is_refused_with_its_answer(board: str) -> None:
    line = SerialLine(board, 9600)
    with pytest.raises(LineStalledError, match=r"did not switch relay 60: sent 01 05 00 3c"):
        backend().switch(line, 60, on=True)
    line.close()


def test_another_unit_is_not_taken_for_ours(board: str) -> None:
    robot = robot_file.parse(
        {"device": "modbus", "joints": [{"left": 0, "right": 1}], "options": {"unit": 9}, "port": board}
    )
    line = SerialLine(board, 9600)
    other = backends.make(robot)
    # This server answers for every unit that is asked for, with a refusal.
    with pytest.raises(WrongDeviceError, match=r"unit 9 does not tell its coils .* is options: unit right"):
        other.identify(line)
    with pytest.raises(LineStalledError, match=r"unit 9 did not switch relay 0: .* check options: unit"):
        other.disable(line)
    line.close()
