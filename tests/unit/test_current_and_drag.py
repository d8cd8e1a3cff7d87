"""A steady current and a drag with a viscous part: known answers, in the general kernel and in the batch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fin_plant.gait import Gait, JointDrive
from fin_sim import dynamics, time_stepping
from fin_sim.batch import Status, swim_batch
from fin_sim.chain import Chain
from fin_sim.energy import energy_budget
from fin_sim.fish import Fish, Link, Water
from fin_sim.stream_messages import StreamMessages
from fin_sim.swim import Swim, swim
from support.paper_fish import BODY, FIN

GAIT = Gait((JointDrive(math.radians(15.0), 0.9, 0.0, math.radians(5.0)),))
STILL, STREAM = Water(1000.0, 1.0), Water(1000.0, 1.0, current_x=0.02, current_y=-0.03)


def swum(water: Water, **arguments: object) -> Swim:
    return swim(FIN, Fish(BODY, water), GAIT, 4.0, **arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def still() -> Swim:
    return swum(STILL)


@pytest.fixture(scope="module")
def streaming() -> Swim:
    return swum(STREAM)


def test_a_fish_in_a_current_swims_as_in_still_water_and_drifts(still: Swim, streaming: Swim) -> None:
    assert streaming.x - 0.02 * streaming.time == pytest.approx(still.x, abs=1e-12)
    assert streaming.y + 0.03 * streaming.time == pytest.approx(still.y, abs=1e-12)
    assert streaming.heading == pytest.approx(still.heading, abs=1e-12)
    assert streaming.servo_power == pytest.approx(still.servo_power, abs=1e-12)


def test_velocity_over_ground_is_the_rate_of_the_position_and_through_the_water_that_of_still_water(
    still: Swim, streaming: Swim
) -> None:
    sine, cosine = np.sin(streaming.heading), np.cos(streaming.heading)
    moved = np.trapezoid(streaming.surge * cosine - streaming.sway * sine, streaming.time)
    assert moved == pytest.approx(streaming.x[-1], abs=1e-5)
    moved = np.trapezoid(streaming.surge * sine + streaming.sway * cosine, streaming.time)
    assert moved == pytest.approx(streaming.y[-1], abs=1e-5)
    assert streaming.water_surge == pytest.approx(still.surge, abs=1e-12)
    assert streaming.water_sway == pytest.approx(still.sway, abs=1e-12)


def test_figures_of_propulsion_are_those_through_the_water(still: Swim, streaming: Swim) -> None:
    for name in ("efficiency", "strouhal_number", "cost_of_transport", "tip_amplitude", "mean_thrust"):
        assert getattr(streaming, name) == pytest.approx(getattr(still, name), rel=1e-6), name
    assert streaming.steady_speed != pytest.approx(still.steady_speed, rel=0.05)


def test_the_velocity_topic_is_over_ground() -> None:
    chain = Chain(BODY, (Link(0.08, 0.025, 0.025),), (True,), STREAM)
    state, record = np.zeros((1, 8)), np.zeros((1, dynamics.RECORD_HEAD + 1))
    state[0, dynamics.HEADING] = 0.5 * math.pi
    state[0, dynamics.SURGE] = 0.1
    streams = StreamMessages(chain)
    velocity = streams.serialized(np.zeros(1, dtype=np.int64), state, record)[2][0]
    numbers = np.frombuffer(velocity[-48:], dtype="<f8")  # linear x, y, z and angular x, y, z end the message
    assert numbers[:2] == pytest.approx([0.1 - 0.03, -0.02])


def test_a_body_held_in_a_stream_is_one_towed_against_it() -> None:
    held = swum(Water(1000.0, 1.0, current_x=-0.03), clamp="fixed")
    towed = swum(STILL, clamp="towed", tow_speed=0.03)
    assert np.ptp(held.x) == np.ptp(held.surge) == 0.0
    assert held.mean_thrust == pytest.approx(towed.mean_thrust, rel=1e-9)
    assert held.efficiency == pytest.approx(towed.efficiency, rel=1e-9)
    assert held.tip_amplitude == pytest.approx(towed.tip_amplitude, rel=1e-9)
    budgets = energy_budget(held), energy_budget(towed)
    assert budgets[0].tow == pytest.approx(budgets[1].tow, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("clamp", ["free", "fixed", "towed"])
@pytest.mark.parametrize("damping_time", [0.01, 0.0])  # in lanes and by the general kernel
def test_the_batch_swims_in_a_current(clamp: str, damping_time: float) -> None:
    fish, fin = Fish(BODY, STREAM), replace(FIN, damping_time=damping_time)
    speed = 0.05 if clamp == "towed" else 0.0
    batch = swim_batch([fin], fish, GAIT, 4.0, clamp=clamp, tow_speed=speed, threads=1)  # type: ignore[arg-type]
    one = swim(fin, fish, GAIT, 4.0, clamp=clamp, tow_speed=speed)  # type: ignore[arg-type]
    assert batch.status[0] == Status.OK
    assert batch.mean_speed[0] == pytest.approx(one.mean_speed, rel=1e-3)
    assert batch.mean_forward_speed[0] == pytest.approx(np.trapezoid(one.surge, one.time) / 4.0, rel=1e-3, abs=1e-12)
    assert [batch.x[0], batch.y[0]] == pytest.approx([one.x[-1], one.y[-1]], abs=1e-4)
    assert batch.servo_power[0] == pytest.approx(np.trapezoid(one.servo_power, one.time) / 4.0, rel=6e-3, abs=1e-7)


def test_coasting_against_linear_and_quadratic_drag_has_the_closed_form() -> None:
    """With m dV/dt = -(a V + b V^2): V = a V0 q / (a + b V0 (1 - q)), q = exp(-a t / m)."""
    linear, speed, span = 0.02, 0.3, 8.0
    body = replace(BODY, linear_drag=linear)
    chain = Chain(body, (Link(1e-4, 1e-6, 1e-6),), (True,), STILL)
    stepper = time_stepping.Stepper(chain, 1e-3, 1000)
    state = stepper.start()
    state[dynamics.SURGE] = speed
    states, _ = stepper.advance(state, np.zeros((2 * 1000 * int(span) + 1, 1, 3)))
    mass, quadratic = body.mass + body.added_surge, 0.5 * 1000.0 * body.drag_area
    left = np.exp(-linear * np.arange(span + 1.0) / mass)
    expected = linear * speed * left / (linear + quadratic * speed * (1.0 - left))
    assert states[:, dynamics.SURGE] == pytest.approx(expected, rel=1e-7)


def test_the_energy_lost_to_a_linear_drag_is_accounted_for() -> None:
    drive = Gait((JointDrive(math.radians(15.0), 0.9),))
    result = swim(FIN, Fish(replace(BODY, linear_drag=0.02), STILL), drive, 4.0, sample_time=2e-3)
    budget = energy_budget(result)
    gained = result.duration * result.mean_between(budget.supplied - budget.lost, 0.0, result.duration)
    assert gained == pytest.approx(budget.stored[-1] - budget.stored[0], abs=1e-4 * np.ptp(budget.stored))


@pytest.mark.parametrize("damping_time", [0.01, 0.0])
def test_the_batch_has_the_linear_drag(damping_time: float) -> None:
    fish, fin = Fish(replace(BODY, linear_drag=0.02), STILL), replace(FIN, damping_time=damping_time)
    batch = swim_batch([fin], fish, GAIT, 4.0, threads=1)
    assert batch.mean_speed[0] == pytest.approx(swim(fin, fish, GAIT, 4.0).mean_speed, rel=1e-3)
    assert batch.mean_speed[0] < 0.95 * swim(fin, Fish(BODY, STILL), GAIT, 4.0).mean_speed
