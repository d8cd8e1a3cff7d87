"""Many fins as columns of their attributes, which spares an object for each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, cast

import numpy as np

from fin_plant.fin import FIN_PARAMETERS, Fin, ProfiledFin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

FinColumns = Mapping[str, "ArrayLike"]


PROFILE = ("profile_position", "profile_height")
NAMES = tuple(item.name for item in fields(Fin))
WORDS = tuple(name for name in NAMES if FIN_PARAMETERS[f"fin.{name}"].choices)
"""Attributes whose values are words; all others are numbers."""


def fin_at(columns: Mapping[str, NDArray[np.generic]], index: int) -> Fin:
    """Return one fin of the columns.

    Raises:
        ValueError: A value that is refused.
    """
    values = {name: columns[name][index].item() for name in NAMES}
    profile = {name: columns[name][index] for name in PROFILE if name in columns}
    return ProfiledFin(**values, **profile) if any(map(len, profile.values())) else Fin(**values)


def _profile_column(profiles: Sequence[Sequence[float]]) -> NDArray[np.generic]:
    column = np.empty(len(profiles), dtype=object)
    for index, profile in enumerate(profiles):
        column[index] = tuple(profile)
    return column


def fin_columns(fins: Sequence[Fin] | FinColumns) -> dict[str, NDArray[np.generic]]:
    """Return the fins' attributes as columns of one length, those not given at the default fin's.

    A profile is the same for all fins of columns; there are columns of profiles only where a fin has one.

    Raises:
        ValueError: A name that is no attribute of a fin, columns of unequal length, or a column that is not numbers.
    """
    columns: dict[str, NDArray[np.generic]]
    if not isinstance(fins, Mapping):
        columns = {name: np.array([getattr(fin, name) for fin in fins]) for name in NAMES}
        if any(isinstance(fin, ProfiledFin) for fin in fins):
            columns |= {name: _profile_column([getattr(fin, name, ()) for fin in fins]) for name in PROFILE}
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
    try:
        columns = dict(zip(NAMES, np.broadcast_arrays(*columns.values()), strict=True))
    except ValueError:
        lengths = {f"fin.{name}": column.shape for name, column in columns.items() if column.size > 1}
        msg = f"the columns of the fins have different shapes, {lengths}: give one value each, or one for all"
        raise ValueError(msg) from None
    profile = {name: tuple(map(float, cast("Sequence[float]", fins.get(name, ())))) for name in PROFILE}
    if any(profile.values()):
        columns |= {name: _profile_column([profile[name]] * len(columns["length"])) for name in PROFILE}
    return columns


def accepted(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return which fins `Fin` would accept, shape (n,)."""
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
    sheet = np.minimum(columns["length"].astype(float), columns["height"].astype(float))
    return np.asarray(good & (columns["thickness"].astype(float) < sheet))
