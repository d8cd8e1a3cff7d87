"""The page of one study."""

from __future__ import annotations

import json
import statistics
from collections import Counter
from typing import TYPE_CHECKING

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.report import study_figures
from fin_optimizer.report.marks import some_of
from fin_optimizer.report.parts import Cell, Column, Facts, Film, Page, Plot, Section, Table
from fin_optimizer.report.simulated import DEFAULT_FISH
from fin_optimizer.study.candidate import front, rank
from fin_optimizer.study.importance import importances
from fin_optimizer.study.report import varied
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import CM, in_words, show_number, show_values, with_unit
from fin_plant.checks import counted
from fin_plant.fin import node_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.goals import Measure
    from fin_optimizer.report.parts import Block
    from fin_optimizer.report.study_facts import StudyFacts
    from fin_optimizer.study.candidate import Candidate, TrialRecord

_ROWS = 400
"""Trials that the table holds at most."""
_REPEATED = 24
"""Fins at most whose repeats are drawn."""
_REASONS = 100
"""Different reasons that are told at most."""
_MAY_REPEAT = 2


def study_page(facts: StudyFacts) -> Page:
    """Return the page of a study, whatever it holds: no trial, one, or ten thousand."""
    sections: list[Section | None] = [_progress(facts)]
    if facts.best is not None:
        sections += [_searched(facts, facts.best), _repeats(facts), _best_fin(facts), _against(facts)]
    sections += [_trials(facts), _refused(facts), _settings(facts)]
    return Page(
        title=f"Study {facts.name}",
        lead=lead(facts),
        facts=Facts(_seen_first(facts), "large"),
        sections=[section for section in sections if section is not None],
        notes=facts.notes,
    )


def lead(facts: StudyFacts) -> list[str]:
    """Return in sentences what a study found."""
    best = facts.best
    if not facts.trials:
        return ["No trial was begun yet."]
    if best is None:
        return [f"No trial has a score yet, of {counted(len(facts.trials), 'trial')}."]
    said = f"The best of {counted(len(facts.scored), 'fin')}: {show_values(best.values)}, {_told(facts.goal, best)}."
    sentences = [said]
    others = [MEASURES[name].told(value) for name, value in best.measured.items() if name != facts.goal.name]
    if others:
        sentences.append(f"Of it was measured: {', '.join(others)}.")
    if best.missed:
        sentences.append(f"No fin meets all constraints; of the best, {' and '.join(best.missed)}.")
    return sentences


def _told(goal: Measure, candidate: Candidate) -> str:
    """Return how good a candidate is, with the standard deviation between its swims if it has several."""
    swims = sum(bool(trial.measured) for trial in candidate.trials)
    told = goal.told(candidate.measured[goal.name])
    if swims == 1:
        return told
    unit, factor = goal.shown_in
    spread = f"{study_figures.spread_of(goal, candidate) / factor:.2g} {unit}".rstrip()
    return f"{told} with a standard deviation of {spread} between {swims} swims"


def _seen_first(facts: StudyFacts) -> list[tuple[str, str]]:
    outcomes = Counter(trial.outcome for trial in facts.trials)
    seen = []
    if facts.best is not None:
        seen += [
            (f"best: {goal.words}", goal.shown(facts.best.measured[goal.name]))
            for goal in facts.settings.goals.measures
        ]
    seen += [
        ("fins", str(len(facts.tried))),
        ("trials", str(len(facts.trials))),
        *((outcome.value, str(outcomes[outcome])) for outcome in Outcome if outcomes[outcome]),
    ]
    started = [trial.started for trial in facts.trials if trial.started is not None]
    ended = [trial.ended for trial in facts.trials if trial.ended is not None]
    if started and ended:
        seen.append(("begun", f"{min(started):%Y-%m-%d %H:%M}"))
        seen.append(("last trial ended", f"{max(ended):%Y-%m-%d %H:%M}"))
    plant = facts.fish.get("plant")
    return [*seen, ("plant", str(plant))] if plant else seen


def _progress(facts: StudyFacts) -> Section:
    if not facts.trials:
        return Section("progress", "Progress", ["There is nothing to show yet: begin with the first trial."])
    algorithm = facts.settings.details.get("search.algorithm")
    of = " that meets all constraints" if facts.settings.goals.constraints else ""
    said = f"The {facts.goal.words} of each trial, and the best so far{of}."
    said += f" The search is {algorithm}." if algorithm else ""
    if facts.best is None:
        said = "No trial has a score; the marks at the bottom are trials without one."
    plot = Plot(study_figures.progress(facts.settings.goals, facts.trials, facts.best), said)
    return Section("progress", "Progress of the search", (), [plot])


def _searched(facts: StudyFacts, best: Candidate) -> Section:
    space, simulated, goal = facts.settings.space, facts.simulated, facts.goal
    curves = simulated.curves if simulated is not None else {}
    if curves:
        said = (
            "Behind the fins is what the simulator swims with all else as the best fin has it; where there is a gap, "
        )
        said += "no fin can be, by the study's conditions or the plant's ranges."
    elif simulated is not None and simulated.is_the_plant:
        said = f"The simulator's landscape is not drawn: of {goal.words} many swims at once tell nothing."
        said = simulated.trouble or said
    elif simulated is not None:
        said = "No simulated fish swam this study, so there is no landscape of the simulator behind the fins."
    else:
        said = "This study tells too little of its fish, fin or gait to compute the simulator's landscape."
    several = len(space.dimensions) > 1
    blocks: list[Block] = []
    if several:
        mapped = simulated.map if simulated is not None else None
        what = "The first two parameters" if len(space.dimensions) > _MAY_REPEAT else "Both parameters"
        behind = "; behind the fins what the simulator swims" if mapped is not None else ""
        plot = study_figures.chart(goal, space, facts.scored, best, mapped)
        blocks.append(Plot(plot, f"{what}, {goal.words} as colour{behind}.", 440))
    for dimension in space.dimensions:
        curve = curves.get(dimension.name)
        plot = study_figures.over(goal, dimension, facts.scored, best, curve)
        blocks.append(
            Plot(plot, f"{goal.words.capitalize()} over {in_words(dimension.name)[0]}.", 360, is_half=several)
        )
    if several:
        shown = min(len(facts.scored), study_figures.LINES)
        told = f"Each line is a fin, {shown} of them; what stands out is good."
        blocks.append(Plot(study_figures.parallel(goal, space, facts.scored, best), told))
        some = [facts.scored[place] for place in some_of(len(facts.scored))]
        good = [goal.direction * c.measured[goal.name] for c in some]
        shares = importances(space, [c.values for c in some], good)
        if shares:
            told = "Which parameter decides: how far the best tenth of the fins differs from all in each (PED-ANOVA)."
            blocks.append(Plot(study_figures.importance(shares), told, 120 + 40 * len(shares)))
    goals = facts.settings.goals.measures
    if len(goals) > 1:
        chosen = front(facts.tried)
        told = f"Fins than which none is better in {goals[0].words} and {goals[1].words} at once: the Pareto front."
        if len(goals) > len(goals[:2]):
            told = f"The Pareto front of {', '.join(goal.words for goal in goals)}; here the first two of them."
        blocks.append(Plot(study_figures.front(facts.tried, chosen, goals[:2]), told))
    return Section("searched", f"{goal.words.capitalize()} over what was searched", [said], blocks)


def _repeats(facts: StudyFacts) -> Section:
    repeated = [c for c in facts.scored if sum(trial.score is not None for trial in c.trials) > 1]
    if not repeated:
        spreads = [trial.spread for trial in facts.trials if trial.spread is not None]
        said = "Each fin has one swim with a score, so there is no spread between repeats."
        if spreads:
            middle = f"{statistics.median(spreads) / CM:.2g} cm/s (median)"
            said += f" Within a swim the speed's standard deviation from block to block is {middle}."
        return Section("repeats", "Repeats", [said])
    some = sorted(repeated, key=rank, reverse=True)[:_REPEATED]
    unit, factor = facts.goal.shown_in
    spreads = [study_figures.spread_of(facts.goal, candidate) / factor for candidate in repeated]
    said = (
        f"{counted(len(repeated), 'fin')} swam more than once; the standard deviation between the swims of a fin is "
        f"{statistics.median(spreads):.2g} {unit} (median), at most {max(spreads):.2g} {unit}."
    )
    of = f"The {len(some)} best of them" if len(some) < len(repeated) else "All of them"
    return Section(
        "repeats", "Repeats", [said], [Plot(study_figures.repeats(facts.goal, some), f"{of}, the best first.")]
    )


def _best_fin(facts: StudyFacts) -> Section | None:
    simulated = facts.simulated
    if simulated is None:
        return None
    said = ["Computed by the simulator, with the fish that swam the study."]
    if not simulated.is_the_plant:
        said = [f"Computed by the simulator with {simulated.swimmer}: it did not swim this study."]
        if simulated.swimmer == DEFAULT_FISH:
            said[0] += " Its body is another; `report --fish` takes the one that `calibrate` has fitted."
    blocks: list[Block] = []
    if simulated.film is not None:
        blocks.append(Film(simulated.film, "The best fin's swim from above: body, driven tail and bending fin."))
        blocks.append(Facts(simulated.numbers))
    else:
        said = [f"The simulator cannot swim the best fin: {simulated.trouble}."]
    return Section("best", "The best fin", said, blocks)


def _against(facts: StudyFacts) -> Section | None:
    if not facts.pairs or facts.simulated is None:
        return None
    if facts.simulated.is_the_plant:
        said = "The simulator swam the trials through the whole graph, and again alone for this page."
    else:
        said = "Measured is what the plant swam; simulated is the simulator with "
        said += f"{facts.simulated.swimmer} and the same fin and gait."
    plot = Plot(
        study_figures.against(facts.simulated.measure, facts.pairs),
        "On the dashed line both are equal; bars are one standard deviation between a fin's swims.",
    )
    return Section("measured", "Simulated against measured", [said, facts.transfer.text], [plot])


# -- tables ------------------------------------------------------------------------------------------------------------


def _measured(of: Measure, value: float | None) -> Cell:
    return Cell("" if value is None else f"{value / of.shown_in[1]:.4g}", value)


def _trials(facts: StudyFacts) -> Section | None:
    if not facts.trials:
        return None
    chosen = _chosen(facts)
    names = varied(facts.settings, [trial.values for trial in chosen])
    columns = [Column("trial"), Column("fin"), *(_column(name) for name in names), Column("outcome", is_number=False)]
    columns += [Column("speed", "cm/s"), Column("± within", "cm/s", is_minor=True)]
    asked = [each for each in facts.settings.goals.asked if each.name != MEAN_SPEED]
    columns += [Column(each.words, each.shown_in[0]) for each in asked]
    several = len({trial.plant for trial in facts.trials}) > 1
    columns += [Column("plant", is_number=False, is_minor=True)] if several else []
    columns += [Column("begun", is_number=False, is_minor=True), Column("bag", is_number=False, is_minor=True)]
    best = facts.best
    rows: list[list[Cell]] = []
    marked = None
    for trial in chosen:
        told = facts.settings.told(trial.values)
        row = [Cell(f"{trial.number:04d}", trial.number), Cell(str(trial.candidate + 1), trial.candidate)]
        row += [_value(told.get(name), name) for name in names]
        row += [Cell(trial.outcome.value), _speed(trial.score), _speed(trial.spread, 2)]
        row += [_measured(each, trial.measured.get(each.name)) for each in asked]
        row += [Cell(trial.plant)] if several else []
        begun = trial.started
        row.append(Cell(f"{begun:%m-%d %H:%M:%S}", begun.timestamp()) if begun is not None else Cell(""))
        row.append(Cell("bag", trial.number, trial.bag) if trial.bag in facts.bags else Cell(""))
        if best is not None and trial.candidate == best.number and marked is None:
            marked = len(rows)
        rows.append(row)
    note = ""
    if len(chosen) < len(facts.trials):
        note = (
            f"The {len(chosen)} best of {len(facts.trials)} trials; all of them stand in trials.csv, which "
            "`export` of fin_optimizer writes too."
        )
    return Section("trials", "Trials", (), [Table(columns, rows, note, marked)])


def _chosen(facts: StudyFacts) -> list[TrialRecord]:
    """Return the trials that the table holds: all as they were begun, or of many the best."""
    if len(facts.trials) <= _ROWS:
        return list(facts.trials)
    goal = facts.goal
    good = {t.number: goal.direction * t.measured[goal.name] for t in facts.trials if t.measured}
    return sorted(facts.trials, key=lambda t: (t.number not in good, -good.get(t.number, 0.0), t.number))[:_ROWS]


def _column(name: str) -> Column:
    word, _, unit = in_words(name)
    return Column(word, unit)


def _value(value: object, name: str) -> Cell:
    if value is None:
        return Cell("")
    factor = in_words(name)[1]
    return Cell(show_number(value, factor), float(value) if isinstance(value, int | float) else None)


def _speed(value: float | None, digits: int = 4) -> Cell:
    return Cell("" if value is None else f"{value / CM:.{digits}g}", value)


def _refused(facts: StudyFacts) -> Section:
    without = facts.without_score
    if not without:
        return Section("refused", "Refused and failed", ["Every trial that ended has a score: nothing was refused."])
    reasons: dict[tuple[str, str], list[TrialRecord]] = {}
    for trial in without:
        reasons.setdefault((trial.outcome.value, trial.reason), []).append(trial)
    ranked = sorted(reasons.items(), key=lambda item: (-len(item[1]), item[1][0].number))
    rows = [
        [
            Cell(outcome),
            Cell(str(len(some)), len(some)),
            Cell(_names(some), some[0].number),
            Cell(show_values(some[0].values)),
            Cell(reason or "no reason is known"),
        ]
        for (outcome, reason), some in ranked[:_REASONS]
    ]
    columns = [
        Column("outcome", is_number=False),
        Column("trials"),
        Column("numbers", is_number=False),
        Column("the first of them", is_number=False, is_minor=True),
        Column("why", is_number=False),
    ]
    said = "INFEASIBLE: refused. FAILED: no score, which counts as an attempt. INTERRUPTED: for no reason of the fin's."
    note = f"{len(ranked) - _REASONS} more reasons stand in trials.csv." if len(ranked) > _REASONS else ""
    return Section("refused", "Refused and failed", [said], [Table(columns, rows, note)])


def _names(trials: Sequence[TrialRecord]) -> str:
    numbers = ", ".join(f"{trial.number:04d}" for trial in trials[:5])
    return f"{numbers} and {len(trials) - 5} more" if len(trials) > 5 else numbers  # noqa: PLR2004


def _settings(facts: StudyFacts) -> Section:
    blocks: list[Block] = [listed(facts.settings.flat(), "Study")]
    said = ["What decides candidates and scores: it cannot change while a study goes on."]
    seed = facts.settings.details.get("seed")
    if seed is not None:
        said.append(f"Seed {seed}: with it, and what was tried before, each candidate can be computed again.")
    if facts.fish:
        blocks.append(listed(facts.fish, "Fish"))
    if facts.versions:
        said.append(f"Versions are {facts.versions_of}.")
        blocks.append(listed(facts.versions, "Versions"))
    return Section("settings", "Parameters, versions, seed", said, blocks)


def listed(content: Mapping[str, object], title: str) -> Facts:
    """Return many names with their units and values."""
    return Facts([(_with_unit(name), _text(value)) for name, value in content.items()], "list", title)


def _with_unit(name: str) -> str:
    """Return a parameter's name with its SI unit, of the fish and of the study's own too."""
    known = node_table("fin_sim", "simulator"), node_table("fin_optimizer", "optimizer")
    unit = next((table[name].unit for table in known if name in table), "")
    return f"{name} [{unit}]" if unit else with_unit(name)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else json.dumps(value, default=str)
