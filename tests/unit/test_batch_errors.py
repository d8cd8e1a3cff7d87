"""No swim of the batch is wrong without saying so: random swims and nasty ones against a solver of another kind."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.integrate

from fin_plant import validity
from fin_plant.fin import Fin, ProfiledFin
from fin_plant.gait import PAPER_GAIT, Gait, JointDrive
from fin_plant.gait_follower import GaitFollower
from fin_sim import dynamics
from fin_sim.batch import TOLERANCES, BatchSwim, Status, swim_batch
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.proven import proven_fins
from fin_sim.batch.task import checked_task
from fin_sim.batch.tolerances import difference, error_floors
from fin_sim.chain import build_chain
from fin_sim.presets import PRESETS, preset
from fin_sim.swim import PAPER_FISH as DEFAULT_FISH
from fin_sim.swim import swim as swim_alone
from support.paper_fish import FISH as PAPER_FISH
from support.paper_fish import paper_columns, paper_fin
from support.random_swims import RandomSwim, random_swim

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RELATIVE = 1e-7


def in_batch(swim: RandomSwim) -> BatchSwim:
    """Return the batch of one swim."""
    return swim_batch(
        [swim.fin],
        PAPER_FISH,
        gait=swim.gait,
        duration=swim.duration,
        ramp_time=swim.ramp_time,
        settle=swim.settle,
        clamp=swim.clamp,
        reactive=swim.reactive,
    )


def true_figures(swim: RandomSwim) -> Array:
    """Return the figures that `TOLERANCES` name, by a solver that chooses its own steps and orders (LSODA)."""
    chain = build_chain(PAPER_FISH, swim.fin, reactive=swim.reactive, clamp=swim.clamp)
    table, body, links = chain.link_table(), chain.body_vector(), len(chain.links)
    size = dynamics.BODY_STATES + 2 * links
    derivative, record, scratch = (
        np.zeros(size),
        np.zeros(dynamics.RECORD_HEAD + links),
        np.zeros((links, dynamics.SCRATCH_COLUMNS)),
    )
    drive = np.zeros((links, 3))
    follower = GaitFollower(1, swim.ramp_time, as_asked=True)
    follower.command(swim.gait, 0.0)
    form = (swim.clamp == "free", swim.reactive == "distributed")

    def slope(time: float, state: Array) -> Array:
        drive[0] = follower.motion(np.array([time]))[0, 0]
        now = state[:size].copy()
        dynamics.evaluate(now, drive, table, body, *form, derivative, record, scratch)
        forward = record[2] * math.cos(now[2]) + record[3] * math.sin(now[2])
        return np.concatenate((derivative, (now[dynamics.SURGE], forward, record[4])))

    state, begun = np.zeros(size + 3), np.zeros(3)
    stops = sorted({0.0, min(swim.ramp_time, swim.duration), swim.settle, swim.duration})
    for start, stop in pairwise(stops):
        if start == swim.settle:
            begun = state[size:]
        run = scipy.integrate.solve_ivp(
            slope, (start, stop), state, method="LSODA", rtol=RELATIVE, atol=1e-2 * RELATIVE, first_step=1e-6
        )
        assert run.success, run.message
        state = run.y[:, -1]
    means = (state[size:] - begun) / (swim.duration - swim.settle)
    return np.concatenate(([math.hypot(state[0], state[1]) / swim.duration], means))


def error(swim: RandomSwim, swum: BatchSwim) -> float:
    """Return the largest error of a swim of the batch over its tolerance."""
    task = checked_task(
        PAPER_FISH,
        swim.gait,
        swim.duration,
        swim.reactive,
        swim.clamp,
        0.0,
        swim.ramp_time,
        swim.settle,
        None,
        "double",
    )
    true = true_figures(swim)
    got = np.array([getattr(swum, name)[0] for name in TOLERANCES])
    scale = np.array(list(TOLERANCES.values())) * np.maximum(
        np.abs(true), error_floors(task, fin_columns([swim.fin]))[0, : len(TOLERANCES)]
    )
    off = np.abs(got - true)
    return float(np.divide(off, scale, out=np.zeros_like(off), where=off > 0.0).max())


def drawn(seed: int, count: int) -> list[RandomSwim]:
    random = np.random.default_rng(seed)
    return [random_swim(random) for _ in range(count)]


def few_forms(swim: RandomSwim) -> bool:
    """Return whether it needs no code but that of a few forms: a minute of compilation less."""
    return swim.fin.segments == 3 and swim.reactive == "distributed" and swim.fin.height != swim.fin.tip_height


FEW = [swim for swim in drawn(7, 600) if few_forms(swim)][:12]
DEAR = {0, 1, 7, 9}
"""Of them, those for which the second solver takes seconds."""


@pytest.mark.parametrize(
    "swim", [pytest.param(swim, marks=[pytest.mark.long] * (index in DEAR)) for index, swim in enumerate(FEW)]
)
def test_random_swim_is_right_or_says_that_it_is_not(swim: RandomSwim) -> None:
    swum = in_batch(swim)
    if swum.status[0] == Status.OK:
        assert error(swim, swum) < 1.0
    else:
        assert np.isnan(swum.mean_speed[0])
        assert swum.reason(0)


@pytest.mark.long
def test_random_swims_are_right_or_say_that_they_are_not() -> None:
    count = int(os.environ.get("RANDOM_SWIMS", "150"))
    given_up, wrong = 0, []
    for index, swim in enumerate(drawn(11, count)):
        swum = in_batch(swim)
        if swum.status[0] == Status.OK:
            off = error(swim, swum)
            wrong += [(index, off, swim)] if off > 1.0 else []
        elif swum.status[0] != Status.FOLDED:
            given_up += 1
    assert not wrong
    assert given_up < 0.02 * count


def drive(frequency: float, degrees: float) -> Gait:
    return Gait((JointDrive(math.radians(degrees), frequency),))


NASTY = {
    "short ramp at a low frequency": RandomSwim(
        paper_fin(tip_height=0.03), drive(0.2, 20.0), 12.0, 0.03, 0.0, "free", "distributed"
    ),
    "fast beat": RandomSwim(paper_fin(tip_height=0.03), drive(8.0, 40.0), 1.0, 0.1, 0.0, "free", "distributed"),
    "soft fin": RandomSwim(
        paper_fin(young_modulus=5e7, tip_height=0.02), drive(0.9, 15.0), 6.0, 0.5, 0.0, "free", "distributed"
    ),
    "no damping": RandomSwim(
        paper_fin(damping_time=0.0, tip_height=0.02), drive(1.5, 30.0), 4.0, 0.5, 3.0, "fixed", "distributed"
    ),
    "window between two steps": RandomSwim(
        paper_fin(tip_height=0.03), drive(0.9, 15.0), 10.0, 0.5, 9.987, "fixed", "distributed"
    ),
}


@pytest.mark.parametrize("name", NASTY)
def test_nasty_swim_is_right(name: str) -> None:
    swum = in_batch(NASTY[name])
    assert swum.status[0] == Status.OK, swum.reason(0)
    assert error(NASTY[name], swum) < 1.0


@pytest.mark.parametrize("clamp", ["free", pytest.param("fixed", marks=pytest.mark.long)])
def test_proven_fins_are_right_without_a_second_swim(clamp: str) -> None:
    fins = [paper_fin(young_modulus=e, tip_height=tip) for e, tip in ((3e8, 0.025), (1.2e9, 0.05), (4e9, 0.025))]
    for fin in fins:
        swim = RandomSwim(fin, PAPER_GAIT, 10.0, 0.5, 0.0, clamp, "distributed")  # type: ignore[arg-type]
        task = checked_task(PAPER_FISH, PAPER_GAIT, 10.0, "distributed", clamp, 0.0, 0.5, 0.0, None, "double")
        assert proven_fins(task, fin_columns([fin])).all()
        assert error(swim, in_batch(swim)) < 1.0


@pytest.mark.parametrize("name", ["clark2012_simulation", "three_segments"])
def test_fins_in_three_dimensions_are_as_right_as_in_strips(name: str) -> None:
    given, random = preset(name), np.random.default_rng(5)
    length = random.uniform(0.04, 0.14, 60)
    changed = {"young_modulus": 10.0 ** random.uniform(8.0, 10.0, 60), "length": length}
    height = given.fin.area / length
    columns = fin_columns({**vars(given.fin), **changed, "height": height, "tip_height": height})
    fish = replace(given.fish, water=replace(given.fish.water, model="surface_3d"))
    task = checked_task(fish, PAPER_GAIT, 10.0, given.reactive, "free", 0.0, 0.5, 0.0, None, "double")
    proven = proven_fins(task, columns)
    assert np.count_nonzero(proven) > 50
    fins = {name: column[proven] for name, column in columns.items()}
    true = lane_figures(task.refined(8), fins)
    assert difference(lane_figures(task, fins), true, error_floors(task, fins)).max() < 0.5
    dead = replace(fish, water=replace(fish.water, wake="none"))
    without_wake = checked_task(dead, PAPER_GAIT, 10.0, given.reactive, "free", 0.0, 0.5, 0.0, None, "double")
    assert not proven_fins(without_wake, columns).any()
    assert without_wake.steps == 4 * task.steps


def test_fins_with_a_damper_in_each_hinge_on_a_box_are_right_without_a_second_swim() -> None:
    """Of the papers' fins and fish, E from 10 MPa to 10 GPa: what the campaign's searches swim."""
    given, random = preset("clark2012_simulation"), np.random.default_rng(5)
    length = random.uniform(0.04, 0.14, 400)
    height = given.fin.area / length * random.uniform(0.3, 1.0, 400)
    changed = {"young_modulus": 10.0 ** random.uniform(7.0, 10.0, 400), "length": length}
    columns = fin_columns({**vars(given.fin), **changed, "height": height, "tip_height": height})
    for degrees, mass, drag_area, settle in (
        (15.0, 0.295, 7.48e-3, 0.0),
        (10.0, 0.5, 3e-3, 5.0),
        (16.0, 0.25, 1e-2, 0),
    ):
        body = replace(given.fish.body, mass=mass, drag_area=drag_area)
        fish, gait = replace(given.fish, body=body), drive(0.9, degrees)
        task = checked_task(fish, gait, 10.0, "tip", "free", 0.0, 0.5, settle, None, "double")
        proven = proven_fins(task, columns)
        assert np.count_nonzero(proven) > 350
        fins = {name: column[proven] for name, column in columns.items()}
        true = lane_figures(task.refined(8), fins)
        assert difference(lane_figures(task, fins), true, error_floors(task, fins)).max() < 0.5
        held = checked_task(fish, gait, 10.0, "tip", "fixed", 0.0, 0.5, settle, None, "double")
        assert not proven_fins(held, columns).any()


@pytest.mark.parametrize("name", PRESETS)
def test_only_fish_and_fins_that_were_compared_need_no_second_swim(name: str) -> None:
    given = preset(name)
    task = checked_task(given.fish, PAPER_GAIT, 10.0, given.reactive, "free", 0.0, 0.5, 0.0, None, "double")
    proven = proven_fins(task, fin_columns([given.fin])).all()
    assert proven == (name in ("clark2012_simulation", "three_segments"))
    assert not proven_fins(task, fin_columns([replace(given.fin, segments=7)])).any()


def test_default_fins_are_right_without_a_second_swim() -> None:
    fins = [Fin(young_modulus=modulus) for modulus in (0.5e9, 2e9, 4e9)]
    task = checked_task(DEFAULT_FISH, PAPER_GAIT, 10.0, "distributed", "free", 0.0, 0.5, 0.0, None, "double")
    assert proven_fins(task, fin_columns(fins)).all()
    held = checked_task(DEFAULT_FISH, PAPER_GAIT, 10.0, "distributed", "fixed", 0.0, 0.5, 0.0, None, "double")
    assert not proven_fins(held, fin_columns(fins)).any()
    swum = swim_batch(fins)
    for index, fin in enumerate(fins):
        alone = swim_alone(fin, step=2e-3)
        assert swum.mean_speed[index] == pytest.approx(alone.mean_speed, rel=1e-3)
        assert swum.mean_forward_speed[index] == pytest.approx(alone.mean_forward_speed, rel=1e-3)


def test_a_fin_that_folds_has_its_angle_and_no_figures() -> None:
    fin = paper_fin(young_modulus=1.23e7, length=0.079, height=0.011, tip_height=0.025, thickness=3.2e-4)
    swum = in_batch(RandomSwim(fin, drive(5.5, 36.0), 10.0, 0.5, 0.0, "free", "distributed"))
    assert swum.status[0] == Status.FOLDED
    assert swum.largest_hinge_angle[0] > validity.FOLDED_ANGLE
    assert np.isnan([swum.mean_speed[0], swum.thrust[0], swum.servo_power[0]]).all()
    assert "degrees" in swum.reason(0)


def test_fins_with_a_profile_swim_in_a_batch_as_they_do_alone() -> None:
    profile = {"profile_position": (0.3, 0.6), "profile_height": (0.01, 0.04)}
    fins = [ProfiledFin(**paper_columns(**profile, young_modulus=1e9)), paper_fin(young_modulus=1e9)]
    swum = swim_batch(fins, duration=3.0)
    assert swum.mean_speed == pytest.approx([swim_alone(fin, duration=3.0).mean_speed for fin in fins], rel=1e-3)
    columns = swim_batch(paper_columns(young_modulus=[1e9, 2e9], **profile), duration=3.0)
    assert columns.mean_speed[0] == swum.mean_speed[0]
    refused = swim_batch(paper_columns(profile_position=(0.6, 0.3), profile_height=(0.01, 0.04)), duration=1.0)
    assert refused.status[0] == Status.REFUSED
    assert "must rise" in refused.reason(0)


def test_a_large_bend_and_a_short_fin_are_said_of_a_swim_of_the_batch() -> None:
    swum = swim_batch(paper_columns(length=[0.08, 0.04]), duration=1.0)
    assert swum.warnings(0) == []
    assert "strip theory" in swum.warnings(1)[0]
    assert 0.0 < swum.largest_hinge_angle[0] < validity.BENT_ANGLE
