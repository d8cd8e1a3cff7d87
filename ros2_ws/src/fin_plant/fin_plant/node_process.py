"""How a node's process starts and ends: one way for every executable of the workspace."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from threadpoolctl import threadpool_limits

from fin_plant import ros_environment, start
from fin_plant.command import EXIT_FAILURE, EXIT_OK, EXIT_USAGE, program, tell_error
from fin_plant.output import go_on_when_output_closes
from fin_plant.ros_arguments import refuse_doubtful

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

    from rclpy.node import Node

END_BY_SIGNAL_IS_SUCCESS = start.END_BY_SIGNAL_IS_SUCCESS
# A callback that waits on nothing returns at once; this bounds how late a stop is seen.
_SPIN_SECONDS = 0.1


class Runnable(Protocol):
    """What `run` drives: a node, an optional slice of own work, and an end that leaves everything safe."""

    node: Node

    def step(self) -> float:
        """Do a slice of work; return the seconds that the executor may wait for the next callback."""

    def finished(self) -> int | None:
        """Return the exit code once the node has nothing more to do, else None."""

    def close(self) -> None:
        """Leave everything safe; called once on every way out, while publishers still work."""


@runtime_checkable
class Interruptible(Protocol):
    """A runnable that waits for something in its callbacks."""

    def interrupt(self) -> None:
        """End such a wait; called in a signal's handler, so it must wait for no lock of the thread it interrupts."""


class _Stop:
    """Remembers the first signal; later ones of the same wave must not break the tear-down.

    Attributes:
        signal: Its number, 0 before.
        interrupted: What is told of it at once.
    """

    def __init__(self) -> None:
        self.signal = 0
        self.interrupted: Interruptible | None = None
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT):  # the last is Ctrl-backslash
            signal.signal(number, self._note)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as under `nohup`
            signal.signal(signal.SIGHUP, self._note)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self.signal = self.signal or number
        if self.interrupted is not None:
            self.interrupted.interrupt()


def _refuse_words(words: list[str]) -> int | None:
    """Say how a node is started if its command line has words that are not for ROS; return the exit code then."""
    if not words:
        return None
    usage = f"usage: {program()} [--ros-args -p PARAMETER:=VALUE ...]; --help lists the parameters"
    tell_error(program(), f"{words[0]!r} is no argument of a node\n{usage}")
    return EXIT_USAGE


@contextlib.contextmanager
def starting_ros(args: list[str] | None = None) -> Iterator[None]:
    """Start ROS 2, without its handlers of signals; what it refuses while the first node is made is one line.

    Raises:
        SystemExit: It refuses; exit code 2.
    """
    ros_environment.prepare()
    with _one_line_for_what_ros_refuses():
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        yield


@contextlib.contextmanager
def _one_line_for_what_ros_refuses() -> Iterator[None]:
    try:
        yield
    except rclpy_implementation.RCLError as error:
        ros_environment.refuse(f"ROS 2 does not start: {error}; check its arguments and the ROS_ variables")


def run(make: Callable[[], Runnable], args: list[str] | None = None) -> int:
    """Run a node until it has finished or a signal asks it to stop.

    Args:
        make: Makes the node; a ValueError is a start value that is refused.
        args: The command line, its program first, for a command that reads words of its own; where it is None the
            process' own command line is taken, and words that are not for ROS are refused.

    Returns:
        The node's own exit code, 128 + signal after SIGINT (130), SIGTERM (143), SIGQUIT (131) or SIGHUP (129, its
        terminal was closed) or 0 then if END_BY_SIGNAL_IS_SUCCESS is set, 2 for a start value that is refused (its
        message goes to stderr).
    """
    go_on_when_output_closes()
    if args is None:
        with _one_line_for_what_ros_refuses():
            words = remove_ros_args(sys.argv)[1:]
        if (asked := _refuse_words(words)) is not None:
            return asked
    # The matrices here are small. A helper thread of the linear algebra would gain nothing, and after each call it
    # spins for tens of milliseconds on a core that another node needs.
    threadpool_limits(1, user_api="blas")
    stop = _Stop()
    with contextlib.ExitStack() as last:
        last.callback(rclpy.try_shutdown)
        try:
            refuse_doubtful(sys.argv if args is None else args)
            with starting_ros(args):
                runnable = make()
        except ValueError as error:
            tell_error(program(), error)
            return EXIT_USAGE
        stop.interrupted = runnable if isinstance(runnable, Interruptible) else None
        last.callback(runnable.node.destroy_node)
        executor = EventsExecutor()
        last.callback(executor.shutdown)
        executor.add_node(runnable.node)
        last.callback(runnable.close)
        code: int | None = None
        try:
            while code is None and not stop.signal:
                executor.spin_once(timeout_sec=min(runnable.step(), _SPIN_SECONDS))
                code = runnable.finished()
        except ExternalShutdownException:
            code = EXIT_FAILURE
        except Exception:  # noqa: BLE001  (a defect; left to the interpreter's end, the middleware would hang there)
            traceback.print_exc()
            code = EXIT_FAILURE
    if stop.signal and not os.environ.get(END_BY_SIGNAL_IS_SUCCESS):
        return 128 + stop.signal
    return code or EXIT_OK
