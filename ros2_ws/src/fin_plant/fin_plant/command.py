"""How a command ends: what goes wrong is one line in argparse's own form, ``NAME: error: TEXT``, and an exit code."""

from __future__ import annotations

import functools
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from fin_plant.output import end_when_output_closes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

EXIT_OK = 0
EXIT_FAILURE = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 128 + signal.SIGINT


class Main(Protocol):
    """A command's main function: of its arguments, those of its process if None, it returns its exit code."""

    def __call__(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command."""


def program() -> str:
    """Return the name of this process's program, as argparse would: for what is not told the name of a command."""
    return Path(sys.argv[0]).name


def error_line(name: str, what: object) -> str:
    """Return the line that says what went wrong, as argparse writes its own; of a file that fails, its name first."""
    if isinstance(what, OSError) and what.filename is not None and what.strerror:
        what = f"{what.filename}: {what.strerror}"
    return f"{name}: error: {what}"


def tell_error(name: str, what: object) -> None:
    """Write that line to the standard error."""
    sys.stderr.write(error_line(name, what) + "\n")


def _drop_output() -> None:
    """Have the interpreter's end not try again to write what could not be written."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115


def command(
    name: str,
    *,
    failures: tuple[type[Exception], ...] = (),
    when_output_closes: Callable[[], None] | None = end_when_output_closes,
) -> Callable[[Main], Main]:
    """Have a command end as all do: 2 for a ValueError or an OSError, input that cannot be used, and 130 for Ctrl-C.

    Args:
        name: Of the command.
        failures: Further errors, of work that did not succeed: 1.
        when_output_closes: In a process of the command's own, where it is called without arguments: what has it end,
            or go on, when its reader has gone; where it is None, the next write ends it with 0.
    """

    def ending(main: Main) -> Main:
        @functools.wraps(main)
        def run(arguments: Sequence[str] | None = None) -> int:
            if arguments is None and when_output_closes is not None:
                when_output_closes()
            try:
                code = main(arguments)
                sys.stdout.flush()  # a disk may be full
            except KeyboardInterrupt:
                return EXIT_INTERRUPTED
            except BrokenPipeError:  # whoever read it has seen enough, as `head` has
                _drop_output()
                return EXIT_OK
            except failures as error:
                tell_error(name, error)
                return EXIT_FAILURE
            except (ValueError, OSError) as error:
                tell_error(name, error)
                try:
                    sys.stdout.flush()
                except OSError:  # its disk is full
                    _drop_output()
                return EXIT_USAGE
            return code

        return run

    return ending
