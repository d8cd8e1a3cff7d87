"""The resistive coefficient by the tail's amplitude: numbers by hand, limits, and the same in every kernel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fin_plant.fin import Fin, ProfiledFin
from fin_plant.gait import Gait, JointDrive
from fin_sim.batch import Status, swim_batch
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.links import lane_constants, link_columns, normal_drags
from fin_sim.chain import RESISTIVE, Chain, build_chain
from fin_sim.energy import energy_budget
from fin_sim.fish import Fish, Link, Water
from fin_sim.swim import swim, swim_chain
from support.paper_fish import BODY, FIN

AMPLITUDE = math.radians(15.0)
GAIT = Gait((JointDrive(AMPLITUDE, 0.9),))
PLATES = Water(1000.0, 1.0, 8.0)


def coefficients(water: Water, gait: Gait, *links: Link, driven: int = 1) -> tuple[float, ...]:
    is_driven = tuple(index < driven for index in range(len(links)))
    return Chain(BODY, links, is_driven, water).for_gait(gait).normal_drags


def test_a_rigid_plate_has_twelve_elevenths_of_the_coefficient_at_its_tip() -> None:
    """KC = 2 pi A s / d grows as s: the mean of s^(-1/3) with the weight s^3 is 4 / (11/3) of that at the tip."""
    keulegan_carpenter = 2.0 * math.pi * AMPLITUDE * 0.08 / 0.025
    assert keulegan_carpenter == pytest.approx(5.264, abs=1e-3)
    (found,) = coefficients(PLATES, GAIT, Link(0.08, 0.025, 0.025))
    assert found == pytest.approx(12.0 / 11.0 * 8.0 * keulegan_carpenter ** (-1.0 / 3.0), rel=1e-5)
    assert found == pytest.approx(5.017, abs=1e-3)


def test_the_coefficient_does_not_depend_on_frequency_and_falls_with_the_cube_root_of_amplitude() -> None:
    plate = Link(0.08, 0.025, 0.025)
    slow, fast, wide = (
        coefficients(PLATES, Gait((JointDrive(a, f),)), plate)[0] for a, f in ((0.1, 0.5), (0.1, 4.0), (0.2, 0.5))
    )
    assert slow == pytest.approx(fast, rel=1e-12)
    assert wide == pytest.approx(slow / 2.0 ** (1.0 / 3.0), rel=1e-12)


def test_a_long_stroke_and_a_tail_at_rest_have_the_steady_coefficient() -> None:
    thin = Link(0.5, 1e-4, 1e-4)  # KC of 8000 at its tip, where a KC^(-1/3) is 0.4
    assert coefficients(Water(1000.0, 2.0, 8.0), GAIT, thin)[0] == pytest.approx(2.0, rel=1e-3)
    assert coefficients(PLATES, Gait((JointDrive(0.0, 0.0, 0.0, 0.1),)), Link(0.08, 0.025, 0.025)) == (1.0,)
    assert coefficients(Water(1000.0, 1.0), GAIT, Link(0.08, 0.025, 0.025)) == ()


def test_joints_that_beat_against_each_other_cancel_at_the_tip() -> None:
    """Amplitude A over 8 cm against 2 A over the last 4 cm: the end of the second link stays where it is."""
    links = (Link(0.04, 0.025, 0.025), Link(0.04, 0.025, 0.025))
    with_phase = Gait((JointDrive(0.1, 0.9), JointDrive(0.2, 0.9, math.pi)))
    together = Gait((JointDrive(0.1, 0.9), JointDrive(0.2, 0.9)))
    first, second = coefficients(PLATES, with_phase, *links, driven=2)
    assert first == pytest.approx(12.0 / 11.0 * 8.0 * (2.0 * math.pi * 0.1 * 0.04 / 0.025) ** (-1.0 / 3.0), rel=1e-5)
    # Falls from 4 mm to 0 along the second link, as it rises along the first: the same mean.
    assert second == pytest.approx(first, rel=1e-5)
    assert coefficients(PLATES, together, *links, driven=2)[1] < 0.7 * second


def test_a_rigid_tail_loses_the_power_of_the_law_taken_by_stations() -> None:
    """Mean of 1/2 rho C d |w|^3 over a beat of a held plate: 1/2 rho d C(s) (A omega s)^3 times 4 / (3 pi)."""
    plate = Chain(BODY, (Link(0.08, 0.025, 0.025),), (True,), PLATES, clamp="fixed")
    result = swim_chain(plate, GAIT, 4.0, sample_time=2e-3)
    lost = result.beat_mean(energy_budget(result).resistive)
    s = np.linspace(0.0, 0.08, 20001)[1:]
    law = 8.0 * (2.0 * math.pi * AMPLITUDE * s / 0.025) ** (-1.0 / 3.0)
    density = 500.0 * law * 0.025 * (AMPLITUDE * 2.0 * math.pi * 0.9 * s) ** 3 * 4.0 / (3.0 * math.pi)
    assert lost == pytest.approx(np.trapezoid(density, s), rel=1e-3)


@pytest.mark.parametrize("tip_height", [0.025, 0.05, 0.0])
def test_lanes_and_general_kernel_have_the_same_coefficients(tip_height: float) -> None:
    fish = Fish(BODY, PLATES, (Link(0.03, 0.04, 0.03, 0.5),))
    gait = Gait((JointDrive(0.1, 0.9), JointDrive(0.2, 0.9, -1.0)))
    fin = replace(FIN, tip_height=tip_height)
    columns = fin_columns([fin])
    links = link_columns(fish, columns)
    in_lanes = lane_constants(links, PLATES, normal_drags(links, columns, fish, gait.rows()[None]))
    chain = build_chain(fish, fin).for_gait(gait)
    expected = chain.link_table()[:, RESISTIVE] * links["root_height"][0] * links["length"][0] / 3.0
    assert in_lanes["resistive_force"][0] == pytest.approx(expected, rel=1e-12)
    assert len(set(chain.normal_drags)) == len(chain.links)


def test_the_batch_swims_with_it_in_lanes_and_by_the_general_kernel() -> None:
    fish = Fish(BODY, PLATES)
    fins: list[Fin] = [FIN, replace(FIN, damping_time=0.0)]
    values = {name: getattr(FIN, name) for name in FIN.__dataclass_fields__}
    fins.append(ProfiledFin(**values, profile_position=(0.5,), profile_height=(0.03,)))
    batch = swim_batch(fins, fish, GAIT, 4.0, threads=1)
    assert (batch.status == Status.OK).all()
    alone = [swim(fin, fish, GAIT, 4.0).mean_speed for fin in fins]
    assert batch.mean_speed == pytest.approx(alone, rel=1e-3)
    assert alone[0] != pytest.approx(swim(FIN, Fish(BODY, Water(1000.0, 1.0)), GAIT, 4.0).mean_speed, rel=0.02)
