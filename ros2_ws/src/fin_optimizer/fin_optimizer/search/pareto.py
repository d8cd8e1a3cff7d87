"""What is good in several respects: fronts of candidates of which none is better than another in all of them."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_PLANE = 2


def ranks(objectives: Array) -> NDArray[np.intp]:
    """Return the front of each point, shape (n,): 0 for those that none dominates, 1 for those that only these do, ...

    A point dominates another if it is nowhere worse and somewhere better. Equal points are of the same front.

    Args:
        objectives: Shape (n, objectives), each to be small; finite.
    """
    return _plane_ranks(objectives) if objectives.shape[1] == _PLANE else _general_ranks(objectives)


def _plane_ranks(objectives: Array) -> NDArray[np.intp]:
    """Return the fronts of points with two objectives in one pass over the sorted ones (Jensen 2003, algorithm 2)."""
    points, places = np.unique(objectives, axis=0, return_inverse=True)  # sorted by the first, then by the second
    front = np.empty(len(points), dtype=np.intp)
    least: list[float] = []  # of each front the second objective of its last point; grows from front to front
    for number, second in enumerate(points[:, 1].tolist()):
        front[number] = bisect_right(least, second)  # those before have a last point that dominates this one
        least[front[number] : front[number] + 1] = [second]
    return front[places]


def _general_ranks(objectives: Array) -> NDArray[np.intp]:
    """Return the fronts by taking one after the other away (Deb et al. 2002, fast non-dominated sorting)."""
    result = np.empty(len(objectives), dtype=np.intp)
    no_worse = (objectives[:, None, :] <= objectives[None, :, :]).all(axis=2)
    dominates = no_worse & ~no_worse.T
    dominating = dominates.sum(axis=0)
    left = np.ones(len(objectives), dtype=bool)
    front = 0
    while left.any():
        taken = left & (dominating == 0)
        result[taken] = front
        dominating -= dominates[taken].sum(axis=0)
        left &= ~taken
        front += 1
    return result


def front(objectives: Array) -> list[int]:
    """Return the places of the points that none dominates, in order; of several that are equal the first.

    Args:
        objectives: Shape (n, objectives), each to be small; finite.
    """
    # Sorted by the first objective, then by the others: no later point dominates one before (Kung, Luccio & Preparata,
    # J. ACM 22, 1975). Equal points stay in their order.
    order = np.lexsort(objectives.T[::-1])
    chosen: list[int] = []
    points = np.empty_like(objectives)
    for place in order.tolist():
        if not (points[: len(chosen)] <= objectives[place]).all(axis=1).any():
            points[len(chosen)] = objectives[place]
            chosen.append(place)
    return sorted(chosen)


def crowding(objectives: Array) -> Array:
    """Return how far the neighbours of each point of a front are apart, shape (n,); infinity for its ends.

    Deb et al. 2002, crowding distance: the sides of the box between both neighbours, as shares of the front's width.
    """
    count, sides = objectives.shape
    result = np.zeros(count)
    for side in range(sides):
        order = np.argsort(objectives[:, side], kind="stable")
        column = objectives[order, side]
        result[order[[0, -1]]] = np.inf
        width = column[-1] - column[0]
        if width > 0.0:
            result[order[1:-1]] += (column[2:] - column[:-2]) / width
    return result
