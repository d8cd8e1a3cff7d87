"""Smooth functions of joint angles as Chebyshev sums, from values at few poses.

The mass matrix is analytic in the angles until members touch, so the sum converges as fast as a power series: of the
fish with a fin in three segments, with 9 poses a joint, to 5e-7 within 0.3, 0.6 and 0.6 rad, and to 6e-5 within 0.6, 1
and 1 rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_plant.validity import FoldedError
from fin_sim.compiled import kernel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

MOST_JOINTS, MOST_JOINTS_ON_A_GRID = 8, 3
DEGREE = 8
"""Total degree of the sums."""
_POSES_A_TERM = 1.5
_NEGLIGIBLE = 1e-13  # of a function's largest value: rounding


class FoldError(FoldedError):
    """A joint went beyond the angles that its table holds.

    Attributes:
        joint: Which, from 0.
        angle: To which angle, rad.
        reach: Largest angle of the table, rad.
        time: When, s since the start of what was advanced; None of a pose alone.
    """

    def __init__(self, joint: int, angle: float, reach: float, time: float | None) -> None:
        super().__init__()
        self.joint, self.angle, self.reach, self.time = joint, angle, reach, time

    def __str__(self) -> str:
        when = "" if self.time is None else f" at t = {self.time:.3g} s"
        return (
            f"joint {self.joint + 1} folds to {self.angle:.3g} rad{when}, the plane flow holds from "
            f"{-self.reach:.3g} to {self.reach:.3g} rad: take a stiffer fin, a slower or smaller beat"
        )


@kernel
def evaluate_table(
    angles: NDArray[np.float64],
    reach: NDArray[np.float64],
    orders: NDArray[np.int64],
    weights: NDArray[np.float64],
    polynomials: NDArray[np.float64],
    sloped: int,
    values: NDArray[np.float64],
) -> None:
    """Write the functions, and of the first of them the derivatives by each angle, into ``values``.

    Args:
        angles: rad, shape (J,).
        reach: Half-width of the table, rad, shape (J,).
        orders: Of each term, shape (T, J).
        weights: Shape (T, F).
        polynomials: Scratch, shape (2 J, largest order + 1).
        sloped: Number of functions whose derivatives are wanted.
        values: Shape (1 + J, F).
    """
    joints, terms, functions = orders.shape[1], weights.shape[0], weights.shape[1]
    for joint in range(joints):
        x = angles[joint] / reach[joint]
        here, slope = polynomials[2 * joint], polynomials[2 * joint + 1]
        here[0], slope[0] = 1.0, 0.0
        here[1], slope[1] = x, 1.0 / reach[joint]
        for order in range(2, polynomials.shape[1]):
            here[order] = 2.0 * x * here[order - 1] - here[order - 2]
            slope[order] = 2.0 * here[order - 1] / reach[joint] + 2.0 * x * slope[order - 1] - slope[order - 2]
    values[:] = 0.0
    for term in range(terms):
        for derivative in range(1 + joints):
            factor = 1.0
            for joint in range(joints):
                factor *= polynomials[2 * joint + (1 if derivative == joint + 1 else 0), orders[term, joint]]
            for function in range(sloped if derivative else functions):
                values[derivative, function] += factor * weights[term, function]


@dataclass(frozen=True)
class Table:
    """Functions of joint angles as sums of products of Chebyshev polynomials.

    Attributes:
        reach: Largest angle of each joint, to both sides, rad, shape (J,).
        orders: Order in each angle of each term, shape (T, J).
        weights: Of each term in each function, shape (T, F).
    """

    reach: NDArray[np.float64]
    orders: NDArray[np.int64]
    weights: NDArray[np.float64]

    def at(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the functions, shape (F,), and their derivatives by the angles, shape (J, F).

        Raises:
            FoldError: An angle beyond the table.
        """
        refuse_fold(angles, self.reach)
        values = np.empty((1 + len(self.reach), self.weights.shape[1]))
        evaluate_table(angles, self.reach, self.orders, self.weights, self.scratch(), self.weights.shape[1], values)
        return values[0], values[1:]

    def scratch(self) -> NDArray[np.float64]:
        """Return the scratch that `evaluate_table` needs."""
        return np.empty((2 * len(self.reach), max(2, int(self.orders.max()) + 1)))


def refuse_fold(angles: NDArray[np.float64], reach: NDArray[np.float64], time: float | None = None) -> None:
    """Refuse a pose beyond a table; ``time``: when it was reached, s.

    Raises:
        FoldError: There is one.
    """
    beyond = np.flatnonzero(np.abs(angles) > reach * (1.0 + 1e-9))
    if len(beyond):
        joint = int(beyond[0])
        raise FoldError(joint, float(angles[joint]), float(reach[joint]), time)


def tabulate(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    reach: Sequence[float],
    *,
    mirror: NDArray[np.float64] | None = None,
    degree: int = DEGREE,
) -> Table:
    """Return the table of functions of the joint angles.

    Args:
        function: Its argument has shape (J,), its result shape (F,).
        reach: Largest angle of each joint, rad.
        mirror: Of a linkage that is its own mirror image: the sign, 1 or -1, by which each function of the mirrored
            pose differs, shape (F,). Half as many poses are needed.
        degree: Total degree of the sums; one more pose a joint.

    Raises:
        ValueError: More joints than a table has.
    """
    joints = checks.whole_number("joints of a table", len(reach), 1, MOST_JOINTS)
    if joints > MOST_JOINTS_ON_A_GRID:
        return _fitted(function, np.array(reach), mirror, degree)
    count = degree + 1
    places = np.cos(math.pi * (np.arange(count) + 0.5) / count)
    widths = np.array(reach)
    known: dict[tuple[int, ...], NDArray[np.float64]] = {}
    for index in product(range(count), repeat=joints):
        mirrored = tuple(count - 1 - each for each in index)
        if mirror is not None and mirrored in known:
            known[index] = mirror * known[mirrored]
        else:
            known[index] = function(widths * places[list(index)])
    values = np.array([known[index] for index in product(range(count), repeat=joints)])
    scale = np.abs(values).max(axis=0)
    waves = np.cos(np.outer(np.arange(count), math.pi * (np.arange(count) + 0.5) / count)) * 2.0 / count
    waves[0] /= 2.0
    weights = values.reshape((count,) * joints + (-1,))
    for axis in range(joints):
        weights = np.moveaxis(np.tensordot(waves, weights, axes=(1, axis)), 0, axis)
    weights = weights.reshape(count**joints, -1)
    orders = np.array(list(product(range(count), repeat=joints)), dtype=np.int64)
    kept = (orders.sum(axis=1) <= degree) & (np.abs(weights) > _NEGLIGIBLE * scale).any(axis=1)
    return Table(widths, np.ascontiguousarray(orders[kept]), np.ascontiguousarray(weights[kept]))


def _orders(joints: int, degree: int) -> NDArray[np.int64]:
    """Return all orders of a total degree up to this, shape (terms, joints)."""
    rows = [
        np.bincount(np.array(chosen, dtype=np.int64), minlength=joints)
        for total in range(degree + 1)
        for chosen in combinations_with_replacement(range(joints), total)
    ]
    return np.array(rows, dtype=np.int64)


def _fitted(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    reach: NDArray[np.float64],
    mirror: NDArray[np.float64] | None,
    degree: int,
) -> Table:
    """Return the table of functions of many joint angles: least squares through poses drawn from Chebyshev's density.

    Where a fin has many hinges each bends little, so that a low degree does.
    """
    orders = _orders(len(reach), degree)
    even = orders.sum(axis=1) % 2 == 0
    count = math.ceil(_POSES_A_TERM * (max(even.sum(), (~even).sum()) if mirror is not None else len(orders)))
    places = np.cos(math.pi * np.random.default_rng(0).random((count, len(reach))))
    values = np.array([function(reach * place) for place in places])
    waves = np.cos(orders[None] * np.arccos(places)[:, None]).prod(axis=2)
    weights = np.zeros((len(orders), values.shape[1]))
    parts = [(orders[:, 0] >= 0, np.isfinite(values[0]))]
    if mirror is not None:
        parts = [(even, mirror > 0.0), (~even, mirror < 0.0)]
    for terms, functions in parts:
        weights[np.ix_(terms, functions)] = np.linalg.lstsq(waves[:, terms], values[:, functions], rcond=None)[0]
    return Table(reach, orders, weights)
