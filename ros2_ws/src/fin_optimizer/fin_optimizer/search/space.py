"""Search for the best fin: what to try next, as a pure function of the seed and of what was tried before.

An algorithm keeps nothing between calls. It is *told* by the history and *asked* by ``propose``; its random numbers
come from a generator that the seed and the number of the candidate determine. So a study that was interrupted goes on
with bit for bit the candidates of one that was not, and every candidate can be recomputed from the journal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fin_optimizer.search.pareto import front
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

Scalar = float | str
"""What one parameter of a candidate may be: a number, whole or not, a truth value or a text."""
Values = dict[str, Any]
"""A candidate: the value of every parameter of the space, by name; each a `Scalar`."""

_DRAWS = 10_000
"""How often a candidate is drawn before a space is said to hold none."""
_DIGITS = 12
"""Of a stepped value: 0.045 m, not 0.045000000000000005."""
_ON_STEP = 1e-6
"""Part of a step by which a value may miss the grid."""


@dataclass(frozen=True)
class Dimension:
    """A range of numbers that the search may vary.

    A search moves in a *coordinate*: the value itself, or its logarithm. On a grid the coordinate goes half a step
    beyond both ends, so that all values are drawn alike.

    Attributes:
        name: The plant's parameter, for example ``fin.young_modulus``.
        minimum: Smallest value, in ``unit``.
        maximum: Largest value, in ``unit``.
        unit: SI unit, for messages and reports.
        log: Whether the search moves in the logarithm.
        step: Distance of two values in ``unit``, counted from the minimum; 0 for any value.
        whole: Whether only whole numbers count.

    Raises:
        ValueError: A bound that is not finite, bounds that leave no room, or a step or logarithm that cannot be.
    """

    name: str
    minimum: float
    maximum: float
    unit: str = ""
    log: bool = False
    step: float = 0.0
    whole: bool = False

    def __post_init__(self) -> None:
        for bound in ("minimum", "maximum"):
            value = checks.number(f"{bound} of {self.name}", getattr(self, bound), unit=self.unit)
            object.__setattr__(self, bound, value)
        if self.minimum >= self.maximum:
            msg = (
                f"range of {self.name} is upside down or empty: minimum = {self.minimum:g} {self.unit} must be less "
                f"than maximum = {self.maximum:g} {self.unit}"
            )
            raise ValueError(msg)
        width = self.maximum - self.minimum
        step = checks.number(f"step of {self.name}", self.step, 0.0, width, unit=self.unit)
        object.__setattr__(self, "step", step or float(self.whole))
        if self.whole:
            for bound in ("minimum", "maximum", "step"):
                checks.whole_number(f"{bound} of {self.name}", getattr(self, bound), -(2**53), 2**53)
        if self.log:
            checks.number(f"minimum of {self.name}", self.minimum, 0.0, unit=self.unit, exclusive_minimum=True)
            if self.step and not (self.whole and self.step == 1.0):
                msg = f"{self.name} has log and step = {self.step:g} {self.unit}: choose one of them"
                raise ValueError(msg)

    @cached_property
    def count(self) -> int | None:
        """Number of its values, None where any number between its ends is one."""
        return math.floor((self.maximum - self.minimum) / self.step + _ON_STEP) + 1 if self.step else None

    @property
    def last(self) -> float:
        """Largest value that it takes: the maximum, or the last step before it."""
        return self.maximum if self.count is None else self._at(float(self.count - 1))

    @property
    def low(self) -> float:
        """Lower end of the coordinate."""
        low = self.minimum - 0.5 * self.step
        return math.log(low) if self.log else low

    @property
    def high(self) -> float:
        """Upper end of the coordinate."""
        high = self.last + 0.5 * self.step
        return math.log(high) if self.log else high

    def coordinates(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where values lie for a search, any shape."""
        return np.log(numbers) if self.log else numbers

    def numbers(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at coordinates, any shape: those next to them on a grid, inside the range for sure."""
        numbers = np.exp(coordinates) if self.log else coordinates
        if self.count is not None:
            places = np.clip(np.rint((numbers - self.minimum) / self.step), 0.0, self.count - 1.0)
            return np.asarray(np.round(self.minimum + self.step * places, self._decimals))
        return np.clip(numbers, self.minimum, self.maximum) if self.log else numbers

    @property
    def _decimals(self) -> int:
        return _DIGITS - math.floor(math.log10(max(abs(self.minimum), abs(self.maximum))))

    def _at(self, place: float) -> float:
        return float(np.round(self.minimum + self.step * place, self._decimals))

    def number(self, value: Scalar) -> float:
        """Return a value as a number."""
        return float(value)

    def value(self, number: float) -> Scalar:
        """Return the value that a number of it stands for."""
        return round(number) if self.whole else float(number)

    def check(self, value: Scalar) -> Scalar:
        """Return the value if it is one of the range's.

        Raises:
            ValueError: It is outside, or between two steps.
        """
        number = checks.number(self.name, value, self.minimum, self.maximum, unit=self.unit)  # type: ignore[arg-type]
        if self.count is not None:
            places = (number - self.minimum) / self.step
            if abs(places - round(places)) > _ON_STEP:
                msg = (
                    f"{self.name} = {number:.6g} {self.unit} lies between two steps of {self.step:g} {self.unit} from "
                    f"{self.minimum:g} {self.unit}"
                )
                raise ValueError(msg)
        return self.value(number)


@dataclass(frozen=True)
class Choice:
    """A parameter that takes one of several values which have no order.

    Its *number*, for searches that hold candidates in arrays, is its place in the list, from 0.

    Attributes:
        name: The plant's parameter, or ``stock``.
        choices: Numbers, truth values or texts; each once.
        unit: SI unit of numbers.
        traits: For each choice some numbers: choices with like numbers are alike. Nothing where none are known.

    Raises:
        ValueError: Fewer than two, or one twice.
    """

    name: str
    choices: tuple[Scalar, ...]
    unit: str = ""
    traits: tuple[tuple[float, ...], ...] = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "choices", tuple(self.choices))
        if len(self.choices) < 2 or len(set(self.choices)) < len(self.choices):  # noqa: PLR2004
            msg = f"choices of {self.name} must be two or more, each once, got {list(self.choices)}"
            raise ValueError(msg)

    @property
    def count(self) -> int:
        """Number of its values."""
        return len(self.choices)

    @property
    def low(self) -> float:
        """Lower end of the coordinate, from which places are rounded."""
        return -0.5

    @property
    def high(self) -> float:
        """Upper end of the coordinate."""
        return self.count - 0.5

    def coordinates(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return places as they are."""
        return numbers

    def numbers(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places next to coordinates, any shape."""
        return np.asarray(np.clip(np.rint(coordinates), 0.0, self.count - 1.0))

    def number(self, value: Scalar) -> float:
        """Return the place of a value."""
        return float(self.choices.index(value))

    def value(self, number: float) -> Scalar:
        """Return the value at a place."""
        return self.choices[int(number)]

    def check(self, value: Scalar) -> Scalar:
        """Return the value if it is one of the choices.

        Raises:
            ValueError: It is not.
        """
        if value not in self.choices:
            msg = f"{self.name} = {value!r} is not one of {', '.join(map(str, self.choices))}"
            raise ValueError(msg)
        return self.choices[self.choices.index(value)]


AnyDimension = Dimension | Choice


def written(dimension: AnyDimension) -> dict[str, object]:
    """Return what `dimension_from` reads: all that is not as it is by default."""
    named = {f.name: getattr(dimension, f.name) for f in fields(dimension) if f.compare}
    return {name: value for name, value in named.items() if value not in (False, 0.0) or name in {"minimum", "maximum"}}


def dimension_from(entries: Mapping[str, object]) -> AnyDimension:
    """Return the dimension whose attributes are given.

    Raises:
        TypeError: Others than it has.
        ValueError: See `Dimension` and `Choice`.
    """
    kind = Choice if "choices" in entries else Dimension
    return kind(**entries)  # type: ignore[arg-type]


def _allowed(_: Mapping[str, Any]) -> str:
    """Return no reason against any candidate."""
    return ""


@dataclass(frozen=True)
class Space:
    """What is searched: a range or a choice for each parameter, and what a candidate must meet beyond them.

    Attributes:
        dimensions: In the order of their names.
        judge: Returns why a candidate cannot be, with its numbers, or an empty text; such a one is drawn again.
        judge_many: Returns which rows of candidates, given as numbers, can be: what ``judge`` says of each, sooner.

    Raises:
        ValueError: No parameter, or the same one twice.
    """

    dimensions: tuple[AnyDimension, ...]
    judge: Callable[[Mapping[str, Any]], str] = field(default=_allowed, compare=False, repr=False)
    judge_many: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = field(
        default=None, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        names = self.names
        if not names or len(set(names)) != len(names):
            msg = f"a space needs at least one parameter and each only once, got {list(names)}"
            raise ValueError(msg)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(dimension.name for dimension in self.dimensions)

    @property
    def ranges(self) -> tuple[Dimension, ...]:
        """The parameters that are no choices."""
        return tuple(dimension for dimension in self.dimensions if isinstance(dimension, Dimension))

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper ends of the coordinates, each of shape (parameters,)."""
        low = np.array([dimension.low for dimension in self.dimensions])
        return low, np.array([dimension.high for dimension in self.dimensions])

    @property
    def is_countable(self) -> bool:
        """Whether every parameter takes a limited number of values."""
        return all(dimension.count is not None for dimension in self.dimensions)

    def coordinates(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates of candidates, shape (candidates, parameters), given as numbers."""
        return np.column_stack([d.coordinates(numbers[:, i]) for i, d in enumerate(self.dimensions)])

    def numbers(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the candidates at coordinates, shape (candidates, parameters), as numbers."""
        return np.column_stack([d.numbers(coordinates[:, i]) for i, d in enumerate(self.dimensions)])

    def row(self, values: Mapping[str, Scalar]) -> list[float]:
        """Return a candidate as numbers, in the order of the parameters."""
        return [dimension.number(values[dimension.name]) for dimension in self.dimensions]

    def values(self, row: Iterable[float]) -> Values:
        """Return the candidate that these numbers stand for."""
        return {d.name: d.value(number) for d, number in zip(self.dimensions, row, strict=True)}

    def drawn(self, random: np.random.Generator) -> Values:
        """Return a candidate drawn uniformly, whether or not it can be."""
        return {d.name: d.value(float(d.numbers(np.asarray(random.uniform(d.low, d.high))))) for d in self.dimensions}

    def refused(self, numbers: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return which rows of candidates, shape (candidates, parameters), cannot be."""
        if self.judge is _allowed:
            return np.empty(0, dtype=np.intp)
        if self.judge_many is not None:
            return np.flatnonzero(~self.judge_many(numbers))
        return np.array([i for i, row in enumerate(numbers) if self.judge(self.values(row))], dtype=np.intp)

    def check(self, values: Mapping[str, Scalar]) -> Values:
        """Return ``values`` if they name exactly the parameters of the space, each inside its range.

        Raises:
            ValueError: A parameter too many or too few, or a value outside its range.
        """
        if set(values) != set(self.names):
            msg = f"a candidate of this space has the parameters {sorted(self.names)}, got {sorted(values)}"
            raise ValueError(msg)
        return {dimension.name: dimension.check(values[dimension.name]) for dimension in self.dimensions}


@dataclass(frozen=True)
class Evaluation:
    """A candidate that was tried.

    Attributes:
        values: What was tried.
        score: How good it was, more is better; None if it could not be measured or could not be built, or is still
            being tried. With several objectives the first of them.
        others: The further objectives, more of each is better.
        excesses: By how much it misses each constraint, 0 or less where it meets it.
        pending: Whether it is still being tried, or will be again, so that it may have a score yet.

    Raises:
        ValueError: A number that is not finite: what could not be measured has none.
    """

    values: Mapping[str, Any]
    score: float | None
    others: tuple[float, ...] = ()
    excesses: tuple[float, ...] = ()
    pending: bool = False

    def __post_init__(self) -> None:
        if self.score is not None:
            checks.number("score", self.score, advice="give None for a trial without a score")
        for name in ("others", "excesses"):
            for number in getattr(self, name):
                checks.number(name, number, advice="give no score to a trial without it")

    @property
    def objectives(self) -> tuple[float, ...]:
        """All objectives, more of each is better; none without a score."""
        return () if self.score is None else (self.score, *self.others)

    @property
    def violation(self) -> float:
        """How much is missed of all constraints: the sum of the excesses above 0, and 0 where all are met."""
        return math.fsum(max(excess, 0.0) for excess in self.excesses)


class Search(Protocol):
    """What a study asks. What searches differ in is behind it."""

    @property
    def space(self) -> Space:
        """Where it searches."""

    def needed(self, number: int) -> int:
        """Return how many of the first candidates must be settled before candidate ``number`` can be proposed."""

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``, which holds all candidates so far in their order.

        The same history always gives the same candidate, to the last bit.
        """


def best(history: Iterable[Evaluation]) -> Evaluation | None:
    """Return the evaluation with the highest score, of equals the first; None if nothing was scored.

    One that meets all constraints is better than one that misses any, and of two that miss some the one that misses
    less is (Deb, Computer Methods in Applied Mechanics and Engineering 186, 2000).
    """
    scored = [evaluation for evaluation in history if evaluation.score is not None]
    return max(scored, key=lambda evaluation: (-evaluation.violation, evaluation.score or 0.0), default=None)


def pareto_front(history: Sequence[Evaluation]) -> list[int]:
    """Return the places in ``history`` of the evaluations than which none is better in every objective, in order.

    Of several that are equal in all, the first one counts. Those without a score do not, nor do those that miss a
    constraint.
    """
    places = [place for place, entry in enumerate(history) if entry.score is not None and not entry.violation]
    objectives = -np.array([history[place].objectives for place in places])
    return [places[number] for number in front(objectives)] if places else []


def generator(seed: int, number: int) -> np.random.Generator:
    """Return the random numbers of candidate ``number`` (from 0): independent of those of every other candidate."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))


def uniform(space: Space, random: np.random.Generator) -> Values:
    """Return a candidate drawn uniformly from the whole space, as far as it can be.

    Raises:
        ValueError: None of ten thousand can.
    """
    for _ in range(_DRAWS):
        drawn = space.drawn(random)
        refusal = space.judge(drawn)
        if not refusal:
            return drawn
    msg = f"none of {_DRAWS} candidates drawn from the space can be; the last one: {refusal}"
    raise ValueError(msg)
