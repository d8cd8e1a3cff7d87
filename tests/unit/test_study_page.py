"""The report of a study: one file that needs nothing else, and says what the study found whatever it holds."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from fin_optimizer.goals import Goals
from fin_optimizer.report import marks, study_facts
from fin_optimizer.report.film import film_of
from fin_optimizer.report.page import html_of, unwrapped
from fin_optimizer.report.parts import Facts, Film, Page, Plot, Section, Table
from fin_optimizer.report.simulated import KeptSpeeds, Map, map_of, numbers_of, to_swim_again
from fin_optimizer.report.study_facts import StudyFacts, simulate
from fin_optimizer.report.study_page import study_page
from fin_optimizer.search.space import Space
from fin_optimizer.study.settings import Settings
from fin_plant.fin import FIN_PARAMETERS, node_table
from fin_plant.gait import carangiform
from fin_sim.swim import swim
from support.report_facts import (
    DETAILS,
    EMPTY,
    LENGTH,
    MODULUS,
    ONE,
    SETTINGS,
    SIMULATED,
    SPACE,
    TEN_THOUSAND,
    TYPICAL,
    WITHOUT_SCORE,
    scored,
    trial,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

LARGEST_PAGE = 5_000_000


class Seen(HTMLParser):
    """What a page holds: its elements, what they refer to, and the text of each script."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[str] = []
        self.references: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.references += [value or "" for name, value in attrs if name in {"src", "href", "action", "data", "srcset"}]

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def seen(text: str) -> Seen:
    parser = Seen()
    parser.feed(text)
    parser.close()
    return parser


def section(page: Page, anchor: str) -> Section:
    return next(each for each in page.sections if each.anchor == anchor)


def of_kind(page: Page, kind: type) -> list[Any]:
    return [block for each in page.sections for block in each.blocks if isinstance(block, kind)]


@pytest.mark.parametrize("facts", [EMPTY, WITHOUT_SCORE, ONE, TYPICAL, TEN_THOUSAND], ids=lambda facts: facts.name)
def test_a_page_is_one_small_file_that_refers_to_nothing_outside(facts: StudyFacts) -> None:
    text = html_of(study_page(facts))
    assert len(text.encode()) < LARGEST_PAGE
    page = seen(text)
    anchors = {f"#{each.anchor}" for each in study_page(facts).sections}
    assert set(page.references) <= anchors | {"bags/trial_0000"}
    assert not {"link", "img", "iframe", "object", "base"} & set(page.elements)
    assert "default-src 'none'" in text  # a browser refuses whatever would be fetched all the same
    own = re.sub(r'<script type="text/plain" id="bundle">.*?</script>', "", text, flags=re.DOTALL)
    assert not re.search(r"https?:|url\(|@import", own)


def test_plotly_stands_in_a_page_without_a_function_around_it_and_whole_where_its_wrapping_is_another() -> None:
    whole = get_plotlyjs()
    bare = unwrapped(whole)
    assert len(whole) - 400 < len(bare) < len(whole)
    assert bare.startswith("/**\n* plotly.js v")
    assert '*/\n"use strict";var Plotly=' in bare[:300]
    assert bare.endswith("window.Plotly = Plotly;")
    other = "(function(e){e.Plotly = 1})(window);"
    assert unwrapped(other) == other


def test_what_a_laboratory_writes_is_text_and_never_markup() -> None:
    page = seen(html_of(study_page(TYPICAL)))
    assert "b" not in page.elements
    told = "".join(page.text)
    assert 'too <b>long</b> </script> "x"' in told
    assert "Study typical <&>" in told


def test_the_data_of_each_plot_can_be_read_and_holds_only_numbers_that_json_knows() -> None:
    text = html_of(study_page(TYPICAL))
    plots = re.findall(r'<script type="application/json">(.*?)</script>', text, flags=re.DOTALL)
    assert len(plots) == len(of_kind(study_page(TYPICAL), Plot)) + 1
    for plot in plots:
        json.loads(plot, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_each_thing_that_a_page_must_hold_is_there() -> None:
    page = study_page(TYPICAL)
    anchors = [each.anchor for each in page.sections]
    assert anchors == ["progress", "searched", "repeats", "best", "measured", "trials", "refused", "settings"]
    assert len(of_kind(page, Film)) == 1
    assert [("mean thrust", "2.3 mN")] in [block.entries for block in of_kind(page, Facts)]
    assert "The best of 12 fins" in page.lead[0]
    settings = dict(
        entry for block in section(page, "settings").blocks if isinstance(block, Facts) for entry in block.entries
    )
    assert settings.items() >= {("seed", "7"), ("version.numpy", "2"), ("body.length [m]", "0.14")}


def test_a_study_without_a_score_says_so_and_why() -> None:
    page = study_page(WITHOUT_SCORE)
    assert page.lead == ["No trial has a score yet, of 1 trial."]
    (table,) = section(page, "refused").blocks
    assert isinstance(table, Table)
    assert [cell.text for cell in table.rows[0]][-1] == "no velocity"
    assert study_page(EMPTY).lead == ["No trial was begun yet."]


def test_of_ten_thousand_trials_the_fastest_stand_in_the_table_and_no_plot_has_more_points_than_can_be_seen() -> None:
    page = study_page(TEN_THOUSAND)
    (table,) = section(page, "trials").blocks
    assert isinstance(table, Table)
    assert len(table.rows) == 400
    speeds = [row[6].sort for row in table.rows]
    assert min(s for s in speeds if s is not None) == pytest.approx(0.01 + 1e-6 * 9600)
    assert "400 best of 10900" in table.note
    for plot in of_kind(page, Plot):
        assert all(len(trace["x"]) <= marks.MOST for trace in plot.figure["data"] if trace.get("mode") == "markers")
    (refused,) = section(page, "refused").blocks
    assert isinstance(refused, Table)
    assert refused.rows[0][1].text == "900"


def test_the_best_trial_is_marked_and_only_bags_that_are_there_are_linked() -> None:
    (table,) = section(study_page(TYPICAL), "trials").blocks
    assert isinstance(table, Table)
    best = TYPICAL.best
    assert best is not None
    assert table.best is not None
    assert table.rows[table.best][0].text == f"{best.trials[0].number:04d}"
    assert [cell.link for row in table.rows for cell in row if cell.link] == ["bags/trial_0000"]


def test_repeats_have_their_spread() -> None:
    trials = [trial(0, score=0.02), trial(1, score=0.03, candidate=0), trial(2, score=0.01)]
    repeats = section(study_page(StudyFacts("r", SETTINGS, trials)), "repeats")
    assert "1 fin swam more than once" in repeats.paragraphs[0]
    assert "0.71 cm/s (median)" in repeats.paragraphs[0]
    (plot,) = repeats.blocks
    assert isinstance(plot, Plot)
    assert plot.figure["data"][0]["y"] == [2.0, 3.0]
    two = [*trials[:2], trial(2, score=0.01), trial(3, score=0.0102, candidate=2)]
    repeats = section(study_page(StudyFacts("r", SETTINGS, two)), "repeats")
    assert "0.36 cm/s (median), at most 0.71 cm/s" in repeats.paragraphs[0], "of two the middle between them"
    once = section(study_page(ONE), "repeats")
    assert "no spread between repeats" in once.paragraphs[0]


def test_two_objectives_have_their_front() -> None:
    trials = [replace(each, measured={**each.measured, "energy_per_metre": 0.1 * each.number}) for each in scored(5)]
    facts = StudyFacts(
        "f", Settings(SPACE, details=DETAILS, goals=Goals.of_objective("speed_and_cost_of_transport")), trials
    )
    assert any("Pareto front" in plot.says for plot in of_kind(study_page(facts), Plot))


def test_simulated_and_measured_are_compared_by_rank() -> None:
    again = dict(enumerate([0.011, 0.013, 0.012]))
    trials = [trial(0, score=0.010), trial(1, score=0.030), trial(2, score=0.020), trial(3, score=0.005)]
    facts = StudyFacts("r", SETTINGS, trials, simulated=replace(SIMULATED, again=again, is_the_plant=False))
    assert facts.transfer.rank == pytest.approx(1.0)
    assert "over 3 fins: 1.000" in section(study_page(facts), "measured").paragraphs[1]
    few = replace(facts, simulated=replace(SIMULATED, again={0: 0.01}))
    assert few.transfer.rank is None
    # 0.011 for 0.010, 0.013 for 0.030, 0.012 for 0.020 m/s: ratios 1.1, 0.433 and 0.6.
    assert (facts.transfer.bias, facts.transfer.error) == pytest.approx((-0.4, 0.4))
    # Each over the middle of the two others: 1.1 / 0.517, 0.433 / 0.85, 0.6 / 0.767.
    assert facts.transfer.error_left == pytest.approx(1.0 - 0.4333333 / 0.85)
    assert "Simulated is 40.0% less (median)" in section(study_page(facts), "measured").paragraphs[1]
    assert "the simulator with its default fish" in section(study_page(facts), "measured").paragraphs[0]
    robot = replace(facts, simulated=replace(SIMULATED, curves={}, is_the_plant=False, swimmer="the fish of tank.yaml"))
    assert "with the fish of tank.yaml: it did not swim this study." in section(study_page(robot), "best").paragraphs[0]
    assert "No simulated fish swam" in section(study_page(robot), "searched").paragraphs[0]


# -- the simulator -----------------------------------------------------------------------------------------------------


def test_a_speed_is_computed_once_and_kept_for_the_same_simulator_alone(tmp_path: Path) -> None:
    asked: list[int] = []

    def compute(some: Sequence[Mapping[str, Any]]) -> list[float]:
        asked.append(len(some))
        return [math.nan if values["a"] < 0.0 else values["a"] for values in some]

    first = KeptSpeeds(compute, "k")
    some = [{"a": 1.0}, {"a": -1.0}, {"a": 1.0}]
    found = first(some)
    assert (found[0], found[2], math.isnan(found[1])) == (1.0, 1.0, True)
    first.write(tmp_path / "kept.json")
    for key, number in (("k", 0), ("another", 2)):
        again = KeptSpeeds(compute, key)
        again.read(tmp_path / "kept.json")
        again(some)
        assert asked[-1] == number
    for damage in ("", "[]", '{"key": "k"}', '{"key": "k", "speeds": 3}'):
        (tmp_path / "kept.json").write_text(damage)
        again = KeptSpeeds(compute, "k")
        again.read(tmp_path / "kept.json")
        assert again.known == {}


def test_a_map_has_a_row_a_value_of_the_second_parameter() -> None:
    found = map_of(Space((MODULUS, LENGTH)), {}, lambda some: [values[LENGTH.name] for values in some])
    assert isinstance(found, Map)
    assert [row[0] for row in found.found] == list(found.up)
    assert all(len(set(row)) == 1 and len(row) == len(found.across) for row in found.found)
    assert map_of(SPACE, {}, lambda some: [0.0] * len(some)) is None


def test_of_many_candidates_some_of_all_ranks_are_swum_again() -> None:
    many = {number: float((7 * number) % 1000) for number in range(1000)}
    chosen = [many[number] for number in to_swim_again(many)]
    assert (chosen[0], chosen[-1]) == (0.0, 999.0)
    assert len(chosen) == len(set(chosen)) < 500
    assert sorted(to_swim_again({3: 0.1, 4: 0.2})) == [3, 4]


def test_a_film_shows_the_swim_where_it_was() -> None:
    swum = swim(gait=carangiform(0.2, 2.0), duration=1.5)
    film = film_of(swum, (0.14, 0.045))
    frames = np.array(film["frames"])
    assert len(frames) == 38
    assert film["body"] == [1400, 450]
    last = int(np.searchsorted(swum.time, 37 / film["rate"]))
    assert frames[-1, 0] == pytest.approx(1e4 * (swum.x[last] - swum.x[0]), abs=1.0)
    assert frames[-1, -2] == pytest.approx(1e4 * (swum.tip_path[last, 0] - swum.x[0]), abs=1.0)
    assert len(film["driven"]) == len(swum.chain.links) == (frames.shape[1] - 5) / 2


def test_the_numbers_of_a_swim_are_told_with_units_and_a_swim_too_short_for_a_beat_leaves_some_out() -> None:
    told = dict(numbers_of(swim(gait=carangiform(0.2, 2.0), duration=3.0), 0.5))
    wanted = {"mean speed, as scored", "mean thrust", "mean servo power", "energy per metre", "Strouhal number"}
    assert wanted <= told.keys()
    assert told["tail beat"] == "2 Hz"
    short = dict(numbers_of(swim(duration=0.6), 0.0))
    assert "Strouhal number" not in short
    assert "mean speed, as scored" in short
    swum = swim(duration=3.0)
    assert "energy per metre" not in dict(numbers_of(replace(swum, surge=-swum.surge), 0.5)), "it swims backwards"


def test_the_simulator_tells_curves_of_its_own_studies_and_swims_others_with_its_default_fish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = node_table("fin_sim", "simulator")
    fish = {name: table[name].default for name in table.deciding_swims - FIN_PARAMETERS.keys()}
    fin = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
    gait = {"gait.frequency": 2.0, "gait.amplitude": 0.2}
    settings = Settings(Space((LENGTH,)), details={**DETAILS, **fin, **gait, "fin.area": 2e-3})
    trials = [replace(trial(0), values={LENGTH.name: 0.08})]
    cache = tmp_path / "landscape.json"
    own = simulate(settings, trials, fish, cache)
    assert own is not None
    assert own.is_the_plant
    assert own.film is not None
    assert np.isfinite(own.curves[LENGTH.name].found).all()
    before = cache.read_text()
    assert simulate(settings, trials, fish, cache) == own
    assert cache.read_text() == before
    monkeypatch.setattr(study_facts, "simulator_digest", lambda: "another simulator's")
    assert simulate(settings, trials, fish, cache) == own
    assert cache.read_text() != before, "what another one swam counts for nothing"
    other = simulate(settings, trials, {"plant": "robot"})
    assert other is not None
    assert (other.is_the_plant, other.curves) == (False, {})
    assert other.again == pytest.approx(own.again)
    default = node_table("fin_sim", "simulator").checked({})
    blunt = default | {"body.drag_area": 2.4e-3}
    fitted = simulate(settings, trials, {"plant": "robot"}, fitted=("the fish of tank.yaml", blunt))
    assert fitted is not None
    assert fitted.again != pytest.approx(own.again)
    assert (fitted.swimmer, fitted.is_the_plant) == ("the fish of tank.yaml", False)
    with pytest.raises(ValueError, match=r"a fish that the study tells: leave the fish of tank\.yaml out"):
        simulate(settings, trials, fish, fitted=("the fish of tank.yaml", blunt))
    assert simulate(settings, [], fish) is None
    assert simulate(SETTINGS, trials, fish) is None


# -- colours -----------------------------------------------------------------------------------------------------------


def luminance(colour: str) -> float:
    """Return the relative luminance of a colour as WCAG 2 defines it."""
    parts = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_words_and_marks_stand_out_from_the_page_in_light_and_dark() -> None:
    style = (resources.files("fin_optimizer.report") / "page.css").read_text()
    themes = re.findall(r":root[^{]*\{(.*?)\}", style, flags=re.DOTALL)
    assert len(themes) == 2
    for theme in themes:
        colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", theme))
        # WCAG 2.1: 4.5 for words, 3 for marks.
        wanted = {"ink": 4.5, "quiet": 4.5, "blue": 4.5, "red": 3.0, "green": 3.0, "orange": 3.0, "purple": 3.0}
        for name, least in wanted.items():
            for ground in ("paper", "panel"):
                low, high = sorted((luminance(colours[name]), luminance(colours[ground])))
                assert (high + 0.05) / (low + 0.05) >= least, (name, ground)
