"""The benchmark: figures that are there and hang together; nothing here depends on how fast the machine is."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest

from fin_bringup.benchmarks import command, measuring, mujoco_fish, other_programs, profile, swims, trials
from fin_bringup.benchmarks.measuring import PAPER, Sizes
from fin_bringup.benchmarks.trials import Throughput
from fin_sim.swim import swim

if TYPE_CHECKING:
    from collections.abc import Callable


def test_operations_are_counted_and_the_profile_is_that_of_the_times_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = iter((4.0, 1.0, 0.25))  # s: a batch, one of hardly a step, multiplications and additions alone

    def core_time(work: Callable[[], object], repeats: int) -> float:
        assert repeats == 1
        work()
        return next(taken)

    monkeypatch.setattr(profile, "core_time", core_time)
    counted = profile.operations()
    assert counted["multiply"] > 300
    assert counted["square_root"] == 1
    figures = profile.profile(Sizes(1, (1,), (1,), (1e-3,), 1))
    swims, steps = 4.0 / figures["core_us_per_swim"] * 1e6, round(measuring.DURATION * 56 * 0.9)
    assert swims == measuring.MANY
    assert figures["set_up_us_per_swim"] == pytest.approx(1e6 / swims)
    assert figures["ns_per_step_of_a_fish"] == pytest.approx(3e9 / swims / steps, rel=1e-2)
    done = sum(counted.values()) * steps * swims
    assert figures["gflops"] == pytest.approx(done / 3.0 / 1e9, rel=1e-2)
    assert figures["gflops_limit"] == pytest.approx(2 * 16 * 64 * 100_000 / 0.25 / 1e9)
    assert figures["share_of_limit"] == pytest.approx(figures["gflops"] / figures["gflops_limit"])


@pytest.mark.long
def test_every_water_has_its_cost() -> None:
    rows = swims.waters(Sizes(1, (1,), (1,), (1e-3,), 1))
    assert [(row["model"], row["wake"]) for row in rows[:2]] == [("strip", "lighthill"), ("surface_3d", "lighthill")]
    assert all(row["alone_ms"] > 0.0 for row in rows)
    assert {row["drag"] for row in rows if "core_ms" not in row} == {"off"}


def test_lanes_are_within_a_thousandth_and_time_a_swim() -> None:
    rows = swims.methods(Sizes(1, (1,), (1,), (1e-3,), 1))
    assert all(row["error"] < 1e-3 for row in rows)
    assert all(row["core_ms"] > 0.0 for row in rows)


def test_scipy_solves_the_same_equations() -> None:
    expected = swim(PAPER.fin, PAPER.fish, reactive=PAPER.reactive).mean_speed
    assert other_programs.scipy_swim(1e-5) == pytest.approx(expected, rel=1e-5)


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_command_prints_json(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco", reason="pip install -r requirements/bench.txt")
    monkeypatch.setattr(command, "QUICK", Sizes(1, (1, 16), (1, 3), (4e-3, 2e-3), 1))
    monkeypatch.setattr(swims, "WATERS", swims.WATERS[:2])
    monkeypatch.setattr(trials, "trial_loop", lambda count, duration: Throughput(count, 0.5, count * duration))
    command.main(["--quick", "--json"])
    figures = json.loads(capsys.readouterr().out)
    assert figures["others"]["MuJoCo rollout"]["core_ms"] > 0.0
    assert figures["times_faster_than"]["SciPy solve_ivp"] > 1.0
    assert "| MuJoCo rollout |" in command.text(figures)
    assert "| 1 | 10 s | 2.0 | 20 |" in command.text(figures)


def test_what_is_refused_leaves_by_2(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert command.main(["--repeats", "0"]) == 2

    def missing() -> None:
        msg = "the comparison needs MuJoCo"
        raise ValueError(msg)

    monkeypatch.setattr(mujoco_fish, "require", missing)
    assert command.main(["--quick"]) == 2
    assert "needs MuJoCo" in capsys.readouterr().err


def test_core_time_does_not_count_other_threads() -> None:
    with ThreadPoolExecutor(1) as other:
        busy = other.submit(lambda: sum(range(10**6)))
        assert measuring.core_time(lambda: None, 3) < 1e-3
        busy.result()
