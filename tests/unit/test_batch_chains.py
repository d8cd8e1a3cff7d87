"""Chains in lanes: generated code, whatever its form and the chain's length, gives what the general kernel gives."""

from __future__ import annotations

import itertools
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import Gait, JointDrive
from fin_sim.batch import Status, kernel, swim_batch
from fin_sim.batch.columns import fin_columns, with_gaits
from fin_sim.batch.general_kernel import swim_by_general_kernel
from fin_sim.batch.kernel import generate
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.loops import code_of
from fin_sim.batch.result import FIGURES
from fin_sim.batch.step import Form
from fin_sim.batch.task import checked_task
from fin_sim.batch.tolerances import difference, error_floors
from fin_sim.chain import MAXIMUM_LINKS
from fin_sim.fish import Fish, Link
from support.lane_equations import interpret, straight_code
from support.paper_fish import FISH as PAPER_FISH
from support.paper_fish import paper_columns
from support.random_swims import RandomSwim, random_swim

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_sim.batch import Precision
    from fin_sim.batch.step import Code
    from fin_sim.batch.task import Task
    from fin_sim.chain import Clamp, Reactive

THREE_SERVOS = (Link(0.03, 0.04, 0.03, 0.5), Link(0.02, 0.03, 0.03, 0.5))
GAITS = {
    1: Gait((JointDrive(0.4, 1.0),)),
    3: Gait((JointDrive(0.1, 1.0), JointDrive(0.2, 1.0, -0.5), JointDrive(0.4, 1.0, -1.0))),
}
LONG = MAXIMUM_LINKS - 1
"""Segments of the longest fin on a fish with one driven joint."""


@pytest.fixture
def interpreted(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Form], Code]], None]:
    """Let generated code run as it stands, uncompiled; return what has it generated in another way."""
    interpret(monkeypatch)
    return lambda generator: monkeypatch.setattr(kernel, "code_of", generator)


def task_of(fish: Fish, clamp: str, reactive: str, precision: str, gait: Gait) -> Task:
    return checked_task(
        fish, gait, 0.1, reactive, clamp, 0.05 if clamp == "towed" else 0.0, 0.05, 0.03, 0.01, precision
    )


@pytest.mark.parametrize(
    ("driven", "clamp", "reactive", "precision"),
    [
        (1, "free", "tip", "double"),
        (1, "free", "distributed", "double"),
        (1, "towed", "distributed", "double"),
        (3, "free", "distributed", "double"),
        (3, "fixed", "tip", "double"),
        (3, "free", "tip", "single"),
    ],
)
def test_code_with_loops_over_the_links_does_what_straight_code_does(
    driven: int,
    clamp: Clamp,
    reactive: Reactive,
    precision: Precision,
    interpreted: Callable[[Callable[[Form], Code]], None],
) -> None:
    """With all that a form can have: taper, dampers, current, linear drag, drag by amplitude; chains of any length."""
    water = replace(PAPER_FISH.water, current_x=-0.03, current_y=0.02, oscillating_drag=1.5)
    plain = replace(PAPER_FISH, peduncle=THREE_SERVOS if driven == 3 else ())
    stream = replace(plain, body=replace(PAPER_FISH.body, linear_drag=0.02), water=water)
    for (fish, tip), segments in itertools.product(((plain, 0.025), (stream, 0.04)), (1, 2, 5)):
        columns = fin_columns(
            paper_columns(
                segments=segments,
                hinges="midpoint",
                height=0.025,
                tip_height=tip,
                young_modulus=[2e8, 1e9],
                hinge_damping=1e-5,
            )
        )
        task = task_of(fish, clamp, reactive, precision, GAITS[driven])
        interpreted(straight_code)
        straight = lane_figures(task, columns)
        interpreted(code_of)
        looped = lane_figures(task, columns)
        assert looped == pytest.approx(straight, rel=1e-10 if precision == "double" else 1e-3, abs=1e-12)
        assert np.abs(straight[:, 0]).min() > 0.0 or clamp == "fixed"


@pytest.mark.parametrize("segments", [1, 3])
@pytest.mark.usefixtures("interpreted")
def test_a_gait_of_its_own_moves_a_fish_as_one_that_all_share(segments: int) -> None:
    fish = replace(PAPER_FISH, peduncle=THREE_SERVOS)
    columns = fin_columns(paper_columns(segments=segments, hinges="midpoint", young_modulus=[2e8, 1e9]))
    gait = Gait((*GAITS[3].joints[:2], JointDrive(0.4, 1.3, -1.0, 0.2)))
    task = task_of(fish, "free", "distributed", "double", gait)
    for ramp_time in (0.05, 0.0):
        shared = lane_figures(replace(task, ramp_time=ramp_time), columns)
        own = lane_figures(replace(task, gait=None, ramp_time=ramp_time), with_gaits(columns, [gait.rows()] * 2, 3))
        assert own == pytest.approx(shared, rel=1e-9, abs=1e-12)


@pytest.mark.usefixtures("interpreted")
def test_a_profile_along_a_straight_line_changes_nothing_and_one_beside_it_does() -> None:
    fish = replace(PAPER_FISH, water=replace(PAPER_FISH.water, oscillating_drag=1.5))
    plain = paper_columns(segments=4, hinges="midpoint", tip_height=0.045, young_modulus=[2e8, 1e9])
    task = task_of(fish, "free", "distributed", "double", GAITS[1])
    straight = lane_figures(task, fin_columns(plain))
    at = np.array([0.05, 0.1, 0.5, 0.85])
    on_line = 0.025 + (0.045 - 0.025) * at
    along = lane_figures(task, fin_columns({**plain, "profile_position": at, "profile_height": on_line}))
    assert along == pytest.approx(straight, rel=1e-9, abs=1e-12)
    positions, heights = np.array([at, at]), np.array([on_line, on_line])
    heights[1, :2] = 0.01
    positions[1, 2:] = heights[1, 2:] = np.nan
    mixed = lane_figures(task, fin_columns({**plain, "profile_position": positions, "profile_height": heights}))
    assert mixed[0] == pytest.approx(straight[0], rel=1e-9, abs=1e-12)
    assert mixed[1, 0] != pytest.approx(straight[1, 0], rel=1e-3)


@pytest.mark.parametrize("clamp", ["free", "fixed"])
@pytest.mark.usefixtures("interpreted")
def test_a_chain_that_is_not_finite_is_seen_and_spoils_no_neighbour(clamp: Clamp) -> None:
    moduli = np.array([1e9, np.nan, 1e9, np.inf])
    columns = fin_columns(paper_columns(segments=5, young_modulus=moduli))
    with np.errstate(all="ignore"):
        figures = lane_figures(task_of(PAPER_FISH, clamp, "tip", "double", GAITS[1]), columns)
    assert np.isnan(figures[[1, 3]]).all()
    assert np.array_equal(figures[0], figures[2])
    assert np.isfinite(figures[0]).all()


def test_one_compilation_serves_chains_of_every_length() -> None:
    codes = [generate(Form(1, links, free=True, distributed=True, tapered=True)) for links in (3, 12, 21)]
    assert len({id(code.advance) for code in codes}) == 1
    grown = np.diff([sum(code.operations.values()) for code in codes])
    assert grown[0] == grown[1]  # the cost is linear in the links


def test_a_long_fin_swims_in_lanes_the_same_alone_and_in_any_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        pytest.fail("swum by the general kernel")

    module = import_module("fin_sim.batch.swim_batch")
    monkeypatch.setattr(module, "swim_by_general_kernel", refuse)
    monkeypatch.setattr(module, "_BLOCK", 16)
    segments = np.resize([LONG, 13, LONG, 17], 37)
    columns = paper_columns(segments=segments, hinges="midpoint", tip_height=0.035)
    columns["young_modulus"] = np.geomspace(3e8, 3e9, 37)
    together = swim_batch(columns, PAPER_FISH, duration=2.0, threads=2)
    assert (together.status == Status.OK).all()
    for index in (0, 1, 3, 30, 36):
        own = {name: values if np.ndim(values) == 0 else values[index] for name, values in columns.items()}
        alone = swim_batch(own, PAPER_FISH, duration=2.0)
        assert alone.mean_speed[0] == together.mean_speed[index]
        assert alone.servo_power[0] == together.servo_power[index]


def long_swims(seed: int, count: int) -> list[RandomSwim]:
    """Return random swims of chains of 13 to 21 links whose hinges have enough damping for lanes."""
    random, swims = np.random.default_rng(seed), list[RandomSwim]()
    while len(swims) < count:
        swim, segments = random_swim(random), int(random.integers(13, LONG + 1))
        if swim.fin.damping_time > 0.0:
            swims.append(replace(swim, fin=replace(swim.fin, segments=segments)))
    return swims


def off(swim: RandomSwim) -> float:
    """Return a swim's largest difference from the general kernel over the tolerance, 0 where either has no figures."""
    shape = {"gait": swim.gait, "duration": swim.duration, "reactive": swim.reactive, "clamp": swim.clamp}
    timing = {"ramp_time": swim.ramp_time, "settle": swim.settle}
    swum = swim_batch([swim.fin], PAPER_FISH, **shape, **timing)  # type: ignore[arg-type]
    task = checked_task(PAPER_FISH, **shape, **timing, tow_speed=0.0, step=None, precision="double")
    fins = fin_columns([swim.fin])
    exact, status = swim_by_general_kernel(task, fins)
    if swum.status[0] != Status.OK or status[0] != Status.OK:
        return 0.0
    figures = np.array([[getattr(swum, name)[0] for name in FIGURES]])
    return float(difference(np.nan_to_num(figures), exact, error_floors(task, fins))[0])


FEW = [
    swim
    for swim in long_swims(3, 60)
    if swim.clamp == "free" and swim.reactive == "distributed" and swim.fin.height != swim.fin.tip_height
][:8]
"""They need the code of one form only."""
DEAR = {0, 3, 5, 7}
"""Of them, those for which the general kernel takes many seconds."""


@pytest.mark.parametrize(
    "swim", [pytest.param(swim, marks=[pytest.mark.long] * (index in DEAR)) for index, swim in enumerate(FEW)]
)
def test_random_long_chain_swims_in_a_batch_as_by_the_general_kernel(swim: RandomSwim) -> None:
    assert off(swim) < 1.0


@pytest.mark.long
def test_many_random_long_chains_swim_in_a_batch_as_by_the_general_kernel() -> None:
    assert max(off(swim) for swim in long_swims(4, 60)) < 1.0
