"""How numerical kernels are compiled: one decorator, one place that says where the machine code is kept."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar, cast

from fin_plant.private_folder import private_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FunctionType

FunctionT = TypeVar("FunctionT", bound="Callable[..., object]")
# Reordering and contraction of operations are welcome; NaN and infinity keep their meaning, since a state that is
# not finite must be seen.
_FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def _choose_cache_folder() -> None:
    """Keep compiled code where nobody else can put any; an installed package may be read-only, or another user's."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        with suppress(OSError):  # then it is compiled each time
            os.environ["NUMBA_CACHE_DIR"] = str(private_folder("fin_sim"))


@contextmanager
def _without_coverage() -> Iterator[None]:
    """Have numba do without coverage.py unless it runs: numba loads it where it is installed, a quarter of its time."""
    if "coverage" in sys.modules:
        yield
        return
    sys.modules["coverage"] = None  # type: ignore[assignment]  # the import system's word for a module that is not there
    try:
        yield
    finally:
        del sys.modules["coverage"]


_choose_cache_folder()
with _without_coverage():
    import numba  # reads NUMBA_CACHE_DIR when it is imported


def kernel(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays; the machine code is cached, the interpreter lock released."""
    cached = "NUMBA_CACHE_DIR" in os.environ
    code = cast("FunctionType", function).__code__
    # numba keeps machine code by the path of its source: of a workspace of links each path would be compiled by itself.
    cast("FunctionType", function).__code__ = code.replace(co_filename=os.path.realpath(code.co_filename))
    compiled = numba.njit(cache=cached, nogil=True, error_model="numpy", fastmath=_FAST_MATH)(function)
    return cast("FunctionT", compiled)
