"""A study through the graph in each kind of water."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import pytest

from fin_plant.fin import Fin
from fin_sim.fish import Fish
from fin_sim.swim import SIMULATOR_PARAMETERS, swim
from fin_sim.water_settings import PRESETS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = [pytest.mark.graph, pytest.mark.long]
DAMPING_TIME = 0.1
"""Of the fins, s: without drag nothing else keeps one from folding onto itself near its resonance."""


@pytest.mark.parametrize("water", PRESETS)
def test_a_study_runs_in_each_water(water: str, start: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / "study"
    arguments = (f"study_folder:={folder}", "trials:=3", f"water.preset:={water}", f"fin.damping_time:={DAMPING_TIME}")
    process = start("fin_bringup", "bringup", *arguments)
    assert process.wait(timeout=900.0) == 0, process.tail()
    with (folder / "trials.csv").open(newline="") as file:
        trials = [row for row in csv.DictReader(file) if row["outcome"] == "OK"]
    assert [int(row["fin"]) for row in trials] == [1, 2, 3]
    fish = Fish.from_parameters(SIMULATOR_PARAMETERS.checked({"water.preset": water}))
    fin = Fin(young_modulus=float(trials[-1]["fin.young_modulus [Pa]"]), damping_time=DAMPING_TIME)
    speed = float(trials[-1]["speed [m/s]"])
    assert speed == pytest.approx(swim(fin, fish, duration=10.0).mean_forward_speed, rel=0.01, abs=1e-6)
