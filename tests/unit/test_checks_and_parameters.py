"""Refusals name the parameter, the value and the allowed range; tables hold what they promise."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_plant import checks
from fin_plant.fin import PLANT_PARAMETERS
from fin_plant.parameters import Parameter, ParameterTable


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_is_returned_exactly_when_it_lies_in_the_range(value: float) -> None:
    if math.isfinite(value) and -1.0 <= value <= 2.5:
        assert checks.number("x", value, -1.0, 2.5) == value
    else:
        with pytest.raises(ValueError, match=r"x = .* m is outside the allowed range \[-1, 2.5\] m"):
            checks.number("x", value, -1.0, 2.5, unit="m")


@pytest.mark.parametrize("value", ["1.0", b"1", True, None, [1.0], "nan"])
def test_what_is_no_number_is_refused_by_name(value: object) -> None:
    with pytest.raises(ValueError, match=r"x must be a number, got .*allowed is \[0, 1\]"):
        checks.number("x", value, 0.0, 1.0)  # type: ignore[arg-type]


def test_an_exclusive_minimum_refuses_the_minimum_itself() -> None:
    with pytest.raises(ValueError, match=r"\(0, 1\]"):
        checks.number("x", 0.0, 0.0, 1.0, exclusive_minimum=True)


@pytest.mark.parametrize("value", [2.5, math.nan, -1, 21, "3"])
def test_a_whole_number_refuses_fractions_and_what_lies_outside(value: object) -> None:
    with pytest.raises(ValueError, match="segments"):
        checks.whole_number("segments", value, 1, 20)


def test_the_plants_defaults_pass_their_own_ranges() -> None:
    values = PLANT_PARAMETERS.checked({})
    assert values.keys() == PLANT_PARAMETERS.keys()
    assert values["fin.thickness"] == 2.08e-4


def test_every_parameter_of_the_plants_has_a_description_and_every_number_a_unit_or_none() -> None:
    for parameter in PLANT_PARAMETERS.values():
        assert len(parameter.description) > 10, parameter.name
        assert parameter.reason or parameter.name == "fin.hinges", parameter.name


def test_an_unknown_name_is_refused_with_the_nearest_ones() -> None:
    with pytest.raises(ValueError, match=r"fin.yung_modulus is not a parameter: did you mean .*fin.young_modulus"):
        PLANT_PARAMETERS.checked({"fin.yung_modulus": 1e9})


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        ("double", 1.5, "1.5"),
        ("integer", 3, 3.5),
        ("bool", True, 1),
        ("string", "a", 1),
        ("double_array", [1.0, 2.0], [1.0, math.nan]),
        ("string_array", ["a", "b"], "ab"),
    ],
)
def test_each_kind_takes_its_own_values_and_refuses_others(kind: str, good: object, bad: object) -> None:
    parameter = Parameter("p", kind, good, "what it is")  # type: ignore[arg-type]
    assert parameter.check(good) == good
    with pytest.raises(ValueError, match="p"):
        parameter.check(bad)


def test_a_group_holds_the_names_under_its_prefix_only() -> None:
    table = ParameterTable({name: Parameter(name, "double", 0.0, "x") for name in ("a.b", "a.c", "ab.c")})
    assert list(table.group("a")) == ["a.b", "a.c"]


def test_a_whole_number_keeps_every_digit() -> None:
    assert checks.whole_number("seed", 2**53 + 1) == 2**53 + 1
    with pytest.raises(ValueError, match="seed"):
        checks.whole_number("seed", 2**63, 0, 2**63 - 1)


def test_a_number_too_long_for_a_float_is_refused_as_too_large() -> None:
    with pytest.raises(ValueError, match=r"x = inf s is outside the allowed range \[0, 10\] s"):
        checks.number("x", 10**400, 0.0, 10.0, unit="s")


def test_lists_that_belong_together_are_told_apart_by_their_lengths() -> None:
    names = {"a.length": "", "a.height": "a.length", "b.other": ""}
    table = ParameterTable(
        {name: Parameter(name, "double_array", [], "x", one_for_each=first) for name, first in names.items()}
    )
    assert table.lists_apart({"a.length": [1.0], "a.height": [2.0], "b.other": [1.0, 2.0]}) == {}
    apart = table.lists_apart({"a.length": [1.0, 2.0], "a.height": [2.0], "b.other": []})
    assert apart.keys() == {"a.length", "a.height"}
    assert all("a.length 2, a.height 1" in words for words in apart.values())
