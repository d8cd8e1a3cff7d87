"""What a plant is sent for a candidate, and why a candidate cannot be: with known numbers, and without a file."""

from __future__ import annotations

import math
from typing import Any

import pytest

from fin_optimizer.search import rules as rules_module
from fin_optimizer.search.conditions import Condition
from fin_optimizer.search.rules import Rules, condition_units, gait_of, is_plain
from fin_optimizer.search.space import Dimension, Space, generator
from fin_optimizer.search.stock import Sheet
from fin_optimizer.search.ties import Tie
from fin_plant.fin import Fin
from fin_sim.rigid_fin import rigid_fin_load

FIN = Fin(length=0.08, height=0.02, tip_height=0.03, thickness=2.5e-4, density=1000.0, segments=4)
"""Its side area is 20 cm^2, its volume 0.5 cm^3, its mass 0.5 g."""
START: dict[str, Any] = {**FIN.as_parameters(), "gait.amplitude": 0.26, "gait.frequency": 0.9}
THREE_JOINTS = {"gait.joints.amplitude": [0.1, 0.2, 0.3], "gait.joints.frequency": [4.0, 3.0, 1.0]}
UNITS = condition_units(0, 1)
SHEETS = {
    "small": Sheet("small", 1e9, 0.0, 1100.0, 3e-4, (0.05, 0.06), loss_factor=0.004 * math.pi),
    "any": Sheet("any", 2e9, 1e8, 1200.0, 5e-4),
}


def rules(*conditions: str, stock: bool = False, ties: tuple[Tie, ...] = ()) -> Rules:
    return Rules(SHEETS if stock else {}, ties, tuple(Condition.parse(text, UNITS) for text in conditions))


def test_conditions_may_name_numbers_and_what_follows_from_them() -> None:
    units = condition_units(1, 2)
    assert (units["fin.length"], units["fin.segments"], units["fin.area"]) == ("m", "", "m^2")
    assert (units["fin.profile_height[1]"], units["gait.joint_2.bias"], units["servo.power"]) == ("m", "rad", "W")
    assert {"fin.hinges", "fin.profile_height[2]", "gait.joint_3.bias"}.isdisjoint(units)


def test_single_numbers_of_joints_take_the_place_of_the_tails() -> None:
    drawn = {"gait.joint_2.phase": -0.5, "gait.joint_3.amplitude": 0.25, "fin.length": 0.1}
    joints = gait_of({**THREE_JOINTS, **drawn}).joints
    assert [joint.amplitude for joint in joints] == [0.1, 0.2, 0.25]
    assert joints[1].phase == -0.5
    assert [joint.frequency for joint in joints] == [4.0, 3.0, 1.0]


def test_every_number_that_a_condition_may_name_is_told_in_si() -> None:
    profile = {"fin.profile_position": [0.25, 0.5], "fin.profile_height": [0.021, 0.022]}
    parameters = {**FIN.as_parameters(), **profile, **THREE_JOINTS}
    found = rules_module._numbers(parameters, Fin.from_parameters(parameters), gait_of(parameters))
    assert (found["fin.length"], found["fin.segments"]) == (0.08, 4.0)
    assert (found["fin.profile_height[1]"], found["fin.profile_height[2]"]) == (0.021, 0.022)
    assert (found["gait.joint_1.frequency"], found["gait.joint_3.amplitude"]) == (4.0, 0.3)
    area = 0.08 * (0.25 * 0.0205 + 0.25 * 0.0215 + 0.5 * 0.026)
    expected = {
        "fin.area": area,
        "fin.volume": 2.5e-4 * area,
        "fin.tip_over_root": 1.5,
        "fin.mass": 0.25 * area,
        "fin.largest_height": 0.03,
        "servo.rate": 2.0 * math.pi * 0.6,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_what_is_sent_is_the_start_the_sheet_what_was_drawn_and_what_follows() -> None:
    start = {**START, "fin.profile_position": [0.3, 0.6], "fin.profile_height": [0.02, 0.02]}
    before = {name: list(value) if isinstance(value, list) else value for name, value in start.items()}
    values = {"stock": "small", "fin.profile_height[2]": 0.05, "fin.segments": 7, "gait.frequency": 2.0}
    sent = rules(stock=True, ties=(Tie("fin.tip_over_root", 2.0, "tip"),)).sent(start, values)
    sheet = {"fin.young_modulus": 1e9, "fin.thickness": 3e-4, "fin.density": 1100.0, "fin.damping_time": 0.001}
    drawn = {"fin.segments": 7, "gait.frequency": 2.0, "fin.profile_height": [0.02, 0.05]}
    assert sent == {**start, **sheet, **drawn, "fin.tip_height": 0.04}
    assert start == before


def test_a_sheet_damps_by_the_beat_of_the_joint_that_carries_the_fin() -> None:
    sent = rules(stock=True).sent({**FIN.as_parameters(), **THREE_JOINTS}, {"stock": "small"})
    assert sent["fin.damping_time"] == pytest.approx(0.002)
    assert sent["fin.profile_height"] == []


def test_why_a_candidate_cannot_be_is_told_with_the_rule() -> None:
    assert rules().refusal(START, {}) == ("", "")
    rule, why = rules().refusal(START, {"fin.length": -1.0})
    assert rule == "what a fin can be"
    assert "fin.length" in why or "length" in why
    area, ratio = Tie("fin.area", 0.1, "heights"), Tie("fin.tip_over_root", 2.0, "tip")
    assert rules(ties=(ratio, area)).refusal(START, {})[0] == "the ties fin.tip_over_root, fin.area"
    stocked = rules(stock=True)
    too_small = "sheet small of 50 x 60 mm is too small for a fin of 80 x 30 mm"
    assert stocked.refusal(START, {"stock": "small"}) == ("the sheets' sizes", too_small)
    assert stocked.judge(START, {"stock": "small"}) == too_small
    assert stocked.refusal(START, {"stock": "any"}) == ("", "")
    limited = rules("fin.length <= 90 mm", "fin.segments < 4")
    not_met = "fin.segments < 4 is not met: 4 < 4 is wrong (fin.segments = 4)"
    assert limited.refusal(START, {}) == ("the condition fin.segments < 4", not_met)
    assert limited.refusal(START, {"fin.segments": 3}) == ("", "")


@pytest.mark.parametrize("name", ["servo.torque", "servo.power"])
def test_what_the_servo_gives_is_that_of_the_joint_that_carries_the_fin(name: str) -> None:
    units = condition_units(0, 3)
    load = rigid_fin_load(FIN, 0.3, 1.0)
    told = {"servo.torque": (load.torque, "N m"), "servo.power": (load.power, "W")}
    number, unit = told[name]
    conditions = (Condition.parse("fin.length < 1 m", units), Condition.parse(f"{name} < 1e-9 {unit}", units))
    for some in (conditions, conditions[1:]):
        why = Rules(conditions=some).refusal({**FIN.as_parameters(), **THREE_JOINTS}, {})[1]
        assert why.endswith(f"({name} = {number:.6g} {unit})")


def test_rules_are_plain_where_arithmetic_of_what_is_searched_is_all() -> None:
    assert is_plain(rules())
    assert is_plain(rules("fin.length <= 90 mm", "fin.height > 1 mm", ties=(Tie("fin.area", 2e-3, "length"),)))
    assert not is_plain(rules("fin.length <= 90 mm", "fin.area < 1 m^2"))
    assert not is_plain(rules("fin.length <= 90 mm", "fin.length ** 2 < 1 m^2"))
    assert not is_plain(rules(stock=True))


LENGTHS = Space((Dimension("fin.length", 0.04, 0.14, "m"),))


def test_a_space_is_judged_by_its_rules_and_many_at_once_where_they_are_plain() -> None:
    plain = rules("fin.length <= 90 mm").applied_to(LENGTHS, START)
    assert plain.dimensions == LENGTHS.dimensions
    assert plain.judge({"fin.length": 0.08}) == ""
    assert "is not met" in plain.judge({"fin.length": 0.1})
    assert plain.judge_many is not None
    powers = rules("fin.length ** 2 <= 0.01 m^2").applied_to(LENGTHS, START)
    assert powers.judge_many is None
    assert "is not met" in powers.judge({"fin.length": 0.11})


def test_a_space_that_holds_none_is_refused_with_what_most_often_stands_in_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rules_module, "_SAMPLES", 20)
    both = rules("fin.length <= 60 mm", "fin.length >= 1 m")
    random = generator(0, 0)
    lengths = [LENGTHS.drawn(random)["fin.length"] for _ in range(20)]
    long, short = ([each for each in lengths if (each > 0.06) is are] for are in (True, False))
    assert len(long) > len(short) > 0
    with pytest.raises(ValueError, match=r"^of 20 candidates drawn from the space none can be: ") as refused:
        both.applied_to(LENGTHS, START)
    first, second = str(refused.value).partition("none can be: ")[2].split("; ")
    assert first.startswith(f"{len(long)} fail the condition fin.length <= 60 mm (")
    assert first.endswith(f"(fin.length = {long[-1]:.6g} m))")
    assert second.startswith(f"{len(short)} fail the condition fin.length >= 1 m (")
    assert second.endswith(f"(fin.length = {short[-1]:.6g} m))")


def test_rules_are_read_as_they_were_written_and_told_by_name() -> None:
    given = rules("fin.length <= 9 cm", "fin.segments < 9", stock=True, ties=(Tie("fin.area", 2e-3, "length"),))
    written = given.written()
    assert written["ties"] == [{"name": "fin.area", "value": 2e-3, "by": "length"}]
    assert written["conditions"] == ["fin.length <= 9 cm", "fin.segments < 9"]
    stored = {**written, "stock": [{**entry, "size": list(entry["size"])} for entry in written["stock"]]}  # type: ignore[attr-defined]
    again = Rules.from_written(stored, 0)
    assert again == given
    assert again.conditions[0].refusal({"fin.length": 0.1}) != ""
    assert given.flat() == {
        "sheet small": SHEETS["small"].told,
        "sheet any": SHEETS["any"].told,
        "tie fin.area": "0.002 m^2, the length following",
        "conditions": "fin.length <= 9 cm; fin.segments < 9",
    }
    assert rules().flat() == {}


def test_the_stock_gives_modulus_thickness_and_density() -> None:
    assert rules(stock=True).given == {"fin.young_modulus", "fin.thickness", "fin.density"}
    assert rules().given == frozenset()
