"""A study's folder: begun whole or not at all, locked by the one process that works on it, and what lies in it.

It holds ``study.json`` (settings, written once), ``journal.log`` with ``journal.end``, ``bags/``, table and pictures.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import uuid
from typing import TYPE_CHECKING, Any, TextIO

from fin_optimizer.checksums import check_sum
from fin_optimizer.study.file_names import BAG_FOLDER, SETTINGS_FILE
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.settings import Settings
from fin_optimizer.words import show_values, trial_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

_PARTIAL = ".partial"

_NO_HARD_LINKS = {errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS}
"""What os.link says on vfat and exFAT, on CIFS, and in user space."""

_LONGEST_NAME = 150
"""Letters of a fin in its bag's name; a file system takes 255 in all."""
_BAG_NAME = re.compile(r"trial_(\d+)_")


def read_settings(folder: Path) -> Settings:
    """Return the settings of the study in a folder; nothing is changed.

    Raises:
        StudyError: There is no study, it was damaged, or this version cannot read it.
    """
    return settings_and_sum(folder)[0]


def settings_and_sum(folder: Path) -> tuple[Settings, str]:
    """Return a study's settings and the check sum of their file; raises as `read_settings`."""
    try:
        text = (folder / SETTINGS_FILE).read_text(encoding="utf-8")
        return Settings.from_json(text), check_sum(text.encode())
    except (FileNotFoundError, NotADirectoryError):
        msg = f"{folder} holds no study: {SETTINGS_FILE} is missing"
        raise StudyError(msg) from None
    except UnicodeDecodeError as error:
        msg = f"{folder / SETTINGS_FILE} is damaged ({error}): restore it from a copy"
        raise StudyError(msg) from error
    except StudyError as error:
        msg = f"{folder / SETTINGS_FILE}: {error}"
        raise StudyError(msg) from error


def begun(folder: Path, settings: Settings) -> TextIO:
    """Make a study's folder, its parents too, and return its settings file, new and locked.

    Raises:
        StudyError: The folder holds something already.
        OSError: The folder cannot be written.
    """
    if (folder / SETTINGS_FILE).exists():
        raise _begun_already(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if any(not entry.match(f"{SETTINGS_FILE}*{_PARTIAL}") for entry in folder.iterdir()):
        if (folder / SETTINGS_FILE).exists():  # by now
            raise _begun_already(folder)
        msg = f"{folder} is neither empty nor a study's folder: choose another one"
        raise StudyError(msg)
    return _written_settings(folder, settings)


def _begun_already(folder: Path) -> StudyError:
    """Return the error of beginning a study where there is one."""
    return StudyError(f"{folder} holds a study already: open it to go on with it, or choose another folder")


def _written_settings(folder: Path, settings: Settings) -> TextIO:
    """Write the settings file, which must be new, and return it, locked: it appears whole and locked, or not at all.

    Raises:
        StudyError: Another process was quicker; its file is as it was.
        OSError: The folder cannot be written.
    """
    final, partial = folder / SETTINGS_FILE, folder / f"{SETTINGS_FILE}.{uuid.uuid4().hex}{_PARTIAL}"
    with contextlib.ExitStack() as on_failure:
        file = on_failure.enter_context(partial.open("x", encoding="utf-8"))
        on_failure.callback(partial.unlink)
        _lock(file, folder)
        _write_through(file, settings.to_json())
        try:
            os.link(partial, final)
        except FileExistsError:
            raise _begun_already(folder) from None
        except OSError as error:
            if error.errno not in _NO_HARD_LINKS:
                raise
            return _written_in_place(final, settings)
        on_failure.pop_all()
    partial.unlink()
    return file


def _written_in_place(final: Path, settings: Settings) -> TextIO:
    """Do the same on a stick or a share without hard links; a kill meanwhile leaves a file that `open` refuses."""
    with contextlib.ExitStack() as on_failure:
        try:
            file = on_failure.enter_context(final.open("x", encoding="utf-8"))
        except FileExistsError:
            raise _begun_already(final.parent) from None
        on_failure.callback(final.unlink)
        _lock(file, final.parent)
        _write_through(file, settings.to_json())
        on_failure.pop_all()
    return file


def _write_through(file: TextIO, text: str) -> None:
    file.write(text)
    file.flush()
    os.fsync(file.fileno())


def locked(folder: Path) -> TextIO:
    """Return the settings file, locked for this process until it is closed or the process ends."""
    file = (folder / SETTINGS_FILE).open(encoding="utf-8")
    try:
        _lock(file, folder)
    except StudyError:
        file.close()
        raise
    return file


def _lock(file: TextIO, folder: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        msg = f"another optimiser is working on {folder}: stop it first, or choose another folder"
        raise StudyError(msg) from None


def put_on_disk(folder: Path) -> None:
    """Bring the names of new files to the disk."""
    for path in (folder, folder.parent):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def bag_name(number: int, values: Mapping[str, Any]) -> str:
    """Return the name of a trial's bag, which tells a person the fin, for example ``trial_0007_E1.112GPa``."""
    fin = re.sub(r"[^\w.+-]", "", show_values(values).replace(", ", "_"))[:_LONGEST_NAME]
    return f"{trial_name(number).replace(' ', '_')}_{fin}"


def bags_in(folder: Path) -> Iterator[tuple[int, str]]:
    """Yield number and name of every bag of a trial in a study's folder."""
    for path in (folder / BAG_FOLDER).glob("trial_*_*"):
        if found := _BAG_NAME.match(path.name):
            yield int(found[1]), path.name
