"""Machine code that is kept: never older than anything that was compiled into it."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

SOURCES = {
    "numbers_of_it.py": "FACTOR = 2.0\n",
    "inner.py": (
        "from fin_sim.compiled import kernel\nfrom numbers_of_it import FACTOR\n\n\n"
        "@kernel\ndef inner(x):\n    return FACTOR * x\n"
    ),
    "outer.py": (
        "from fin_sim.compiled import kernel\nfrom inner import inner\n\n\n"
        "@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
    ),
}
CALL = "from outer import outer; print(outer(10.0), sum(outer.stats.cache_hits.values()))"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a kernel that calls one of another file, which names a number of a third, called once."""
    for name, source in SOURCES.items():
        (tmp_path / name).write_text(source)
    assert _called(tmp_path) == "21.0 0"
    return tmp_path


def _called(folder: Path) -> str:
    """Call the outer kernel in a process of its own; return its result, and how often kept machine code was used."""
    result = subprocess.run(
        [sys.executable, "-B", "-c", CALL],
        cwd=folder,
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout.strip()


def test_machine_code_is_kept_from_one_process_to_the_next(folder: Path) -> None:
    assert _called(folder) == "21.0 1"


@pytest.mark.parametrize(
    ("name", "before", "after", "result"),
    [
        ("inner.py", "FACTOR * x", "FACTOR * x + 5.0", "26.0 0"),
        ("numbers_of_it.py", "2.0", "3.0", "31.0 0"),
        ("outer.py", "+ 1.0", "+ 2.0", "22.0 0"),
    ],
)
def test_what_a_kernel_calls_or_names_in_another_file_is_compiled_anew_when_it_changes(
    folder: Path, name: str, before: str, after: str, result: str
) -> None:
    (folder / name).write_text(SOURCES[name].replace(before, after))
    assert _called(folder) == result
