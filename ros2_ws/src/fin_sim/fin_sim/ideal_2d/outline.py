"""Sections in the plane, as nodes with quadrature weights: closed outlines, and fins without thickness.

Integrals over the boundary are sums over nodes that are equally spaced in a parameter, which converge faster than any
power of the spacing on smooth outlines. The logarithm of the distance between two nodes of one section is integrated
exactly: Kress, *Linear Integral Equations* (2014), section 12.3, on a closed outline; on a fin by the cosine series
log|c - c'| = -log 2 - 2 sum cos(m tau) cos(m tau') / m with c = cos tau, whose nodes crowd at the ends, where the
vortex sheet of a free edge is infinite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

FEWEST_POINTS, MOST_POINTS = 8, 2000
SHARPEST_TURN = math.radians(75.0)
"""Largest angle between two sides of an outline of points; a smooth outline has no sharper corner."""
_WIDEST_GAP = 3.0  # last point to first, over the longest other side
_FEWEST_NODES, _MOST_NODES = 160, 800


@dataclass(frozen=True)
class Section:
    """A rigid section in its own axes, as nodes on its boundary.

    Attributes:
        nodes: Positions x + i y, m, shape (n,); a closed outline counter-clockwise.
        spacing: h of the parameter: a boundary integral is h times the sum over nodes of density times speed.
        self_log: Symmetric matrix, shape (n, n): h times it, times values of the density per parameter, is the
            integral over the section of the density times log |x - x'| at each node.
        area: m^2; 0 of a fin without thickness.
        centroid: Of the area, x + i y, m; of a fin its middle.
        second_moment: Of the area about its centroid, m^4.
        inner_energy: J of `added_mass`: integral over the inside of |grad psi|^2, where psi is harmonic and
            -|x - centroid|^2 / 2 on the outline, m^4; 0 of a fin.
        ends: Of a fin its front and rear end; of a closed outline none.
        corners: Positions that nodes crowd at, where a fin is joined to this section so that no water passes.
    """

    nodes: NDArray[np.complex128]
    spacing: float
    self_log: NDArray[np.float64]
    area: float = 0.0
    centroid: complex = 0.0
    second_moment: float = 0.0
    inner_energy: float = 0.0
    ends: tuple[complex, ...] = ()
    corners: tuple[complex, ...] = ()

    @property
    def is_fin(self) -> bool:
        """Whether it has no thickness."""
        return bool(self.ends)


def _closed_log(count: int) -> NDArray[np.float64]:
    """Return the weights R of Kress's rule for half of log(4 sin^2((t - t')/2)), over h, shape (n, n); n is even."""
    half = count // 2
    angle = 2.0 * math.pi / count * np.arange(count)
    orders = np.arange(1, half)
    row = -np.cos(np.outer(angle, orders)) @ (1.0 / orders) - np.cos(half * angle) / (2.0 * half)
    index = np.arange(count)
    return np.asarray(row[np.abs(index[:, None] - index)])


def _derivative(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the derivative by the parameter of values at nodes that are equally spaced over 2 pi."""
    count = len(values)
    orders = np.fft.fftfreq(count, 1.0 / count)
    orders[count // 2] = 0.0
    return np.asarray(np.fft.ifft(1j * orders * np.fft.fft(values)))


def _closed_self_log(nodes: NDArray[np.complex128]) -> NDArray[np.float64]:
    count = len(nodes)
    parameter = 2.0 * math.pi / count * np.arange(count)
    sine = np.abs(2.0 * np.sin(0.5 * (parameter[:, None] - parameter)))
    distance = np.abs(nodes[:, None] - nodes)
    np.fill_diagonal(sine, 1.0)
    np.fill_diagonal(distance, np.abs(_derivative(nodes)))
    return _closed_log(count) + np.log(distance / sine)


def _inner_energy(nodes: NDArray[np.complex128], self_log: NDArray[np.float64], centroid: complex) -> float:
    """Return the energy of the harmonic function inside that is -|x - centroid|^2 / 2 on the outline.

    The function is the potential of a layer g: -1/(2 pi) times its integral with log |x - x'|; its slope along the
    normal, from inside, is g / 2 plus the principal value.
    """
    count = len(nodes)
    spacing = 2.0 * math.pi / count
    values = -0.5 * np.abs(nodes - centroid) ** 2
    layer_matrix = np.zeros((count + 1, count + 1))
    layer_matrix[:count, :count] = -spacing / (2.0 * math.pi) * self_log
    layer_matrix[:count, count] = layer_matrix[count, :count] = 1.0
    layer = np.linalg.solve(layer_matrix, np.append(values, 0.0))[:count]
    first = _derivative(nodes)
    second = _derivative(first)
    normal = -1j * first  # outward, times speed
    apart = nodes[:, None] - nodes
    np.fill_diagonal(apart, 1.0)
    kernel = np.real(normal[:, None] / apart)
    np.fill_diagonal(kernel, 0.5 * np.imag(np.conj(first) * second) / np.abs(first) ** 2)
    slope = 0.5 * layer - spacing / (2.0 * math.pi) * kernel @ layer  # times speed
    return float(spacing * values @ slope)


def _closed(nodes: NDArray[np.complex128]) -> Section:
    """Return a closed section; moments by Green's theorem."""
    spacing = 2.0 * math.pi / len(nodes)
    first = _derivative(nodes)
    area = float(0.5 * spacing * np.sum(np.imag(np.conj(nodes) * first)))
    moment = spacing * np.sum(np.abs(nodes) ** 2 * (-1j) * first) / 2.0  # integral of z over the area
    centroid = complex(moment / area)
    about = nodes - centroid
    second = float(0.25 * spacing * np.sum(np.abs(about) ** 2 * np.imag(np.conj(about) * first)))
    self_log = _closed_self_log(nodes)
    return Section(nodes, spacing, self_log, area, centroid, second, _inner_energy(nodes, self_log, centroid))


def ellipse(semi_major: float, semi_minor: float, count: int = 0) -> Section:
    """Return an ellipse with its axes along x and y.

    Args:
        semi_major: Half its length along x, m.
        semi_minor: Half its width along y, m.
        count: Nodes; 0 for what its slenderness asks for.

    Raises:
        ValueError: An axis that is not a positive length, or more slender than 200 to 1.
    """
    a = checks.number("semi-axis along x", semi_major, 0.0, unit="m", exclusive_minimum=True)
    b = checks.number("semi-axis along y", semi_minor, 0.0, unit="m", exclusive_minimum=True)
    count = count or nodes_of_ellipse(a, b)
    angle = 2.0 * math.pi / count * np.arange(count)
    return _closed(a * np.cos(angle) + 1j * b * np.sin(angle))


def joined_ellipse(semi_major: float, semi_minor: float, count: int) -> Section:
    """Return an ellipse with a fin joined to its rear tip: its nodes crowd there, none is at the tip.

    Raises:
        ValueError: As `ellipse`.
    """
    whole = ellipse(semi_major, semi_minor)
    place = 2.0 * math.pi / count * (np.arange(count) + 0.5)
    angle = place - np.sin(place) + math.pi
    nodes = semi_major * np.cos(angle) + 1j * semi_minor * np.sin(angle)
    crowded = _closed_self_log(nodes)
    return replace(whole, nodes=nodes, spacing=2.0 * math.pi / count, self_log=crowded, corners=(complex(-semi_major),))


def outline(points: Sequence[tuple[float, float]]) -> Section:
    """Return the section with a smooth outline through points: the periodic cubic spline over their number.

    Args:
        points: Positions (x, y), m, in order around the section, either way; dense where it is round. The first one may
            stand again at the end.

    Raises:
        ValueError: Too few or too many points, one given twice, an outline that is open, crosses itself or has a
            corner.
    """
    places = np.array([complex(*point) for point in points])
    if len(places) > 1 and places[0] == places[-1]:
        places = places[:-1]
    checks.whole_number("points of the outline", len(places), FEWEST_POINTS, MOST_POINTS)
    if not np.isfinite(places).all():
        number = int(np.flatnonzero(~np.isfinite(places))[0])
        msg = f"point {number + 1} of the outline is {points[number]}: give finite numbers, m"
        raise ValueError(msg)
    sides = np.roll(places, -1) - places
    lengths = np.abs(sides)
    if not lengths.all():
        msg = f"point {int(np.argmin(lengths)) + 1} of the outline stands twice: leave one of them out"
        raise ValueError(msg)
    longest = float(lengths[:-1].max())
    if lengths[-1] > _WIDEST_GAP * longest:
        msg = (
            f"the outline is open: from its last point to its first it is {lengths[-1]:.4g} m, its longest side is "
            f"{longest:.4g} m; give points all round"
        )
        raise ValueError(msg)
    _refuse_crossing(places)
    turns = np.angle(sides / np.roll(sides, 1))
    if np.max(np.abs(turns)) > SHARPEST_TURN:
        sharpest = int(np.argmax(np.abs(turns)))
        msg = (
            f"the outline turns by {math.degrees(abs(turns[sharpest])):.0f} degrees at its point {sharpest + 1}, "
            f"({places[sharpest].real:g}, {places[sharpest].imag:g}) m: a smooth one turns by "
            f"{math.degrees(SHARPEST_TURN):.0f} at most; give more points round the corner, or a fin without thickness"
        )
        raise ValueError(msg)
    if np.sum(turns) < 0.0:
        places = places[::-1]
    spline = CubicSpline(np.arange(len(places) + 1), np.append(places, places[0]), bc_type="periodic")
    count = 2 * math.ceil(min(max(_FEWEST_NODES, 2 * len(places)), _MOST_NODES) / 2)
    nodes = np.asarray(spline(len(places) / count * np.arange(count)))
    _refuse_crossing(nodes)
    return _closed(nodes)


def crossing(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> tuple[int, int] | None:
    """Return the numbers of two sides, one of each line of points, that cross each other; None where none do.

    Sides that only touch do not cross. Both shapes (n,); the lines are as long as given: repeat the first point to
    close one.
    """
    start, end = first[:-1, None], first[1:, None]
    other, beyond = second[None, :-1], second[None, 1:]

    def side(a: NDArray[np.complex128], b: NDArray[np.complex128], c: NDArray[np.complex128]) -> NDArray[np.float64]:
        return np.asarray(np.imag(np.conj(b - a) * (c - a)))

    apart = side(start, end, other) * side(start, end, beyond)
    across = side(other, beyond, start) * side(other, beyond, end)
    found = np.argwhere((apart < 0.0) & (across < 0.0))
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None


def _refuse_crossing(places: NDArray[np.complex128]) -> None:
    closed = np.append(places, places[0])
    found = crossing(closed, closed)
    if found:
        where = places[found[0]]
        msg = (
            f"the outline crosses itself near ({where.real:.4g}, {where.imag:.4g}) m, between its points "
            f"{found[0] + 1} and {found[1] + 1}: give them in order around the section"
        )
        raise ValueError(msg)


def fin(length: float, count: int, *, front_joined: bool = False, rear_joined: bool = False) -> Section:
    """Return a straight fin without thickness, from its front end at 0 back to -length.

    At an end where the next fin, or a body, goes on without a gap the sheet has no edge: there the nodes crowd further,
    so that the bend in the sheet's strength is resolved.

    Args:
        length: m.
        count: Nodes.
        front_joined: Whether the sheet goes on at the front end.
        rear_joined: Whether it goes on at the rear end.

    Raises:
        ValueError: A length that is not positive.
    """
    length = checks.number("fin length", length, 0.0, unit="m", exclusive_minimum=True)
    angle = math.pi / count * (np.arange(count) + 0.5)
    cosine = np.cos(angle)  # 1 at the front
    place, slope = _crowded(cosine, front=front_joined, rear=rear_joined)
    orders = np.arange(1, count)
    waves = np.cos(np.outer(angle, orders))
    self_log = -math.log(2.0) - 2.0 * (waves / orders) @ waves.T
    apart = np.abs(cosine[:, None] - cosine)
    distance = length * np.abs(place[:, None] - place)
    np.fill_diagonal(apart, 1.0)
    np.fill_diagonal(distance, length * slope)
    nodes = (-length * place).astype(np.complex128)
    return Section(
        nodes=nodes,
        spacing=math.pi / count,
        self_log=self_log + np.log(distance / apart),
        centroid=complex(-0.5 * length),
        ends=(0j, complex(-length)),
    )


def _crowded(
    cosine: NDArray[np.float64], *, front: bool, rear: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the share of the length behind the front end, and how fast it grows as the cosine falls, shape (n,)."""
    if front and rear:
        return (2.0 - 3.0 * cosine + cosine**3) / 4.0, 0.75 * (1.0 - cosine**2)
    if front:
        return (0.5 - 0.5 * cosine) ** 2, 0.5 - 0.5 * cosine
    if rear:
        return 1.0 - (0.5 + 0.5 * cosine) ** 2, 0.5 + 0.5 * cosine
    return 0.5 - 0.5 * cosine, np.full_like(cosine, 0.5)


def nodes_of_ellipse(a: float, b: float) -> int:
    """Return an even number of nodes that makes an ellipse's own integrals right to 1e-12.

    They converge as ((a - b) / (a + b))^n.

    Raises:
        ValueError: More slender than 200 to 1.
    """
    ratio = abs(a - b) / (a + b)
    most = 0.99  # 199 to 1
    if ratio > most:
        msg = (
            f"an ellipse of semi-axes {a:g} and {b:g} m is more slender than 199 to 1: "
            "give a fin without thickness in its place"
        )
        raise ValueError(msg)
    needed = math.log(1e-12) / math.log(ratio) if ratio > 0.0 else 0.0
    return 2 * math.ceil(0.5 * max(64.0, needed))
