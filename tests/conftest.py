"""What unit tests and graph tests share."""

from __future__ import annotations

import gc
import os
import signal
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


# Loading three thousand tests makes millions of objects that stay: to look through them again and again for some that
# do not would take a third of the time.
gc.disable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put mutants last: where time is short, what judges the product comes before what judges its tests."""
    items.sort(key=lambda item: item.path.stem.endswith("_mutants"))


def pytest_collection_finish() -> None:
    """Collect garbage again, but never in what was loaded."""
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """End at once: an interpreter's end would look through everything twice."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def signals_are_heard() -> None:
    """Let what the tests start hear every signal: a shell's background and nohup hand on that some are ignored."""
    for number, handler in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGHUP, lambda *_: None),  # ignored still, by who runs the tests alone: a handler is not handed on
        (signal.SIGQUIT, lambda *_: None),
    ):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """A disk of 256 kB; the test is skipped where it cannot be mounted."""
    path = tmp_path / "disk"
    path.mkdir()
    disk = Disk(path)
    yield disk
    disk.unmount()
