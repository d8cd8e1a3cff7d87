"""Trials of the whole graph: how fast a study goes, and how fast it went, from its journal alone."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from fin_bringup.processes import find_executable
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome

if TYPE_CHECKING:
    from fin_bringup.benchmarks.measuring import Sizes

DURATIONS = (10.0, 0.5)
"""Swims in s of the paper, and short ones, which show what a trial costs besides its swim."""
_NAMESPACE = "namespace:=/bench/fish"


@dataclass(frozen=True)
class Throughput:
    """What a study's OK trials took, with a bag each.

    Attributes:
        trials: Number of them.
        seconds: From the first one's start to the last one's end, in s of the wall clock.
        swum: Time that their swims lasted for the fish, in s.
    """

    trials: int
    seconds: float
    swum: float

    @property
    def trials_a_second(self) -> float:
        """Trials in a second of the wall clock."""
        return self.trials / self.seconds

    @property
    def real_time_factor(self) -> float:
        """Seconds of swimming in a second of the wall clock."""
        return self.swum / self.seconds


def throughput(folder: Path) -> Throughput:
    """Return how fast the study in a folder went; nothing is changed.

    Raises:
        StudyError: There is no study, or no trial of it was OK.
    """
    details = read_settings(folder).details
    one = cast("float", details["measurement.settle"]) + cast("float", details["measurement.duration"])
    times = [(t.started, t.ended) for t in read_trials(folder) if t.outcome is Outcome.OK]
    starts, ends = [a for a, _ in times if a is not None], [b for _, b in times if b is not None]
    if not starts or not ends:
        msg = f"no trial of {folder} was OK: it tells no throughput"
        raise StudyError(msg)
    return Throughput(len(times), (max(ends) - min(starts)).total_seconds(), one * len(times))


def trial_loop(trials: int, duration: float) -> Throughput:
    """Return how fast the whole graph does trials in the simulator: three processes, a bag and the journal for each.

    Args:
        trials: Number of them.
        duration: Of a swim, in s.

    Raises:
        RuntimeError: The study failed; the message has the end of what it said.
    """
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study"
        words = (f"study_folder:={study}", f"trials:={trials}", f"measurement.duration:={duration}", _NAMESPACE)
        command = [*find_executable("fin_bringup", "bringup"), *words, "disk.minimum_free:=0"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            msg = f"the study ended with exit code {done.returncode}:\n{done.stdout[-1000:]}{done.stderr[-1000:]}"
            raise RuntimeError(msg)
        return throughput(study)


def trial_loops(sizes: Sizes) -> list[dict[str, float]]:
    """Return trials a second and the factor of real time for long and short swims."""
    rows = []
    for duration in DURATIONS:
        found = trial_loop(sizes.trials, duration)
        figures = {"trials_a_second": found.trials_a_second, "real_time_factor": found.real_time_factor}
        rows.append({"duration_s": duration, "trials": float(found.trials), **figures})
    return rows
