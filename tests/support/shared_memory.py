"""Shared memory that a killed process leaves behind: Fast DDS keeps its segments in /dev/shm."""

from __future__ import annotations

import os
import time
from pathlib import Path

_FOLDER = Path("/dev/shm")  # noqa: S108 - where Linux keeps shared memory, not a temporary folder of ours
# A segment may exist for a moment before its maker has mapped it.
_SETTLED_SECONDS = 5.0


def _in_use() -> set[str]:
    """Return the paths below /dev/shm that a process maps or holds open."""
    found: set[str] = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            lines = (process / "maps").read_text().splitlines()
            found.update(line.split(maxsplit=5)[5] for line in lines if str(_FOLDER) in line)
            found.update(str(handle.readlink()) for handle in (process / "fd").iterdir())
        except OSError:  # it has ended, or is another user's, whose segments are not ours to remove
            continue
    return {path.removesuffix(" (deleted)") for path in found}


def remove_stale_segments() -> list[str]:
    """Remove this user's Fast DDS segments that no process uses any more; return their names."""
    own = [
        path for pattern in ("fastrtps_*", "sem.fastrtps_*") for path in _FOLDER.glob(pattern) if _is_old_and_own(path)
    ]
    in_use = _in_use() if own else set()
    stale = [path for path in own if str(path) not in in_use]
    for path in stale:
        path.unlink(missing_ok=True)
    return sorted(path.name for path in stale)


def _is_old_and_own(path: Path) -> bool:
    try:
        status = path.stat()
    except FileNotFoundError:
        return False
    return status.st_uid == os.getuid() and time.time() - status.st_mtime > _SETTLED_SECONDS
