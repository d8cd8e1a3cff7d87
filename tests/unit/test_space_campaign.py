"""A campaign over a space: any search, the same results in step or alone, on any executor and after any kill."""

from __future__ import annotations

import os
import re
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.paper import campaign, space_report
from fin_optimizer.paper.space_campaign import (
    LATER,
    SWUM,
    SpaceCampaign,
    SpaceRun,
    later_experiment,
    own_value,
    perform,
    swim_candidates,
)
from fin_optimizer.search import names
from fin_optimizer.search.algorithms import ALGORITHMS
from fin_optimizer.search.many import columns_of
from fin_optimizer.search.space import Choice, generator, uniform
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_plant.paths import config_folder
from fin_sim.swim import swim

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    Table = Mapping[str, NDArray[np.float64]]

TEXT = """
search:
  fin.young_modulus: {minimum: 0.5 GPa, maximum: 4 GPa}
  fin.length: {minimum: 60 mm, maximum: 120 mm, step: 5 mm}
conditions:
  - fin.length >= 3 * fin.height
"""

OWN = {"amplitude": 0.26, "frequency": 1.0, "phase": 0.1, "bias": 0.1}
"""Numbers of a driven joint, whose table has no default."""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "space.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def small(file: Path, algorithm: str, **given: Any) -> SpaceCampaign:
    return SpaceCampaign.of_file(file, algorithm=algorithm, **{"runs": 2, "swims": 8, "duration": 1.0, **given})


def same(one: Table, other: Table) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def command(*arguments: str) -> int:
    try:
        return campaign.main(list(arguments))
    except SystemExit as left:
        return int(left.code or 0)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_search_swims_the_same_candidates_alone_and_in_step(file: Path, algorithm: str) -> None:
    population = {"genetic": 4, "cma_es": 5, "nsga2": 4}.get(algorithm, 0)
    runs = small(file, algorithm, population=population).planned()
    together = perform(runs)
    assert all(same(perform([run])[0], table) for run, table in zip(runs, together, strict=True))
    assert not same(*together)
    assert all(len(table["candidate"]) in (8, 10) for table in together)
    assert all((table["fin.length"] >= 0.075).all() for table in together)
    assert all(np.isfinite(table["mean_speed"]).all() for table in together)


def test_a_candidate_has_the_figures_of_its_swim(file: Path) -> None:
    given = small(file, "random", duration=4.0, settle=1.0)
    row = np.array([[1e9, 0.08]])
    swum = swim_candidates(given, row)
    alone = swim(Fin(young_modulus=1e9, length=0.08), duration=4.0)
    beats = 2.0 / PAPER_GAIT.joints[0].frequency  # two whole ones end with the window of 3 s
    window = alone.time >= 4.0 - beats
    speed, power = (alone.surge[window].mean(), alone.servo_power[window].mean())
    assert swum["mean_speed"][0] == pytest.approx(speed, rel=2e-3)
    assert swum["power"][0] == pytest.approx(power, rel=5e-3)
    assert swum["energy_per_metre"][0] == pytest.approx(power / speed, rel=5e-3)
    assert swum["efficiency"][0] == pytest.approx(swum["thrust"][0] * speed / power, rel=5e-3)


def test_the_command_leaves_tables_and_pictures_and_goes_on_after_a_kill(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    asked = [
        *("--space", str(file), "--algorithm", "nsga2", "--runs", "2", "--swims", "8", "--population", "4"),
        *(
            "--goal",
            "mean_speed",
            "--goal",
            "efficiency",
            "--constraint",
            "power <= 5 W",
            "--duration",
            "1",
            "--fin",
            "fin.density=1200",
        ),
        *("--output", str(folder), "--workers", "1"),
    ]
    assert command(*asked) == 0
    assert "Pareto front" in capsys.readouterr().out
    made = {path.name for path in folder.iterdir()}
    assert {"study.json", "runs", "candidates.npz", "runs.csv", "report.md", "pareto_front.png", "slices.png"} <= made
    first, second = (folder / "runs" / f"nsga2-00{number}.npz" for number in (0, 1))
    kept, lost = first.stat().st_mtime_ns, np.load(second)["mean_speed"]
    second.unlink()
    assert command(*asked) == 0
    assert first.stat().st_mtime_ns == kept
    assert np.array_equal(np.load(second)["mean_speed"], lost)
    assert (folder / "runs.csv").read_text().splitlines()[0].startswith("run,seed,swims,without_score,best_mean_speed")
    assert command(*asked, "--seed", "3") == 2
    assert "other settings (seed)" in capsys.readouterr().err


def test_the_best_of_a_report_meets_the_constraints(file: Path) -> None:
    given = small(file, "random", runs=2, goals=("mean_speed", "power"), constraints=("power <= 2 mW",))
    tables = [
        {name: np.full(3, 0.1) for name in run.columns}
        | {"mean_speed": 0.01 * np.array([1.0, 2.0, 3.0]), "power": 1e-3 * np.array([1.0, 1.5, 9.0])}
        for run in given.planned()
    ]
    told = space_report.report(given, tables)
    assert "2 of 6 swims have no score or miss a constraint" in told
    assert "best speed: 2.000 cm/s" in told
    assert "best power: 1.000 mW" in told


def test_results_do_not_depend_on_the_executor(file: Path, tmp_path: Path) -> None:
    given = small(file, "random", runs=3)
    (tmp_path / "runs").mkdir()
    with ThreadPoolExecutor(2) as executor:
        found = campaign.carry_out(given.planned(), tmp_path, executor, lambda *_: None)
    assert all(same(perform([run])[0], found[run]) for run in given.planned())


@pytest.mark.long
def test_a_dask_cluster_of_two_processes_gives_the_same_results(file: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="pip install -r requirements/bench.txt")
    given, folder = small(file, "random", runs=3), tmp_path / "out"
    asked = ["--space", str(file), "--algorithm", "random", "--runs", "3", "--swims", "8", "--duration", "1"]
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(host="127.0.0.1", protocol="tcp://", **options) as cluster:
        assert command(*asked, "--output", str(folder), "--dask", cluster.scheduler_address) == 0
        with distributed.Client(cluster, set_as_default=False) as client:
            assert len(set(client.run(os.getpid).values()) - {os.getpid()}) == 2
    found = campaign.finished(folder, given.planned())
    assert all(same(perform([run])[0], found[run]) for run in given.planned())


def test_a_folder_of_a_settled_window_says_so_and_another_is_as_ever(file: Path) -> None:
    """Older versions took all of the window, whose runs would be mixed with those of whole beats."""
    assert campaign._settings(small(file, "random", settle=0.5))["window"] == "whole beats"
    assert "window" not in campaign._settings(small(file, "random"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--algorithm", "gp"], "needs a space"),
        (["--space", "FILE"], "--space needs --algorithm"),
        (["--space", "FILE", "--algorithm", "gpp"], "--algorithm"),
        (["--space", "FILE", "--algorithm", "genetic", "--goal", "mean_sped"], "did you mean mean_speed"),
        (["--space", "FILE", "--algorithm", "genetic", "--goal", "turning_rate"], "cannot tell turning_rate"),
        (
            ["--space", "FILE", "--algorithm", "genetic", "--goal", "mean_speed", "--goal", "power"],
            "one objective only",
        ),
        (["--space", "FILE", "--algorithm", "gp", "--generations", "3"], "of the papers' experiments"),
        (["--space", "FILE", "--algorithm", "gp", "shape"], "carried out alone"),
        (["ices2014", "--fish", "clark2012_simulation"], "wrong servo power"),
        (["--space", "NONE", "--algorithm", "gp"], "cannot be read"),
    ],
)
def test_what_is_refused_leaves_by_2_and_writes_nothing(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    known = {"FILE": str(file), "NONE": str(tmp_path / "none.yaml")}
    folder = tmp_path / "out"
    assert command(*(known.get(each, each) for each in arguments), "--output", str(folder)) == 2
    assert told in capsys.readouterr().err
    assert not folder.exists()


def test_a_value_of_the_fin_is_read_with_its_unit() -> None:
    assert own_value("fin.thickness=1.2 mm") == ("fin.thickness", pytest.approx(1.2e-3))
    assert own_value("fin.segments=5") == ("fin.segments", 5)
    assert own_value("fin.hinges=between") == ("fin.hinges", "between")
    for text, told in {
        "fin.thickness=1.2 m": "fin.thickness = 1.2 m is outside",
        "fin.segments=0": "fin.segments = 0 is outside",
        "fin.segments=x": "'x' is no number",
        "fin.thickness": "fin.thickness = '' is no number with a unit",
        "fin.thicknes=1 mm": "fin.thicknes is not a parameter: did you mean fin.thickness",
    }.items():
        with pytest.raises(ValueError, match=f"^--fin {re.escape(text)}: {re.escape(told)}"):
            own_value(text)


def test_every_name_that_a_space_can_have_is_a_column(tmp_path: Path) -> None:
    """Of a fin with two heights and a tail of one joint; the first choice or number of each."""
    lines = ["search:", "  fin.profile_height: {points: 2, minimum: 20 mm, maximum: 30 mm}"]
    for name, entry in names.searchable(0, 1).items():
        if name in names.WHOLE and f"gait.joint_1.{names.WHOLE[name]}" in names.searchable(0, 1):
            continue  # the same number by another name
        if entry.choices:
            lines.append(f"  {name}: {{choices: [{', '.join(entry.choices)}]}}")
        else:
            middle = OWN.get(name.rpartition(".")[2], entry.default)
            assert isinstance(middle, int | float)
            low, high = (round(middle), round(middle) + 2) if entry.kind == "integer" else (middle, 1.1 * middle + 1e-4)
            lines.append(f"  {name}: {{minimum: {low!r}, maximum: {high!r}}}")
    path = tmp_path / "all.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    given = SpaceCampaign.of_file(path, algorithm="random", duration=1.0)
    space = given.start.space
    assert set(space.names) >= {name for name in names.searchable(0, 1) if name not in names.WHOLE}
    rows = np.array([space.row(uniform(space, generator(1, number))) for number in range(6)])
    assert np.isfinite(swim_candidates(given, rows)["mean_speed"]).all()


@pytest.mark.parametrize("name", ["drawer_of_sheets", "ices2014", "twenty_heights"])
def test_candidates_as_columns_are_what_a_plant_is_sent(name: str) -> None:
    given = SpaceCampaign.of_file(config_folder("fin_optimizer") / f"{name}.yaml", algorithm="random")
    found, space = given.start, given.start.space
    random = np.random.default_rng(4)
    low, high = space.bounds
    numbers = space.numbers(random.uniform(low, high, (40, len(low))))
    assert space.refused(numbers).tolist() == [
        place for place, row in enumerate(numbers.tolist()) if space.judge(space.values(row))
    ]
    allowed = np.delete(numbers, space.refused(numbers), axis=0)
    columns = columns_of(space, found.rules, found.start, allowed)
    for place, row in enumerate(allowed.tolist()):
        sent = found.rules.sent(found.start, space.values(row))
        for parameter, value in Fin.from_parameters(sent).as_parameters().items():
            column = columns.parameters[parameter]
            own = column[place] if np.ndim(column) and len(column) == len(allowed) else column
            assert np.array_equal(np.asarray(own), np.asarray(value)) or own == pytest.approx(value)


@pytest.mark.parametrize("name", LATER)
def test_a_later_experiment_is_ready(name: str) -> None:
    given = later_experiment(name)
    assert given.planned()[-1].number == given.runs - 1
    rows = np.array([given.start.space.row(uniform(given.start.space, generator(1, 1)))])
    assert not len(given.start.space.refused(rows))


def test_the_spread_of_the_runs_is_that_of_a_sample(file: Path) -> None:
    given = small(file, "random", runs=3)
    tables = [{name: np.full(2, 0.01) for name in run.columns} for run in given.planned()]
    for table, best in zip(tables, (0.01, 0.02, 0.03), strict=True):
        table["mean_speed"] = np.array([0.001, best])
    told = space_report.report(given, tables)
    assert "* best speed: 3.000 cm/s; the runs' bests: mean 2.000 cm/s, standard deviation 1.000 cm/s\n" in told


def test_the_front_is_what_nothing_beats(file: Path) -> None:
    given = small(file, "nsga2", goals=("mean_speed", "power"), population=4)
    random = np.random.default_rng(2)
    table = {name: random.normal(size=300) for name in SpaceRun(given, 0).columns}
    table["mean_speed"][5] = np.nan
    good = np.array([table["mean_speed"], -table["power"]])
    beaten = [
        np.isnan(good[0, i]) or bool(((good >= good[:, [i]]).all(axis=0) & (good > good[:, [i]]).any(axis=0)).any())
        for i in range(300)
    ]
    front = space_report.front_places(given, table)
    assert sorted(front.tolist()) == [i for i in range(300) if not beaten[i]]
    assert (np.diff(table["mean_speed"][front]) < 0.0).all()
    assert set(SWUM) <= table.keys()
    assert not any(isinstance(dimension, Choice) for dimension in given.start.space.dimensions)
