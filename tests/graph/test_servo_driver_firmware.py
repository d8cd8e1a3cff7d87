"""The servo driver against firmware that nobody here wrote: StandardFirmata on a simulated Uno.

A set-point is followed in three steps, each with its own bound: the driver's command; the frame that the board received
and what its servo library set the timer to (both exact); the pulse at the pin, which lasts longer where the timer's
interrupt has to wait for another handler, on a real Uno just the same. All times are cycles of the simulated processor:
nothing here depends on how fast the simulation runs.
"""

from __future__ import annotations

import functools
import hashlib
import shutil
import signal
import subprocess
import tarfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant import topics
from fin_plant.gait import PAPER_GAIT
from fin_plant.messages import gait_message, nanoseconds_of
from fin_plant.plant_state import State
from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends import firmata
from fin_servo_driver.port import SerialLine
from support.robot_client import RobotClient
from support.steady import on_time
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sensor_msgs.msg import JointState

    from support.processes import StartedProcess

pytestmark = [pytest.mark.graph, pytest.mark.firmware]
SOURCE = Path(__file__).resolve().parents[1] / "firmware" / "uno.c"
PACKAGE = "avrgirl-arduino@5.0.1"
HEX = "package/junk/hex/uno/StandardFirmata.cpp.hex"
HEADERS = Path("/usr/include/simavr")
PIN, LOWEST, HIGHEST, UNITS_PER_RADIAN = 9, 1200.0, 1800.0, 573.0
"""Pin, us, us and us/rad of the example robot."""
NEAR_EXTREME = 0.95 * UNITS_PER_RADIAN * np.radians(15.0)
"""us from neutral."""
FIRST_PULSE = 1500
"""us. The servo library starts a servo with it."""
ROUNDING = 1e-6
"""us by which a command on the half may have come to either side."""
RAMPED = 2.0
"""s after which the gait is no longer on its starting ramp."""
TOLERANCE = 2.0
"""us."""
TRIM = 2.0
"""us by which the servo library shortens what it sets, for the time that it takes itself to raise and lower the pin."""
INTERRUPTS_OFF = 2.0
"""us at most for which the firmware's main program bars interrupts (1.0 seen), or enters and leaves a handler."""
LONGEST_WAIT = 10.0
"""us from the timer's match to its handler: 8.0 of the longest other handler (sending a byte), and `INTERRUPTS_OFF`."""
PROCESSING = 0.002
"""s in which the firmware's main loop has taken a frame that was received whole (26 us seen)."""
FREQUENCY = 16e6
"""Hz, of the processor."""
CYCLES_A_US = 16.0
SILENCE = 0.3
"""s of the board's own clock: fifteen pulses that did not come."""


@dataclass(frozen=True)
class Pulse:
    """A pulse of the servo pin.

    Attributes:
        start: s of the board's clock.
        width: At the pin, us.
        set_width: What the servo library meant it to be, us: what it set the timer to, and its trim.
        wait: us that the timer's handler, which ends the pulse, had to wait.
    """

    start: float
    width: float
    set_width: float
    wait: float


class Board:
    """The simulated Uno.

    Attributes:
        pulses: Of the servo pin so far.
        received: Bytes that came over the line, each with s of the board's clock.
        clock: s.
        longest_handler: us of the longest run of an interrupt handler, the servo timer's aside.
    """

    def __init__(self, program: Path, firmware: Path) -> None:
        self.pulses: list[Pulse] = []
        self.received: list[tuple[float, int]] = []
        self.clock = 0.0
        self.longest_handler = 0.0
        self.port = ""
        self._process = subprocess.Popen(
            [str(program), str(firmware)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        wait_until(lambda: self.port, 10.0, "the board's pty")

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            match line.split():
                case ["pty", port] if port.startswith("/dev/"):
                    self.port = port
                case ["pulse", start, *others]:
                    width, set_width, wait = (int(cycles) / CYCLES_A_US for cycles in others)
                    self.pulses.append(Pulse(int(start) / FREQUENCY, width, set_width + TRIM, wait))
                case ["byte", now, value]:
                    self.received.append((int(now) / FREQUENCY, int(value, 16)))
                case ["handler", _, cycles]:
                    self.longest_handler = int(cycles) / CYCLES_A_US
                case ["clock", now]:
                    self.clock = int(now) / FREQUENCY

    def silent(self) -> bool:
        """Whether no pulse has come for a while of the board's own time."""
        return not self.pulses or self.clock - self.pulses[-1].start > SILENCE

    def commands(self) -> list[tuple[float, int]]:
        """Return the pulse widths in us that came in frames ``E9 lsb msb``, each with s of the board's clock."""
        kept: list[int] = []
        commands = []
        for time, value in list(self.received):
            kept = [value] if value >= 0x80 else [*kept, value]
            if len(kept) == 3 and kept[0] == 0xE0 | PIN:
                commands.append((time, kept[1] | kept[2] << 7))
        return commands

    def close(self) -> None:
        """Switch it off."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(60.0)
        self._reader.join()
        assert self._process.stdout is not None
        self._process.stdout.close()


@functools.cache
def build(folder: Path) -> tuple[Path, Path]:
    """Return the board's program and StandardFirmata's hex file, or skip with what is missing."""
    missing = [tool for tool in ("cc", "npm") if shutil.which(tool) is None]
    if not (HEADERS / "sim_avr.h").is_file():
        missing.append("simavr (apt install libsimavr-dev)")
    if missing:
        pytest.skip(f"not here: {', '.join(missing)}")
    program = folder / "uno"
    libraries = ["-lsimavrparts", "-lsimavr", "-lpthread", "-lutil", "-lm"]
    subprocess.run(["cc", "-O2", f"-I{HEADERS}", "-o", program, SOURCE, *libraries], check=True)
    # Fetched, never committed: the firmware is under the LGPL.
    packed = subprocess.run(
        ["npm", "pack", "--silent", PACKAGE], cwd=folder, check=False, capture_output=True, text=True, timeout=100.0
    )
    archive = folder / "avrgirl-arduino-5.0.1.tgz"
    if packed.returncode != 0 or not archive.is_file():
        pytest.skip(f"npm pack {PACKAGE} did not work: {packed.stderr.strip()[-200:] or 'no archive'}")
    with tarfile.open(archive) as content:
        content.extract(HEX, folder, filter="data")
    return program, folder / HEX


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return build(tmp_path_factory.mktemp("firmware"))


@pytest.fixture
def board(built: tuple[Path, Path]) -> Iterator[Board]:
    uno = Board(*built)
    yield uno
    uno.close()


@pytest.fixture
def client(ros_domain: int) -> Iterator[RobotClient]:
    with RobotClient(ros_domain) as robot_client:
        yield robot_client


@pytest.fixture
def driver(start: Callable[..., StartedProcess], board: Board, client: RobotClient) -> StartedProcess:
    """Start the driver on the board, ready and silent."""
    process = start(
        "fin_servo_driver", "servo_driver", "--ros-args", "-p", "robot_file:=firmata", "-p", f"port:={board.port}"
    )
    client.make_ready()
    assert board.silent()
    return process


def swim(client: RobotClient, board: Board, pulses: int) -> None:
    """Swim the paper's gait until so many pulses have come."""
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.wait_until(lambda: len(board.pulses) >= pulses, f"{pulses} pulses", timeout=60.0)


def check_frames(frames: np.ndarray, commanded: np.ndarray, dropped: int) -> None:
    """Check that the frames are the commands in us, rounded and in their order; left out are the dropped ones alone.

    Both begin at neutral for a while, with and without frames; compared are they from the first motion on.
    """
    frames, commanded = (values[np.flatnonzero(np.abs(values - 1500.0) > 0.5)[0] :] for values in (frames, commanded))
    at, left_out = 0, 0
    for number, frame in enumerate(frames):
        later = np.flatnonzero(np.abs(commanded[at:] - frame) <= 0.5 + ROUNDING)
        assert later.size, f"frame {number} of {frame} us is none of the commands from number {at} on"
        left_out += int(later[0])
        at += int(later[0]) + 1
    assert left_out <= dropped


def check_pulse(pulse: Pulse, commands: list[tuple[float, int]], longest_handler: float) -> None:
    """Check one pulse against the frames received: the newest one, or an older one while the newest is being taken."""
    before = [width for time, width in commands if time <= pulse.start - PROCESSING][-1:] or [FIRST_PULSE]
    being_taken = [width for time, width in commands if pulse.start - PROCESSING < time <= pulse.start]
    assert pulse.set_width in {*before, *being_taken}
    # Half a us is a tick of the timer; the wait is what the processor did at that moment, to the cycle.
    assert abs(pulse.width - pulse.wait - pulse.set_width) <= 0.5
    assert pulse.wait <= min(longest_handler + INTERRUPTS_OFF, LONGEST_WAIT)


def seconds_after(first: JointState, sample: JointState) -> float:
    """Return how long after the first sample another one was commanded, in s."""
    return (nanoseconds_of(sample.header.stamp) - nanoseconds_of(first.header.stamp)) / 1e9


def check_sinusoid(samples: list[JointState]) -> None:
    """Check that the driver commands the gait asked for: its amplitude and frequency; the phase is free."""
    times = np.array([seconds_after(samples[0], sample) for sample in samples])
    angles = 2.0 * np.pi * PAPER_GAIT.joints[0].frequency * times
    terms = np.column_stack((np.sin(angles), np.cos(angles)))
    commanded = np.array([UNITS_PER_RADIAN * sample.position[0] for sample in samples])
    parts, *_ = np.linalg.lstsq(terms, commanded)
    assert np.hypot(*parts) == pytest.approx(UNITS_PER_RADIAN * np.radians(15.0), abs=TOLERANCE / 2.0)
    assert np.abs(commanded - terms @ parts).max() <= TOLERANCE


def test_the_pulses_are_those_commanded_within_two_microseconds(
    driver: StartedProcess, client: RobotClient, board: Board
) -> None:
    del driver
    swim(client, board, 250)
    pulses = list(board.pulses)
    commands = board.commands()
    client.spin(1.5)  # until what was commanded has arrived here too, and the next diagnostics
    samples = client.received(topics.JOINT_STATES)
    steady = on_time([nanoseconds_of(sample.header.stamp) for sample in samples], 50.0)
    check_sinusoid(
        [s for s, kept in zip(samples, steady, strict=True) if kept and seconds_after(samples[0], s) > RAMPED]
    )
    commanded = np.array([1500.0 - UNITS_PER_RADIAN * sample.position[0] for sample in samples])
    check_frames(
        np.array([frame for _, frame in commands]), commanded, int(client.diagnostic("dropped_set_points") or 0)
    )
    for pulse in pulses:
        check_pulse(pulse, commands, board.longest_handler)
        assert LOWEST <= pulse.width <= HIGHEST
    errors = np.array([pulse.width - pulse.set_width for pulse in pulses])
    print(  # noqa: T201
        f"{len(pulses)} pulses, all set as commanded; at the pin {np.mean(np.abs(errors) <= TOLERANCE):.1%} within "
        f"{TOLERANCE:g} us, {errors.min():+.2f} to {errors.max():+.2f} us; longest wait for another interrupt handler "
        f"{max(pulse.wait for pulse in pulses):.2f} us, longest handler {board.longest_handler:.2f} us"
    )


def test_the_pulses_stop_when_the_gait_stops(driver: StartedProcess, client: RobotClient, board: Board) -> None:
    del driver
    swim(client, board, 100)
    client.publish_gait(None)
    client.wait_until(board.silent, "silence", timeout=30.0)
    check_end(board)
    assert [pulse.set_width for pulse in board.pulses[-4:-1]] == [1500.0] * 3


def check_end(board: Board) -> None:
    """Check that no pulse was beyond the limits; a reset may cut the very last one short."""
    assert all(LOWEST <= pulse.width <= HIGHEST for pulse in board.pulses[:-1])
    assert board.pulses[-1].width <= HIGHEST


def test_the_pulses_stop_on_the_emergency_stop(driver: StartedProcess, client: RobotClient, board: Board) -> None:
    del driver
    swim(client, board, 100)
    assert client.emergency_stop(on=True).success
    client.wait_until(board.silent, "silence", timeout=30.0)
    check_end(board)
    client.wait_for_state(State.FAULT)
    count = len(board.pulses)
    client.spin(1.0)  # the gait is still repeated
    assert len(board.pulses) == count


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_pulses_stop_when_the_driver_is_asked_to_end(
    driver: StartedProcess, client: RobotClient, board: Board, number: signal.Signals
) -> None:
    swim(client, board, 100)
    client.wait_until(
        lambda: abs(board.commands()[-1][1] - 1500.0) > NEAR_EXTREME, "a tail far from neutral", timeout=30.0
    )
    driver.signal(number)
    assert driver.wait(60.0) == 128 + number
    wait_until(board.silent, 30.0, "silence")
    check_end(board)
    # The tail stays where it was. The driver beats until it hears the signal, for long if the machine is busy, so only
    # neutral itself, where a beat leaves a frame in a few hundred, tells a driver that leads the tail there.
    assert abs(board.pulses[-2].set_width - 1500.0) > 1.0
    assert abs(board.commands()[-1][1] - 1500.0) > 1.0


def test_a_killed_driver_leaves_the_firmware_pulsing_and_its_successor_stops_it(
    driver: StartedProcess, client: RobotClient, board: Board, start: Callable[..., StartedProcess], ros_domain: int
) -> None:
    swim(client, board, 100)
    driver.kill()
    count = len(board.pulses)
    wait_until(lambda: len(board.pulses) > count + 50, 30.0, "pulses without a driver")
    successor = start(
        "fin_servo_driver", "servo_driver", "--ros-args", "-p", "robot_file:=firmata", "-p", f"port:={board.port}"
    )
    with RobotClient(ros_domain) as anew:  # the first client still waits for the dead driver's answers
        anew.make_ready()
        successor.signal(signal.SIGTERM)
        successor.wait(60.0)
    wait_until(board.silent, 30.0, "silence")


@pytest.mark.parametrize("set_points", [0, 100])
def test_the_pulses_stop_also_in_the_midst_of_a_message(board: Board, set_points: int) -> None:
    """A sysex message has lost its end: its firmware takes a reset for data, and 64 bytes of set-points overrun it."""
    backend = backends.make(robot_file.load(robot_file.find("firmata")))
    line = SerialLine(board.port, 57600)
    backend.identify(line)
    backend.enable(line, {PIN: 1500.0})
    backend.send(line, {PIN: 1600.0})
    wait_until(lambda: board.pulses and board.pulses[-1].set_width == 1600.0, 30.0, "pulses")
    unfinished = firmata.servo_range(PIN + 1, 1056, 1892)[:-1]
    line.write(unfinished)
    for number in range(set_points):
        backend.send(line, {PIN: 1501.0 + number})
        line.drain(1.0)
    if set_points:
        wait_until(lambda: board.pulses[-1].set_width == 1500.0 + set_points, 30.0, "the last set-point")
        line.write(unfinished)
    line.write(firmata.SYSTEM_RESET)
    count = len(board.pulses)
    wait_until(lambda: len(board.pulses) > count + 20, 30.0, "pulses in spite of a bare reset")
    backend.disable(line)
    wait_until(board.silent, 30.0, "silence")
    check_end(board)
    line.close()


def test_the_simulated_firmware_is_the_one_named(built: tuple[Path, Path]) -> None:
    digest = hashlib.sha256(built[1].read_bytes()).hexdigest()
    assert digest == "6d57ea7cf30e26c9c2f3a01ee37907d2c951f8bc9c27f84dddad12fa9c8b8f36"
