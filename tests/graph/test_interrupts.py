"""Ctrl-C ends each executable quietly, from its first moment on: exit code 130, no traceback, nothing half written."""

from __future__ import annotations

import os
import pty
import random
import signal
import subprocess
from typing import TYPE_CHECKING

import pytest

from support.processes import INSTALL, ROOT, StartedProcess

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

EXECUTABLES = sorted(
    (path.parent.name, path.name) for path in INSTALL.glob("*/lib/*/*") if path.is_file() and os.access(path, os.X_OK)
)
LONG_VARIATION = ("--vary", "fin.length=0.06:0.10:4000", "--csv", "swims.csv")
STRIP = (
    *("--length", "100 +- 0.5 mm", "--width", "20 +- 0.1 mm", "--thickness", "0.35 +- 0.01 mm"),
    *("--weight", "5 +- 0.1 g", "--deflection", "12 +- 0.5 mm"),
)
# What makes an executable work for some time, or get as far as it can without a device.
SWIMS = str(ROOT / "tests/data/tail_actuated_fish_swims")
FITTED = str(ROOT / "ros2_ws/src/fin_optimizer/config/fitted_tail_actuated_fish.yaml")
ARGUMENTS = {
    "bench": ("--repeats", "50"),
    "bench_search": ("--fish", "100"),
    "bringup": ("trials:=20", "study_folder:=study", "disk.minimum_free:=0"),
    "calibrate": ("--swims", SWIMS, "--starts", "50"),
    "calibrate_servo": (str(ROOT / "ros2_ws/src/fin_servo_driver/config/dynamixel.yaml"),),
    "control": ("pause",),
    "dashboard": ("study",),
    "enrich_bag": ("bags",),
    "export": ("study",),
    "export_fin": ("study",),
    "live": ("--port", "0"),
    "measure_strip": STRIP,
    "optimizer": ("--ros-args", "-p", "study_folder:=study", "-p", "disk.minimum_free:=0"),
    "page": ("--port", "0"),
    "play_bag": ("bag",),
    "recover_study": ("study",),
    "predict": ("--fish", FITTED, "--swims", SWIMS),
    "repair_bags": ("bags",),
    "report": ("study",),
    "score_bag": ("bags",),
    "show_study": ("study",),
    "swim": LONG_VARIATION,
    "validation": ("--data", str(ROOT / "tests/data"), "--docs", "docs"),
}
# Of programs that are done, or have found no file or no device, before the signal comes.
ENDED_BEFORE = {
    "calibrate_servo": 1,
    "dashboard": 2,
    "enrich_bag": 2,
    "export": 2,
    "export_fin": 2,
    "materials": 0,
    "measure_strip": 0,
    "play_bag": 2,
    "recover_study": 2,
    "predict": 0,
    "repair_bags": 2,
    "report": 2,
    "score_bag": 2,
    "show_study": 2,
}
END_SECONDS = 180.0  # code that is being compiled is not interrupted; a program that hangs fails anyway


@pytest.fixture
def terminal() -> Iterator[int]:
    """The program's side of a terminal on which nobody types."""
    person, program = pty.openpty()
    yield program
    os.close(program)
    os.close(person)


def interrupted_after(
    delay: float, package: str, executable: str, folder: Path, terminal: int, said: str | None = None
) -> tuple[int, bool, str]:
    """Return the exit code, whether it came before the signal, and what was said.

    The signal comes so many seconds after the start, or after ``said`` is said.
    """
    log = folder / "said.txt"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [str(ROOT / "run"), package, executable, *ARGUMENTS.get(executable, ())],
            stdin=terminal,
            stdout=output,
            stderr=output,
            cwd=folder,
            start_new_session=True,
            env=os.environ | {"ROS_LOG_DIR": str(folder / "log")},
        )
    started = StartedProcess(executable, process, log)
    before = True
    if said is not None:
        started.wait_for_output(said, END_SECONDS)
    try:
        process.wait(delay)
    except subprocess.TimeoutExpired:
        before = False
    started.signal(signal.SIGINT)
    try:
        process.wait(END_SECONDS)
    finally:
        complaints = started.end()
    assert complaints == []
    return process.returncode, before, log.read_text(errors="replace")


def check(delay: float, package: str, executable: str, folder: Path, terminal: int, after: str | None = None) -> None:
    code, before, said = interrupted_after(delay, package, executable, folder, terminal, after)
    where = f"{executable} after {delay:.2f} s ended with {code} and said:\n{said[-2000:]}"
    assert "Traceback" not in said, where
    assert "Error" not in said, where
    assert "usage:" not in said, f"ARGUMENTS of {executable} are missing: {where}"
    # At its very start, before it can hold the signal back, the shell's own end by SIGINT: 130 to who asks a shell.
    assert (
        code in {130, -signal.SIGINT}
        or (before and code == ENDED_BEFORE.get(executable, 0))
        or (code == ENDED_BEFORE.get(executable))
    ), where


@pytest.mark.parametrize(("package", "executable"), EXECUTABLES)
def test_ctrl_c_while_it_starts_ends_an_executable_quietly(
    package: str, executable: str, ros_domain: int, tmp_path: Path, terminal: int
) -> None:
    # Where in the start the moment falls depends on the machine: any must do.
    check(random.Random(executable).uniform(0.1, 1.0), package, executable, tmp_path, terminal)  # noqa: S311


@pytest.mark.long
@pytest.mark.parametrize("step", range(8))
@pytest.mark.parametrize(("package", "executable"), EXECUTABLES)
def test_ctrl_c_at_any_time_ends_an_executable_quietly(
    package: str, executable: str, step: int, ros_domain: int, tmp_path: Path, terminal: int
) -> None:
    check(0.02 + 0.4 * step, package, executable, tmp_path, terminal)


@pytest.mark.parametrize("delay", [0.0, 0.8, *(pytest.param(delay, marks=pytest.mark.long) for delay in (0.4, 1.2))])
def test_ctrl_c_while_the_workers_of_a_campaign_start_is_answered_by_the_campaign_alone(
    delay: float, tmp_path: Path, terminal: int
) -> None:
    check(delay, "fin_optimizer", "campaign", tmp_path, terminal, after="runs are done already")
