"""What a study leaves behind: table and pictures in its folder, and the sentences that say what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.parameters import OPTIMIZER
from fin_optimizer.study import report
from fin_optimizer.study.candidate import front
from fin_optimizer.study.file_names import FIGURE_FILE, PICTURES
from fin_optimizer.study.pictures import draw_study
from fin_optimizer.words import near, show_speed, show_values
from fin_plant.checks import counted
from fin_plant.command import error_line

if TYPE_CHECKING:
    from fin_optimizer.study.ledger import Study


def write_table(study: Study) -> None:
    """Write the table of all trials into the study's folder.

    Raises:
        OSError: The disk refuses.
    """
    report.write_table(study.folder / report.CSV_FILE, study.trials, study.settings)


def write_report(study: Study) -> list[str]:
    """Write table and pictures, and return what to say of those that could not be: they can be made again any time."""
    told = []
    try:
        write_table(study)
    except OSError as error:
        told.append(error_line(OPTIMIZER, f"the report in {study.folder} cannot be written: {error.strerror or error}"))
    if study.best() is not None:
        failures = draw_study(study.folder / FIGURE_FILE, study.settings, study.trials, study.fish)[1]
        told += [f"warning: {failure}" for failure in failures]
    return told


def findings(study: Study) -> list[str]:
    """Return what was found, the Pareto front too where there are several goals, and where it lies."""
    best = study.best()
    found = ["no trial gave a score"]
    if best is not None and best.score is not None:
        others = [MEASURES[n].told(value) for n, value in best.measured.items() if n != MEAN_SPEED]
        achieved = ", ".join([f"swims {show_speed(best.score)}", *others])
        found = [f"best of {_swum(study)}: {show_values(best.values)} {achieved}"]
        if best.missed:
            found.append(f"no fin meets all constraints; of the best, {' and '.join(best.missed)}")
        elif len(study.settings.goals.measures) > 1:
            found += _front(study)
    names = (report.CSV_FILE, *PICTURES, "journal.log", "bags")
    there = [name for name in names if (study.folder / name).exists()]
    return [*found, f"results: {near(study.folder)}/ ({', '.join(there)})"]


def how_to_go_on(study: Study) -> list[str]:
    """Return what to say of a study that was stopped before its end."""
    folder, trials = near(study.folder), counted(len(study.trials), "trial")
    said = [f"stopped after {trials}, all in the journal; go on with study_folder:={folder} and what else was given"]
    if study.best() is not None:
        said.append(f"its picture is drawn by `show_study {folder} --plot` of fin_optimizer")
    return said


def _swum(study: Study) -> str:
    """Return how much was swum: trials, and fins where some were swum more often or have no score."""
    trials = sum(trial.score is not None for trial in study.trials)
    tried = study.candidates
    fins = sum(fin.score is not None for fin in tried)
    swum = counted(trials, "trial") if fins == trials else f"{counted(fins, 'fin')} in {counted(trials, 'trial')}"
    return swum if fins == len(tried) else f"{swum} ({counted(len(tried) - fins, 'fin')} without a score)"


def _front(study: Study) -> list[str]:
    """Return the fins of the Pareto front, one a line under its heading."""
    chosen = front(study.candidates)
    lines = [f"  {show_values(fin.values)}: {fin.shown}" for fin in chosen]
    *words, last = (goal.words for goal in study.settings.goals.measures)
    return [f"Pareto front of {', '.join(words)} and {last} ({counted(len(chosen), 'fin')}):", *lines]
