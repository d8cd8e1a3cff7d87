"""A fin is what can be cut, and its hinges follow the papers' equation 3."""

import math

import pytest

from fin_plant.fin import Fin


@pytest.mark.parametrize(
    ("fin", "stiffness"),
    [
        (Fin(young_modulus=1.9e9, length=0.08, height=0.025, tip_height=0.025), 1.35e-3),
        (Fin(young_modulus=7.55e9, length=0.14, height=0.0143, tip_height=0.0143), 1.73e-3),
    ],
)
def test_the_paper_fin_has_the_stiffness_that_the_papers_print(fin: Fin, stiffness: float) -> None:
    # Solved for the thickness, the two printed values give 0.2087 and 0.2078 mm: they agree to 1.5 % in stiffness.
    assert fin.hinge_stiffness(fin.length / 3) == pytest.approx(stiffness, rel=0.015)


def test_a_tapered_fin_bends_easier_towards_its_tip() -> None:
    fin = Fin(height=0.03, tip_height=0.01)
    assert fin.hinge_stiffness(0.0) == pytest.approx(3 * fin.hinge_stiffness(fin.length))
    assert fin.area == pytest.approx(0.02 * fin.length)


def test_a_fin_and_its_parameters_are_the_same_thing() -> None:
    fin = Fin(young_modulus=2.5e9, segments=5, hinges="midpoint")
    assert Fin.from_parameters({**fin.as_parameters(), "speed": 3.0}) == fin


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("young_modulus", -1.0),
        ("young_modulus", math.nan),
        ("length", math.inf),
        ("height", 0.0),
        ("tip_height", -0.01),
        ("thickness", 0.0),
        ("segments", 0),
        ("segments", 2.5),
        ("hinges", "everywhere"),
        ("damping_time", -0.1),
        ("density", math.nan),
    ],
)
def test_a_fin_that_cannot_be_is_refused_by_name_value_and_range(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"fin\.{name} = ") as error:
        Fin(**{name: value})  # type: ignore[arg-type]
    assert any(word in str(error.value) for word in ("allowed range", "whole number", "choose one of"))


@pytest.mark.parametrize("extent", ["length", "height"])
def test_a_fin_thicker_than_long_or_high_is_refused(extent: str) -> None:
    with pytest.raises(ValueError, match=rf"fin.thickness = 0.02 m must be less than fin.{extent} = 0.015 m"):
        Fin(thickness=0.02, **{extent: 0.015})  # type: ignore[arg-type]
