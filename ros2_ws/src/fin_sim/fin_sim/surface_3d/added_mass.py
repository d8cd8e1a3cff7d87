"""Added mass of a tail in three dimensions: what is left of each link's virtual mass, and the matrix of body and links.

The kinetic energy of the water is 1/2 q.A q, with q the motions of body and links across themselves. In the straight
pose a motion j of the body and the sheet moves the sheet against Lamb's flow around the body with b_j = w_j - l_j, and
A_ij = Lamb's + rho times the integral of mu_j b_i over the sheet, mu_j the jump of the potential that b_j causes with
the body there (Green's second identity; the sources on the body carry no flow through it). So the matrix is symmetric
and positive.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from threadpoolctl import threadpool_limits

from fin_sim.surface_3d.sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_sim.fish import Link
    from fin_sim.surface_3d.ellipsoid import Ellipsoid

    Array = NDArray[np.float64]

ALONG, ACROSS = 24, 8
"""Panels of a sheet, and of its upper half: within 2e-4 of the converged mass of plates of 0.5 to 10 heights."""
_PANELS_A_LINK = 3
_BODY_ALONG, _BODY_AROUND = 24, 8
"""Points on a quarter of the body: within 2e-3 of the converged matrix for a fin nearly as high as the body."""
_SMOOTH = 8
"""Gauss points beyond the highest order of a series: its integrals over a link are then exact to 1e-10."""


def profile(links: Sequence[Link]) -> tuple[Array, Array]:
    """Return the stations of all links: distance behind the first joint and height, m, each of shape (S,)."""
    distances, heights, start = [0.0], [links[0].root_height], 0.0
    for link in links:
        for distance, height in link.stations:
            if distance == 0.0 and height == heights[-1]:
                continue  # the link in front ends with it
            distances.append(start + distance)
            heights.append(height)
        start += link.length
    return np.array(distances), np.array(heights)


def _bounds(links: Sequence[Link]) -> Array:
    """Return the joints and the trailing edge behind the first joint, m, shape (N + 1,)."""
    return np.concatenate(([0.0], np.cumsum([link.length for link in links])))


@cache
def _gauss(points: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(points)


def _solve(matrix: Array, right: Array) -> Array:
    # Threads of a small system's elimination only wait for each other.
    with threadpool_limits(1, user_api="blas"):
        return np.asarray(scipy.linalg.solve(matrix, right, check_finite=False))


def turning_series(distances: Array, heights: Array, along: int = ALONG, across: int = ACROSS) -> Array:
    """Return the momentum per length of the water beside a sheet that turns about its front end, as a series.

    p(s) = rho rate times the sum of series[n - 1] sin(n theta), with s = length (1 - cos theta) / 2: it vanishes at
    both ends as sin(theta) does. By strip theory it is rho rate pi/4 d^2 s.

    Args:
        distances: Of the stations between which the height is linear, behind the front end, m, shape (S,).
        heights: There, m, shape (S,).
        along: Panels along the sheet.
        across: Panels across its upper half.

    Returns:
        m^3, shape (along,).
    """
    sheet = Sheet.of_profile(distances, heights, along, across)
    s, _ = sheet.collocation()
    line = sheet.line(_solve(sheet.own_velocity(), s[:, None]))[:, 0]
    orders = np.arange(1, along + 1)
    # A ring has its sides' sum, which of sin(n theta) is x / sin(x) times the value at the point.
    steps = 0.5 * np.pi * orders / (along + 1)
    return np.asarray(2.0 / (along + 1) * np.sinc(steps / np.pi) * (np.sin(np.outer(orders, sheet.angles)) @ line))


def series_moments(bounds: Array, orders: int) -> Array:
    """Return what a series leaves of the links' moments: the integrals over a link of sin(n theta) / s (s - start)^j.

    Args:
        bounds: The joints and the trailing edge over the sheet's length, shape (N + 1,).
        orders: Terms of the series.

    Returns:
        Over length^j, shape (N, 3, orders), j = 0, 1, 2.
    """
    nodes, weights = _gauss(orders + _SMOOTH)
    ends = np.arccos(np.clip(1.0 - 2.0 * bounds, -1.0, 1.0))
    half = 0.5 * np.diff(ends)[:, None]
    angle = ends[:-1, None] + half * (1.0 + nodes)
    at = 0.5 * (1.0 - np.cos(angle))
    weight = half * weights * 0.5 * np.sin(angle) / at
    behind = (at - bounds[:-1, None])[:, None] ** np.arange(3)[:, None]
    terms = np.sin(angle[..., None] * np.arange(1, orders + 1))
    return np.asarray(np.einsum("kjg,kg,kgn->kjn", behind, weight, terms))


def link_factors(links: Sequence[Link], along: int = ALONG, across: int = ACROSS) -> Array:
    """Return what three dimensions leave of the three virtual moments of each link, shape (N, 3).

    The sheet turns about its front end; where its speed is s, the water's momentum per length is p(s), in strip theory
    rho pi/4 d^2 s. Their ratio scales the virtual mass per length, so the sum of the links' is exact for that motion.
    A factor may exceed 1 near the front end, which stands nearly still in water that the rest moves.

    Args:
        links: From the front to the trailing edge.
        along: Panels along the sheet.
        across: Panels across its upper half.
    """
    distances, heights = profile(links)
    bounds, length = _bounds(links), float(distances[-1])
    series = turning_series(distances, heights, along, across)
    kept = series_moments(bounds / length, along) @ series * length ** np.arange(3)
    strip = [[_strip_moment(link, power) for power in range(3)] for link in links]
    return np.asarray(kept / np.array(strip))


def _strip_moment(link: Link, power: int) -> float:
    """Return the integral over a link of pi/4 d^2 s^power."""
    nodes, weights = _gauss(3)
    total = 0.0
    for (start, low), (end, high) in pairwise(link.stations):
        half = 0.5 * (end - start)
        at = start + half * (1.0 + nodes)
        total += float(half * weights @ ((low + (high - low) * 0.5 * (1.0 + nodes)) ** 2 * at**power))
    return 0.25 * np.pi * total


def link_matrix(links: Sequence[Link], body: Ellipsoid, density: float) -> Array:
    """Return the added mass of body and links in the straight pose, and what couples surge to a bent tail.

    Coordinates: surge, sway and yaw rate of the body, then of each link the velocity of its joint across it and its
    yaw rate. A link's motion across itself is its own: a bent chain's links do not move as a straight one's.

    The body's surge carries water along with it, in which a bent tail moves across itself more slowly than in water at
    rest: for each link, first the coupling of surge to every coordinate over the sine of the link's angle to the body,
    then over the distance of its joint to the right of the body's axis; exact to the first order of the angles.

    Args:
        links: From the first joint to the trailing edge.
        body: The body, of which the rigid motion's own added mass is left out: that is Lamb's.
        density: Of the water, kg/m^3.

    Returns:
        Shape (3 + 2 N + 2 N, 3 + 2 N): the matrix, then the couplings of surge.

    Raises:
        ValueError: The matrix of the links is not positive.
    """
    count = len(links)
    sheet = Sheet.of_profile(*profile(links), max(ALONG, _PANELS_A_LINK * count), ACROSS)
    along, across = sheet.shape
    s, z = sheet.collocation()
    flow = sheet.own_velocity()
    surface = body.surface(_BODY_ALONG, _BODY_AROUND)
    through = -sheet.velocity_at(surface.places, surface.normals)
    flow += surface.flow_on_sheet(s, z) @ _solve(surface.flow_through(), through)

    bounds = _bounds(links)
    moments = sheet.moments(bounds[:-1], bounds[1:])  # (along, links, 2)
    area = moments[:, :, :1].sum(axis=1, keepdims=True)
    whole = (moments[:, :, :1] == area) & (area > 0.0)
    behind = sheet.points[:, None] - bounds[:-1]
    local = np.where(whole, np.stack((np.ones_like(behind), behind), axis=-1), moments / area)
    sign = np.array([1.0, -1.0])  # a link that turns to the left moves its rear to the right
    spans = 2.0 * np.diff(sheet.levels)[across:]  # both halves
    against = np.stack(body.flow_on_sheet(s, z), axis=1)
    motions = np.hstack((-against, np.repeat((local * sign).reshape(along, -1), across, axis=0)))
    areas = (area[:, 0] * spans).reshape(-1, 1)
    weights = np.hstack(
        (-against * areas, ((moments * sign).reshape(along, 1, -1) * spans[:, None]).reshape(along * across, -1))
    )
    strengths = density * _solve(flow, motions)
    own = weights.T @ strengths
    size = 3 + 2 * count
    matrix = np.zeros((size + 2 * count, size))
    matrix[1:size, 1:] = 0.5 * (own + own.T)
    carried, spread = (part.reshape(along, across, 1) for part in body.surge_on_sheet(s, z))
    surge = np.stack((carried + behind[:, None] * spread, np.broadcast_to(spread, (along, across, count))), axis=-1)
    surge = (surge * (moments[:, None, :, :1] / area[:, None])).reshape(along * across, 2 * count)
    matrix[size:, 1:] = (surge * areas).T @ strengths
    if np.linalg.eigvalsh(matrix[1:size, 1:])[0] <= 0.0:
        msg = f"the added-mass matrix of {count} links is not positive: the tail's outline is too uneven for its panels"
        raise ValueError(msg)
    return matrix


def straight_kinematics(lengths: Sequence[float], offset: float) -> Array:
    """Return how body and joints move the links of a straight chain, shape (3 + 2 N, 3 + N).

    Columns: surge, sway, yaw rate, joint rates. Rows: the coordinates of `link_matrix`.
    """
    count = len(lengths)
    result = np.zeros((3 + 2 * count, 3 + count))
    result[:3, :3] = np.eye(3)
    across, turning = np.zeros(3 + count), np.zeros(3 + count)
    across[1], across[2], turning[2] = 1.0, -offset, 1.0
    for index, length in enumerate(lengths):
        turning[3 + index] = 1.0
        result[3 + 2 * index], result[4 + 2 * index] = across, turning
        across = across - length * turning
    return result
