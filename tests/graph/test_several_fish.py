"""Several fish swim for one study: who fails is left out, and its trial is swum by another."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, Any

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
# A body without weight to speak of in much too thick a liquid, and limits that let a wild gait through: no step is
# short enough for it.
HOPELESS = (
    "speed:=0.0",
    "step:=0.01",
    "limits.sweep:=1.5",
    "limits.frequency:=20.0",
    "drive.ramp_time:=0.02",
    "body.mass:=0.001",
    "body.inertia:=1.0e-7",
    "body.drag_area:=1.0",
    "body.lift_area:=10.0",
)


def parameters(*assigned: str) -> list[str]:
    return [word for one in assigned for word in ("-p", one)]


def test_a_fish_that_is_killed_is_left_out_and_its_fin_is_swum_by_the_other(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    fish = [start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={name}") for name in FISH]
    words = parameters(
        f"study_folder:={folder}",
        f"plants:=[{','.join(FISH)}]",
        "trials:=4",
        "measurement.duration:=1.5",
        "timeout.silence:=1.0",
    )
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


def test_a_fin_that_failed_on_every_fish_is_tried_again_until_it_is_given_up(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    short = parameters("command_timeout:=0.1")  # the gait comes four times a second: each swim ends early
    fish = [start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={name}", *short) for name in FISH]
    for one in fish:
        one.wait_for_output("kernel ready")
    words = (f"study_folder:={folder}", f"plants:=[{','.join(FISH)}]", "trials:=1", "attempts:=4")
    study = start("fin_optimizer", "optimizer", "--ros-args", *parameters(*words, "failures_in_a_row:=100"))
    assert study.wait(60) == 1
    trials = read_trials(folder)
    assert [trial.outcome for trial in trials] == [Outcome.FAILED] * 4
    assert {trial.plant for trial in trials[:2]} == set(FISH), "it first tries the other one"
    assert "no trial gave a score" in study.output()


def test_a_fish_in_fault_is_left_out_and_takes_part_again_after_its_reset(
    start: Start, tmp_path: Path, call: Callable[[str], Any]
) -> None:
    folder = tmp_path / "study"
    words = (f"study_folder:={folder}", f"plants:=[{','.join(FISH)}]", "trials:=1000", "measurement.duration:=1.0")
    gait = ("gait.amplitude:=1.5", "gait.frequency:=20.0")
    start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={FISH[0]}", "-p", "speed:=4.0")
    # The other one's limits tame the gait.
    start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={FISH[1]}", *parameters(*HOPELESS))
    study = start("fin_optimizer", "optimizer", "--ros-args", *parameters(*words, *gait))
    study.wait_for_output(f"{FISH[1]} does not take part: {FISH[1]}/simulator is in FAULT")
    study.wait_for_output("trial 0004")
    trials = read_trials(folder)
    first = next(trial for trial in trials if trial.plant == FISH[1])
    assert first.outcome is Outcome.FAILED
    assert "stopped being finite" in first.reason
    again = [trial for trial in trials if trial.candidate == first.candidate and trial is not first]
    assert [trial.plant for trial in again] == [FISH[0]]
    assert call(f"{FISH[1]}/simulator/reset").success
    study.wait_for_output(f"{FISH[1]} takes part")
    study.signal(signal.SIGINT)
    assert study.wait(30) == 130
    assert all(trial.outcome is not Outcome.RUNNING for trial in read_trials(folder))


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
