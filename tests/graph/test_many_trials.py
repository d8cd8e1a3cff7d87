"""Thousands of trials in one process: memory and file descriptors stay flat, a late trial costs what the first did."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fin_bringup.benchmarks.trials import trial_loop
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

SWIM = 0.2
"""s; the shortest swim with enough samples for a score."""
# What the ledger keeps of a trial: its record, Optuna's, and the history's.
KILOBYTES_A_TRIAL = 10.0
WARM_UP = 10_000.0
"""kB that Python's heap may still grow by in the first trials, for messages of all sizes."""


def resident(process: StartedProcess) -> float:
    """Return the memory that a process holds in kB."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return float(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")))


def open_files(process: StartedProcess) -> int:
    return len(list(Path(f"/proc/{process.pid}/fd").iterdir()))


def many(start: Start, folder: Path, trials: int, patience: float) -> None:
    """Swim so many trials; look at the optimiser after a third of them and at the end."""
    simulator = start("fin_sim", "simulator", "--ros-args", "-p", "speed:=0.0", "-p", "command_timeout:=5.0")
    parameters = (
        f"study_folder:={folder}",
        f"trials:={trials}",
        f"measurement.duration:={SWIM}",
        "disk.minimum_free:=1.0e6",
    )
    words = [word for parameter in (*parameters, "exit_when_done:=false") for word in ("-p", parameter)]
    optimizer = start("fin_optimizer", "optimizer", "--ros-args", *words)
    optimizer.wait_for_output(f"trial {trials // 3:04d}", patience)
    before = [(resident(each), open_files(each)) for each in (optimizer, simulator)]
    optimizer.wait_for_output(f"trial {trials - 1:04d}", patience)
    after = [(resident(each), open_files(each)) for each in (optimizer, simulator)]
    wait_until(lambda: "results:" in optimizer.output(), 120, "the report")
    swum = read_trials(folder)
    took = (swum[-1].ended - swum[0].started).total_seconds()  # type: ignore[operator]
    growth = [(b[0] - a[0]) / (trials - trials // 3) for a, b in zip(before, after, strict=True)]
    print(  # noqa: T201  (the proof's numbers)
        f"{trials} trials of {SWIM} s with a bag each in {took:.1f} s: {trials / took:.1f} trials a second, "
        f"{trials * SWIM / took:.1f} x real time; growth of optimiser and simulator {growth[0]:.2f} and "
        f"{growth[1]:.2f} kB a trial; files open {before[0][1]} -> {after[0][1]} and {before[1][1]} -> {after[1][1]}"
    )
    assert [trial.outcome for trial in swum] == [Outcome.OK] * trials
    assert len(list(folder.glob("bags/*/metadata.yaml"))) == trials
    allowed = KILOBYTES_A_TRIAL + WARM_UP / (trials - trials // 3)
    assert max(growth) < allowed
    assert all(b[1] <= a[1] + 2 for a, b in zip(before, after, strict=True))


@pytest.mark.long
def test_sixty_trials_leave_memory_and_files_flat(start: Start, tmp_path: Path) -> None:
    many(start, tmp_path / "study", 60, 60.0)


@pytest.mark.long
def test_the_benchmark_times_trials_of_the_whole_graph(ros_domain: int) -> None:
    found = trial_loop(3, 1.0)
    assert (found.trials, found.swum) == (3, 3.0)
    assert found.seconds > 0.0


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_thousands_of_trials_leave_memory_and_files_flat(start: Start, tmp_path: Path) -> None:
    many(start, tmp_path / "study", int(os.environ.get("TRIALS", "2000")), 3000.0)
