"""Many fins as columns of their attributes, which spares an object for each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.fin import FIN_PARAMETERS, Fin, ProfiledFin
from fin_plant.gait import COLUMNS, DRIVE_RANGES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

FinColumns = Mapping[str, "ArrayLike"]


PROFILE = ("profile_position", "profile_height")
GAITS = "gait"
"""Column of the gaits, shape (n, joints, 4), where each fish has its own."""
NAMES = tuple(item.name for item in fields(Fin))
WORDS = tuple(name for name in NAMES if FIN_PARAMETERS[f"fin.{name}"].choices)
"""Attributes whose values are words; all others are numbers."""


def fin_at(columns: Mapping[str, NDArray[np.generic]], index: int) -> Fin:
    """Return one fin of the columns.

    Raises:
        ValueError: A value that is refused.
    """
    values = {name: columns[name][index].item() for name in NAMES}
    profile = {name: _points(columns[name][index]) for name in PROFILE if name in columns}
    if not any(map(len, profile.values())):
        return Fin(**values)
    return Fin.from_parameters({f"fin.{name}": value for name, value in (values | profile).items()})


def _points(row: NDArray[np.generic]) -> list[float]:
    """Return the points of one fin's profile."""
    numbers = row.astype(float)
    return [float(number) for number in numbers[~np.isnan(numbers)]]


def _padded(rows: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Return points of profiles, shape (n, most points), NaN behind the last one of each."""
    result = np.full((len(rows), max(map(len, rows))), np.nan)
    for row, points in zip(result, rows, strict=True):
        row[: len(points)] = points
    return result


def fin_columns(fins: Sequence[Fin] | FinColumns) -> dict[str, NDArray[np.generic]]:
    """Return the fins' attributes as columns of one length, those not given at the default fin's.

    A profile's columns have shape (n, points), or (points,) where all fins have the same; in the result they are filled
    up with NaN, and there are none where no fin has one.

    Raises:
        ValueError: A name that is no attribute of a fin, columns of unequal length, or a column that is not numbers.
    """
    columns: dict[str, NDArray[np.generic]]
    if not isinstance(fins, Mapping):
        columns = {name: np.array([getattr(fin, name) for fin in fins]) for name in NAMES}
        if any(isinstance(fin, ProfiledFin) for fin in fins):
            columns |= {name: _padded([getattr(fin, name, ()) for fin in fins]) for name in PROFILE}
        return columns
    for name in fins:
        FIN_PARAMETERS.require(f"fin.{name}")
    defaults = Fin()
    columns = {}
    for name in NAMES:
        column = np.atleast_1d(np.asarray(fins.get(name, getattr(defaults, name))))
        if column.dtype.kind not in ("U" if name in WORDS else "fiu"):
            msg = f"fin.{name} must be a column of {'names' if name in WORDS else 'numbers'}, got {column.dtype}"
            raise ValueError(msg)
        columns[name] = column
    profile = _profile_columns(fins)
    shapes = {f"fin.{name}": column.shape for name, column in columns.items() if column.size > 1}
    shapes |= {f"fin.{name}": column.shape[:1] for name, column in profile.items() if len(column) > 1}
    if len(set(shapes.values())) > 1 or any(len(shape) != 1 for shape in shapes.values()):
        msg = f"the columns of the fins have different shapes, {shapes}: give one value each, or one for all"
        raise ValueError(msg)
    count = max((shape[0] for shape in shapes.values()), default=1)
    columns = {name: np.broadcast_to(column.ravel(), (count,)) for name, column in columns.items()}
    return columns | {name: np.broadcast_to(column, (count, column.shape[1])) for name, column in profile.items()}


def _profile_columns(fins: FinColumns) -> dict[str, NDArray[np.float64]]:
    """Return the columns of profiles, each of shape (n or 1, most points); none where there is none."""
    given = {}
    for name in PROFILE:
        try:
            given[name] = np.atleast_2d(np.asarray(fins.get(name, ()), dtype=float))
        except (TypeError, ValueError):
            msg = f"fin.{name} must be numbers, of shape (points,) or (n, points)"
            raise ValueError(msg) from None
        if given[name].ndim > 2:  # noqa: PLR2004
            msg = f"fin.{name} has shape {given[name].shape}: give (points,) or (n, points)"
            raise ValueError(msg)
    most = max(column.shape[1] for column in given.values())
    if most == 0:
        return {}
    return {
        name: np.pad(column, ((0, 0), (0, most - column.shape[1])), constant_values=np.nan)
        for name, column in given.items()
    }


def with_gaits(
    columns: dict[str, NDArray[np.generic]], gaits: ArrayLike, joints: int
) -> dict[str, NDArray[np.generic]]:
    """Return the columns with a gait a row, shape (n, joints, 4) as `Gait.rows`; one row serves all fins or gaits.

    Raises:
        ValueError: Another shape, or another number of joints than the tail's.
    """
    rows = np.array(gaits, dtype=float)
    if rows.ndim != 3 or rows.shape[1:] != (joints, len(COLUMNS)):  # noqa: PLR2004
        msg = f"gaits have shape {rows.shape}: give (n, {joints}, {len(COLUMNS)}), a row a driven joint of the tail"
        raise ValueError(msg)
    count = len(columns["length"])
    if 1 not in (count, len(rows)) and count != len(rows):
        msg = f"there are {len(rows)} gaits and {count} fins: give one a fin, or one for all"
        raise ValueError(msg)
    count = max(count, len(rows)) if len(rows) and count else 0
    phase = COLUMNS.index("phase")
    with np.errstate(invalid="ignore"):
        rows[:, :, phase] = np.where(
            np.abs(rows[:, :, phase]) <= DRIVE_RANGES["phase"][1], np.remainder(rows[:, :, phase], 2.0 * np.pi), np.nan
        )
    columns = {name: np.broadcast_to(column, (count, *column.shape[1:])) for name, column in columns.items()}
    return columns | {GAITS: np.broadcast_to(rows, (count, *rows.shape[1:]))}


def highest_heights(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the fins' largest heights in m, shape (n,)."""
    heights = [columns["height"].astype(float), columns["tip_height"].astype(float)]
    if PROFILE[1] in columns:
        heights.append(np.nan_to_num(columns[PROFILE[1]].astype(float), nan=0.0).max(axis=1))
    return np.asarray(np.max(heights, axis=0))


def accepted(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return which fins and gaits `Fin` and `Gait` would accept, shape (n,)."""
    good = np.ones(len(columns["length"]), dtype=bool)
    for name in NAMES:
        column, parameter = columns[name], FIN_PARAMETERS[f"fin.{name}"]
        if parameter.choices:
            good &= np.isin(column, parameter.choices)
        else:
            values = column.astype(float)
            good &= (values >= parameter.minimum) & (values <= parameter.maximum)
            if parameter.kind == "integer":
                good &= values == np.floor(values)
    if PROFILE[0] in columns:
        good &= _accepted_profiles(*(columns[name].astype(float) for name in PROFILE))
    if GAITS in columns:
        rows = columns[GAITS].astype(float)
        for place, name in enumerate(COLUMNS):
            low, high, _ = DRIVE_RANGES[name]
            good &= ((rows[:, :, place] >= low) & (rows[:, :, place] <= high)).all(axis=1)
    sheet = np.minimum(columns["length"].astype(float), columns["height"].astype(float))
    return np.asarray(good & (columns["thickness"].astype(float) < sheet))


def fins_accepted(fins: FinColumns) -> NDArray[np.bool_]:
    """Return which fins of columns `Fin` would accept, shape (n,)."""
    return accepted(fin_columns(fins))


def _accepted_profiles(positions: NDArray[np.float64], heights: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which profiles can be, both of shape (n, most points): as many heights as positions, which rise."""
    there = ~np.isnan(positions)
    entry = FIN_PARAMETERS[f"fin.{PROFILE[1]}"]
    good = (there == ~np.isnan(heights)).all(axis=1)
    with np.errstate(invalid="ignore"):
        good &= (~there | ((positions > 0.0) & (positions < 1.0))).all(axis=1)
        good &= (~there | ((heights >= entry.minimum) & (heights <= entry.maximum))).all(axis=1)
        good &= (~there[:, 1:] | (positions[:, 1:] > positions[:, :-1])).all(axis=1)
    return np.asarray(good)
