"""Simulated speeds that are kept by all that they follow from: thousands of fish swim once, not once a study."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fin_optimizer
from fin_sim.source_digest import simulator_digest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def content_key(*decides: object) -> str:
    """Return a name for what follows from these: arrays, and what its ``repr`` tells whole."""
    digest = hashlib.sha256(_code().encode())
    for each in decides:
        digest.update(each.tobytes() if isinstance(each, np.ndarray) else repr(each).encode())
    return digest.hexdigest()[:32]


def _code() -> str:
    """Return what stands for the simulator and for what draws the fish: other code, other speeds."""
    drawn = Path(fin_optimizer.__path__[0]) / "search" / "plausible.py"
    return simulator_digest() + hashlib.sha256(drawn.read_bytes()).hexdigest()


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
