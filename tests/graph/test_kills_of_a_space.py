"""A study over sheets, length and frequency with the Gaussian process, killed twice, beside an undisturbed one."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

import pytest

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.study.candidate import candidates
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from support.processes import nodes_of
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fin_optimizer.search.space import Values
    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph

SPACE = """
search:
  fin.length: {minimum: 60 mm, maximum: 110 mm, step: 5 mm}
  gait.frequency: {minimum: 0.7 Hz, maximum: 1.3 Hz}
stock:
  PP_0.5: {material: PP, thickness: 0.5 mm}
  PET_0.35: {material: PET, thickness: 0.35 mm}
  offcut: {young_modulus: 2.263 GPa, density: 1190 kg/m^3, thickness: 0.3 mm}
"""
GP: dict[str, Any] = {"search.algorithm": "gp", "constraints": ["mean_speed <= 20 cm/s"], "measurement.duration": 1.5}
"""Of its eight first candidates no score decides; those after them follow from all that was measured."""
FIRST = 8


def words_of(space: Path, folder: Path, trials: int, plant: str) -> tuple[str, ...]:
    given = [f"{name}:={value if isinstance(value, str | float) else f'[{value[0]}]'}" for name, value in GP.items()]
    return (f"plant:={plant}", f"space:={space}", f"study_folder:={folder}", f"trials:={trials}", *given)


def killed_twice(start: Start, words: tuple[str, ...], folder: Path, trials: int, patience: float) -> None:
    """Swim a study, whose optimiser is killed in the first candidates and in one that follows from scores."""
    for number in (2, FIRST + 1):
        study = start("fin_optimizer", "bringup", *words)
        wait_until(lambda n=number: list(folder.glob(f"bags/trial_{n:04d}_*/*.mcap")), patience, f"trial {number}")  # type: ignore[misc]
        os.kill(nodes_of(study)["optimizer"], signal.SIGKILL)
        assert study.wait(60) == 1
    study = start("fin_optimizer", "bringup", *words)
    assert study.wait(patience) == 0, study.tail()
    swum = read_trials(folder)
    assert [trial.outcome for trial in swum].count(Outcome.OK) == trials
    assert any(trial.outcome is Outcome.INTERRUPTED for trial in swum), "nothing was killed"


def computed_again(space: Path, folder: Path) -> list[Values]:
    """Return the candidates of a study that nobody disturbed and that measured the same."""
    with Study.open(folder) as study:
        history = study.history
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**GP, "space": str(space)}))
    assert read_settings(folder).space == plan.search.space
    return [plan.search.propose(history[:number]) for number in range(len(history))]


def check_candidates_after_kills(start: Start, tmp_path: Path, trials: int, plant: str, seconds: float) -> list[Values]:
    """Kill a study twice, see that its candidates are those of an undisturbed one, and return them."""
    space, folder = tmp_path / "space.yaml", tmp_path / "study"
    space.write_text(SPACE)
    killed_twice(start, words_of(space, folder, trials, plant), folder, trials, seconds)
    swum = [candidate.values for candidate in candidates(read_trials(folder))]
    assert swum == computed_again(space, folder)
    return swum


@pytest.mark.long
@pytest.mark.timeout(400)
def test_a_simulated_study_that_is_killed_twice_has_the_candidates_of_an_undisturbed_one(
    start: Start, tmp_path: Path
) -> None:
    check_candidates_after_kills(start, tmp_path, FIRST + 3, "sim", 150.0)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_it_has_those_of_one_that_was_really_swum_without_a_kill(start: Start, tmp_path: Path) -> None:
    space, trials = tmp_path / "space.yaml", FIRST + 6
    space.write_text(SPACE)
    killed_twice(start, words_of(space, tmp_path / "killed", trials, "sim"), tmp_path / "killed", trials, 150.0)
    whole = start("fin_optimizer", "bringup", *words_of(space, tmp_path / "whole", trials, "sim"))
    assert whole.wait(120) == 0, whole.tail()
    swum, undisturbed = ([c.values for c in candidates(read_trials(tmp_path / n))] for n in ("killed", "whole"))
    assert swum == undisturbed


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_rehearsed_study_that_is_killed_twice_has_the_candidates_of_an_undisturbed_one(
    start: Start, tmp_path: Path
) -> None:
    """Rehearsed swims scatter as a robot's do, so an undisturbed study is one that measured the same."""
    swum = check_candidates_after_kills(start, tmp_path, FIRST + 4, "rehearsal", 400.0)
    assert len({value["stock"] for value in swum}) == 3
