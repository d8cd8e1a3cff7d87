"""What a study is to do: settings that decide its scores, and the fin of each candidate."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.goals import Goals
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.search.cloud_search import CloudSearch
from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import GeneticAlgorithm
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.settings import Policy
from fin_optimizer.trial.phases import Timeouts
from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive
from fin_plant.paths import config_folder
from support.old_studies import take_off_check_sums

if TYPE_CHECKING:
    from pathlib import Path

    from fin_optimizer.search.space import Search

PAPER: dict[str, object] = {"seed": 7, "gait.amplitude": 0.2, "gait.frequency": 1.6}
STIFFNESS = Dimension("fin.young_modulus", 0.5e9, 4e9, unit="Pa")
SHAPE: dict[str, object] = {"search.length.minimum": 0.05, "search.length.maximum": 0.12}
OLDER: dict[str, object] = {"fin.hinges": "between"}
PROFILE = {"fin.profile_position": [0.25, 0.6], "fin.profile_height": [0.03, 0.018]}


def plan(folder: Path, **given: object) -> StudyPlan:
    values = OPTIMIZER_PARAMETERS.checked({**SHAPE, "study_folder": str(folder), **given})
    return StudyPlan.from_parameters(values)


@pytest.mark.parametrize("profile", [{}, PROFILE])
@pytest.mark.parametrize("length", [0.05, 0.08, 0.1099])
def test_a_fin_of_another_length_has_the_same_area(tmp_path: Path, length: float, profile: dict[str, object]) -> None:
    shape = plan(tmp_path, **profile)
    fin = Fin.from_parameters(shape.fin_of({"fin.young_modulus": 1e9, "fin.length": length}))
    assert (fin.length, fin.young_modulus, fin.thickness) == (length, 1e9, shape.fin.thickness)
    assert fin.area == pytest.approx(shape.fin.area, rel=1e-14)
    assert fin.tip_height / fin.height == pytest.approx(shape.fin.tip_height / shape.fin.height, rel=1e-14)


def test_a_study_of_the_shape_is_not_gone_on_with_at_another_area(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    plan(folder).study().close()
    with pytest.raises(StudyError, match=r"fin\.area is 0\.002 there and 0\.004 here"):
        plan(folder, **{"fin.length": 0.16}).study()
    plan(folder).study().close()


def test_without_a_search_for_the_length_the_length_itself_is_a_setting(tmp_path: Path) -> None:
    one = {"search.length.minimum": 0.0, "search.length.maximum": 0.0}
    plan(tmp_path / "study", **one).study().close()
    with pytest.raises(StudyError, match=r"fin\.length is 0\.08 there and 0\.1 here"):
        plan(tmp_path / "study", **one, **{"fin.length": 0.1}).study()


def test_an_older_study_of_the_shape_opens_with_a_note_that_it_does_not_tell_its_area(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    plan(folder).study().close()
    take_off_check_sums(folder)
    settings = json.loads((folder / "study.json").read_text())
    del settings["details"]["fin.area"]
    (folder / "study.json").write_text(json.dumps(settings))
    with plan(folder).study() as study:
        (note,) = (note for note in study.notes if "fin.area" in note)
        assert "0.002" in note
        assert "fin.height" not in study.settings.fin_of({"fin.young_modulus": 1e9, "fin.length": 0.1})


def test_the_plan_of_known_parameters() -> None:
    given = {"trials": 12, "measurement.settle": 1.5, "measurement.duration": 4.0, "timeout.rest": 20.0, "repeats": 3}
    asked = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**PAPER, **given, "plants": ["/a/fish", "/b"]}))
    assert (asked.trials, asked.seed, asked.failures_in_a_row, asked.minimum_free) == (12, 7, 3, 2e8)
    assert (asked.autostart, asked.exit_when_done, asked.plants) == (True, True, ("/a/fish", "/b"))
    assert asked.gait == Gait((JointDrive(0.2, 1.6),))
    assert asked.gait.at_rest == Gait((JointDrive(0.0, 1.6),))
    assert asked.measurement == Measurement(1.5, 4.0, block=0.625)
    assert asked.timeouts == Timeouts(60.0, 10.0, 10.0, 5.0, 20.0, 0.0)
    assert asked.settings.policy == Policy(repeats=3, attempts=2)
    assert asked.settings.goals == Goals()


def test_every_setting_of_the_paper_is_known() -> None:
    """What decides the fins and their scores, by name: a later version finds it under these."""
    settings = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(PAPER)).settings
    assert settings.space == Space((Dimension("fin.young_modulus", 0.5e9, 4e9, unit="Pa"),))
    assert dict(settings.details) == {
        "seed": 7,
        "search.algorithm": "hill_climber",
        "search.population": 0,
        "search.length.minimum": 0.0,
        "search.length.maximum": 0.0,
        "search.length.step_variance": 1e-5,
        "search.young_modulus.minimum": 0.5e9,
        "search.young_modulus.maximum": 4e9,
        "search.young_modulus.step_variance": 1e17,
        "gait.preset": "carangiform",
        "gait.driven_joints": 0,
        "gait.amplitude": 0.2,
        "gait.frequency": 1.6,
        "gait.lag": 0.9,
        "gait.bias": 0.0,
        "gait.joints.amplitude": [],
        "gait.joints.frequency": [],
        "gait.joints.phase": [],
        "gait.joints.bias": [],
        "measurement.settle": 0.0,
        "measurement.duration": 10.0,
        "measurement.largest_speed": 1.0,
        "measurement.largest_start_speed": 0.005,
        "fin.length": 0.08,
        "fin.height": 0.025,
        "fin.tip_height": 0.025,
        "fin.profile_position": [],
        "fin.profile_height": [],
        "fin.thickness": 2.08e-4,
        "fin.density": 1180.0,
        "fin.segments": 6,
        "fin.hinges": "midpoint",
        "fin.stiffness_length": "segment",
        "fin.damping_time": 0.01,
        "fin.hinge_damping": 0.0,
    }


def test_a_study_may_be_gone_on_with_by_other_patience_and_other_fish() -> None:
    may_differ = {name for name, entry in OPTIMIZER_PARAMETERS.items() if not entry.decides_swim}
    assert may_differ == {
        *("trials", "failures_in_a_row", "autostart", "exit_when_done", "study_folder", "plants", "disk.minimum_free"),
        "space",  # what it says is compared, not where it lies
        "search.fish",  # the study keeps a copy
        "search.stop_regret",
        *("timeout.find", "timeout.plant", "timeout.reply", "timeout.silence", "timeout.rest", "timeout.people"),
    }


@pytest.mark.parametrize(
    ("given", "search"),
    [
        ({}, HillClimber(Space((STIFFNESS,)), 7, {"fin.young_modulus": math.sqrt(1e17)})),
        (
            {"search.algorithm": "genetic", "search.population": 5},
            OneByOne(GeneticAlgorithm(Space((STIFFNESS,)), 7, {"fin.young_modulus": math.sqrt(1e17)}, population=5)),
        ),
        (
            {"search.algorithm": "cma_es", **SHAPE},
            OneByOne(CmaEs(Space((STIFFNESS, Dimension("fin.length", 0.05, 0.12, unit="m"))), 7)),
        ),
    ],
    ids=["hill_climber", "genetic", "cma_es"],
)
def test_the_search_asked_for_is_made_of_its_parameters(given: dict[str, object], search: Search) -> None:
    made = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**PAPER, **given})).search
    assert vars(made) == vars(search)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"search.young_modulus.minimum": 5e9}, "fin.young_modulus"),
        ({"search.length.minimum": 0.1}, "fin.length"),
        ({"search.algorithm": "cma_es", "objective": "mean_speed,power"}, "knows one objective only"),
        ({"objective": "mean_speed,efficency"}, "did you mean efficiency"),
        ({"objective": ""}, "'' is no measure of a swim: there are mean_speed"),
        ({"objective": "speed,power"}, "'speed' is no measure of a swim: did you mean"),
        ({"constraints": ["mean_speed >= 2 cm"]}, "another kind of unit: it is in m/s"),
        ({"constraints": ["mean_speed >= 3 cm/s", "mean_speed <= 2 cm/s"]}, "contradict each other"),
        ({"constraints": ["mean_speed >= 2 m/s"]}, "no swim has a score beyond measurement.largest_speed = 1 m/s"),
        ({"constraints": ["steady_speed >= 2 m/s"]}, "no swim has a score beyond measurement.largest_speed = 1 m/s"),
        ({"gait.amplitude": 0.0}, "the gait moves no joint"),
        ({"search.algorithm": "genetic", "objective": "speed_and_cost_of_transport"}, "knows one objective only"),
        ({"search.algorithm": "cma_es"}, "CMA-ES needs at least 2 parameters"),
        ({"plants": ["fish"]}, "plants has 'fish': give namespaces like /tank_a/fish"),
        ({"plants": ["/a", "/a"]}, "plants names a fish twice: /a, /a"),
        ({"fin.thickness": 0.02, "fin.length": 0.01}, "must be less than fin.length"),
    ],
)
def test_parameters_that_do_not_fit_together_are_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given))


def test_what_a_swim_may_reach_or_stay_below_is_no_contradiction() -> None:
    allowed = ["mean_speed >= 1 m/s", "steady_speed <= 2 m/s", "power >= 2 W"]
    asked = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({"constraints": allowed}))
    assert [each.text for each in asked.settings.goals.constraints] == allowed


@pytest.mark.parametrize("objective", ["power", "mean_speed,power"])
def test_a_cloud_of_fish_knows_speeds_only(objective: str) -> None:
    with pytest.raises(ValueError, match=r"needs objective speed|one objective only"):
        StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({"objective": objective, "search.algorithm": "cloud"}))


def test_a_cloud_of_fish_swims_each_candidate_as_a_trial_does(tmp_path: Path) -> None:
    window: dict[str, object] = {"measurement.settle": 1.5, "measurement.duration": 4.0}
    made = plan(tmp_path, **window, **{"search.algorithm": "cloud", "gait.amplitude": 0.2}).search
    assert isinstance(made, CloudSearch)
    assert made.around is None, "no fish was given"
    assert (made.settle, made.duration) == (1.5, 4.0)
    fin, gait = made.swum({"fin.young_modulus": 1e9, "fin.length": 0.1})
    assert [fin.young_modulus, fin.length, fin.height] == pytest.approx([1e9, 0.1, 0.08 * 0.025 / 0.1])
    assert gait == Gait((JointDrive(0.2, 0.9),))


def test_a_cloud_is_drawn_around_the_studys_copy_of_its_fish(tmp_path: Path) -> None:
    fitted = (config_folder("fin_optimizer") / "fitted_tail_actuated_fish.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(fitted, encoding="utf-8")
    asked: dict[str, object] = {"search.algorithm": "cloud", "search.fish": str(mine)}
    begun = plan(tmp_path / "study", **asked)
    begun.study().close()
    mine.write_text(fitted.replace("body.mass: 0.725", "body.mass: 0.9"), encoding="utf-8")
    again = plan(tmp_path / "study", **asked).search
    assert isinstance(begun.search, CloudSearch)
    assert isinstance(again, CloudSearch)
    assert again.around == begun.search.around
    assert again.around is not None
    assert again.around["fish"].body.mass == 0.725
    with pytest.raises(ValueError, match=r"search.fish = .* cannot be read"):
        plan(tmp_path / "other", **{**asked, "search.fish": str(tmp_path / "none.yaml")})
    with pytest.raises(ValueError, match=r"is for search.algorithm = cloud, not gp"):
        plan(tmp_path / "other", **{**asked, "search.algorithm": "gp"})


GAITS = """
search:
  fin.length: {minimum: 40 mm, maximum: 120 mm, step: 5 mm}
  fin.height: {minimum: 20 mm, maximum: 21 mm, step: 0.5 mm}
  gait.amplitude: {minimum: 0.1 rad, maximum: 0.3 rad}
  gait.frequency: {choices: [1 Hz, 2 Hz, 1.5 Hz]}
"""


def test_a_space_of_a_file_is_searched_in_tenths_of_its_ranges_and_by_its_gaits(tmp_path: Path) -> None:
    path = tmp_path / "gaits.yaml"
    path.write_text(GAITS, encoding="utf-8")
    values = OPTIMIZER_PARAMETERS.checked({"space": str(path), "seed": 3, "repeats": 3})
    asked = StudyPlan.from_parameters(values)
    assert isinstance(asked.search, HillClimber)
    # A grid's ends lie half a step beyond its first and its last value.
    tenths = {"fin.length": 0.0085, "fin.height": 0.0005, "gait.amplitude": 0.02}
    assert asked.search.deviations == pytest.approx(tenths)
    assert asked.gait == Gait((JointDrive(0.3, 2.0),))
    candidate = {"fin.length": 0.07, "fin.height": 0.02, "gait.amplitude": 0.25, "gait.frequency": 1.5}
    assert asked.gait_of(candidate) == Gait((JointDrive(0.25, 1.5),))
    policy, details = asked.settings.policy, asked.settings.details
    assert policy == Policy(repeats=3)
    assert details["seed"] == 3
    assert (details["fin.thickness"], details["measurement.duration"]) == (Fin().thickness, 10.0)
    assert not {"objective", "trials", "repeats", "search.young_modulus.minimum"} & details.keys()
    cloud = StudyPlan.from_parameters({**values, "search.algorithm": "cloud"}).search
    assert isinstance(cloud, CloudSearch)
    assert cloud.swum(candidate) == (Fin(length=0.07, height=0.02), Gait((JointDrive(0.25, 1.5),)))


def test_every_candidate_of_the_short_form_swims_the_same_gait(tmp_path: Path) -> None:
    asked = plan(tmp_path, **PAPER)
    assert asked.gait_of({"fin.young_modulus": 1e9, "fin.length": 0.1}) == Gait((JointDrive(0.2, 1.6),))


def test_the_plan_of_a_study_is_read_from_its_folder(tmp_path: Path) -> None:
    begun = plan(tmp_path / "study", **PAPER)
    begun.study().close()
    there = StudyPlan.of_study(tmp_path / "study")
    assert (there.settings, there.gait) == (begun.settings, begun.gait)
    assert there.study_folder == str(tmp_path / "study")
    take_off_check_sums(tmp_path / "study")
    settings = json.loads((tmp_path / "study" / "study.json").read_text())
    settings["details"]["fin.area"] = 0.003
    (tmp_path / "study" / "study.json").write_text(json.dumps(settings))
    with pytest.raises(ValueError, match=r"begun by a version with other settings: fin\.area is 0\.003 there"):
        StudyPlan.of_study(tmp_path / "study")


def test_a_study_goes_on_with_what_was_the_default_when_it_was_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan(tmp_path, **OLDER).study().close()
    assert plan(tmp_path).settings.details["fin.hinges"] == "between"
    assert plan(tmp_path / "another").settings.details["fin.hinges"] == "midpoint"
    monkeypatch.chdir(tmp_path)
    assert plan(tmp_path, study_folder="").settings.details["fin.hinges"] == "midpoint", "of a new study"
