"""ROS domains for tests: one each, so that graphs which run side by side do not hear each other."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# Domain 0 is everybody's default; above 101 the UDP ports of Fast DDS reach into Linux' ephemeral range.
DOMAINS = range(1, 102)
_TURNS = itertools.count()


@contextmanager
def locked_domain() -> Iterator[int]:
    """Hold a ROS_DOMAIN_ID that no other test on this machine holds; the lock ends with the process at the latest.

    It is another one each time: what the test before has killed may need a moment to be gone.

    Raises:
        RuntimeError: Every domain is held.
    """
    folder = Path(tempfile.gettempdir())
    # Start at a place of this process' own: two test runs then rarely try the same domains.
    first = (os.getpid() + next(_TURNS)) % len(DOMAINS)
    for domain in [*DOMAINS[first:], *DOMAINS[:first]]:
        try:
            handle = os.open(folder / f"ros_domain_{domain}.lock", os.O_CREAT | os.O_RDWR, 0o666)
        except PermissionError:  # another user's
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            continue
        try:
            yield domain
        finally:
            os.close(handle)
        return
    msg = f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are held by other tests ({folder}/ros_domain_*.lock)"
    raise RuntimeError(msg)
