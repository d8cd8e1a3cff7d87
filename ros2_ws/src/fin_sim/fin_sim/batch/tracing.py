"""Straight-line code from ordinary functions: run once on recording numbers, they leave the operations they did.

A function of numbers that only adds, multiplies, divides, takes roots and selects can be run on `Number`s instead of
floats. Each operation is then written down once (the same operation on the same numbers is not repeated, nor are
products with 0 or 1), what no result needs is left out, and the rest is the body of a compiled loop.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_COMMUTING = {"add", "multiply"}
_TEXT = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "negate": "-{}",
    "absolute": "abs({})",
    "square_root": "math.sqrt({})",
    "floor": "math_floor({})",
    "maximum": "{0} if {0} > {1} else {1}",
    "select": "{1} if {0} >= ZERO else {2}",
}


class Number:
    """A number whose value is known only when the generated code runs."""

    __slots__ = ("index", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index

    def __add__(self, other: Real) -> Real:
        return self if _is(other, 0.0) else self.tape.record("add", self, other)

    __radd__ = __add__

    def __sub__(self, other: Real) -> Real:
        return self if _is(other, 0.0) else self.tape.record("subtract", self, other)

    def __rsub__(self, other: Real) -> Real:
        return -self if _is(other, 0.0) else self.tape.record("subtract", other, self)

    def __mul__(self, other: Real) -> Real:
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self.tape.record("multiply", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Real) -> Real:
        return self.tape.record("divide", self, other)

    def __rtruediv__(self, other: Real) -> Real:
        return 0.0 if _is(other, 0.0) else self.tape.record("divide", other, self)

    def __neg__(self) -> Number:
        return self.tape.record("negate", self)


Real = Number | float


def _is(value: Real, constant: float) -> bool:
    return not isinstance(value, Number) and value == constant


def square_root(value: Real) -> Real:
    """Return the square root of a number that is not negative."""
    return value.tape.record("square_root", value) if isinstance(value, Number) else math.sqrt(value)


def absolute(value: Real) -> Real:
    """Return the size of a number."""
    return value.tape.record("absolute", value) if isinstance(value, Number) else abs(value)


def floor(value: Real) -> Real:
    """Return the largest whole number that is not above ``value``."""
    return value.tape.record("floor", value) if isinstance(value, Number) else float(math.floor(value))


def maximum(one: Real, other: Real) -> Real:
    """Return the larger of two numbers."""
    if isinstance(one, Number):
        return one.tape.record("maximum", one, other)
    return other.tape.record("maximum", one, other) if isinstance(other, Number) else max(one, other)


def select(condition: Real, if_not_negative: Real, if_negative: Real) -> Real:
    """Return the second number where the first is 0 or more, else the third."""
    if isinstance(condition, Number):
        return condition.tape.record("select", condition, if_not_negative, if_negative)
    return if_not_negative if condition >= 0.0 else if_negative


class Tape:
    """The operations of one function, in their order; ``prefix`` begins the names of the numbers in the text."""

    def __init__(self, prefix: str = "t") -> None:
        self._prefix = prefix
        self._operations: list[tuple[str, tuple[int | float, ...]]] = []
        self._known: dict[tuple[str, tuple[int | float | str, ...]], Number] = {}

    def load(self, source: str) -> Number:
        """Return the number that the generated code reads from ``source``, a Python expression."""
        return self._append(f"load {source}", ())

    def record(self, operation: str, *operands: Real) -> Number:
        """Write an operation down, once."""
        keys = tuple(value.index if isinstance(value, Number) else float(value) for value in operands)
        if operation in _COMMUTING:
            keys = tuple(sorted(keys, key=lambda key: (isinstance(key, float), key)))
        return self._append(operation, keys)

    def _append(self, operation: str, keys: tuple[int | float, ...]) -> Number:
        identity = (operation, tuple(repr(key) for key in keys))
        if identity not in self._known:
            self._operations.append((operation, keys))
            self._known[identity] = Number(self, len(self._operations) - 1)
        return self._known[identity]

    def _needed(self, results: Iterable[Real]) -> set[int]:
        waiting = [value.index for value in results if isinstance(value, Number)]
        needed: set[int] = set()
        while waiting:
            index = waiting.pop()
            if index not in needed:
                needed.add(index)
                waiting += [key for key in self._operations[index][1] if isinstance(key, int)]
        return needed

    def lines(self, results: dict[str, Real], constants: dict[str, float]) -> list[str]:
        """Return the statements that compute ``results``, a number for each target of an assignment.

        Args:
            results: What to compute, by the Python expression that takes it.
            constants: Names given to the numbers in the text; new ones are added.
        """

        def text(key: float) -> str:
            if isinstance(key, int):
                return f"{self._prefix}{key}"
            name = next((name for name, value in constants.items() if repr(value) == repr(key)), None)
            if name is None:
                name = f"C{len(constants)}"
                constants[name] = key
            return name

        needed = self._needed(results.values())
        statements = []
        for index, (operation, keys) in enumerate(self._operations):
            if index in needed:
                source = operation[5:] if operation.startswith("load ") else _TEXT[operation].format(*map(text, keys))
                statements.append(f"{self._prefix}{index} = {source}")
        for target, value in results.items():
            statements.append(f"{target} = {text(value.index if isinstance(value, Number) else float(value))}")
        return statements

    def count(self, results: Iterable[Real]) -> Counter[str]:
        """Return how often each floating-point operation is done for ``results``."""
        needed = self._needed(results)
        operations = (self._operations[index][0] for index in needed)
        return Counter(operation for operation in operations if not operation.startswith("load "))
