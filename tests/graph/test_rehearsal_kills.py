"""A SIGKILL of the driver, or of the device under it, in the middle of a study on the robot's path."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from support.processes import nodes_of
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.processes import StartedProcess

pytestmark = pytest.mark.graph


@pytest.mark.long
@pytest.mark.timeout(180)
@pytest.mark.parametrize("victim", ["servo_driver", "rehearsal"])
def test_a_kill_on_the_robots_path_stops_everything_and_the_study_goes_on_later(
    start: Callable[..., StartedProcess], tmp_path: Path, victim: str
) -> None:
    folder = tmp_path / "study"
    words = ("plant:=rehearsal", "trials:=2", "measurement.duration:=2.0", f"study_folder:={folder}")
    study = start("fin_optimizer", "bringup", *words)
    study.wait_for_output("trial 0000", 90)
    wait_until(lambda: list(folder.glob("bags/trial_0001_*/*.mcap")), 60, "the second fin's swim")
    nodes = nodes_of(study)
    os.kill(nodes[victim], signal.SIGKILL)
    assert study.wait(60) == 1
    assert f"bringup: error: {victim} was killed by SIGKILL before the study did" in study.output()
    assert not [name for name, node in nodes.items() if Path(f"/proc/{node}").exists()], "something may still move"
    finished, interrupted = read_trials(folder)
    assert finished.outcome is Outcome.OK
    assert interrupted.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}
    assert all(read_bag(folder / trial.bag).complete for trial in (finished, interrupted))
    assert start("fin_optimizer", "bringup", *words).wait(120) == 0
    again = read_trials(folder)
    assert again[:2] == [finished, interrupted]
    assert [(trial.candidate, trial.values, trial.outcome) for trial in again[2:]] == [
        (interrupted.candidate, interrupted.values, Outcome.OK)
    ]
    assert [score_bag(folder / trial.bag)[0].value for trial in again if trial.score] == [
        trial.score for trial in again if trial.score
    ]
