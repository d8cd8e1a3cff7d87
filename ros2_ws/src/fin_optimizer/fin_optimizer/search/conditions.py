"""Conditions on a candidate as a person writes them: ``fin.length >= 3 * fin.height``, ``fin.length <= 96 mm``.

The text is read by Python's parser and its tree is walked; only what is named here has a meaning, and nothing of it is
ever run as a program. Units are checked once, when a condition is read.
"""

from __future__ import annotations

import ast
import difflib
import math
import operator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from fin_plant.units import PLAIN, QUANTITY, combined, si_unit, unit_of

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from fin_plant.units import Powers

    Numbers = Mapping[str, float]
    Term = tuple[Powers, Callable[[Numbers], float]]
    """A part of a condition: its unit, and its value in SI from those of all names."""

_LONGEST = 500
_LARGEST_POWER = 8
_UNIT_NAME = "_unit_"
_COMPARISONS = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
}
_FUNCTIONS: dict[str, Callable[..., float]] = {"min": min, "max": max, "abs": abs, "sqrt": math.sqrt}


@dataclass(frozen=True)
class Condition:
    """What a candidate must meet.

    Attributes:
        text: As it was written.
        names: What it names.
    """

    text: str
    names: tuple[str, ...] = field(compare=False, repr=False)
    _terms: tuple[Term, ...] = field(compare=False, repr=False)
    _signs: tuple[type[ast.cmpop], ...] = field(compare=False, repr=False)
    _units: Mapping[str, str] = field(compare=False, repr=False)
    is_arithmetic: bool = field(compare=False, repr=False)
    """Whether it has sums, products and quotients alone, so that its terms take arrays too."""

    @classmethod
    def parse(cls, text: object, units: Mapping[str, str]) -> Condition:
        """Read a condition.

        Args:
            text: Comparisons of sums, products, powers, min, max, abs and sqrt of names and quantities.
            units: SI unit of every name that may stand in it.

        Raises:
            ValueError: It is no such text, names what there is not, or mixes units.
        """
        if not isinstance(text, str) or len(text) > _LONGEST:
            msg = f"condition {text!r:.80} must be a text of at most {_LONGEST} letters, like fin.length <= 96 mm"
            raise ValueError(msg)
        return _Reader(text, units).condition()

    def refusal(self, numbers: Numbers) -> str:
        """Return why the numbers, in SI, do not meet it, or an empty text."""
        told = ", ".join(f"{name} = {numbers[name]:.6g} {self._units[name]}".rstrip() for name in self.names)
        try:
            values = [value(numbers) for _, value in self._terms]
        except (ArithmeticError, ValueError) as error:
            return f"{self.text} cannot be computed ({error}) with {told}"
        unit = f" {si_unit(self._terms[0][0])}".rstrip()
        for sign, (left, right) in zip(self._signs, pairwise(values), strict=True):
            word, holds = _COMPARISONS[sign]
            if not holds(left, right):
                return f"{self.text} is not met: {left:.6g}{unit} {word} {right:.6g}{unit} is wrong ({told})"
        return ""

    def met(self, columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.bool_]:
        """Return which candidates meet it, shape as of the columns' values, if it `is_arithmetic`."""
        with np.errstate(all="ignore"):
            values = [np.asarray(value(columns)) for _, value in self._terms]  # type: ignore[arg-type]
            good = np.logical_and.reduce(np.broadcast_arrays(*map(np.isfinite, values)))
            for sign, (left, right) in zip(self._signs, pairwise(values), strict=True):
                good = good & _COMPARISONS[sign][1](left, right)
        return np.asarray(good)


class _Reader:
    """Reads one condition; the methods return the parts of its tree."""

    def __init__(self, text: str, units: Mapping[str, str]) -> None:
        self._text = text.strip()
        self._units = units
        self._names: dict[str, None] = {}
        self._quantities: list[str] = []
        self._is_arithmetic = True

    def condition(self) -> Condition:
        """Return the whole."""
        if _UNIT_NAME in self._text:
            self._refuse(f"{_UNIT_NAME} is no name")
        written = QUANTITY.sub(self._with_factor, self._text)
        try:
            tree = ast.parse(written, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            self._refuse("it cannot be read: write for example fin.length >= 3 * fin.height, or fin.length <= 96 mm")
        if not isinstance(tree, ast.Compare):
            self._refuse("it compares nothing: it needs one of <, <=, >, >=")
        for sign in tree.ops:
            if type(sign) not in _COMPARISONS:
                self._refuse("it may compare with <, <=, > and >= only; for an equality write a tie")
        terms = tuple(self._term(part) for part in (tree.left, *tree.comparators))
        for one, other in pairwise(terms):
            self._same(one[0], other[0], "compares")
        if not self._names:
            self._refuse("it names nothing of the fin or the gait")
        signs = tuple(map(type, tree.ops))
        return Condition(self._text, tuple(self._names), terms, signs, self._units, self._is_arithmetic)

    def _with_factor(self, found: re.Match[str]) -> str:
        number, unit = found[1], found[2]
        self._quantities.append(unit)
        return f"({number}*{_UNIT_NAME}{len(self._quantities) - 1})"

    def _error(self, why: str) -> ValueError:
        return ValueError(f"condition {self._text}: {why}")

    def _refuse(self, why: str) -> NoReturn:
        raise self._error(why)

    def _same(self, one: Powers, other: Powers, does: str) -> None:
        if one != other:
            left, right = (si_unit(powers) or "a plain number" for powers in (one, other))
            hint = ": write a quantity with its unit, for example 96 mm" if PLAIN in (one, other) else ""
            self._refuse(f"it {does} {left} with {right}{hint}")

    def _term(self, node: ast.AST) -> Term:
        match node:
            case ast.Constant(value=int() | float() as constant) if not isinstance(constant, bool):
                number = float(constant)
                return PLAIN, lambda _: number
            case ast.Name() | ast.Attribute() | ast.Subscript():
                return self._name(ast.unparse(node))
            case ast.UnaryOp(op=ast.USub()):
                powers, value = self._term(node.operand)
                return powers, lambda numbers: -value(numbers)
            case ast.BinOp():
                return self._pair(node)
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in _FUNCTIONS:
                return self._function(name, node.args)
        raise self._error(self._meaningless(node))

    def _meaningless(self, node: ast.AST) -> str:
        known = f"+ - * / **, {', '.join(_FUNCTIONS)}, names and quantities"
        return f"{ast.unparse(node)!r} has no meaning here: there are {known}"

    def _pair(self, node: ast.BinOp) -> Term:
        if isinstance(node.op, ast.Pow | ast.BitXor):
            return self._power(node)
        (one, left), (other, right) = self._term(node.left), self._term(node.right)
        match node.op:
            case ast.Mult():
                return combined(one, other), lambda numbers: left(numbers) * right(numbers)
            case ast.Div():
                return combined(one, other, -1), lambda numbers: left(numbers) / right(numbers)
            case ast.Add():
                self._same(one, other, "adds")
                return one, lambda numbers: left(numbers) + right(numbers)
            case ast.Sub():
                self._same(one, other, "subtracts")
                return one, lambda numbers: left(numbers) - right(numbers)
        raise self._error(self._meaningless(node))

    def _power(self, node: ast.BinOp) -> Term:
        power = node.right.value if isinstance(node.right, ast.Constant) else None
        if isinstance(node.op, ast.BitXor) or type(power) is not int or power > _LARGEST_POWER:
            self._refuse(f"a power is written ** and a whole number up to {_LARGEST_POWER}")
        self._is_arithmetic = False
        powers, value = self._term(node.left)
        return combined(PLAIN, powers, power), lambda numbers: float(value(numbers) ** power)

    def _name(self, name: str) -> Term:
        if name.startswith(_UNIT_NAME):
            factor, powers = unit_of(self._quantities[int(name.removeprefix(_UNIT_NAME))])
            return powers, lambda _: factor
        if name not in self._units:
            near = difflib.get_close_matches(name, self._units, n=3)
            hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(self._units)}"
            self._refuse(f"{name} is not known: {hint}")
        self._names[name] = None
        return unit_of(self._units[name])[1], lambda numbers: numbers[name]

    def _function(self, name: str, arguments: list[ast.expr]) -> Term:
        self._is_arithmetic = False
        several = name in {"min", "max"}
        if (len(arguments) < 2) if several else (len(arguments) != 1):  # noqa: PLR2004
            self._refuse(f"{name} takes {'two or more values' if several else 'one value'}")
        terms = [self._term(argument) for argument in arguments]
        for other, _value in terms:
            self._same(terms[0][0], other, f"takes the {name} of")
        powers = terms[0][0]
        if name == "sqrt":
            if any(power % 2 for power in powers):
                self._refuse(f"sqrt of {si_unit(powers)} has no unit")
            powers = (powers[0] // 2, powers[1] // 2, powers[2] // 2)
        work = _FUNCTIONS[name]
        return powers, lambda numbers: float(work(*(value(numbers) for _, value in terms)))
