"""Checks at the edge: every refusal names the quantity, the value got, the allowed range and what to do."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from typing import TYPE_CHECKING, SupportsFloat

if TYPE_CHECKING:
    from collections.abc import Collection


def describe_range(minimum: float, maximum: float, unit: str = "", *, exclusive_minimum: bool = False) -> str:
    """Return the interval as a reader would write it, for example ``[0.1, 2] m``."""
    suffix = f" {unit}" if unit else ""
    if math.isinf(maximum) and math.isinf(minimum):
        return f"any finite number{suffix and ' of'}{suffix}"
    opening = "(" if exclusive_minimum else "["
    closing = ")" if math.isinf(maximum) else "]"
    return f"{opening}{minimum:g}, {maximum:g}{closing}{suffix}"


class NumberError(ValueError, ArgumentTypeError):
    """A text is no number: argparse says so in these words, and not by the name of a function."""


def read_number(text: str) -> float:
    """Return the number that a text stands for; not what only Python takes for one: `1_000`, digits of other scripts.

    Also a `type` of argparse.

    Raises:
        NumberError: It is no number.
    """
    try:
        if text.isascii() and "_" not in text:
            return float(text)
    except ValueError:
        pass
    msg = f"{text!r} is no number: write its digits from 0 to 9, a point, an exponent, no more"
    raise NumberError(msg)


def read_whole_number(text: str) -> int:
    """Return the whole number that a text stands for, as `read_number` does.

    Raises:
        NumberError: It is none.
    """
    read_number(text)
    try:
        return int(text)
    except ValueError:
        msg = f"{text!r} is no whole number: write its digits from 0 to 9, no more"
        raise NumberError(msg) from None


def number(
    name: str,
    value: SupportsFloat,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    *,
    unit: str = "",
    exclusive_minimum: bool = False,
    advice: str = "",
) -> float:
    """Return ``value`` as a finite float inside ``[minimum, maximum]``.

    Args:
        name: What the value is, as the user knows it.
        value: The value got.
        minimum: Smallest value allowed, itself allowed unless ``exclusive_minimum``.
        maximum: Largest value allowed.
        unit: Unit of value and range, for the message.
        exclusive_minimum: Refuse ``minimum`` itself too.
        advice: What the user should do, appended to the message.

    Raises:
        ValueError: The value is no number, not finite or outside the range.
    """
    allowed = describe_range(minimum, maximum, unit, exclusive_minimum=exclusive_minimum)
    hint = f"; {advice}" if advice else ""
    if isinstance(value, bool | str | bytes):
        msg = f"{name} must be a number, got {value!r}: allowed is {allowed}{hint}"
        raise ValueError(msg)
    try:
        result = float(value)
    except (TypeError, ValueError):
        msg = f"{name} must be a number, got {value!r}: allowed is {allowed}{hint}"
        raise ValueError(msg) from None
    except OverflowError:  # a whole number of more than 308 digits
        result = math.inf
    too_low = result <= minimum if exclusive_minimum else result < minimum
    if not math.isfinite(result) or too_low or result > maximum:
        shown = f"{result:.6g}{' ' + unit if unit else ''}"
        msg = f"{name} = {shown} is outside the allowed range {allowed}{hint}"
        raise ValueError(msg)
    return result


def whole_number(name: str, value: object, minimum: int = 0, maximum: int | None = None, *, advice: str = "") -> int:
    """Return ``value`` as an int inside ``[minimum, maximum]``.

    Raises:
        ValueError: The value is not whole or outside the range.
    """
    upper = math.inf if maximum is None else float(maximum)
    if isinstance(value, int) and not isinstance(value, bool):  # above 2^53 a float would be another number
        if minimum <= value and (maximum is None or value <= maximum):
            return value
        msg = f"{name} = {value} is outside the allowed range {describe_range(float(minimum), upper)}"
        raise ValueError(f"{msg}; {advice}" if advice else msg)
    as_float = number(name, value, float(minimum), upper, advice=advice)  # type: ignore[arg-type]
    if as_float != int(as_float):
        msg = f"{name} = {as_float:g} must be a whole number in {describe_range(float(minimum), upper)}"
        raise ValueError(msg)
    return int(as_float)


def choice(name: str, value: object, allowed: Collection[str]) -> str:
    """Return ``value`` if it is one of the allowed names.

    Raises:
        ValueError: It is not.
    """
    if not isinstance(value, str) or value not in allowed:
        msg = f"{name} = {value!r} is not known: choose one of {', '.join(sorted(allowed))}"
        raise ValueError(msg)
    return value


def mapping(name: str, value: object) -> dict[str, object]:
    """Return a part of a file that must hold names with values.

    Raises:
        ValueError: It does not.
    """
    if not isinstance(value, dict):
        msg = f"{name} must be names with values, got {value!r}"
        raise ValueError(msg)
    return value


def counted(number: int, thing: str) -> str:
    """Return so many of a thing: ``1 trial``, ``3 trials``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
