"""A study with goals and constraints by name: its settings, its journal, what is best, and what people are shown."""

from __future__ import annotations

import csv
import json
from typing import TYPE_CHECKING

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from fin_optimizer.commands import export, show_study
from fin_optimizer.goals import Goals
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study import final_report
from fin_optimizer.study.candidate import front
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome, Result

if TYPE_CHECKING:
    from pathlib import Path

MODULUS = "fin.young_modulus"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
GOALS = Goals.of(["efficiency", "turning_radius"], ["mean_speed >= 2 cm/s", "power <= 0.5 W"])
SWIMS = [  # speed, efficiency, turning radius, power
    (0.030, 0.10, 0.4, 0.30),
    (0.010, 0.60, 0.3, 0.30),  # too slow
    (0.025, 0.20, 0.6, 0.45),
    (0.022, 0.15, 0.7, 0.50),  # behind the third
    (0.040, 0.50, 0.2, 0.90),  # takes too much
]
NAMES = ("mean_speed", "efficiency", "turning_radius", "power")


def result(numbers: tuple[float, ...]) -> Result:
    return Result(Outcome.OK, measured=dict(zip(NAMES, numbers, strict=True)), samples=100)


@pytest.fixture
def swum(tmp_path: Path) -> Path:
    with Study.create(tmp_path / "study", Settings(SPACE, details={"seed": 1}, goals=GOALS)) as study:
        for number, numbers in enumerate(SWIMS):
            study.start(study.propose(number, {MODULUS: 1e9 + 1e8 * number}).number)
            study.finish(number, result(numbers))
    return tmp_path / "study"


def test_settings_are_read_as_they_were_written_and_those_of_before_are_written_as_before() -> None:
    settings = Settings(SPACE, details={"seed": 1}, goals=GOALS)
    text = settings.to_json()
    assert Settings.from_json(text) == settings
    assert json.loads(text)["format"] == 3
    for objective in ("speed", "speed_and_cost_of_transport"):
        short = Settings(SPACE, details={"seed": 1}, goals=Goals.of_objective(objective))
        content = json.loads(short.to_json())
        assert (content["format"], content["objective"], "constraints" in content) == (1, objective, False)
        assert Settings.from_json(short.to_json()) == short
    long = Settings(SPACE, details={"seed": 1}, goals=Goals.of_objective("mean_speed, energy_per_metre"))
    assert long.flat()["objective"] == "speed_and_cost_of_transport"
    assert short.differences(settings) == [
        "objective is speed_and_cost_of_transport there and efficiency, turning_radius here",
        "constraints is not set there and mean_speed >= 2 cm/s; power <= 0.5 W here",
    ]


def test_settings_about_something_unknown_are_of_another_version() -> None:
    text = Settings(SPACE, goals=GOALS).to_json().replace("efficiency", "beauty")
    with pytest.raises(StudyError):
        Settings.from_json(text)


def test_the_journal_has_goals_as_optunas_values_and_constraints_as_optunas_constraints(swum: Path) -> None:
    storage = JournalStorage(JournalFileBackend(str(swum / "journal.log")))
    study = optuna.load_study(study_name="study", storage=storage)
    assert [direction.name for direction in study.directions] == ["MAXIMIZE", "MINIMIZE"]
    assert study.metric_names == ["efficiency", "turning radius (m)"]
    assert study.trials[1].values == [0.60, 0.3]
    assert study.trials[1].constraints == pytest.approx({"mean_speed >= 2 cm/s": 0.5, "power <= 0.5 W": -0.4})
    assert {trial.number for trial in study.best_trials} == {0, 2}, "Optuna's front is of those that meet them all"


def test_a_study_that_is_opened_again_has_what_was_measured_and_the_same_best(swum: Path) -> None:
    assert [tuple(trial.measured[name] for name in NAMES) for trial in read_trials(swum)] == SWIMS
    with Study.open(swum) as study:
        best = study.best()
        assert best is not None
        assert best.number == 2, "the most efficient of those that meet the constraints"
        assert [each.number for each in front(study.candidates)] == [2, 0]
        assert [entry.violation > 0.0 for entry in study.history] == [False, True, False, False, True]
        assert final_report.findings(study)[:3] == [
            "best of 5 trials: E 1.2 GPa swims 2.500 cm/s, efficiency 20.00 %, turning radius 60.00 cm, power 450.0 mW",
            "Pareto front of efficiency and turning radius (2 fins):",
            "  E 1.2 GPa: 20.00 %, 60.00 cm",
        ]
        following = study.next_candidate(HillClimber(SPACE, 3, {MODULUS: 1e5}))
        assert following is not None
        assert min(abs(following[1][MODULUS] - modulus) for modulus in (1.0e9, 1.2e9)) < 1e6, "from a fin of the front"


def test_while_none_meets_the_constraints_the_one_that_misses_least_is_best_and_it_is_said(tmp_path: Path) -> None:
    with Study.create(tmp_path / "study", Settings(SPACE, details={"seed": 1}, goals=GOALS)) as study:
        for number, numbers in enumerate((SWIMS[4], SWIMS[1])):
            study.start(study.propose(number, {MODULUS: 1e9}).number)
            study.finish(number, result(numbers))
        best = study.best()
        assert best is not None
        assert best.number == 1
        assert final_report.findings(study)[1] == (
            "no fin meets all constraints; of the best, mean_speed >= 2 cm/s is missed: 1.000 cm/s"
        )


def test_a_trial_without_what_a_constraint_asks_for_is_refused(tmp_path: Path) -> None:
    with Study.create(tmp_path / "study", Settings(SPACE, details={"seed": 1}, goals=GOALS)) as study:
        study.start(study.propose(0, {MODULUS: 1e9}).number)
        with pytest.raises(StudyError, match="trial 0000 has no turning radius and no power, which this study is"):
            study.finish(0, Result(Outcome.OK, measured={"mean_speed": 0.02, "efficiency": 0.1}))


def test_a_table_shows_what_is_asked_for_and_what_is_missed(swum: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert show_study.main([str(swum)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == ("efficiency, turning_radius; mean_speed >= 2 cm/s; power <= 0.5 W, 1 swim a fin: 5 OK")
    assert lines[1] == "best 20.00 % at E 1.2 GPa (trial 0002)"
    rows = [line.split() for line in lines if line.strip().startswith(tuple("12345"))]
    assert rows[0] == ["1", "1.200", "2.500", "20.00", "60.00", "450.0", "*", "0002"]
    assert rows[3] == ["4", "1.100", "1.000", "60.00", "30.00", "300.0", "mean_speed", "0001"]
    assert rows[4] == ["5", "1.400", "4.000", "50.00", "20.00", "900.0", "power", "0004"]


SHEETS = """
search:
  fin.length: {minimum: 60 mm, maximum: 110 mm, step: 5 mm}
  gait.frequency: {minimum: 0.7 Hz, maximum: 1.3 Hz}
stock:
  PP_0.5: {material: PP, thickness: 0.5 mm}
  PET_0.35: {material: PET, thickness: 0.35 mm}
  offcut: {young_modulus: 2.263 GPa, density: 1190 kg/m^3, thickness: 0.3 mm}
"""


def swim_on(folder: Path, words: dict[str, object], trials: int) -> None:
    """Begin a study, or go on with it, as a new process does that is killed in the trial after these."""
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**words, "study_folder": str(folder)}))
    with plan.study() as study:
        for _ in range(trials):
            following = study.next_candidate(plan.search)
            assert following is not None
            record = study.start(study.propose(*following).number)
            length, frequency = following[1]["fin.length"], following[1]["gait.frequency"]
            speed = 0.03 - (length - 0.08) ** 2 - 0.02 * (frequency - 1.0) ** 2 + 0.001 * len(following[1]["stock"])
            power = 0.2 * frequency**3
            study.finish(record.number, result((speed, 0.1 * speed / power, 1.0 - length, power)))
        if following := study.next_candidate(plan.search):
            study.start(study.propose(*following).number)


@pytest.mark.long
def test_a_study_over_sheets_length_and_frequency_that_is_gone_on_with_twice_is_an_undisturbed_one(
    tmp_path: Path,
) -> None:
    (tmp_path / "space.yaml").write_text(SHEETS)
    words: dict[str, object] = {
        "space": str(tmp_path / "space.yaml"),
        "search.algorithm": "gp",
        "objective": "efficiency,turning_radius",
        "constraints": ["mean_speed >= 2 cm/s", "power <= 0.3 W"],
    }
    swim_on(tmp_path / "whole", words, 11)
    for part in (3, 6, 2):
        swim_on(tmp_path / "cut", words, part)
    found = {name: [t.values for t in read_trials(tmp_path / name) if t.measured] for name in ("whole", "cut")}
    assert len(found["whole"]) == 11
    assert found["cut"] == found["whole"]


def test_nothing_is_written_of_a_study_whose_goals_are_refused(tmp_path: Path) -> None:
    slips: list[dict[str, object]] = [{"objective": "efficency"}, {"constraints": ["power <= 0.5 J"]}]
    for wrong in slips:
        with pytest.raises(ValueError, match=r"efficiency|in W"):
            swim_on(tmp_path / "study", wrong, 1)
    assert list(tmp_path.iterdir()) == []


def test_an_export_has_a_column_with_its_unit_for_each_measure(swum: Path, tmp_path: Path) -> None:
    assert export.main([str(swum), "--into", str(tmp_path)]) == 0
    with (tmp_path / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["efficiency"]) for row in rows] == [numbers[1] for numbers in SWIMS]
    assert [float(row["turning radius [m]"]) for row in rows] == [numbers[2] for numbers in SWIMS]
    assert [float(row["power [W]"]) for row in rows] == [numbers[3] for numbers in SWIMS]
    assert [row["misses"] for row in rows][:2] == ["", "mean_speed >= 2 cm/s is missed: 1.000 cm/s"]
    final = swum / "trials.csv"
    with Study.open(swum) as study:
        final_report.write_table(study)
    assert "efficiency,turning radius [m],power [W],samples" in final.read_text().splitlines()[0]
