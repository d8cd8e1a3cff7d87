"""Case files: the reference solver's swims, and what is refused."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fin_sim import case as case_files
from fin_sim.motor import Motor
from fin_sim.swim import swim_chain
from fin_sim.validation import reference

CASES = sorted((Path(__file__).parents[1] / "data" / "cases").glob("*.json"))


SERVO = {"stall_torque": 5e-5, "no_load_speed": 7.0, "gain": 10.0, "derivative_time": 0.02, "time_constant": 0.02}


@pytest.fixture(name="content")
def _content() -> dict[str, Any]:
    path = next(path for path in CASES if path.stem == "free_three_links")
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def test_there_are_seven_cases() -> None:
    assert len(CASES) == 7


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_case_agrees_with_the_reference_solver(path: Path) -> None:
    for name, deviation in reference.compare(path).items():
        # A thousandth of the project's targets: the solvers agree to 1e-6 and better, and a defect should be seen.
        assert deviation <= 1e-3 * reference.TARGETS[name] + 1e-6, name


def test_case_may_stand_alone(content: dict[str, Any]) -> None:
    assert case_files.parse_case(content["case"]) == case_files.parse_case(content)


def test_a_case_may_have_a_current_a_drag_by_amplitude_and_a_servo(content: dict[str, Any]) -> None:
    case = {**content["case"], "oscillating_drag": 8.0, "current_x": 0.02, "current_y": -0.03, "servo": SERVO}
    more = case_files.parse_case({"case": {**case, "duration": 2.0}})
    plain = case_files.parse_case({"case": {**content["case"], "duration": 2.0}})
    water = replace(plain.chain.water, oscillating_drag=8.0, current_x=0.02, current_y=-0.03)
    chain = replace(plain.chain, water=water, motor=Motor(**SERVO))
    assert more.chain == chain
    swum = more.swim()
    again = swim_chain(chain, plain.gait, 2.0, ramp_time=plain.ramp_time)
    assert swum.y[-1] == pytest.approx(again.y[-1], rel=1e-6)
    still = plain.swim()
    assert swum.y[-1] - still.y[-1] == pytest.approx(-0.06, abs=0.02)
    assert np.abs(swum.joint_angles[:, 0]).max() < 0.95 * np.abs(still.joint_angles[:, 0]).max()


def test_trajectory_file_has_the_reference_columns(content: dict[str, Any], tmp_path: Path) -> None:
    swim = case_files.parse_case(content).swim()
    path = tmp_path / "trajectory.csv"
    case_files.write_trajectory(swim, path)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    wanted = next(p for p in CASES if p.stem == "free_three_links").with_suffix(".csv").read_text(encoding="utf-8")
    assert rows[0] == wanted.splitlines()[0].split(",")
    assert len(rows) == len(wanted.splitlines())
    assert float(rows[-1][0]) == 10.0


def test_trajectory_file_is_never_overwritten(content: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "trajectory.csv"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(FileExistsError):
        case_files.write_trajectory(case_files.parse_case(content).swim(), path)
    assert path.read_text(encoding="utf-8") == "mine"


def _with(content: dict[str, Any], *keys: object, value: object) -> dict[str, Any]:
    copy: dict[str, Any] = json.loads(json.dumps(content))
    place: Any = copy["case"]
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    return copy


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("duration",), -1.0, "case duration"),
        (("duration",), float("nan"), "case duration"),
        (("ramp",), "soon", "case ramp"),
        (("rho",), 0.0, "case rho"),
        (("normal_drag",), -1.0, "case normal_drag"),
        (("oscillating_drag",), -1.0, "case oscillating_drag = -1"),
        (("current_x",), "slow", "case current_x"),
        (("current_y",), float("nan"), "case current_y"),
        (("servo",), {"stall_torque": 0.3}, "case servo lacks derivative_time, gain, no_load_speed, time_constant"),
        (("servo",), {**SERVO, "gain": 0.0}, "case servo: servo.gain = 0"),
        (("servo",), {**SERVO, "gian": 1.0}, "case servo has unknown gian"),
        (("reactive",), "none", "reactive"),
        (("clamp",), "loose", "clamp"),
        (("clamp",), {"tow": float("inf")}, "case clamp tow"),
        (("clamp",), {"pull": 1.0}, "case clamp"),
        (("links",), [], "number of links"),
        (("links",), {}, "case links"),
        (("links", 0, "length"), 0.0, "link 1: link length"),
        (("links", 1, "mass_per_area"), float("nan"), "link 2: link mass_per_area"),
        (("links", 2, "colour"), "red", "link 3 has unknown colour"),
        (("body", "mass"), 0.0, "case body: body.mass"),
        (("joints", 0), {"passive": True}, "no joint is driven"),
        (("joints", 1), {}, "joint 2"),
        (("joints", 1), {"passive": False}, "joint 2"),
        (("joints", 0, "drive", "frequency"), -1.0, "joint 1: gait frequency"),
        (("joints",), [{"drive": {"amplitude": 0.1, "frequency": 1.0}}], "driven names 1 joints"),
        (("colour",), "red", "case has unknown colour"),
        (("clamp",), "towed", "does not say how fast"),
        (("duration",), 10**400, "case duration"),
        (("duration",), 1e-320, "case duration"),
        (("links", 0, "profile"), 5, "link 1 profile must be a list"),
        (("links", 0, "profile"), [5], "link 1 profile point 1 must be a distance and a height in m, got 5"),
        (("links", 0, "profile"), [[0.01, 0.02, 1]], r"link 1 profile point 1 .* got \[0\.01, 0\.02, 1\]"),
        (("links", 0, "profile"), [[0.01, "high"]], "link 1 profile height must be a number"),
        (("links", 0, "profile"), [[9.0, 0.02]], "link 1: link profile distance"),
    ],
)
def test_bad_case_is_refused_by_name(
    content: dict[str, Any], keys: tuple[object, ...], value: object, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        case_files.parse_case(_with(content, *keys, value=value))


def test_profile_of_a_link_is_read(content: dict[str, Any]) -> None:
    case = case_files.parse_case(_with(content, "links", 0, "profile", value=[[0.01, 0.02]]))
    assert case.chain.links[0].profile == ((0.01, 0.02),)
    hash(case.chain)


def test_missing_key_is_refused_by_name(content: dict[str, Any]) -> None:
    del content["case"]["rho"]
    with pytest.raises(ValueError, match="case lacks rho"):
        case_files.parse_case(content)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"case": 3}', "\xff"])
def test_file_that_is_no_case_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ValueError, match=r"broken\.json"):
        case_files.read_case(path)


def test_means_of_a_held_swim_need_two_beats(content: dict[str, Any]) -> None:
    short = _with(_with(content, "clamp", value="fixed"), "duration", value=1.0)
    with pytest.raises(ValueError, match="holds less than 2 tail beats"):
        case_files.summary(case_files.parse_case(short).swim())


def test_samples_are_finer_than_rows(content: dict[str, Any]) -> None:
    swim = case_files.parse_case(content).swim()
    assert np.isclose(swim.time[case_files.SAMPLES_A_ROW], 0.05)
