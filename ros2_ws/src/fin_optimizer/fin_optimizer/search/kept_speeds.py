"""Simulated speeds that are kept by all that they follow from: thousands of fish swim once, not once a study."""

from __future__ import annotations

import hashlib
import os
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fin_optimizer
import fin_sim

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def content_key(*decides: object) -> str:
    """Return a name for what follows from these: arrays, and what its ``repr`` tells whole."""
    digest = hashlib.sha256(_simulator())
    for each in decides:
        digest.update(each.tobytes() if isinstance(each, np.ndarray) else repr(each).encode())
    return digest.hexdigest()[:32]


@cache
def _simulator() -> bytes:
    """Return what stands for the simulator and for what draws the fish: other code, other speeds."""
    simulator, drawn = Path(fin_sim.__path__[0]), Path(fin_optimizer.__path__[0]) / "search" / "plausible.py"
    sources = [*simulator.rglob("*.py"), *simulator.rglob("*.yaml"), drawn]
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(path.read_bytes())
    return digest.digest()


def kept(path: Path, shape: tuple[int, ...]) -> Array | None:
    """Return the speeds of a file, m/s; None where there is none, or none of this shape: it can be made again."""
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return found if isinstance(found, np.ndarray) and found.shape == shape and found.dtype == np.float64 else None


def keep(path: Path, speeds: Array) -> None:
    """Write speeds into a file, whole or not at all; a disk that refuses is no loss."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".npy.partial")
        with os.fdopen(handle, "wb") as file:
            np.save(file, speeds)
        Path(name).replace(path)
    except OSError:
        return
