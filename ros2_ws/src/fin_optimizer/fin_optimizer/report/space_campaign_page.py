"""The page of a campaign over the space of a file: that of a study whose trials are all its runs' swims."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.paper.space_campaign import swim_candidates
from fin_optimizer.report.film import film_of
from fin_optimizer.report.marks import some_of
from fin_optimizer.report.parts import Cell, Column, Page, Section, Table
from fin_optimizer.report.simulated import Simulated, curves_through, map_of, numbers_of
from fin_optimizer.report.study_facts import StudyFacts
from fin_optimizer.report.study_page import study_page
from fin_optimizer.search.rules import gait_of
from fin_optimizer.study.candidate import Candidate, TrialRecord, best_of, candidates, improvements
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome
from fin_optimizer.words import show_values
from fin_plant.checks import counted
from fin_plant.fin import Fin
from fin_sim.swim import swim

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from fin_optimizer.goals import Goals
    from fin_optimizer.paper.space_campaign import SpaceCampaign, SpaceRun
    from fin_optimizer.paper.space_campaign import Table as RunTable

_MOST = 3000
"""Swims that the page shows at most, evenly chosen; beside them the best of each run, and all that raise the best."""
_NO_VALUE = "its swim settles at no time step, or has no value of what is asked for"


def space_campaign_page(
    name: str, campaign: SpaceCampaign, results: Mapping[SpaceRun, RunTable], versions: Mapping[str, str]
) -> Page:
    """Return the page of a campaign.

    Args:
        name: What it is called: its folder's name.
        campaign: What it is.
        results: Its finished runs.
        versions: Of what writes the page; a campaign keeps none.
    """
    plan, goals = campaign.start, campaign.wanted
    details = {"search.algorithm": campaign.algorithm, "seed": campaign.seed, **plan.start}
    details |= {"measurement.settle": campaign.settle, "measurement.duration": campaign.duration - campaign.settle}
    settings = Settings(plan.space, details=details, goals=goals, rules=plan.rules)
    runs = sorted(results, key=lambda run: run.number)
    swims = [_swims(run, results[run], first) for run, first in zip(runs, _firsts(runs, results), strict=True)]
    bests = [best_of(candidates(each, goals)) for each in swims]
    every = [trial for each in swims for trial in each]
    chosen = {every[place].number for place in some_of(len(every), _MOST)}
    chosen |= {best.number for best in bests if best is not None}
    chosen |= {trial.number for trial in _turns(every, goals)}
    facts = StudyFacts(
        name,
        settings,
        [trial for trial in every if trial.number in chosen],
        {"plant": f"batch simulator, fish {campaign.fish}"},
        versions,
        "those of the program that wrote this page: a campaign keeps none",
    )
    if facts.best is not None:
        facts = replace(facts, simulated=_simulated(campaign, settings, facts.best))
    page = study_page(facts)
    said = f"{counted(len(every), 'swim')} of {counted(len(runs), 'run')}"
    said += f", of which the page shows {len(facts.trials)}" if len(facts.trials) < len(every) else ""
    lost = sum(not trial.measured for trial in every)
    said += f"; {lost} have no value." if lost else "."
    sections = [page.sections[0], _runs(runs, swims, bests), *page.sections[1:]]
    return replace(page, title=f"Campaign {name}", lead=[*page.lead, said], sections=sections)


def _turns(trials: Sequence[TrialRecord], goals: Goals) -> Iterator[TrialRecord]:
    """Yield the trials that are better than all before them, and the first without a value."""
    allowed = (trial for trial in trials if trial.measured and not goals.missed(trial.measured))
    yield from improvements(goals.measures[0], allowed)
    yield from [trial for trial in trials if not trial.measured][:1]


def _firsts(runs: Sequence[SpaceRun], results: Mapping[SpaceRun, RunTable]) -> list[int]:
    """Return the number of each run's first swim among all."""
    sizes = [len(results[run]["candidate"]) for run in runs]
    return np.cumsum([0, *sizes])[:-1].tolist() if sizes else []


def _swims(run: SpaceRun, table: RunTable, first: int) -> list[TrialRecord]:
    """Return the swims of a run as trials, numbered from ``first`` on."""
    space, asked = run.campaign.start.space, [each.name for each in run.campaign.wanted.asked]
    rows = np.column_stack([table[name] for name in space.names]).tolist()
    found = np.column_stack([table[name] for name in asked])
    trials = []
    for place, (row, numbers) in enumerate(zip(rows, found.tolist(), strict=True)):
        is_known = bool(np.isfinite(numbers).all())
        trials.append(
            TrialRecord(
                number=first + place,
                candidate=first + place,
                values=space.values(row),
                outcome=Outcome.OK if is_known else Outcome.FAILED,
                reason="" if is_known else _NO_VALUE,
                measured=dict(zip(asked, numbers, strict=True)) if is_known else {},
                spread=None,
                samples=0,
                plant=run.name,
                bag="",
                started=None,
                ended=None,
            )
        )
    return trials


def _simulated(campaign: SpaceCampaign, settings: Settings, best: Candidate) -> Simulated:
    """Return the batch simulator's landscape around the best, and its swim."""
    space, goal = campaign.start.space, settings.goals.measures[0]

    def told(some: Sequence[Mapping[str, Any]]) -> list[float]:
        values = np.full(len(some), np.nan)
        able = [index for index, each in enumerate(some) if not space.judge(each)]
        if able:
            numbers = np.array([space.row(some[index]) for index in able])
            values[able] = swim_candidates(campaign, numbers)[goal.name]
        return values.tolist()

    curves, chart = curves_through(space, best.values, told), map_of(space, best.values, told)
    sent = {**campaign.start.start, **settings.sent(best.values)}
    given = campaign.given
    try:
        fin, gait = Fin.from_parameters(sent), gait_of(sent)
        swum = swim(fin, given.fish, gait, campaign.duration, reactive=given.reactive)
    except (ArithmeticError, ValueError) as error:
        return Simulated(curves, chart, {}, None, (), is_the_plant=True, measure=goal, trouble=str(error))
    offset = given.fish.body.tail_offset
    film = film_of(swum, (2.0 * offset, 0.6 * offset))
    return Simulated(curves, chart, {}, film, numbers_of(swum, campaign.settle), is_the_plant=True, measure=goal)


def _runs(
    runs: Sequence[SpaceRun], swims: Sequence[Sequence[TrialRecord]], bests: Sequence[Candidate | None]
) -> Section:
    rows = []
    for run, tried, best in zip(runs, swims, bests, strict=True):
        row = [Cell(run.name), Cell(str(run.seed)), Cell(str(len(tried)), len(tried))]
        row.append(Cell("" if best is None else best.shown))
        row.append(Cell("" if best is None else show_values(best.values)))
        rows.append(row)
    columns = [Column("run", is_number=False), Column("seed", is_minor=True), Column("swims")]
    columns += [Column("its best", is_number=False), Column("at", is_number=False)]
    return Section("runs", "Runs", (), [Table(columns, rows)])
