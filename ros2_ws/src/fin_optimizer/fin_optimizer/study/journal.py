"""A study's journal as a file: what a kill, a full disk, another program or version did to it, found before it is used.

Each line is one operation of Optuna's journal storage, as JSON, and lines are only appended. Optuna ignores a last line
that was cut short, but would then append to it and make both unreadable; here it is taken off first.

Each line ends with a check sum of itself and of all lines before it, under a name that Optuna does not read. The first
one counts from the study's settings file on. So a line that was changed, taken away, doubled or moved is noticed, and
so is the journal of another study. Lines that are missing at the end are noticed by ``journal.end``, which holds how
many there were; it is written after the line is on the disk, so it never tells of a line that a power cut took away.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from fin_optimizer.checksums import CHECK_SUM, SUM_LENGTH, check_sum

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    Operation = dict[str, Any]


class StudyError(ValueError):
    """A study that cannot be begun, gone on with or written; the message says what to do."""


STUDY_NAME = "study"
"""Of the one study in a journal."""
END_FILE = "journal.end"
RESTORE = "restore it from a copy, or let recover_study keep what is whole of it and take the rest from the bags"
"""What to do with a journal that cannot be used."""
# Left by a process that was killed between taking and releasing it; a living one holds it for milliseconds. Only the
# study's one optimiser and, rarely, somebody's dashboard write.
_STALE_LOCK_SECONDS = 1.0
_BLOCK = 64 * 1024

_SUM_HEAD, _SUM_TAIL = f',"{CHECK_SUM}":"'.encode(), b'"}\n'
_SUFFIX = len(_SUM_HEAD) + SUM_LENGTH + len(_SUM_TAIL)

# Optuna's operations (optuna.storages.journal, JournalOperation), each with the entries that Optuna 5 gives it.
_CREATE_STUDY, _STUDY_SYSTEM_ATTRIBUTE, _CREATE_TRIAL, _TRIAL_SYSTEM_ATTRIBUTE = 0, 3, 4, 9
_NUMBER, _TEXT = (int, float), (str,)
_OPTIONAL_TEXT = (str, type(None))
_ENTRIES: dict[int, dict[str, tuple[type, ...]]] = {
    _CREATE_STUDY: {"study_name": _TEXT, "directions": (list,)},
    2: {"study_id": (int,), "user_attr": (dict,)},
    _STUDY_SYSTEM_ATTRIBUTE: {"study_id": (int,), "system_attr": (dict,)},
    _CREATE_TRIAL: {
        "study_id": (int,),
        "datetime_start": _OPTIONAL_TEXT,
        "state": (int,),
        "value": (*_NUMBER, type(None)),
        "values": (list, type(None)),
        "distributions": (dict,),
        "params": (dict,),
        "user_attrs": (dict,),
        "system_attrs": (dict,),
        "intermediate_values": (dict,),
    },
    6: {"trial_id": (int,), "state": (int,), "values": (list, type(None))},
    8: {"trial_id": (int,), "user_attr": (dict,)},
    _TRIAL_SYSTEM_ATTRIBUTE: {"trial_id": (int,), "system_attr": (dict,)},
}
_TIMES: Mapping[str, tuple[type, ...]] = {"datetime_start": _OPTIONAL_TEXT, "datetime_complete": _OPTIONAL_TEXT}
_MAY_HAVE = {_CREATE_TRIAL: _TIMES, 6: _TIMES}
_IN_ALL: Mapping[str, tuple[type, ...]] = {"op_code": (int,), "worker_id": _TEXT}
_NOT_OURS = {
    1: "deletes the study",
    5: "sets a parameter of a trial",
    7: "reports an intermediate value",
}
"""Operations that only another program writes, and what each does."""
_REMARKS = {_STUDY_SYSTEM_ATTRIBUTE, _TRIAL_SYSTEM_ATTRIBUTE}
"""Operations by which Optuna's dashboard keeps a person's notes: they change neither a trial nor its score."""


class JournalLines:
    """The whole lines of a journal, each read once, checked, and continued.

    Args:
        journal: Its file, which need not be there yet.
        origin: Check sum of the study's settings, from which the lines' check sums count.

    Attributes:
        journal: As given.
        count: Lines read so far.
        without_sums: Of these, those at the beginning that an older version wrote without check sums.
        notes: What `check_end` found, for the user.
        remarks: Numbers of the lines that another program added without changing any trial.
    """

    def __init__(self, journal: Path, origin: str) -> None:
        self.journal = journal
        self.count = 0
        self.without_sums = 0
        self.notes: list[str] = []
        self.remarks: list[int] = []
        self._origin = origin
        self._sum = origin
        self._offset = 0
        self._trials = 0
        self._end = _read_end(journal, origin)  # before the lines: another process may be appending

    def read(self) -> list[Operation]:
        """Return the operations of the whole lines that are new since the last time.

        Raises:
            StudyError: A line that is damaged, that this version does not understand, or that changes the study and is
                not this program's. Those before it count as read.
        """
        operations: list[Operation] = []
        if not self.journal.exists() and not self._offset:
            return operations
        with self.journal.open("rb") as file:
            if os.fstat(file.fileno()).st_size < self._offset:
                msg = f"{self.journal} became shorter while it was in use: restore it from a copy"
                raise StudyError(msg)
            file.seek(self._offset)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                operations.append(self._take_in(line))
        return operations

    def append(self, operations: Sequence[Operation]) -> None:
        """Append operations behind what was read, with their check sums, and put them on the disk.

        Raises:
            OSError: The disk refuses.
        """
        total, lines = self._sum, b""
        for operation in operations:
            body = json.dumps(operation, separators=(",", ":")).encode()[:-1]
            total = check_sum(total.encode(), body)
            lines += body + _SUM_HEAD + total.encode() + _SUM_TAIL
        with self.journal.open("ab") as file:
            file.write(lines)
            file.flush()
            os.fsync(file.fileno())
        with suppress(OSError):  # one that lags behind misses nothing that is there
            write_end(self.journal, self._origin, self.count + len(operations))

    def check_end(self) -> None:
        """Look at what was read first as a whole, and note what a user should know of.

        Raises:
            StudyError: Lines are missing at the end.
        """
        has_sums = self.count > self.without_sums
        missing = 0 if self._end is None else self._end - self.count
        if missing > 1:
            holds = f"holds {self.count}" if self.journal.exists() else "is not there"
            msg = (
                f"{self.journal} {holds} and had {self._end} entries: the last {missing} are missing. "
                f"{RESTORE.capitalize()}"
            )
            raise StudyError(msg)
        if missing == 1 and not self.cut():
            self.notes.append("the journal's last entry is missing")
        if has_sums and self._end is None:
            self.notes.append(f"{END_FILE} is missing or damaged: it cannot be told whether the last entries are there")
        if self.without_sums:
            which = f"the first {self.without_sums} of {self.count} entries" if has_sums else "its entries"
            self.notes.append(
                f"{self.journal.name} was begun by an older version: {which} carry no check sums, so a change in them "
                "cannot be noticed"
            )
        if self.remarks:
            lines = ", ".join(map(str, self.remarks))
            self.notes.append(f"{self.journal.name} line {lines}: a remark of another program, which changes no trial")

    @property
    def whole_bytes(self) -> int:
        """Length in bytes of the lines read so far."""
        return self._offset

    def cut(self) -> int:
        """Return the length in bytes of a last line that was cut short, often 0."""
        return self.journal.stat().st_size - self._offset if self.journal.exists() else 0

    def _take_in(self, line: bytes) -> Operation:
        number = self.count + 1
        where = f"{self.journal}: line {number}"
        try:
            operation = json.loads(line)
        except (ValueError, RecursionError) as error:
            msg = f"{where} is damaged ({error}): {RESTORE}"
            raise StudyError(msg) from error
        summed = line[-_SUFFIX:].startswith(_SUM_HEAD)
        total = check_sum(self._sum.encode(), line[:-_SUFFIX] if summed else line)
        if summed and line != line[:-_SUFFIX] + _SUM_HEAD + total.encode() + _SUM_TAIL:
            raise StudyError(self._mismatch(number))
        self._check_operation(where, operation, summed=summed)
        if not summed:
            self._take_in_without_sum(number, operation)
        self._sum = total
        self._offset += len(line)
        self.count = number
        self._trials += operation["op_code"] == _CREATE_TRIAL
        return operation  # type: ignore[no-any-return]  # checked to be a dict

    def _mismatch(self, number: int) -> str:
        if number == self.without_sums + 1:
            lines = f"lines 1 to {number}" if number > 1 else "line 1"
            return (
                f"{self.journal}: the check sum of line {number} does not fit {lines} and the study's settings: one of "
                "them was changed, or it is the journal of another study. Put back the files that belong together, "
                "or let recover_study make the journal anew from the bags"
            )
        return (
            f"{self.journal}: line {number} is damaged: its check sum does not fit it and the lines before it. It was "
            f"changed, or a line was taken away, doubled or moved: {RESTORE}"
        )

    def _check_operation(self, where: str, operation: object, *, summed: bool) -> None:
        """Look at what a line says; one whose check sum fits may say more than is known here.

        Raises:
            StudyError: It cannot be what this program wrote.
        """
        if not isinstance(operation, dict) or type(operation.get("op_code")) is not int:
            msg = f"{where} is damaged (it is no operation of a journal): {RESTORE}"
            raise StudyError(msg)
        code = operation["op_code"]
        if code in _NOT_OURS:
            raise StudyError(self._foreign(where, _NOT_OURS[code]))
        if code not in _ENTRIES:
            msg = (
                f"{where} is operation {code}, which this version does not know: a newer one wrote it, update "
                "fin_optimizer and optuna, or it is damaged"
            )
            raise StudyError(msg)
        if not summed:
            self._check_entries(where, operation)
        self._check_target(where, operation)

    @staticmethod
    def _check_entries(where: str, operation: Operation) -> None:
        code = operation["op_code"]
        needed = {**_IN_ALL, **_ENTRIES[code]}
        known = {**needed, **_MAY_HAVE.get(code, {}), CHECK_SUM: _TEXT}
        wrong = [name for name in needed if name not in operation]
        wrong += [n for n, value in operation.items() if n not in known or type(value) not in known[n]]
        if wrong:
            msg = (
                f"{where} is damaged, or another version of Optuna wrote it: {', '.join(map(repr, wrong))} is missing, "
                "unknown or of another kind. Restore the file from a copy, or use the version that wrote it"
            )
            raise StudyError(msg)

    def _check_target(self, where: str, operation: Operation) -> None:
        """Look at what an operation is about: this journal's one study, or a trial that was created before.

        Raises:
            StudyError: It is something else.
        """
        begins = operation["op_code"] == _CREATE_STUDY
        if begins and (self.count or operation.get("study_name") != STUDY_NAME):
            raise StudyError(self._foreign(where, f"begins another study, {operation.get('study_name')!r}"))
        if not self.count and not begins:
            msg = f"{where} does not begin the study: the lines before it are missing, {RESTORE}"
            raise StudyError(msg)
        if operation.get("study_id", 0) != 0 or not 0 <= operation.get("trial_id", 0) < max(1, self._trials):
            msg = f"{where} is about a study or a trial that was never begun: it is damaged, {RESTORE}"
            raise StudyError(msg)

    def _foreign(self, where: str, what: str) -> str:
        return f"{where} {what}, which this program never does: another one changed the journal; {RESTORE}"

    def _take_in_without_sum(self, number: int, operation: Operation) -> None:
        """Note a line without a check sum.

        Raises:
            StudyError: Lines before it have one, and it is more than a remark.
        """
        if number == self.without_sums + 1:
            self.without_sums = number
        elif operation["op_code"] in _REMARKS:
            self.remarks.append(number)
        else:
            what = "has no check sum and changes the study"
            raise StudyError(self._foreign(f"{self.journal}: line {number}", what))


def _end_text(origin: str, count: int) -> str:
    said = f"{count:012d}"
    return f"{said} {check_sum(origin.encode(), said.encode())}\n"


def write_end(journal: Path, origin: str, count: int) -> None:
    """Write down how many lines a journal has, beside it.

    Raises:
        OSError: The disk refuses.
    """
    descriptor = os.open(journal.with_name(END_FILE), os.O_WRONLY | os.O_CREAT, 0o666)
    try:
        os.pwrite(descriptor, _end_text(origin, count).encode(), 0)
    finally:
        os.close(descriptor)


def _read_end(journal: Path, origin: str) -> int | None:
    """Return how many lines the journal had when it was last written; None if that is not known."""
    try:
        text = journal.with_name(END_FILE).read_text(encoding="ascii")
        count = int(text.partition(" ")[0])
    except (OSError, ValueError):
        return None
    return count if text == _end_text(origin, count) else None


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
