"""What a study can look for: the table of measures, goals and constraints by name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from fin_optimizer.goals import (
    MEASURES,
    OF_OBJECTIVE,
    VELOCITY,
    YAW_RATE,
    Constraint,
    Goals,
)
from fin_plant.plant_state import SERVO_TORQUE, THRUST
from fin_plant.units import unit_of


@pytest.mark.parametrize("name", MEASURES)
def test_a_measure_can_be_written_as_its_example_says(name: str) -> None:
    of = MEASURES[name]
    limit = Constraint.parse(f"{name} <= {of.example}").limit
    assert of.minimum < limit < of.maximum
    assert of.shown(limit).split()[0] == f"{limit / of.shown_in[1]:#.4g}"
    unit = of.shown_in[0]
    assert unit == "%" or unit_of(unit)[1] == unit_of(of.unit)[1]
    assert unit == "%" or unit_of(unit)[0] == pytest.approx(of.shown_in[1])
    assert set(of.needs) <= {VELOCITY, YAW_RATE, SERVO_TORQUE, THRUST}
    assert of.needs


def test_the_objectives_of_before_are_short_for_goals() -> None:
    assert [Goals.of(names).asked for names in OF_OBJECTIVE.values()] == [
        (MEASURES["mean_speed"],),
        (MEASURES["mean_speed"], MEASURES["energy_per_metre"]),
    ]
    assert MEASURES["mean_speed"].column == "speed [m/s]"
    assert MEASURES["energy_per_metre"].label == "energy per metre (J/m)"
    assert MEASURES["efficiency"].column == "efficiency"


def test_more_of_an_objective_is_better_and_an_excess_above_zero_is_a_miss() -> None:
    goals = Goals.of(["efficiency", "power"], ["mean_speed >= 2 cm/s", "power <= 500 mW", "efficiency >= 30 %"])
    measured = {"mean_speed": 0.01, "power": 0.6, "efficiency": 0.33}
    assert goals.objectives(measured) == (0.33, -0.6)
    assert goals.excesses(measured) == pytest.approx((0.5, 0.2, -0.1))
    assert goals.missed(measured) == [
        "mean_speed >= 2 cm/s is missed: 1.000 cm/s",
        "power <= 500 mW is missed: 600.0 mW",
    ]
    swims = {name: np.array([value, 2.0 * value]) for name, value in measured.items()}
    assert goals.excesses(swims)[0] == pytest.approx([0.5, 0.0])
    assert goals.objectives(swims)[1].tolist() == [-0.6, -1.2]


def test_a_limit_that_is_reached_is_met_and_one_of_nothing_counts_by_its_amount() -> None:
    assert Constraint.parse("mean_speed>=2 cm/s").missed(0.02) == ""
    assert Constraint.parse("  mean_speed   >=  0 ").excess(-0.25) == 0.25
    assert Constraint.parse("turning_rate <= 10 deg/s").limit == pytest.approx(math.radians(10.0))
    assert Constraint.parse("servo_torque <= 0.2 N m").limit == 0.2
    assert Constraint.parse("efficiency >= 0.3").limit == 0.3


def test_the_mean_speed_is_always_asked_for_and_a_plant_says_what_it_cannot_tell() -> None:
    goals = Goals.of(["efficiency"], ["turning_radius <= 30 cm"])
    assert [each.name for each in goals.asked] == ["mean_speed", "efficiency", "turning_radius"]
    assert goals.needs == {VELOCITY, YAW_RATE, SERVO_TORQUE, THRUST}
    assert goals.cannot_be_told(goals.needs, "simulator") == ""
    assert goals.cannot_be_told({VELOCITY, YAW_RATE}, "servo_driver") == (
        "servo_driver cannot tell what the study is about: efficiency needs torque in joint_states and thrust. It can "
        "tell mean_speed, steady_speed, turning_rate, turning_radius"
    )


@pytest.mark.parametrize(
    ("names", "constraints", "message"),
    [
        (["efficency"], [], "'efficency' is no measure of a swim: did you mean efficiency?"),
        (["zeal"], [], "there are mean_speed, steady_speed, energy_per_metre"),
        ([], [], "needs one goal or several, each once, got \\[\\]"),
        (["power", "power"], [], "each once"),
        (["power"], ["mean_sped >= 2 cm/s"], "constraint 'mean_sped >= 2 cm/s': .*did you mean mean_speed"),
        (["power"], ["mean_speed >= 2 cm"], "another kind of unit: it is in m/s"),
        (["power"], ["power <= 0.5 J"], "another kind of unit: it is in W"),
        (["power"], ["mean_speed >= 2"], "its limit 2 has no unit: write for example 2 cm/s"),
        (["power"], ["mean_speed >= 30 %"], "mean_speed = '30 %' is no number with a unit"),
        (["power"], ["mean_speed >= 20 m/s"], "limit of mean_speed = 20 m/s"),
        (["power"], ["efficiency >= 30"], "limit of efficiency = 30"),
        (["power"], ["efficiency >= nan"], "is no number"),
        (["power"], ["mean_speed > 2 cm/s"], "cannot be read"),
        (["power"], ["2 cm/s <= mean_speed"], "cannot be read"),
        (["power"], [""], "cannot be read"),
        (["power"], ["mean_speed >= 3 cm/s", "mean_speed <= 20 mm/s"], "contradict each other: no swim meets both"),
        (["power"], ["mean_speed <= 2 cm/s", "mean_speed >= 2 cm/s"], "contradict"),
        (["power"], ["mean_speed >= 3 cm/s", "mean_speed >= 2 cm/s"], "limit the same"),
    ],
)
def test_what_cannot_be_meant_is_refused(names: list[str], constraints: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Goals.of(names, constraints)


def test_two_limits_of_one_measure_make_a_range() -> None:
    goals = Goals.of(["power"], ["mean_speed >= 2 cm/s", "mean_speed <= 3 cm/s"])
    assert [each.limit for each in goals.constraints] == [0.02, 0.03]


def test_the_page_shows_every_measure_as_the_table_has_it() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "trials.md").read_text(encoding="utf-8")
    for of in MEASURES.values():
        good = "large" if of.direction > 0 else "small"
        row = [f"`{of.name}`", of.meaning.rstrip("."), of.unit or "1", good, ", ".join(of.needs)]
        assert f"| {' | '.join(row)} |" in page


def test_an_objective_is_one_text_by_which_it_is_read_again() -> None:
    assert Goals.of_objective("speed") == Goals.of(["mean_speed"]) == Goals()
    assert Goals.of_objective("speed_and_cost_of_transport") == Goals.of(["mean_speed", "energy_per_metre"])
    assert Goals.of_objective(" power , thrust").measures == (MEASURES["power"], MEASURES["thrust"])
    texts = ("speed", "speed_and_cost_of_transport", "efficiency", "power, thrust", "energy_per_metre, mean_speed")
    for text in texts:
        assert Goals.of_objective(text).objective == text
    assert Goals.of_objective("mean_speed").objective == "speed", "as older versions know it"
    assert Goals.of_objective("mean_speed,energy_per_metre").objective == "speed_and_cost_of_transport"


def test_a_measure_is_labelled_with_its_unit_in_si_and_in_that_of_a_laboratory() -> None:
    assert [MEASURES[name].label for name in ("mean_speed", "steady_speed", "efficiency")] == [
        "mean forward speed (m/s)",
        "steady speed (m/s)",
        "efficiency",
    ]
    assert [MEASURES[name].axis for name in ("mean_speed", "power", "efficiency")] == [
        "mean forward speed (cm/s)",
        "power (mW)",
        "efficiency (%)",
    ]
    assert Goals.of(["mean_speed", "turning_radius"]).shown({"mean_speed": 0.02, "turning_radius": 0.3}) == (
        "2.000 cm/s, 30.00 cm"
    )


def test_the_two_nearest_names_are_offered() -> None:
    with pytest.raises(ValueError, match=r"did you mean mean_speed or steady_speed\?$"):
        Goals.of(["ener_speed"])


def test_limits_that_contradict_each_other_are_told_the_lower_one_first() -> None:
    for limits in (["power >= 2 W", "power <= 1 W"], ["power <= 1 W", "power >= 2 W"]):
        with pytest.raises(ValueError, match=r"constraints 'power >= 2 W' and 'power <= 1 W' contradict"):
            Goals.of(["mean_speed"], limits)
    assert len(Goals.of(["mean_speed"], ["power <= 2 W", "power >= 1 W"]).constraints) == 2
