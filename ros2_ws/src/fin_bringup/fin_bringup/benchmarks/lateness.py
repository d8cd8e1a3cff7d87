"""How late the servo driver's ticks are, and what they cost, while a study runs beside them: a table.

    ./run fin_bringup lateness [--seconds S] [DEVICE ...]

The study is a rehearsal: the real driver, optimiser and recorder, with an emulated device on a pseudo-terminal. The
emulator and its hidden fish run on the same machine, where a real robot would not. The figures are the driver's own
diagnostics.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor

from fin_bringup.processes import find_executable
from fin_plant import checks, node_process, topics
from fin_plant.command import command

if TYPE_CHECKING:
    from collections.abc import Sequence

DEVICES = ("firmata", "dynamixel")
"""A pulse servo, at 50 Hz, and a bus servo, at 100 Hz, which also reports its position."""
_NAMESPACE = "/lateness"
"""Of its own, so that no gait of this study reaches a robot that is in use."""
_SWIMMING = "following the gait"
_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
_START_SECONDS = 60.0
_LEAST_SECONDS = 3.0
_LEAST_DIAGNOSTICS = 2
"""Of a difference."""
_COLUMNS = ("device", "lateness p50, ms", "p99, ms", "max, ms", "missed ticks", "CPU of the driver", "nice")


@dataclass(frozen=True)
class Lateness:
    """What was measured with one device.

    Attributes:
        device: Its name.
        p50: Median lateness of a tick, ms; of this and the next figure the median over all seconds.
        p99: Lateness that one tick in a hundred exceeds, ms.
        largest: The largest lateness of all, ms.
        missed: Ticks left out.
        sent: Set-points sent.
        load: Of the driver on one core, 0 to 1.
        nice: Its priority, as the system has it.
    """

    device: str
    p50: float
    p99: float
    largest: float
    missed: int
    sent: int
    load: float
    nice: int

    def row(self) -> str:
        """Return it as a row of the table."""
        ticks = f"{self.missed} of {self.missed + self.sent}"
        late = (f"{value:.2f}" for value in (self.p50, self.p99, self.largest))
        return _row((self.device, *late, ticks, f"{100.0 * self.load:.0f} % of a core", str(self.nice)))


def summarise(device: str, seconds: Sequence[dict[str, str]], load: float, nice: int) -> Lateness:
    """Return the figures of the diagnostics of ``seconds``, one dictionary for each second.

    Raises:
        RuntimeError: There are fewer than two.
    """
    if len(seconds) < _LEAST_DIAGNOSTICS:
        msg = f"{device}: {len(seconds)} s of swimming are too few to measure: give more --seconds"
        raise RuntimeError(msg)
    p50, p99, largest = ([float(second[f"lateness_{name}_ms"]) for second in seconds] for name in ("p50", "p99", "max"))
    missed, sent = (int(seconds[-1][name]) - int(seconds[0][name]) for name in ("missed_ticks", "set_points_sent"))
    return Lateness(device, float(np.median(p50)), float(np.median(p99)), max(largest), missed, sent, load, nice)


class _Listener:
    """Keeps the driver's diagnostics of the seconds in which the tail swam."""

    def __init__(self) -> None:
        self.seconds: list[dict[str, str]] = []
        self._node = rclpy.create_node("lateness", namespace=_NAMESPACE)
        diagnostics = topics.DIAGNOSTICS
        self._node.create_subscription(diagnostics.type, diagnostics.name, self._keep, diagnostics.qos)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def close(self) -> None:
        """Stop listening."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _keep(self, message: Any) -> None:
        for status in message.status:
            if status.name == f"{_NAMESPACE}/servo_driver: device":
                values = {item.key: item.value for item in status.values}
                if values["phase"] == _SWIMMING:
                    self.seconds.append(values)

    def listen(self, seconds: float, study: subprocess.Popen[bytes], words: Path) -> None:
        """Listen for so long.

        Raises:
            RuntimeError: The study has ended; the message has the end of what it said.
        """
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.2)
            if study.poll() is not None:
                said = "\n".join(deque(words.read_text(errors="replace").splitlines(), maxlen=20))
                msg = f"the study ended with exit code {study.returncode}:\n{said}"
                raise RuntimeError(msg)


def _statistics(pid: int) -> list[str]:
    """Return the fields of /proc/PID/stat from the third one on, see proc(5)."""
    return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()


def cpu_seconds(pid: int) -> float:
    """Return the processor time of a process in s, user and system."""
    return sum(int(field) for field in _statistics(pid)[11:13]) / _TICKS_A_SECOND


def niceness(pid: int) -> int:
    """Return the priority of a process, from -20, before all others, to 19."""
    return int(_statistics(pid)[16])


def driver_pid(parent: int) -> int:
    """Return the process of the servo driver among the children of the bring-up.

    Raises:
        RuntimeError: There is none.
    """
    for child in Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="utf-8").split():
        if "/servo_driver\0" in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8"):
            return int(child)
    msg = "no servo_driver among the processes of the study"
    raise RuntimeError(msg)


def measure(device: str, seconds: float) -> Lateness:
    """Rehearse a study on a device for so many s of swimming and pauses; rclpy must be initialised.

    Raises:
        FileNotFoundError: The workspace is not built.
        RuntimeError: The study failed, or did not swim.
    """
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder) / "said.txt"
        words = [f"robot_file:={device}", "plant:=rehearsal", "trials:=1000", f"namespace:={_NAMESPACE}"]
        words += [f"study_folder:={folder}/study", "disk.minimum_free:=0"]
        with said.open("wb") as output:
            study = subprocess.Popen(  # noqa: S603
                [*find_executable("fin_bringup", "bringup"), *words], stdout=output, stderr=output
            )
        listener = _Listener()
        try:
            return _measure(device, seconds, study, said, listener)
        finally:
            listener.close()
            study.send_signal(signal.SIGINT)
            study.wait()


def _measure(device: str, seconds: float, study: subprocess.Popen[bytes], said: Path, listener: _Listener) -> Lateness:
    deadline = time.monotonic() + _START_SECONDS
    while not listener.seconds:
        listener.listen(0.2, study, said)
        if time.monotonic() > deadline:
            msg = f"{device}: the tail did not swim within {_START_SECONDS:g} s"
            raise RuntimeError(msg)
    pid = driver_pid(study.pid)
    begin, used, count = time.monotonic(), cpu_seconds(pid), len(listener.seconds)
    listener.listen(seconds, study, said)
    while len(listener.seconds) < count + _LEAST_DIAGNOSTICS and time.monotonic() < begin + _START_SECONDS:
        listener.listen(0.2, study, said)  # on a busy machine a swim begins late
    load = (cpu_seconds(pid) - used) / (time.monotonic() - begin)
    return summarise(device, listener.seconds[count:], load, niceness(pid))


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |\n"


@command("lateness", failures=(RuntimeError, FileNotFoundError), when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a study failed."""
    parser = argparse.ArgumentParser(prog="lateness", description=__doc__.partition(":")[0])
    parser.add_argument("devices", nargs="*", metavar="DEVICE", help=f"(default: {' '.join(DEVICES)})")
    parser.add_argument(
        "--seconds", type=checks.read_number, default=45.0, help="with each device (default: %(default)g)"
    )
    options = parser.parse_args(arguments)
    if not _LEAST_SECONDS <= options.seconds < float("inf"):
        msg = f"--seconds {options.seconds:g} must be at least {_LEAST_SECONDS:g}"
        raise ValueError(msg)
    devices = options.devices or DEVICES
    sys.stdout.write(
        f"./run fin_bringup lateness --seconds {options.seconds:g} {' '.join(devices)}\n\n"
        + _row(_COLUMNS)
        + _row(["---"] * len(_COLUMNS))
    )
    with node_process.starting_ros():
        pass
    try:
        for device in devices:
            sys.stdout.write(measure(device, options.seconds).row())
            sys.stdout.flush()
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
