"""What a study leaves for people: a table with units and every digit, a figure, and lines that can be read."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest

from fin_optimizer import progress, words
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study import drawing, report
from fin_optimizer.study.candidate import Candidate, TrialRecord, candidates
from fin_optimizer.study.file_names import FIGURE_FILE
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome
from fin_plant.fin import Fin

if TYPE_CHECKING:
    from pathlib import Path

MODULUS = "fin.young_modulus"
RANGE = Dimension(MODULUS, 0.5e9, 4e9, "Pa")
SETTINGS = Settings(Space((RANGE,)))
NOON = datetime(2026, 1, 2, 12, 0, 0, tzinfo=UTC)


def trial(
    number: int, modulus: float, score: float | None, outcome: Outcome = Outcome.OK, reason: str = ""
) -> TrialRecord:
    return TrialRecord(
        number=number,
        candidate=number,
        values={MODULUS: modulus},
        outcome=outcome,
        reason=reason,
        measured={} if score is None else {"mean_speed": score},
        spread=None if score is None else 0.001,
        plant="/fish",
        samples=0 if score is None else 1000,
        bag=f"bags/trial_{number:04d}",
        started=NOON + timedelta(seconds=number),
        ended=NOON + timedelta(seconds=number, milliseconds=250),
    )


TRIALS = [
    trial(0, 3e9, 0.018),
    trial(1, 1.1000000000000001e9, 0.02905123456789012),
    trial(2, 2e9, None, Outcome.FAILED, 'no message on topic "/fish/velocity", at all'),
    trial(3, 0.6e9, None, Outcome.INFEASIBLE, "refused"),
]


def best() -> Candidate:
    return candidates(TRIALS)[1]


def test_the_table_has_units_in_its_header_and_loses_no_digit() -> None:
    rows = list(csv.DictReader(io.StringIO(report.trials_table(TRIALS, SETTINGS))))
    assert {"trial", "fin.young_modulus [Pa]", "speed [m/s]", "spread [m/s]", "started [UTC]"} <= set(rows[0])
    assert float(rows[1]["fin.young_modulus [Pa]"]) == TRIALS[1].values[MODULUS]
    assert float(rows[1]["speed [m/s]"]) == TRIALS[1].score
    assert (rows[0]["started [UTC]"], rows[0]["ended [UTC]"]) == (
        "2026-01-02T12:00:00.000Z",
        "2026-01-02T12:00:00.250Z",
    )


def test_the_table_leaves_empty_what_is_not_known_and_gives_the_reason() -> None:
    row = list(csv.DictReader(io.StringIO(report.trials_table(TRIALS, SETTINGS))))[2]
    assert (row["outcome"], row["speed [m/s]"], row["samples"]) == ("FAILED", "", "")
    assert row["reason"] == TRIALS[2].reason


def test_a_table_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / report.CSV_FILE
    path.write_text("old")
    report.write_table(path, TRIALS, SETTINGS)
    assert path.read_text() == report.trials_table(TRIALS, SETTINGS)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("with_curve", [True, False])
def test_the_figure_is_drawn_with_and_without_a_curve(tmp_path: Path, with_curve: bool) -> None:
    curve = ([RANGE.minimum, RANGE.maximum], [0.02, 0.03]) if with_curve else None
    path = tmp_path / FIGURE_FILE
    drawing.draw_speed(path, TRIALS, best(), RANGE, simulated=curve, title="a fin")
    assert path.read_bytes().startswith(b"\x89PNG")
    drawing.draw_speed(path, [], None, RANGE)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_values_are_shown_in_a_laboratorys_units() -> None:
    assert words.show_values({MODULUS: 1.234e9, "fin.length": 0.08}) == "E 1.234 GPa, length 8 cm"
    assert words.show_speed(0.026612) == "2.661 cm/s"
    assert words.show_speed(1.834e-06) == "0.0001834 cm/s"  # a swim of 0.2 s from rest


def test_away_from_a_terminal_there_is_one_line_a_trial() -> None:
    stream = io.StringIO()
    shown = progress.display(stream, 30, 0)
    shown.begin(TRIALS[0])
    shown.show("measure", "3 s")
    shown.end(TRIALS[0], 1, candidates(TRIALS)[0])
    shown.end(TRIALS[2], 2, best())
    shown.close()
    first, second = stream.getvalue().splitlines()
    assert first.startswith("trial 0000  fin  1 of 30  E 3 GPa  1.800 cm/s  (best 1.800 cm/s at E 3 GPa)")
    assert "trial 0002  fin  3 of 30  E 2 GPa  FAILED: no message on topic" in second
    assert "(best 2.905 cm/s at E 1.1 GPa)" in second


def test_on_a_terminal_of_80_columns_a_live_line_shows_trial_modulus_speed_best_and_time_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    shown = progress.display(stream, 30, 0)
    shown.begin(TRIALS[0])
    shown.end(TRIALS[0], 1, candidates(TRIALS)[0])
    shown.begin(TRIALS[1])
    shown.show("measure", "3 s")
    text = stream.getvalue()
    for part in ("fin  2 of 30", "E 1.1 GPa", "last 1.800 cm/s", "best 1.800 cm/s at E 3 GPa"):
        assert part in text
    shown.end(TRIALS[2], 2, best())
    shown.close()
    text = stream.getvalue()
    for line in (
        "trial 0000  fin  1 of 30  E 3 GPa  1.800 cm/s",
        "trial 0002  fin  3 of 30  E 2 GPa  FAILED: no message",
    ):
        assert line in text, "each trial stays on the screen"


@pytest.mark.parametrize("width", [100, 80, 60, 40, 20])
@pytest.mark.parametrize("length", [{}, {"fin.length": 0.07345}])
def test_a_live_line_fits_its_terminal_and_cuts_no_number(width: int, length: dict[str, float]) -> None:
    values = words.show_values({MODULUS: 1.131e9, **length})
    texts = ("fin 12 of 30", values, "measure 9 s", f"best 2.903 cm/s at {values}", "about 25 min left")
    line = progress.live_line(width, *texts)
    assert len(line) <= width
    assert "12 of 30" in line
    assert all(part in {*texts, "best 2.903 cm/s"} for part in line.split("  "))
    assert ("2.903 cm/s" in line) == (width > 20), "the best is the last to go"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.2, "about 10 s"),
        (44.0, "about 40 s"),
        (125.0, "about 2 min"),
        (1463.0, "about 25 min"),
        (12900.0, "about 3.5 h"),
        (70000.0, "about 19 h"),
        (200000.0, "about 2.5 days"),
    ],
)
def test_an_estimate_is_told_as_a_round_figure(seconds: float, text: str) -> None:
    assert progress.show_about(seconds) == text


def test_the_time_left_is_told_from_the_third_fin_on_and_a_night_without_trials_does_not_count() -> None:
    now = 0.0
    left = progress.TimeLeft(10, 2, clock=lambda: now)
    told = []
    for settled, night in ((3, 0.0), (4, 40_000.0), (5, 0.0), (6, 0.0), (10, 0.0)):
        now += night
        left.begin()
        now += 60.0
        left.end()
        told.append(left.text(settled))
    assert told == ["", "", "about 5 min left", "about 4 min left", ""]


def test_of_two_fish_that_swim_at_once_the_time_counts_once() -> None:
    now = 0.0
    left = progress.TimeLeft(8, 0, clock=lambda: now)
    for _ in range(2):
        left.begin()
        left.begin()
        now += 120.0
        left.end()
        left.end()
    assert left.text(4) == "about 4 min left"


def test_an_interrupted_trial_is_its_own_word_in_line_and_table() -> None:
    stopped = trial(4, 2e9, None, Outcome.INTERRUPTED, "in phase 'measure': the optimiser was stopped")
    assert progress.summary(stopped) == "E 2 GPa  INTERRUPTED: in phase 'measure': the optimiser was stopped"
    (row,) = csv.DictReader(io.StringIO(report.trials_table([stopped], SETTINGS)))
    assert (row["trial"], row["fin"], row["outcome"]) == ("4", "5", "INTERRUPTED")


def shape_settings(fin: Fin) -> Settings:
    base = {name: value for name, value in fin.as_parameters().items() if name not in {MODULUS, "fin.length"}}
    shape = Space((RANGE, Dimension("fin.length", 0.04, 0.12, "m")))
    return Settings(shape, details=base | {"fin.area": fin.area})


def test_tables_have_every_dimension_that_changes_with_its_unit() -> None:
    lengths = (0.05, 0.1)
    trials = [replace(trial(n, 1e9, 0.02), values={MODULUS: 1e9, "fin.length": lengths[n]}) for n in range(2)]
    rows = list(csv.DictReader(io.StringIO(report.trials_table(trials, shape_settings(Fin())))))
    assert [float(row["fin.height [m]"]) for row in rows] == pytest.approx([0.04, 0.02])
    assert "fin.tip_height [m]" not in rows[0], "it is the height"
    assert "fin.thickness [m]" not in rows[0]
    flaring = shape_settings(Fin(tip_height=0.05))
    assert report.varied(flaring, [trial.values for trial in trials])[2:] == ["fin.height", "fin.tip_height"]
