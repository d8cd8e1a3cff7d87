"""What a terminal shows of a bag that is played."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

_REDRAW_PERIOD = 0.125


class PlayDisplay:
    """Lines on standard output, and on a terminal how far the playing is."""

    def __init__(self, length: float, *, quiet: bool) -> None:
        """Show the progress of a bag of so many s, if anybody can see it."""
        self._quiet = quiet
        self._length = length
        self._due = 0.0
        self._bar = self._bar_of(length) if sys.stdout.isatty() and not quiet else None

    @staticmethod
    def _bar_of(length: float) -> tuple[Progress, TaskID]:
        # A tenth of a second, which only a terminal spends.
        from rich.console import Console  # noqa: PLC0415
        from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415

        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[time]}"))
        bar = Progress(*columns, console=Console(), transient=True)
        task = bar.add_task("", total=max(length, 1e-9), time="")
        bar.start()
        return bar, task

    def say(self, line: str) -> None:
        """Print a line."""
        if self._quiet:
            return
        if self._bar is None:
            print(line, flush=True)  # noqa: T201
        else:
            self._bar[0].console.print(line, highlight=False, markup=False, soft_wrap=True)

    def show(self, now: float, position: float, rounds: int, *, paused: bool) -> None:
        """Show the position in s; cheap enough to be called often."""
        if self._bar is None or now < self._due:
            return
        self._due = now + _REDRAW_PERIOD
        what = ("paused" if paused else "playing") + (f", round {rounds + 1}" if rounds else "")
        bar, task = self._bar
        bar.update(task, completed=position, description=what, time=f"{position:.1f} of {self._length:.1f} s")

    def end(self, line: str) -> None:
        """Take the progress away and print a last line, unless it is empty."""
        if self._bar is not None:
            self._bar[0].stop()
            self._bar = None
        if line:
            self.say(line)
