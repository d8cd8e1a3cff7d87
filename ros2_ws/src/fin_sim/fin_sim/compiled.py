"""How numerical kernels are compiled: one decorator, one place that says where the machine code is kept."""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

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
    from numba.core.caching import FunctionCache
    from numba.core.dispatcher import Dispatcher


@cache
def _digest(source: str) -> str:
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()


def _compiled_in(function: FunctionType) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
    """Return what the machine code of a kernel is made from, itself and whatever it calls included.

    These are the digests of the kernels' sources and of this file, whose options they are compiled with, and the
    numbers and words that they name, which are compiled in as they are when a kernel is first called.
    """
    sources, numbers = {_digest(__file__)}, set()
    waiting, seen = [function], {function}
    while waiting:
        each = waiting.pop()
        sources.add(_digest(each.__code__.co_filename))
        for name in each.__code__.co_names:
            value = each.__globals__.get(name)
            if isinstance(value, Dispatcher) and value.py_func not in seen:
                seen.add(value.py_func)
                waiting.append(value.py_func)
            elif isinstance(value, int | float | str | tuple):
                numbers.add((name, repr(value)))
    return tuple(sorted(sources)), tuple(sorted(numbers))


class _KernelCache(FunctionCache):
    """Machine code on the disk, used only as long as nothing that is compiled into it has changed.

    numba itself looks at the source of the one function, not at what that calls or names from other files.
    """

    def _index_key(self, sig: object, codegen: object) -> tuple[Any, ...]:
        key = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, _compiled_in(self._py_func))


def kernel(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays; the machine code is cached, the interpreter lock released."""
    code = cast("FunctionType", function).__code__
    # numba keeps machine code by the path of its source: of a workspace of links each path would be compiled by itself.
    cast("FunctionType", function).__code__ = code.replace(co_filename=os.path.realpath(code.co_filename))
    compiled = numba.njit(nogil=True, error_model="numpy", fastmath=_FAST_MATH)(function)
    if "NUMBA_CACHE_DIR" in os.environ and isinstance(compiled, Dispatcher):  # none where numba is told not to compile
        cached = _KernelCache(compiled.py_func)  # type: ignore[no-untyped-call]
        cast("Any", compiled)._cache = cached  # noqa: SLF001  (what its enable_caching does)
    return cast("FunctionT", compiled)
