"""What a study is to do: settings that decide its scores, and the fin of each candidate."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import Plan
from fin_optimizer.study.journal import StudyError
from fin_plant.fin import Fin
from support.old_studies import take_off_check_sums

if TYPE_CHECKING:
    from pathlib import Path

SHAPE = {"search.length.minimum": 0.05, "search.length.maximum": 0.12}
PROFILE = {"fin.profile_position": [0.25, 0.6], "fin.profile_height": [0.03, 0.018]}


def plan(folder: Path, **given: object) -> Plan:
    values = OPTIMIZER_PARAMETERS.checked({**SHAPE, "study_folder": str(folder), **given})
    return Plan(values)


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
