"""Pictures of a space of several parameters: what they show is what was tried, whatever a space may hold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.commands.export import columns
from fin_optimizer.commands.show_study import study_table
from fin_optimizer.goals import MEASURES, Goals
from fin_optimizer.search.space import Choice, Dimension, Space, generator
from fin_optimizer.study import pictures, space_drawing
from fin_optimizer.study.candidate import TrialRecord, candidates
from fin_optimizer.study.file_names import FIGURE_FILE, IMPORTANCE_FILE, PARALLEL_FILE, SLICES_FILE
from fin_optimizer.study.importance import LEAST, importances
from fin_optimizer.study.report import trials_table
from fin_optimizer.study.settings import Settings
from fin_optimizer.study.simulated_curve import SimulatedFish, values_along
from fin_optimizer.trial.result import Outcome
from fin_plant.fin import FIN_PARAMETERS, node_table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

LENGTH = Dimension("fin.length", 0.04, 0.14, "m", step=0.02)
MODULUS = Dimension("fin.young_modulus", 1e8, 1e10, "Pa", log=True)
SEGMENTS = Dimension("fin.segments", 2, 9, whole=True)
SHEET = Choice("stock", ("PP_0.5", "PET_0.35"))
FREQUENCY = Dimension("gait.frequency", 0.5, 2.5, "Hz")
BIAS = Dimension("gait.joint_1.bias", -0.1, 0.1, "rad")
SPACE = Space((SHEET, LENGTH, MODULUS, SEGMENTS, FREQUENCY, BIAS))


def drawn(count: int) -> list[dict[str, Any]]:
    return [SPACE.drawn(generator(5, number)) for number in range(count)]


def tried(scores: list[float]) -> space_drawing.Tried:
    return space_drawing.Tried(
        SPACE.dimensions, np.array([SPACE.row(values) for values in drawn(len(scores))]), np.array(scores)
    )


@pytest.mark.parametrize("draw", [space_drawing.draw_parallel, space_drawing.draw_slices])
@pytest.mark.parametrize("scores", [[2.0], [1.0, 1.0], [3.0, -1.0, 2.0], list(np.linspace(-1.0, 5.0, 900))])
def test_one_candidate_equal_ones_and_many_are_drawn(
    draw: Callable[..., None], scores: list[float], tmp_path: Path
) -> None:
    path = tmp_path / "a.svg"
    draw(path, tried(scores), title="[no] $markup_{")
    text = path.read_text()
    assert "<svg" in text
    assert len(text) > 10_000
    assert list(tmp_path.iterdir()) == [path]


def test_the_best_is_the_highest_and_where_less_is_better_the_lowest() -> None:
    some = tried([2.0, 5.0, 1.0, 5.0])
    assert (some.best, list(some.order)) == (1, [2, 0, 1, 3])
    least = space_drawing.Tried(some.dimensions, some.numbers, some.scores, "energy per metre (J/m)", least=True)
    assert (least.best, list(least.order)) == (2, [1, 3, 0, 2])


@pytest.mark.parametrize("dimension", SPACE.dimensions, ids=lambda dimension: dimension.name)
def test_the_values_along_an_axis_are_those_that_can_be_searched_from_end_to_end(dimension: Any) -> None:
    values = values_along(dimension, 25)
    assert [dimension.check(value) for value in values] == values
    assert len(set(values)) == len(values)
    ends = (dimension.choices[0], dimension.choices[-1]) if isinstance(dimension, Choice) else None
    low, high = ends or (dimension.minimum, dimension.last)
    assert values[0] == pytest.approx(low)
    assert values[-1] == pytest.approx(high)
    assert len(values) == min(25, dimension.count or 25)


def test_a_slice_keeps_all_else_as_the_best_has_it_and_has_a_gap_where_a_candidate_cannot_be() -> None:
    best = drawn(1)[0]
    seen = []

    def speeds(some: Any) -> list[float]:
        seen.extend(some)
        return [math.nan if values["fin.length"] > 0.1 else 0.03 for values in some]

    curves = pictures.slices_through(SPACE, best, MEASURES["mean_speed"], speeds, points=3)
    assert list(curves) == list(SPACE.names)
    assert all(sum(values[name] != best[name] for name in SPACE.names) <= 1 for values in seen)
    assert list(curves["stock"][0]) == [0.0, 1.0]
    assert np.isnan(curves["fin.length"][1]).any()
    assert np.nanmax(curves["fin.length"][1]) == pytest.approx(3.0)


def test_the_parameter_that_alone_decides_has_nearly_all_of_the_importance() -> None:
    some = drawn(200)
    shares = importances(SPACE, some, [values["gait.frequency"] for values in some])
    assert next(iter(shares)) == "gait.frequency"
    assert shares["gait.frequency"] > 0.7
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(shares) == set(SPACE.names)


def test_nothing_is_said_of_importance_where_nothing_can_be_known() -> None:
    some = drawn(LEAST)
    assert importances(SPACE, some[1:], list(range(LEAST - 1))) == {}
    assert importances(SPACE, some, [math.nan, *range(LEAST - 1)]) == {}
    assert importances(SPACE, some, [1.0] * LEAST) == {}
    assert importances(SPACE, some, list(range(LEAST))) != {}


# -- of a study ------------------------------------------------------------------------------------------------------

TWO = Space((Dimension("fin.young_modulus", 0.5e9, 4e9, "Pa"), Dimension("fin.length", 0.05, 0.1, "m")))
FIN = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
WINDOW = {"measurement.settle": 0.0, "measurement.duration": 0.2}
OF_TWO = Settings(TWO, details={**FIN, "fin.area": 2e-3, "gait.frequency": 0.9, "gait.amplitude": 0.2, **WINDOW})


def record(number: int, values: dict[str, Any], score: float | None) -> TrialRecord:
    return TrialRecord(
        number=number,
        candidate=number,
        values=values,
        outcome=Outcome.OK if score is not None else Outcome.INFEASIBLE,
        reason="",
        measured={} if score is None else {"mean_speed": score},
        spread=None,
        samples=10,
        plant="",
        bag=f"bags/trial_{number:04d}",
        started=None,
        ended=None,
    )


def test_a_study_of_several_parameters_has_all_its_pictures(tmp_path: Path) -> None:
    trials = [record(number, TWO.drawn(generator(1, number)), 0.01 * number) for number in range(LEAST)]
    trials.append(record(LEAST, TWO.drawn(generator(1, LEAST)), None))
    paths, failures = pictures.draw_study(tmp_path / FIGURE_FILE, OF_TWO, trials, {})
    assert failures == []
    assert [path.name for path in paths] == [FIGURE_FILE, SLICES_FILE, PARALLEL_FILE, IMPORTANCE_FILE]
    few = pictures.draw_study(tmp_path / "mine.svg", OF_TWO, trials[:1], {})
    assert [path.name for path in few[0]] == ["mine.svg", "mine_slices.svg", "mine_parallel_coordinates.svg"]


def test_each_goal_has_its_pictures_and_its_best(tmp_path: Path) -> None:
    goals = Goals.of(["mean_speed", "power"])
    of_both = replace(OF_TWO, goals=goals)
    trials = [
        replace(trial, measured={"mean_speed": 0.01 * trial.number, "power": 0.001 * trial.number})
        for trial in (record(number, TWO.drawn(generator(1, number)), 0.0) for number in range(LEAST))
    ]
    paths, failures = pictures.draw_study(tmp_path / FIGURE_FILE, of_both, trials, {})
    assert failures == []
    assert {"slices.png", "slices_power.png", "parallel_coordinates_power.png", "importance_power.png"} <= {
        path.name for path in paths
    }
    tried = candidates(trials, goals)
    fastest, thriftiest = (pictures.as_arrays(of_both, tried, goal) for goal in goals.measures)
    assert (fastest.best, thriftiest.best) == (LEAST - 1, 0)
    assert thriftiest.least
    one, _ = pictures.draw_study(tmp_path / "own.svg", of_both, trials, {}, goals.measures[1])
    assert [path.name for path in one] == [
        "own.svg",
        "own_pareto_front.svg",
        "own_slices_power.svg",
        "own_parallel_coordinates_power.svg",
        "own_importance_power.svg",
    ]


def test_the_simulated_fish_keeps_what_a_candidate_leads_to() -> None:
    table = node_table("fin_sim", "simulator")
    simulated = {name: table[name].default for name in table.deciding_swims - FIN_PARAMETERS.keys()}
    fish = SimulatedFish.of(OF_TWO, simulated)
    assert fish is not None
    fin, gait = fish.fin_and_gait({"fin.young_modulus": 1e9, "fin.length": 0.05})
    assert fin.area == pytest.approx(2e-3)
    assert gait.joints[0].frequency == 0.9


def test_a_fish_in_a_plane_flow_has_no_curve_that_takes_minutes() -> None:
    table = node_table("fin_sim", "simulator")
    simulated = {name: table[name].default for name in table.deciding_swims - FIN_PARAMETERS.keys()}
    assert SimulatedFish.of(OF_TWO, {**simulated, "water.preset": "soleil"}) is not None
    assert SimulatedFish.of(OF_TWO, {**simulated, "water.preset": "bht"}) is None


def test_every_searched_name_stands_with_its_unit_in_each_table() -> None:
    searched = Space((MODULUS, SEGMENTS, FREQUENCY, BIAS, Dimension("fin.damping_time", 0.0, 0.1, "s")))
    settings = Settings(searched, details={**FIN, "gait.amplitude": 0.2})
    trials = [record(number, searched.drawn(generator(2, number)), 0.02) for number in range(2)]
    heads = {
        "fin.young_modulus [Pa]",
        "fin.segments",
        "gait.frequency [Hz]",
        "gait.joint_1.bias [rad]",
        "fin.damping_time [s]",
    }
    assert heads <= {head for head, _, _ in columns(settings, trials)}
    assert heads <= set(trials_table(trials, settings).partition("\n")[0].split(","))
    table = list(study_table(settings, trials, 200))[2]
    shown = {column.header for column in table.columns}  # type: ignore[union-attr]  # a table
    assert {"E\n(GPa)", "frequency\n(Hz)", "joint\n1\nbias\n(deg)", "fin.damping_time\n(s)"} <= shown
