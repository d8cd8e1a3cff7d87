"""Command ``show_study``: a study as a table on the terminal, the best fin first."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.journal import StudyError
from fin_optimizer.pipe import end_with_the_reader
from fin_optimizer.report import show_speed, show_values
from fin_optimizer.study import Objective, candidates, front, read_settings, read_trials
from fin_optimizer.trial import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from fin_optimizer.study import Candidate, Settings, TrialRecord


def ranking(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates by speed, the best first; those without a score follow in the order they were tried."""
    return sorted(tried, key=lambda c: (c.score is None, -(c.score or 0.0), c.number))


def study_table(settings: Settings, trials: Sequence[TrialRecord], limit: int | None = None) -> Table:
    """Return the table of a study for a terminal.

    Args:
        settings: Of the study.
        trials: All of them.
        limit: Rows at most, None for all.
    """
    from rich.table import Table  # noqa: PLC0415  (a tenth of a second, which only the terminal's user spends)
    from rich.text import Text  # noqa: PLC0415

    tried = candidates(trials)
    with_cost = settings.objective is Objective.SPEED_AND_COST
    chosen = {candidate.number for candidate in front(tried)} if with_cost else set()
    heads = ["rank", "fin", "speed", "± between swims", "swims", "FAILED", "trials", "remark"]
    interrupted = any(trial.interrupted for trial in trials)
    if interrupted:
        heads.insert(6, "interrupted")
    if with_cost:
        heads.insert(4, "J/m")
    table = Table(*heads, title=_title(settings, trials), title_justify="left")
    ranked = ranking(tried)
    for rank, candidate in enumerate(ranked[:limit], start=1):
        row = _row(candidate, in_front=candidate.number in chosen)
        if interrupted:
            row.insert(5, str(sum(trial.interrupted for trial in candidate.trials) or ""))
        if with_cost:
            row.insert(3, "" if candidate.cost is None else f"{candidate.cost:.4g}")
        style = "bold green" if rank == 1 and candidate.score is not None else None
        row.insert(0, str(rank) if candidate.score is not None else "")
        table.add_row(*map(Text, row), style=style)  # what stands in brackets is no markup
    if limit is not None and len(ranked) > limit:
        table.caption = f"{len(ranked) - limit} more: see --all"
    return table


def _row(candidate: Candidate, *, in_front: bool) -> list[str]:
    outcomes = [trial.outcome for trial in candidate.trials if not trial.interrupted]
    reasons = [trial.reason for trial in candidate.trials if trial.outcome in {Outcome.FAILED, Outcome.INFEASIBLE}]
    remark = reasons[-1] if reasons and candidate.score is None else "on the Pareto front" if in_front else ""
    return [
        show_values(candidate.values),
        "" if candidate.score is None else show_speed(candidate.score),
        "" if candidate.spread is None else show_speed(candidate.spread),
        str(outcomes.count(Outcome.OK)),
        str(outcomes.count(Outcome.FAILED) or ""),
        " ".join(f"{trial.number:04d}" for trial in candidate.trials),
        remark,
    ]


def _title(settings: Settings, trials: Sequence[TrialRecord]) -> str:
    counted = Counter("interrupted" if trial.interrupted else trial.outcome.value for trial in trials)
    words = (*(outcome.value for outcome in Outcome), "interrupted")
    said = ", ".join(f"{counted[word]} {word}" for word in words if counted[word]) or "no trial yet"
    repeats = settings.policy.repeats
    return f"{settings.objective.value}, {repeats} {'swim' if repeats == 1 else 'swims'} a fin: {said}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Show a study; return 0, or 2 if there is none."""
    if arguments is None:
        end_with_the_reader()
    parser = argparse.ArgumentParser(prog="show_study", description="Show a study's fins, the best first.")
    parser.add_argument("study", type=Path, metavar="STUDY", help="folder of the study; it may be under way")
    parser.add_argument("--all", action="store_true", help="every fin, not only the best 20")
    given = parser.parse_args(arguments)
    try:
        settings, trials = read_settings(given.study), read_trials(given.study)
    except (StudyError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    from rich.console import Console  # noqa: PLC0415  (as above)

    console = Console()
    if not console.is_terminal:
        console.width = 200  # a file has no width: lines are not to be broken for it
    console.print(study_table(settings, trials, None if given.all else 20))
    return 0


if __name__ == "__main__":
    sys.exit(main())
