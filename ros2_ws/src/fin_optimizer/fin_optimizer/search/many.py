"""Many candidates at once, as the columns that the batch simulator swims: what `Rules.sent` says of each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.search import names
from fin_optimizer.search.rules import gait_of, is_plain
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.gait import COLUMNS, Gait
from fin_sim.batch import fins_accepted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.conditions import Condition
    from fin_optimizer.search.rules import Rules
    from fin_optimizer.search.space import Space


@dataclass(frozen=True)
class Columns:
    """Candidates as columns.

    Attributes:
        parameters: Of fin and gait by name, each of shape (n,), or one value for all; the profile's of shape (points,)
            or (n, points).
        gaits: One for all, or shape (n, joints, 4) as `Gait.rows`.
        count: Number of candidates, n.
    """

    parameters: Mapping[str, Any]
    gaits: Gait | NDArray[np.float64]
    count: int

    @property
    def fins(self) -> dict[str, Any]:
        """The fins as `swim_batch` takes them."""
        given = {name.removeprefix("fin."): self.parameters[name] for name in FIN_PARAMETERS if name in self.parameters}
        return {**given, "length": np.broadcast_to(np.asarray(given["length"], dtype=float), (self.count,))}

    def met(self, conditions: Sequence[Condition]) -> NDArray[np.bool_]:
        """Return which candidates can be built and meet plain conditions, shape (n,)."""
        good = fins_accepted(self.fins)
        numbers = self.numbers
        for condition in conditions:
            good = good & condition.met(numbers)
        return good

    @property
    def numbers(self) -> dict[str, Any]:
        """Every number that a plain condition may name, each of shape (n,) or one value for all."""
        heights = np.asarray(self.parameters[names.HEIGHTS], dtype=float)
        rows = self.gaits.rows() if isinstance(self.gaits, Gait) else self.gaits
        return {
            **self.parameters,
            **{names.height(place + 1): heights[..., place] for place in range(heights.shape[-1])},
            **_drives(rows),
        }


def columns_of(space: Space, rules: Rules, start: Mapping[str, Any], numbers: NDArray[np.float64]) -> Columns:
    """Return candidates, shape (n, parameters) as `Space.row` has them, as columns; nothing is checked.

    Args:
        space: What is searched.
        rules: What follows from a candidate.
        start: Parameters that are not searched.
        numbers: The candidates.
    """
    gait = gait_of(start)
    searched = [name for name in space.names if name.startswith("gait.")]
    # Of a tail of several joints a preset says what the whole tail's numbers mean to each.
    if not is_plain(rules) or (len(gait.joints) > 1 and set(searched) & set(names.WHOLE)):
        return _one_by_one(space, rules, start, numbers, own_gaits=bool(searched or rules.stock))
    columns = {
        dimension.name: np.array([dimension.value(number) for number in column.tolist()])
        for dimension, column in zip(space.dimensions, numbers.T, strict=True)
    }
    heights = list(start[names.HEIGHTS])
    for name, column in columns.items():
        place = names.height_place(name)
        if place is not None:
            heights[place] = column
    parameters: dict[str, Any] = {**start, **columns, names.HEIGHTS: heights}
    with np.errstate(all="ignore"):  # what cannot be is refused by what follows from it
        for tie in rules.ties:
            parameters = tie.solved(parameters)
    heights = parameters[names.HEIGHTS]
    if heights:
        parameters[names.HEIGHTS] = np.column_stack([np.broadcast_to(each, len(numbers)) for each in heights])
    if not searched:
        return Columns(parameters, gait, len(numbers))
    gaits = np.tile(gait.rows(), (len(numbers), 1, 1))
    for name in searched:
        joint, of = names.drive_place(name) or (0, names.WHOLE[name])
        gaits[:, joint, COLUMNS.index(of)] = columns[name]
    return Columns(parameters, gaits, len(numbers))


def _one_by_one(
    space: Space, rules: Rules, start: Mapping[str, Any], numbers: NDArray[np.float64], *, own_gaits: bool
) -> Columns:
    sent = [rules.sent(start, space.values(row)) for row in numbers.tolist()]
    wanted = [*FIN_PARAMETERS, *(set(names.WHOLE) & {*start, *space.names})]
    parameters = {name: np.array([each[name] for each in sent]) for name in wanted}
    gaits = np.array([gait_of(each).rows() for each in sent]) if own_gaits else gait_of(start)
    return Columns(parameters, gaits, len(numbers))


def _drives(gaits: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the columns of gaits by the names that conditions have for them; a phase as a place on the circle.

    Args:
        gaits: Shape (..., joints, 4).
    """
    rows = gaits.copy()
    phase = COLUMNS.index("phase")
    rows[..., phase] = np.pi - np.mod(np.pi - rows[..., phase], 2.0 * np.pi)
    return {
        names.drive(joint + 1, column): rows[..., joint, place]
        for joint in range(rows.shape[-2])
        for place, column in enumerate(COLUMNS)
    }
