"""Conditions: only what they name has a meaning, units are checked once, and a refusal tells its numbers."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.search.conditions import Condition

UNITS = {
    "fin.length": "m",
    "fin.height": "m",
    "fin.profile_height[1]": "m",
    "fin.area": "m^2",
    "fin.segments": "",
    "fin.mass": "kg",
    "gait.frequency": "Hz",
    "servo.rate": "rad/s",
}
NUMBERS = {
    "fin.length": 0.08,
    "fin.height": 0.03,
    "fin.profile_height[1]": 0.02,
    "fin.area": 2e-3,
    "fin.segments": 3.0,
    "fin.mass": 2e-3,
    "gait.frequency": 1.0,
    "servo.rate": 1.0,
}


def refusal(text: str) -> str:
    return Condition.parse(text, UNITS).refusal(NUMBERS)


@pytest.mark.parametrize(
    "text",
    [
        "fin.length >= 2.6 * fin.height",
        "fin.length <= 80 mm",
        "1 cm < fin.height < fin.length <= 0.08 m",
        "servo.rate <= 57.3 deg/s",
        "fin.profile_height[1]**2 <= 4.01 cm^2",
        "sqrt(fin.area) >= fin.height",
        "max(fin.length, fin.height) - min(fin.length, fin.height) <= 9 cm / 1.5",
        "gait.frequency * fin.length <= 0.09 m/s",
        "-fin.length < 0.5 * abs(fin.height)",
        "fin.segments > 2.5",
        "1 / fin.length <= 12.6 m^-1",
        "109 mm < fin.length + fin.height < 111 mm",
        "1.9 g < sqrt(fin.mass ** 2) < 2.1 g",
        "0.9 Hz^3 < sqrt(gait.frequency ** 6) < 1.1 Hz^3",
        "6560 < fin.segments ** 8 < 6562",
        "fin.segments > " + "-" * 484 + "1",
        "fin.segments < " + "1+" * 242 + "1",
    ],
)
def test_what_holds_holds(text: str) -> None:
    assert not refusal(text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "fin.length >= 3 * fin.height",
            "is not met: 0.08 m >= 0.09 m is wrong (fin.length = 0.08 m, fin.height = 0.03 m)",
        ),
        (
            "10 mm < fin.length < 79 mm",
            "is not met: 0.08 m < 0.079 m is wrong (fin.length = 0.08 m)",
        ),
        (
            "1 / (fin.length - fin.length) > 1 m^-1",
            "cannot be computed (float division by zero) with fin.length = 0.08 m",
        ),
        (
            "sqrt(fin.area - 1 m^2) > 1 m",
            "cannot be computed (math domain error) with fin.area = 0.002 m^2",
        ),
    ],
)
def test_what_does_not_hold_is_told_with_its_numbers(text: str, why: str) -> None:
    assert refusal(text) == f"{text} {why}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fin.lenght > 3 m", "fin.lenght is not known: did you mean fin.length"),
        ("fin.length <= 96", "compares m with a plain number: write a quantity with its unit"),
        ("fin.length <= 96 s", "compares m with s$"),
        ("fin.length + fin.area > 1 m", r"adds m with m\^2"),
        ("fin.length - 1 < 1 m", "subtracts m with a plain number"),
        ("min(fin.length, fin.area) < 1 m", "takes the min of"),
        ("sqrt(fin.length) < 1 m", "sqrt of m has no unit"),
        ("sqrt(fin.area, fin.area) < 1 m", "sqrt takes one value"),
        ("max(fin.length) < 1 m", "max takes two or more values"),
        ("fin.length", "it compares nothing"),
        ("fin.length == 3 cm", "may compare with <, <=, > and >= only"),
        ("fin.length ^ 2 > 1 m^2", r"a power is written \*\*"),
        ("fin.length ** 9 > 1 m^9", "a whole number up to 8"),
        ("fin.length ** -9 > 1 m^-9", "a whole number up to 8"),
        ("fin.length ** 0.5 > 1 m", "a power is written"),
        ("9 ** 9 ** 9 > fin.segments", "a power is written"),
        ("1 < 2", "it names nothing of the fin or the gait"),
        ("fin.length > 3 lightyears", "it cannot be read"),
        ("fin.length >", "it cannot be read"),
        ("fin.length > True * 1 m", "'True' has no meaning here"),
        ("'a' < fin.segments", "has no meaning here"),
        ("fin.length.__class__ > 1 m", "fin.length.__class__ is not known"),
        ("__import__('os').system('true') > 1", "has no meaning here"),
        ("(lambda: fin.length)() > 1 m", "has no meaning here"),
        ("[fin.length for fin in fin] > 1 m", "has no meaning here"),
        ("fin.length > _unit_7 * 1 m", "_unit_ is no name"),
        ("fin.segments % 2 < 1", "has no meaning here"),
        ("min(fin.length, key=1) < 1 m", "has no meaning here"),
        ("fin.length > " + "(" * 300 + "1 m" + ")" * 300, "."),
        ("fin.length > " + "1 m + " * 200 + "1 m", "must be a text of at most 500"),
        ("fin.segments > " + "-" * 485 + "1", "must be a text of at most 500"),
        ("zzz > 1", "zzz is not known: there are fin.length, fin.height"),
        (3, "must be a text"),
    ],
)
def test_what_cannot_be_read_is_refused(text: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Condition.parse(text, UNITS)


def test_three_names_at_most_are_proposed() -> None:
    with pytest.raises(ValueError, match=r"ab5 is not known: did you mean ab\d or ab\d or ab\d\?$"):
        Condition.parse("ab5 > 1", dict.fromkeys(("ab1", "ab2", "ab3", "ab4"), ""))


def test_a_condition_is_known_by_its_text_and_names_without_the_blanks_around() -> None:
    read = Condition.parse("  fin.height < fin.length ", UNITS)
    assert (read.text, read.names) == ("fin.height < fin.length", ("fin.height", "fin.length"))


@pytest.mark.parametrize(
    ("text", "is_arithmetic"),
    [
        ("-fin.length + 3 * fin.height <= 2 m / 4 - 1 cm", True),
        ("fin.length ** 2 <= 1 m^2", False),
        ("abs(fin.length) <= 1 m", False),
    ],
)
def test_sums_products_and_quotients_alone_are_arithmetic(text: str, *, is_arithmetic: bool) -> None:
    assert Condition.parse(text, UNITS).is_arithmetic is is_arithmetic


def test_many_candidates_meet_it_as_each_alone_and_what_cannot_be_computed_is_not_met() -> None:
    read = Condition.parse("2 m^-1 < 1 / fin.length <= 12.5 m^-1", UNITS)
    lengths = np.array([0.5, 0.4, 0.08, 0.07, 0.0, math.inf, math.nan])
    assert read.met({"fin.length": lengths}).tolist() == [False, True, True, False, False, False, False]
    assert [read.refusal({"fin.length": float(length)}) == "" for length in lengths[:5]] == [0, 1, 1, 0, 0]
    below = Condition.parse("1 / fin.length > 2 m^-1", UNITS)
    assert not below.met({"fin.length": np.array([0.0])})[0]


@given(st.text(alphabet="fin.lengthsegments ()*+-/<>=1259e_mk[],'\"@:", max_size=60))
def test_any_text_is_a_condition_or_refused_as_one(text: str) -> None:
    read = None
    with contextlib.suppress(ValueError):
        read = Condition.parse(text, UNITS)
    if read is not None:
        assert isinstance(read.refusal(NUMBERS), str)
