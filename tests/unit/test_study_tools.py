"""What a person does with a study: a table on the terminal, an export, and searches that go on where they stopped."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pytest
from pyarrow import parquet

from fin_bringup.benchmarks.trials import throughput
from fin_optimizer.bags.messages import decode, velocity_samples
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.commands import export, score_bag, show_study
from fin_optimizer.goals import Goals
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.score import recorded
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.score.swim import SwimRecord, score_swim
from fin_optimizer.search.algorithms import search
from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import GeneticAlgorithm
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.candidate import front
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.records import read_trials
from fin_optimizer.study.settings import Policy, Settings
from fin_optimizer.trial.result import Outcome, Result
from support.bags import (
    JOINTS,
    START,
    STATE,
    STEP,
    VELOCITY,
    joint_states,
    state,
    velocity,
    write_swim,
)
from support.old_studies import take_off_check_sums

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import ModuleType

    from fin_optimizer.search.space import Search

MODULUS, LENGTH = "fin.young_modulus", "fin.length"
SPACE = Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"), Dimension(LENGTH, 0.05, 0.12, "m")))
DEVIATIONS = {MODULUS: 0.3e9, LENGTH: 0.003}
SEARCHES: dict[str, Callable[[], Search]] = {
    "hill climber": lambda: HillClimber(SPACE, 7, DEVIATIONS),
    "genetic": lambda: OneByOne(GeneticAlgorithm(SPACE, 7, DEVIATIONS, population=6)),
    "CMA-ES": lambda: OneByOne(CmaEs(SPACE, 7, population=6)),
}

BOTH = Goals.of_objective("speed_and_cost_of_transport")


def outcome(number: int, values: dict[str, float], *, with_cost: bool = False) -> Result:
    """Return how a trial of this fin ends: every seventh candidate cannot be built."""
    if number % 7 == 5:
        return Result(Outcome.INFEASIBLE, "thicker than long")
    speed = 0.03 - abs(values[MODULUS] - 1.1e9) / 1e11 - abs(values[LENGTH] - 0.08) / 10.0
    cost = {"energy_per_metre": values[LENGTH] * speed} if with_cost else {}
    return Result(Outcome.OK, measured={"mean_speed": speed, **cost}, samples=100)


def ok(speed: float, **more: Any) -> Result:
    return Result(Outcome.OK, measured={"mean_speed": speed}, **more)


def swim(study: Study, search: Search, trials: int) -> None:
    for _ in range(trials):
        following = study.next_candidate(search)
        assert following is not None
        record = study.propose(*following, "/fish")
        study.start(record.number)
        result = outcome(*following, with_cost=study.settings.goals == BOTH)
        study.finish(record.number, result)


@pytest.mark.parametrize("name", SEARCHES)
@pytest.mark.parametrize("interruption", [1, 6, 13, 20])
def test_a_resumed_search_proposes_bit_for_bit_what_an_uninterrupted_one_proposes(
    tmp_path: Path, name: str, interruption: int
) -> None:
    settings = Settings(SPACE)
    with Study.create(tmp_path / "whole", settings) as study:
        swim(study, SEARCHES[name](), 26)
    with Study.create(tmp_path / "cut", settings) as study:
        swim(study, SEARCHES[name](), interruption)
    with Study.open(tmp_path / "cut", settings) as study:
        swim(study, SEARCHES[name](), 26 - interruption)
    assert [t.values for t in read_trials(tmp_path / "cut")] == [t.values for t in read_trials(tmp_path / "whole")]


@pytest.mark.parametrize("name", ["tpe", "gp", "nsga2", "random", "quasi_random"])
def test_a_study_killed_twice_in_a_swim_ends_with_the_candidates_of_an_undisturbed_one(
    tmp_path: Path, name: str
) -> None:
    settings = Settings(SPACE)
    with Study.create(tmp_path / "whole", settings) as study:
        swim(study, search(name, SPACE, 7, DEVIATIONS, 4), 12)
        wanted = [candidate.values for candidate in study.candidates]
    Study.create(tmp_path / "cut", settings).close()
    for trials in (4, 5, 3):
        with Study.open(tmp_path / "cut", settings) as study:
            one = search(name, SPACE, 7, DEVIATIONS, 4)
            swim(study, one, trials)
            found = [candidate.values for candidate in study.candidates]
            following = study.next_candidate(one)
            assert following is not None
            study.start(study.propose(*following, "/fish").number)
    assert found == wanted


@pytest.mark.parametrize("name", ["genetic", "CMA-ES"])
def test_several_fish_that_finish_in_any_order_give_a_generational_search_the_same_candidates(
    tmp_path: Path, name: str
) -> None:
    with Study.create(tmp_path / "one", Settings(SPACE)) as study:
        swim(study, SEARCHES[name](), 24)
    search = SEARCHES[name]()
    with Study.create(tmp_path / "three", Settings(SPACE)) as study:
        under_way: list[tuple[int, int, dict[str, float]]] = []
        while study.settled() < 24:
            following = study.next_candidate(search, 24) if len(under_way) < 3 else None
            if following is not None:
                record = study.propose(*following, f"/fish_{len(under_way)}")
                study.start(record.number)
                under_way.append((record.number, *following))
            else:  # the last to begin is the first to end
                number, candidate, values = under_way.pop()
                study.finish(number, outcome(candidate, values))
    tried = [candidate.values for candidate in study.candidates]
    assert tried == [trial.values for trial in read_trials(tmp_path / "one")]


def test_a_failed_trial_of_one_fish_is_given_to_the_next_that_is_free(tmp_path: Path) -> None:
    search = SEARCHES["hill climber"]()
    with Study.create(tmp_path / "study", Settings(SPACE)) as study:
        for plant in ("/a", "/b"):
            following = study.next_candidate(search)
            assert following is not None
            study.start(study.propose(*following, plant).number)
        study.finish(0, Result(Outcome.FAILED, "the plant is in FAULT"))
        again = study.next_candidate(search)
        assert again is not None
        assert again == (0, study.trials[0].values)
        assert study.next_candidate(search, 2) == again


def test_the_journal_tells_what_was_known_when_a_candidate_was_proposed(tmp_path: Path) -> None:
    search = SEARCHES["hill climber"]()
    known = []
    with Study.create(tmp_path / "study", Settings(SPACE)) as study:
        for _ in range(3):
            known.append([entry.score for entry in study.history])
            following = study.next_candidate(search)
            assert following is not None
            study.start(study.propose(*following).number)
        study.finish(1, outcome(1, dict(study.trials[1].values)))
        known.append([entry.score is not None for entry in study.history])
    assert known == [[], [None], [None, None], [False, True, False]]


def test_two_objectives_give_a_pareto_front_and_a_resumed_study_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = Settings(SPACE, Policy(), {}, BOTH)
    for folder, parts in (("whole", (30,)), ("cut", (11, 19))):
        for part in parts:
            with (
                Study.open(tmp_path / folder)
                if (tmp_path / folder).exists()
                else Study.create(tmp_path / folder, settings) as study
            ):
                swim(study, SEARCHES["hill climber"](), part)
    assert [t.values for t in read_trials(tmp_path / "cut")] == [t.values for t in read_trials(tmp_path / "whole")]
    scored = [c for c in study.candidates if c.measured]
    dominated = {
        c.number
        for c in scored
        for o in scored
        if all(b >= a for a, b in zip(c.evaluation.objectives, o.evaluation.objectives, strict=True))
        and o.evaluation.objectives != c.evaluation.objectives
    }
    assert sorted(c.number for c in front(study.candidates)) == sorted({c.number for c in scored} - dominated)
    assert show_study.main([str(tmp_path / "cut"), "--all"]) == 0
    assert capsys.readouterr().out.count(" * ") == len(front(study.candidates))


def test_an_ok_trial_without_its_second_objective_is_refused(tmp_path: Path) -> None:
    with Study.create(tmp_path / "study", Settings(SPACE, Policy(), {}, BOTH)) as study:
        values = {MODULUS: 1e9, LENGTH: 0.08}
        study.start(study.propose(0, values).number)
        with pytest.raises(StudyError, match="has no energy per metre"):
            study.finish(0, ok(0.02))


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Return the folder of a study with repeats, a failure and an infeasible fin."""
    with Study.create(tmp_path / "study", Settings(SPACE, Policy(repeats=2))) as begun:
        results = (
            [ok(score, spread=0.001, samples=1001) for score in (0.0101, 0.0103)]
            + [
                Result(Outcome.FAILED, "no velocity for 1 s"),
                ok(0.02, samples=1001),
            ]
            + [
                ok(0.022, samples=1001),
                Result(Outcome.INFEASIBLE, "thicker than long"),
            ]
        )
        for result in results:
            following = begun.next_candidate(SEARCHES["hill climber"]())
            assert following is not None
            begun.start(begun.propose(*following, "/fish").number)
            begun.finish(len(begun.trials) - 1, result)
    return tmp_path / "study"


def test_an_export_has_a_row_a_trial_and_its_units_in_csv_and_parquet_alike(study: Path, tmp_path: Path) -> None:
    assert export.main([str(study), "--into", str(tmp_path / "tables")]) == 0
    with (tmp_path / "tables" / "study.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = parquet.read_table(tmp_path / "tables" / "study.parquet")
    assert list(rows[0]) == table.column_names
    trials = read_trials(study)
    for name, value in (("speed [m/s]", "score"), ("trial", "number")):
        expected = [getattr(trial, value) for trial in trials]
        assert table[name].to_pylist() == expected
        assert [float(row[name]) if row[name] else None for row in rows] == expected
    assert table["fin.length [m]"].to_pylist() == [trial.values[LENGTH] for trial in trials]
    assert table["mean speed of the fin [m/s]"].to_pylist()[:2] == [pytest.approx(0.0102)] * 2
    assert table["spread between its repeats [m/s]"].to_pylist()[0] == pytest.approx(math.sqrt(2e-8))
    assert table.schema.field("started [UTC]").type == pa.timestamp("us", "UTC")
    assert table.schema.metadata[b"study.repeats"] == b"2"


def test_an_export_knows_the_two_hours_of_a_change_of_the_clocks_apart(tmp_path: Path) -> None:
    with Study.create(tmp_path / "study", Settings(SPACE)) as begun:
        begun.start(begun.propose(0, {MODULUS: 1e9, LENGTH: 0.08}).number)
        begun.finish(0, ok(0.02))
    take_off_check_sums(tmp_path / "study")
    journal = tmp_path / "study" / "journal.log"
    times = ("2025-10-26T00:30:00.000000+00:00", "2025-10-26T01:30:00.000000+00:00")  # in Berlin both are 2:30
    lines = journal.read_text().splitlines(keepends=True)
    for key, value in zip(("datetime_start", "datetime_complete"), times, strict=True):
        lines = [re.sub(rf'("{key}": ?)"[^"]+"', rf'\1"{value}"', line) for line in lines]
    journal.write_text("".join(lines))
    subprocess.run(
        [sys.executable, "-m", export.__name__, str(tmp_path / "study")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TZ": "Europe/Berlin"},
        check=True,
    )
    (row,) = parquet.read_table(tmp_path / "study" / "study.parquet").to_pylist()
    assert [row[name].isoformat(timespec="microseconds") for name in ("started [UTC]", "ended [UTC]")] == [*times]


def test_a_study_is_shown_best_first_with_its_spread_and_what_failed(
    study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show_study.main([str(study)]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "speed, 2 swims a fin: 4 OK, 1 FAILED, 1 INFEASIBLE"
    assert out[1].startswith("best 2.100 cm/s at E ")
    assert out[1].endswith(" cm (trial 0003, 0004)")
    lines = [line for line in out[2:] if line.rstrip().endswith(("0001", "0004", "thicker than long"))]
    assert [["2.100" in line, "1.020" in line] for line in lines] == [[True, False], [False, True], [False, False]]
    assert "0002 0003 0004" in lines[0]


@pytest.mark.parametrize("columns", [80, 60, 44])
def test_in_a_narrow_terminal_no_number_of_a_study_is_broken(
    tmp_path: Path, columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "study"
    given = {"search.length.minimum": 0.05, "search.length.maximum": 0.12, "fin.tip_height": 0.05, "repeats": 3}
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**given, "study_folder": str(folder), "seed": 3}))
    with plan.study() as begun:
        while begun.settled() < 8:
            following = begun.next_candidate(plan.search, 8)
            assert following is not None
            number = begun.start(begun.propose(*following, "/fish").number).number
            bad = {
                4: Result(Outcome.INTERRUPTED, "in phase 'measure': Ctrl-C"),
                8: Result(Outcome.FAILED, "no velocity"),
            }
            begun.finish(
                number,
                bad.get(number, ok(0.0123456 + 1e-5 * number, samples=1)),
            )
        best = begun.best()
        settings, trials = begun.settings, begun.trials
    assert best is not None
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    assert show_study.main([str(folder)]) == 0
    lines = [re.sub("\x1b\\[[0-9;]*m", "", line) for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= columns
    numbers = {f"{trial.number:04d}" for trial in trials}
    assert numbers <= set(" ".join(lines).replace(",", " ").replace(")", " ").split())
    (first,) = (line.split() for line in lines if line.split()[:1] == ["1"])
    fin = settings.fin_of(best.values)
    shown = [f"{fin['fin.young_modulus'] / 1e9:#.4g}", f"{fin['fin.length'] * 100:#.4g}"]
    assert first[1:3] == shown
    assert f"{(best.score or 0.0) * 100:#.4g}" in first
    if columns >= 60:
        assert first[3:5] == [f"{fin['fin.height'] * 100:#.4g}", f"{fin['fin.tip_height'] * 100:#.4g}"]
        assert "(GPa) (cm) (cm) (cm) (cm/s)" in " ".join(" ".join(lines).split())
    left_out = [line for line in lines if line.startswith(f"not shown in {columns} columns: ")]
    assert left_out, "whatever has no room is named"


def test_a_reason_is_shown_as_it_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reason = "the stock [/dev/shelf] is empty, choose [bold] or [acetal]\\"
    with Study.create(tmp_path / "study", Settings(SPACE)) as begun:
        begun.start(begun.propose(0, {MODULUS: 1e9, LENGTH: 0.08}).number)
        begun.finish(0, Result(Outcome.INFEASIBLE, reason))
    assert show_study.main([str(tmp_path / "study")]) == 0
    assert reason in capsys.readouterr().out


@pytest.fixture
def resumed(tmp_path: Path) -> Path:
    """Return the folder of a study whose second of three trials was interrupted, each with its bag."""
    with Study.create(tmp_path / "resumed", Settings(SPACE)) as begun:
        stopped = Result(Outcome.INTERRUPTED, "in phase 'measure': Ctrl-C")
        for interrupted in (False, True, False):
            following = begun.next_candidate(SEARCHES["hill climber"]())
            assert following is not None
            record = begun.start(begun.propose(*following, "/fish").number)
            bag = write_swim(tmp_path / "resumed" / record.bag)
            scored = recorded.score_bag(bag)[0]
            done = ok(scored.value, spread=scored.spread, samples=scored.samples)
            begun.finish(record.number, stopped if interrupted else done)
            if interrupted:
                (file,) = bag.glob("*.mcap")
                file.write_bytes(file.read_bytes()[:3000])
    return tmp_path / "resumed"


def test_a_resumed_study_is_scored_without_its_interrupted_trial(
    resumed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = [resumed / trial.bag for trial in read_trials(resumed)]
    assert score_bag.main([str(resumed)]) == 0
    shown = capsys.readouterr()
    assert [line.split(" ", 2)[2] for line in shown.out.splitlines()] == [str(bags[0]), str(bags[2])]
    assert shown.err == f"note: {bags[1]}: trial 0001 is INTERRUPTED (in phase 'measure': Ctrl-C)\n"
    for path in (bags[1], resumed / "bags"):  # no study by itself: scored whatever a journal says
        assert score_bag.main([str(path)]) == 2
        assert f"score_bag: error: {bags[1]}: " in capsys.readouterr().err
    (resumed / "journal.log").write_text("{}\n")
    assert score_bag.main([str(resumed)]) == 2
    assert f": every bag of {resumed} is scored\nscore_bag: error: {bags[1]}: " in capsys.readouterr().err


def test_an_ok_trial_without_its_bag_is_an_error(resumed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bags = [resumed / trial.bag for trial in read_trials(resumed)]
    shutil.rmtree(bags[2])
    (bags[0] / f"{bags[0].name}_0.mcap").unlink()
    write_swim(resumed / "bags" / "of another day")
    assert score_bag.main([str(resumed)]) == 2
    shown = capsys.readouterr()
    errors = [line.removeprefix("score_bag: error: ") for line in shown.err.splitlines() if ": error: " in line]
    assert [error.partition(": ")[0] for error in errors] == [str(bags[0]), str(bags[2])]
    assert all(error.endswith("missing") for error in errors)
    assert shown.out.endswith(f" {resumed}/bags/of another day\n")
    assert shown.out.count("\n") == 1


def test_a_bag_that_does_not_give_the_journals_score_is_an_error(
    resumed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trials = read_trials(resumed)
    value = trials[2].score
    assert value is not None
    take_off_check_sums(resumed)
    journal = (resumed / "journal.log").read_text()
    changed = math.nextafter(value, 1.0)
    assert journal.count(repr(value)) == 2
    head, _, tail = journal.rpartition(repr(value))
    (resumed / "journal.log").write_text(head + repr(changed) + tail)
    assert score_bag.main([str(resumed)]) == 2
    shown = capsys.readouterr()
    assert shown.out.count("\n") == 2
    (error,) = (line for line in shown.err.splitlines() if line.startswith("score_bag: error: "))
    assert error.startswith(f"score_bag: error: {resumed / trials[2].bag}: speed [m/s] is {value!r} from the bag")
    assert f"and {changed!r} in journal.log" in error


@pytest.fixture
def with_cost(tmp_path: Path) -> Path:
    """Return the folder of a study that looks for speed and energy per metre, with one trial."""
    measurement = Measurement(duration=2.0)
    settings = Settings(SPACE, Policy(), {}, BOTH)
    metadata = {f"study.{name}": str(value) for name, value in settings.flat().items()}
    velocities = [
        velocity(START + index * STEP, 0.15 * math.tanh(index / 20) + 0.01 * math.sin(index)) for index in range(201)
    ]
    joints = [joint_states(START + index * STEP, 2.0 + math.cos(index), math.sin(index) ** 2) for index in range(201)]
    with Study.create(tmp_path / "study", settings) as study:
        record = study.start(study.propose(0, {MODULUS: 1e9, LENGTH: 0.08}).number)
        bag = tmp_path / "study" / record.bag
        with BagWriter(bag, (VELOCITY, STATE, JOINTS), metadata | measurement.metadata()) as writer:
            writer.write(STATE.name, state("SWIMMING", START))
            for speed, joint in zip(velocities, joints, strict=True):
                writer.write(VELOCITY.name, speed)
                writer.write(JOINTS.name, joint)
        started = decode(state("SWIMMING", START), STATE.type_name)
        record_of_swim = SwimRecord(velocity_samples(velocities), [started], joints, measurement.metadata())
        scored, measured = score_swim(record_of_swim, BOTH.asked)
        study.finish(record.number, Result(Outcome.OK, measured=measured, spread=scored.spread, samples=1))
    return tmp_path / "study"


def test_the_energy_per_metre_of_a_study_about_it_is_that_of_the_live_trial(
    with_cost: Path, resumed: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (trial,) = read_trials(with_cost)
    assert score_bag.main([str(with_cost), str(with_cost / trial.bag)]) == 0
    lines = capsys.readouterr().out.splitlines()
    cost = trial.measured["energy_per_metre"]
    assert lines == [f"{trial.score!r} {trial.spread!r} {cost!r} {with_cost / trial.bag}"] * 2
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert score_bag.main([str(with_cost), str(resumed)]) == 0
    heads = [line.split() for line in capsys.readouterr().out.splitlines() if line.endswith(" bag")]
    assert [" ".join(words) for words in heads] == [
        "speed [m/s] spread [m/s] energy per metre [J/m] bag",
        "speed [m/s] spread [m/s] bag",
    ]
    take_off_check_sums(with_cost)
    journal = (with_cost / "journal.log").read_text()
    (with_cost / "journal.log").write_text(journal.replace(repr(cost), "0.5"))
    assert score_bag.main([str(with_cost)]) == 2
    assert f"energy per metre [J/m] is {cost!r} from the bag and 0.5 in journal.log" in capsys.readouterr().err


def test_scores_have_a_header_for_a_person_only(
    resumed: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    score_bag.main([str(resumed)])
    piped = capsys.readouterr().out
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    score_bag.main([str(resumed)])
    header, _, lines = capsys.readouterr().out.partition("\n")
    assert header.split("  ")[0] == "speed [m/s]"
    assert lines == piped


def test_scores_as_csv_and_json_have_units_and_the_dimensions_that_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heights = (0.025, 0.03)
    for number, height in enumerate(heights):
        fin = {"fin.height": repr(height), "fin.length": "0.08", "fin.profile_height": "[]"}
        write_swim(tmp_path / "bags" / f"trial_{number:04d}", metadata=fin)
    assert score_bag.main([str(tmp_path / "bags")]) == 0
    plain = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert score_bag.main([str(tmp_path / "bags"), "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert list(rows[0]) == ["bag", "fin.height [m]", "speed [m/s]", "spread [m/s]"]
    assert [float(row["fin.height [m]"]) for row in rows] == [*heights]
    assert [[row["speed [m/s]"], row["spread [m/s]"]] for row in rows] == plain, "every digit"
    assert score_bag.main([str(tmp_path / "bags"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [[repr(row["speed [m/s]"]), row["fin.height [m]"]] for row in told] == [
        [words[0], height] for words, height in zip(plain, heights, strict=True)
    ]


@pytest.fixture
def swum(tmp_path: Path) -> Path:
    """Return the folder of a study of the shape, with five trials and one that a kill left open."""
    folder = tmp_path / "swum"
    given = {"search.length.minimum": 0.05, "search.length.maximum": 0.12}
    plan = StudyPlan.from_parameters(OPTIMIZER_PARAMETERS.checked({**given, "study_folder": str(folder)}))
    with plan.study() as begun:
        swim(begun, plan.search, 5)
        following = begun.next_candidate(plan.search)
        assert following is not None
        begun.start(begun.propose(*following, "/fish").number)  # and then a kill
    return folder


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("a.svg", b"<?xml"),
        pytest.param("a.pdf", b"%PDF", marks=pytest.mark.long),
        pytest.param("a.png", b"\x89PNG", marks=pytest.mark.long),
    ],
)
def test_a_studys_picture_is_drawn_any_time_and_only_read_for_it(
    swum: Path, tmp_path: Path, name: str, begins: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in swum.rglob("*") if path.is_file()}
    assert show_study.main([str(swum), "--plot", str(tmp_path / name)]) == 0
    assert (tmp_path / name).read_bytes().startswith(begins)
    assert f"picture: {tmp_path / name}" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in swum.rglob("*") if path.is_file()} == before
    take_off_check_sums(swum)
    assert show_study.main(["--plot", str(swum)]) == 0
    assert (swum / "speed_over_modulus.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_that_cannot_be_drawn_is_named_after_the_table(
    swum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show_study.main([str(swum), "--plot", str(tmp_path / "nowhere" / "a.png")]) == 1
    shown = capsys.readouterr()
    assert "best " in shown.out
    assert shown.err.count("could not be drawn") == 3, "the map, the slices and the parallel coordinates"
    assert show_study.main([str(swum), "--plot", str(tmp_path / "a.jpg")]) == 2
    assert "must end in .png, .pdf or .svg" in capsys.readouterr().err
    for asked, said in ((["--goal", "powr", "--plot"], "--goal"), (["--goal", "mean_speed"], "give --plot too")):
        assert show_study.main([str(swum), *asked]) == 2
        assert said in capsys.readouterr().err


def test_an_interrupted_trial_is_shown_apart_from_failed_ones(
    resumed: Path, study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show_study.main([str(resumed)]) == 0
    out = capsys.readouterr().out
    assert "speed, 1 swim a fin: 2 OK, 1 INTERRUPTED" in out
    (line,) = (line for line in out.splitlines() if "0001 0002" in line)
    assert line.split()[-3:] == ["1", "0001", "0002"]
    assert "FAILED" not in out
    assert show_study.main([str(study)]) == 0
    out = capsys.readouterr().out
    assert "speed, 2 swims a fin: 4 OK, 1 FAILED, 1 INFEASIBLE" in out
    assert "INTER" not in out


@pytest.mark.parametrize("tool", [score_bag, show_study, export])
def test_a_tool_whose_reader_is_gone_ends_without_a_traceback(tool: ModuleType, resumed: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as pipe:
        ended = subprocess.run(
            [sys.executable, "-m", tool.__name__, str(resumed)],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ended.returncode == -signal.SIGPIPE
    assert "Error" not in ended.stderr


@pytest.mark.parametrize("tool", [show_study.main, export.main])
def test_what_is_no_study_is_said_so(
    tool: Callable[[list[str]], int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tool([str(tmp_path)]) == 2
    assert f"{tmp_path} holds no study" in capsys.readouterr().err


def test_the_journal_tells_how_fast_a_study_went(tmp_path: Path) -> None:
    details = {"measurement.settle": 0.5, "measurement.duration": 9.5}
    with Study.create(tmp_path / "study", Settings(SPACE, Policy(), details)) as study:
        with pytest.raises(StudyError, match="no trial of"):
            throughput(tmp_path / "study")
        swim(study, SEARCHES["hill climber"](), 4)
        first, last = study.trials[0].started, study.trials[-1].ended
    assert first is not None
    assert last is not None
    found = throughput(tmp_path / "study")
    assert (found.trials, found.swum) == (4, 40.0)
    assert found.seconds == pytest.approx((last - first).total_seconds())
    assert found.real_time_factor == pytest.approx(10.0 * found.trials_a_second)
