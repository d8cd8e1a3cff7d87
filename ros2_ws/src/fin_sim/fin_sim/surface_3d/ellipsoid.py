"""The body in ideal flow: Lamb's potential of a moving ellipsoid, and what a sheet behind it changes on its surface.

Axes: s rearward from the sheet's leading edge, y to the side, z up; the ellipsoid's centre lies at s = -offset, y = z =
0. Lamb's solution is exact for the body alone. The sheet's flow through the body's surface is cancelled by sources on
it, which are odd in y and even in z: a quarter of the surface is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import elliprd

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_FOUR_PI = 4.0 * np.pi


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid by its half axes a along, b across and c up, m, and the distance from its centre to the sheet, m.

    Raises:
        ValueError: The sheet begins inside of the body.
    """

    a: float
    b: float
    c: float
    offset: float

    def __post_init__(self) -> None:
        if self.offset < self.a * (1.0 - 1e-9):
            msg = (
                f"body.tail_offset = {self.offset:g} m lies inside of a body of length {2.0 * self.a:g} m: the flow "
                f"around both needs a tail that begins at its end, {self.a:g} m or more behind the centre"
            )
            raise ValueError(msg)

    def _integral(self, own: float, others: tuple[float, float], outside: Array | float) -> Array:
        """Return the integral from lambda on of 1 / ((own^2 + t) Delta(t)), in Carlson's symmetric form."""
        x, y = (axis**2 + outside for axis in others)
        return np.asarray(2.0 / 3.0 * elliprd(x, y, own**2 + outside))

    def _outside(self, x: Array, z: Array) -> Array:
        """Return lambda, m^2, of the confocal ellipsoids through points of the plane y = 0."""
        half = 0.5 * (x**2 + z**2 - self.a**2 - self.c**2)
        return np.asarray(half + np.sqrt(half**2 + (x * self.c) ** 2 + (z * self.a) ** 2 - (self.a * self.c) ** 2))

    def surge_on_sheet(self, s: Array, z: Array) -> tuple[Array, Array]:
        """Return the forward velocity that the body's unit surge causes in the plane y = 0, and d v / d y of its v.

        Lamb, article 114. A tail that is bent lies across the first and leaves the plane.

        Args:
            s: m, any shape.
            z: m, of the same shape.

        Returns:
            Without unit, and in 1/m.
        """
        a, b, c = self.a, self.b, self.c
        x = -self.offset - s
        outside = self._outside(x, z)
        squares = [axis**2 + outside for axis in (a, b, c)]
        slope = -1.0 / (squares[0] * np.sqrt(squares[0] * squares[1] * squares[2]))  # of the integral over lambda
        size = (x / squares[0]) ** 2 + (z / squares[2]) ** 2
        scale = -1.0 / (2.0 / (a * b * c) - self._integral(a, (b, c), 0.0))
        along = scale * (self._integral(a, (b, c), outside) + x * slope * 2.0 * x / squares[0] / size)
        return np.asarray(along), np.asarray(scale * x * slope * 2.0 / (squares[1] * size))

    def flow_on_sheet(self, s: Array, z: Array) -> tuple[Array, Array]:
        """Return the velocity in y that the body's unit sway and unit yaw rate cause in the plane y = 0.

        Lamb, *Hydrodynamics* (1932), articles 114 and 115.

        Args:
            s: m, any shape.
            z: m, of the same shape.

        Returns:
            Without unit, and in m.
        """
        a, b, c = self.a, self.b, self.c
        x = -self.offset - s
        outside = self._outside(x, z)
        beta = self._integral(b, (a, c), 0.0)
        sway = -self._integral(b, (a, c), outside) / (2.0 / (a * b * c) - beta)
        if a == b:
            return sway, np.zeros_like(sway)

        def both(at: Array | float) -> Array:
            return np.asarray((self._integral(b, (a, c), at) - self._integral(a, (b, c), at)) / (a**2 - b**2))

        yaw = x * both(outside) * (a**2 - b**2) / ((a**2 + b**2) * both(0.0) - 2.0 / (a * b * c))
        return sway, yaw

    def surface(self, along: int, around: int) -> Surface:
        """Return points on the quarter y > 0, z > 0, ``along`` from head to tail and ``around`` from side to top."""
        polar = np.pi * (np.arange(along) + 0.5) / along
        turn = 0.5 * np.pi * (np.arange(around) + 0.5) / around
        polar, turn = (np.ravel(part) for part in np.meshgrid(polar, turn, indexing="ij"))
        unit = np.stack((-np.cos(polar), np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn)), axis=1)
        axes = np.array([self.a, self.b, self.c])
        gradient = unit / axes
        support = 1.0 / np.linalg.norm(gradient, axis=1)  # of the tangent plane, from the centre
        cell = np.pi / along * 0.5 * np.pi / around
        return Surface(
            places=unit * axes - np.array([self.offset, 0.0, 0.0]),
            normals=gradient * support[:, None],
            areas=cell * self.a * self.b * self.c * np.sin(polar) / support,
            support=support,
        )


@dataclass(frozen=True)
class Surface:
    """Points on a quarter of an ellipsoid.

    Attributes:
        places: s, y, z, m, shape (B, 3).
        normals: Outward, shape (B, 3).
        areas: m^2, shape (B,).
        support: Distance of the tangent plane from the centre, m, shape (B,): the density of sources that leaves the
            inside at rest goes with it.
    """

    places: Array
    normals: Array
    areas: Array
    support: Array

    def flow_through(self) -> Array:
        """Return the velocity along the outward normal just outside that unit sources cause, shape (B, B).

        Nystrom's method; the singular part is taken from the density that leaves the inside at rest, for which the
        outside's velocity equals the density.
        """
        folded = np.zeros((len(self.areas), len(self.areas)))
        alike = np.zeros_like(folded)  # with sources of one sign on the whole surface
        for sign_y in (1.0, -1.0):
            for sign_z in (1.0, -1.0):
                off = self.places[:, None] - self.places * np.array([1.0, sign_y, sign_z])
                distance = np.linalg.norm(off, axis=2)
                own = sign_y + sign_z == 2.0  # noqa: PLR2004  (the points themselves, not an image)
                np.fill_diagonal(distance, 1.0 if own else np.diag(distance))
                part = np.einsum("ijk,ik->ij", off, self.normals) / (_FOUR_PI * distance**3) * self.areas
                folded += sign_y * part
                alike += part
        rest = 1.0 - alike @ self.support / self.support
        return np.asarray(folded + np.diag(rest))

    def flow_on_sheet(self, s: Array, z: Array) -> Array:
        """Return the velocity in y that unit sources cause in the plane y = 0, shape (points, B)."""
        result = np.zeros((len(s), len(self.areas)))
        for sign_z in (1.0, -1.0):
            off_s, off_z = s[:, None] - self.places[:, 0], z[:, None] - sign_z * self.places[:, 2]
            distance = np.sqrt(off_s**2 + self.places[:, 1] ** 2 + off_z**2)
            result -= 2.0 * self.places[:, 1] * self.areas / (_FOUR_PI * distance**3)
        return result
