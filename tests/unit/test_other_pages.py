"""Reports of several studies, of a campaign, and of a study that looks for something else than speed; the command."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.commands import report
from fin_optimizer.goals import Goals
from fin_optimizer.paper.experiments import Campaign, Run
from fin_optimizer.paper.space_campaign import SpaceCampaign, perform
from fin_optimizer.report import space_campaign_page as pages
from fin_optimizer.report.campaign_page import campaign_page
from fin_optimizer.report.comparison_page import comparison_page, distinct
from fin_optimizer.report.page import html_of
from fin_optimizer.report.parts import Facts, Film, Plot, Table
from fin_optimizer.report.space_campaign_page import space_campaign_page
from fin_optimizer.report.study_facts import StudyFacts
from fin_optimizer.report.study_page import study_page
from fin_optimizer.study.settings import Settings
from support.report_facts import DETAILS, EMPTY, SPACE, TYPICAL, scored
from support.source_tree import SOURCE

if TYPE_CHECKING:
    from pathlib import Path

    from fin_optimizer.report.parts import Page, Section


def section(page: Page, anchor: str) -> Section:
    return next(each for each in page.sections if each.anchor == anchor)


# -- several studies ---------------------------------------------------------------------------------------------------


def test_several_studies_stand_side_by_side_with_what_differs() -> None:
    other = replace(TYPICAL, settings=Settings(SPACE, details={**DETAILS, "seed": 8}))
    page = comparison_page([TYPICAL, other, EMPTY])
    names = [f"{TYPICAL.name} (1)", f"{TYPICAL.name} (2)", "empty"]
    (table,) = section(page, "studies").blocks
    assert isinstance(table, Table)
    assert [row[0].text for row in table.rows] == names
    (differ,) = section(page, "settings").blocks
    assert isinstance(differ, Table)
    assert ["seed", "7", "8", "7"] in [[cell.text for cell in row] for row in differ.rows]
    shared = [block for block in section(page, "searched").blocks if isinstance(block, Plot)]
    assert len(shared) == len(SPACE.dimensions)
    written = "typical &lt;&amp;&gt;"
    assert [trace["name"] for trace in shared[0].figure["data"]] == [f"{written} (1)", f"{written} (2)"]
    assert "typical <&> (2)" not in html_of(page)


def test_names_that_are_there_twice_get_their_place() -> None:
    assert distinct(["a", "b", "a"]) == ["a (1)", "b", "a (3)"]


def test_studies_without_a_score_can_be_compared_too() -> None:
    page = comparison_page([EMPTY, replace(EMPTY, name="another")])
    assert page.lead == ["No study has a score yet."]
    assert html_of(page)


# -- what else is good -------------------------------------------------------------------------------------------------


def test_a_study_for_another_goal_speaks_of_that_and_its_best_meets_the_constraints() -> None:
    goals = Goals.of(["energy_per_metre"], ["mean_speed >= 1.5 cm/s"])
    costs = [3.0, 0.5, 2.0, 1.0, 4.0]
    speeds = [0.02, 0.01, 0.02, 0.02, 0.02]  # the cheapest is too slow
    trials = [
        replace(each, measured={"mean_speed": speed, "energy_per_metre": cost})
        for each, speed, cost in zip(scored(5), speeds, costs, strict=True)
    ]
    facts = StudyFacts("cheap", Settings(SPACE, details=DETAILS, goals=goals), trials)
    assert facts.best is not None
    assert facts.best.number == 3
    page = study_page(facts)
    assert "energy per metre 1.000 J/m" in page.lead[0]
    assert ("best: energy per metre", "1.000 J/m") in page.facts.entries
    plots = [block for each in page.sections for block in each.blocks if isinstance(block, Plot)]
    assert plots[0].figure["layout"]["yaxis"]["title"]["text"] == "energy per metre (J/m)"
    so_far = next(trace for trace in plots[0].figure["data"] if trace["name"] == "best so far")
    assert so_far["y"] == [3.0, 2.0, 1.0, 1.0], "0.5 J/m is too slow"
    assert section(page, "searched").title == "Energy per metre over what was searched"
    assert html_of(page)


def test_the_fastest_fin_of_several_studies_is_so_whatever_each_looked_for() -> None:
    trials = [
        replace(each, measured={"mean_speed": speed, "energy_per_metre": cost})
        for each, speed, cost in zip(scored(2), [0.05, 0.02], [3.0, 1.0], strict=True)
    ]
    cheap = StudyFacts("cheap", Settings(SPACE, details=DETAILS, goals=Goals.of(["energy_per_metre"])), trials)
    fast = StudyFacts("fast", Settings(SPACE, details=DETAILS), [replace(trials[1], measured={"mean_speed": 0.04})])
    page = comparison_page([cheap, fast])
    assert page.lead[0] == "cheap found the fastest fin: 5.000 cm/s."
    assert "by its own goals" in page.lead[1]
    assert page.facts.entries[0] == ("cheap", "5.000 cm/s")


# -- a campaign --------------------------------------------------------------------------------------------------------


def table(run: Run, speeds: list[float]) -> dict[str, np.ndarray]:
    count = len(speeds)
    return {
        "generation": np.zeros(count),
        "candidate": np.arange(float(count)),
        "young_modulus": np.linspace(1e9, 9e9, count) + run.number,
        "length": np.linspace(0.05, 0.13, count),
        "height": np.linspace(0.04, 0.02, count),
        "speed": np.array(speeds),
    }


def test_a_campaign_has_its_runs_its_best_fin_and_what_has_no_speed() -> None:
    campaign = Campaign(genetic_runs=2)
    runs = [Run("shape", number, campaign) for number in range(2)]
    results = {runs[0]: table(runs[0], [0.010, 0.012, 0.011]), runs[1]: table(runs[1], [0.009, np.nan, 0.013])}
    page = campaign_page("mine", campaign, results, {"version.numpy": "2"})
    (runs_table,) = section(page, "runs").blocks
    assert isinstance(runs_table, Table)
    assert [row[4].text for row in runs_table.rows] == ["1.2", "1.3"]
    (lost,) = section(page, "refused").blocks
    assert isinstance(lost, Table)
    assert [cell.text for cell in lost.rows[0]] == ["shape", "1", "1"]
    assert "13 cm long" in section(page, "best").paragraphs[0]
    numbers = section(page, "best").blocks[1]
    assert isinstance(numbers, Facts)
    assert "Strouhal number" in dict(numbers.entries)
    assert f"Seed {campaign.seed}" in section(page, "settings").paragraphs[0]
    assert len(html_of(page)) < 5_000_000


def test_a_campaign_over_a_space_is_a_page_like_a_studys_with_its_runs() -> None:
    space = SOURCE / "fin_optimizer/config/drawer_of_sheets.yaml"
    campaign = SpaceCampaign.of_file(space, algorithm="random", runs=2, swims=6, duration=2.0)
    results = {run: perform([run])[0] for run in campaign.planned()}
    page = space_campaign_page("drawer", campaign, results, {"version.numpy": "2"})
    assert page.lead[-1] == "12 swims of 2 runs."
    (runs,) = section(page, "runs").blocks
    assert isinstance(runs, Table)
    assert [row[0].text for row in runs.rows] == ["random-000", "random-001"]
    assert sum(isinstance(block, Plot) for block in section(page, "searched").blocks) >= 1 + len(
        campaign.start.space.names
    )
    assert any(isinstance(block, Film) for block in section(page, "best").blocks)
    assert html_of(page)


def test_a_campaign_of_many_swims_shows_all_that_raise_the_best_and_says_how_many_have_no_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pages, "_MOST", 3)
    space = SOURCE / "fin_optimizer/config/drawer_of_sheets.yaml"
    campaign = SpaceCampaign.of_file(space, algorithm="random", runs=1, swims=12, duration=1.0)
    (run,) = campaign.planned()
    table = perform([run])[0]
    speeds = np.array([1.0, 2.0, 1.0, np.nan, 3.0, 1.0, 1.0, 4.0, 1.0, 5.0, np.nan, 1.0]) / 100.0
    page = space_campaign_page("drawer", campaign, {run: {**table, "mean_speed": speeds}}, {})
    assert page.lead[-1] == "12 swims of 1 run, of which the page shows 8; 2 have no value."
    plot = next(block for block in section(page, "progress").blocks if isinstance(block, Plot))
    so_far = next(trace for trace in plot.figure["data"] if trace["name"] == "best so far")
    assert so_far["y"] == [1.0, 2.0, 3.0, 4.0, 5.0, 5.0]
    assert "nothing was refused" not in section(page, "refused").paragraphs[0]


# -- the command -------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_campaign_into_its_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "campaign"
    (folder / "runs").mkdir(parents=True)
    (folder / "study.json").write_text(json.dumps(asdict(Campaign())))
    assert report.main([str(folder)]) == 0
    assert capsys.readouterr().out == f"report: {folder / 'report.html'}\n"
    assert "0 runs of 0 experiments" in (folder / "report.html").read_text()


@pytest.mark.parametrize("content", ["", "[]", '{"seed": -1}'])
def test_a_campaign_that_cannot_be_read_is_refused(
    content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "study.json").write_text(content)
    assert report.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("report: error: ")
    assert not (tmp_path / "report.html").exists()


def test_a_folder_without_a_study_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report.main([str(tmp_path)]) == 2
    assert "holds no study" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_device_is_not_replaced_by_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert report.main([str(tmp_path), "--output", str(pipe)]) == 2
    assert "is no file that a page could replace" in capsys.readouterr().err
    assert pipe.is_fifo()
