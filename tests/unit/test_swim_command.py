"""The command swim: what it prints and writes, and what it refuses before anything is written."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from fin_plant.fin import Fin
from fin_plant.gait import carangiform
from fin_sim.swim import swim
from fin_sim.swim_command.axes import Axis, parse_axis, varied_plans
from fin_sim.swim_command.command import main as swim_main
from fin_sim.swim_command.plan import SwimPlan
from fin_sim.swim_command.variation import swim_all, swim_one
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fin_sim.chain import Clamp
    from fin_sim.swim import Swim

CASES = Path(__file__).parents[1] / "data" / "cases"
PAPER = Path(__file__).parents[2] / "ros2_ws" / "src" / "fin_sim" / "config" / "clark2012_simulation.yaml"
SHORT = ("--duration", "3")


def _run(capsys: pytest.CaptureFixture[str], *arguments: str | Path, code: int = 0) -> tuple[str, str]:
    assert swim_main([str(argument) for argument in arguments]) == code
    captured = capsys.readouterr()
    return captured.out, captured.err


@pytest.mark.parametrize("path", sorted(CASES.glob("*.json")), ids=lambda path: path.stem)
def test_case_as_json_has_the_reference_figures(capsys: pytest.CaptureFixture[str], path: Path) -> None:
    figures = json.loads(_run(capsys, "--case", path, "--json")[0])
    for name, value in json.loads(path.read_text(encoding="utf-8"))["summary"].items():
        assert figures[name] == pytest.approx(value, rel=1e-3, abs=1e-9)
    assert {"mean_speed", "final_psi"} <= figures.keys()


def test_case_as_csv_has_the_reference_rows(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = CASES / "free_subcarangiform_turn.json"
    _, err = _run(capsys, "--case", path, "--csv", tmp_path / "out.csv")
    files = (tmp_path / "out.csv", path.with_suffix(".csv"))
    got, wanted = (list(csv.reader(file.read_text(encoding="utf-8").splitlines())) for file in files)
    assert got[0] == wanted[0]
    assert len(got) == len(wanted)
    assert [float(x) for x in got[-1][:4]] == pytest.approx([float(x) for x in wanted[-1][:4]], rel=1e-6)
    assert "swim: wrote" in err


def test_one_swim_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = _run(capsys, *SHORT)
    assert f"{100.0 * swim(duration=3.0).mean_speed:.4g}" in out
    assert "Strouhal" in out


def test_json_has_no_infinity(capsys: pytest.CaptureFixture[str]) -> None:
    figures = json.loads(_run(capsys, *SHORT, "--clamp", "fixed", "--json")[0])
    assert figures["strouhal_number"] is None
    assert figures["mean_thrust_last_two_periods"] > 0.0


@pytest.mark.parametrize(("clamp", "speed"), [("fixed", 0.0), ("towed", 0.05)])
def test_means_over_two_periods_are_those_of_the_swim(
    capsys: pytest.CaptureFixture[str], clamp: Clamp, speed: float
) -> None:
    tow = ("--tow_speed", str(speed)) if clamp == "towed" else ()
    figures = json.loads(_run(capsys, "--frequency", "10", "--duration", "2", "--clamp", clamp, *tow, "--json")[0])
    gait = carangiform(math.radians(15.0), 10.0)
    fine = swim(gait=gait, duration=2.0, clamp=clamp, tow_speed=speed, sample_time=2e-4)
    for name, values in (("thrust", fine.convective_force[:, 0]), ("power", fine.servo_power)):
        wanted = fine.mean_between(values, 1.8, 2.0)
        assert figures[f"mean_{name}_last_two_periods"] == pytest.approx(wanted, rel=1e-3)


def test_variation_over_two_numbers_has_a_row_for_each_pair(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = _run(
        capsys, *SHORT, "--vary", "fin.young_modulus=1e8:1e10:3:log", "--vary", "frequency=0.9,1.8", "--csv", "-"
    )
    rows = list(csv.DictReader(io.StringIO(out)))
    assert [float(row["fin.young_modulus [Pa]"]) for row in rows] == pytest.approx([1e8, 1e8, 1e9, 1e9, 1e10, 1e10])
    assert [float(row["frequency [Hz]"]) for row in rows] == [0.9, 1.8] * 3
    assert all(float(row["mean_speed [m/s]"]) > 0.0 for row in rows)


def test_the_first_name_of_an_option_still_holds(capsys: pytest.CaptureFixture[str]) -> None:
    outputs = [_run(capsys, *SHORT, word, "fin.length=0.06,0.08", "--csv", "-")[0] for word in ("--vary", "--sweep")]
    assert outputs[0] == outputs[1]
    assert len(outputs[0].splitlines()) == 3


def test_variation_table_is_printed_whole(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = _run(capsys, *SHORT, "--vary", "fin.length=0.06,0.08")
    assert "fin.length" in out
    assert "0.06" in out
    assert "…" not in out


def test_material_gives_a_range_of_speeds(capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(_run(capsys, *SHORT, "--material", "PP", "--json")[0])
    assert [row["fin.young_modulus"] for row in rows] == [1.07e9, 1.72e9]
    assert rows[0]["mean_speed"] != rows[1]["mean_speed"]


def test_shape_keeps_the_area(capsys: pytest.CaptureFixture[str]) -> None:
    speeds = [
        json.loads(_run(capsys, *SHORT, "--shape", shape, "--json")[0])["mean_speed"]
        for shape in ("rectangular", "flaring", "tapered")
    ]
    assert len(set(speeds)) == 3


def test_sub_carangiform_fish_swims(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = _run(
        capsys, *SHORT, "--gait", "sub_carangiform", "--peduncle.length", "0.03", "--peduncle.root_height", "0.05",
        "--peduncle.tip_height", "0.035", "--peduncle.mass_per_area", "20", "--json"
    )  # fmt: skip
    assert json.loads(out)["mean_speed"] > 0.0


def test_parameters_come_from_the_nodes_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "fish.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    fin.young_modulus: 2.0e9\n    body: {drag_area: 0.005}\n    speed: 0.0\n",
        encoding="utf-8",
    )
    from_file = json.loads(_run(capsys, *SHORT, "--params-file", file, "--json")[0])
    given = json.loads(_run(capsys, *SHORT, "--fin.young_modulus", "2e9", "--body.drag_area", "5e-3", "--json")[0])
    assert from_file == given


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/**: {ros__parameters: {fin.lenght: 0.07}}", "fin.lenght is not a parameter: did you mean fin.length"),
        ("simulator: {ros__parameters: {body: {masss: 0.2}}}", "body.masss is not a parameter: did you mean body.mass"),
        ("optimizer: {ros__parameters: {trials: 3}}", "has parameters of optimizer only"),
        ("/**: {ros__parameters: {fin.segments: many}}", "fin.segments = 'many' must be a whole number"),
        ("/**: {ros__parameters: {step: short}}", "step = 'short' must be a number"),
        ("/**: {ros__parameters: {peduncle.length: [long]}}", "must be a number"),
        ("/**: {ros__parameters: {peduncle.length: 3}}", "must be a list"),
    ],
)
def test_parameter_file_with_a_mistake_is_refused_by_name(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "fish.yaml"
    file.write_text(text, encoding="utf-8")
    _, err = _run(capsys, "--params-file", file, code=2)
    assert "fish.yaml" in err
    assert message in err


def test_parameter_file_may_hold_what_only_the_node_has_and_other_nodes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "fish.yaml"
    file.write_text(
        "/**: {ros__parameters: {use_sim_time: false}}\n"
        "/fish/simulator: {ros__parameters: {sample_rate: 100.0, limits.sweep: 0.2, step: 2e-3, fin.length: 7e-2}}\n"
        "/fish/optimizer: {ros__parameters: {trials: 3}}\n",
        encoding="utf-8",
    )
    from_file = json.loads(_run(capsys, *SHORT, "--params-file", file, "--json")[0])
    assert from_file == json.loads(_run(capsys, *SHORT, "--step", "2e-3", "--fin.length", "0.07", "--json")[0])


def test_folder_that_cannot_be_written_to_is_refused_before_the_swim(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)
    assert "cannot be written to" in _run(capsys, "--csv", tmp_path / "out.csv", code=2)[1]


def test_pictures_are_written_and_a_replaced_file_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plot, movie = tmp_path / "swim.png", tmp_path / "swim.gif"
    plot.write_text("old", encoding="utf-8")
    _, err = _run(capsys, "--duration", "0.4", "--plot", plot, "--animate", movie)
    assert f"swim: replaced {plot}" in err
    assert f"swim: wrote {movie}" in err
    with Image.open(plot) as picture:
        assert picture.size[0] >= 1000
    with Image.open(movie) as picture:
        assert getattr(picture, "n_frames", 0) == 10
    assert sorted(path.name for path in tmp_path.iterdir()) == ["swim.gif", "swim.png"]


def test_variation_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    _run(capsys, *SHORT, "--vary", "fin.young_modulus=1e8,1e9", "--plot", tmp_path / "swims.png")
    assert (tmp_path / "swims.png").stat().st_size > 10_000


def test_csv_and_json_tell_the_units(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = _run(capsys, *SHORT, "--csv", "-")
    assert out.splitlines()[0].startswith("t [s],x [m],y [m],psi [rad],theta0 [rad],")
    assert json.loads(_run(capsys, *SHORT, "--json")[0])["units"]["mean_speed"] == "m/s"
    variation = (*SHORT, "--vary", "fin.young_modulus=1e9,2e9")
    row = next(csv.DictReader(io.StringIO(_run(capsys, *variation, "--csv", "-")[0])))
    assert {"fin.young_modulus [Pa]", "mean_speed [m/s]", "mean_servo_power [W]", "strouhal_number"} <= row.keys()
    assert float(row["mean_speed [m/s]"]) == pytest.approx(swim(Fin(young_modulus=1e9), duration=3.0).mean_speed)
    assert json.loads(_run(capsys, *variation, "--json")[0])[0]["units"]["fin.young_modulus"] == "Pa"


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_a_picture_can_be_pdf_or_svg(capsys: pytest.CaptureFixture[str], tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"swim.{kind}"
    _run(capsys, *SHORT, "--plot", path)
    assert {"pdf": b"%PDF", "svg": b"<svg"}[kind] in path.read_bytes()[:2000]


def _drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the list that each figure is put into when it is saved."""
    drawn: list[Figure] = []

    def save(figure: Figure, path: Path, **_: float) -> None:
        drawn.append(figure)
        path.touch()

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)
    return drawn


def test_the_heading_of_a_picture_says_which_fin_swims_how(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = _drawn(monkeypatch)
    profile = ("--fin.profile_position", "0.5", "--fin.profile_height", "0.04", "--amplitude", "20")
    _run(capsys, *SHORT, *profile, "--plot", tmp_path / "swim.png")
    _run(capsys, *SHORT, "--vary", "fin.length=0.06,0.08", "--plot", tmp_path / "swims.png")
    assert [figure.get_suptitle() for figure in drawn] == [
        (
            "fin 8 cm long, 2.5-4-2.5 cm high, 0.208 mm thick, E 2 GPa; "
            "carangiform 20\N{DEGREE SIGN} 0.9 Hz; swims of 3 s"
        ),
        "fin 2.5 cm high, 0.208 mm thick, E 2 GPa; carangiform 15\N{DEGREE SIGN} 0.9 Hz; swims of 3 s",
    ]


def test_many_values_of_a_second_number_are_a_map_with_the_fastest_swim_marked(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = _drawn(monkeypatch)
    lengths = "fin.length=0.05:0.12:8"
    out, _ = _run(
        capsys, *SHORT, "--vary", "fin.young_modulus=1e8,1e9,1e10", "--vary", lengths, "--plot",
        tmp_path / "map.png", "--json",
    )  # fmt: skip
    rows = json.loads(out)
    fastest = max(rows, key=lambda row: row["mean_speed"])
    panel = drawn[0].axes[0]
    assert panel.get_legend() is None
    (mesh,) = panel.collections
    speeds = np.asarray(mesh.get_array())
    assert speeds.shape == (8, 3)
    assert speeds.max() == pytest.approx(100.0 * fastest["mean_speed"])
    (mark,) = panel.lines
    assert np.asarray(mark.get_xydata()).tolist() == [[fastest["fin.young_modulus"], fastest["fin.length"]]]


def test_a_variation_shows_the_units_of_its_numbers(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = _drawn(monkeypatch)
    arguments = (*SHORT, "--vary", "fin.young_modulus=1e9,2e9", "--vary", "frequency=0.9,1.8")
    out, _ = _run(capsys, *arguments, "--plot", tmp_path / "swims.png")
    names, units = (line.replace("┃", " ").split() for line in out.splitlines()[1:3])
    assert (names[:2], units[:2]) == (["fin.young_modulus", "frequency"], ["Pa", "Hz"])
    panel = drawn[0].axes[0]
    assert panel.get_xlabel() == "fin.young_modulus, Pa"
    legend = panel.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["frequency = 0.9 Hz", "frequency = 1.8 Hz"]
    assert Axis("fin.segments", (2.0, 3.0)).unit == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--fin.length", "-1"), "fin.length = -1 m"),
        (("--fin.length", "nan"), "fin.length = nan"),
        (("--fin.length", "long"), "fin.length = 'long'"),
        (("--fin.hinges", "none"), "fin.hinges = 'none'"),
        (("--fin.segments", "2.5"), "fin.segments = 2.5"),
        (("--duration", "0"), "duration = 0 s"),
        (("--amplitude", "200"), "amplitude = 200 degrees"),
        (("--frequency", "-1"), "gait frequency = -1 Hz"),
        (("--gait", "sub_carangiform"), "driven joints of a sub-carangiform gait"),
        (("--material", "wood"), "material 'wood'"),
        (("--material", "DM8510"), "No modulus"),
        (("--material", "PP", "--fin.young_modulus", "1e9"), "leave one of them out"),
        (("--vary", "fin.colour=1,2"), "fin.colour is not a parameter"),
        (("--vary", "fin.hinges=1,2"), "fin.hinges = '1' is not known"),
        (("--vary", "frequency=1:2"), "FIRST:LAST:COUNT"),
        (("--vary", "frequency=0:2:3:log"), "values above 0"),
        (("--vary", "frequency=1:2:3", "--vary", "frequency=1:2:3"), "one or two different numbers"),
        (("--vary", "frequency=1:2:1e6"), "count = 1e+06"),
        (("--vary", "fin.length=0.08,9"), "fin.length = 9 m"),
        (("--case", "nothing.json"), "nothing.json"),
        (("--case", str(CASES / "plate_fixed.json"), "--duration", "3"), "leave out --duration"),
        (("--case", str(CASES / "plate_fixed.json"), "--vary", "frequency=1,2"), "leave out --vary"),
        (("--params-file", str(CASES / "plate_fixed.csv")), "not a ROS parameter file"),
        (("--servo.backlash", "0.1"), "servo.lag = 0 s"),
        (("--plot", "swim.jpg"), "must end in .png, .pdf or .svg"),
        (("--animate", "swim.avi"), "must end in .gif or .mp4"),
        (("--csv", "-", "--json"), "give the CSV a file"),
        (("--vary", "frequency=1,2", "--animate", "swim.gif"), "--animate shows one swim"),
        (("--csv", "nowhere/out.csv"), "its folder does not exist"),
        (("--csv", "a.png", "--plot", "./a.png"), "go to the same file"),
        (("--tow_speed", "0.03"), "tow_speed is that of a towed body, this one is free"),
        (("--clamp", "fixed", "--vary", "tow_speed=0.01,0.02"), "tow_speed is that of a towed body"),
        (("--material", "PP", "--fin.density", "900"), "--material gives fin.density"),
        (("--material", "PP", "--params-file", str(PAPER)), "--material gives fin.young_modulus"),
        (("--material", "PP", "--vary", "fin.density=900,1000"), "--material gives fin.density"),
        (("--case", str(CASES / "plate_fixed.json"), "--step", "0"), "step = 0 s"),
        (("--case", str(CASES / "plate_fixed.json"), "--params-file", str(PAPER)), "leave out --params-file"),
        (("--frequency", "0"), "frequency = 0 Hz"),
        (("--vary", "frequency=0,1"), "frequency = 0 Hz"),
        (("--duration", "1e5"), "duration = 100000 s in steps of step = 0.001 s"),
        (("--step", "1e-7"), "duration = 10 s in steps of step = 1e-07 s"),
        (("--gait", "sub_carangiform"), "peduncle.length, peduncle.root_height"),
        (("--vary", "duration=1,2"), "duration is not a parameter that can vary"),
        (("--fin.segments", "abc"), "fin.segments = 'abc' must be a whole number: allowed is [1, 20]"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    extra = () if "--csv" in arguments else ("--csv", "out.csv")
    out, err = _run(capsys, *arguments, *extra, code=2)
    assert out == ""
    assert err.startswith("swim: error: ")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        swim_main(["--fin.lenght", "1"])
    assert stop.value.code == 2
    assert "--fin.lenght" in capsys.readouterr().err


def test_a_parameter_of_the_node_alone_is_no_option(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        swim_main(["--help"])
    shown = capsys.readouterr().out
    assert "--fin.young_modulus" in shown
    for name in ("publish_clock", "speed", "sample_rate"):
        assert f"--{name} " not in shown
    file = tmp_path / "node.yaml"  # which may set it all the same
    file.write_text("/**: {ros__parameters: {publish_clock: false}}", encoding="utf-8")
    assert "mean speed" in _run(capsys, *SHORT, "--params-file", file)[0]


def test_film_without_ffmpeg_is_refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    assert "MP4 needs the program ffmpeg" in _run(capsys, "--animate", "swim.mp4", code=2)[1]


def test_swim_that_diverges_ends_with_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)

    def diverge(_: SwimPlan) -> None:
        raise StepError(0.5)

    monkeypatch.setattr(SwimPlan, "swim", diverge)
    _, err = _run(capsys, "--csv", "out.csv", code=1)
    assert "use a shorter step" in err
    assert list(tmp_path.iterdir()) == []


def test_variation_leaves_a_gap_for_a_swim_that_diverges(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    swum = SwimPlan.swim

    def diverge(plan: SwimPlan) -> Swim:
        if plan.frequency == 1.0:
            raise StepError(0.5)
        return swum(plan)

    monkeypatch.setattr(SwimPlan, "swim", diverge)
    file = tmp_path / "table.csv"
    arguments = (*SHORT, "--vary", "frequency=0.9,1,1.1", "--csv", file, "--plot", tmp_path / "swims.png")
    _, err = _run(capsys, *arguments, code=1)
    rows = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))
    assert [row["frequency [Hz]"] for row in rows] == ["0.9", "1.0", "1.1"]
    assert [bool(row["mean_speed [m/s]"]) for row in rows] == [True, False, True]
    assert "frequency = 1: the state stopped being finite" in err
    assert (tmp_path / "swims.png").is_file()


def test_the_swims_of_a_variation_come_in_order_and_are_those_that_swim_alone() -> None:
    plans = [SwimPlan({}, duration=0.3, frequency=frequency) for frequency in (3.0, 0.9, 2.0, 1.0, 5.0)]
    with swim_all(plans, cores=3) as swims:
        assert list(swims) == [swim_one(plan) for plan in plans]


def test_interrupted_variation_keeps_its_rows(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    swum = SwimPlan.swim

    def interrupt(plan: SwimPlan) -> Swim:
        if plan.frequency == 1.0:
            raise KeyboardInterrupt
        return swum(plan)

    monkeypatch.setattr(SwimPlan, "swim", interrupt)
    file = tmp_path / "table.csv"
    _, err = _run(capsys, *SHORT, "--vary", "frequency=0.9,1,1.1", "--csv", file, code=130)
    rows = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))
    assert [row["frequency [Hz]"] for row in rows] == ["0.9"]
    assert "stopped after 1 of 3 swims" in err


def test_interrupted_swim_ends_quietly(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: SwimPlan) -> Swim:
        raise KeyboardInterrupt

    monkeypatch.setattr(SwimPlan, "swim", interrupt)
    assert _run(capsys, code=130) == ("", "")


def test_swim_within_its_ramp_shows_no_servo_torque(capsys: pytest.CaptureFixture[str]) -> None:
    assert json.loads(_run(capsys, "--duration", "0.005", "--json")[0])["largest_servo_torque"] is None


def test_variation_spaces_its_values() -> None:
    assert parse_axis("frequency=1:2:3").values == (1.0, 1.5, 2.0)
    assert parse_axis("fin.length=0.05,0.1").values == (0.05, 0.1)
    plans = varied_plans(SwimPlan({}), [parse_axis("amplitude=10,20")])
    assert [plan.amplitude for _, plan in plans] == [10.0, 20.0]
    assert math.degrees(plans[1][1].drive(1).joints[0].amplitude) == pytest.approx(20.0)


def test_a_picture_that_fails_costs_one_warning_and_no_number(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(*_: object, **__: object) -> None:
        msg = "latex could not be found"
        raise RuntimeError(msg)

    plain, _ = _run(capsys, *SHORT)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", refuse)
    out, err = _run(capsys, *SHORT, "--plot", tmp_path / "swim.png")
    assert out == plain
    warning = f"swim: warning: the picture {tmp_path / 'swim.png'} could not be drawn: latex could not be found"
    assert err.splitlines() == [warning]
    assert not list(tmp_path.iterdir())
