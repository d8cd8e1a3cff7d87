"""Lateness and CPU of the driver in a rehearsed study.

    . scripts/environment.sh; python tests/support/lateness.py [DEVICE [SECONDS]]

The optimiser and its recorder run beside it, as at the tank; so does the emulated robot, which a real one would not.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor

from fin_plant import node_process, topics

ROOT = Path(__file__).resolve().parents[2]
_TICKS = os.sysconf("SC_CLK_TCK")


def cpu_seconds(pid: int) -> float:
    """Return the processor time of a process in s, user and system."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def driver_pid(parent: int) -> int:
    """Return the process of the servo driver among the children of the bring-up.

    Raises:
        RuntimeError: There is none.
    """
    for child in Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="utf-8").split():
        if "servo_driver" in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8").split("\0")[1]:
            return int(child)
    msg = "no servo_driver among the processes of the study"
    raise RuntimeError(msg)


def measure(device: str, seconds: float, folder: str) -> str:
    """Run a study for so long; return the figures as a row of a table."""
    words = [f"robot_file:={device}", "plant:=rehearsal", "trials:=1000", f"study_folder:={folder}/study"]
    study = subprocess.Popen([ROOT / "run", "fin_optimizer", "bringup", *words], stdout=subprocess.DEVNULL)
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(node_process.FAST_DDS_PROFILE))
    rclpy.init()
    node = rclpy.create_node("lateness")
    rows: list[dict[str, str]] = []

    def keep(message: Any) -> None:
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if "lateness_p99_ms" in values and "following" in values["phase"]:
                rows.append(values)

    node.create_subscription(topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, keep, topics.DIAGNOSTICS.qos)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not rows:
            executor.spin_once(timeout_sec=0.2)
        pid = driver_pid(study.pid)
        begin, used, count = time.monotonic(), cpu_seconds(pid), len(rows)
        while time.monotonic() - begin < seconds:
            executor.spin_once(timeout_sec=0.2)
        load = (cpu_seconds(pid) - used) / (time.monotonic() - begin)
    finally:
        study.send_signal(signal.SIGINT)
        study.wait()
        rclpy.try_shutdown()
    rows = rows[count:]
    p50, p99, worst = (sorted(float(row[f"lateness_{name}_ms"]) for row in rows) for name in ("p50", "p99", "max"))
    missed, sent = (int(rows[-1][name]) - int(rows[0][name]) for name in ("missed_ticks", "set_points_sent"))
    middle = len(rows) // 2
    return (
        f"| {device} | {p50[middle]:.2f} | {p99[middle]:.2f} | {worst[-1]:.2f} | {missed} of {missed + sent} | "
        f"{100.0 * load:.0f} % of a core |"
    )


def main() -> int:
    """Print the table."""
    device = sys.argv[1] if len(sys.argv) > 1 else "firmata"
    if not re.fullmatch("[a-z]+", device):
        print("usage: lateness.py [DEVICE [SECONDS]]", file=sys.stderr)  # noqa: T201
        return 2
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    print("| device | lateness p50, ms | p99, ms | max, ms | missed ticks | CPU of the driver |")  # noqa: T201
    print("|---|---|---|---|---|---|")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        print(measure(device, seconds, folder))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())
