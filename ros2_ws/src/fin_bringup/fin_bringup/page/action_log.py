"""What was done from pages, by time and address: a line each, in the study's folder."""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.study.file_names import SETTINGS_FILE

if TYPE_CHECKING:
    from collections.abc import Callable

LOG_FILE = "page.log"
_KEPT = 1000
"""Lines that wait for a study at most."""


def line(when: datetime, address: str, text: str) -> str:
    """Return an entry: ISO time with its offset, address, what happened, with a tab between them."""
    parts = (when.isoformat(timespec="milliseconds"), address, text)
    return "\t".join(" ".join(part.split()) for part in parts) + "\n"


class ActionLog:
    """Writes in a thread of its own: a slow disk holds no emergency stop back.

    Args:
        tell: Called with what goes wrong, in that thread.
    """

    def __init__(self, tell: Callable[[str], object]) -> None:
        self._tell = tell
        self._waiting: deque[str] = deque(maxlen=_KEPT)
        self._folder: Path | None = None
        self._thread = ThreadPoolExecutor(1, "page.log")

    def study_in(self, folder: str) -> None:
        """Write into this folder from now on, and there what waits, if a study of this computer is in it."""
        self._thread.submit(self._take_folder, folder)

    def note(self, address: str, text: str, when: datetime | None = None) -> None:
        """Note what somebody at this address did, or what came of it."""
        self._thread.submit(self._write, line(when or datetime.now().astimezone(), address, text))

    def close(self) -> None:
        """Write what was noted."""
        self._thread.shutdown()

    def _take_folder(self, folder: str) -> None:
        path = Path(folder)
        if folder and path.is_absolute() and (path / SETTINGS_FILE).is_file():
            self._folder = path
            waiting = "".join(self._waiting)
            self._waiting.clear()
            if waiting:
                self._write(waiting)

    def _write(self, lines: str) -> None:
        if self._folder is None:
            self._waiting.append(lines)
            return
        path = self._folder / LOG_FILE
        try:
            # Never through a link: what else is written there is nobody's business here.
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            with os.fdopen(os.open(path, flags, 0o644), "a", encoding="utf-8") as file:
                file.write(lines)
        except OSError as error:
            self._tell(f"{path} cannot be written: {error.strerror or error}")
