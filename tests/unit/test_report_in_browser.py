"""The report in a real Chromium: it opens without a complaint or a request, light and dark, on a phone and on paper."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.report.page import html_of
from fin_optimizer.report.parts import Film, Plot, Table
from fin_optimizer.report.study_facts import simulate
from fin_optimizer.report.study_page import study_page
from fin_optimizer.search.space import Space
from fin_optimizer.study.settings import Settings
from fin_plant.fin import FIN_PARAMETERS, node_table
from support.browser import CHROMIUM, browser
from support.report_facts import DETAILS, EMPTY, LENGTH, MODULUS, ONE, TEN_THOUSAND, TYPICAL, WITHOUT_SCORE, scored

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from fin_optimizer.report.study_facts import StudyFacts
    from support.browser import Browser

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium"),
]
DRAWN = "document.documentElement.dataset.drawn === 'all'"
PAPER_WIDTH = 703
"""px of A4 between margins of 12 mm, at 96 px an inch."""


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def page(tab: Browser) -> Browser:
    tab.complaints.clear()
    tab.requests.clear()
    tab.look(1200, 900)
    return tab


def swum() -> StudyFacts:
    """Return a study of two parameters with all that the simulator tells of it."""
    table = node_table("fin_sim", "simulator")
    fish = {name: table[name].default for name in table.deciding_swims - FIN_PARAMETERS.keys()}
    fin = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
    gait = {"gait.frequency": 2.0, "gait.amplitude": 0.2}
    settings = Settings(Space((MODULUS, LENGTH)), details={**DETAILS, **fin, **gait, "fin.area": 2e-3})
    trials = [replace(each, values={name: each.values[name] for name in settings.space.names}) for each in scored(30)]
    return replace(TYPICAL, settings=settings, trials=trials, fish=fish, simulated=simulate(settings, trials, fish))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(html_of(study_page(swum())))
    return path


@pytest.mark.parametrize("facts", [EMPTY, WITHOUT_SCORE, ONE, TYPICAL, TEN_THOUSAND], ids=lambda facts: facts.name)
def test_any_study_opens_without_a_complaint_and_asks_for_nothing(
    facts: StudyFacts, page: Browser, tmp_path: Path
) -> None:
    made = study_page(facts)
    path = tmp_path / "report.html"
    path.write_text(html_of(made))
    page.ask("Performance.enable", timeDomain="threadTicks")
    page.open(path, DRAWN)
    painted, opened, drawn = (
        page.tell(f"performance.getEntriesByName('{mark}')[0]?.startTime")
        for mark in ("first-contentful-paint", "report-open", "report-drawn")
    )
    taken = {each["name"]: each["value"] for each in page.ask("Performance.getMetrics")["metrics"]}
    sys.stdout.write(
        f"{facts.name}: text after {painted or opened:.0f} ms, open after {opened:.0f} ms, "
        f"all plots after {drawn or opened:.0f} ms, {1e3 * taken['TaskDuration']:.0f} ms of its own thread\n"
    )
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:application/gzip", "blob:"))] == []
    blocks = [block for section in made.sections for block in section.blocks]
    plots = sum(isinstance(block, Plot) for block in blocks)
    assert page.tell("document.querySelectorAll('.drawing.js-plotly-plot').length") == plots
    assert page.tell("document.querySelectorAll('table').length") == sum(isinstance(b, Table) for b in blocks)
    assert page.tell("document.querySelectorAll('canvas').length") == sum(isinstance(b, Film) for b in blocks)
    assert page.tell("document.getElementById('trouble').hidden")


def test_a_browser_that_runs_no_file_out_of_its_memory_draws_all_the_same(
    page: Browser, file: Path, tmp_path: Path
) -> None:
    text = file.read_text()
    assert text.count("'unsafe-inline' blob:") == 1
    strict = tmp_path / "strict.html"
    strict.write_text(text.replace("'unsafe-inline' blob:", "'unsafe-inline'"))
    page.open(strict, DRAWN)
    assert any("blob:" in complaint for complaint in page.complaints)
    assert page.tell("document.querySelectorAll('.drawing.js-plotly-plot').length") == 7


def test_each_plot_shows_its_points_lines_or_bars(page: Browser, file: Path) -> None:
    page.open(file, DRAWN)
    marks = "d.querySelectorAll('.point, .js-line, .contourlevel').length"
    drawn = page.tell(f"[...document.querySelectorAll('.drawing')].map((d) => {marks})")
    assert len(drawn) == 7
    assert min(drawn) > 0


def test_a_click_on_a_head_sorts_the_trials_both_ways(page: Browser, file: Path) -> None:
    page.open(file, DRAWN)
    heads = page.tell("[...document.querySelectorAll('#trials th')].map((head) => head.textContent.trim())")
    index = heads.index("speed (cm/s)")
    keys = f"Number(row.cells[{index}].dataset.sort)"
    column = f"[...document.querySelectorAll('#trials tbody tr')].map((row) => {keys})"
    click = f"document.querySelectorAll('#trials th button')[{index}].click()"
    page.tell(click)
    up = page.tell(column)
    page.tell(click)
    assert len(set(up)) > 10
    assert up == sorted(up)
    assert page.tell(column) == sorted(up, reverse=True)
    assert page.tell(f"document.querySelectorAll('#trials th')[{index}].getAttribute('aria-sort')") == "descending"


def test_the_film_plays_unless_somebody_wants_no_motion_and_then_on_demand(page: Browser, file: Path) -> None:
    place = "Number(document.querySelector('.film input').value)"
    page.open(file, DRAWN)
    page.tell("document.querySelector('.film').scrollIntoView()")
    page.wait_for(f"{place} > 3")
    page.look(1200, 900, still=True)
    page.open(file, DRAWN)
    page.tell("document.querySelector('.film').scrollIntoView()")
    before = page.tell(place)
    next_frame = "requestAnimationFrame(() => ++n > 20 ? done(n) : next())"
    page.tell(f"new Promise((done) => {{ let n = 0; const next = () => {next_frame}; next(); }})")
    assert page.tell(place) == before > 0
    page.tell("document.querySelector('.film .play').click()")
    page.wait_for(f"{place} > {before}")
    assert page.tell("document.querySelector('.film .play').textContent") == "pause"


def test_dark_is_dark_in_the_plots_too_and_follows_a_change(page: Browser, file: Path) -> None:
    grid = "getComputedStyle(document.querySelector('.drawing .gridlayer path')).stroke"
    words = "getComputedStyle(document.querySelector('.drawing .xtick text')).fill"
    ground = "getComputedStyle(document.body).backgroundColor"
    page.open(file, DRAWN)
    light = [page.tell(each) for each in (grid, words, ground)]
    page.look(1200, 900, dark=True)
    page.wait_for(f"{words} !== '{light[1]}'")
    dark = [page.tell(each) for each in (grid, words, ground)]
    assert dark == ["rgb(48, 57, 65)", "rgb(232, 236, 239)", "rgb(20, 24, 28)"]
    assert light[2] == "rgb(255, 255, 255)"


def test_a_phone_held_upright_scrolls_down_and_not_aside(page: Browser, file: Path) -> None:
    page.look(390, 800, phone=True)
    page.open(file, DRAWN)
    assert page.tell("document.documentElement.scrollWidth") == 390
    widths = page.tell(
        "[...document.querySelectorAll('.drawing .main-svg')].map((svg) => svg.getBoundingClientRect().right)"
    )
    assert max(widths) <= 390


def test_paper_has_no_cut_row_and_is_as_wide_as_a4_lets_it_be(page: Browser, file: Path, tmp_path: Path) -> None:
    page.look(PAPER_WIDTH, 1000, dark=True)
    page.open(file, DRAWN)
    page.tell("dispatchEvent(new Event('beforeprint'))")
    page.ask("Emulation.setEmulatedMedia", media="print")
    assert page.tell("document.documentElement.scrollWidth") <= PAPER_WIDTH
    assert page.tell("getComputedStyle(document.querySelector('#trials tbody tr')).breakInside") == "avoid"
    assert page.tell("getComputedStyle(document.body).color") == "rgb(27, 33, 38)"  # dark ink, whatever the screen is
    page.ask("Emulation.setEmulatedMedia", media="")
    page.tell("dispatchEvent(new Event('afterprint'))")
    page.pdf(tmp_path / "report.pdf")
    data = (tmp_path / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF")
    assert data.count(b"/Type /Page\n") >= 3
    assert page.complaints == []
