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


def line_weights(samples: int) -> NDArray[np.float64]:
    """Return the weights of evenly spaced samples in the integral of the line through them, in intervals.

    Shape (samples,). Over whole periods both ends err alike, so that of a smooth swim next to nothing is left.
    """
    weights = np.ones(samples)
    weights[[0, -1]] = 0.5
    return weights


def whole_beats(duration: float, settle: float, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the whole beats begin that end with a window, as many as it has, s, shape (n,).

    A window without a whole beat begins at ``settle``. A mean over whole beats does not depend on where in its beat a
    fish is.

    Args:
        duration: When the window ends, s.
        settle: When it begins, s.
        frequency: Of the beats, Hz, shape (n,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        beats = np.floor((duration - settle) * frequency + 1e-9)
        return np.where(beats >= 1.0, np.maximum(duration - beats / frequency, settle), settle)


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
