"""What a space file is made of, piece by piece: names of what is searched, sheets in stock, and ties."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.search import names
from fin_optimizer.search.stock import Sheet, sheet
from fin_optimizer.search.ties import Tie, area_of, ties
from fin_plant.fin import FIN_PARAMETERS, Fin

if TYPE_CHECKING:
    from collections.abc import Collection

# -- names -------------------------------------------------------------------------------------------------------------


def test_names_of_heights_and_of_joints_are_counted_from_one() -> None:
    assert (names.height(3), names.height_place("fin.profile_height[3]")) == ("fin.profile_height[3]", 2)
    assert names.drive(2, "bias") == "gait.joint_2.bias"
    assert names.drive_place("gait.joint_2.bias") == (1, "bias")
    for other in ("fin.length", "fin.profile_height", "fin.profile_height[1].x", "gait.joint_2.mass", "gait.amplitude"):
        assert names.height_place(other) is None
        assert names.drive_place(other) is None


def test_a_name_has_what_its_table_says() -> None:
    heights, biases = FIN_PARAMETERS["fin.profile_height"], OPTIMIZER_PARAMETERS["gait.joints.bias"]
    one = replace(heights, name="fin.profile_height[2]", kind="double", default=0.0)
    assert names.parameter("fin.profile_height[2]") == one
    second = replace(biases, name="gait.joint_2.bias", kind="double", description="Bias of driven joint 2.")
    assert names.parameter("gait.joint_2.bias") == second
    assert names.parameter("gait.lag") is OPTIMIZER_PARAMETERS["gait.lag"]
    assert names.parameter("fin.length") is FIN_PARAMETERS["fin.length"]
    assert names.parameter("gait.joints.bias") is None


def test_all_that_can_be_searched_is_single_values_of_the_fin_its_heights_the_tail_and_its_joints() -> None:
    fin = [name for name in FIN_PARAMETERS if name not in {"fin.profile_position", "fin.profile_height"}]
    tail = ["gait.amplitude", "gait.frequency", "gait.bias"]
    columns = ("amplitude", "frequency", "phase", "bias")
    assert list(names.searchable(0, 1)) == [*fin, *tail, *(f"gait.joint_1.{column}" for column in columns)]
    found = list(names.searchable(2, 2))
    joints = [f"gait.joint_{joint}.{column}" for joint in (1, 2) for column in columns]
    heights = ["fin.profile_height[1]", "fin.profile_height[2]"]
    assert found == [*fin, *heights, "gait.amplitude", "gait.frequency", "gait.lag", "gait.bias", *joints]


# -- sheets ------------------------------------------------------------------------------------------------------------

MEASURED = {"young_modulus": "3.1 GPa", "spread": "0.2 GPa", "density": 1340, "thickness": "0.7 mm"}
PP = {"material": "PP", "thickness": 4e-4}


def test_a_sheet_is_as_it_was_measured() -> None:
    assert sheet("thick", {**MEASURED, "sheet": ["5 cm", "120 mm"]}) == Sheet(
        "thick", 3.1e9, 2e8, 1340.0, 7e-4, (0.05, 0.12)
    )
    unsure = {**MEASURED, "young_modulus": 1e9, "spread": 1e9}
    assert sheet("t", unsure).spread == 1e9
    assert sheet("t", {**unsure, "spread": 0.5}).spread == 0.5
    assert sheet("t", {name: unsure[name] for name in ("young_modulus", "density", "thickness")}).spread == 0.0


def test_a_sheet_of_a_material_is_in_the_middle_of_its_ranges() -> None:
    """Polypropylene: 1.07 to 1.72 GPa, 900 to 910 kg/m^3, tan delta 0.029; what was measured counts before it."""
    made = sheet("A.4_-", PP)
    assert (made.young_modulus, made.spread, made.density) == pytest.approx((1.395e9, 0.325e9, 905.0))
    assert (made.loss_factor, made.size) == (0.029, ())
    measured = sheet("a", {**PP, **MEASURED, "sheet": [0.1, 0.2]})
    assert measured == Sheet("a", 3.1e9, 2e8, 1340.0, 7e-4, (0.1, 0.2), 0.029)


@pytest.mark.parametrize(
    ("name", "entry", "message"),
    [
        ("4a", PP, "sheet 4a: name it with a letter first"),
        ("a" * 41, PP, "40 at most"),
        ("a", {**PP, "colour": "red", "age": 3}, r"sheet a needs a mapping with material, .*, sheet, not age, colour$"),
        ("a", "PP", "sheet a needs a mapping with material, young_modulus, spread, density, thickness, sheet$"),
        ("a", {"material": "PP"}, "sheet a has no thickness: measure it"),
        ("a", {**PP, "thickness": "9 m"}, "sheet a: thickness = 9 m is outside"),
        ("a", {**PP, "spread": 1e8}, r"sheet a needs young_modulus \(and spread\) as measured"),
        ("a", {"thickness": 4e-4, "density": 1200}, "sheet a needs young_modulus"),
        ("a", {**PP, "material": "DM8520"}, "sheet a: .*Measure it and give young_modulus instead$"),
        ("a", {**MEASURED, "young_modulus": "1 m"}, "sheet a: young_modulus = '1 m' has another kind of unit"),
        ("a", {**MEASURED, "spread": "3.2 GPa"}, r"sheet a: spread = 3\.2e\+09 Pa is outside"),
        ("a", {**MEASURED, "spread": -1e-3}, "sheet a: spread = -0.001 Pa is outside"),
        ("a", {**MEASURED, "density": "1 g"}, "sheet a: density = '1 g' has another kind of unit"),
        ("a", {"young_modulus": 1e9, "thickness": 4e-4}, "sheet a needs a density or a material: weigh the sheet"),
        ("a", {**PP, "sheet": [0.1]}, r"sheet a: sheet = \[0.1\] must be a list of its two edges"),
        ("a", {**PP, "sheet": [0.1, 0.2, 0.3]}, "must be a list of its two edges"),
        ("a", {**PP, "sheet": "ab"}, "must be a list of its two edges"),
        ("a", {**PP, "sheet": [0.1, "9 m"]}, "sheet a: sheet = 9 m is outside"),
    ],
)
def test_a_slip_in_a_sheet_is_refused(name: str, entry: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sheet(name, entry)


def test_a_fin_is_cut_from_a_sheet_either_way_round_up_to_its_edges() -> None:
    small = Sheet("small", 1e9, 0.0, 1200.0, 4e-4, (0.05, 0.12))
    assert [small.refusal(*fin) for fin in ((0.12, 0.05), (0.05, 0.12), (0.01, 0.01))] == ["", "", ""]
    why = "sheet small of 50 x 120 mm is too small for a fin of 80 x 60 mm"
    assert small.refusal(0.08, 0.06) == why
    assert small.refusal(0.13, 0.04) != ""
    assert replace(small, size=()).refusal(9.0, 9.0) == ""


def test_a_fin_of_a_sheet_has_what_it_gives_and_damps_by_its_beat() -> None:
    given = {"fin.young_modulus": 1e9, "fin.thickness": 4e-4, "fin.density": 1200.0}
    plain = Sheet("s", 1e9, 0.0, 1200.0, 4e-4)
    assert plain.parameters(2.0) == given
    assert replace(plain, loss_factor=0.04 * math.pi).parameters(2.0) == {**given, "fin.damping_time": 0.01}


def test_sheets_are_like_by_logarithms_of_stiffness_thickness_and_density_and_told_in_a_line() -> None:
    one = Sheet("s", 2e9, 1e8, 1200.0, 1e-3)
    assert one.traits == pytest.approx((math.log(2.0), math.log(1e-3), math.log(1200.0)))
    line = "E 2000000000.0 +- 100000000.0 Pa, 1200.0 kg/m^3, 0.001 m thick"
    assert one.told == line
    assert replace(one, size=(0.05, 0.12), loss_factor=0.03).told == f"{line}, 0.05 x 0.12 m, tan delta 0.03"


# -- ties --------------------------------------------------------------------------------------------------------------

START: dict[str, Any] = {**Fin(length=0.08, height=0.02, tip_height=0.03, thickness=2.5e-4).as_parameters()}
"""Its side area is 20 cm^2, its volume 0.5 cm^3, its tip 1.5 times as high as its root."""


def told(given: object, searched: Collection[str] = ()) -> list[str]:
    return [f"{tie.name}: {tie.told}" for tie in ties(given, searched, START)]


def test_the_area_is_that_between_root_tip_and_the_heights_between() -> None:
    assert area_of(START) == pytest.approx(2e-3)
    tapered = {**START, "fin.profile_position": [0.25], "fin.profile_height": [0.04]}
    assert area_of(tapered) == pytest.approx(0.08 * (0.25 * 0.03 + 0.75 * 0.035))


def test_what_is_held_makes_the_most_natural_follow_that_is_free() -> None:
    all_three = {"fin.volume": "0.6 cm^3", "fin.area": "24 cm^2", "fin.tip_over_root": 2}
    assert told(all_three) == [
        "fin.tip_over_root: 2.0, the tip following",
        "fin.area: 0.0024 m^2, the heights following",
        "fin.volume: 6e-07 m^3, the thickness following",
    ]
    assert told({"fin.area": 2e-3}, ["fin.height"]) == ["fin.area: 0.002 m^2, the length following"]
    assert told({"fin.area": 2e-3}, ["fin.profile_height[2]"]) == ["fin.area: 0.002 m^2, the length following"]
    assert told({"fin.volume": 6e-7}, ["fin.thickness"]) == ["fin.volume: 6e-07 m^3, the heights following"]
    both = told({"fin.area": 2e-3, "fin.volume": 6e-7}, ["fin.thickness"])
    assert both[1] == "fin.volume: 6e-07 m^3, the length following"
    shape = told({"fin.area": {"value": 2e-3, "by": "heights"}}, ["fin.profile_height[2]", "fin.length"])
    assert shape == ["fin.area: 0.002 m^2, the heights following"]


def test_what_is_fixed_is_that_of_the_fin_that_the_search_starts_from() -> None:
    held = ties(dict.fromkeys(("fin.tip_over_root", "fin.area", "fin.volume"), "fixed"), [], START)
    assert [tie.value for tie in held] == pytest.approx([1.5, 2e-3, 5e-7])


@pytest.mark.parametrize(
    ("given", "searched", "message"),
    [
        ("area", (), "ties must be a mapping of fin.tip_over_root, fin.area, fin.volume to what they are held at$"),
        ({"fin.mass": 1, "fin.age": 2, "fin.area": 2e-3}, (), "held at: fin.age, fin.mass is none$"),
        ({"fin.area": {"by": "length"}}, (), r"tie fin.area = \{'by': 'length'\} must be a value, fixed, or a mapping"),
        ({"fin.area": {"value": 2e-3, "for": "length"}}, (), "must be a value, fixed, or a mapping"),
        ({"fin.area": {"value": 2e-3, "by": "thickness"}}, (), "by = 'thickness' is not known: choose one of heights,"),
        ({"fin.area": 1.0}, (), r"tie fin.area = 1 m\^2 is outside"),
        (
            {"fin.area": 2e-3},
            ("fin.tip_height", "fin.length"),
            r"tie fin.area leaves nothing that could follow .*, heights or length \(fin.tip_height, fin.length\): ",
        ),
        (
            {"fin.area": 2e-3, "fin.volume": {"value": 5e-7, "by": "heights"}},
            (),
            "tie fin.volume sets the heights, which is searched, drawn from the stock or set by another tie: keep one",
        ),
        ({"fin.volume": {"value": 5e-7, "by": "thickness"}}, ("fin.thickness",), "tie fin.volume sets the thickness"),
    ],
)
def test_a_tie_that_cannot_be_is_refused(given: object, searched: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ties(given, searched, START)


@pytest.mark.parametrize(
    ("tie", "follows"),
    [
        (Tie("fin.tip_over_root", 2.0, "tip"), {"fin.tip_height": 0.04}),
        (Tie("fin.area", 3e-3, "heights"), {"fin.height": 0.03, "fin.tip_height": 0.045}),
        (Tie("fin.area", 3e-3, "length"), {"fin.length": 0.12}),
        (Tie("fin.volume", 1e-6, "thickness"), {"fin.thickness": 5e-4}),
        (Tie("fin.volume", 1e-6, "heights"), {"fin.height": 0.04, "fin.tip_height": 0.06}),
        (Tie("fin.volume", 1e-6, "length"), {"fin.length": 0.16}),
    ],
)
def test_a_tie_changes_what_follows_and_nothing_else_of_one_fin_or_of_many(tie: Tie, follows: dict[str, float]) -> None:
    solved = tie.solved(START)
    assert {name: solved[name] for name in follows} == pytest.approx(follows)
    assert {name: value for name, value in solved.items() if name not in follows} == {
        name: value for name, value in START.items() if name not in follows
    }
    many = tie.solved({**START, "fin.height": np.array([0.02, 0.02])})
    for name, value in follows.items():
        assert many[name] == pytest.approx([value, value] if np.ndim(many[name]) else value)
