"""A space's parameters as Optuna has them, in its ledger and for its samplers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from fin_optimizer.search.space import Choice

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

    from fin_optimizer.search.space import AnyDimension, Space


def distribution(dimension: AnyDimension) -> BaseDistribution:
    """Return what Optuna calls the range of a parameter, or its choices."""
    if isinstance(dimension, Choice):
        return CategoricalDistribution(dimension.choices)
    if dimension.whole:
        return IntDistribution(round(dimension.minimum), round(dimension.last), dimension.log, round(dimension.step))
    return FloatDistribution(dimension.minimum, dimension.last, log=dimension.log, step=dimension.step or None)


def distributions(space: Space) -> dict[str, BaseDistribution]:
    """Return those of all parameters, by name."""
    return {dimension.name: distribution(dimension) for dimension in space.dimensions}
