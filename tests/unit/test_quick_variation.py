"""A quick variation: the figures of the same swims swum one by one, within the batch's tolerances."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_sim.batch import TOLERANCES
from fin_sim.swim_command.axes import Axis, varied_plans
from fin_sim.swim_command.command import main as swim_main
from fin_sim.swim_command.plan import SwimPlan
from fin_sim.swim_command.quick_variation import quick_figures, swim_quickly
from fin_sim.swim_command.variation import swim_one

if TYPE_CHECKING:
    from pathlib import Path

    from fin_plant.parameters import Value

TOLERANCE = {
    "mean_speed": TOLERANCES["mean_speed"],
    "mean_thrust": TOLERANCES["thrust"],
    "mean_servo_power": TOLERANCES["servo_power"],
    # A quotient's error is at most the sum of its parts': thrust, forward speed and power.
    "efficiency": TOLERANCES["thrust"] + TOLERANCES["mean_forward_speed"] + TOLERANCES["servo_power"],
    # Not promised by the batch: its largest of fewer samples, so up to 1 - cos(pi / 56) less, half a step off the top.
    "largest_hinge_angle": 5e-3,
}


def command(capsys: pytest.CaptureFixture[str], *arguments: str | Path, code: int = 0) -> tuple[str, str]:
    """Return what the command puts out."""
    assert swim_main([str(argument) for argument in arguments]) == code
    captured = capsys.readouterr()
    return captured.out, captured.err


def random_plans(seed: int, count: int) -> list[SwimPlan]:
    """Return plans of fins and gaits near a laboratory's, of three links each, which is one code to compile."""
    random = np.random.default_rng(seed)
    plans = []
    for _ in range(count):
        values: dict[str, Value] = {
            "fin.young_modulus": float(10.0 ** random.uniform(8.5, 10.0)),
            "fin.length": float(random.uniform(0.05, 0.12)),
            "fin.tip_height": float(random.uniform(0.026, 0.05)),
        }
        amplitude, frequency = float(random.uniform(8.0, 20.0)), float(random.uniform(0.7, 2.0))
        plans.append(SwimPlan(values, amplitude=amplitude, frequency=frequency, duration=6.0))
    return plans


@pytest.mark.parametrize("clamp", ["free", "towed"])
def test_random_plans_have_the_figures_of_single_swims(clamp: str) -> None:
    changed = {"clamp": clamp, "tow_speed": 0.03 if clamp == "towed" else 0.0}
    plans = [replace(plan, **changed) for plan in random_plans(3, 20)]  # type: ignore[arg-type]
    with swim_quickly(plans, cores=2) as outcomes:
        quick = list(outcomes)
    assert not any(swum.failure for swum in quick)
    for plan, swum in zip(plans, quick, strict=True):
        single = swim_one(plan)
        assert swum.figures.keys() == {figure.name for figure in quick_figures(plan)}
        assert list(swum.warnings) == list(single.warnings)
        for name, value in swum.figures.items():
            assert value == pytest.approx(single.figures[name], rel=TOLERANCE[name]), (name, plan)


def test_outcomes_come_in_the_order_of_the_plans_whichever_axis_varies_first() -> None:
    fin, gait = Axis("fin.young_modulus", (8e8, 2e9)), Axis("frequency", (0.9, 1.2, 1.5))
    for axes in ([fin, gait], [gait, fin]):
        plans = [plan for _, plan in varied_plans(SwimPlan({}, duration=2.0), axes)]
        with swim_quickly(plans, cores=2) as outcomes:
            got = [swum.figures["mean_speed"] for swum in outcomes]
        assert got == pytest.approx([swim_one(plan).figures["mean_speed"] for plan in plans], rel=1e-3)


def test_a_quick_variation_puts_out_the_columns_that_it_has(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    variation = ("--quick", "--duration", "2", "--vary", "fin.young_modulus=8e8,2e9")
    file, picture = tmp_path / "swims.csv", tmp_path / "swims.png"
    out, _ = command(capsys, *variation, "--json", "--csv", file, "--plot", picture)
    rows = json.loads(out)
    assert rows[0].keys() == {"fin.young_modulus", "mean_speed", "mean_servo_power", "largest_hinge_angle", "units"}
    assert rows[0]["units"].keys() == rows[0].keys() - {"units"}
    table = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))
    assert [float(row["mean_speed [m/s]"]) for row in table] == [row["mean_speed"] for row in rows]
    assert "steady_speed [m/s]" not in table[0]
    assert picture.is_file()
    table_text, _ = command(capsys, *variation)
    assert "hinge angle" in table_text
    assert "steady" not in table_text
    towed, _ = command(capsys, *variation, "--clamp", "towed", "--tow_speed", "0.03", "--json")
    assert {"mean_thrust", "efficiency"} <= json.loads(towed)[0].keys()


def test_a_fin_that_folds_is_told_as_in_any_variation(capsys: pytest.CaptureFixture[str]) -> None:
    variation = ("--fin.young_modulus", "1e7", "--frequency", "10", "--vary", "amplitude=15,172", "--duration", "2")
    told = [command(capsys, *variation, *more, code=1)[1] for more in ((), ("--quick",))]
    for err in told:
        assert "amplitude = 172: a hinge of the fin bent by" in err


def test_steady_figures_of_a_swim_without_a_whole_beat_are_gaps() -> None:
    with swim_quickly([SwimPlan({}, duration=0.8)]) as outcomes:
        (swum,) = outcomes
    assert swum.figures["mean_speed"] is not None
    assert swum.figures["mean_servo_power"] is None
    assert not swum.failure


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--vary", "frequency=1,2", "--servo.lag", "0.02"), "servo.lag = 0.02 s"),
        (("--vary", "servo.lag=0,0.02"), "servo.lag = 0.02 s"),
        (("--vary", "frequency=1,2", "--step", "0.001"), "leave out --step"),
        ((), "add --vary"),
    ],
)
def test_what_cannot_swim_quickly_is_refused_by_name(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    out, err = command(capsys, "--quick", *arguments, code=2)
    assert told in err
    assert not out


@pytest.mark.parametrize(("options", "told"), [((), ""), (("--step", "0.001"), "--step and ")])
def test_a_step_of_a_parameter_file_is_refused_as_the_option_is(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, options: tuple[str, ...], told: str
) -> None:
    file = tmp_path / "fish.yaml"
    file.write_text("simulator:\n  ros__parameters:\n    fin.length: 0.07\n    step: 1.0e-4\n", encoding="utf-8")
    quick = ("--quick", "--vary", "frequency=1,2", "--duration", "0.3", "--params-file", file)
    out, err = command(capsys, *quick, *options, code=2)
    assert err.endswith(f"leave out {told}step in {file}\n")
    assert not out
    file.write_text(file.read_text(encoding="utf-8").partition("    step")[0], encoding="utf-8")
    command(capsys, *quick)


def test_a_large_variation_says_that_there_is_a_quick_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fin_sim.swim_command.command._MANY_SWIMS", 2)
    for count, hinted in ((2, False), (3, True)):
        _, err = command(capsys, "--duration", "0.3", "--vary", f"frequency=1:2:{count}")
        assert ("--quick" in err) == hinted
