"""Fins that were printed and measured: what is simulated of them, and in which order."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fin_plant.gait import PAPER_GAIT
from fin_sim.batch import swim_batch
from fin_sim.materials import materials
from fin_sim.presets import preset
from fin_sim.validation import measured_fins
from fin_sim.validation.measured_fins import PrintedFin, Reading, SwumReading

DATA = Path(__file__).parents[2] / "tests" / "data"
FINS = measured_fins.printed_fins()
KNOWN = [index for index, fin in enumerate(FINS) if fin.modulus]
MEASURED = np.array([fin.measured for fin in FINS])


def test_six_fins_from_soft_to_stiff_with_the_makers_ranges() -> None:
    assert [fin.material for fin in FINS] == [
        "TangoBlackPlus",
        "DM9870",
        "DM9895",
        "DM8520",
        "DM8510",
        "VeroWhite",
    ]
    assert [FINS[index].modulus for index in KNOWN] == [
        materials()[name].young_modulus for name in ("TangoBlackPlus", "DM9870", "DM9895", "VeroWhite")
    ]
    assert pytest.approx([0.0, 0.0187, 0.0375, 0.0322, 0.0314, 0.0305]) == MEASURED


def test_a_fin_without_a_modulus_lies_between_its_neighbours() -> None:
    fins = [
        PrintedFin("soft", 0.0, (1e6, 4e6)),
        PrintedFin("one", 0.0, None),
        PrintedFin("two", 0.0, None),
        PrintedFin("stiff", 0.0, (4e8, 9e8)),
    ]
    tried = measured_fins.moduli(fins, 3)
    assert tried[0] == pytest.approx([1e6, 2e6, 4e6])
    assert tried[1] == pytest.approx([4e6, 4e6 * 10**0.5, 4e7])
    assert tried[2] == pytest.approx([4e7, 4e7 * 10**0.5, 4e8])
    assert tried[3] == pytest.approx([4e8, 6e8, 9e8])


def test_hinge_stiffness_is_the_sheets_whatever_it_is_cut_into() -> None:
    fin = preset("clark2012_fish").fin
    stiffness = measured_fins.hinge_stiffness(fin, [1e9, 2e9])
    by_hand = 1e9 * 0.025 * 1e-3**3 / (12.0 * 0.08 / 3.0)  # E d h^3 / (12 l)
    assert stiffness == pytest.approx([by_hand, 2.0 * by_hand])
    finer = replace(fin, segments=12, stiffness_length="fin")
    assert measured_fins.hinge_stiffness(finer, 1e9) == pytest.approx(by_hand)
    thin = replace(fin, thickness=3e-4)
    assert by_hand / measured_fins.hinge_stiffness(thin, 1e9) == pytest.approx(37.04, abs=0.01)


def test_rank_correlation_of_known_orders() -> None:
    one, other = np.array([5.17, 5.39, 5.62, 4.97]), np.array([7.43, 4.0, 5.0, 4.9])
    # Ranks 2 3 4 1 and 4 1 3 2: differences 2 -2 -1 1, so 1 - 6 * 10 / (4 * 15); pairs: 3 agree, 3 do not.
    assert measured_fins.correlation(one, other) == pytest.approx((0.0, 0.0))
    assert measured_fins.correlation(one, one**2) == pytest.approx((1.0, 1.0))
    assert measured_fins.correlation(one, -one) == pytest.approx((-1.0, -1.0))


def test_share_of_moduli_that_are_in_the_measured_order_is_counted() -> None:
    fins = [PrintedFin("a", 0.1, None), PrintedFin("b", 0.3, None), PrintedFin("c", 0.2, None)]
    given = preset("clark2012_fish")
    swum = SwumReading(Reading("", given), np.array([[1.0, 2.0], [4.0, 6.0], [1.5, 5.0]]))
    # a < c < b: of the pairs of a and c the three but (2, 1.5), times b 4 or 6 above c.
    assert swum.in_order(fins, [0, 1, 2]) == pytest.approx(4 / 8)
    assert swum.in_order(fins, [0, 1]) == 1.0
    assert swum.nominal.tolist() == [2.0, 6.0, 5.0]


@pytest.mark.parametrize("normal_drag", [1.0, 4.6])
def test_speeds_over_the_makers_ranges_are_those_that_others_computed(normal_drag: float) -> None:
    with (DATA / "measured_fins_1mm.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if float(row["C_N"]) == normal_drag]
    given = preset("clark2012_fish")
    fish = replace(
        given.fish,
        body=replace(given.fish.body, drag_area=float(rows[0]["SCD_m2"])),
        water=replace(given.fish.water, normal_drag=normal_drag),
    )
    ends = [(float(row[f"E_{end}_Pa"]), float(row[f"U_{end}_cm_s"])) for row in rows for end in ("low", "high")]
    time = float(rows[0]["damping_time_s"])
    fins = [replace(given.fin, young_modulus=modulus, damping_time=time) for modulus, _ in ends]
    beat = 1.0 / PAPER_GAIT.joints[0].frequency
    swum = swim_batch(fins, fish, PAPER_GAIT, 31.0 * beat, settle=22.0 * beat)
    # They do not say after what time; the softest fin is the one that still gains.
    assert 100.0 * swum.mean_forward_speed == pytest.approx([speed for _, speed in ends], rel=0.03)


def test_drag_area_is_fitted_to_the_anchor_alone() -> None:
    fitted = measured_fins.with_fitted_drag(preset("clark2012_fish"), 2.45e9, 0.0305)
    assert measured_fins.steady_speeds(fitted, [2.45e9]) == pytest.approx([0.0305], rel=2e-4)
    assert fitted.fish.body.drag_area == pytest.approx(1.242e-3, rel=0.005)
    assert replace(fitted.fish, body=replace(fitted.fish.body, drag_area=1.2e-3)) == preset("clark2012_fish").fish


@pytest.mark.parametrize(
    ("which", "speeds", "rho", "tau"),
    [(0, (1.36, 3.32, 3.94, 3.05), 0.8, 2 / 3), (1, (1.30, 2.90, 3.85, 3.05), 1.0, 1.0)],
)
def test_order_of_the_four_fins_at_their_nominal_moduli(
    which: int, speeds: tuple[float, ...], rho: float, tau: float
) -> None:
    reading = measured_fins.readings(FINS, 2)[which]
    assert reading.given.fish.water.oscillating_drag == (0.0, 8.0)[which]  # Graham 1980
    nominal = np.array([one[1] for one in measured_fins.moduli(FINS, 3)])
    simulated = measured_fins.steady_speeds(reading.given, nominal[KNOWN])
    assert 100.0 * simulated == pytest.approx(speeds, abs=0.03)
    assert measured_fins.correlation(MEASURED[KNOWN], simulated) == pytest.approx((rho, tau))


def test_speed_only_falls_where_two_fins_have_no_stated_modulus() -> None:
    between = np.geomspace(46e6, 2e9, 20)
    assert (np.diff(measured_fins.steady_speeds(preset("clark2012_fish"), between)) < 0.0).all()


def test_preset_swims_the_speed_that_its_file_states() -> None:
    assert 100.0 * measured_fins.steady_speeds(preset("clark2012_fish"), [2.5e9]) == pytest.approx([3.10], abs=0.01)


@pytest.mark.long
def test_a_finer_fin_swims_within_a_hundredth_of_the_preset_s() -> None:
    base = preset("clark2012_fish")
    nominal = [float(one[1]) for one, fin in zip(measured_fins.moduli(FINS, 3), FINS, strict=True) if fin.modulus]
    finer = replace(base, fin=replace(base.fin, segments=11))
    speeds = measured_fins.steady_speeds(base, nominal)
    assert measured_fins.steady_speeds(finer, nominal) == pytest.approx(speeds, rel=0.01)
