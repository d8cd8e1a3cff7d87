"""The processes of a study: nodes that are started, heard and ended together, the optimiser's end being the study's."""

from __future__ import annotations

import ctypes
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from fin_plant import sub_commands
from fin_plant.command import EXIT_FAILURE, error_line

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from fin_bringup.study_nodes import NodeSpec

SECONDS_TO_END = 20.0
"""s that a node gets from the first signal: a robot's driver leads its tail to neutral, which takes 10 s at most."""
# How a process is asked to end, whatever signal came here, with the seconds that it gets. The nodes treat SIGINT and
# SIGTERM alike once they run; while Python still loads them, SIGTERM ends them without a traceback. The optimiser
# closes a bag and a journal, for which a slow disk may need its time.
_WAYS_TO_END = ((signal.SIGTERM, SECONDS_TO_END), (signal.SIGKILL, 5.0))
_LAST_WORDS = 20
# From <linux/prctl.h>.
_PR_SET_PDEATHSIG = 1


def find_executable(package: str, executable: str) -> list[str]:
    """Return the words that start an executable.

    By the rule of `ros2 run` it is PREFIX/lib/PACKAGE/EXECUTABLE in the environment's prefixes, else a wheel's.

    Raises:
        FileNotFoundError: There is none; the message says what to do.
    """
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        path = Path(prefix) / "lib" / package / executable
        if os.access(path, os.X_OK):
            return [str(path)]
    if executable in sub_commands.executables(package):
        return sub_commands.start_words(package, executable)
    msg = (
        f"executable {executable} of package {package} is in no prefix of AMENT_PREFIX_PATH and in no installed wheel: "
        f"source install/setup.bash"
    )
    raise FileNotFoundError(msg)


def _end_with_parent() -> None:
    """Have Linux send this process SIGTERM when its parent is gone: a killed bring-up leaves no node running."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


class Child:
    """A node's process, in a process group of its own, so that it gets each signal once and from here only."""

    def __init__(self, spec: NodeSpec, name: str) -> None:
        """Start it.

        Args:
            spec: What to start.
            name: Of the node, by which a person tells it from the others.

        Raises:
            FileNotFoundError: Its executable is not installed.
        """
        self.name = name
        self.last_words: deque[str] = deque(maxlen=_LAST_WORDS)
        command = [*find_executable(spec.package, spec.executable), *spec.words, *spec.ros_arguments()]
        self.process = subprocess.Popen(  # noqa: S603
            command,
            start_new_session=True,
            stderr=subprocess.PIPE,
            preexec_fn=_end_with_parent,  # noqa: PLW1509  (there are no threads here)
        )
        self.ended = os.pidfd_open(self.process.pid)
        assert self.process.stderr is not None  # noqa: S101 - asked for above
        self.errors = self.process.stderr
        os.set_blocking(self.errors.fileno(), False)
        self._rest = b""

    def echo(self) -> bool:
        """Pass on what it wrote to stderr since the last call, its name before each line; False at the stream's end."""
        chunk = self.errors.read()
        if chunk is None:
            return True
        *lines, self._rest = (self._rest + chunk).split(b"\n") if chunk else (self._rest, b"")
        for line in lines:
            if text := line.decode(errors="replace").rstrip():
                self.last_words.append(text)
                _say(f"[{self.name}] {text}\n")
        return bool(chunk)

    def signal(self, number: int) -> None:
        """Send a signal to its whole group; nothing happens if it is gone."""
        try:
            os.killpg(self.process.pid, number)
        except ProcessLookupError:
            return

    def close(self) -> None:
        """End what is left of its group, and let go of its streams."""
        self.signal(signal.SIGKILL)
        self.process.wait()
        self.errors.close()
        os.close(self.ended)


class StudyProcesses:
    """The processes of a study, the plant first and the optimiser last."""

    def __init__(self, specs: Sequence[NodeSpec], viewers: Sequence[NodeSpec] = ()) -> None:
        """Start them all.

        Args:
            specs: The plant first and the optimiser last.
            viewers: What shows the study, and may end before it.

        Raises:
            FileNotFoundError: An executable is not installed; nothing is left running.
        """
        for spec in (*specs, *viewers):
            find_executable(spec.package, spec.executable)
        self._signal = 0
        self._selector = selectors.DefaultSelector()
        self._listen_to_signals()
        self.children: list[Child] = []
        self._fish: dict[str, list[Child]] = {}
        self._viewers: list[Child] = []
        several = len({spec.namespace for spec in specs[:-1]}) > 1
        for spec in specs:
            child = Child(spec, f"{spec.namespace}/{spec.name}" if several else spec.name)
            self.children.append(child)
            if len(self.children) < len(specs):
                self._fish.setdefault(spec.namespace, []).append(child)
            self._watch(child)
        for spec in viewers:
            self._viewers.append(Child(spec, spec.name))
            self._watch(self._viewers[-1])

    def _watch(self, child: Child) -> None:
        self._selector.register(child.errors, selectors.EVENT_READ, child)
        self._selector.register(child.ended, selectors.EVENT_READ, child)

    @property
    def optimizer(self) -> Child:
        """The process whose end is the study's."""
        return self.children[-1]

    def _listen_to_signals(self) -> None:
        woken, waker = socket.socketpair()
        for end in (woken, waker):
            end.setblocking(False)  # noqa: FBT003
        self._waker = waker
        signal.set_wakeup_fd(waker.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as under `nohup`
                signal.signal(number, self._note)
        self._selector.register(woken, selectors.EVENT_READ, woken)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self._signal = self._signal or number

    def run(self) -> int:
        """Wait for the end of the study and return its exit code: the optimiser's, 128 + a signal, or 1.

        One of several fish may end before: the others swim on.
        """
        while self._fish and not self._signal and self.optimizer.process.poll() is None:
            if not self._end_what_is_left_of_a_fish():
                self._wait(None)
        if self._signal or self.optimizer.process.poll() is not None:
            return self._end(self._signal)
        self._end()
        return EXIT_FAILURE

    def _end_what_is_left_of_a_fish(self) -> bool:
        """Name a fish of which a process has ended, if any, and end the rest of it: half a fish only spoils trials."""
        gone = [name for name, fish in self._fish.items() if any(child.process.poll() is not None for child in fish)]
        if not gone:
            return False
        children = self._fish.pop(gone[0])
        dead = [child for child in children if child.process.poll() is not None]
        for child in dead:
            child.echo()
            _say(_how_it_ended(child))
        if self._fish:
            _say(f"note: the study goes on without {gone[0]}\n")
            self._end_children(children)
        return True

    def _end(self, number: int = 0) -> int:
        """End all processes, the optimiser first: its last gait must still find the plant.

        Args:
            number: Signal that asked for the end here, 0 if none did.
        """
        self._end_children([*self._viewers, *self.children])
        code = self.optimizer.process.returncode
        self.optimizer.echo()
        if number:
            return 128 + number
        if code < 0:
            _say(_how_it_ended(self.optimizer))
            return EXIT_FAILURE
        return code

    def _end_children(self, children: Sequence[Child]) -> None:
        for child in reversed(children):
            for way, patience in _WAYS_TO_END:
                if child.process.poll() is None:
                    child.signal(way)
                    self._wait_for(child, patience)

    def _wait_for(self, child: Child, patience: float) -> None:
        until = time.monotonic() + patience
        while child.process.poll() is None and (left := until - time.monotonic()) > 0.0:
            self._wait(left)

    def _wait(self, seconds: float | None) -> None:
        """Wait for output, a signal or the end of a process, and pass on the output."""
        for key, _ in self._selector.select(seconds):
            if isinstance(key.data, socket.socket):
                key.data.recv(4096)
            elif key.fileobj is key.data.errors:
                if not key.data.echo():
                    self._selector.unregister(key.fileobj)
            else:
                key.data.process.poll()
                self._selector.unregister(key.fileobj)

    def close(self) -> None:
        """End what still runs, as at the end of a study, and leave no process behind.

        If that fails too, no process is killed: each one's own SIGTERM comes when this process is gone.
        """
        children = [*self._viewers, *self.children]
        self._end_children(children)
        for child in children:
            child.close()
        signal.set_wakeup_fd(-1)
        self._selector.close()


def _say(text: str) -> None:
    """Write it, on a terminal in the place of the optimiser's live line, which is drawn anew below."""
    sys.stderr.write(f"\r\x1b[K{text}" if sys.stderr.isatty() else text)


def _how_it_ended(child: Child) -> str:
    code = child.process.returncode
    how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
    words = "".join(f"\n  {line}" for line in child.last_words) or "\n  (nothing)"
    return error_line("bringup", f"{child.name} {how} before the study did; the last it said:{words}\n")
