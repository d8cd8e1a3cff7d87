"""Command ``show_study``: a study as a table on the terminal, the best fin first, and as a picture."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.goals import BETWEEN_CONSTRAINTS, MEAN_SPEED
from fin_optimizer.progress import show_best
from fin_optimizer.study.candidate import best_of, candidates, front, rank
from fin_optimizer.study.file_names import FIGURE_FILE, SETTINGS_FILE
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.records import read_ledger
from fin_optimizer.study.report import varied
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import in_words, show_number, trial_name
from fin_plant import checks
from fin_plant.command import command, tell_error
from fin_plant.figures import FORMATS, check_picture
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from rich.table import Table
    from rich.text import Text

    from fin_optimizer.goals import Measure
    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.settings import Settings


_NO_PATH = Path()
_BETWEEN = 2
"""Columns of the terminal between two columns of the table."""
_TRIALS_WIDTH = len("trials")
"""Wide enough for one number; several are broken between them."""
_REMARK_WIDTH = 24 + _BETWEEN
_WITH_REASON = {Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE}


def ranking(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates, the best first; those without a score follow in the order they were tried."""
    return sorted(tried, key=rank, reverse=True)


@dataclass(frozen=True)
class _Column:
    """A column of the table.

    Attributes:
        head: Its head; the unit stands in a line of its own.
        cells: One a fin.
        need: The higher, the sooner it is left out where the terminal is narrow; 0 never is.
    """

    head: str
    cells: list[str]
    need: int = 0

    @property
    def width(self) -> int:
        """Columns of the terminal that it takes, unbroken."""
        return max(map(len, [*self.head.split("\n"), *self.cells]), default=0) + _BETWEEN


def _columns(settings: Settings, ranked: Sequence[Candidate], chosen: Collection[int]) -> list[_Column]:
    """Return all columns that say something."""
    fins = [settings.told(candidate.values) for candidate in ranked]
    columns = [
        _Column("rank", [str(n) if c.score is not None else "" for n, c in enumerate(ranked, start=1)]),
    ]
    for name in varied(settings, [candidate.values for candidate in ranked]):
        word, factor, unit = in_words(name)
        head = "\n".join([*word.split(" "), f"({unit})"] if unit else [word])
        follows = name not in settings.space.names  # from those that are searched
        columns.append(_Column(head, [show_number(fin[name], factor) for fin in fins], int(follows)))
    swims = [_count(c, Outcome.OK) or "0" for c in ranked]
    several = settings.policy.repeats > 1 or any(int(n) > 1 for n in swims)
    columns += [
        _Column("speed\n(cm/s)", ["" if c.score is None else f"{c.score * 100:#.4g}" for c in ranked]),
        _Column("±\n(cm/s)", ["" if c.spread is None else f"{c.spread * 100:.2g}" for c in ranked], 3),
        *(_measured(each, ranked) for each in settings.goals.asked if each.name != MEAN_SPEED),
        _Column("misses", [", ".join(c.missed_measures) for c in ranked]),
        _Column("front", ["*" if c.number in chosen else "" for c in ranked], 2),
        _Column("swims", swims if several else [], 5),
        _Column("FAILED", [_count(c, Outcome.FAILED) for c in ranked], 4),
        _Column("INTER-\nRUPTED", [_count(c, Outcome.INTERRUPTED) for c in ranked], 6),
    ]
    return [column for column in columns if any(column.cells)]


def _measured(of: Measure, ranked: Sequence[Candidate]) -> _Column:
    unit, factor = of.shown_in
    cells = [f"{c.measured[of.name] / factor:#.4g}" if c.measured else "" for c in ranked]
    return _Column("\n".join([*of.words.split(" "), f"({unit})"]), cells)


def _count(candidate: Candidate, outcome: Outcome) -> str:
    return str([trial.outcome for trial in candidate.trials].count(outcome) or "")


def _remark(candidate: Candidate) -> str:
    reasons = [trial.reason for trial in candidate.trials if trial.outcome in _WITH_REASON]
    return reasons[-1] if reasons and candidate.score is None else ""


def study_table(
    settings: Settings, trials: Sequence[TrialRecord], width: int, limit: int | None = None
) -> Iterator[Table | Text]:
    """Yield what is to be printed of a study: what it found, a table of its fins, and what does not fit into that.

    Args:
        settings: Of the study.
        trials: All of them.
        width: Of the terminal.
        limit: Rows at most, None for all.
    """
    from rich.text import Text  # noqa: PLC0415  (a tenth of a second, which only the terminal's user spends)

    tried = candidates(trials, settings.goals)
    yield Text(_title(settings, trials))
    best = best_of(tried)
    if best is not None:
        names = ", ".join(f"{trial.number:04d}" for trial in best.trials if trial.score is not None)
        yield Text(f"{show_best(best)} (trial {names})", style="bold green")
    several = len(settings.goals.measures) > 1
    chosen = {candidate.number for candidate in front(tried)} if several else set()
    shown = ranking(tried)[:limit]
    if not shown:
        return
    columns, left_out = _fitting(_columns(settings, shown, chosen), width - _TRIALS_WIDTH)
    remarks = [_remark(candidate) for candidate in shown]
    room = width - _TRIALS_WIDTH - sum(column.width for column in columns)
    beside = any(remarks) and room >= _REMARK_WIDTH
    yield _table(columns, shown, best, remarks if beside else [])
    for candidate, remark in zip(shown, remarks, strict=True):
        if remark and not beside:
            yield Text(f"{trial_name(candidate.trials[-1].number)}: {remark}")
    if len(tried) > len(shown):
        yield Text(f"{len(tried) - len(shown)} more: see --all")
    if left_out:
        yield Text(f"not shown in {width} columns: {', '.join(left_out)}")


def _fitting(columns: Sequence[_Column], width: int) -> tuple[list[_Column], list[str]]:
    """Return the columns that fit into so many columns of the terminal, and the heads of those left out."""
    kept, left_out = list(columns), []
    while sum(column.width for column in kept) > width:
        column = max(kept, key=lambda each: each.need)
        if not column.need:
            break
        kept.remove(column)
        left_out.append(column.head.replace("-\n", "").replace("\n", " "))
    return kept, left_out


def _table(
    columns: Sequence[_Column], shown: Sequence[Candidate], best: Candidate | None, remarks: Sequence[str]
) -> Table:
    from rich.box import SIMPLE_HEAD  # noqa: PLC0415  (a tenth of a second, which only the terminal's user spends)
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column.head, justify="right", no_wrap=True, min_width=column.width - _BETWEEN)
    table.add_column("trials", min_width=_TRIALS_WIDTH)
    if remarks:
        table.add_column("remark", min_width=_REMARK_WIDTH - _BETWEEN)
    for row, candidate in enumerate(shown):
        numbers = " ".join(f"{trial.number:04d}" for trial in candidate.trials)
        cells = [*(column.cells[row] for column in columns), numbers, *remarks[row : row + 1]]
        # What stands in brackets is no markup.
        table.add_row(*map(Text, cells), style="bold green" if candidate is best else None)
    return table


def _title(settings: Settings, trials: Sequence[TrialRecord]) -> str:
    counted = Counter(trial.outcome for trial in trials)
    said = ", ".join(f"{counted[word]} {word}" for word in Outcome if counted[word]) or "no trial yet"
    repeats = settings.policy.repeats
    goals = BETWEEN_CONSTRAINTS.join([settings.goals.objective, *(each.text for each in settings.goals.constraints)])
    return f"{goals}, {repeats} {'swim' if repeats == 1 else 'swims'} a fin: {said}"


@command("show_study")
def main(arguments: Sequence[str] | None = None) -> int:
    """Show a study; return 0, 1 if a picture of it could not be drawn, 2 if there is no study."""
    parser = argparse.ArgumentParser(prog="show_study", description="Show a study's fins, the best first.")
    parser.add_argument("study", type=given_path, nargs="?", metavar="STUDY", help="its folder; it may be under way")
    parser.add_argument("--all", action="store_true", help="every fin, not only the best 20")
    parser.add_argument(
        "--plot",
        nargs="?",
        type=given_path,
        const=_NO_PATH,
        metavar="PATH",
        help="draw its picture too, from the journal alone: into a file whose name ends in "
        f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}, or into a folder; {FIGURE_FILE} of the study if left out",
    )
    parser.add_argument(
        "--goal",
        metavar="NAME",
        help="with --plot: slices, parallel coordinates and importance of this one of the study's goals (default: all)",
    )
    given = parser.parse_args(arguments)
    if given.study is None and given.plot and (given.plot / SETTINGS_FILE).exists():
        given.study, given.plot = given.plot, _NO_PATH
    if given.study is None:
        parser.error("which study? Give its folder")
    picture = given.plot
    if picture is not None and (picture == _NO_PATH or picture.is_dir()):
        picture = (given.study if picture == _NO_PATH else picture) / FIGURE_FILE
    if picture is not None:
        check_picture(picture)
    settings, (trials, fish) = read_settings(given.study), read_ledger(given.study)
    goal = None if given.goal is None else _goal(settings, given.goal, picture)
    from rich.console import Console  # noqa: PLC0415  (as above)

    console = Console()
    if not console.is_terminal:
        console.width = 200  # a file has no width: lines are not to be broken for it
    for part in study_table(settings, trials, console.width, None if given.all else 20):
        console.print(part)
    return 0 if picture is None else _draw(picture, settings, trials, fish, goal)


def _goal(settings: Settings, name: str, picture: Path | None) -> Measure:
    """Return one of the study's goals.

    Raises:
        ValueError: It is none of them, or nothing is to be drawn.
    """
    if picture is None:
        msg = f"--goal {name} chooses pictures: give --plot too"
        raise ValueError(msg)
    goals = {goal.name: goal for goal in settings.goals.measures}
    return goals[checks.choice("--goal", name, goals)]


def _draw(
    path: Path,
    settings: Settings,
    trials: Sequence[TrialRecord],
    fish: Mapping[str, object],
    goal: Measure | None,
) -> int:
    """Draw a study's pictures; return 0, or 1 if one could not be drawn."""
    if all(trial.score is None for trial in trials):
        tell_error("show_study", f"{path} is not drawn: no trial has a score yet")
        return 1
    from fin_optimizer.study.pictures import draw_study  # noqa: PLC0415  (likewise)

    drawn, failures = draw_study(path, settings, trials, fish, goal)
    sys.stdout.writelines(f"picture: {each}\n" for each in drawn)
    for failure in failures:
        tell_error("show_study", failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
