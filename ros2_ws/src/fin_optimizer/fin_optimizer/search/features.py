"""A space as a model of its scores sees it: each range from 0 to 1, each choice as points between 0 and 1."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.space import Choice

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_optimizer.search.space import Space

    Array = NDArray[np.float64]

_DIGITS = 6
"""By which traits must differ to tell two choices apart."""


class Features:
    """Turns candidates into features, and places in the unit box into candidates.

    A range, also one with steps, is one feature: its coordinate from 0 to 1. So is a choice among numbers, from its
    least to its largest. A choice whose `Choice.traits` tell all of them apart has a feature a trait, each with a
    length of its own. A choice among anything else has a feature for each, so that any two are equally far apart.

    Attributes:
        groups: For each feature the group whose length it shares, from 0, shape (features,).
        moving: Places of the parameters that take any value of a range, whose feature is their place in the box.
        columns: The features of these, in the same order.
        counts: For each parameter how many values it takes, 0 for any.
    """

    def __init__(self, space: Space) -> None:
        """Look at what is searched."""
        self._space = space
        self._low, high = space.bounds
        self._width = high - self._low
        self._points = [_points(dimension) if isinstance(dimension, Choice) else None for dimension in space.dimensions]
        sizes = [1 if points is None else points.shape[1] for points in self._points]
        # A group a parameter, but one a feature where the features are traits.
        alone = [isinstance(d, Choice) and _traits(d) is not None for d in space.dimensions]
        begins = [number == 0 or one for size, one in zip(sizes, alone, strict=True) for number in range(size)]
        self.groups = np.cumsum(begins) - 1
        self.counts = [dimension.count or 0 for dimension in space.dimensions]
        self.moving = [place for place, count in enumerate(self.counts) if not count]
        self.columns = [sum(sizes[:place]) for place in self.moving]

    def of(self, numbers: Array) -> Array:
        """Return the features of candidates given as numbers: (n, parameters) becomes (n, features)."""
        unit = self.unit(numbers)
        parts = [
            unit[:, place : place + 1] if points is None else points[numbers[:, place].astype(int)]
            for place, points in enumerate(self._points)
        ]
        return np.hstack(parts)

    def unit(self, numbers: Array) -> Array:
        """Return where candidates lie in the unit box, both of shape (n, parameters)."""
        return np.asarray((self._space.coordinates(numbers) - self._low) / self._width)

    def numbers(self, unit: Array) -> Array:
        """Return the candidates at, or next to, places in the unit box, both of shape (n, parameters)."""
        coordinates = np.clip(self._low + self._width * unit, self._low, self._low + self._width)
        return self._space.numbers(coordinates)

    def alternatives(self, place: int, number: float, most: int) -> Array:
        """Return the values, as numbers, of a parameter with a limited number of them: at most so many, the nearest.

        Args:
            place: Of the parameter in the space.
            number: One of its values, to which they are near.
            most: How many; of a choice all are returned, since none is near another.
        """
        dimension = self._space.dimensions[place]
        if isinstance(dimension, Choice):
            return np.arange(dimension.count, dtype=float)
        at = round((number - dimension.minimum) / dimension.step)
        first = min(max(at - most // 2, 0), max(self.counts[place] - most, 0))
        places = np.arange(first, min(first + most, self.counts[place]), dtype=float)
        return dimension.numbers(dimension.coordinates(np.asarray(dimension.minimum + dimension.step * places)))


def _points(choice: Choice) -> Array:
    values = choice.choices
    if (traits := _traits(choice)) is not None:
        return traits
    if any(isinstance(value, str | bool) for value in values):
        return np.eye(len(values)) / math.sqrt(2.0)
    column = np.array(values, dtype=float)[:, None]
    return np.asarray((column - column.min()) / (column.max() - column.min()))


def _traits(choice: Choice) -> Array | None:
    """Return the traits of choices from 0 to 1, shape (choices, traits that differ); None if any two are the same."""
    if not choice.traits:
        return None
    traits = np.array(choice.traits)
    width = np.ptp(traits, axis=0)
    unit = (traits[:, width > 0.0] - traits.min(axis=0)[width > 0.0]) / width[width > 0.0]
    return unit if len(np.unique(np.round(unit, _DIGITS), axis=0)) == len(unit) else None
