"""SIGKILL at random moments: what was finished stays, what was under way loses its last second, the search goes on."""

from __future__ import annotations

import random
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.bags.integrity import MAGIC_SIZE
from fin_optimizer.bags.own import is_closed
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.study.candidate import candidates
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from support.shared_memory import remove_stale_segments
from support.waiting import wait_until
from support.witness import Witness

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fin_optimizer.study.candidate import TrialRecord
    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

SECOND = 1_000_000_000
REAL_TIME, FASTEST = 1.0, 0.0
# A plant that is killed says nothing about a fin, and here it is killed often.
PATIENT = ("attempts:=1000", "failures_in_a_row:=1000", "timeout.silence:=1.0", "measurement.duration:=1.5")
STUDY = ("trials:=1000", *PATIENT)


@dataclass
class Losses:
    """What the kills took."""

    kills: Counter[str] = field(default_factory=Counter)
    cut_bags: int = 0
    seconds: list[float] = field(default_factory=list)
    trials_lost: int = 0
    scores_changed: int = 0

    def __str__(self) -> str:
        """Return a line for the log."""
        worst = f"{max(self.seconds):.2f} s at most" if self.seconds else "nothing"
        killed = ", ".join(f"{count} {who}" for who, count in sorted(self.kills.items()))
        return (
            f"kills: {self.kills.total()} ({killed}); finished trials lost: {self.trials_lost}; scores changed: "
            f"{self.scores_changed}; bags cut short: {self.cut_bags}, of which was lost: {worst}"
        )


class Laboratory:
    """A plant and an optimiser, one of which is killed again and again."""

    def __init__(self, start: Start, folder: Path, witness: Witness, speed: float, seed: int) -> None:
        self.folder = folder
        self._speed = speed
        self.losses = Losses()
        self._start = start
        self._witness = witness
        self._random = random.Random(seed)  # noqa: S311
        self._plant = self._start_plant()
        self._optimizer = self._start_optimizer()
        self._known: list[TrialRecord] = []
        self._cut: set[Path] = set()

    def _start_plant(self) -> StartedProcess:
        self._plant_since = time.time_ns()
        return self._start("fin_sim", "simulator", "--ros-args", "-p", f"speed:={self._speed}")

    def _start_optimizer(self) -> StartedProcess:
        words = [word for parameter in (f"study_folder:={self.folder}", *STUDY) for word in ("-p", parameter)]
        return self._start("fin_optimizer", "optimizer", "--ros-args", *words)

    def kill_at_random(self) -> None:
        """Let them work for a random time, kill one, look at what is left, and start it again."""
        time.sleep(self._random.uniform(0.0, 4.0))
        assert self._optimizer.running, self._optimizer.tail()
        victim = self._random.choice(("optimiser", "optimiser", "simulator"))
        self.losses.kills[victim] += 1
        if victim == "simulator":
            self._plant.kill()
            self._plant = self._start_plant()
        else:
            self._optimizer.kill()
            self._look_at_what_is_left(self._witness.newest)
            self._optimizer = self._start_optimizer()
        remove_stale_segments()

    def _look_at_what_is_left(self, newest: int) -> None:
        """Measure what the cut bag lacks, and compare the journal with what it said before."""
        for bag in self.folder.glob("bags/*"):
            if bag in self._cut or not list(bag.glob("*.mcap")) or is_closed(bag):
                continue
            self._cut.add(bag)  # the next one may be killed before it has repaired this bag
            self.losses.cut_bags += 1
            if next(bag.glob("*.mcap")).stat().st_size <= MAGIC_SIZE:
                continue
            last = last_stamp(bag)
            # Faster than real time, the fish's last second is not the clock's; and a swim whose plant was killed has
            # ended before.
            if self._speed == REAL_TIME and last > self._plant_since:
                self.losses.seconds.append((newest - last) / SECOND)
        if (self.folder / "journal.log").exists():
            self.compare(read_trials(self.folder))

    def compare(self, now: list[TrialRecord]) -> None:
        """Count the finished trials that are gone or have another score than before."""
        finished = {trial.number: trial for trial in now if trial.outcome not in {Outcome.PROPOSED, Outcome.RUNNING}}
        for before in self._known:
            self.losses.trials_lost += before.number not in finished
            self.losses.scores_changed += finished.get(before.number, before) != before
        self._known = list(finished.values())

    def finish(self, more: int = 2) -> list[TrialRecord]:
        """Leave them alone for some trials, stop the study, and return what its journal says."""

        def scored() -> int:
            return sum(trial.outcome is Outcome.OK for trial in read_trials(self.folder))

        wait_until((self.folder / "journal.log").exists, 30, "a journal")
        goal = scored() + more
        wait_until(lambda: scored() >= goal, 60, lambda: f"{more} more trials; {self._optimizer.tail()}")
        self._optimizer.interrupt()
        self._plant.interrupt()
        trials = read_trials(self.folder)
        self.compare(trials)
        return trials


def last_stamp(path: Path) -> int:
    """Return how far a cut bag goes, in ns; one without any message goes to its own beginning."""
    bag = read_bag(path)
    if bag.topics and (stamps := bag.velocity()[0]).size:
        return int(stamps[-1])
    return bag.path.stat().st_mtime_ns


def torture(start: Start, tmp_path: Path, domain: int, kills: int, speed: float) -> Losses:
    """Kill so often; return what it took, after all has been checked that no busy machine can change."""
    with Witness(domain) as witness:
        laboratory = Laboratory(start, tmp_path / "study", witness, speed, seed=kills)
        for _ in range(kills):
            laboratory.kill_at_random()
        trials = laboratory.finish()
    losses = laboratory.losses
    scored = [trial for trial in trials if trial.outcome is Outcome.OK]
    rescored = [score_bag(laboratory.folder / trial.bag)[0].value for trial in scored]
    tried = [candidate.values for candidate in candidates(trials) if candidate.score is not None]
    print(losses)  # noqa: T201  (the proof's numbers)
    print(f"{len(trials)} trials, {len(scored)} of them OK; each scored again from its bag")  # noqa: T201
    assert (losses.trials_lost, losses.scores_changed) == (0, 0)
    assert rescored == [trial.score for trial in scored]
    assert all(is_closed(bag) for bag in laboratory.folder.glob("bags/*") if list(bag.glob("*.mcap")))
    assert {trial.outcome for trial in trials} <= {Outcome.OK, Outcome.FAILED, Outcome.INTERRUPTED}
    assert tried == uninterrupted(start, tmp_path / "uninterrupted", len(tried))
    print(f"candidates equal to those of a study without any kill: {len(tried)} of {len(tried)}")  # noqa: T201
    return losses


def uninterrupted(start: Start, folder: Path, trials: int) -> list[dict[str, float]]:
    """Return the candidates of a study that nobody kills."""
    study = start("fin_optimizer", "bringup", f"study_folder:={folder}", f"trials:={trials}", *PATIENT)
    assert study.wait(60 + 5 * trials) == 0, study.tail()
    return [candidate.values for candidate in candidates(read_trials(folder))]


def test_a_study_survives_kills_at_random_moments(start: Start, tmp_path: Path, ros_domain: int) -> None:
    torture(start, tmp_path, ros_domain, 4, REAL_TIME)


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("speed", [REAL_TIME, FASTEST])
def test_a_study_survives_a_hundred_kills_at_random_moments(
    start: Start, tmp_path: Path, ros_domain: int, speed: float
) -> None:
    losses = torture(start, tmp_path, ros_domain, 100, speed)
    assert max(losses.seconds, default=0.0) <= 1.0
