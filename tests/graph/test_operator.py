"""The operator's terminal program on a terminal of its own, before the real driver: keys go in, a screen comes out."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import termios
import threading
import time
from typing import TYPE_CHECKING

import pytest

from fin_plant.gait import PAPER_GAIT
from fin_plant.messages import gait_message
from fin_plant.plant_state import State
from fin_servo_driver.emulator.devices import Firmata
from support.processes import executable_path, workspace_environment
from support.robot_client import RobotClient, plugged_in
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from support.processes import StartedProcess

COLUMNS, ROWS = 40, 24
"""A telephone's width."""
CALM = 1.2
"""s. A step counts after it was on the screen for 1 s; Enter after it was at rest as long."""
_CONTROL = re.compile(rb"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b[()][0-9A-B]|\x1b[=>78]|\r")


class Terminal:
    """A terminal with the program in it. What is on its screen is what was written since it was last cleared."""

    def __init__(self, domain: int) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self._before = termios.tcgetattr(slave)
        self._slave = slave
        self._written = b""
        self.process = subprocess.Popen(
            [executable_path("fin_servo_driver", "operator")],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=workspace_environment() | {"ROS_DOMAIN_ID": str(domain), "TERM": "xterm-256color"},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509 - so that Ctrl-C is one
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self._master, 65536):
                self._written += data

    def screen(self) -> str:
        """Return the newest screen as words with single spaces, without its frame."""
        # The program writes a screen from its upper left corner to the panel's lower right one.
        whole = self._written.replace(b"\x1b[H", b"\f").rpartition("╯".encode())[0].rpartition(b"\f")[2]
        return " ".join(re.sub("[│╭╮─╰╯┃━┏┓┗┛┡┩]", " ", _CONTROL.sub(b"", whole).decode()).split())

    def press(self, keys: str) -> None:
        """Press keys."""
        os.write(self._master, keys.encode())

    def wait_for(self, *texts: str) -> None:
        """Wait until all these stand on the screen."""
        wait_until(
            lambda: all(text in self.screen() for text in texts), 20.0, lambda: f"{texts}; there was:\n{self.screen()}"
        )

    def confirm(self, step: str, keys: str = "\r") -> None:
        """Read a step, and press Enter for it; again where the step was put on the screen anew meanwhile."""
        self.wait_for(step)

        def press() -> None:
            time.sleep(CALM)  # what is tested is that less does not count
            if step in self.screen():
                self.press(keys)

        wait_until(lambda: step not in self.screen(), 20.0, lambda: f"an end of {step}:\n{self.screen()}", press)

    def restored(self) -> bool:
        """Whether the terminal echoes and waits for whole lines again, as before."""
        return bool(termios.tcgetattr(self._slave)[3] == self._before[3])

    def output(self) -> str:
        """Return all that was written."""
        return self._written.decode(errors="replace")

    def close(self) -> None:
        """End the program if it has not ended."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self._slave)
        self._reader.join(60.0)
        os.close(self._master)


@pytest.fixture
def driver(start: Callable[..., StartedProcess], tmp_path: Path) -> Iterator[StartedProcess]:
    """Start the driver with an emulated board; nobody has configured it.

    It goes on where nobody repeats the gait while the screen is looked at.
    """
    with plugged_in(Firmata(), tmp_path) as port:
        given = ("robot_file:=firmata", f"port:={port.path}", "command_timeout:=10.0")
        words = [word for parameter in given for word in ("-p", parameter)]
        yield start("fin_servo_driver", "servo_driver", "--ros-args", *words)


@pytest.fixture
def terminal(driver: StartedProcess, ros_domain: int) -> Iterator[Terminal]:
    del driver
    found = Terminal(ros_domain)
    yield found
    found.close()


@pytest.fixture
def client(ros_domain: int) -> Iterator[RobotClient]:
    with RobotClient(ros_domain) as robot_client:
        yield robot_client


def test_a_person_leads_the_robot_from_its_start_to_a_stopped_swim(terminal: Terminal, client: RobotClient) -> None:
    terminal.confirm("Press Enter to open the port")
    terminal.wait_for("Mount this fin", "material E = 2 GPa", "length 80.0 mm", "thickness 0.208 mm")
    terminal.press("x")
    terminal.wait_for("'x' does nothing; there is [Enter] do it")
    terminal.press("\x1b[3~")  # the key Delete
    terminal.wait_for("this key does nothing")
    terminal.confirm("Mount this fin")
    terminal.confirm("Hands off the tail")
    terminal.wait_for("READY", "SPACE BAR: EMERGENCY STOP", "[q] quit")
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    terminal.wait_for("SWIMMING")
    terminal.press("q")
    terminal.wait_for("q again leaves")
    terminal.press(" ")
    client.wait_for_state(State.FAULT)
    client.publish_gait(None)
    terminal.wait_for("FAULT", "Stopped. When all is safe, press r")
    terminal.press("r")
    terminal.confirm("Bring the fish back to its mark")
    terminal.wait_for("READY")
    terminal.press("d")
    terminal.wait_for("Hands off the tail", "deactivate: done")
    terminal.press("q")
    assert terminal.process.wait(60.0) == 0
    assert terminal.restored()


def test_an_enter_that_bounces_does_not_arm_the_robot(terminal: Terminal, client: RobotClient) -> None:
    terminal.confirm("Press Enter to open the port")
    # A key held down; what lies between its repetitions is tested with the program's clock.
    terminal.confirm("Mount this fin", 20 * "\r")
    terminal.wait_for("Hands off the tail")
    client.spin(CALM)
    state = client.state()
    assert state is not None
    assert state.details["waiting_for"] == "arming"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_without_a_traceback_and_gives_the_terminal_back(
    terminal: Terminal, number: signal.Signals
) -> None:
    terminal.wait_for("Press Enter to open the port")
    if number is signal.SIGINT:
        terminal.press("\x03")
    else:
        terminal.process.send_signal(number)
    assert terminal.process.wait(60.0) == 128 + number
    assert terminal.restored()
    assert "Traceback" not in terminal.output()


def test_a_driver_that_is_gone_is_not_shown_as_it_was(
    terminal: Terminal, driver: StartedProcess, client: RobotClient
) -> None:
    terminal.confirm("Press Enter to open the port")
    terminal.wait_for("Mount this fin")
    del client
    driver.kill()
    terminal.wait_for("NO ANSWER", "use the switch of its servos")
    terminal.press(" ")
    terminal.wait_for("NO ANSWER TO THE EMERGENCY STOP: switch the servos off")
