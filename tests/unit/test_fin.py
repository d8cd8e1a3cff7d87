"""A fin is what can be cut, and its hinges follow the papers' equation 3."""

import math

import pytest

from fin_plant.fin import Fin, ProfiledFin
from support.paper_fish import paper_fin


@pytest.mark.parametrize(
    ("fin", "stiffness"),
    [
        (paper_fin(young_modulus=1.9e9, length=0.08, height=0.025, tip_height=0.025), 1.35e-3),
        (paper_fin(young_modulus=7.55e9, length=0.14, height=0.0143, tip_height=0.0143), 1.73e-3),
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


# -- shapes ----------------------------------------------------------------------------------------------------------

LEAF = ProfiledFin(height=0.01, tip_height=0.01, profile_position=(0.3, 0.9), profile_height=(0.02, 0.05))


@pytest.mark.parametrize(("shape", "ratio"), [("rectangular", 1.0), ("flaring", 3.0), ("tapered", 1.0 / 3.0)])
def test_named_shapes_keep_length_area_and_material(shape: str, ratio: float) -> None:
    fin = Fin(height=0.03, tip_height=0.01, density=900.0, segments=7)
    shaped = fin.shaped(shape)
    assert shaped.area == pytest.approx(fin.area)
    assert shaped.tip_height == pytest.approx(ratio * shaped.height)
    assert (shaped.length, shaped.density, shaped.segments) == (fin.length, 900.0, 7)


def test_an_unknown_shape_is_refused() -> None:
    with pytest.raises(ValueError, match="shape = 'round'"):
        Fin().shaped("round")


def test_a_profile_runs_through_its_points() -> None:
    assert LEAF.height_at(0.3 * LEAF.length) == pytest.approx(0.02)
    assert LEAF.height_at(0.6 * LEAF.length) == pytest.approx(0.035)
    assert LEAF.height_at(LEAF.length) == 0.01
    assert LEAF.area == pytest.approx(LEAF.length * (0.3 * 0.015 + 0.6 * 0.035 + 0.1 * 0.03))


ONE_POINT = ProfiledFin(height=0.02, tip_height=0.02, profile_position=(0.5,), profile_height=(0.055,))


def test_a_fin_of_another_length_has_its_area_whatever_its_profile() -> None:
    """30 cm^2 of 8 cm with a point in its middle: at 5 and 12 cm too, its heights in proportion."""
    assert ONE_POINT.area == pytest.approx(30e-4, rel=1e-14)
    short, long = ONE_POINT.at_length(0.05), ONE_POINT.at_length(0.12)
    assert (short.length, long.length) == (0.05, 0.12)
    assert [short.area, long.area] == pytest.approx([30e-4, 30e-4], rel=1e-14)
    assert short.heights == pytest.approx((0.032, 0.088, 0.032), rel=1e-14)
    assert long.heights == pytest.approx((0.02 / 1.5, 0.055 / 1.5, 0.02 / 1.5), rel=1e-14)


@pytest.mark.parametrize("fin", [Fin(), Fin(tip_height=0.04, density=900.0, segments=7, young_modulus=2e9), LEAF])
def test_all_else_of_a_fin_of_another_length_stays(fin: Fin) -> None:
    assert fin.at_length(fin.length) == fin
    longer = fin.at_length(0.1).as_parameters()
    others = {name: value for name, value in fin.as_parameters().items() if "height" not in name}
    assert longer | others == longer | {"fin.length": fin.length}


@pytest.mark.parametrize(("length", "name"), [(0.0, "fin.length"), (math.nan, "fin.length"), (0.006, "fin.height")])
def test_a_length_at_which_the_fin_cannot_be_is_refused(length: float, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} = "):
        Fin(height=0.1, tip_height=0.1).at_length(length)


def test_a_profiled_fin_and_its_parameters_are_the_same_thing() -> None:
    assert Fin.from_parameters(LEAF.as_parameters()) == LEAF
    assert LEAF.as_parameters()["fin.profile_position"] == [0.3, 0.9]
    assert Fin().as_parameters()["fin.profile_height"] == []


@pytest.mark.parametrize(
    ("position", "height", "message"),
    [
        ((0.5,), (), "fin.profile_position has 1 entries and fin.profile_height 0"),
        ((0.6, 0.5), (0.02, 0.02), "must rise"),
        ((0.0,), (0.02,), "must rise"),
        ((1.5,), (0.02,), r"fin.profile_position = 1\.5 is outside"),
        ((0.5,), (-0.02,), r"fin.profile_height = -0\.02 m is outside"),
        ((math.nan,), (0.02,), "fin.profile_position = nan"),
    ],
)
def test_a_profile_that_cannot_be_is_refused(
    position: tuple[float, ...], height: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        ProfiledFin(profile_position=position, profile_height=height)
