"""The page of several studies side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_optimizer.goals import Goals
from fin_optimizer.report import several_figures
from fin_optimizer.report.parts import Cell, Column, Facts, Page, Plot, Section, Table
from fin_optimizer.report.study_page import lead
from fin_optimizer.words import CM, in_words, show_speed, show_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.report.parts import Block
    from fin_optimizer.report.study_facts import StudyFacts


def comparison_page(studies: Sequence[StudyFacts]) -> Page:
    """Return the page of several studies, two at least."""
    names = distinct([study.name for study in studies])
    fastest = [max((c.score for c in study.scored if c.score is not None), default=None) for study in studies]
    ranked = sorted((speed, name) for speed, name in zip(fastest, names, strict=True) if speed is not None)
    said = [f"{ranked[-1][1]} found the fastest fin: {show_speed(ranked[-1][0])}."] if ranked else []
    if any(study.settings.goals != Goals() for study in studies):
        said.append("Not all of them looked for speed alone: the best fin of each is that by its own goals.")
    if len({tuple(sorted(map(str, study.fish.items()))) for study in studies}) > 1:
        said.append("Not the same fish swam them, so their speeds tell of the fish as well as of the fins.")
    parts = (_studies, _progress, _searched, _settings)
    sections = [part(names, studies) for part in parts]
    return Page(
        title=f"{len(studies)} studies side by side",
        lead=said or ["No study has a score yet."],
        facts=Facts(
            [(name, "no score" if s is None else show_speed(s)) for name, s in zip(names, fastest, strict=True)],
            "large",
        ),
        sections=[section for section in sections if section is not None],
        notes=[f"{name}: {note}" for name, study in zip(names, studies, strict=True) for note in study.notes],
    )


def distinct(names: Sequence[str]) -> list[str]:
    """Return names of which none is twice: those that are get their place."""
    return [name if names.count(name) == 1 else f"{name} ({place})" for place, name in enumerate(names, start=1)]


def _studies(names: Sequence[str], studies: Sequence[StudyFacts]) -> Section:
    columns = [
        Column("study", is_number=False),
        Column("search", is_number=False),
        Column("seed"),
        Column("plant", is_number=False),
        Column("fins"),
        Column("trials"),
        Column("speed of the best", "cm/s"),
        Column("±", "cm/s"),
        Column("best fin", is_number=False),
    ]
    rows = []
    for name, study in zip(names, studies, strict=True):
        best, details = study.best, study.settings.details
        score = None if best is None else best.score
        spread = None if best is None else best.spread
        rows.append(
            [
                Cell(name),
                Cell(str(details.get("search.algorithm", "hill_climber"))),
                Cell(str(details.get("seed", ""))),
                Cell(str(study.fish.get("plant", ""))),
                Cell(str(len(study.tried)), len(study.tried)),
                Cell(str(len(study.trials)), len(study.trials)),
                Cell("" if score is None else f"{score / CM:.4g}", score),
                Cell("" if spread is None else f"{spread / CM:.2g}", spread),
                Cell(show_values(best.values) if best is not None else " ".join(lead(study))),
            ]
        )
    return Section("studies", "The studies", (), [Table(columns, rows)])


def _progress(names: Sequence[str], studies: Sequence[StudyFacts]) -> Section | None:
    known = [(name, study) for name, study in zip(names, studies, strict=True) if study.best is not None]
    if not known:
        return None
    some = [(name, study.trials) for name, study in known]
    over = Plot(several_figures.progress_of_several(some), "The best speed so far, over the number of the trial.")
    all_fins = Plot(
        several_figures.spread_of_several([(name, study.scored) for name, study in known]),
        "The speed of every fin with a score; the box holds the middle half of them.",
    )
    return Section("progress", "Progress of the searches", (), [over, all_fins])


def _searched(names: Sequence[str], studies: Sequence[StudyFacts]) -> Section | None:
    """Return the speed over each parameter that two studies at least have searched alike, by kind and unit."""
    kinds: dict[tuple[str, type], list[tuple[str, StudyFacts]]] = {}
    for name, study in zip(names, studies, strict=True):
        for dimension in study.settings.space.dimensions if study.best is not None else ():
            kinds.setdefault((dimension.name, type(dimension)), []).append((name, study))
    blocks: list[Block] = []
    for (parameter, _), some in kinds.items():
        if len(some) > 1:
            fins = [(names.index(name), name, study.settings.space, study.scored) for name, study in some]
            plot = several_figures.over_of_several(parameter, fins)
            blocks.append(Plot(plot, f"Speed over {in_words(parameter)[0]}.", 400, is_half=True))
    if not blocks:
        return Section("searched", "Speed over what was searched", ["No two of them have searched the same parameter."])
    return Section("searched", "Speed over what was searched", (), blocks)


def _settings(names: Sequence[str], studies: Sequence[StudyFacts]) -> Section:
    """Return in what settings and fish differ."""
    flat = [{**study.settings.flat(), **{f"fish: {n}": v for n, v in study.fish.items()}} for study in studies]
    every = dict.fromkeys(name for settings in flat for name in settings)
    differ = [name for name in every if len({str(settings.get(name, "")) for settings in flat}) > 1]
    if not differ:
        return Section("settings", "Settings", ["All settings and the fish are the same."])
    columns = [Column("setting", is_number=False), *(Column(name, is_number=False) for name in names)]
    rows = [[Cell(name), *(Cell(str(settings.get(name, "not set"))) for settings in flat)] for name in differ]
    said = f"{len(every) - len(differ)} of {len(every)} settings are the same; these differ."
    return Section("settings", "Settings that differ", [said], [Table(columns, rows)])
