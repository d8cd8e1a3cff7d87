"""A fish learnt from swims: recovered where it is known, refused where the swims cannot be right."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.calibration import errors as judged
from fin_optimizer.calibration import recorded
from fin_optimizer.calibration.cloud_prior import around
from fin_optimizer.calibration.fish_file import fish_file, read_errors, read_fish
from fin_optimizer.calibration.fit import Fit, _Problem, fit, refit
from fin_optimizer.calibration.model import Tank, model_of
from fin_optimizer.calibration.prediction import predict
from fin_optimizer.calibration.recorded import read_folder, read_swim_of_bag
from fin_optimizer.calibration.settings import GAIN_LEFT, Fitted, Settings, read_settings
from fin_optimizer.calibration.swims import Swim, SwimError, beat_frequency, read_csv, swim_of, usable
from fin_optimizer.commands import calibrate as calibrate_command
from fin_optimizer.commands import predict as predict_command
from fin_optimizer.search import plausible
from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive
from fin_plant.paths import config_folder
from fin_sim.swim import swim as simulated_swim
from fin_sim.swim_command.command import main as swim_main

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_optimizer.bags.reader import Bag

DATA = Path(__file__).parents[2] / "tests" / "data"
SWIMS = DATA / "tail_actuated_fish_swims"
CONFIG = config_folder("fin_optimizer")
SETTINGS = read_settings(CONFIG / "calibrate_tail_actuated_fish.yaml")
FITTED = CONFIG / "fitted_tail_actuated_fish.yaml"
ONE = SWIMS / "amplitude30_bias+30_run1.csv"
RANDOM = np.random.default_rng

LEARNT = ("body.drag_area", "body.lift_area", "body.yaw_drag", GAIN_LEFT, "drive.bias_offset")
FEW = replace(SETTINGS, fitted=tuple(each for each in SETTINGS.fitted if each.name in LEARNT), factor_spread=0.0)
"""Five parameters, so that a fit takes a second."""


def synthetic(
    settings: Settings, coordinates: np.ndarray, random: np.random.Generator, seconds: float = 6.0
) -> list[Swim]:
    """Return nine swims of a known fish, with the noise of a tracker."""
    biases = tuple(math.radians(each) for each in (-40.0, 0.0, 40.0))
    tank = Tank(model_of(settings, coordinates, biases, (0.95,) * 3))
    time = np.arange(0.0, seconds, 0.075)
    swims = []
    for amplitude in (15.0, 22.0, 30.0):
        for bias in biases:
            blank = np.zeros_like(time)
            swim = Swim("", math.radians(amplitude), bias, 0.95, time, blank, blank, blank, blank)
            start = np.array([0.02, 0.0, 0.0, random.uniform(-math.pi, math.pi)])
            x, y, heading, surge, sway, rate = tank.swim(swim, start, time).T
            clean = {"forward": surge, "lateral": sway, "yaw_rate": rate, "heading": heading}
            noise = {"forward": 0.003, "lateral": 0.003, "yaw_rate": 0.05, "heading": 0.02}
            noisy = {name: clean[name] + noise[name] * random.standard_normal(len(time)) for name in clean}
            position = np.stack((x, y), axis=1) + 0.002 * random.standard_normal((len(time), 2))
            name = f"{amplitude:g} degrees, bias {bias:.2f}"
            swims.append(replace(swim, name=name, position=position, **noisy))
    return swims


def hidden(settings: Settings, random: np.random.Generator) -> np.ndarray:
    """Return the coordinates of a fish as the prior has them."""
    prior = np.array([each.coordinate(each.prior) for each in settings.fitted])
    spread = np.array([each.spread for each in settings.fitted])
    return np.asarray(prior + 0.4 * spread * np.clip(random.standard_normal(len(prior)), -2.0, 2.0))


def distances(found: Fit, settings: Settings, truth: np.ndarray) -> np.ndarray:
    """Return how many stated errors lie between what was found and what is true."""
    rows = zip(settings.fitted, found.values, found.low, found.high, truth, strict=True)
    return np.array(
        [
            (each.coordinate(value) - true) / (0.5 * (each.coordinate(high) - each.coordinate(low)))
            for each, value, low, high, true in rows
        ]
    )


def test_a_synthetic_fish_is_recovered_within_its_stated_errors() -> None:
    random = RANDOM(5)
    truth = hidden(FEW, random)
    swims = synthetic(FEW, truth, random)
    found = fit(swims, FEW, starts=1)
    assert np.all(np.abs(distances(found, FEW, truth)) < 3.0)
    drag = found.names.index("body.drag_area")
    assert found.high[drag] / found.low[drag] < 1.5, "nine swims tell the drag area to a quarter"
    predicted = [judged.errors(swim, predict(Tank(found.model), swim)) for swim in swims]
    assert float(np.median([each.speed for each in predicted if each.speed is not None])) < 0.02


@pytest.mark.long
@pytest.mark.timeout(1500)
def test_stated_errors_cover_the_truth_of_fifty_synthetic_fish() -> None:
    apart = []
    for seed in range(50):
        random = RANDOM(100 + seed)
        truth = hidden(FEW, random)
        apart.append(distances(fit(synthetic(FEW, truth, random), FEW, starts=1), FEW, truth))
    within = [float(np.mean(np.abs(apart) < limit)) for limit in (1.0, 2.0)]
    # 250 numbers: of right errors 68 and 95 % lie within one and two, give or take 5 and 3 %.
    assert 0.55 < within[0] < 0.85, within
    assert within[1] > 0.88, within


def test_swims_that_turn_against_their_biases_are_named() -> None:
    swims = synthetic(FEW, hidden(FEW, RANDOM(7)), RANDOM(7))
    assert len(usable(swims, 0.95)[0]) == len(swims)
    mirrored = [replace(swim, bias=-swim.bias) for swim in swims]
    with pytest.raises(SwimError, match=r"the fish turns to the (left|right) under a bias (above|below) 0"):
        usable(mirrored, 0.95)


def test_a_fish_that_was_fitted_survives_its_file(tmp_path: Path) -> None:
    random = RANDOM(7)
    truth = hidden(FEW, random)
    swims = synthetic(FEW, truth, random)[::2]
    found = fit(swims, FEW, starts=1)
    path = tmp_path / "fitted.yaml"
    path.write_text(fish_file(found, [swim.name for swim in swims], "calibrate"), encoding="utf-8")
    read = read_fish(path)
    told = read_errors(path)
    assert list(told) == list(found.names)
    assert told[found.names[0]] == pytest.approx((found.low[0], found.high[0]), rel=5e-3)
    assert read.own == pytest.approx(found.model.own, rel=1e-5)
    assert read.knots.bias == pytest.approx(found.model.knots.bias, rel=1e-5)
    assert read.fish["body.drag_area"] == pytest.approx(found.model.fish["body.drag_area"], rel=1e-5)
    one, other = (predict(Tank(model), swims[0]).forward for model in (read, found.model))
    assert one == pytest.approx(other, abs=1e-4)


def test_a_refit_near_the_best_stays_there() -> None:
    random = RANDOM(9)
    swims = synthetic(FEW, hidden(FEW, random), random)[::2]
    found = fit(swims, FEW, starts=1)
    again = refit(swims, FEW, found)
    assert again.cost == pytest.approx(found.cost, rel=1e-3)


def test_what_is_fixed_is_not_fitted_and_what_cannot_be_told_is_said() -> None:
    random = RANDOM(11)
    swims = [
        swim
        for swim in synthetic(
            SETTINGS.with_fixed({"drive.amplitude_factor": 1.0}),
            np.array([each.coordinate(each.prior) for each in SETTINGS.fitted]),
            random,
        )
        if not swim.turns
    ]
    settings = FEW.with_fixed({"body.drag_area": 1.2e-3})
    found = fit(swims, settings, starts=1)
    assert found.model.fish["body.drag_area"] == 1.2e-3
    assert "body.drag_area" not in found.names
    said = "\n".join(found.doubts)
    assert f"{GAIN_LEFT} is hardly told by these swims" in said, "no swim turned"
    assert "scale of all masses" in said


def narrowed(name: str, low: float, high: float) -> Settings:
    """Return `FEW` with other bounds of one parameter, and its prior between them."""

    def of(each: Fitted) -> Fitted:
        return replace(each, low=low, high=high, prior=math.sqrt(low * high)) if each.name == name else each

    return replace(FEW, fitted=tuple(map(of, FEW.fitted)))


def test_a_derivative_is_the_same_at_either_bound() -> None:
    """A value does not pass its bound: a step across it would tell that the parameter changes nothing."""
    swims = synthetic(FEW, hidden(FEW, RANDOM(3)), RANDOM(3))[:1]
    place = [each.name for each in FEW.fitted].index("body.drag_area")
    columns = []
    for low, high, at in ((1e-4, 2e-3, 2e-3), (2e-3, 4e-2, 2e-3), (1e-4, 4e-2, 2e-3)):
        settings = narrowed("body.drag_area", low, high)
        problem = _Problem(swims, settings)
        coordinates = np.array([each.coordinate(each.prior) for each in settings.fitted])
        coordinates[place] = math.log(at)
        columns.append(float(np.linalg.norm(problem.blocks(coordinates)[0][:, place])))
    assert columns == pytest.approx([columns[-1]] * 3, rel=0.02)
    assert columns[-1] > 1.0


def test_errors_are_not_cut_off_at_a_bound_and_the_bound_is_named() -> None:
    swims = synthetic(FEW, np.array([each.coordinate(each.prior) for each in FEW.fitted]), RANDOM(3))[::2]
    found = fit(swims, narrowed("body.drag_area", 1e-5, 5e-4), starts=1)
    place = found.names.index("body.drag_area")
    assert found.values[place] == pytest.approx(5e-4, rel=0.01), "half of what is true"
    assert found.high[place] / found.values[place] == pytest.approx(found.values[place] / found.low[place])
    assert found.high[place] > 5.1e-4
    assert "body.drag_area lies at its bound" in "\n".join(found.doubts)


def test_a_belief_that_the_swims_contradict_makes_the_errors_hardly_smaller_and_is_named() -> None:
    """The loss forgives it as an outlier: 7 spreads off, its curvature is (1 + 49)^-1.5, a 350th of its own."""
    truth = np.array([each.coordinate(each.prior) for each in FEW.fitted])
    swims = synthetic(FEW, truth, RANDOM(4))[::2]
    wide = fit(swims, FEW, starts=1)
    place = FEW.fitted.index(next(each for each in FEW.fitted if each.name == GAIN_LEFT))
    error = float(wide.high[place] - wide.low[place]) / 2.0
    believed = 1.0 - 8.0 * error
    wrong = replace(FEW.fitted[place], prior=believed, spread=error)
    narrow = replace(FEW, fitted=tuple(wrong if each.name == GAIN_LEFT else each for each in FEW.fitted))
    found = fit(swims, narrow, starts=1)
    assert abs(found.values[place] - believed) > 5.0 * error
    assert (found.high[place] - found.low[place]) / 2.0 > 0.9 * error, "0.7 of it if the belief counted whole"
    assert f"further than 3 spreads from their priors lie {GAIN_LEFT} (" in "\n".join(found.doubts)


def test_the_fitted_fish_of_the_tree_predicts_the_measured_swims() -> None:
    tank = Tank(read_fish(FITTED))
    swims = [swim for swim in read_folder(SWIMS) if round(math.degrees(swim.amplitude)) == 30]
    told = [judged.errors(swim, predict(tank, swim)) for swim in swims]
    assert float(np.median([each.speed for each in told if each.speed is not None])) < 0.06
    assert float(np.median([each.turning_rate for each in told if each.turning_rate is not None])) < 0.10
    assert float(np.median([each.position for each in told if each.position is not None])) < 0.012


def test_the_fitted_fish_is_taken_by_the_simulator(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--params-file", str(FITTED), "--amplitude", "25", "--frequency", "0.98", "--duration", "15", "--json"]
    assert swim_main(arguments) == 0
    assert 0.02 < json.loads(capsys.readouterr().out)["mean_speed"] < 0.1


def test_predict_prints_what_programs_read(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / ONE.name).write_bytes(ONE.read_bytes())
    assert predict_command.main(["--fish", str(FITTED), "--swims", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told) == ["median", "p90", "swims"]
    assert all(list(told[key]) == ["speed", "turning_rate", "position"] for key in ("median", "p90"))
    assert told["swims"][0]["name"] == ONE.stem
    assert told["median"]["speed"] == told["swims"][0]["speed"] < 0.2
    assert predict_command.main(["--fish", str(FITTED), "--swims", str(tmp_path), "--given", "2"]) == 0
    assert "first 2 s given" in capsys.readouterr().out


def test_a_swim_without_bias_has_no_turning_error() -> None:
    swim = read_csv(SWIMS / "amplitude30_bias+0_run1.csv")
    assert judged.errors(swim, predict(Tank(read_fish(FITTED)), swim)).turning_rate is None


def test_windows_of_the_errors_are_in_true_time() -> None:
    swim = read_csv(ONE)
    predicted = predict(Tank(read_fish(FITTED)), swim)
    late = np.where(swim.time >= swim.time[-1] - 2.0, 0.9, 1.0)
    position = np.array(swim.position, dtype=float)
    right = replace(predicted, forward=swim.forward * late, heading=swim.heading, position=position)
    told = judged.errors(swim, right)
    assert told.speed == pytest.approx(0.1)
    assert (told.turning_rate, told.position) == (0.0, 0.0)
    at = int(np.argmin(np.abs(swim.time - 4.0)))
    moved = position.copy()
    moved[at] += (0.003, 0.004)
    assert judged.errors(swim, replace(right, position=moved)).position == pytest.approx(0.005)


def test_a_fish_that_does_not_move_has_no_relative_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, lambda rows: scaled(["v_forward"], 0.0)(without("x")(without("y")(rows))))
    assert predict_command.main(["--fish", str(FITTED), "--swims", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["median"]["speed"] is None


def test_a_swim_that_a_fish_cannot_swim_is_no_prediction(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not a number in place of an error is neither small nor large, and no JSON."""

    def breaks_off(_: Tank, __: Swim, ___: np.ndarray, times: np.ndarray) -> np.ndarray:
        return np.where(times[:, None] < 3.0, np.zeros((len(times), 6)), math.nan)

    swim, tank = read_csv(ONE), Tank(read_fish(FITTED))
    monkeypatch.setattr(Tank, "swim", breaks_off)
    with pytest.raises(
        ValueError, match=rf"{re.escape(ONE.stem)}: the fish cannot swim it, .* breaks off 3\.\d\d s after"
    ):
        predict(tank, swim)


def test_nothing_that_a_prediction_is_judged_by_is_shown_to_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert predict_command.main(["--fish", str(FITTED), "--swims", str(SWIMS), "--given", "2.6"]) == 2
    assert "--given = 2.6 s is outside the allowed range [0.3, 2.5] s" in capsys.readouterr().err


def columns() -> list[list[str]]:
    return [line.split(",") for line in ONE.read_text(encoding="utf-8").split()]


def written(path: Path, change: Callable[[list[list[str]]], list[list[str]]]) -> Path:
    file = path / ONE.name
    file.write_text("\n".join(",".join(row) for row in change(columns())), encoding="utf-8")
    return file


def scaled(names: Sequence[str], factor: float) -> Callable[[list[list[str]]], list[list[str]]]:
    def change(rows: list[list[str]]) -> list[list[str]]:
        places = [rows[0].index(name) for name in names]
        for row in rows[1:]:
            for place in places:
                row[place] = repr(float(row[place]) * factor)
        return rows

    return change


def without(name: str) -> Callable[[list[list[str]]], list[list[str]]]:
    def change(rows: list[list[str]]) -> list[list[str]]:
        place = rows[0].index(name)
        return [row[:place] + row[place + 1 :] for row in rows]

    return change


DEGREES = 180.0 / math.pi


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without("yaw_rate"), "no column yaw_rate"),
        (without("y"), "one of the columns x and y"),
        (lambda rows: rows[:40] + rows[50:], "no sample for"),
        (lambda rows: rows[:40] + rows[39:], "t must rise"),
        (lambda rows: rows[:50], "needed are 4.5 s"),
        (lambda rows: rows[:2], "it has one row"),
        (lambda rows: [*rows[:9], [*rows[9][:2], "nan", *rows[9][3:]], *rows[10:]], "line 10: v_forward = 'nan'"),
        (scaled(["heading"], DEGREES), "heading changes"),
        (scaled(["yaw_rate"], DEGREES), "degrees/s"),
        (scaled(["yaw_rate", "heading"], DEGREES), "are angles in degrees?"),
        (scaled(["x", "y"], 1000.0), "are they in millimetres?"),
        (scaled(["v_forward", "v_lateral"], 1000.0), "in mm/s?|in millimetres?"),
        (scaled(["x", "y", "v_forward", "v_lateral"], 1000.0), "are lengths in millimetres?"),
        (scaled(["t"], 1000.0), "in milliseconds"),
        (scaled(["t"], 0.45), "time base is wrong by a factor of 2"),
    ],
)
def test_what_cannot_be_is_named(
    change: Callable[[list[list[str]]], list[list[str]]], said: str, tmp_path: Path
) -> None:
    written(tmp_path, change)
    with pytest.raises(SwimError, match=said.replace("?", r"\?")) as caught:
        usable(read_folder(tmp_path), SETTINGS.stated_frequency)
    assert ONE.stem in str(caught.value)


def test_the_published_clock_is_named_and_not_fitted_away(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def as_published(rows: list[list[str]]) -> list[list[str]]:
        true, logged = rows[0].index("t"), rows[0].index("t_logged")
        for row in rows[1:]:
            row[true] = row[logged]
        return rows

    written(tmp_path, as_published)
    out = tmp_path / "fitted.yaml"
    assert calibrate_command.main(["--swims", str(tmp_path), "--out", str(out)]) == 2
    assert "time base is wrong" in capsys.readouterr().err
    assert not out.exists()


def test_too_few_swims_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, lambda rows: rows)
    assert calibrate_command.main(["--swims", str(tmp_path)]) == 2
    assert "1 swim cannot tell a fish: needed are 3" in capsys.readouterr().err


def test_too_few_swims_to_leave_any_out_are_refused_before_anything_is_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("amplitude15_bias+0_run1.csv", "amplitude25_bias+0_run1.csv", "amplitude30_bias+30_run1.csv"):
        (tmp_path / name).write_bytes((SWIMS / name).read_bytes())
    out = tmp_path / "fitted.yaml"
    assert calibrate_command.main(["--swims", str(tmp_path), "--leave-out", "bias", "--out", str(out)]) == 2
    told = capsys.readouterr()
    assert "1 swim would be left without amplitude15_bias+0_run1, amplitude25_bias+0_run1; needed are 3" in told.err
    assert "start 1" not in told.out
    assert not out.exists()


def test_repeats_of_a_condition_are_left_out_together() -> None:
    one, other = (read_csv(SWIMS / f"amplitude{amplitude}_bias+30_run1.csv") for amplitude in (15, 30))
    third = read_csv(SWIMS / "amplitude25_bias+30_run1.csv")
    swims = [one, other, replace(one, name="again"), third, replace(third, name="once more")]
    keys = calibrate_command._left_out("condition", swims)
    assert keys[0] == keys[2] == f"{one.name}, again"
    assert len(set(keys)) == 3


def test_swims_of_several_beats_are_no_calibration() -> None:
    swims = [replace(read_csv(ONE), name=f"{beat:g}", frequency=beat) for beat in (0.9, 0.9, 1.4)]
    with pytest.raises(SwimError, match=r"1\.4: .* at 1\.40 Hz, in the swims of its bias at 0\.90 Hz"):
        usable(swims, 0.0)
    assert len(usable([replace(swim, frequency_commanded=True) for swim in swims], 0.0)[0]) == 3


def test_a_folder_without_swims_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SwimError, match="holds no swims"):
        read_folder(tmp_path)
    (tmp_path / "swim.csv").write_text("t\n0\n", encoding="utf-8")
    with pytest.raises(SwimError, match="rename it"):
        read_folder(tmp_path)


def test_a_swim_that_tells_its_commanded_beat_is_held_to_no_other() -> None:
    swim = replace(read_csv(ONE), frequency=1.6)
    with pytest.raises(SwimError, match="time base is wrong"):
        usable([swim], 1.0)
    commanded = replace(swim, frequency_commanded=True)
    assert usable([commanded], 1.0)[0] == [commanded]


def test_what_is_refused_of_a_swim_names_its_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, scaled(["t"], 0.45))
    for command, words in ((calibrate_command, []), (predict_command, ["--fish", str(FITTED)])):
        assert command.main(["--swims", str(tmp_path), *words]) == 2
        assert f": error: {tmp_path}: {ONE.stem}: by its t the tail beats" in capsys.readouterr().err


def test_a_swim_in_which_the_camera_lost_the_fish_is_left_out_and_said() -> None:
    swim = read_csv(ONE)
    lost = replace(swim, forward=np.where(swim.time > 3.0, -0.05, swim.forward))
    kept, notes = usable([swim, lost], 1.0)
    assert kept == [swim]
    assert "lost the fish" in notes[0]


PARAMETER = "parameters:\n  body.drag_area: "


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PARAMETER + "{prior: 0.5, spread: 1.0, range: [1.0e-5, 0.1], scale: log}", "prior = 0.5 is outside"),
        (PARAMETER + "{prior: 0.05, spread: 1.0, range: [0.1, 1.0e-5], scale: log}", "lower bound first"),
        (PARAMETER + "{prior: 0.05, spread: 0.0, range: [1.0e-5, 0.1], scale: log}", "spread = 0"),
        (PARAMETER + "{prior: 0.05, spread: 1.0, range: [0.0, 0.1], scale: log}", "use scale linear"),
        (PARAMETER + "{prior: 0.05, spread: 1.0, range: [0.0, 0.1]}", "needs prior, range, scale, spread"),
        ("parameters:\n  body.drag: {prior: 1.0, spread: 1.0, range: [0.0, 2.0], scale: linear}", "did you mean"),
        ("parameters:\n  fin.segments: {prior: 1, spread: 1, range: [1, 2], scale: linear}", "cannot be fitted"),
        ("fish: {}", "needs parameters"),
        ("parameters: {}\nother: 1", "nothing else"),
    ],
)
def test_settings_that_cannot_be_are_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        read_settings(path)


@pytest.mark.parametrize("text", ["body.mass", "body.mass=heavy", "body.weight=1", "body.mass=-5"])
def test_a_fixed_value_that_cannot_be_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate_command.main(["--swims", str(SWIMS), "--fix", text]) == 2
    assert capsys.readouterr().err.startswith("calibrate: error:")


def test_a_bag_of_a_trial_is_a_swim() -> None:
    bag = min((DATA / "study_2026_11" / "bags").iterdir())
    swim = read_swim_of_bag(bag)
    assert swim.frequency == 0.9
    assert math.degrees(swim.amplitude) == pytest.approx(15.0)
    assert swim.fin["fin.young_modulus"] == pytest.approx(3292507153.95)
    assert 0.04 < float(np.median(np.diff(swim.time))) < 0.06, "thinned to 20 Hz"
    assert swim.position is not None
    moved = np.diff(swim.position, axis=0)
    along = moved[:, 0] * np.cos(swim.heading[1:]) + moved[:, 1] * np.sin(swim.heading[1:])
    assert along.sum() == pytest.approx(np.trapezoid(swim.forward, swim.time), rel=0.05)
    with pytest.raises(SwimError, match=r"needed are 4\.5 s"):
        usable([swim], 0.0)


@pytest.mark.parametrize(
    ("topic", "change", "said"),
    [
        (
            "velocity",
            lambda rows: [(at, spoilt(each) if n == 99 else each) for n, (at, each) in enumerate(rows)],
            "finite",
        ),
        ("pose", lambda rows: rows[: len(rows) // 2] + rows[-1:], "no pose for"),
    ],
)
def test_a_bag_with_wrong_or_missing_numbers_is_no_swim(
    topic: str, change: Callable[[list[Any]], list[Any]], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = min((DATA / "study_2026_11" / "bags").iterdir())
    bag = read_bag(path)
    read = type(bag).decoded

    def decoded(self: Bag, name: str, kind: str) -> list[Any]:
        rows = list(read(self, name, kind))
        return change(rows) if name == topic else rows

    monkeypatch.setattr(type(bag), "decoded", decoded)
    with pytest.raises(SwimError, match=said):
        recorded.read_swim_of_bag(path)


def spoilt(message: Any) -> Any:
    message.twist.linear.x = math.nan
    return message


def test_the_swims_of_a_study_are_its_bags_and_not_its_table() -> None:
    study = DATA / "study_2026_11"
    assert (study / "trials.csv").exists()
    assert [swim.name for swim in read_folder(study)] == [each.name for each in sorted((study / "bags").iterdir())]


def test_the_swim_of_a_bag_can_be_predicted() -> None:
    """Its fin is told whole: a profile of heights is a list."""
    swim = read_swim_of_bag(min((DATA / "study_2026_11" / "bags").iterdir()))
    assert isinstance(swim.fin["fin.profile_height"], list)
    tank = Tank(model_of(FEW, np.array([each.coordinate(each.prior) for each in FEW.fitted]), (0.0,), (0.0,)))
    short = tank.swim(swim, np.zeros(4), swim.time[:4])
    assert np.isfinite(short).all()


def test_a_flexible_fin_is_bent_where_a_record_begins() -> None:
    """A swim from rest by the simulator, recorded from the second beat on: its own fish predicts the rest."""
    settings = read_settings(CONFIG / "calibrate_default_fish.yaml")
    fin, amplitude, bias = Fin(), 0.2, 0.07
    swum = simulated_swim(fin, gait=Gait((JointDrive(amplitude, 0.9, 0.0, bias),)), duration=8.0, sample_time=0.05)
    kept = swum.time >= 1.5
    columns = {
        "t": swum.time[kept],
        "v_forward": swum.surge[kept],
        "v_lateral": swum.sway[kept],
        "yaw_rate": swum.yaw_rate[kept],
        "heading": swum.heading[kept],
        "x": swum.x[kept],
        "y": swum.y[kept],
    }
    recorded = swim_of("cut", amplitude, bias, columns, 0.9, fin.as_parameters())
    fish = np.array([each.coordinate(each.prior) for each in settings.fitted])
    tank = Tank(model_of(settings, fish, (bias,), (0.9,)))
    found = judged.errors(recorded, predict(tank, recorded))
    assert found.speed is not None
    assert found.speed < 0.01, "0.03 with a fin that is straight where the record begins"
    assert found.turning_rate is not None
    assert found.turning_rate < 0.05, "0.14"


def test_a_cloud_is_drawn_around_a_calibrated_fish_as_wide_as_its_errors() -> None:
    known = around(FITTED)
    widths = dict(zip(plausible.WIDTHS, known["prior"].widths, strict=True))
    assert known["fish"].body.mass == 0.725
    assert widths["drag_area"] == pytest.approx(0.5 * math.log(0.000675 / 0.000285), rel=1e-3)
    assert widths["yaw_drag"] == plausible.WIDTHS["yaw_drag"], "no wider than without a calibration"
    assert widths["amplitude"] == plausible.WIDTHS["amplitude"], "known to 0.13 of 1.22: no better than any servo's"
    assert (widths["servo_lag"], known["prior"].servo_lag) == (0.0, 0.0), "the amplitude factor holds it"
    assert known["prior"].amplitude == pytest.approx(1.22, abs=0.01)
    assert known["prior"].stiffness_width == plausible.STIFFNESS_WIDTH, "a rigid tail tells nothing of sheets"


KNOTS = "drive.knots: [0.0]\n    drive.amplitude_factor: [{}]\n    drive.frequency: [{}]"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("drive.knots: 3.0", "drive.knots = 3.0 must be a list"),
        (
            "drive.knots: [0.0]\n    drive.amplitude_factor: [-1.0]\n    drive.frequency: [1.0]",
            "factor = -1 is outside",
        ),
        (
            "drive.knots: [0.0]\n    drive.amplitude_factor: [1.0]\n    drive.frequency: [-1.0]",
            "frequency = -1 is outside",
        ),
        ("tracker.ahed: 0.1", "no parameter tracker.ahed"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "fish.yaml"
    path.write_text(f"/**:\n  ros__parameters: {{}}\ncalibration:\n  ros__parameters:\n    {text}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=said) as caught:
        read_fish(path)
    assert str(path) in str(caught.value)


def test_the_beat_is_found_at_uneven_intervals() -> None:
    random = RANDOM(3)
    time = np.cumsum(random.uniform(0.05, 0.12, 120))
    rate = 0.1 * time + np.sin(2.0 * math.pi * 1.37 * time) + 0.3 * random.standard_normal(120)
    assert beat_frequency(time, rate) == pytest.approx(1.37, abs=0.01)


def test_pages_are_drawn(tmp_path: Path) -> None:
    page = tmp_path / "page.png"
    (tmp_path / ONE.name).write_bytes(ONE.read_bytes())
    arguments = ["--fish", str(FITTED), "--swims", str(tmp_path), "--page", str(page)]
    assert predict_command.main(arguments) == 0
    assert page.stat().st_size > 10_000
