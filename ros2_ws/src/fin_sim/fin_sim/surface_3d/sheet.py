"""A sheet without thickness in three dimensions: a lattice of vortex rings, whose strengths are the jump of potential.

The sheet lies in the plane y = 0 between ``-h(s)/2`` and ``h(s)/2``, s the distance behind its leading edge. A ring of
strength mu is the boundary of a panel over which the potential jumps by mu (Katz & Plotkin, *Low-Speed Aerodynamics*,
2001, section 10.4.6). Its sides lie at the zeros of the Chebyshev polynomial T_n and the points where the water follows
the sheet at those of U_(n-1), in both directions: for a plane plate that is the Gauss quadrature of the square roots at
its edges, and exact (C. E. Lan, Journal of Aircraft 11, 1974). So no edge needs a grid of its own.

All motions here are alike above and below, so only the upper half of the panels is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_FOUR_PI = 4.0 * np.pi
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(2)
"""Exact for the height times a distance, both linear along a panel."""


@dataclass(frozen=True)
class Sheet:
    """A lattice on a sheet.

    Attributes:
        angles: Of the points along the sheet, theta with s = length (1 - cos theta) / 2, shape (P,).
        points: Their distance behind the leading edge, m, shape (P,).
        sides: Of the panels' front and rear ends, m, shape (P + 1,).
        heights: Of the sheet at the sides, m, shape (P + 1,).
        levels: Of the panels' lower and upper ends over half the height, from -1 to 1, shape (2 Q + 1,).
        middles: Of the points, likewise, the upper half, shape (Q,).
        point_heights: Of the sheet at the points, m, shape (P,).
        length: m.
    """

    angles: Array
    points: Array
    sides: Array
    heights: Array
    levels: Array
    middles: Array
    point_heights: Array
    length: float

    @classmethod
    def of_profile(cls, distances: Array, heights: Array, along: int, across: int) -> Sheet:
        """Return a lattice of ``along`` x 2 ``across`` panels on a sheet whose height is linear between stations.

        Args:
            distances: Of the stations behind the leading edge, m, rising from 0, shape (S,).
            heights: There, m, shape (S,).
            along: P, panels from the leading to the trailing edge.
            across: Q, panels from the middle to the upper edge.
        """
        length = float(distances[-1])

        def place(angle: Array) -> Array:
            return np.asarray(0.5 * length * (1.0 - np.cos(angle)))

        inner = np.pi * np.arange(1, along + 1) / (along + 1)
        outer = np.pi * (np.arange(along + 1) + 0.5) / (along + 1)
        levels = -np.cos(np.pi * (np.arange(2 * across + 1) + 0.5) / (2 * across + 1))
        middles = -np.cos(np.pi * np.arange(across + 1, 2 * across + 1) / (2 * across + 1))
        return cls(
            angles=inner,
            points=place(inner),
            sides=place(outer),
            heights=np.interp(place(outer), distances, heights),
            levels=levels,
            middles=middles,
            point_heights=np.interp(place(inner), distances, heights),
            length=length,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Panels along, and across in the upper half."""
        return len(self.points), len(self.middles)

    def collocation(self) -> tuple[Array, Array]:
        """Return s and z of the points in the upper half, m, each of shape (P Q,)."""
        heights = 0.5 * self.point_heights[:, None] * self.middles
        return np.repeat(self.points, len(self.middles)), heights.ravel()

    def _corners(self) -> tuple[Array, Array]:
        """Return s and z of the rings' corners, m, shape (P + 1, 2 Q + 1)."""
        z = 0.5 * self.heights[:, None] * self.levels
        return np.broadcast_to(self.sides[:, None], z.shape), z

    def _rings(self, sides: tuple[Array, Array]) -> Array:
        """Return what the upper half's unknowns cause, shape (points, P Q), from what each side of a ring causes.

        Args:
            sides: Of upward sides, shape (points, P + 1, 2 Q), and of rearward ones, (points, P, 2 Q + 1).
        """
        upward, rearward = sides
        ring = upward[:, :-1] - upward[:, 1:] + rearward[:, :, 1:] - rearward[:, :, :-1]
        half = len(self.middles)
        folded = ring[:, :, half:] + ring[:, :, half - 1 :: -1]
        return np.asarray(folded.reshape(len(folded), -1))

    def own_velocity(self) -> Array:
        """Return the velocity in y at the points that unit rings cause, 1/m, shape (P Q, P Q)."""
        s, z = self.collocation()
        corner_s, corner_z = self._corners()
        off_s, off_z = corner_s - s[:, None, None], corner_z - z[:, None, None]
        distance = np.sqrt(off_s**2 + off_z**2)

        def side(one: tuple[slice, ...], other: tuple[slice, ...]) -> Array:
            a_s, a_z, b_s, b_z = off_s[one], off_z[one], off_s[other], off_z[other]
            a, b = distance[one], distance[other]
            return np.asarray((a_z * b_s - a_s * b_z) * (a + b) / (a * b * (a * b + a_s * b_s + a_z * b_z)) / _FOUR_PI)

        every, front, rear = slice(None), slice(None, -1), slice(1, None)
        upward = side((every, every, front), (every, every, rear))
        rearward = side((every, front, every), (every, rear, every))
        return self._rings((upward, rearward))

    def velocity_at(self, places: Array, normals: Array) -> Array:
        """Return the velocity along normals at places off the sheet that unit rings cause, 1/m, shape (points, P Q).

        Args:
            places: s, y, z of the points, m, shape (points, 3).
            normals: Unit vectors there, in the same axes, shape (points, 3).
        """
        corner_s, corner_z = self._corners()
        off = np.stack(
            np.broadcast_arrays(
                corner_s - places[:, 0, None, None], -places[:, 1, None, None], corner_z - places[:, 2, None, None]
            )
        )
        distance = np.sqrt(np.sum(off**2, axis=0))
        normal = normals.T[:, :, None, None]

        def side(one: tuple[slice, ...], other: tuple[slice, ...]) -> Array:
            a, b, size_a, size_b = off[:, *one], off[:, *other], distance[one], distance[other]
            triple = (
                normal[0] * (a[1] * b[2] - a[2] * b[1])
                + normal[1] * (a[2] * b[0] - a[0] * b[2])
                + normal[2] * (a[0] * b[1] - a[1] * b[0])
            )
            along = np.sum(a * b, axis=0)
            return np.asarray(triple * (size_a + size_b) / (size_a * size_b * (size_a * size_b + along)) / _FOUR_PI)

        every, front, rear = slice(None), slice(None, -1), slice(1, None)
        upward = side((every, every, front), (every, every, rear))
        rearward = side((every, front, every), (every, rear, every))
        return self._rings((upward, rearward))

    def line(self, strengths: Array) -> Array:
        """Return the integral over the height of the jump at each point along, m^2/s per unit motion.

        Args:
            strengths: Of the rings, shape (P Q, motions).

        Returns:
            Shape (P, motions).
        """
        along, across = self.shape
        spans = np.diff(self.levels)[across:]  # of the upper half; the lower one doubles it
        jumps = strengths.reshape(along, across, -1)
        return np.asarray(np.einsum("pqm,q->pm", jumps, spans) * self.point_heights[:, None])

    def moments(self, starts: Array, ends: Array) -> Array:
        """Return the integrals over each panel column of 1 and of the distance behind each link's joint, over a link.

        Args:
            starts: Of the links behind the leading edge, m, shape (N,).
            ends: Of the links, m, shape (N,).

        Returns:
            Areas in m^2 and their first moments in m^3 for a sheet of height 2, times half the height: shape
            (P, N, 2); times the spans of the panels they are the panels' own.
        """
        low = np.maximum(self.sides[:-1, None], starts)
        high = np.minimum(self.sides[1:, None], ends)
        half = 0.5 * np.maximum(high - low, 0.0)
        at = 0.5 * (low + high)[..., None] + half[..., None] * _GAUSS_POINTS
        slope = np.diff(self.heights) / np.diff(self.sides)
        height = self.heights[:-1, None, None] + slope[:, None, None] * (at - self.sides[:-1, None, None])
        weight = half[..., None] * _GAUSS_WEIGHTS * 0.5 * height
        behind = at - starts[:, None]
        return np.stack((weight.sum(axis=-1), (weight * behind).sum(axis=-1)), axis=-1)
