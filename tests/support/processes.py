"""Executables of the workspace as processes of a test: started as `./run` starts them, and surely ended."""

from __future__ import annotations

import os
import signal
import subprocess
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).resolve().parents[2]
INSTALL = ROOT / "ros2_ws" / "install"
# A node has this long to stop after a signal. Generous: the machine may be busy, and a node that hangs fails anyway.
STOP_SECONDS = 60.0
_TAIL_LINES = 60


@cache
def workspace_environment() -> dict[str, str]:
    """Return the environment in which ./run starts an executable, without this process' ROS_DOMAIN_ID."""
    script = '. "$1" && exec env --null'
    result = subprocess.run(
        ["bash", "-euc", script, "bash", str(ROOT / "scripts" / "environment.sh")],
        check=True,
        stdout=subprocess.PIPE,
    )
    lines = (line.partition("=") for line in result.stdout.decode().split("\0") if line)
    return {name: value for name, _, value in lines if name != "ROS_DOMAIN_ID"}


@dataclass
class StartedProcess:
    """A process in a session of its own, its output in a file."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    forgiven: bool = field(default=False)

    @property
    def pid(self) -> int:
        """Process id, which is its group's id too."""
        return self.process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def output(self) -> str:
        """Return what it has written so far, to either stream."""
        return self.log.read_text(errors="replace")

    def wait(self, timeout: float = 60.0) -> int:
        """Wait for its end; return its exit code, negative for a signal.

        Raises:
            AssertionError: It did not end in time.
        """
        wait_until(lambda: not self.running, timeout, lambda: f"the end of {self.name}; it said:\n{self.tail()}")
        return self.process.returncode

    def wait_for_output(self, text: str, timeout: float = 30.0) -> None:
        """Wait until it has written this text.

        Raises:
            AssertionError: It ended or the time passed without it.
        """
        wait_until(
            lambda: text in self.output() or not self.running,
            timeout,
            lambda: f"'{text}' from {self.name}; it said:\n{self.tail()}",
        )
        if text not in self.output():
            message = f"{self.name} ended with {self.process.returncode} without '{text}'; it said:\n{self.tail()}"
            raise AssertionError(message)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the whole group, as a terminal does."""
        if self.group_alive():
            os.killpg(self.pid, number)

    def interrupt(self, timeout: float = STOP_SECONDS) -> int:
        """Press Ctrl-C and wait for the end; return the exit code."""
        self.signal(signal.SIGINT)
        return self.wait(timeout)

    def kill(self) -> None:
        """Kill the whole group without warning, as a power cut would; the end of the test does not complain."""
        self.forgiven = True
        self.signal(signal.SIGKILL)
        self.process.wait()

    def group_alive(self) -> bool:
        """Whether any process of the group is left, a zombie aside."""
        self.process.poll()
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                # The command, in brackets, may hold spaces; after it: state, parent, group.
                state, _, group = stat.read_text().rpartition(")")[2].split()[:3]
            except OSError:
                continue
            if int(group) == self.pid and state != "Z":
                return True
        return False

    def tail(self) -> str:
        """Return the last lines of its output."""
        return "\n".join(self.output().splitlines()[-_TAIL_LINES:])

    def end(self) -> list[str]:
        """End whatever is left of it; return complaints: a hang, or children it left behind."""
        complaints = []
        if self.running:
            self.signal(signal.SIGINT)
            try:
                self.process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                complaints.append(f"{self.name} did not stop within {STOP_SECONDS} s of SIGINT and was killed")
        left = f"{self.name} ended but left processes of its group behind; they were killed"
        try:
            if not complaints:  # a process that ends because its parent has may do so a moment later
                wait_until(lambda: not self.group_alive(), STOP_SECONDS, left)
        except AssertionError:
            complaints.append(left)
        if self.group_alive():
            self.signal(signal.SIGKILL)
        self.process.wait()
        return [] if self.forgiven else complaints


def executable_path(package: str, executable: str) -> Path:
    """Return the path that `ros2 run PACKAGE EXECUTABLE` would start.

    Raises:
        FileNotFoundError: It is not installed.
    """
    path = INSTALL / package / "lib" / package / executable
    if not path.is_file():
        message = f"{path} is not installed: run 'make setup'"
        raise FileNotFoundError(message)
    return path


def start_executable(
    package: str,
    executable: str,
    *arguments: str,
    log: Path,
    environment: Mapping[str, str],
    folder: Path,
) -> StartedProcess:
    """Start an installed executable in a session of its own, with no standard input, in this folder."""
    command = [str(executable_path(package, executable)), *arguments]
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=dict(environment),
            start_new_session=True,
        )
    return StartedProcess(f"{package} {executable}", process, log)


def nodes_of(bringup: StartedProcess) -> dict[str, int]:
    """Return the processes of a bring-up by their nodes' names."""
    children = Path(f"/proc/{bringup.pid}/task/{bringup.pid}/children").read_text().split()
    lines = {int(child): Path(f"/proc/{child}/cmdline").read_text().split("\0") for child in children}
    names = {next(w for w in words if w.startswith("__node:=")): child for child, words in lines.items()}
    return {name.removeprefix("__node:="): child for name, child in names.items()}
