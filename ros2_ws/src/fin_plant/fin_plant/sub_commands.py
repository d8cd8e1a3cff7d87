"""The commands of a `pip install`, ``fin-sim`` and the like: each executable of a package is a sub-command of one.

A wheel's commands go where everybody's do, so ``report`` or ``export`` would be no good names there.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING

from fin_plant.command import EXIT_USAGE, tell_error

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "fin_executables"
"""Of the entry points in a package's setup.py: the one table of its executables, however it is installed."""


def executables(package: str) -> dict[str, EntryPoint]:
    """Return a package's executables by name, in the order of the alphabet; none of a package that is not installed."""
    try:
        found = distribution(package).entry_points.select(group=GROUP)
    except PackageNotFoundError:
        return {}
    return {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}


def start_words(package: str, name: str) -> list[str]:
    """Return the words that start an executable of an installed wheel, with what every executable begins by."""
    return [sys.executable, "-P", "-m", "fin_plant.start", f"{package}/{name}"]


def main() -> None:
    """Start the sub-command that is named, in this process's place, or list what there is.

    Raises:
        SystemExit: No sub-command, help, or an unknown one.
    """
    command = Path(sys.argv[0]).name
    package = command.replace("-", "_")
    there = executables(package)
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name in there:
        # Held back until the executable listens, which ends without a traceback then.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        words = start_words(package, name)
        os.execv(words[0], [*words, *sys.argv[2:]])  # noqa: S606  (no shell)
    from fin_plant.executables import lines  # noqa: PLC0415  (not on the way to an executable)

    usage = f"usage: {command} SUB-COMMAND [ARGUMENTS]\nthere is:\n{lines(command, there.values())}"
    if name in {"-h", "--help"}:
        print(usage)  # noqa: T201
        raise SystemExit(0)
    tell_error(command, f"there is no sub-command '{name}'\n{usage}")
    raise SystemExit(EXIT_USAGE)
