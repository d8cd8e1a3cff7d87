"""The benchmark: figures that are there and hang together; nothing here depends on how fast the machine is."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from fin_bringup import bench, mujoco_fish
from fin_bringup.throughput import Throughput
from fin_sim import swim


def test_operations_are_counted_and_the_profile_adds_up() -> None:
    counted = bench.operations()
    assert counted["multiply"] > 300
    assert counted["square_root"] == 1
    figures = bench.profile(bench.Sizes(1, (1,), (1,), (1e-3,), 1))
    assert 0.0 < figures["share_of_limit"] < 1.0
    assert figures["set_up_us_per_swim"] < figures["core_us_per_swim"]


def test_lanes_are_within_a_thousandth_and_time_a_swim() -> None:
    rows = bench.methods(bench.Sizes(1, (1,), (1,), (1e-3,), 1))
    assert all(row["error"] < 1e-3 for row in rows)
    assert all(row["core_ms"] > 0.0 for row in rows)


def test_scipy_solves_the_same_equations() -> None:
    assert bench.scipy_swim(1e-5) == pytest.approx(swim(reactive="tip").mean_speed, rel=1e-5)


@pytest.mark.timeout(300)
def test_the_command_prints_json(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco", reason="pip install -r requirements/bench.txt")
    monkeypatch.setattr(bench, "QUICK", bench.Sizes(1, (1, 16), (1, 3), (4e-3, 2e-3), 1))
    monkeypatch.setattr(bench, "trial_loop", lambda trials, duration: Throughput(trials, 0.5, trials * duration))
    bench.main(["--quick", "--json"])
    figures = json.loads(capsys.readouterr().out)
    assert figures["others"]["MuJoCo rollout"]["core_ms"] > 0.0
    assert figures["times_faster_than"]["SciPy solve_ivp"] > 1.0
    assert "| MuJoCo rollout |" in bench.text(figures)
    assert "| 1 | 10 s | 2.0 | 20 |" in bench.text(figures)


def test_what_is_refused_leaves_by_2(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SystemExit) as left:
        bench.main(["--repeats", "0"])
    assert left.value.code == 2

    def missing() -> None:
        msg = "the comparison needs MuJoCo"
        raise ValueError(msg)

    monkeypatch.setattr(mujoco_fish, "require", missing)
    with pytest.raises(SystemExit) as left:
        bench.main(["--quick"])
    assert left.value.code == 2
    assert "needs MuJoCo" in capsys.readouterr().err


def test_core_time_does_not_count_other_threads() -> None:
    with ThreadPoolExecutor(1) as other:
        busy = other.submit(lambda: sum(range(10**6)))
        assert bench.core_time(lambda: None, 3) < 1e-3
        busy.result()
