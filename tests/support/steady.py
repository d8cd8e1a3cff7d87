"""What a driver did while the machine let it: a tail that was put aside catches up within its joints' rates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_LATE = 1.2
"""Periods since the last tick."""
_CATCHING_UP = 10
"""Ticks after a late one in which a tail may still be on its way to where the gait is."""


def on_time(stamps: Sequence[int] | NDArray[np.int64], rate: float) -> NDArray[np.bool_]:
    """Return which samples came on time, and so did those before it.

    Args:
        stamps: Of successive samples in ns, shape (n,).
        rate: Samples a second.

    Returns:
        Shape (n,).
    """
    gaps = np.diff(np.asarray(stamps, dtype=np.int64), prepend=0)
    late = np.flatnonzero(gaps > int(_LATE * 1e9 / rate))
    since = np.arange(gaps.size) - late[np.searchsorted(late, np.arange(gaps.size), side="right") - 1]
    return since >= _CATCHING_UP
