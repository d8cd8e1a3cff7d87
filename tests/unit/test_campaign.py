"""The paper's experiments: the same results on any executor, and after any kill."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.paper import campaign
from fin_optimizer.paper.experiments import (
    EXPERIMENTS,
    MODULUS,
    SIMULATION,
    Campaign,
    Run,
    groups,
    perform,
    planned_runs,
    speeds,
)
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.study.file_names import IMPORTANCE_FILE, PARALLEL_FILE, SLICES_FILE
from fin_sim.presets import preset

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_optimizer.paper.experiments import Table

SMALL = Campaign(
    hill_climber_runs=3, hill_climber_candidates=4, genetic_runs=2, population=12, generations=3, landscape=9
)
SIZES = [
    *("--hill-climber-runs", "3", "--hill-climber-candidates", "4", "--genetic-runs", "2"),
    *("--population", "12", "--generations", "3", "--landscape", "9"),
]


def command(folder: Path, *arguments: str) -> int:
    try:
        return campaign.main([*arguments, "--output", str(folder), *SIZES])
    except SystemExit as left:
        return int(left.code or 0)


def same(one: Table, other: Table) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


@pytest.fixture(scope="module")
def expected() -> dict[Run, Table]:
    """Return every run's result, each carried out alone."""
    return {run: perform([run])[0] for run in planned_runs(SMALL)}


def carried_out(folder: Path, executor: Executor) -> dict[Run, Table]:
    (folder / "runs").mkdir()
    with executor:
        return campaign.carry_out(planned_runs(SMALL), folder, executor, lambda *_: None)


def test_the_papers_sizes_are_the_default() -> None:
    paper = {
        name: experiment.runs(Campaign()) * experiment.swims(Campaign()) for name, experiment in EXPERIMENTS.items()
    }
    assert paper["hill_climber"] == 100 * 100
    assert paper["genetic"] == paper["shape"] == 30 * 100 * 100
    assert Campaign.clark().population == 125
    assert Campaign.clark().crossover


def test_results_do_not_depend_on_executor_or_grouping(tmp_path: Path, expected: dict[Run, Table]) -> None:
    for number, workers in enumerate((1, 2)):
        folder = tmp_path / str(number)
        folder.mkdir()
        results = carried_out(folder, ThreadPoolExecutor(workers))
        assert all(same(results[run], expected[run]) for run in expected)
    assert [len(group) for group in groups(planned_runs(SMALL))] == [1, 1, 1, 3, 1, 1, 1, 1, 1, 1, 1]


@pytest.mark.parametrize("workers", [pytest.param("1", marks=pytest.mark.long), "2"])
def test_the_command_writes_tables_and_figures_the_same_on_any_number_of_processes(
    tmp_path: Path, expected: dict[Run, Table], capsys: pytest.CaptureFixture[str], workers: str
) -> None:
    assert command(tmp_path / "out", "--workers", workers) == 0
    output = capsys.readouterr()
    assert "hinge stiffness" in output.out
    assert "swims in" in output.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    pictures = {f"paper_figure_{number}.png" for number in (4, 5, 6, 7)}
    of_several = {f"{one}_{name}" for one in ("shape", "cma") for name in (SLICES_FILE, PARALLEL_FILE, IMPORTANCE_FILE)}
    assert names == {"study.json", "runs", "candidates.npz", "runs.csv", "paper.md"} | pictures | of_several
    results = campaign.finished(tmp_path / "out", planned_runs(SMALL))
    assert all(same(results[run], expected[run]) for run in expected)
    with np.load(tmp_path / "out" / "candidates.npz") as table:
        assert len(table["speed"]) == sum(len(one["speed"]) for one in expected.values())
        assert set(table["experiment"]) == set(EXPERIMENTS)
    assert len((tmp_path / "out" / "runs.csv").read_text().splitlines()) == 1 + len(expected)


def test_a_campaign_cut_short_goes_on_to_the_results_of_an_uninterrupted_one(
    tmp_path: Path, expected: dict[Run, Table], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    assert command(folder, "hill_climber", "genetic") == 0
    kept = folder / "runs" / "genetic-000.npz"
    (folder / "runs" / "genetic-001.npz").unlink()
    (folder / "runs" / ".genetic-001.npz.1.part.npz").write_bytes(b"half a file")  # what a kill leaves behind
    before = kept.stat().st_mtime_ns
    repeated: list[Run] = []
    real = campaign.carry_out

    def watched(runs: Sequence[Run], folder: Path, executor: Executor, show: campaign.Show) -> dict[Run, Table]:
        repeated.extend(runs)
        return real(runs, folder, executor, show)

    monkeypatch.setattr(campaign, "carry_out", watched)
    assert command(folder, "hill_climber", "genetic") == 0
    assert [run.name for run in repeated] == ["genetic-001"]
    assert kept.stat().st_mtime_ns == before
    chosen = planned_runs(SMALL, ["hill_climber", "genetic"])
    results = campaign.finished(folder, chosen)
    assert all(same(results[run], expected[run]) for run in chosen)


class Killed(BaseException):
    """Stands for a kill."""


def test_a_kill_loses_the_run_under_way_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runs").mkdir()
    written: list[Path] = []

    def replace(part: Path, path: Path) -> None:
        if len(written) == 3:
            raise Killed
        written.append(path)
        part.rename(path)

    monkeypatch.setattr("pathlib.Path.replace", replace)
    with pytest.raises(Killed), ThreadPoolExecutor(1) as executor:
        campaign.carry_out(planned_runs(SMALL, ["genetic", "shape"]), tmp_path, executor, lambda *_: None)
    assert len(campaign.finished(tmp_path, planned_runs(SMALL))) == 3


def test_a_killed_command_leaves_no_process_and_is_resumed(tmp_path: Path) -> None:
    script = "from fin_optimizer.paper import campaign; campaign.main()"
    arguments = ["genetic", "--output", str(tmp_path), "--generations", "100", "--genetic-runs", "40"]
    session = subprocess.Popen(
        [sys.executable, "-c", script, *arguments], stderr=subprocess.PIPE, start_new_session=True
    )
    with session, contextlib.closing(session.stderr or io.BytesIO()):
        until(lambda: any((tmp_path / "runs").glob("genetic-*.npz")) if (tmp_path / "runs").exists() else False)
        session.kill()
    until(lambda: not members(session.pid))
    sizes = Campaign(generations=100, genetic_runs=40)
    kept = campaign.finished(tmp_path, planned_runs(sizes, ["genetic"]))
    assert 1 <= len(kept) < 40


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition; the test's own time limit ends it."""
    while not condition():
        time.sleep(0.02)


def members(session: int) -> list[int]:
    """Return the processes of a session that are alive."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, _, its_session = stat.read_text().rpartition(")")[2].split()[:4]
            if int(its_session) == session and state != "Z":
                found.append(int(stat.parent.name))
    return found


def test_climbers_in_step_are_the_hill_climber_of_a_study(expected: dict[Run, Table]) -> None:
    run = Run("hill_climber", 1, SMALL)
    climber = HillClimber(SMALL.stiffness(), run.seed, {MODULUS: np.sqrt(0.1) * 1e9})
    assert expected[run]["young_modulus"][0] == climber.propose([])[MODULUS]


def test_the_shape_keeps_the_area_and_the_length_its_range(expected: dict[Run, Table]) -> None:
    table = expected[Run("shape", 0, SMALL)]
    fin = preset(SIMULATION).fin
    assert table["length"] * table["height"] == pytest.approx(fin.area)
    assert table["length"].min() >= 0.04
    assert table["length"].max() <= 0.14
    assert set(expected[Run("genetic", 0, SMALL)]["length"]) == {fin.length}


def test_a_fin_that_is_refused_has_no_speed_and_spoils_no_other() -> None:
    swum = speeds({MODULUS: np.array([1.2e9, np.nan, 1e30, 1.2e9])}, preset(SIMULATION))
    assert np.isnan(swum).tolist() == [False, True, True, False]
    assert swum[0] == swum[3]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["flying"], "experiment = 'flying' is not known"),
        (["--modulus", "4", "0.5"], "upside down"),
        (["--genetic-runs", "0"], "genetic_runs"),
        (["--hill-climber-runs", "0"], "hill_climber_runs"),
        (["--workers", "0"], "--workers"),
        (["--seed", "-1"], "seed"),
        (["--dask", "tcp://127.0.0.1:1", "model"], "dask"),  # no scheduler there, or no Dask here
    ],
)
def test_what_is_refused_leaves_by_2_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], named: str
) -> None:
    sizes = SIZES[-2:] if "--dask" in arguments else []
    assert campaign.main([*arguments, "--output", str(tmp_path / "out"), *sizes]) == 2
    assert named in capsys.readouterr().err.replace("Dask", "dask")
    assert not (tmp_path / "out" / "candidates.npz").exists()


def test_an_unwritable_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("not a folder")
    assert command(tmp_path / "file" / "out", "model") == 2
    assert "cannot write to the folder" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "not a folder"


def test_what_cannot_swim_is_refused_before_its_folder_is_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(tmp_path / "out", "model", "--water", "bht") == 2
    assert "clamp = fixed with water.model = ideal_2d" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_half_a_result_is_named_and_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(tmp_path, "model", "simulation", "--workers", "1") == 0
    path = tmp_path / "runs" / "model-000.npz"
    half = path.read_bytes()[:200]
    path.write_bytes(half)
    assert command(tmp_path, "model", "simulation") == 2
    assert "model-000.npz is damaged" in capsys.readouterr().err
    assert path.read_bytes() == half
    path.write_bytes((tmp_path / "runs" / "simulation-000.npz").read_bytes())
    assert command(tmp_path, "model", "simulation") == 2
    assert "is that of run simulation-000" in capsys.readouterr().err


@pytest.mark.parametrize("told", ["of an older version", None])
def test_runs_that_another_simulator_swam_are_told_and_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], told: str | None
) -> None:
    assert command(tmp_path, "model", "simulation", "--workers", "1") == 0
    assert "another version" not in capsys.readouterr().err
    path = tmp_path / "runs" / "model-000.npz"
    with np.load(path) as content:
        columns = {name: content[name] for name in content.files if name != "simulator"}
    columns |= {} if told is None else {"simulator": np.array(told)}
    np.savez_compressed(path, allow_pickle=False, **columns)
    before = path.read_bytes()
    assert command(tmp_path, "model", "simulation") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert f"1 of the 2 finished runs in {tmp_path} were swum by another version of the simulator" in said
    assert path.read_bytes() == before


def test_a_folder_with_other_settings_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(tmp_path, "model", "--workers", "1") == 0
    before = (tmp_path / "study.json").read_bytes()
    assert command(tmp_path, "model", "--seed", "5") == 2
    assert "other settings (seed)" in capsys.readouterr().err
    assert (tmp_path / "study.json").read_bytes() == before
    (tmp_path / "study.json").write_text(json.dumps({**json.loads(before), "gills": 2}))
    assert command(tmp_path, "model") == 2
    assert "other settings (gills)" in capsys.readouterr().err
    (tmp_path / "study.json").write_text("{")
    assert command(tmp_path, "model") == 2
    assert json.loads(before)["population"] == 12


def test_a_folder_whose_runs_swam_another_fish_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(tmp_path, "model", "--workers", "1") == 0
    settings = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps({name: settings[name] for name in settings if name != "fish"}))
    assert command(tmp_path, "model") == 2
    assert "other settings (fish)" in capsys.readouterr().err
    settings["fish"]["clark2012_model"]["fish"]["body"]["drag_area"] *= 1.01
    (tmp_path / "study.json").write_text(json.dumps(settings))
    assert command(tmp_path, "simulation") == 2
    assert not (tmp_path / "runs" / "simulation-000.npz").exists()


def test_a_dask_cluster_gives_the_same_results(tmp_path: Path, expected: dict[Run, Table]) -> None:
    distributed = pytest.importorskip("distributed", reason="pip install -r requirements/bench.txt")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(host="127.0.0.1", protocol="tcp://", **options) as cluster:
        assert command(tmp_path, "hill_climber", "genetic", "--dask", cluster.scheduler_address) == 0
    chosen = planned_runs(SMALL, ["hill_climber", "genetic"])
    results = campaign.finished(tmp_path, chosen)
    assert all(same(results[run], expected[run]) for run in chosen)


def test_a_campaign_in_another_water_is_another_campaign_and_one_in_strips_the_same_as_ever(tmp_path: Path) -> None:
    sizes = {"genetic_runs": 1, "population": 2, "generations": 1, "landscape": 2}
    strips, ideal = Campaign(**sizes), Campaign(**sizes, water="paper_simulation")  # type: ignore[arg-type]
    assert Run("shape", 0, ideal).preset.fish.water.model == "surface_3d"
    assert Run("shape", 0, ideal).preset.fish.water.wake == "none"
    campaign._begin_folder(tmp_path / "strips", strips)
    campaign._refuse_another(tmp_path / "strips", strips)
    settings = json.loads((tmp_path / "strips" / "study.json").read_text())
    assert "water" not in settings  # as folders of older versions are
    assert "wake" not in settings["fish"]["clark2012_simulation"]["fish"]["water"]
    with pytest.raises(ValueError, match=r"other settings \(water"):
        campaign._refuse_another(tmp_path / "strips", ideal)
    with pytest.raises(ValueError, match="water = 'salt' is not known"):
        Campaign(water="salt")
