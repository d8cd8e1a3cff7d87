"""Numbers of the optimiser that are known beforehand, by hand or by another way than the code takes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.bags.messages import decode
from fin_optimizer.goals import MEASURES
from fin_optimizer.paper.experiments import LENGTH, MODEL, MODULUS, SIMULATION, model_speeds, speeds
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.score.swim import SwimRecord, score_swim
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.space import Dimension, Evaluation, Space
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.simulated_curve import SimulatedFish
from fin_optimizer.trial.recorder import Extent
from fin_plant.fin import Fin, node_table
from fin_sim.paper_models import mathematical_model, simulation
from fin_sim.presets import preset
from fin_sim.swim import swim
from support.bags import SECOND, START, STATE, STEP, joint_states, state

if TYPE_CHECKING:
    from pathlib import Path


def test_the_energy_of_a_metre_is_the_servos_power_over_the_speed() -> None:
    """A speed that rises from rest to 0.2 m/s has a mean of 0.1 m/s; 2 N m at 0.5 rad/s are 1 W: 10 J a metre."""
    measurement = Measurement(duration=2.0)
    stamps = START + STEP * np.arange(201)
    joints = [joint_states(int(stamp), torque=2.0, rate=0.5) for stamp in stamps]
    velocity = (stamps, 0.1 * (stamps - START) / SECOND)
    started = decode(state("SWIMMING", START), STATE.type_name)
    record = SwimRecord(velocity, [started], joints, measurement.metadata())
    scored, measured = score_swim(record, [MEASURES["energy_per_metre"]])
    assert scored.value == pytest.approx(0.1, rel=1e-12)
    assert measured["energy_per_metre"] == pytest.approx(10.0, rel=1e-12)


def test_each_fin_of_the_pareto_front_is_a_parent_as_often() -> None:
    """Of 300 draws among three each gets 100, with a standard deviation of 8.2; far ones would tell of a preference."""
    space = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
    front = [(1e9, 0.01, 1.0), (2e9, 0.02, 2.0), (3e9, 0.03, 3.0)]
    history = [Evaluation({MODULUS: modulus}, speed, (-energy,)) for modulus, speed, energy in front]
    history += [Evaluation({MODULUS: 3.5e9}, 0.02, (-3.5,)), Evaluation({MODULUS: 1.5e9}, None)]  # behind the front
    children = [HillClimber(space, seed, {MODULUS: 1e5}).propose(history)[MODULUS] for seed in range(300)]
    counts = [sum(abs(child - modulus) < 1e6 for child in children) for modulus, *_ in front]
    assert sum(counts) == 300
    assert min(counts) > 100 - 5 * 8.2
    assert max(counts) < 100 + 5 * 8.2


@pytest.mark.parametrize(
    ("name", "value"), [("gait.amplitude", 0.2), ("gait.frequency", 1.1), ("fin.thickness", 0.0005), ("seed", 7)]
)
def test_a_study_is_not_gone_on_with_by_another_gait_or_fin(tmp_path: Path, name: str, value: float) -> None:
    given = {"study_folder": str(tmp_path / "study")}
    StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked(given)).study().close()
    other = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**given, name: value}))
    with pytest.raises(StudyError, match=rf"{name} is .* there and {value:g} here"):
        other.study()


def test_the_curve_behind_the_trials_is_the_mean_speed_over_the_window_that_is_scored() -> None:
    """Way over time between the window's ends, which no mean of speeds has a part in; other windows differ by 20 %."""
    plan = StudyPlan.from_parameters(
        OPTIMIZER_PARAMETERS.checked({"measurement.settle": 3.0, "measurement.duration": 2.0})
    )
    fish = SimulatedFish.of(plan.settings, node_table("fin_sim", "simulator").checked({}))
    assert fish is not None
    speed = fish.speed({MODULUS: 1.5e9})
    swum = swim(Fin(young_modulus=1.5e9), duration=5.0)
    (start,), (end,) = np.nonzero(swum.time == 3.0), np.nonzero(swum.time == 5.0)
    way = float(np.hypot(swum.x[end] - swum.x[start], swum.y[end] - swum.y[start])[0])
    assert speed == pytest.approx(way / 2.0, rel=0.02)


def test_streams_are_recorded_until_half_a_second_after_the_window() -> None:
    extent = Extent()
    extent.begin(Measurement(settle=1.0, duration=2.0))
    assert not extent.is_over(START + 100 * SECOND)  # no swim has begun
    extent.note(state("READY", START - SECOND))
    extent.note(state("SWIMMING", START))
    end = START + 3 * SECOND + SECOND // 2
    assert not extent.is_over(end)
    assert extent.is_over(end + 1)
    assert extent.is_over(end + 5 * SECOND)
    assert not extent.is_over(end + 10_000 * SECOND)  # of another clock: it is kept, and told


@pytest.mark.parametrize("length", [0.06, 0.08])
def test_model_and_simulation_of_the_campaign_are_those_of_the_simulator(length: float) -> None:
    moduli = np.array([0.8e9, 1.6e9, 3.2e9])
    values = {MODULUS: moduli, LENGTH: np.full(3, length)}
    model, simulated = preset(MODEL), preset(SIMULATION)
    fins = [replace(model.fin, young_modulus=modulus).at_length(length) for modulus in moduli]
    alone = [mathematical_model(fin, model.fish) for fin in fins]
    assert model_speeds(values, model) == pytest.approx(alone, rel=2e-3)
    fins = [replace(simulated.fin, young_modulus=modulus).at_length(length) for modulus in moduli]
    alone = [simulation(fin, simulated.fish).mean_speed for fin in fins]
    assert speeds(values, simulated) == pytest.approx(alone, rel=2e-3)
