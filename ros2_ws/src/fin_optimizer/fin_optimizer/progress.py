"""What a person sees while a study runs: a line a trial, and on a terminal a live one below."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Protocol, TextIO

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import show_speed, show_values, trial_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.progress import TaskID

    from fin_optimizer.study.candidate import Candidate, TrialRecord

_REDRAWS_PER_SECOND = 8.0
_SLOW_SECONDS = 1.0
"""A trial that takes longer shows what it waits for."""
_WIDTH_WITH_BAR = 120
_BAR_WIDTH = 16
_FIRST_ESTIMATE = 3
"""Fins after which the time left is told: the first ones also tell how long the nodes take to start."""
_MINUTE, _HOUR, _DAY = 60.0, 3600.0, 86400.0
# Below how many s an estimate is told in which unit (s), to which step of it, and the unit's word.
_ABOUT: tuple[tuple[float, float, float, str], ...] = (
    (1.5 * _MINUTE, 1.0, 10, "s"),
    (10.0 * _MINUTE, _MINUTE, 1, "min"),
    (1.5 * _HOUR, _MINUTE, 5, "min"),
    (10.0 * _HOUR, _HOUR, 0.5, "h"),
    (1.5 * _DAY, _HOUR, 1, "h"),
    (math.inf, _DAY, 0.5, "days"),
)


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


def display(
    stream: TextIO, total: int, settled: int, *, several: bool = False, clock: Callable[[], float] = time.monotonic
) -> Display:
    """Return what suits the stream, for a study of ``total`` candidates of which ``settled`` need no more trials.

    Where ``several`` fish swim, each line names the one. ``clock`` is the time in s.
    """
    kind = LiveLine if stream.isatty() else PlainLines
    return kind(stream, total, settled, clock, several=several)


def summary(trial: TrialRecord) -> str:
    """Return a finished trial in a few words."""
    if trial.outcome is Outcome.OK and trial.score is not None:
        others = [MEASURES[name].shown(value) for name, value in trial.measured.items() if name != MEAN_SPEED]
        return "  ".join([show_values(trial.values), show_speed(trial.score), *others])
    return f"{show_values(trial.values)}  {trial.outcome.value}: {trial.reason}"


def show_best(best: Candidate | None) -> str:
    """Return the best candidate in a few words."""
    if best is None or not best.measured:
        return "best: none yet"
    first = best.goals.measures[0]
    missed = " (misses a constraint)" if best.missed else ""
    return f"best {first.shown(best.measured[first.name])}{missed} at {show_values(best.values)}"


def show_about(seconds: float) -> str:
    """Return a duration as an estimate is told: ``about 40 s``, ``about 25 min``, ``about 3.5 h``, ``about 2 days``."""
    unit, step, word = next(each[1:] for each in _ABOUT if seconds < each[0])
    rounded = max(1, round(seconds / (unit * step))) * step
    return f"about {rounded:g} {word}"


class TimeLeft:
    """Time left, from how long the fins took that were settled in this run; hours in which the study held don't count.

    Args:
        total: Fins that the study shall have.
        settled: Fins that need no more trials now.
        clock: Time in s.
    """

    def __init__(self, total: int, settled: int, clock: Callable[[], float]) -> None:
        self._total, self._first, self._clock = total, settled, clock
        self._under_way = 0
        self._since = self._worked = 0.0

    def begin(self) -> None:
        """Note that a trial begins."""
        if not self._under_way:
            self._since = self._clock()
        self._under_way += 1

    def end(self) -> None:
        """Note that a trial has ended."""
        now = self._clock()
        self._worked += now - self._since
        self._since = now
        self._under_way = max(0, self._under_way - 1)

    def text(self, settled: int) -> str:
        """Return for example ``about 25 min left``; an empty text as long as too few fins tell, and at the end."""
        done, missing = settled - self._first, self._total - settled
        if done < _FIRST_ESTIMATE or missing <= 0:
            return ""
        return f"{show_about(self._worked / done * missing)} left"


def count(trial: TrialRecord, total: int) -> str:
    """Return which fin of how many a trial is about, from 1: ``fin 3 of 30``."""
    return f"fin {trial.candidate + 1:>{len(str(total))}} of {total}"


def _line(trial: TrialRecord, total: int, *, several: bool) -> str:
    fish = f"{trial.plant}  " if several else ""
    return f"{trial_name(trial.number)}  {count(trial, total)}  {fish}{summary(trial)}"


def live_line(width: int, count: str, values: str, state: str, best: str, left: str) -> str:
    """Return what of these texts fits into ``width`` columns, the least important ones left out, none in part."""
    short = best.partition(" at ")[0]
    for parts in (
        (count, values, state, best, left),
        (count, values, state, short, left),
        (count, state, short, left),
        (count, state, short),
        (count, short),
        (count,),
    ):
        line = "  ".join(filter(None, parts))
        if len(line) <= width:
            break
    return line


class PlainLines:
    """One line a trial, for a file or another program."""

    def __init__(
        self, stream: TextIO, total: int, settled: int, clock: Callable[[], float], *, several: bool = False
    ) -> None:
        self._stream = stream
        self._several = several
        self._total = total
        self._left = TimeLeft(total, settled, clock)

    def begin(self, trial: TrialRecord) -> None:  # noqa: ARG002  (as a `Display`)
        """Show nothing: the line comes with the result."""
        self._left.begin()

    def show(self, phase: str, note: str) -> None:
        """Show nothing: a file is no place for a line that changes."""

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Print the trial's line."""
        self._left.end()
        known = ", ".join(filter(None, (show_best(best), self._left.text(settled))))
        self.say(f"{_line(trial, self._total, several=self._several)}  ({known})")

    def say(self, text: str) -> None:
        """Print a line."""
        print(text, file=self._stream, flush=True)

    def close(self) -> None:
        """Nothing to restore."""


class LiveLine:
    """One line a trial, and below it one that is redrawn in place; it fits 80 columns, and has a bar in more."""

    def __init__(
        self, stream: TextIO, total: int, settled: int, clock: Callable[[], float], *, several: bool = False
    ) -> None:
        # Loaded only where there is a terminal: it takes a tenth of a second.
        from rich.console import Console  # noqa: PLC0415
        from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn  # noqa: PLC0415
        from rich.table import Column  # noqa: PLC0415

        console = Console(file=stream)
        columns: list[ProgressColumn] = [
            TextColumn("{task.fields[line]}", markup=False, table_column=Column(no_wrap=True))
        ]
        if console.width >= _WIDTH_WITH_BAR:
            columns.append(BarColumn(bar_width=_BAR_WIDTH))
        self._total = total
        self._left = TimeLeft(total, settled, clock)
        self._several = several
        self._clock = clock
        self._drawn = -math.inf
        self._begun = clock()
        self._count = f"fin {min(settled + 1, total)} of {total}"
        self._values = self._now = self._last = self._time_left = ""
        self._best = show_best(None)
        self._line = Progress(*columns, console=console, auto_refresh=False)
        self._task: TaskID = self._line.add_task("", total=total, completed=settled, line=self._text())
        self._line.start()

    def _text(self) -> str:
        width = self._line.console.width
        room = width - _BAR_WIDTH - 1 if width >= _WIDTH_WITH_BAR else width
        return live_line(room, self._count, self._values, self._now, self._best, self._time_left)

    def begin(self, trial: TrialRecord) -> None:
        """Show the candidate."""
        self._left.begin()
        self._begun = self._clock()
        self._values, self._count = show_values(trial.values), count(trial, self._total)
        self._line.update(self._task, line=self._text())

    def show(self, phase: str, note: str) -> None:
        """Redraw the line some times a second: with the last speed, or with the phase of a trial that takes long."""
        now = self._clock()
        if now - self._drawn < 1.0 / _REDRAWS_PER_SECOND:
            return
        self._drawn = now
        slow = now - self._begun > _SLOW_SECONDS or not self._last
        self._now = f"{phase} {note}".strip() if slow else self._last
        self._line.update(self._task, line=self._text(), refresh=True)

    def end(self, trial: TrialRecord, settled: int, best: Candidate | None) -> None:
        """Print the trial's line, and take the result into the one below."""
        self._left.end()
        self._last = "" if trial.score is None else f"last {show_speed(trial.score)}"
        self._best, self._time_left = show_best(best), self._left.text(settled)
        self._line.update(self._task, completed=settled, line=self._text())
        line = _line(trial, self._total, several=self._several)
        self._line.console.print(line, markup=False, highlight=False)  # broken between words where it is too long

    def say(self, text: str) -> None:
        """Print a line above the live one."""
        self._line.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Draw the last state and give the terminal back."""
        self._now = ""
        self._line.update(self._task, line=self._text())
        self._line.stop()
