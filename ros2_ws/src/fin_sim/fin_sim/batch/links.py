"""From columns of fins to columns of links: what `chain.build_chain` does for one fin, for many at once."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.batch.columns import NAMES, PROFILE, WORDS, highest_heights
from fin_sim.batch.step import PIECE_FIELDS, piece_field
from fin_sim.oscillating_drag import STATIONS, link_coefficients

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fin_sim.fish import Fish, Water


def stiffness_per_height(fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return a hinge's stiffness over the height of the sheet at it, N/rad, shape (n,), as `Fin.hinge_stiffness`."""
    modulus, thickness, length, segments = (
        fins[name].astype(float) for name in ("young_modulus", "thickness", "length", "segments")
    )
    length = np.where(fins["stiffness_length"] == "segment", length / segments, length)
    return np.asarray(modulus * thickness**3 / (12.0 * length))  # eq. 3


def least_damping_times(fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the least damping over stiffness of any hinge that the fins could have, s, shape (n,)."""
    with np.errstate(all="ignore"):  # a fin that is refused may be of any size
        own = fins["hinge_damping"].astype(float) / (stiffness_per_height(fins) * highest_heights(fins))
    return np.asarray(fins["damping_time"].astype(float) + own)


def _ends(hinges: str, segments: int) -> NDArray[np.float64]:
    """Return where links begin and the last one ends, in parts of the fin's length, shape (links + 1,)."""
    inner = np.arange(1, segments) if hinges == "between" else np.arange(segments) + 0.5
    return np.concatenate(([0.0], inner / segments, [1.0]))


def _stations(fins: Mapping[str, NDArray[np.generic]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the fins' heights are given and these, shapes (n, points): root, profile, tip, the tip repeated."""
    height, tip = fins["height"].astype(float)[:, None], fins["tip_height"].astype(float)[:, None]
    begin, end = np.zeros_like(height), np.ones_like(height)
    if PROFILE[0] not in fins:
        return np.hstack((begin, end)), np.hstack((height, tip))
    at, heights = (fins[name].astype(float) for name in PROFILE)
    missing = np.isnan(at)
    return (
        np.hstack((begin, np.where(missing, 1.0, at), end)),
        np.hstack((height, np.where(missing, tip, heights), tip)),
    )


def _heights_at(fins: Mapping[str, NDArray[np.generic]], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the fins' heights at places in parts of their lengths, both of shape (n, places), or places (places,)."""
    at, heights = _stations(fins)
    places = np.broadcast_to(places, (len(at), places.shape[-1]))
    if at.shape[1] == 2:  # noqa: PLR2004  (root and tip)
        return heights[:, :1] * (1.0 - places) + heights[:, 1:] * places
    piece = np.zeros(places.shape, dtype=int)
    for column in at[:, 1:-1].T:
        piece += places >= column[:, None]
    front, rear, low, high = (
        np.take_along_axis(table, piece + shift, axis=1) for table in (at, heights) for shift in (0, 1)
    )
    width = rear - front
    share = np.divide(places - front, width, out=np.zeros_like(width), where=width > 0.0)
    return low * (1.0 - share) + high * share


def piece_counts(fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.intp]:
    """Return the most pieces between two points of its profile that a link of each fin has, shape (n,)."""
    counts = np.ones(len(fins["length"]), dtype=np.intp)
    if PROFILE[0] not in fins:
        return counts
    kinds = np.char.add(fins["hinges"].astype(str), np.char.mod("_%d", fins["segments"].astype(int)))
    for kind in np.unique(kinds):
        rows = np.flatnonzero(kinds == kind)
        ends = _ends(str(fins["hinges"][rows[0]]), int(fins["segments"][rows[0]]))
        at = fins[PROFILE[0]].astype(float)[rows]
        for start, end in pairwise(ends):
            counts[rows] = np.maximum(counts[rows], 1 + np.count_nonzero((at > start) & (at < end), axis=1))
    return counts


def link_columns(fish: Fish, fins: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.float64]]:
    """Return the links of fins of equal segments and hinges, by attribute of `Link`, each of shape (n, links).

    Where a link has several pieces there are ``piece_begin`` and so on too, each of shape (n, links, pieces); what a
    link has fewer than the others ends with pieces of no length.
    """
    count = len(fins["length"])
    number = {name: fins[name].astype(float)[:, None] for name in NAMES if name not in WORDS}
    at = _ends(str(fins["hinges"][0]), int(fins["segments"][0]))
    heights = _heights_at(fins, at)
    stiffness = heights[:, :-1] * stiffness_per_height(fins)[:, None]
    tail = {
        "length": number["length"] * np.diff(at),
        "root_height": heights[:, :-1],
        "tip_height": heights[:, 1:],
        "mass_per_area": np.broadcast_to(number["density"] * number["thickness"], (count, len(at) - 1)),
        "stiffness": stiffness,
        "damping": stiffness * number["damping_time"] + number["hinge_damping"],
    }
    links = {
        name: np.hstack((np.tile([getattr(link, name) for link in fish.peduncle], (count, 1)), column))
        for name, column in tail.items()
    }
    most = int(piece_counts(fins).max(initial=1))
    return links | _pieces(links, fins, at, most) if most > 1 else links


def _pieces(
    links: Mapping[str, NDArray[np.float64]],
    fins: Mapping[str, NDArray[np.generic]],
    at: NDArray[np.float64],
    most: int,
) -> dict[str, NDArray[np.float64]]:
    """Return the columns of so many pieces of each link: distance behind the joint, length, both heights."""
    points, heights = (table[:, 1:-1] for table in _stations(fins))
    shape = (*links["length"].shape, most + 1)
    place, height = np.empty(shape), np.empty(shape)
    place[:], height[:] = links["length"][:, :, None], links["tip_height"][:, :, None]
    place[:, :, 0], height[:, :, 0] = 0.0, links["root_height"]
    first = shape[1] - len(at) + 1  # the links before are the peduncle's
    for link, (start, end) in enumerate(pairwise(at), start=first):
        inside = (points > start) & (points < end)
        rank = np.cumsum(inside, axis=1)
        for piece in range(1, most):
            row, column = np.nonzero(inside & (rank == piece))
            place[row, link, piece] = (points[row, column] - start) * fins["length"].astype(float)[row]
            height[row, link, piece] = heights[row, column]
    return {
        "piece_begin": place[:, :, :-1],
        "piece_length": np.diff(place, axis=2),
        "piece_root": height[:, :, :-1],
        "piece_tip": height[:, :, 1:],
    }


def normal_drags(
    links: Mapping[str, NDArray[np.float64]],
    fins: Mapping[str, NDArray[np.generic]],
    fish: Fish,
    gaits: NDArray[np.float64],
) -> NDArray[np.float64] | float:
    """Return C_N of every link, shape (n, links), or the one of all where it does not depend on the gait.

    Args:
        links: Columns of `link_columns`.
        fins: Columns of the fins.
        fish: The fish.
        gaits: Shape (n or 1, joints, 4).
    """
    if fish.water.oscillating_drag == 0.0:
        return fish.water.normal_drag
    root, tip = links["root_height"][:, :, None], links["tip_height"][:, :, None]
    heights = root + (tip - root) * STATIONS
    if PROFILE[0] in fins:
        at = _ends(str(fins["hinges"][0]), int(fins["segments"][0]))
        places = (at[:-1, None] + np.diff(at)[:, None] * STATIONS).ravel()
        heights[:, len(fish.peduncle) :] = _heights_at(fins, places).reshape(len(heights), -1, len(STATIONS))
    return link_coefficients(fish.water, gaits, links["length"], heights, range(fish.driven_joints))


def lane_constants(
    links: Mapping[str, NDArray[np.float64]], water: Water, normal_drag: NDArray[np.float64] | float | None = None
) -> dict[str, NDArray[np.float64]]:
    """Return the constants of `LaneLink` and its pieces, each of shape (n, links); moments in closed form.

    Args:
        links: Attributes of `Link`, each of shape (n, links).
        water: The water.
        normal_drag: C_N, shape (n, links) or one for all; the water's where none is given.
    """
    length, tip = links["length"], links["tip_height"]
    virtual = 0.25 * np.pi * water.density
    resistive = -0.5 * water.density * (water.normal_drag if normal_drag is None else normal_drag) * water.resists
    pieces = _piece_columns(links)
    moments = [_piece_moments(piece, virtual, links["mass_per_area"]) for piece in pieces]
    virtual_moments, solid_moments = (np.sum(kind, axis=0) for kind in zip(*moments, strict=True))
    resistances = [_piece_resistance(piece, resistive) for piece in pieces]
    tip_virtual = virtual * tip**2 * (water.wake == "lighthill")
    if water.model == "surface_3d":
        from fin_sim.surface_3d.factors import columns_factors  # noqa: PLC0415  (strips need no table)

        kept = columns_factors(links)
        virtual_moments = virtual_moments * np.moveaxis(kept, 2, 0)
        tip_virtual = tip_virtual * (kept[:, -1:, 0] if water.tip_term == "scaled" else 1.0)
    normal = [v + s for v, s in zip(virtual_moments, solid_moments, strict=True)]
    constants = {
        "length": length,
        "along_mass": solid_moments[0],
        "normal_mass": normal[0],
        "normal_first": normal[1],
        "normal_second": normal[2],
        "virtual_mass": virtual_moments[0],
        "virtual_first": virtual_moments[1],
        "tip_virtual": tip_virtual,
    }
    if len(pieces) == 1:
        return constants | resistances[0]
    for place, (piece, resistance) in enumerate(zip(pieces, resistances, strict=True)):
        fields = {"begin": piece["begin"], "length": piece["length"], **resistance}
        constants |= {piece_field(name, place): fields[name] for name in PIECE_FIELDS}
    return constants


def _piece_columns(links: Mapping[str, NDArray[np.float64]]) -> list[dict[str, NDArray[np.float64]]]:
    """Return ``begin``, ``length``, ``root`` and ``tip`` (heights) of each piece, in m, each of shape (n, links)."""
    if "piece_begin" not in links:
        whole = {"length": links["length"], "root": links["root_height"], "tip": links["tip_height"]}
        return [{"begin": np.zeros_like(links["length"])} | whole]
    return [
        {name: links[f"piece_{name}"][:, :, place] for name in ("begin", "length", "root", "tip")}
        for place in range(links["piece_begin"].shape[2])
    ]


def _piece_moments(
    piece: Mapping[str, NDArray[np.float64]], virtual: float, mass_per_area: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return the moments 0 to 2 about the link's root, of a piece's virtual mass and of its sheet.

    Args:
        piece: As `_piece_columns` returns it.
        virtual: Virtual mass per length and height squared, kg/m^3.
        mass_per_area: Of the sheet, kg/m^2, shape (n, links).
    """
    own, root = piece["length"], piece["root"]
    change = piece["tip"] - root
    squares = [
        virtual * own ** (p + 1) * (root**2 / (p + 1) + 2.0 * root * change / (p + 2) + change**2 / (p + 3))
        for p in range(3)
    ]
    sheets = [mass_per_area * own ** (p + 1) * (root / (p + 1) + change / (p + 2)) for p in range(3)]
    return _shifted(squares, piece["begin"]), _shifted(sheets, piece["begin"])


def _piece_resistance(
    piece: Mapping[str, NDArray[np.float64]], resistive: NDArray[np.float64] | float
) -> dict[str, NDArray[np.float64]]:
    """Return the constants of a piece's resistance, of ``resistive`` = -1/2 density C_N."""
    own, root = piece["length"], piece["root"]
    change = piece["tip"] - root
    return {
        "resistive_force": resistive * root * own / 3.0,
        "resistive_moment": resistive * root * own**2 / 12.0,
        "taper_force": resistive * change * own / 12.0,
        "taper_moment": resistive * change * own**2 / 30.0,
    }


def _shifted(moments: Sequence[NDArray[np.float64]], begin: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the moments 0 to 2 about a point ``begin`` ahead."""
    zeroth, first, second = moments
    return [zeroth, begin * zeroth + first, begin * (begin * zeroth + 2.0 * first) + second]
