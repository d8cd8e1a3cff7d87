"""What unit tests and graph tests share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.disk import Disk

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """A disk of 256 kB; the test is skipped where it cannot be mounted."""
    path = tmp_path / "disk"
    path.mkdir()
    disk = Disk(path)
    yield disk
    disk.unmount()
