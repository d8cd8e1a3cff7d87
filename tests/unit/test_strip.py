"""Young's modulus from a bent strip: the elastica's known numbers, errors by propagation, and the bench's command."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from fin_optimizer.search.stock import sheet
from fin_plant import yaml_file
from fin_sim.measure_strip import force, main, measured
from fin_sim.strip import LARGEST_SAG, Measured, load_number, modulus_of_strip

if TYPE_CHECKING:
    from numpy.typing import NDArray

E, LENGTH, WIDTH, THICKNESS = 2.31e9, 0.06, 0.01, 3e-4
STIFFNESS = E * WIDTH * THICKNESS**3 / 12.0
COMMAND = [
    *("--length", "60 +- 0.3 mm", "--width", "10 +- 0.1 mm", "--thickness", "0.300 +- 0.003 mm"),
    *("--weight", "0.5 g", "1 g", "--deflection", "6.8 +- 0.2 mm", "13.2 +- 0.2 mm", "--density", "1190 kg/m^3"),
]


def strip(
    force_error: float = 0.0, length: float = 0.0, width: float = 0.0, thickness: float = 0.0, deflection: float = 0.0
) -> tuple[Measured, Measured, Measured, list[tuple[Measured, Measured]]]:
    """Return a strip of E that sinks by 0.3 of its length, with these errors."""
    sag = 0.3
    load = load_number(sag) * STIFFNESS / LENGTH**2
    reading = (Measured("weight", load, force_error), Measured("deflection", sag * LENGTH, deflection))
    return (
        Measured("length", LENGTH, length),
        Measured("width", WIDTH, width),
        Measured("thickness", THICKNESS, thickness),
        [reading],
    )


@pytest.mark.parametrize(("load", "sag"), [(0.2, 0.06636), (0.4, 0.13098), (1.0, 0.30172), (2.0, 0.49346)])
def test_the_load_of_a_sag_is_that_of_published_tables(load: float, sag: float) -> None:
    """K. Mattiasson, Int. J. Numerical Methods in Engineering 17 (1981) 145, table for a tip load; five digits."""
    assert load_number(sag) == pytest.approx(load, rel=1e-4)


@pytest.mark.parametrize("load", [0.01, 0.3, 1.2, 2.0])
def test_the_load_of_a_sag_is_that_of_the_beam_s_equation(load: float) -> None:
    """Theta'' = -load cos theta, clamped at 0 and free of a moment at 1, solved by collocation."""

    def slope(_: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.vstack((y[1], -load * np.cos(y[0]), np.sin(y[0])))

    def ends(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([a[0], b[1], a[2]])

    mesh = np.linspace(0.0, 1.0, 60)
    solved = solve_bvp(slope, ends, mesh, np.zeros((3, 60)), tol=1e-9)
    assert load_number(float(solved.y[2, -1])) == pytest.approx(load, rel=1e-6)


def test_series_and_integrals_meet() -> None:
    for sag in (0.00099999, 0.00100001):
        assert load_number(sag) == pytest.approx(3.0 * sag * (1.0 + 36.0 / 35.0 * sag**2), rel=1e-9)


def test_a_strip_that_bends_far_gives_its_modulus_and_says_how_far_a_straight_beam_would_be_off() -> None:
    found = modulus_of_strip(*strip())
    assert found.value == pytest.approx(E, rel=1e-12)
    assert found.error == 0.0
    straight = strip()[3][0][0].value * LENGTH**3 / (3.0 * (WIDTH * THICKNESS**3 / 12.0) * 0.3 * LENGTH)
    assert found.correction == pytest.approx(straight / E, rel=1e-12)
    assert found.correction > 1.05


@pytest.mark.parametrize(
    "errors",
    [
        {"length": 1e-3},
        {"width": 2e-4},
        {"thickness": 6e-6},
        {"deflection": 4e-4},
        {"force_error": 2e-5},
        {"length": 1e-3, "width": 2e-4, "thickness": 6e-6, "deflection": 4e-4, "force_error": 2e-5},
    ],
)
def test_the_error_is_the_scatter_of_what_is_measured_with_such_errors(errors: dict[str, float]) -> None:
    given = strip(**errors)
    random = np.random.default_rng(1)
    length, width, thickness, ((load, deflection),) = given
    drawn = []
    for _ in range(1500):
        moved = [
            Measured(each.name, each.value + each.error * float(random.standard_normal()))
            for each in (length, width, thickness, load, deflection)
        ]
        drawn.append(modulus_of_strip(moved[0], moved[1], moved[2], [(moved[3], moved[4])]).value)
    # 1500 draws know a standard deviation within 1.8 %; the second order adds as much.
    assert modulus_of_strip(*given).error == pytest.approx(float(np.std(drawn)), rel=0.07)


def test_readings_that_differ_more_than_they_should_enlarge_the_error() -> None:
    length, width, thickness, ((load, deflection),) = strip()
    near = [(load, Measured("deflection", deflection.value * part, 1e-4)) for part in (0.999, 1.001)]
    far = [(load, Measured("deflection", deflection.value * part, 1e-4)) for part in (0.95, 1.05)]
    agreeing, differing = (modulus_of_strip(length, width, thickness, readings) for readings in (near, far))
    assert agreeing.scatter == 1.0
    assert differing.scatter > 5.0
    assert differing.error > 5.0 * agreeing.error


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: load_number(0.51), r"deflection over length = 0.51 is outside .*take a smaller weight"),
        (lambda: load_number(0.0), "deflection over length = 0 is outside"),
        (lambda: modulus_of_strip(*strip()[:3], []), "give one weight at least"),
        (
            lambda: modulus_of_strip(Measured("length", 2e-3), *strip()[1:]),
            "a strip 0.002 m long and 0.0003 m thick is no beam",
        ),
        (lambda: Measured("width", 0.01, 0.02), "width = 0.01 has an error of 0.02"),
        (lambda: Measured("width", 0.0), "width = 0 is outside"),
        (lambda: measured("length", "60 mm", "m"), "write value, error and unit"),
        (lambda: measured("length", "60 +- 1", "m"), "write value, error and unit"),
        (lambda: measured("length", "60 +- 1 s", "m"), "another kind of unit"),
        (lambda: force("2"), "write it with its unit"),
        (lambda: force("2 mm"), "another kind of unit"),
    ],
)
def test_what_measures_nothing_is_refused(wrong: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()  # type: ignore[operator]


def test_weights_are_masses_or_forces() -> None:
    assert force("2 g").value == pytest.approx(2e-3 * 9.81)
    assert force("20 +- 1 mN") == Measured("weight", 0.02, 0.001)


def test_the_command_s_entry_is_a_sheet_of_a_stock(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMMAND, "--name", "offcut"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("E = 2.263 +- 0.086 GPa")
    assert "the elastica was used" in said
    content = yaml_file.parse(said.splitlines()[-1].strip())
    assert isinstance(content, dict)
    found = sheet("offcut", content["offcut"])
    assert main([*COMMAND, "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert found.young_modulus == pytest.approx(numbers["young_modulus"], rel=1e-3)
    assert found.spread == pytest.approx(numbers["spread"], rel=0.05)
    assert (found.thickness, found.density) == (3e-4, 1190.0)
    assert math.hypot(*numbers["shares"].values()) == pytest.approx(numbers["spread"] / numbers["young_modulus"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--deflection", "40 +- 1 mm", "41 +- 1 mm"), f"is outside the allowed range (0, {LARGEST_SAG:g}]"),
        (("--deflection", "7 +- 1 mm"), "2 weights and 1 deflections: give one for each"),
        (("--thickness", "0.3 +- 0.1 m"), "fin.thickness = 0.3 m is outside"),
        (("--density", "1190 kg"), "density = '1190 kg' has another kind of unit"),
    ],
)
def test_the_command_refuses_with_numbers(
    change: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMMAND, *change]) == 2
    assert message in capsys.readouterr().err
