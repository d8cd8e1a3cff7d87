"""What three dimensions leave of the links' virtual moments: rectangles from a table, other sheets solved once.

`python -m fin_sim.surface_3d.factors` writes the table ``data/surface_3d_rectangles.csv``: for each length over height
the series of `added_mass.turning_series` over pi/4 d^2 length. From it follow the factors for any division into links.
"""

from __future__ import annotations

import csv
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from fin_sim.fish import Link
from fin_sim.surface_3d.added_mass import link_factors, link_matrix, series_moments, turning_series
from fin_sim.surface_3d.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RATIOS = (0.05, 200.0)
"""Length over height of the table; a rectangle beyond it has the factors of the nearest."""
_ROWS, _ALONG, _ACROSS = 73, 32, 10
_CACHED, _ROUNDING = 4096, 1e-12
_TABLE = "surface_3d_rectangles.csv"


@lru_cache(maxsize=1)
def _rectangles() -> CubicSpline:
    """Return the series over the logarithm of length over height."""
    text = (resources.files("fin_sim") / "data" / _TABLE).read_text(encoding="utf-8")
    rows = np.array([[float(cell) for cell in row] for row in list(csv.reader(text.splitlines()))[1:]])
    return CubicSpline(np.log(rows[:, 0]), rows[:, 1:])


def rectangle_factors(ratio: Array, bounds: Array) -> Array:
    """Return the factors of the links of rectangular sheets that are divided alike, shape (n, N, 3).

    Args:
        ratio: Length over height, shape (n,).
        bounds: The joints and the trailing edge over the length, shape (N + 1,).
    """
    series = _rectangles()(np.log(np.clip(ratio, *RATIOS)))
    weights = _weights(tuple(bounds.tolist()), series.shape[-1])
    # Not by the linear algebra's own threads, one of which would spin on the other core for the rest of the batch.
    return np.asarray(np.einsum("ns,ws->nw", series, weights)).reshape(len(series), len(bounds) - 1, 3)


@lru_cache(maxsize=256)
def _weights(bounds: tuple[float, ...], orders: int) -> Array:
    """Return what a series makes of the factors of a rectangle's links, shape (3 N, orders)."""
    ends = np.array(bounds)
    strip = np.stack([np.diff(ends) ** power / power for power in (1, 2, 3)], axis=-1)
    return (series_moments(ends, orders) / strip[..., None]).reshape(-1, orders)


@lru_cache(maxsize=_CACHED)
def _solved(links: tuple[Link, ...]) -> Array:
    return link_factors(links)


def factors(links: Sequence[Link]) -> Array:
    """Return the factors of the three virtual moments of each link of one sheet, shape (N, 3)."""
    heights = np.array([height for link in links for _, height in link.stations])
    lengths = np.array([link.length for link in links])
    if np.all(_alike(heights, heights[:1])):
        bounds = np.concatenate(([0.0], np.cumsum(lengths))) / lengths.sum()
        return np.asarray(rectangle_factors(np.array([lengths.sum() / heights[0]]), bounds)[0])
    # The outline decides, at any size and with any hinges.
    size = float(lengths.sum())
    return _solved(
        tuple(
            Link(
                _rounded(link.length / size),
                _rounded(link.root_height / size),
                _rounded(link.tip_height / size),
                profile=tuple((_rounded(at / size), _rounded(height / size)) for at, height in link.profile),
            )
            for link in links
        )
    )


@lru_cache(maxsize=64)
def matrix(links: tuple[Link, ...], axes: tuple[float, float, float], offset: float) -> Array:
    """Return `added_mass.link_matrix` in water of density 1; the last ones are kept.

    Args:
        links: From the first joint to the trailing edge.
        axes: Full length, width and height of the body, m.
        offset: From the body's centre back to the first joint, m.

    Raises:
        ValueError: The tail begins inside of the body, or the matrix is not positive.
    """
    a, b, c = (0.5 * axis for axis in axes)
    return link_matrix(links, Ellipsoid(a, b, c, offset), 1.0)


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")


def columns_factors(links: Mapping[str, Array]) -> Array:
    """Return the factors of many tails of equally many links, shape (n, N, 3).

    Args:
        links: ``length``, ``root_height`` and ``tip_height`` in m, of shape (n, N); where links have several pieces
            their ``piece_begin``, ``piece_length``, ``piece_root`` and ``piece_tip`` too, of shape (n, N, pieces).
    """
    length, root, tip = links["length"], links["root_height"], links["tip_height"]
    result = np.ones((*length.shape, 3))
    total, first = length.sum(axis=1), root[:, :1]
    flat = np.all(_alike(root, first) & _alike(tip, first), axis=1)
    for name in ("piece_root", "piece_tip"):
        if name in links:
            flat &= np.all(_alike(links[name], first[:, :, None]), axis=(1, 2))
    # Rounded, so that fins of one division but of different lengths share one set of weights.
    bounds = np.round(np.hstack((np.zeros((len(total), 1)), np.cumsum(length, axis=1))) / total[:, None], 12)
    kinds, kind = np.unique(bounds[flat], axis=0, return_inverse=True)
    rows = np.flatnonzero(flat)
    for index, division in enumerate(kinds):
        chosen = rows[kind.ravel() == index]
        result[chosen] = rectangle_factors(total[chosen] / root[chosen, 0], division)
    for row in np.flatnonzero(~flat).tolist():
        result[row] = factors([_link(links, row, column) for column in range(length.shape[1])])
    return result


def _alike(one: Array, other: Array) -> NDArray[np.bool_]:
    """Return where heights are the same but for the rounding of an interpolation between equal ends."""
    return np.asarray(np.abs(one - other) <= _ROUNDING * other)


def _link(links: Mapping[str, Array], row: int, column: int) -> Link:
    """Return the outline of one link of the columns."""
    length, root, tip = (float(links[name][row, column]) for name in ("length", "root_height", "tip_height"))
    points: list[tuple[float, float]] = []
    if "piece_begin" in links:
        begin, size, height = (links[f"piece_{name}"][row, column].tolist() for name in ("begin", "length", "root"))
        inside = [piece for piece in range(1, len(begin)) if size[piece] > 0.0]
        points = [(begin[piece], height[piece]) for piece in inside]
    return Link(length, root, tip, profile=tuple(points))


def write_table(path: Path) -> None:
    """Solve the rectangles and write the table.

    Raises:
        OSError: The file cannot be written.
    """
    rows = ["length_over_height," + ",".join(f"series_{order}" for order in range(1, _ALONG + 1))]
    for ratio in np.geomspace(*RATIOS, _ROWS):
        height = 1.0 / ratio
        series = turning_series(np.array([0.0, 1.0]), np.array([height, height]), _ALONG, _ACROSS)
        values = series / (0.25 * np.pi * height**2)
        rows.append(",".join([f"{ratio:.9g}", *(f"{value:.9g}" for value in values)]))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_table(Path(str(resources.files("fin_sim"))) / "data" / _TABLE)
