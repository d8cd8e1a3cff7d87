"""The simulator's fish in a plane ideal flow: the independent solver's swims, energy, bad input, batch."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, JointDrive
from fin_sim.batch import Status, swim_batch
from fin_sim.ideal_2d import plane_fish, plane_stepper
from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.errors import CollisionError
from fin_sim.ideal_2d.table import FoldError
from fin_sim.presets import preset
from fin_sim.swim import PAPER_FISH, swim
from support.plane_linkages import DATA, fish, largest_difference

if TYPE_CHECKING:
    from fin_sim.fish import Fish
    from fin_sim.swim_result import Swim

PAPER = preset("three_segments")


def plane(gap: float = 0.0) -> Fish:
    """Return the papers' fish in a plane ideal flow."""
    return replace(PAPER.fish, water=replace(PAPER.fish.water, model="ideal_2d", wake="none", drag="off", gap=gap))


def paper_fin(young_modulus: float = 2e9, damping_time: float = 0.03) -> Fin:
    return replace(PAPER.fin, young_modulus=young_modulus, damping_time=damping_time)


@pytest.fixture(scope="module")
def swum() -> Swim:
    return swim(paper_fin(), plane(), duration=10.0)


def references(model: str) -> list[dict[str, float]]:
    with (DATA / "fish_swims.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("model") == model]
    return [{name: float(value) for name, value in row.items()} for row in rows]


def test_the_fish_is_the_slice_that_the_reference_has() -> None:
    from fin_sim.chain import build_chain  # noqa: PLC0415

    cut = plane_fish.slice_of(build_chain(plane(), paper_fin()))
    matrix = AddedMass(plane_fish.linkage_of(cut)).matrix(np.array([0.2, 0.3, -0.4]))
    expected = AddedMass(fish(0.0, 32, 256)).matrix(np.array([0.2, 0.3, -0.4])) * 0.025
    assert largest_difference(matrix, expected) < 2e-6


@pytest.mark.parametrize("model", ["ideal_2d_sealed", "ideal_2d_gap_1mm"])
def test_the_fish_swims_as_far_as_that_of_the_reference(model: str) -> None:
    for row in references(model):
        fin = paper_fin(row["E_Pa"], row["damping_time_s"])
        found = swim(fin, plane(1e-3 if "gap" in model else 0.0), duration=10.0)
        assert math.hypot(found.x[-1], found.y[-1]) == pytest.approx(math.hypot(row["x_m"], row["y_m"]), rel=0.02)
        assert found.largest_hinge_angle == pytest.approx(row["largest_passive_angle"], rel=0.06), (
            "seldom sampled there"
        )
        if "gap" in model:
            assert found.heading[-1] == pytest.approx(row["heading"], rel=2e-3)
            assert found.x[-1] == pytest.approx(row["x_m"], rel=2e-3)


def test_with_the_references_circulation_the_sealed_fish_swims_as_the_references(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = plane_fish.slice_of
    monkeypatch.setattr(plane_stepper, "slice_of", lambda chain: own(chain)._replace(circulation="free"))
    row = references("ideal_2d_sealed")[0]
    found = swim(paper_fin(row["E_Pa"], row["damping_time_s"]), plane(), duration=10.0)
    assert found.x[-1] == pytest.approx(row["x_m"], rel=1e-3)
    assert found.heading[-1] == pytest.approx(row["heading"], rel=1e-3)
    assert found.y[-1] == pytest.approx(row["y_m"], rel=1e-3)


def test_what_the_servo_gives_goes_into_motion_springs_and_dampers(swum: Swim) -> None:
    """The power of servo and dampers is the change of kinetic and elastic energy."""
    cut = plane_fish.slice_of(swum.chain)
    mass = AddedMass(plane_fish.linkage_of(cut))
    links = swum.chain.links[1:]
    begin, end = 300, 420
    rates = np.column_stack((swum.surge, swum.sway, swum.yaw_rate, swum.joint_rates))

    def energy(at: int) -> float:
        springs = sum(0.5 * link.stiffness * swum.joint_angles[at, 1 + k] ** 2 for k, link in enumerate(links))
        return float(0.5 * rates[at] @ mass.matrix(swum.joint_angles[at]) @ rates[at] + springs)

    lost = sum(link.damping * swum.joint_rates[:, 1 + k] ** 2 for k, link in enumerate(links))
    work = swum.mean_between(swum.servo_power - lost, swum.time[begin], swum.time[end])
    assert energy(end) - energy(begin) == pytest.approx(work * (swum.time[end] - swum.time[begin]), abs=2e-9)


def test_it_has_no_momentum_at_any_time(swum: Swim) -> None:
    mass = AddedMass(plane_fish.linkage_of(plane_fish.slice_of(swum.chain)))
    rates = np.column_stack((swum.surge, swum.sway, swum.yaw_rate, swum.joint_rates))
    for at in (100, 400, 900):
        matrix = mass.matrix(swum.joint_angles[at])
        momentum = matrix[:3] @ rates[at]
        assert np.max(np.abs(momentum) / (np.abs(matrix[:3]) @ np.abs(rates[at]))) < 1e-4, "the table's error"


def test_a_rigid_fin_leads_nowhere() -> None:
    """One servo is a scallop: with a stiff fin, whatever it does, the fish is where it was after each beat."""
    gait = replace(PAPER_GAIT, joints=(JointDrive(amplitude=0.3, frequency=1.0),))
    stiff = replace(PAPER.fin, segments=1)
    found = swim(stiff, plane(), gait, 10.0)
    reached = math.hypot(found.x[-1], found.y[-1])
    assert reached < 1e-9
    assert np.max(np.abs(found.heading)) > 0.01


def test_a_batch_swims_as_each_swim_alone(swum: Swim) -> None:
    fins = [paper_fin(), paper_fin(3e9, 0.1), paper_fin(1.33e9, 0.0), replace(paper_fin(), segments=20)]
    batch = swim_batch(fins, plane(), duration=10.0)
    assert list(batch.status) == [Status.OK, Status.OK, Status.BEYOND_TABLE, Status.REFUSED]
    assert batch.mean_speed[0] == pytest.approx(swum.mean_speed, rel=1e-3)
    assert batch.heading[0] == pytest.approx(swum.heading[-1], rel=1e-3)
    assert "folds beyond what the plane flow holds" in batch.reason(2)
    assert "use fewer segments" in batch.reason(3)


def test_a_fold_is_told_with_joint_and_time() -> None:
    with pytest.raises(FoldError, match=r"joint \d folds to .* rad at t = .* s, the plane flow holds from"):
        swim(paper_fin(1.33e9, 0.0), plane())


@pytest.mark.long
def test_beyond_its_table_a_fin_of_many_hinges_swims_as_within(monkeypatch: pytest.MonkeyPatch) -> None:
    """The default fish bends further near its resonance than a table of seven joints can hold."""
    fish = replace(PAPER_FISH, water=plane().water)
    tabled = swim(Fin(young_modulus=1e9), fish, duration=1.0)
    monkeypatch.setattr(plane_stepper, "OF_MANY", ((0.01, 1),))
    direct = swim(Fin(young_modulus=1e9), fish, duration=1.0)
    assert tabled.largest_hinge_angle > 0.1
    assert direct.joint_angles == pytest.approx(tabled.joint_angles, abs=2e-3 * tabled.largest_hinge_angle)
    assert direct.heading == pytest.approx(tabled.heading, abs=1e-4)
    power = np.max(np.abs(tabled.servo_power))
    assert direct.servo_power == pytest.approx(tabled.servo_power, abs=5e-3 * power)
    assert direct.joint_torques == pytest.approx(tabled.joint_torques, abs=5e-3 * np.max(np.abs(tabled.joint_torques)))


@pytest.mark.long
def test_the_default_fish_swims_near_its_resonance_and_folds_onto_itself_at_it() -> None:
    fish = replace(PAPER_FISH, water=plane().water)
    found = swim(Fin(), fish, duration=10.0)
    assert found.largest_hinge_angle > max(reach for reach, _ in plane_stepper.OF_MANY)
    assert found.mean_speed == pytest.approx(6.09e-4, rel=0.02)
    with pytest.raises(CollisionError, match=r"collide at t = 6|come too close .* at t = 6"):
        swim(Fin(young_modulus=3e9), fish, duration=10.0)
    batch = swim_batch([Fin(young_modulus=3e9)], fish, duration=10.0)
    assert list(batch.status) == [Status.BEYOND_TABLE]
    assert "onto itself or the body" in batch.reason(0)


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({"wake": "lighthill"}, {}, "water.wake = lighthill and water.drag = off: a plane flow has neither"),
        ({"drag": "on"}, {}, "water.wake = none and water.drag = on: a plane flow has neither"),
        ({"gap": 0.03}, {}, r"ideal_2d.gap = 0.03 m must be 0, for no gap, or .* to 0.0133 m"),
        ({}, {"clamp": "fixed"}, "clamp = fixed with water.model = ideal_2d: without a wake"),
        ({}, {"clamp": "towed"}, "clamp = towed with water.model = ideal_2d"),
    ],
)
def test_what_a_plane_flow_has_not_is_refused(
    changes: dict[str, object], arguments: dict[str, object], message: str
) -> None:
    there = plane()
    there = replace(there, water=replace(there.water, **changes))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        swim(paper_fin(), there, **arguments)  # type: ignore[arg-type]


def test_a_tail_that_begins_inside_of_the_body_is_refused() -> None:
    there = plane()
    with pytest.raises(ValueError, match=r"body.tail_offset = 0.05 m begins the tail inside of the body"):
        swim(paper_fin(), replace(there, body=replace(there.body, tail_offset=0.05)))


def test_the_current_carries_the_fish(swum: Swim) -> None:
    there = plane()
    drifting = swim(paper_fin(), replace(there, water=replace(there.water, current_x=0.02)), duration=10.0)
    assert drifting.x - swum.x == pytest.approx(0.02 * swum.time, abs=1e-9)
    assert drifting.heading == pytest.approx(swum.heading, abs=1e-12)
