"""Optuna's storage on a study's journal with its check sums, see `fin_optimizer.study.journal`."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from optuna.storages import JournalStorage
from optuna.storages.journal import BaseJournalBackend, JournalFileOpenLock

from fin_optimizer.study.journal import RESTORE, StudyError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fin_optimizer.study.journal import JournalLines

WRONG_CONTENT = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""What Optuna, which expects its own lines, raises where a line without a check sum was changed."""


class CheckedJournal(BaseJournalBackend):
    """What Optuna reads and appends; every line is checked on its way in and gets its check sum on its way out."""

    def __init__(self, lines: JournalLines) -> None:
        """Use the lines of a journal, of which nothing was read yet."""
        self._lines = lines
        self._lock = JournalFileOpenLock(str(lines.journal))
        self._unread: deque[dict[str, Any]] = deque()

    def read_logs(self, log_number_from: int) -> Iterator[dict[str, Any]]:  # noqa: ARG002  (Optuna reads on, always)
        """Yield the operations that Optuna has not had yet.

        Raises:
            StudyError: See `JournalLines.read`.
        """
        self._unread.extend(self._lines.read())
        while self._unread:
            yield self._unread.popleft()

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Append operations, unless another program has changed the study meanwhile.

        Raises:
            StudyError: It has, see `JournalLines.read`.
            OSError: The disk refuses.
        """
        self._lock.acquire()
        try:
            self._unread.extend(self._lines.read())
            self._lines.append(logs)
        finally:
            self._lock.release()


def storage_of(lines: JournalLines, kind: type[CheckedJournal] = CheckedJournal) -> JournalStorage:
    """Return Optuna's storage with all that the journal holds; nothing is changed.

    Args:
        lines: Of the journal, of which nothing was read yet.
        kind: What Optuna reads and appends through.

    Raises:
        StudyError: The journal cannot be read.
    """
    try:
        return JournalStorage(kind(lines))
    except StudyError:
        raise
    except WRONG_CONTENT as error:
        msg = f"{lines.journal} is damaged ({type(error).__name__}: {error}): {RESTORE}"
        raise StudyError(msg) from error
