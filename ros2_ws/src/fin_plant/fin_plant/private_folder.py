"""A folder of this user alone, for what can be made again: compiled code, lists of fonts."""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import tempfile
from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def private_folder(name: str) -> Path:
    """Return a folder that nobody else can write to, so that what is loaded from it is what was put there.

    It lies in the user's cache and lasts. Where that cannot be (read-only, no home, or a folder that another user
    could have filled), it is a fresh one in the temporary folder, removed when the process ends.

    Raises:
        OSError: Neither can be made.
    """
    cache = _cache()
    if cache is not None:
        folder = cache / f"{name}-{os.getuid()}"
        try:
            cache.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            if is_private(folder):
                with tempfile.TemporaryFile(dir=folder):
                    return folder
        except OSError:
            pass
    folder = Path(tempfile.mkdtemp(prefix=f"{name}-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def is_private(folder: Path) -> bool:
    """Return whether the folder, no link, is this user's and nobody else can write to it or put another in its place.

    Of the folders above it, each must belong to this user or to root, and only one in which nobody can rename what is
    another's (the sticky bit, as on /tmp) may be open to all. A group of the user's own may write above, as where
    every user has one.
    """
    own = folder.lstat()
    if not stat.S_ISDIR(own.st_mode) or own.st_uid != os.getuid() or own.st_mode & _OTHERS_WRITE:
        return False
    parent = folder.parent.resolve()
    for above in (place.stat() for place in (parent, *parent.parents)):
        if above.st_mode & stat.S_ISVTX:
            continue
        open_to = above.st_mode & (_OTHERS_WRITE if above.st_gid != os.getgid() else stat.S_IWOTH)
        if open_to or above.st_uid not in {0, os.getuid()}:
            return False
    return True


def _cache() -> Path | None:
    """Return the user's folder for caches; None where there is no home."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if given.is_absolute():  # a relative one is to be ignored (XDG Base Directory Specification)
        return given
    try:
        return Path("~/.cache").expanduser()
    except RuntimeError:
        return None
