"""The papers' fish under ``fin_sim/config``: every number said, and the printed hinge stiffnesses follow."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.gait import PAPER_GAIT
from fin_sim.batch import swim_batch
from fin_sim.chain import fin_links
from fin_sim.paper_models import speed_from_thrust
from fin_sim.presets import PRESETS, preset
from fin_sim.swim import SIMULATOR_PARAMETERS, swim

CONFIG = Path(__file__).parents[2] / "ros2_ws" / "src" / "fin_sim" / "config"


@pytest.mark.parametrize("name", PRESETS)
def test_preset_says_every_number_of_fish_and_fin_with_its_reason(name: str) -> None:
    path = CONFIG / f"{name}.yaml"
    lines = path.read_text(encoding="utf-8").splitlines()
    given = {line.split(":")[0].strip(): line for line in lines if line.startswith("    ")}
    table = {**FIN_PARAMETERS, **SIMULATOR_PARAMETERS}
    wanted = {n for n, entry in table.items() if n.startswith(("fin.", "body.", "water.")) and entry.kind == "double"}
    assert wanted | {"reactive", "fin.hinges", "fin.stiffness_length", "fin.segments"} <= given.keys()
    for line in given.values():
        assert " # " in line, line


def test_fins_length_in_equation_3_gives_both_printed_stiffnesses_at_three_tenths_of_a_millimetre() -> None:
    fin = preset("clark2012_simulation").fin
    assert fin.thickness == 3.0e-4
    assert replace(fin, young_modulus=1.9e9).hinge_stiffness(0.04) == pytest.approx(1.35e-3, rel=0.02)
    assert replace(fin.at_length(0.14), young_modulus=7.55e9).hinge_stiffness(0.07) == pytest.approx(1.73e-3, rel=0.02)


@pytest.mark.parametrize(("hinges", "passive"), [("between", 2), ("midpoint", 3)])
def test_damping_of_the_hinge_adds_to_the_material_s(hinges: str, passive: int) -> None:
    fin = Fin(hinges=hinges, segments=3, damping_time=0.02, hinge_damping=3e-4)  # type: ignore[arg-type]
    links, driven = fin_links(fin)
    assert driven == (True,) + (False,) * passive
    assert links[0].damping == 0.0
    for link in links[1:]:
        assert link.damping == pytest.approx(0.02 * link.stiffness + 3e-4)


def test_model_and_simulation_of_2012_have_the_peaks_that_were_published() -> None:
    modulus = np.geomspace(0.5e9, 4.75e9, 15)
    model, simulated = preset("clark2012_model"), preset("clark2012_simulation")
    held = [
        speed_from_thrust(
            swim(
                replace(model.fin, young_modulus=float(e)),
                model.fish,
                duration=12 / 0.9,
                reactive="tip",
                clamp="fixed",
                step=4e-3,
            ).mean_thrust,
            model.fish.body.drag_area,
        )
        for e in modulus
    ]
    free = [
        swim(replace(simulated.fin, young_modulus=float(e)), simulated.fish, reactive="tip", step=4e-3).mean_speed
        for e in modulus
    ]
    assert 100.0 * max(held) == pytest.approx(5.04, rel=0.05)  # figure 4
    assert 1e-9 * modulus[int(np.argmax(held))] == pytest.approx(0.85, rel=0.1)
    assert 100.0 * max(free) == pytest.approx(1.38, rel=0.05)  # figure 5
    assert 1e-9 * modulus[int(np.argmax(free))] == pytest.approx(1.9, rel=0.1)


@pytest.mark.parametrize("name", ["clark2012_simulation", "clark2012_model"])
def test_batch_swims_a_preset_as_the_general_kernel_does(name: str) -> None:
    given = preset(name)
    clamp = "fixed" if name == "clark2012_model" else "free"
    fins = [replace(given.fin, young_modulus=modulus) for modulus in (0.3e9, 0.9e9, 4.0e9)]
    batch = swim_batch(fins, given.fish, PAPER_GAIT, 10.0, reactive="tip", clamp=clamp, settle=5.0)  # type: ignore[arg-type]
    for index, fin in enumerate(fins):
        one = swim(fin, given.fish, PAPER_GAIT, 10.0, reactive="tip", clamp=clamp)  # type: ignore[arg-type]
        assert batch.mean_speed[index] == pytest.approx(one.mean_speed, rel=1e-3, abs=1e-6)
        assert batch.largest_hinge_angle[index] == pytest.approx(one.largest_hinge_angle, rel=2e-2)


def test_hinges_with_little_damping_swim_in_lanes_at_shorter_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The general kernel would take a hundred times as long, and its last digit depends on who compiled it."""

    def refuse(*_: object) -> None:
        pytest.fail("swum by the general kernel")

    monkeypatch.setattr(import_module("fin_sim.batch.swim_batch"), "swim_by_general_kernel", refuse)
    given = preset("clark2012_simulation")
    fins = [replace(given.fin.at_length(0.04), young_modulus=modulus) for modulus in (5e9, 10e9, 20e9)]
    shares = [1.3e-4 / fin.hinge_stiffness(0.01) / (1.0 / (56.0 * 0.9)) for fin in fins]
    assert shares == pytest.approx([0.466, 0.233, 0.117], rel=0.01)  # 0.4 is the least for a whole step
    swum = swim_batch(fins, given.fish, PAPER_GAIT, 10.0, reactive="tip", settle=5.0)
    for index, fin in enumerate(fins):
        one = swim(fin, given.fish, PAPER_GAIT, 10.0, reactive="tip")
        assert swum.mean_speed[index] == pytest.approx(one.mean_speed, rel=1e-3)
