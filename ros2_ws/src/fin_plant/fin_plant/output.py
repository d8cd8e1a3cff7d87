"""What a process does when its reader has gone, a pipe, a terminal, or a file on a full disk: it ends, or goes on."""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Buffer


def end_when_output_closes() -> None:
    """Let this process end at the next write after its reader has gone, as ``head`` goes, without a traceback.

    For a command's own process only: whoever calls its ``main`` with arguments keeps its own handling.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)


class _Output(io.FileIO):
    """A stream that drops what cannot be written: nobody is there to read it, or no room."""

    def write(self, data: Buffer, /) -> int:
        """Write what can be written; what fails counts as written."""
        size = memoryview(data).nbytes
        try:
            return super().write(data) or size
        except OSError:
            return size


def go_on_when_output_closes() -> None:
    """Let this process go on with its work, whatever becomes of its standard output and standard error.

    For what moves a robot or keeps a study: it must end in its own way, not at a write. Streams that somebody has put
    in the place of the process' own stay as they are.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed from the start
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
        elif stream is getattr(sys, f"__{name}__"):
            setattr(
                sys,
                name,
                io.TextIOWrapper(
                    io.BufferedWriter(_Output(stream.fileno(), "w", closefd=False)),
                    encoding=stream.encoding,
                    errors=stream.errors,
                    line_buffering=True,
                ),
            )
