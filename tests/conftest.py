"""What unit tests and graph tests share."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from support.disk import Disk

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# An example proves what it proves however long it takes: a busy machine fails no test.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


_MINUTES = float(os.environ.get("NO_TEST_AFTER_MINUTES", "inf"))
"""Where time is short: tests that would begin later are skipped, those before them count."""
_BEGIN = time.monotonic()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Begin no test when time is up."""
    if time.monotonic() - _BEGIN > 60.0 * _MINUTES:
        pytest.skip(f"not begun within the {_MINUTES:g} minutes of NO_TEST_AFTER_MINUTES")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """A disk of 256 kB; the test is skipped where it cannot be mounted."""
    path = tmp_path / "disk"
    path.mkdir()
    disk = Disk(path)
    yield disk
    disk.unmount()
