"""How fast a study went, from its journal alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome

if TYPE_CHECKING:
    from pathlib import Path


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
