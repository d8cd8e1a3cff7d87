"""What a study leaves when it ends: its table, its pictures, and sentences that say what was found and how to go on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from fin_optimizer.goals import Goals
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study import final_report
from fin_optimizer.study.file_names import FIGURE_FILE, FRONT_FILE
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.report import CSV_FILE
from fin_optimizer.study.settings import Policy, Settings
from fin_optimizer.trial.result import Outcome, Result

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Begin = Callable[..., Study]

MODULUS = "fin.young_modulus"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),))
INTERRUPTED = Result(Outcome.INTERRUPTED, "Ctrl-C")


@pytest.fixture
def begin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Begin]:
    """Begin a study in the folder ``study`` of the current one."""
    monkeypatch.chdir(tmp_path)
    opened: list[Study] = []

    def begin_one(objective: str = "speed", repeats: int = 1) -> Study:
        settings = Settings(SPACE, Policy(repeats=repeats, attempts=2), {"seed": 1}, Goals.of_objective(objective))
        opened.append(Study.create(tmp_path / "study", settings))
        return opened[-1]

    yield begin_one
    for study in opened:
        study.close()


def swim(study: Study, candidate: int, modulus: float, result: Result) -> None:
    record = study.propose(candidate, {MODULUS: modulus})
    study.start(record.number)
    study.finish(record.number, result)


def ok(speed: float, cost: float | None = None) -> Result:
    measured = {"mean_speed": speed} | ({} if cost is None else {"energy_per_metre": cost})
    return Result(Outcome.OK, measured=measured, spread=0.001, samples=1000)


def test_the_best_fin_is_told_with_how_much_was_swum_and_where_the_results_lie(begin: Begin) -> None:
    study = begin()
    swim(study, 0, 1.0e9, ok(0.02))
    swim(study, 1, 2.0e9, ok(0.03))
    assert final_report.write_report(study) == []
    assert (study.folder / FIGURE_FILE).read_bytes().startswith(b"\x89PNG")
    assert final_report.findings(study) == [
        "best of 2 trials: E 2 GPa swims 3.000 cm/s",
        f"results: study/ ({CSV_FILE}, {FIGURE_FILE}, journal.log, bags)",
    ]


def test_repeats_and_fins_without_a_score_are_counted_apart(begin: Begin) -> None:
    study = begin(repeats=2)
    for speed in (0.02, 0.03):
        swim(study, 0, 1.0e9, ok(speed))
    swim(study, 1, 2.0e9, Result(Outcome.INFEASIBLE, "thicker than long"))
    assert final_report.findings(study)[0] == (
        "best of 1 fin in 2 trials (1 fin without a score): E 1 GPa swims 2.500 cm/s"
    )


def test_of_two_objectives_the_whole_front_is_told_the_fastest_first(begin: Begin) -> None:
    study = begin("speed_and_cost_of_transport")
    for candidate, (modulus, speed, cost) in enumerate([(1e9, 0.02, 0.1), (2e9, 0.03, 0.2), (3e9, 0.01, 0.3)]):
        swim(study, candidate, modulus, ok(speed, cost))
    final_report.write_report(study)
    assert final_report.findings(study)[1:-1] == [
        "Pareto front of speed and energy per metre (2 fins):",
        "  E 2 GPa: 3.000 cm/s, 0.2000 J/m",
        "  E 1 GPa: 2.000 cm/s, 0.1000 J/m",
    ]
    assert FRONT_FILE in final_report.findings(study)[-1]


def test_without_a_score_there_is_a_table_but_no_picture(begin: Begin) -> None:
    study = begin()
    swim(study, 0, 1.0e9, INTERRUPTED)
    assert final_report.write_report(study) == []
    assert final_report.findings(study) == ["no trial gave a score", f"results: study/ ({CSV_FILE}, journal.log, bags)"]
    assert final_report.how_to_go_on(study) == [
        "stopped after 1 trial, all in the journal; go on with study_folder:=study and what else was given"
    ]


def test_what_cannot_be_written_is_told_and_what_was_found_is_told_all_the_same(begin: Begin) -> None:
    study = begin()
    swim(study, 0, 1.0e9, ok(0.02))
    for name in (CSV_FILE, FIGURE_FILE):
        (study.folder / name).mkdir()
    table, picture = final_report.write_report(study)
    assert table.startswith(f"optimizer: error: the report in {study.folder} cannot be written: ")
    assert picture.startswith(f"warning: the picture {study.folder / FIGURE_FILE} could not be drawn: ")
    assert final_report.findings(study)[0] == "best of 1 trial: E 1 GPa swims 2.000 cm/s"
    assert final_report.how_to_go_on(study)[1] == "its picture is drawn by `show_study study --plot` of fin_optimizer"
