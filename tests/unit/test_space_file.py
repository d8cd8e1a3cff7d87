"""A search space from a file: what a lab can change is data, every candidate can be built, and slips are refused."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.search import rules
from fin_optimizer.search.algorithms import ALGORITHMS, search
from fin_optimizer.search.rules import gait_of
from fin_optimizer.search.space import Choice, Dimension, Evaluation, generator, uniform
from fin_optimizer.search.space_file import SPACE_FILE, read_space
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Settings
from fin_plant import yaml_file
from fin_plant.fin import Fin
from fin_plant.paths import config_folder
from fin_sim.rigid_fin import rigid_fin_load

if TYPE_CHECKING:
    from pathlib import Path

    from fin_optimizer.search.space_file import SpaceFile

START = {**Fin().as_parameters(), "gait.amplitude": 0.26, "gait.frequency": 0.9}
DRAWER = config_folder("fin_optimizer") / "drawer_of_sheets.yaml"
SHEETS = """
stock:
  thin: {material: PP, thickness: 0.4 mm, sheet: [300 mm, 100 mm]}
  thick: {young_modulus: 3.1 GPa, spread: 0.2 GPa, density: 1340, thickness: 0.7 mm, sheet: [50 mm, 120 mm]}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def read(folder: Path, text: str, **start: object) -> SpaceFile:
    path = folder / "my_space.yaml"
    path.write_text(text, encoding="utf-8")
    return read_space(path, {**START, **start})


def plan(folder: Path, **given: object) -> StudyPlan:
    return StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({"study_folder": str(folder), **given}))


@given(seed=st.integers(0, 2**63), number=st.integers(0, 1000))
@settings(max_examples=100)
def test_every_candidate_of_the_drawer_can_be_cut_and_driven(seed: int, number: int) -> None:
    space = DRAWER_SPACE.space
    values = uniform(space, generator(seed, number))
    assert space.check(values) == values
    sent = DRAWER_SPACE.rules.sent(DRAWER_SPACE.start, values)
    fin = Fin.from_parameters(sent)
    sheet = DRAWER_SPACE.rules.stock[values["stock"]]
    assert (fin.young_modulus, fin.thickness, fin.density) == (sheet.young_modulus, sheet.thickness, sheet.density)
    assert min(fin.length, fin.height) <= min(sheet.size)
    assert max(fin.length, fin.height) <= max(sheet.size)
    assert fin.tip_height == fin.height
    assert 3.0 * fin.height <= fin.length <= 0.12
    (joint,) = gait_of(sent).joints
    assert 2.0 * math.pi * joint.frequency * joint.amplitude <= math.radians(220.0)
    assert joint.frequency == values["gait.frequency"]


DRAWER_SPACE = read_space(DRAWER, START)


def test_the_page_shows_the_drawer_as_it_is() -> None:
    page = (DRAWER.parents[4] / "docs" / "trials.md").read_text(encoding="utf-8")
    shown = page.split("```yaml\n")[1].split("```")[0]
    assert yaml_file.parse(shown) == yaml_file.read(DRAWER)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] if name == "gp" else [])
        for name, ability in ALGORITHMS.items()
        if ability.choices
    ],
)
def test_no_search_over_the_drawer_leaves_what_can_be(name: str) -> None:
    deviations = {d.name: 0.3 * (d.maximum - d.minimum) for d in DRAWER_SPACE.space.ranges}
    asked = search(name, DRAWER_SPACE.space, 5, deviations, population=4)
    history: list[Evaluation] = []
    for _ in range(12):
        values = asked.propose(history)
        assert DRAWER_SPACE.rules.refusal(DRAWER_SPACE.start, values) == ("", "")
        history.append(Evaluation(values, values["fin.length"]))


def test_each_form_of_a_dimension_is_read(folder: Path) -> None:
    found = read(
        folder,
        """
search:
  fin.young_modulus: {minimum: 10 MPa, maximum: 2.0e+11, log: true}
  fin.length: {minimum: 0.04, maximum: 140 mm, step: 5 mm}
  fin.segments: {minimum: 3, maximum: 12}
  fin.hinges: {choices: [between, midpoint]}
  fin.thickness: {choices: [0.3 mm, 0.0005]}
  gait.joint_1.bias: {minimum: -5 deg, maximum: 5 deg}
""",
    )
    assert found.space.dimensions == (
        Dimension("fin.young_modulus", 1e7, 2e11, "Pa", log=True),
        Dimension("fin.length", 0.04, 0.14, "m", step=0.005),
        Dimension("fin.segments", 3, 12, whole=True),
        Choice("fin.hinges", ("between", "midpoint")),
        Choice("fin.thickness", (3e-4, 5e-4), "m"),
        Dimension("gait.joint_1.bias", math.radians(-5.0), math.radians(5.0), "rad"),
    )


def test_a_profile_of_many_heights_is_searched_at_even_places(folder: Path) -> None:
    text = """
search: {fin.profile_height: {points: 4, minimum: 10 mm, maximum: 50 mm}}
ties: {fin.area: {value: 20 cm^2, by: heights}}
"""
    found = read(folder, text)
    values = uniform(found.space, generator(1, 0))
    assert list(values) == [f"fin.profile_height[{place}]" for place in (1, 2, 3, 4)]
    sent = found.rules.sent(found.start, values)
    assert sent["fin.profile_position"] == [0.2, 0.4, 0.6, 0.8]
    fin = Fin.from_parameters(sent)
    assert fin.area == pytest.approx(2e-3, rel=1e-12)
    ratios = [height / values["fin.profile_height[1]"] for height in values.values()]
    assert [height / fin.heights[1] for height in fin.heights[1:-1]] == pytest.approx(ratios)


@pytest.mark.parametrize(
    ("tie", "searched", "held"),
    [
        ("fin.area: 20 cm^2", "fin.length: {minimum: 50 mm, maximum: 120 mm}", lambda fin: fin.area / 2e-3),
        ("fin.area: fixed", "fin.length: {minimum: 50 mm, maximum: 120 mm}", lambda fin: fin.area / Fin().area),
        ("fin.area: 20 cm^2", "fin.height: {minimum: 15 mm, maximum: 40 mm}", lambda fin: fin.area / 2e-3),
        (
            "fin.volume: 0.4 cm^3",
            "fin.length: {minimum: 50 mm, maximum: 120 mm}",
            lambda fin: fin.area * fin.thickness / 4e-7,
        ),
        (
            "fin.volume: {value: 0.4 cm^3, by: heights}",
            "fin.thickness: {minimum: 0.2 mm, maximum: 0.3 mm}",
            lambda fin: fin.area * fin.thickness / 4e-7,
        ),
        (
            "fin.tip_over_root: 1.5",
            "fin.height: {minimum: 15 mm, maximum: 30 mm}",
            lambda fin: fin.tip_height / fin.height / 1.5,
        ),
    ],
)
def test_what_is_tied_stays(folder: Path, tie: str, searched: str, held: Any) -> None:
    found = read(folder, f"search: {{{searched}}}\nties: {{{tie}}}")
    for number in range(20):
        values = uniform(found.space, generator(2, number))
        assert held(Fin.from_parameters(found.rules.sent(found.start, values))) == pytest.approx(1.0, rel=1e-12)


def test_area_and_volume_are_held_together_with_the_ratio_of_the_heights(folder: Path) -> None:
    text = """
search: {fin.length: {minimum: 60 mm, maximum: 120 mm}}
ties: {fin.area: 20 cm^2, fin.volume: 0.5 cm^3, fin.tip_over_root: 2}
"""
    found = read(folder, text)
    fin = Fin.from_parameters(found.rules.sent(found.start, uniform(found.space, generator(3, 0))))
    assert (fin.area, fin.area * fin.thickness, fin.tip_height / fin.height) == pytest.approx((2e-3, 5e-7, 2.0))


def test_a_sheet_of_a_material_has_the_middle_of_its_range_and_loses_what_it_does(folder: Path) -> None:
    found = read(folder, f"search: {{gait.frequency: {{minimum: 0.5, maximum: 3}}}}{SHEETS}")
    thin = found.rules.stock["thin"]
    assert (thin.young_modulus, thin.spread) == pytest.approx((1.395e9, 0.325e9))
    sent = found.rules.sent(found.start, {"stock": "thin", "gait.frequency": 2.0})
    assert sent["fin.damping_time"] == pytest.approx(0.029 / (4.0 * math.pi))
    of_joint = found.rules.sent({**START}, {"stock": "thin", "gait.joint_1.frequency": 4.0})
    assert of_joint["fin.damping_time"] == pytest.approx(0.029 / (8.0 * math.pi))
    measured = found.rules.sent(found.start, {"stock": "thick", "gait.frequency": 2.0})
    assert measured["fin.damping_time"] == START["fin.damping_time"]


def test_conditions_bound_what_the_servo_gives(folder: Path) -> None:
    text = "search: {gait.frequency: {minimum: 0.5 Hz, maximum: 3 Hz}}\nconditions: [servo.power <= 20 mW]"
    found = read(folder, text)
    torque, power = rigid_fin_load(Fin(), 0.26, 3.0)
    assert power > 0.02
    why = found.space.judge({"gait.frequency": 3.0})
    assert why.endswith(f"(servo.power = {power:.6g} W)")
    torques = read(folder, text.replace("servo.power <= 20 mW", f"servo.torque <= {torque / 4.0} N m"))
    fastest = max(uniform(torques.space, generator(1, number))["gait.frequency"] for number in range(100))
    assert 1.4 < fastest <= 1.5  # the torque rises with the square of the frequency


def test_points_of_a_profile_begin_halfway_between_root_and_tip_and_leave_the_start_as_it_was(folder: Path) -> None:
    start = {**START, "fin.height": 0.02, "fin.tip_height": 0.03}
    path = folder / "my_space.yaml"
    path.write_text("search: {fin.profile_height: {points: 1, minimum: 10 mm, maximum: 50 mm}}", encoding="utf-8")
    found = read_space(path, start)
    assert found.start == {**start, "fin.profile_position": [0.5], "fin.profile_height": [0.025]}
    assert start["fin.profile_position"] == []
    with pytest.raises(ValueError, match=r"has points, and the fin has fin.profile_position = \[0.5\]: leave one of"):
        read_space(path, found.start)


def test_sheets_are_the_first_that_is_searched_and_give_what_a_tie_may_not_set(folder: Path) -> None:
    searched = "search: {fin.length: {minimum: 4 cm, maximum: 5 cm, log: false, step: 5 mm}}\nties: {fin.volume: fixed}"
    alone, stocked = read(folder, searched), read(folder, searched + SHEETS)
    assert alone.space.names == ("fin.length",)
    assert stocked.space.names == ("stock", "fin.length")
    assert [tie.by for found in (alone, stocked) for tie in found.rules.ties] == ["thickness", "heights"]
    given = {"fin.young_modulus", "fin.thickness", "fin.density"}
    assert alone.start.keys() == START.keys() - {"fin.length"}
    assert stocked.start.keys() == alone.start.keys() - given


def test_three_names_at_most_are_proposed(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"gait.joint_2.bias is not .*: did you mean ") as refused:
        read(folder, "search: {gait.joint_2.bias: {minimum: 0, maximum: 0.1}}")
    assert str(refused.value).count(" or ") == 2


def test_a_file_that_is_not_there_is_told(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"^space .*nowhere\.yaml cannot be read: No such file"):
        read_space(folder / "nowhere.yaml", START)


def test_stock_may_lie_in_a_file_beside_it(folder: Path) -> None:
    (folder / "drawer.yaml").write_text(SHEETS.removeprefix("\nstock:\n"), encoding="utf-8")
    found = read(folder, "stock: drawer.yaml")
    assert list(found.rules.stock) == ["thin", "thick"]
    assert set(found.files) == {SPACE_FILE, "drawer.yaml"}


LENGTH = "fin.length: {minimum: 40 mm, maximum: 140 mm}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "search: {fin.lenght: {minimum: 40 mm, maximum: 140 mm}}",
            "fin.lenght is not a parameter .*did you mean fin.length",
        ),
        (
            "search: {fin.length: {minimum: 40, maximum: 80}}",
            r"= 40 m is outside .*without a unit is in m: is it 40 cm \(0.4 m\) or 40 mm \(0.04 m\)\?",
        ),
        (
            "search: {fin.length: {minimum: 40 s, maximum: 1}}",
            "fin.length = '40 s' has another kind of unit",
        ),
        ("search: {fin.length: {minimum: 140 mm, maximum: 40 mm}}", "upside down or empty: minimum = 0.14 m"),
        ("search: {fin.length: {minimum: 40 mm, maximum: 40 mm}}", "upside down or empty"),
        ("search: {fin.length: {minimum: 40 mm, maximum: 90 mm, steps: 5}}", "needs minimum and maximum .*not steps"),
        ("search: {fin.length: {minimum: 40 mm, maximum: 90 mm, step: 0}}", "step of fin.length = 0 m is outside"),
        ("search: {fin.length: {minimum: 40 mm, maximum: 90 mm, log: 1}}", "log = 1 must be true or false"),
        ("search: {fin.hinges: {minimum: 1, maximum: 2}}", "fin.hinges has no order: give choices"),
        ("search: {fin.hinges: {choices: [between, middle]}}", "fin.hinges = 'middle' is not known"),
        ("search: {fin.profile_height: {minimum: 1 cm, maximum: 2 cm}}", "needs points"),
        ("search: {'fin.profile_height[1]': {minimum: 1 cm, maximum: 2 cm}}", "profile has 0 points"),
        ("search: {gait.joint_2.amplitude: {minimum: 0.1, maximum: 0.2}}", "gait.joint_2.amplitude is not a parameter"),
        (f"search: {{{LENGTH}, {LENGTH}}}", "fin.length stands twice"),
        (
            "search: {fin.thickness: {minimum: 0.2 mm, maximum: 1 mm}}" + SHEETS,
            "fin.thickness is searched twice, by itself and with the sheets in stock",
        ),
        (
            "search: {gait.frequency: {minimum: 1, maximum: 2}, gait.joint_1.frequency: {minimum: 1, maximum: 2}}",
            "gait.frequency is searched twice, for the whole tail and as gait.joint_1.frequency: leave one of them out",
        ),
        (
            "search: {fin.tip_height: {minimum: 1 cm, maximum: 2 cm}}\nties: {fin.tip_over_root: 1}",
            "tie fin.tip_over_root leaves nothing that could follow",
        ),
        (f"search: {{{LENGTH}}}\nties: {{fin.area: {{value: 20 cm^2, by: length}}}}", "tie fin.area sets the length"),
        (f"search: {{{LENGTH}}}\nties: {{fin.mass: 1 g}}", "fin.mass is none"),
        (f"search: {{{LENGTH}}}\nties: {{fin.area: 20}}", r"tie fin.area = 20 m\^2 is outside .*"),
        (
            f"search: {{{LENGTH}}}\nties: {{fin.area: 2 cm^2}}\nconditions: [fin.height >= 1 cm]",
            "none can be: .*fail the condition fin.height >= 1 cm .*is wrong",
        ),
        (
            f"search: {{{LENGTH}}}\nties: {{fin.area: 0.1 m^2}}",
            "of 20 candidates drawn from the space none can be: 20 fail the ties fin.area .*fin.height = ",
        ),
        (
            f"search: {{{LENGTH}}}\nconditions: [fin.length >= 20 cm]",
            r"20 fail the condition fin.length >= 20 cm \(fin.length >= 20 cm is not met: 0.\d+ m >= 0.2 m is wrong",
        ),
        (f"search: {{{LENGTH}}}\nconditions: fin.length >= 20 cm", "conditions = .* must be a list"),
        (
            SHEETS.replace("300 mm, 100 mm", "30 mm, 20 mm").replace("50 mm, 120 mm", "20 mm, 70 mm"),
            "fail the sheets' sizes .*is too small for a fin of 80 x 25 mm",
        ),
        (SHEETS.replace("0.4 mm", "0.4"), r"sheet thin: thickness = 0.4 m is outside .* or 0.4 mm \(0.0004 m\)"),
        (SHEETS.replace("PP", "PQ"), "material 'PQ' is not in the table"),
        (SHEETS.replace("material: PP, ", ""), "sheet thin needs young_modulus"),
        (SHEETS.replace(", density: 1340", ""), "sheet thick needs a density"),
        (SHEETS.replace("[50 mm, 120 mm]", "50 mm"), "sheet = '50 mm' must be a list of its two edges"),
        (SHEETS.replace("thick:", "th/ick:"), "sheet th/ick: name it with a letter first"),
        ("stock: {thin: {material: PP, thickness: 0.4 mm}}", "stock holds one sheet, thin: give two or more"),
        ("stock: nowhere.yaml", "stock nowhere.yaml cannot be read: No such file"),
        ("stock: ../drawer.yaml", "must be sheets, or the name of another .yaml file beside this one"),
        ("search: {}", "it searches nothing"),
        ("serach: {}", "serach is none of them"),
        ("[1, 2]", "it must be a mapping with search, stock, ties, conditions$"),
        ("search: [1]", r"search = \[1\] must be a mapping"),
        (
            "search: {zzz: {minimum: 1, maximum: 2}}",
            "zzz is not a parameter .*: there are fin.young_mod",
        ),
        ("search: {fin.length: 3}", "fin.length = 3 must be a mapping with minimum and maximum"),
        ("search: {fin.length: {minimum: 40 mm}}", "fin.length needs minimum and maximum .*, or choices$"),
        ("search: {fin.length: {choices: [4 cm, 5 cm], log: true}}", "fin.length: choices stand alone, as a list"),
        ("search: {fin.length: {choices: 4 cm}}", "fin.length: choices stand alone, as a list"),
        ("search: {fin.profile_height: 3}", "fin.profile_height needs points"),
        ("search: {fin.profile_height: {points: 0, minimum: 1 cm, maximum: 2 cm}}", "fin.profile_height: points = 0 "),
        (
            """search: {fin.profile_height: {points: 2, minimum: 1 cm, maximum: 2 cm},
                        'fin.profile_height[2]': {minimum: 1 cm, maximum: 2 cm}}""",
            r"fin.profile_height\[2\] is searched twice, by itself and as one of 2 points: keep one",
        ),
        ("stock: [thin]", r"stock = \['thin'\] must be a mapping of the names of sheets"),
        ("stock: {}", r"stock = \{\} must be a mapping of the names of sheets"),
        ("stock: space.yaml", "stock = 'space.yaml' must be sheets, or the name of another .yaml file"),
    ],
)
def test_a_slip_is_refused_with_its_numbers(
    folder: Path, text: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rules, "_SAMPLES", 20)
    with pytest.raises(ValueError, match=message) as refused:
        read(folder, text)
    assert str(refused.value).startswith(f"space {folder / 'my_space.yaml'}: ")


def test_nothing_is_written_when_the_space_is_refused(folder: Path) -> None:
    path = folder / "my_space.yaml"
    path.write_text("search: {fin.length: {minimum: 40, maximum: 80}}", encoding="utf-8")
    with pytest.raises(ValueError, match="is it 40 cm"):
        plan(folder / "study", space=str(path))
    assert not (folder / "study").exists()


def test_the_short_form_beside_a_file_is_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"search\.young_modulus\.minimum says what is searched, and so does"):
        plan(folder / "study", space=str(DRAWER), **{"search.young_modulus.minimum": 1e9})


def test_choices_are_refused_by_cma_es_at_the_start(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"cma_es cannot choose \(stock\): for choices use hill"):
        plan(folder / "study", space=str(DRAWER), **{"search.algorithm": "cma_es"})


def test_a_study_goes_on_with_its_copy_and_refuses_another_file(folder: Path) -> None:
    mine = folder / "mine.yaml"
    mine.write_bytes(DRAWER.read_bytes())
    begun = plan(folder / "study", space=str(mine))
    begun.study().close()
    assert (folder / "study" / SPACE_FILE).read_bytes() == DRAWER.read_bytes()
    mine.write_text(mine.read_text(encoding="utf-8").replace("120 mm\n", "110 mm\n"), encoding="utf-8")
    again = plan(folder / "study")
    assert again.settings == begun.settings
    again.study().close()
    with pytest.raises(StudyError, match=r"conditions is .*fin\.length <= 120 mm.* there and .*fin\.length <= 110 mm"):
        plan(folder / "study", space=str(mine)).study()
    (folder / "study" / SPACE_FILE).unlink()
    with pytest.raises(StudyError, match=r"tie fin\.tip_over_root is 1\.0"):
        plan(folder / "study").study()


def test_settings_are_read_as_they_were_written() -> None:
    given = plan(DRAWER.parent / "nowhere", space=str(DRAWER)).settings
    again = Settings.from_json(given.to_json())
    assert (again, again.flat()) == (given, given.flat())
    values = uniform(DRAWER_SPACE.space, generator(4, 0))
    assert again.sent(values) == given.sent(values)


def test_a_study_of_the_short_form_is_written_as_before(folder: Path) -> None:
    content = json.loads(plan(folder / "study").settings.to_json())
    assert content["format"] == 1
    assert "rules" not in content
    assert content["space"] == [{"name": "fin.young_modulus", "minimum": 0.5e9, "maximum": 4e9, "unit": "Pa"}]


def test_the_ledger_keeps_every_kind_of_value(folder: Path) -> None:
    path = folder / "my_space.yaml"
    searched = "{fin.segments: {minimum: 3, maximum: 12}, fin.length: {minimum: 5 cm, maximum: 10 cm, step: 5 mm}}"
    path.write_text(f"search: {searched}{SHEETS}", encoding="utf-8")
    given = plan(folder / "study", space=str(path), seed=3)
    with given.study() as study:
        proposed = study.next_candidate(given.search)
        assert proposed is not None
        record = study.propose(*proposed)
        assert record.values == proposed[1]
    with Study.open(folder / "study", given.settings) as study:
        assert study.trials[0].values == proposed[1]
        assert [type(value) for value in proposed[1].values()] == [str, int, float]


def test_a_candidate_swims_its_own_gait_and_is_judged_by_its_own_beat(folder: Path) -> None:
    given = plan(folder / "study", space=str(DRAWER))
    values = uniform(DRAWER_SPACE.space, generator(6, 0))
    gait = given.gait_of(values)
    assert gait.joints[0].frequency == values["gait.frequency"]
    assert given.measurement_of(gait).block == 1.0 / values["gait.frequency"]
    assert given.gait.joints[0].frequency == 2.5
