"""What a person sees while a study runs: a line a trial, and on a terminal a live one below."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol, TextIO

from fin_optimizer.report import show_speed, show_values
from fin_optimizer.trial import Outcome

if TYPE_CHECKING:
    from rich.progress import TaskID

    from fin_optimizer.study import Candidate, TrialRecord

_REDRAWS_PER_SECOND = 8.0
_SLOW_SECONDS = 1.0
"""A trial that takes longer shows what it waits for."""
_WIDTH_WITH_BAR = 100


class Display(Protocol):
    """Where the progress of a study is shown."""

    def begin(self, trial: TrialRecord) -> None:
        """Show that a trial has begun."""

    def show(self, phase: str, note: str) -> None:
        """Show how far it is; cheap enough to be called often."""

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Show how it ended, how many candidates are settled, and the best so far."""

    def say(self, text: str) -> None:
        """Show a text of its own."""

    def close(self) -> None:
        """Leave the terminal as it was."""


def display(stream: TextIO, total: int, settled: int, *, several: bool = False) -> Display:
    """Return what suits the stream, for a study of ``total`` candidates of which ``settled`` need no more trials.

    Where ``several`` fish swim, each line names the one.
    """
    if stream.isatty():
        return LiveLine(stream, total, settled, several=several)
    return PlainLines(stream, total, settled, several=several)


def summary(trial: TrialRecord) -> str:
    """Return a finished trial in a few words."""
    if trial.outcome is Outcome.OK and trial.score is not None:
        cost = "" if trial.cost is None else f"  {trial.cost:.4g} J/m"
        return f"{show_values(trial.values)}  {show_speed(trial.score)}{cost}"
    return f"{show_values(trial.values)}  {trial.outcome.value}: {trial.reason}"


def show_best(best: Candidate | None) -> str:
    """Return the best candidate in a few words."""
    if best is None or best.score is None:
        return "best: none yet"
    return f"best {show_speed(best.score)} at {show_values(best.values)}"


def show_time(seconds: float) -> str:
    """Return a duration as ``1:02:03`` or ``2:03``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class _TimeLeft:
    """Time left, from the time that the candidates settled in this run took."""

    def __init__(self, total: int, settled: int) -> None:
        self._total = total
        self._first = settled
        self._begin = time.monotonic()

    def text(self, settled: int) -> str:
        done = settled - self._first
        if done < 1:
            return "?"
        return show_time((time.monotonic() - self._begin) / done * max(self._total - settled, 0))


def _line(trial: TrialRecord, total: int, *, several: bool) -> str:
    counted = f"{trial.candidate + 1}/{total}"
    fish = f"{trial.plant}  " if several else ""
    return f"trial {trial.number:04d}  {counted:>7}  {fish}{summary(trial)}"


class PlainLines:
    """One line a trial, for a file or a pipe."""

    def __init__(self, stream: TextIO, total: int, settled: int, *, several: bool = False) -> None:
        self._stream = stream
        self._several = several
        self._total = total
        self._left = _TimeLeft(total, settled)

    def begin(self, trial: TrialRecord) -> None:
        """Show nothing: the line comes with the result."""

    def show(self, phase: str, note: str) -> None:
        """Show nothing: a file is no place for a line that changes."""

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Print the trial's line."""
        line = _line(trial, self._total, several=self._several)
        self.say(f"{line}  ({show_best(best)}, {self._left.text(settled)} left)")

    def say(self, text: str) -> None:
        """Print a line."""
        print(text, file=self._stream, flush=True)

    def close(self) -> None:
        """Nothing to restore."""


class LiveLine:
    """One line a trial, and below it one that is redrawn in place; it fits 80 columns, and has a bar in more."""

    def __init__(self, stream: TextIO, total: int, settled: int, *, several: bool = False) -> None:
        # Loaded only where there is a terminal: it takes a tenth of a second.
        from rich.console import Console  # noqa: PLC0415
        from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn  # noqa: PLC0415

        console = Console(file=stream)
        columns: list[ProgressColumn] = [TextColumn("{task.fields[count]}"), TextColumn("{task.fields[now]}")]
        columns += [TextColumn("[green]{task.fields[best]}"), TextColumn("{task.fields[left]} left")]
        if console.width >= _WIDTH_WITH_BAR:
            columns.insert(1, BarColumn(bar_width=16))
        self._total = total
        self._left = _TimeLeft(total, settled)
        self._several = several
        self._drawn = self._begun = 0.0
        self._values = self._last = ""
        self._line = Progress(*columns, console=console, auto_refresh=False)
        self._task: TaskID = self._line.add_task(
            "", total=total, completed=settled, count=f"{settled}/{total}", now="", best=show_best(None), left="?"
        )
        self._line.start()

    def begin(self, trial: TrialRecord) -> None:
        """Show the candidate."""
        self._begun = time.monotonic()
        self._values = show_values(trial.values)
        self._line.update(self._task, count=f"{trial.candidate + 1}/{self._total}")

    def show(self, phase: str, note: str) -> None:
        """Redraw the line some times a second: with the last speed, or with the phase of a trial that takes long."""
        now = time.monotonic()
        if now - self._drawn < 1.0 / _REDRAWS_PER_SECOND:
            return
        self._drawn = now
        slow = now - self._begun > _SLOW_SECONDS or not self._last
        state = f"{phase} {note}".strip() if slow else self._last
        self._line.update(self._task, now=f"{self._values}  {state}", refresh=True)

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Print the trial's line, and take the result into the one below."""
        self._last = "" if trial.score is None else f"last {show_speed(trial.score)}"
        self._line.update(self._task, completed=settled, best=show_best(best), left=self._left.text(settled))
        self.say(_line(trial, self._total, several=self._several))

    def say(self, text: str) -> None:
        """Print a line above the live one."""
        self._line.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Draw the last state and give the terminal back."""
        self._line.update(self._task, now="")
        self._line.stop()
