"""What a command does when the program that reads its output has seen enough, as ``head`` has."""

from __future__ import annotations

import signal


def end_with_the_reader() -> None:
    """Let this process end at the next write after its reader has gone, as other commands do, without a traceback.

    For a command's own process only: whoever calls its ``main`` with arguments keeps its own handling.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
