"""One way to read a file of text that people write, and to have what is refused in it name the file."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


LARGEST = 100_000_000
"""Bytes. A swim of an hour at 500 Hz is as large."""


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file, at most `LARGEST`.

    Raises:
        ValueError: It is larger, or has no end, as a device.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        msg = f"it holds more than {LARGEST / 1e6:g} MB, which no text of a laboratory does: is it another file?"
        raise ValueError(msg)
    return data


def read(path: Path) -> str:
    """Return what a file in UTF-8 holds, a byte order mark left out.

    Raises:
        ValueError: It is no text in UTF-8, with its line in the message, or too large.
        OSError: It cannot be read.
    """
    data = read_bytes(path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        msg = f"line {line}: it is no text in UTF-8: save it as UTF-8"
        raise ValueError(msg) from None


@contextmanager
def named(path: Path, kind: str = "") -> Iterator[None]:
    """Have every error of the block name the file.

    Args:
        path: Of the file.
        kind: Of the file, a word to put before its path.

    Raises:
        ValueError: The file cannot be read, or something in it is refused.
    """
    file = f"{kind} {path}".lstrip()
    try:
        yield
    except OSError as error:
        msg = f"{file} cannot be read: {error.strerror or error}"
        raise ValueError(msg) from error
    except ValueError as error:
        msg = f"{file}: {error}"
        raise ValueError(msg) from error
