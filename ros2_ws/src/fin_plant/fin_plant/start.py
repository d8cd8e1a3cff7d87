"""What starts every executable: from its first moment to its last, Ctrl-C ends it quietly with exit code 130.

The set-up makes this the interpreter of the installed executables, by their first line:

    #!/usr/bin/env -S --block-signal=INT PYTHON -P -m fin_plant.start

The commands of an installed wheel start it too (`fin_plant.sub_commands`).

SIGINT is held back (blocked) until this module listens: Python itself answers one with a traceback while it starts.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import warnings
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from importlib.metadata import EntryPoint
    from types import FrameType, ModuleType

INTERRUPTED = 128 + signal.SIGINT
_AGAIN = 0.01
"""s until an interrupt that a library lost comes again."""
END_BY_SIGNAL_IS_SUCCESS = "FIN_END_BY_SIGNAL_IS_SUCCESS"
"""Environment variable; where it is set a node that was ended by a signal ends with exit code 0, for `ros2 launch`."""
_HELP = frozenset(("-h", "--help"))


def _end(_number: int, _frame: FrameType | None) -> None:
    os._exit(0 if os.environ.get(END_BY_SIGNAL_IS_SUCCESS) else INTERRUPTED)


class _Interrupt(KeyboardInterrupt):
    """What Ctrl-C raises in a program: it comes again where a library lost it, as its C code does that clears errors.

    Code of this workspace that takes it has its reasons. It is still running when the interrupt is let go, and heads
    the traceback.
    """

    def __del__(self) -> None:
        head = self.__traceback__.tb_frame if self.__traceback__ else None
        running: FrameType | None = sys._getframe()  # noqa: SLF001  (documented, and nothing else tells)
        while running is not None and running is not head:
            running = running.f_back
        if running is None or not str(running.f_globals.get("__package__")).startswith("fin_"):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise _Interrupt


def _once_more(_number: int, _frame: FrameType | None) -> None:
    signal.raise_signal(signal.SIGINT)


@contextmanager
def interrupts() -> Iterator[None]:
    """Let SIGINT be a KeyboardInterrupt that is not lost; after the block it ends the process. For the main thread."""
    signal.signal(signal.SIGALRM, _once_more)
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, _end)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)


def _say_unless_interrupt(unraisable: sys.UnraisableHookArgs) -> None:
    """Say nothing of an interrupt that a library's callback could not raise: it comes again.

    One that a program's own handler raised would not: it ends the process.
    """
    if isinstance(unraisable.exc_value, _Interrupt):
        return
    if unraisable.exc_type is KeyboardInterrupt:
        os._exit(INTERRUPTED)
    sys.__unraisablehook__(unraisable)


def _listen() -> None:
    """End quietly on SIGINT from here on, though the shell has it ignored, as that of a background job."""
    signal.signal(signal.SIGINT, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    sys.unraisablehook = _say_unless_interrupt


def _print_warnings_only() -> None:
    """Let no warning of a library be an error, which PYTHONWARNINGS=error is meant to do to the user's own programs."""
    os.environ.pop("PYTHONWARNINGS", None)
    filters = [("default" if action == "error" else action, *rest) for action, *rest in warnings.filters]
    warnings.filters[:] = filters  # type: ignore[index]  # a list, in spite of its type


def _import_own_packages_first() -> None:
    """Have PYTHONPATH's other folders come last: a foreign numpy in one of them is not the one that is pinned here."""
    workspace = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))  # noqa: PTH100, PTH120
    own = (workspace, sys.prefix, sys.base_prefix)
    sys.path.sort(key=lambda folder: not folder.startswith(own))


def _open_closed_streams() -> None:
    """Put nothing where a standard stream was closed from the start: the next file opened would take its place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nothing = os.open(os.devnull, os.O_RDWR)
            if nothing != number:
                os.dup2(nothing, number)
                os.close(nothing)
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8"))  # noqa: PTH123, SIM115


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Let Ctrl-C wait until the block has ended; a process that is started meanwhile never sees it.

    For the main thread. The mask is what a process inherits. It does not hold the signal back here, where another
    thread may take it for all: that is the handler's part.
    """
    came = []
    before = signal.signal(signal.SIGINT, lambda *_: came.append(True))
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)


class _BeforeRos(MetaPathFinder):
    """Looks at the environment before ROS 2 is loaded, which for some settings ends the process at once.

    Who asks for help only gets it in any environment.
    """

    def find_spec(self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None) -> None:
        if fullname == "rclpy" and not _HELP & set(sys.argv):
            from fin_plant import ros_environment  # noqa: PLC0415

            sys.meta_path.remove(self)
            ros_environment.prepare()


def _loaded(entry: EntryPoint) -> Callable[[], object] | None:
    """Return the main function that an executable names; None where its module is not, or no longer, there."""
    from importlib import import_module  # noqa: PLC0415  (nothing slow before _listen)

    try:
        module = import_module(entry.module)
    except ModuleNotFoundError as error:
        if f"{entry.module}.".startswith(f"{error.name}."):
            return None
        raise
    return getattr(module, entry.attr, None)


def start(path: str) -> object:
    """Run the executable PREFIX/lib/PACKAGE/NAME, or PACKAGE/NAME of a wheel, and return its exit code.

    While it runs a SIGINT is a KeyboardInterrupt, or what it makes of it: it may have files to close.

    Raises:
        SystemExit: It ended so.
    """
    from pathlib import Path  # noqa: PLC0415  (nothing slow before _listen)

    from fin_plant.command import error_line  # noqa: PLC0415
    from fin_plant.sub_commands import executables  # noqa: PLC0415

    package, name = Path(path).parts[-2:]
    entry = executables(package).get(name)
    other_version = error_line(name, f"{package} {name} is not installed as this version has it: run make setup")
    if entry is None:
        raise SystemExit(other_version)
    of_a_wheel = path == f"{package}/{name}"
    command = f"{package.replace('_', '-')} {name}" if of_a_wheel else f"./run {package} {name}"
    if _HELP & set(sys.argv):
        from fin_plant.node_help import answer  # noqa: PLC0415

        if answer(package, entry, command):
            return 0
    main = _loaded(entry)
    if main is None:
        raise SystemExit(other_version)
    try:
        with interrupts():
            code: object = main()
    finally:
        # What nobody needs any more is let go, a node's place in the graph above all. The interpreter's end would look
        # through all the rest twice, which takes the simulator a sixth of what it takes to start.
        gc.collect()
        gc.freeze()
    return code


if __name__ == "__main__":
    _listen()
    try:
        _open_closed_streams()
        _print_warnings_only()
        _import_own_packages_first()
        sys.meta_path.insert(0, _BeforeRos())
        del sys.argv[0]
        sys.exit(start(sys.argv[0]))  # type: ignore[arg-type]  # what a main function returns
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
