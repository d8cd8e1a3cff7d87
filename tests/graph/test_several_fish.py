"""Several fish swim for one study: who fails is left out, and its trial is swum by another."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.recorded import achieved, score_bag
from fin_optimizer.study.candidate import candidates, front
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from fin_plant.checks import counted
from fin_plant.messages import gait_message
from fin_plant.plant_state import State
from support.plant_tester import PlantTester
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_optimizer.study.candidate import TrialRecord
    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
FISH = ("/tank_a/fish", "/tank_b/fish")
# Limits that let a gait through at which the softest fins fold (by 881 degrees at 0.03 GPa).
FRAIL = ("limits.sweep:=1.5", "limits.frequency:=20.0", "drive.ramp_time:=0.02")
SOFT_FINS = ("search.young_modulus.minimum:=2e7", "search.young_modulus.maximum:=4e7")
WILD_GAIT = gait_message([[1.5, 20.0, 0.0, 0.0]])


def parameters(*assigned: str) -> list[str]:
    return [word for one in assigned for word in ("-p", one)]


@pytest.mark.long
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
    running: dict[str, TrialRecord] = {}

    def both_swim() -> bool:
        trials = read_trials(folder) if (folder / "journal.log").exists() else []
        running.clear()
        running.update({trial.plant: trial for trial in trials if trial.outcome is Outcome.RUNNING})
        return set(running) == set(FISH) and (folder / running[FISH[1]].bag).exists()

    wait_until(both_swim, 60, "both fish to swim")
    fish[1].kill()
    assert study.wait(60) == 0
    trials = read_trials(folder)
    interrupted = trials[running[FISH[1]].number]
    assert interrupted.outcome in {Outcome.FAILED, Outcome.INTERRUPTED}
    again = [trial for trial in trials if trial.candidate == interrupted.candidate and trial is not interrupted]
    assert [(trial.outcome, trial.plant) for trial in again] == [(Outcome.OK, FISH[0])]
    assert len(candidates(trials)) == 4
    assert all(candidate.score is not None for candidate in candidates(trials))
    assert all(score_bag(folder / trial.bag)[0].value == trial.score for trial in trials if trial.score is not None)
    assert f"trial {interrupted.number:04d}" in study.output()


def test_a_fin_that_failed_on_every_fish_is_tried_again_until_it_is_given_up(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    fish = [
        start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={name}", *parameters("speed:=0.0")) for name in FISH
    ]
    for one in fish:
        one.wait_for_output("kernel ready")
    words = (f"study_folder:={folder}", f"plants:=[{','.join(FISH)}]", "trials:=1", "attempts:=4")
    hasty = ("measurement.duration:=1.0", "measurement.largest_speed:=0.001")  # every swim is too fast to be believed
    study = start("fin_optimizer", "optimizer", "--ros-args", *parameters(*words, *hasty, "failures_in_a_row:=100"))
    assert study.wait(60) == 1
    trials = read_trials(folder)
    failed = [trial for trial in trials if trial.outcome is Outcome.FAILED]
    # On a busy machine with swims among them whose gait came late, which say nothing about the fin.
    assert {trial.outcome for trial in trials} <= {Outcome.FAILED, Outcome.INTERRUPTED}
    assert len(failed) == 4
    assert {trial.plant for trial in failed[:2]} == set(FISH), "it first tries the other one"
    assert "no trial gave a score" in study.output()


def test_a_fish_in_fault_is_left_out_and_takes_part_again_after_its_reset(
    start: Start, tmp_path: Path, ros_domain: int, call: Callable[[str], Any]
) -> None:
    folder = tmp_path / "study"
    words = (f"study_folder:={folder}", f"plants:=[{','.join(FISH)}]", "trials:=1000", "measurement.duration:=1.0")
    for fish in FISH:
        start("fin_sim", "simulator", "--ros-args", "-r", f"__ns:={fish}", *parameters(*FRAIL))
    study = start("fin_optimizer", "optimizer", "--ros-args", *parameters(*words, *SOFT_FINS))
    with PlantTester(ros_domain, namespace=FISH[1]) as somebody_else:
        somebody_else.wait_for_state(State.SWIMMING)
        somebody_else.publish_gait(WILD_GAIT, repeat=True)
        somebody_else.wait_for_state(State.FAULT)
    study.wait_for_output(f"{FISH[1]} does not take part: {FISH[1]}/simulator is in FAULT")

    def again() -> list[TrialRecord]:
        """Return the swims of the fin whose swim was disturbed that come after that one."""
        trials = read_trials(folder)
        for disturbed in trials:
            # Whichever the study learns of first: that the fish swims another gait than its own, or that it folded.
            if (
                disturbed.plant == FISH[1]
                and disturbed.outcome is Outcome.INTERRUPTED
                and ("another gait" in disturbed.reason or "a hinge of the fin bent by" in disturbed.reason)
            ):
                return [one for one in trials if one.number > disturbed.number and one.candidate == disturbed.candidate]
        return []

    wait_until(again, 60, lambda: f"another swim of the fin whose swim was disturbed: {read_trials(folder)}")
    assert {trial.plant for trial in again()} == {FISH[0]}
    assert call(f"{FISH[1]}/simulator/request_reset").success
    study.wait_for_output(f"{FISH[1]} takes part")
    study.signal(signal.SIGINT)
    assert study.wait(30) == 130
    assert all(trial.outcome is not Outcome.RUNNING for trial in read_trials(folder))


def start_bringup(start: Start, folder: Path, *words: str) -> StartedProcess:
    fish = f"plants:=[{','.join(FISH)}]"
    return start("fin_optimizer", "bringup", f"study_folder:={folder}", fish, "timeout.silence:=1.0", *words)


def node(bringup: StartedProcess, *words: str) -> int:
    """Return the process of the node whose command line holds these words."""
    children = Path(f"/proc/{bringup.pid}/task/{bringup.pid}/children").read_text().split()
    lines = {int(child): Path(f"/proc/{child}/cmdline").read_text() for child in children}
    return next(child for child, line in lines.items() if all(word in line for word in words))


def test_of_several_fish_one_that_dies_is_named_and_the_study_goes_on(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    study = start_bringup(start, folder, "trials:=4", "measurement.duration:=1.5")
    wait_until(lambda: len(list(folder.glob("bags/*/*.mcap"))) > 1, 30, "both fish to swim")
    os.kill(node(study, "simulator", FISH[0]), signal.SIGKILL)  # the one that gives the clock
    assert study.wait(60) == 0
    assert (
        f"bringup: error: {FISH[0]}/simulator was killed by SIGKILL before the study did; the last it said:"
        in study.output()
    )
    assert f"the study goes on without {FISH[0]}" in study.output()
    assert all(candidate.score is not None for candidate in candidates(read_trials(folder)))


def test_a_bring_up_whose_fish_are_all_gone_ends(start: Start, tmp_path: Path) -> None:
    study = start_bringup(start, tmp_path / "study", "trials:=1000", "timeout.find:=1000.0")
    study.wait_for_output("trial 0001")
    for fish in FISH:
        os.kill(node(study, "simulator", fish), signal.SIGKILL)
    assert study.wait(30) == 1
    assert all(f"bringup: error: {fish}/simulator was killed by SIGKILL" in study.output() for fish in FISH)


@pytest.mark.long
@pytest.mark.timeout(120)
def test_a_fish_that_lost_one_of_its_nodes_is_stopped_altogether(start: Start, tmp_path: Path) -> None:
    study = start_bringup(start, tmp_path / "study", "plant:=rehearsal", "trials:=1000")
    wait_until(lambda: len(list(tmp_path.glob("study/bags/*/*.mcap"))) > 1, 60, "both fish to swim")
    others = [node(study, FISH[1], name) for name in ("__node:=servo_driver", "__node:=rehearsal")]
    os.kill(node(study, FISH[1], "velocity_estimator"), signal.SIGKILL)
    wait_until(lambda: not any(Path(f"/proc/{other}/exe").exists() for other in others), 20, "the end of the fish")
    study.wait_for_output(f"the study goes on without {FISH[1]}")
    study.signal(signal.SIGINT)
    assert study.wait(30) == 130
    swum = {trial.plant for trial in read_trials(tmp_path / "study") if trial.started is not None}
    assert swum == set(FISH), "each has a port of its own"


def test_two_objectives_are_measured_in_the_simulator_and_again_from_the_bag(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    words = (f"study_folder:={folder}", "objective:=speed_and_cost_of_transport", "trials:=3")
    study = start("fin_optimizer", "bringup", *words, "measurement.duration:=1.0")
    assert study.wait(60) == 0
    trials = read_trials(folder)
    assert [trial.outcome for trial in trials] == [Outcome.OK] * 3
    again = [achieved(read_bag(folder / trial.bag))["energy per metre [J/m]"] for trial in trials]
    assert again == [trial.measured["energy_per_metre"] for trial in trials]
    goals = read_settings(folder).goals
    assert goals.objective == "speed_and_cost_of_transport"
    found = counted(len(front(candidates(trials, goals))), "fin")
    assert f"Pareto front of speed and energy per metre ({found})" in study.output()
    assert (folder / "pareto_front.png").read_bytes().startswith(b"\x89PNG")
