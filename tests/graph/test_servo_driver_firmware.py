"""The servo driver against firmware that nobody here wrote: StandardFirmata on a simulated Uno.

Pulses are measured at the pin. Widths and order are asserted, never the wall clock: the simulation may run slower
than real time.
"""

from __future__ import annotations

import functools
import hashlib
import shutil
import signal
import subprocess
import tarfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant import topics
from fin_plant.gait import PAPER_GAIT
from fin_plant.messages import gait_message
from fin_plant.plant_state import State
from support.robot_client import RobotClient
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.processes import StartedProcess

pytestmark = [pytest.mark.graph, pytest.mark.firmware]
SOURCE = Path(__file__).resolve().parents[1] / "firmware" / "uno.c"
PACKAGE = "avrgirl-arduino@5.0.1"
HEX = "package/junk/hex/uno/StandardFirmata.cpp.hex"
HEADERS = Path("/usr/include/simavr")
LOWEST, HIGHEST = 1200.0, 1800.0
"""us, of the example robot."""
TOLERANCE = 2.0
"""us: half a us of rounding, and the firmware's own way to a pin."""
JITTER = 8.0
"""us. Seldom the firmware's timer meets one of its other interrupts (clock, UART), which then runs first."""
SILENCE = 0.3
"""s of the board's own clock: fifteen pulses that did not come."""


class Board:
    """The simulated Uno."""

    def __init__(self, program: Path, firmware: Path) -> None:
        self.pulses: list[tuple[float, float]] = []
        self.clock = 0.0
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
                case ["pulse", start, width]:
                    self.pulses.append((float(start) / 1e6, float(width)))
                case ["clock", now]:
                    self.clock = float(now) / 1e6

    def silent(self) -> bool:
        """Whether no pulse has come for a while of the board's own time."""
        return not self.pulses or self.clock - self.pulses[-1][0] > SILENCE

    def widths(self) -> list[float]:
        """Return the widths so far in us."""
        return [width for _, width in self.pulses]

    def close(self) -> None:
        """Switch it off."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10.0)
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


def check_order(widths: list[float], commands: np.ndarray) -> float:
    """Check that each pulse has the width of a command, and that commands take effect in their order.

    Returns:
        Part of the pulses that were within `TOLERANCE`; the others were within `JITTER`.
    """
    at, close = 0, 0
    for number, width in enumerate(widths):
        errors = np.abs(commands[at : at + 25] - width)
        fits = np.flatnonzero(errors <= TOLERANCE)
        close += bool(fits.size)
        fits = fits if fits.size else np.flatnonzero(errors <= JITTER)
        assert fits.size, f"pulse {number} of {width} us follows none of the commands {commands[at : at + 25].round(1)}"
        at += int(fits[0])
    return close / len(widths)


def test_the_pulses_are_those_commanded_within_two_microseconds(
    driver: StartedProcess, client: RobotClient, board: Board
) -> None:
    del driver
    swim(client, board, 250)
    widths = board.widths()
    client.spin(0.5)  # until what was commanded has arrived here too
    assert all(LOWEST <= width <= HIGHEST for width in widths)
    amplitude = 573.0 * np.radians(15.0)
    assert max(widths) == pytest.approx(1500.0 + amplitude, abs=JITTER)
    assert min(widths) == pytest.approx(1500.0 - amplitude, abs=JITTER)
    commanded = np.array([1500.0 + 573.0 * m.position[0] for m in client.received(topics.JOINT_STATES)])
    close = check_order(widths, commanded)
    print(f"{close:.1%} of {len(widths)} pulses within {TOLERANCE:g} us of their command")  # noqa: T201
    assert close >= 0.95


def test_the_pulses_stop_when_the_gait_stops(driver: StartedProcess, client: RobotClient, board: Board) -> None:
    del driver
    swim(client, board, 100)
    client.publish_gait(None)
    client.wait_until(board.silent, "silence", timeout=30.0)
    check_end(board)
    assert board.widths()[-4:-1] == pytest.approx([1500.0] * 3, abs=JITTER)


def check_end(board: Board) -> None:
    """Check that no pulse was beyond the limits; a reset may cut the very last one short."""
    assert all(LOWEST <= width <= HIGHEST for width in board.widths()[:-1])
    assert board.widths()[-1] <= HIGHEST


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
    driver.signal(number)
    assert driver.wait(10.0) == 128 + number
    wait_until(board.silent, 30.0, "silence")
    check_end(board)
    assert board.widths()[-2] == pytest.approx(1500.0, abs=JITTER)


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
        successor.wait(10.0)
    wait_until(board.silent, 30.0, "silence")


def test_the_simulated_firmware_is_the_one_named(built: tuple[Path, Path]) -> None:
    digest = hashlib.sha256(built[1].read_bytes()).hexdigest()
    assert digest == "6d57ea7cf30e26c9c2f3a01ee37907d2c951f8bc9c27f84dddad12fa9c8b8f36"
