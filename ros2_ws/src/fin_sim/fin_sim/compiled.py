"""How numerical kernels are compiled: one decorator, one place that says where the machine code is kept."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable

FunctionT = TypeVar("FunctionT", bound="Callable[..., object]")
# Reordering and contraction of operations are welcome; NaN and infinity keep their meaning, since a state that is
# not finite must be seen.
_FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def _choose_cache_folder() -> None:
    """Keep compiled code in the user's cache, or in the temporary folder where that cannot be written.

    An installed package may be read-only, and a robot's home folder may be too.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    for base in (home, Path(tempfile.gettempdir())):
        folder = base / f"fin_sim-{os.getuid()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        return


_choose_cache_folder()

import numba  # noqa: E402  (reads NUMBA_CACHE_DIR when it is imported)


def kernel(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays; the machine code is cached, the interpreter lock released."""
    cached = "NUMBA_CACHE_DIR" in os.environ
    compiled = numba.njit(cache=cached, nogil=True, error_model="numpy", fastmath=_FAST_MATH)(function)
    return cast("FunctionT", compiled)
