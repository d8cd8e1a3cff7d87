"""The settings of the water: what each switches off, what then is conserved, and how presets and words are read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fin_plant.fin import Fin
from fin_sim.angular_momentum import angular_momentum_budget
from fin_sim.batch import swim_batch
from fin_sim.energy import energy_budget
from fin_sim.fish import Fish, Water
from fin_sim.swim import PAPER_FISH, SIMULATOR_PARAMETERS, Swim, swim
from fin_sim.swim_command.axes import parse_axis, varied_plans
from fin_sim.swim_command.plan import SwimPlan
from fin_sim.water_settings import PRESETS, Settings, settings

SOFT = Fin(young_modulus=1e9, damping_time=0.03)
NO_WAKE = replace(PAPER_FISH, water=replace(PAPER_FISH.water, wake="none"))
IDEAL = replace(PAPER_FISH, water=replace(PAPER_FISH.water, wake="none", drag="off"))


@pytest.fixture(name="ideal", scope="module")
def _ideal() -> Swim:
    return swim(SOFT, IDEAL, duration=4.0)


def test_presets_name_the_three_settings_and_what_is_given_takes_their_place() -> None:
    assert settings("strip") == Settings("strip", "lighthill", "on")
    assert settings("soleil", wake="lighthill") == Settings("surface_3d", "lighthill", "off")
    assert settings("bht", "strip", drag="on") == Settings("strip", "none", "on")
    for name, choices in (("preset", PRESETS), ("model", ()), ("wake", ()), ("drag", ())):
        entry = SIMULATOR_PARAMETERS[f"water.{name}"]
        assert entry.decides_swim
        assert entry.earlier == entry.default  # of a study that was begun before there were settings
        assert set(choices) <= set(entry.choices)


@pytest.mark.parametrize("name", ["preset", "model", "wake", "drag", "tip_term"])
def test_an_unknown_setting_is_refused_by_its_name(name: str) -> None:
    with pytest.raises(ValueError, match=rf"water\.{name} = 'maybe'"):
        Fish.from_parameters(SIMULATOR_PARAMETERS.checked({f"water.{name}": "maybe"}))
    if name != "preset":
        with pytest.raises(ValueError, match=rf"water\.{name} = 'maybe'"):
            Water(**{name: "maybe"})  # type: ignore[arg-type]


def test_without_wake_a_free_fish_that_nothing_resists_keeps_its_momentum(ideal: Swim) -> None:
    budget = angular_momentum_budget(ideal)
    assert np.ptp(ideal.heading) > 0.01
    largest = np.max(np.abs(budget.stored - budget.stored[0]))
    beating = np.max(np.abs(ideal.chain.body_vector()[2] * ideal.yaw_rate))
    assert largest < 1e-5 * beating
    assert not np.any(budget.wake) and not np.any(budget.resistive) and not np.any(budget.body)  # noqa: PT018


def test_without_wake_and_drag_the_servos_work_is_stored_or_lost_in_the_hinges(ideal: Swim) -> None:
    budget = energy_budget(ideal)
    assert not any(np.any(loss) for loss in (budget.wake, budget.resistive, budget.drag, budget.yaw_damping))
    gained = np.trapezoid(budget.supplied - budget.lost, ideal.time)
    turned_over = float(np.trapezoid(np.abs(budget.supplied), ideal.time))
    assert budget.stored[-1] == pytest.approx(gained, abs=1e-3 * turned_over)


def test_without_wake_a_held_fish_has_no_mean_thrust() -> None:
    with_wake = swim(SOFT, duration=12.0 / 0.9, clamp="fixed")
    without = swim(SOFT, NO_WAKE, duration=12.0 / 0.9, clamp="fixed")
    resisting = replace(NO_WAKE, water=replace(NO_WAKE.water, drag="off"))
    nothing = swim(SOFT, resisting, duration=12.0 / 0.9, clamp="fixed")
    assert np.all(nothing.convective_force == 0.0)
    assert abs(without.mean_thrust) < 0.5 * with_wake.mean_thrust  # what the resistive force along the bent fin leaves


def test_without_wake_the_form_of_its_force_does_not_count() -> None:
    assert swim(SOFT, NO_WAKE, duration=1.0, reactive="tip").x[-1] == swim(SOFT, NO_WAKE, duration=1.0).x[-1]


@pytest.mark.parametrize("fish", [NO_WAKE, IDEAL], ids=["no wake", "no wake, no drag"])
def test_a_batch_swims_as_the_general_kernel_does(fish: Fish) -> None:
    fins = [SOFT, replace(SOFT, young_modulus=3e9, tip_height=0.04)]
    batch = swim_batch(fins, fish, duration=4.0, threads=1)
    for fin, speed in zip(fins, batch.mean_speed, strict=True):
        assert speed == pytest.approx(swim(fin, fish, duration=4.0).mean_speed, rel=1e-3)


def test_words_vary_as_numbers_do() -> None:
    axis = parse_axis("water.wake=lighthill,none")
    plans = varied_plans(SwimPlan({}), [axis, parse_axis("fin.young_modulus=1e9,2e9")])
    assert [numbers[0] for numbers, _ in plans] == ["lighthill", "lighthill", "none", "none"]
    assert [plan.fish().water.wake for _, plan in plans] == ["lighthill", "lighthill", "none", "none"]
    with pytest.raises(ValueError, match=r"water\.drag = 'maybe'"):
        parse_axis("water.drag=on,maybe")
