"""Free space on a disk, asked before a trial and watched during it."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_MEGABYTE = 1e6


def shortage(path: Path, needed: float) -> str:
    """Return what to tell a person if the disk of ``path`` has less than ``needed`` bytes free, else an empty text.

    Args:
        path: A file or folder, which need not exist yet.
        needed: In bytes; 0 asks for nothing.
    """
    place = path
    while not place.exists() and place != place.parent:
        place = place.parent
    free = shutil.disk_usage(place).free
    if free >= needed:
        return ""
    return (
        f"the disk of {place} has {free / _MEGABYTE:.1f} MB free, needed are {needed / _MEGABYTE:.1f} MB "
        "(parameter disk.minimum_free): make room, then go on"
    )
