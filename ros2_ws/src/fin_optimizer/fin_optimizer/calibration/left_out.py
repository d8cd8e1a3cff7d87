"""How far a fitted fish is right: some of its swims are left out, it is fitted anew, and predicts them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.calibration.errors import errors
from fin_optimizer.calibration.fit import refit
from fin_optimizer.calibration.model import Tank
from fin_optimizer.calibration.prediction import predict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from fin_optimizer.calibration.errors import Errors
    from fin_optimizer.calibration.fit import Fit
    from fin_optimizer.calibration.settings import Settings
    from fin_optimizer.calibration.swims import Swim

SHOWN = (1.0, 2.0)
"""s of each swim that is left out, by which it is predicted."""


def predicted_without(
    swims: Sequence[Swim], keys: Sequence[str], settings: Settings, found: Fit
) -> Iterator[tuple[str, dict[float, list[Errors]]]]:
    """Yield, for each key, the errors of its swims as a fish predicts them that was fitted to all others.

    Args:
        swims: Recorded.
        keys: Of each swim; without those of any one key enough swims are left.
        settings: What is fitted.
        found: The fit to all, from which the others begin.

    Yields:
        The key; and its swims' errors by how much of each was shown, s.

    Raises:
        ValueError: As for `fit`.
    """
    for key in dict.fromkeys(keys):
        group = [swim for swim, own in zip(swims, keys, strict=True) if own == key]
        others = [swim for swim, own in zip(swims, keys, strict=True) if own != key]
        tank = Tank(refit(others, settings, found).model)
        yield key, {shown: [errors(swim, predict(tank, swim, shown), shown) for swim in group] for shown in SHOWN}
