"""Fins of later papers: what is printed of them becomes a fin, a drive and a fish, and their order is known."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_sim.validation import later_fins
from fin_sim.validation.measured_fins import correlation

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_plant.fin import Fin
    from fin_sim.validation.later_fins import LaterFin

FINS = later_fins.read_fins(Path(__file__).parents[2] / "tests" / "data" / "later_fins.csv")
PRINTED = [fin for fin in FINS if fin.paper == 2015]
MEASURED = np.array([fin.measured for fin in PRINTED])


def test_no_inputs_are_known_of_the_fins_of_2014_and_all_of_those_of_2015() -> None:
    assert [fin.name for fin in PRINTED] == ["best speed", "best energy", "dominated", "hand chosen"]
    assert all(min(fin.frequency, fin.duty, fin.length, fin.height, fin.spring) > 0.0 for fin in PRINTED)
    assert [max(fin.frequency, fin.length, fin.spring) for fin in FINS if fin.paper == 2014] == [0.0] * 4


@pytest.mark.parametrize(("paper", "expected"), [(2014, (0.0, 0.0)), (2015, (1.0, 1.0))])
def test_rank_correlation_of_the_authors_own_simulations(paper: int, expected: tuple[float, float]) -> None:
    rows = np.array([(fin.measured, fin.published) for fin in FINS if fin.paper == paper])
    assert correlation(*rows.T) == pytest.approx(expected)


def test_printed_spring_constant_becomes_a_sheet_or_ten_hinges() -> None:
    best = PRINTED[0]
    sheet, chain = later_fins.as_sheet(best), later_fins.as_chain(best)
    bending = sheet.young_modulus * best.height * later_fins.THICKNESS**3 / 12.0
    assert bending == pytest.approx(best.spring * best.length)  # E I = K L
    assert sheet.young_modulus == pytest.approx(1.32e6, rel=0.005)
    assert chain.hinge_stiffness(0.5 * best.length) == pytest.approx(50e-6)
    assert (chain.segments, chain.hinges) == (10, "between")


def test_actuator_does_what_figure_5_shows() -> None:
    beat = np.degrees(later_fins.actuator_angle(0.5, 0.4, 2000))  # a row a millisecond
    assert beat[[0, 110, 250, 399]] == pytest.approx([0.0, 38.0, 38.0, 38.0], abs=0.5)
    assert beat[[505, 620, 999]] == pytest.approx([19.0, 0.0, 0.0], abs=0.5)
    assert beat[1000:] == pytest.approx(-beat[:1000])


def test_fast_beat_reaches_half_the_amplitude_and_is_centred() -> None:
    beat = np.degrees(later_fins.actuator_angle(3.8, 0.5))
    quarter = 0.25 / 3.8
    # A quarter of a beat at 38 / 0.11 degrees a second, and a quarter back at 38 / 0.21: from -r to a, and a to r.
    up, back = 38.0 / 0.11 * quarter, 38.0 / 0.21 * quarter
    assert beat.max() == pytest.approx(0.5 * (up + back), abs=0.1)
    assert beat.mean() == pytest.approx(0.0, abs=1e-9)


def test_square_drive_has_the_harmonics_of_a_square() -> None:
    slow = later_fins.actuator_angle(1e-3, 1.0)
    expected = 4.0 / math.pi * later_fins.LARGEST_ANGLE / np.array([1, 3, 5, 7])
    assert np.abs(later_fins.harmonics(slow)) == pytest.approx(expected, rel=0.01)


def test_rate_and_acceleration_are_the_angles_derivatives_also_during_the_ramp() -> None:
    time = np.linspace(0.0, 1.0, 20001)
    amplitudes = later_fins.harmonics(later_fins.actuator_angle(1.1, 0.12))
    angle, rate, bend = later_fins.motion(1.1, amplitudes, time)[:, 0].T
    assert np.gradient(angle, time)[1:-1] == pytest.approx(rate[1:-1], abs=1e-3)
    assert np.gradient(rate, time)[1:-1] == pytest.approx(bend[1:-1], abs=1e-2)
    assert angle[0] == rate[0] == bend[0] == 0.0


def test_small_fish_is_the_large_one_scaled() -> None:
    body = later_fins.small_fish().body
    assert body.mass == pytest.approx(0.0263, abs=1e-4)
    scale = (body.mass / 0.1979) ** (1.0 / 3.0)
    assert body.drag_area == pytest.approx(1.2e-3 * scale**2, rel=1e-3)
    assert body.yaw_drag == pytest.approx(4e-4 * scale**5, rel=1e-3)
    assert body.tail_offset == pytest.approx(0.0305)


def test_order_of_the_four_composites_is_right_but_for_the_closest_two() -> None:
    swum = [later_fins.swim(fin, later_fins.as_composite(fin), later_fins.small_fish()) for fin in PRINTED]
    speeds, torques = np.array(swum).T
    assert 100.0 * speeds == pytest.approx([5.7, 2.2, 6.9, 4.3], abs=0.1)
    assert correlation(MEASURED, speeds) == pytest.approx((0.8, 2 / 3))
    assert torques[[0, 2]].min() > 0.9 * later_fins.TORQUE
    assert torques[[1, 3]].max() < 0.25 * later_fins.TORQUE


@pytest.mark.long
@pytest.mark.parametrize(("make", "rho"), [(later_fins.as_sheet, 0.4), (later_fins.as_chain, 0.2)])
def test_order_of_fins_as_soft_as_the_printed_constants_is_not_right(
    make: Callable[[LaterFin], Fin], rho: float
) -> None:
    speeds = [later_fins.swim(fin, make(fin), later_fins.small_fish())[0] for fin in PRINTED]
    assert correlation(MEASURED, np.array(speeds))[0] == pytest.approx(rho)
