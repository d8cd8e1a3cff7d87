"""Several fish swim for one study: who fails is left out, and its trial is swum by another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from fin_optimizer.bag import read_bag
from fin_optimizer.score_bag import cost_of_transport, score_bag
from fin_optimizer.study import Objective, candidates, front, read_settings, read_trials
from fin_optimizer.trial import Outcome
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
FISH = ("/tank_a/fish", "/tank_b/fish")


def test_a_fish_that_is_killed_is_left_out_and_its_fin_is_swum_by_the_other(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    fish = [start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={name}") for name in FISH]
    parameters = (
        f"study_folder:={folder}",
        f"plants:=[{','.join(FISH)}]",
        "trials:=4",
        "measurement.duration:=1.5",
        "timeout.silence:=1.0",
    )
    words = [word for parameter in parameters for word in ("-p", parameter)]
    study = start("fin_optimizer", "optimizer", "--ros-args", *words)
    wait_until(lambda: list(folder.glob("bags/*1_E*/*.mcap")), 30, "both fish to swim")
    running = {trial.plant: trial for trial in read_trials(folder) if trial.outcome is Outcome.RUNNING}
    assert set(running) == set(FISH)
    fish[1].kill()
    assert study.wait(60) == 0
    trials = read_trials(folder)
    interrupted = trials[running[FISH[1]].number]
    assert interrupted.outcome is Outcome.FAILED
    again = [trial for trial in trials if trial.candidate == interrupted.candidate and trial is not interrupted]
    assert [(trial.outcome, trial.plant) for trial in again] == [(Outcome.OK, FISH[0])]
    assert len(candidates(trials)) == 4
    assert all(candidate.score is not None for candidate in candidates(trials))
    assert all(score_bag(folder / trial.bag)[0].value == trial.score for trial in trials if trial.score is not None)
    assert f"trial {interrupted.number:04d}" in study.output()


def test_two_objectives_are_measured_in_the_simulator_and_again_from_the_bag(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    words = (f"study_folder:={folder}", "objective:=speed_and_cost_of_transport", "trials:=3")
    study = start("fin_optimizer", "bringup", *words, "measurement.duration:=1.0")
    assert study.wait(60) == 0
    trials = read_trials(folder)
    assert [trial.outcome for trial in trials] == [Outcome.OK] * 3
    assert [cost_of_transport(read_bag(folder / trial.bag)) for trial in trials] == [trial.cost for trial in trials]
    assert read_settings(folder).objective is Objective.SPEED_AND_COST
    assert f"Pareto front of speed and cost of transport ({len(front(candidates(trials)))} fins)" in study.output()
    assert (folder / "pareto_front.png").read_bytes().startswith(b"\x89PNG")
