"""Search for the best fin: what to try next, as a pure function of the seed and of what was tried before.

An algorithm keeps nothing between calls. It is *told* by the history and *asked* by ``propose``; its random numbers
come from a generator that the seed and the number of the candidate determine. So a study that was interrupted goes on
with bit for bit the candidates of one that was not, and every candidate can be recomputed from the journal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

Values = dict[str, float]
"""A candidate: the value of every parameter of the space, by name."""


@dataclass(frozen=True)
class Dimension:
    """A parameter that the search may vary.

    Attributes:
        name: The plant's parameter, for example ``fin.young_modulus``.
        minimum: Smallest value, in ``unit``.
        maximum: Largest value, in ``unit``.
        unit: SI unit, for messages and reports.

    Raises:
        ValueError: A bound that is not finite, or bounds that leave no room.
    """

    name: str
    minimum: float
    maximum: float
    unit: str = ""

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


@dataclass(frozen=True)
class Space:
    """The box that is searched: one range for each parameter.

    Raises:
        ValueError: No parameter, or the same one twice.
    """

    dimensions: tuple[Dimension, ...]

    def __post_init__(self) -> None:
        names = self.names
        if not names or len(set(names)) != len(names):
            msg = f"a space needs at least one parameter and each only once, got {list(names)}"
            raise ValueError(msg)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(dimension.name for dimension in self.dimensions)

    def check(self, values: Mapping[str, float]) -> Values:
        """Return ``values`` if they name exactly the parameters of the space, each inside its range.

        Raises:
            ValueError: A parameter too many or too few, or a value outside its range.
        """
        if set(values) != set(self.names):
            msg = f"a candidate of this space has the parameters {sorted(self.names)}, got {sorted(values)}"
            raise ValueError(msg)
        return {
            d.name: checks.number(d.name, values[d.name], d.minimum, d.maximum, unit=d.unit) for d in self.dimensions
        }


@dataclass(frozen=True)
class Evaluation:
    """A candidate that was tried.

    Attributes:
        values: What was tried.
        score: How good it was, more is better; None if it could not be measured or could not be built, or is still
            being tried.
        cost: What it took, less is better; None where the study is not about it.

    Raises:
        ValueError: A number that is not finite: what could not be measured has none.
    """

    values: Mapping[str, float]
    score: float | None
    cost: float | None = None

    def __post_init__(self) -> None:
        for name in ("score", "cost"):
            number = getattr(self, name)
            if number is not None:
                checks.number(name, number, advice=f"give None for a trial without a {name}")


class Search(Protocol):
    """What a study asks. Hill climber, genetic algorithm and CMA-ES differ only behind it."""

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
    """Return the evaluation with the highest score, of equals the first; None if nothing was scored."""
    scored = [evaluation for evaluation in history if evaluation.score is not None]
    return max(scored, key=lambda evaluation: evaluation.score or 0.0, default=None)


def pareto_front(history: Sequence[Evaluation]) -> list[int]:
    """Return the places in ``history`` of the evaluations than which none is both as fast and as cheap, in order.

    Of several that are equal in both, the first one counts. Those without a score or without a cost do not.
    """
    # Maxima of plane vectors in one pass over the sorted ones (Kung, Luccio & Preparata, J. ACM 22, 1975).
    known = [
        (-entry.score, entry.cost, place)
        for place, entry in enumerate(history)
        if entry.score is not None and entry.cost is not None
    ]
    chosen, cheapest = [], math.inf
    for _, cost, place in sorted(known):  # the fastest first, so each next one must be cheaper than all before
        if cost < cheapest:
            chosen.append(place)
            cheapest = cost
    return sorted(chosen)


def generator(seed: int, number: int) -> np.random.Generator:
    """Return the random numbers of candidate ``number`` (from 0): independent of those of every other candidate."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))


def uniform(space: Space, random: np.random.Generator) -> Values:
    """Return a candidate drawn uniformly from the whole space."""
    return {d.name: float(random.uniform(d.minimum, d.maximum)) for d in space.dimensions}
