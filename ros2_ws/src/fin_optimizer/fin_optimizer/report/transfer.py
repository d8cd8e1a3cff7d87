"""How far simulated speeds carry over to measured ones, as numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.stats

if TYPE_CHECKING:
    from collections.abc import Sequence

FEWEST = 3
"""Pairs below which a rank correlation says nothing."""


@dataclass(frozen=True)
class Transfer:
    """Simulated against measured.

    Attributes:
        count: Fins that are compared.
        rank: Spearman's rank correlation; None of too few, or where all are equal.
        bias: Simulated over measured, the median of the fins with a measured value above 0, less 1; None without any.
        error: Median of their errors, either way, as shares of what was measured.
        error_left: The same after all that is simulated is divided by one factor, for each fin that of the others: how
            much a calibration of the fish's speed as a whole can mend. None of too few, or where a factor is not
            above 0.
    """

    count: int
    rank: float | None
    bias: float | None
    error: float | None
    error_left: float | None

    @property
    def text(self) -> str:
        """What it says, in a sentence."""
        if self.rank is None:
            said = ["There are too few fins that differ for a rank correlation."]
        else:
            said = [f"Spearman's rank correlation over {self.count} fins: {self.rank:.3f}."]
        if self.bias is not None and self.error is not None:
            more = "more" if self.bias >= 0.0 else "less"
            said.append(f"Simulated is {abs(self.bias):.1%} {more} (median); the errors' median is {self.error:.1%}")
            left = self.error_left
            said[-1] += "." if left is None else f", and {left:.1%} once one factor, from the other fins, is taken out."
        return " ".join(said)


def transfer(simulated: Sequence[float], measured: Sequence[float]) -> Transfer:
    """Return how simulated values compare with measured ones of the same fins, in order."""
    differ = len(set(simulated)) > 1 and len(set(measured)) > 1
    rank = float(scipy.stats.spearmanr(simulated, measured).statistic) if len(measured) >= FEWEST and differ else None
    ratios = np.array([s / m for s, m in zip(simulated, measured, strict=True) if m > 0.0])
    if not len(ratios):
        return Transfer(len(measured), rank, None, None, None)
    left = None
    if len(ratios) >= FEWEST:
        others = [float(np.median(np.delete(ratios, place))) for place in range(len(ratios))]
        left = float(np.median(np.abs(ratios / others - 1.0))) if min(others) > 0.0 else None
    bias, error = float(np.median(ratios)) - 1.0, float(np.median(np.abs(ratios - 1.0)))
    return Transfer(len(measured), rank, bias, error, left)
