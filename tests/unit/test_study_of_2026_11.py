"""A study as the version of November 2026 wrote it is read, scored and gone on with; see tests/data/README.md."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from fin_bringup import study_nodes
from fin_optimizer.commands import score_bag, show_study
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_plant.fin import Fin, node_table
from fin_plant.node_parameters import decides_swim, descriptor
from support.source_tree import SOURCE

if TYPE_CHECKING:
    from pathlib import Path

WRITTEN = SOURCE.parents[1] / "tests/data/study_2026_11"
SETTINGS = {
    "seed": 7,
    "measurement.duration": 2.0,
    "measurement.settle": 1.0,
    "search.algorithm": "genetic",
    "search.population": 4,
}
# What that version said of it, and went on with.
SCORES = [0.011552786765026728, 0.015052035772768861, 0.013744540543574484]
NEXT = 3540888001.725824


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return shutil.copytree(WRITTEN, tmp_path / "study")


def test_its_trials_are_read(study: Path) -> None:
    trials = read_trials(study)
    assert [trial.score for trial in trials] == SCORES
    assert [trial.bag for trial in trials] == [
        "bags/trial_0000_E3.293GPa",
        "bags/trial_0001_E0.6858GPa",
        "bags/trial_0002_E2.57GPa",
    ]


def test_its_bags_give_its_scores(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert score_bag.main([str(study)]) == 0
    said = capsys.readouterr()
    assert [float(line.split()[0]) for line in said.out.splitlines()] == SCORES
    assert said.err == ""


def test_it_is_gone_on_with(study: Path) -> None:
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**SETTINGS, "study_folder": str(study)}))
    with Study.open(study, plan.settings) as opened:
        assert opened.notes == []
        assert opened.next_candidate(plan.search) == (3, {"fin.young_modulus": NEXT})


def test_another_fin_or_fish_that_is_asked_for_is_not_taken_for_its_own(study: Path) -> None:
    simulator, _ = study_nodes.nodes({"study_folder": str(study), "body.drag_area": "1.2e-3"})
    assert "body.drag_area" not in simulator.parameters  # today's default
    asked = OPTIMIZER_PARAMETERS.checked({**SETTINGS, "study_folder": str(study), "fin.segments": 4})
    with pytest.raises(StudyError, match=r"fin\.segments is 3 there and 4 here"):
        Study.open(study, StudyPlan.from_parameters(asked).settings)


def test_a_new_study_has_the_defaults_of_today(tmp_path: Path) -> None:
    simulator, optimizer = study_nodes.nodes({"study_folder": str(tmp_path / "new")})
    assert "body.drag_area" not in simulator.parameters
    assert not [name for name in optimizer.parameters if name.startswith("fin.")]
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(optimizer.parameters))
    assert plan.fin == Fin()


def test_it_is_shown(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert show_study.main([str(study)]) == 0
    assert "0.6858 GPa" in capsys.readouterr().out


def test_it_is_gone_on_with_by_its_folder_alone_whatever_the_defaults_of_today(study: Path) -> None:
    arguments = {**{name: str(value) for name, value in SETTINGS.items()}, "study_folder": str(study)}
    simulator, optimizer = study_nodes.nodes(arguments)
    entries = node_table("fin_sim", "simulator")
    told = entries.checked({**simulator.parameters, "publish_clock": False})
    deciding = {name for name, entry in entries.items() if decides_swim(name, descriptor(entry).description)}
    fish = {"plant": "simulator", **{name: value for name, value in told.items() if name in deciding}}
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(optimizer.parameters))
    assert (plan.fin.segments, plan.fin.hinges, fish["body.drag_area"]) == (3, "between", 3.65e-3)
    with Study.open(study, plan.settings) as opened:
        assert opened.keep_or_compare(fish) == []
        assert opened.keep_or_compare({**fish, "drive.ramp_time": 0.6}) == ["drive.ramp_time is 0.5 there and 0.6 here"]
