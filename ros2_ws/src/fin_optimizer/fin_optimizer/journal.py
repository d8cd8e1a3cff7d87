"""A study's journal as a file: what a kill, a full disk or another version did to it, found before it is used.

Each line is one operation of Optuna's journal storage, as JSON, and lines are only appended. Optuna ignores a last line
that was cut short, but would then append to it and make both unreadable; here it is taken off first.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class StudyError(ValueError):
    """A study that cannot be begun, gone on with or written; the message says what to do."""


OPERATIONS = 10
"""Operations of Optuna 5's journal, numbered from 0; another number was written by something newer."""
# Left by a process that was killed between taking and releasing it; a living one holds it for milliseconds. Only the
# study's one optimiser and, rarely, somebody's dashboard write.
_STALE_LOCK_SECONDS = 1.0
_BLOCK = 64 * 1024


def check_lines(journal: Path) -> None:
    """Look at every whole line without changing anything.

    Raises:
        StudyError: A line that is damaged, or that this version does not understand.
    """
    with journal.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                return
            try:
                operation = json.loads(line)["op_code"]
            except (ValueError, KeyError, TypeError) as error:
                msg = f"{journal}: line {number} is damaged ({error}): restore the file from a copy"
                raise StudyError(msg) from error
            if not isinstance(operation, int) or not 0 <= operation < OPERATIONS:
                msg = (
                    f"{journal}: line {number} is operation {operation}, which this version does not know: "
                    "a newer one wrote it, update fin_optimizer and optuna"
                )
                raise StudyError(msg)


def take_off_cut_line(journal: Path) -> int:
    """Take off a last line that was cut short, keep it in ``<journal>.cut``; return its length in bytes, often 0."""
    size = journal.stat().st_size
    with journal.open("rb") as file:
        start, rest = size, b""
        while start and b"\n" not in rest:
            start = max(0, start - _BLOCK)
            file.seek(start)
            rest = file.read(size - start)
    cut = rest[rest.rfind(b"\n") + 1 :]
    if not cut:
        return 0
    try:
        with journal.with_name(journal.name + ".cut").open("ab") as kept:
            kept.write(cut + b"\n")
    except OSError:  # a full disk keeps no copy of what was never an entry
        pass
    os.truncate(journal, size - len(cut))
    return len(cut)


def remove_stale_lock(journal: Path) -> None:
    """Remove the lock that a killed process left behind, so that nobody waits half a minute for it."""
    lock = journal.with_name(journal.name + ".lock")
    if not os.path.lexists(lock):
        return
    age = time.time() - lock.lstat().st_mtime
    if 0.0 <= age < _STALE_LOCK_SECONDS:
        time.sleep(_STALE_LOCK_SECONDS - age)
    lock.unlink(missing_ok=True)


@contextmanager
def whole_entries(journal: Path) -> Iterator[None]:
    """Append inside this: if the disk refuses, no part of an entry stays behind.

    Raises:
        StudyError: The disk refused. The journal is as it was before.
    """
    try:
        yield
    except OSError as error:
        if journal.exists():
            take_off_cut_line(journal)
        msg = (
            f"cannot write {journal}: {error.strerror or error}; every entry before is safe. "
            "Put the disk right, then go on with the study"
        )
        raise StudyError(msg) from error
