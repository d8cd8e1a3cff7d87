"""One way to read a file of text that people write, and to have what is refused in it name the file."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def read(path: Path) -> str:
    """Return what a file in UTF-8 holds, a byte order mark left out.

    Raises:
        ValueError: It is no text in UTF-8; the message names the line.
        OSError: It cannot be read.
    """
    data = path.read_bytes()
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
