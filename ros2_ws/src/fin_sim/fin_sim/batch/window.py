"""The mean over the end of a swim, from samples that need not lie where the window begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_CUBIC = [
    np.polynomial.Polynomial.fromroots(others).integ() / np.prod([node - other for other in others])
    for node in range(4)
    for others in ([other for other in range(4) if other != node],)
]
"""Antiderivatives of the cubics that are 1 at one of four points 0, 1, 2, 3 and 0 at the others."""


def window_weights(samples: int, begin: float) -> NDArray[np.float64]:
    """Return the weights of the mean over a window that ends at the last of evenly spaced samples, shape (samples,).

    They integrate the cubic through the four samples around each interval, so that the window may begin between two.

    Args:
        samples: Number of samples, 4 at least.
        begin: Where the window begins, in intervals after sample 0.
    """
    weights = np.zeros(samples)
    cells = np.arange(int(begin), samples - 1)
    first = np.clip(cells - 1, 0, samples - len(_CUBIC))
    for node, antiderivative in enumerate(_CUBIC):
        integral = antiderivative(cells + 1 - first) - antiderivative(np.maximum(cells, begin) - first)
        np.add.at(weights, first + node, integral)
    return weights / (samples - 1 - begin)
