"""Waiting for what can be waited for, instead of sleeping."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_POLL_SECONDS = 0.02
PATIENCE = 60.0
"""s that every wait gets at least: what is waited for is to come, and how soon it does says how busy the machine is."""


def wait_until(
    condition: Callable[[], object],
    timeout: float,
    why: str | Callable[[], str],
    meanwhile: Callable[[], object] = lambda: time.sleep(_POLL_SECONDS),
) -> None:
    """Return as soon as the condition is true.

    Args:
        condition: Asked again and again.
        timeout: In s; `PATIENCE` if that is longer, so it proves nothing about how soon.
        why: What was waited for, told when it does not come.
        meanwhile: What to do between two looks; an executor's ``spin_once``, for example.

    Raises:
        AssertionError: It did not become true in time.
    """
    timeout = max(timeout, PATIENCE)
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            message = f"after {timeout} s still waiting for {why() if callable(why) else why}"
            raise AssertionError(message)
        meanwhile()
