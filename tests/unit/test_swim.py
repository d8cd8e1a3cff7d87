"""A swim's figures: definitions on swims whose answers are known, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, carangiform, sub_carangiform
from fin_sim.fish import Fish, Link
from fin_sim.paper_models import mathematical_model, mean_thrust_held, simulation, speed_from_thrust, towed
from fin_sim.swim import PAPER_FISH, SIMULATOR_PARAMETERS, Swim, swim
from support.paper_fish import FIN, FISH


@pytest.fixture(name="paper_swim", scope="module")
def _paper_swim() -> Swim:
    return swim(FIN, FISH, duration=20.0)


@pytest.fixture(name="turn", scope="module")
def _turn() -> Swim:
    return swim(gait=Gait((JointDrive(0.2, 0.9, bias=0.2),)), duration=20.0)


def test_mean_speed_runs_from_start_to_end(paper_swim: Swim) -> None:
    assert paper_swim.mean_speed == pytest.approx(math.hypot(paper_swim.x[-1], paper_swim.y[-1]) / 20.0)


def test_steady_speed_is_higher_than_the_mean_from_rest_and_close_to_the_forward_speed(paper_swim: Swim) -> None:
    assert paper_swim.steady_speed > paper_swim.mean_speed
    assert paper_swim.steady_speed == pytest.approx(paper_swim.beat_mean(paper_swim.surge), rel=5e-3)


def test_steady_thrust_balances_the_drag(paper_swim: Swim) -> None:
    body = paper_swim.chain.body
    drag = 500.0 * body.drag_area * paper_swim.beat_mean(np.hypot(paper_swim.surge, paper_swim.sway) * paper_swim.surge)
    # Lift and the fish's slow acceleration are what is left.
    assert paper_swim.mean_thrust == pytest.approx(drag, rel=0.1)


def test_beats_end_with_the_swim_and_need_not_end_on_a_sample(paper_swim: Swim) -> None:
    assert np.diff(paper_swim.beats) == pytest.approx(np.full(3, 1.0 / 0.9))
    assert paper_swim.beats[-1] == 20.0
    wave = np.sin(2.0 * math.pi * 0.9 * paper_swim.time + 0.3)
    assert abs(paper_swim.beat_mean(wave)) < 1e-7


def test_strouhal_number_and_cost_of_transport_follow_their_definitions(paper_swim: Swim) -> None:
    speed = paper_swim.steady_speed
    assert paper_swim.strouhal_number == pytest.approx(0.9 * 2.0 * paper_swim.tip_amplitude / speed)
    fin = 0.025 * 0.08 * 2.08e-4 * 1180.0
    assert paper_swim.mass == pytest.approx(PAPER_FISH.body.mass + fin)
    assert paper_swim.cost_of_transport == pytest.approx(paper_swim.mean_servo_power / (paper_swim.mass * speed))


def test_efficiency_is_between_nought_and_one(paper_swim: Swim) -> None:
    assert 0.0 < paper_swim.efficiency < 1.0


def test_bias_to_the_left_turns_the_tail_left_and_the_fish_right(turn: Swim) -> None:
    assert turn.turning_rate < -0.01
    assert turn.turning_radius == pytest.approx(turn.steady_speed / abs(turn.turning_rate))


def test_straight_swim_has_a_turning_radius_of_metres_at_least(paper_swim: Swim) -> None:
    assert paper_swim.turning_radius > 10.0


def test_tip_amplitude_of_a_held_plate_is_its_length_times_the_sine() -> None:
    plate = swim(Fin(segments=1, hinges="between"), duration=5.0, clamp="fixed")
    assert plate.tip_amplitude == pytest.approx(0.08 * math.sin(math.radians(15.0)), rel=1e-4)
    assert plate.strouhal_number == math.inf
    assert plate.cost_of_transport == math.inf
    assert plate.efficiency == 0.0


def test_tip_path_starts_behind_the_body(paper_swim: Swim) -> None:
    assert paper_swim.tip_path[0] == pytest.approx((-0.07 - 0.08, 0.0))
    assert paper_swim.joint_path.shape == (len(paper_swim.time), 4, 2)


def test_path_is_longer_than_the_distance(paper_swim: Swim) -> None:
    assert paper_swim.path_length > 20.0 * paper_swim.mean_speed


def test_largest_servo_torque_is_one_of_the_servos(paper_swim: Swim) -> None:
    after = paper_swim.joint_torques[paper_swim.time >= 0.5]
    assert paper_swim.largest_servo_torque == np.abs(after[:, 0]).max()


@pytest.mark.parametrize("duration", [0.3, 0.5])
def test_largest_servo_torque_needs_a_swim_beyond_the_ramp(duration: float) -> None:
    short = swim(duration=duration)
    with pytest.raises(ValueError, match=r"is not longer than the gait's ramp of 0\.5 s"):
        _ = short.largest_servo_torque


@pytest.mark.parametrize(("frequency", "sample_time"), [(0.9, 0.01), (2.5, 0.01), (10.0, 0.0025), (0.0, 0.01)])
def test_fast_beats_are_sampled_forty_times_a_beat(frequency: float, sample_time: float) -> None:
    result = swim(gait=carangiform(0.1, frequency), duration=1.0)
    assert np.diff(result.time) == pytest.approx(np.full(round(1.0 / sample_time), sample_time))


def test_means_of_a_fast_beat_do_not_depend_on_the_samples() -> None:
    gait = carangiform(math.radians(15.0), 10.0)
    result, fine = (swim(gait=gait, duration=2.0, sample_time=each) for each in (None, 2e-4))
    assert result.mean_thrust == pytest.approx(fine.mean_thrust, rel=1e-3)
    assert result.mean_servo_power == pytest.approx(fine.mean_servo_power, rel=1e-3)


def test_swim_shorter_than_a_sample_is_swum() -> None:
    assert swim(duration=0.005).duration == 0.005


def test_joint_that_does_not_beat_gives_no_frequency() -> None:
    assert swim(gait=carangiform(0.1, 0.0), duration=1.0).frequency == 0.0


@pytest.mark.parametrize("arguments", [{"duration": 1e5}, {"step": 1e-7}, {"sample_time": 1e-9}])
def test_swim_that_no_memory_holds_is_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"duration = .* step = .* steps, more than the 1428571"):
        swim(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["steady_speed", "mean_thrust", "efficiency", "strouhal_number", "turning_rate"])
def test_steady_figures_need_a_whole_beat_after_the_ramp(name: str) -> None:
    short = swim(duration=1.5)
    assert short.mean_speed >= 0.0
    with pytest.raises(ValueError, match=r"duration = 1\.5 s is too short .* 1\.61111 s"):
        getattr(short, name)


def test_steady_figures_need_a_beating_tail() -> None:
    still = swim(gait=Gait((JointDrive(0.0, 0.9, bias=0.1),)), duration=2.0)
    with pytest.raises(ValueError, match="beating tail"):
        _ = still.steady_speed


def test_efficiency_refuses_the_force_at_the_tip() -> None:
    with pytest.raises(ValueError, match="distributed"):
        _ = swim(duration=3.0, reactive="tip").efficiency


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "duration = 0 s"),
        ({"duration": float("nan")}, "duration = nan s"),
        ({"duration": 1e6}, "duration = 1e"),
        ({"step": 0.0}, "step = 0 s"),
        ({"step": 2.0}, "step = 2 s"),
        ({"sample_time": -1.0}, "sample_time = -1 s"),
        ({"sample_time": 20.0}, "sample_time = 20 s"),
        ({"ramp_time": -0.1}, "ramp_time = -0.1 s"),
        ({"clamp": "loose"}, "clamp = 'loose'"),
        ({"reactive": "none"}, "reactive = 'none'"),
        ({"tow_speed": float("inf"), "clamp": "towed"}, "tow_speed = inf m/s"),
        ({"gait": Gait((JointDrive(0.1, 1.0),) * 2)}, "gait has 2 rows, the tail has 1 driven joint"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        swim(**arguments)  # type: ignore[arg-type]


# -- the papers' models ----------------------------------------------------------------------------------------------


def test_mathematical_model_turns_thrust_into_speed() -> None:
    thrust = mean_thrust_held(Fin())
    assert mathematical_model(Fin()) == pytest.approx(math.sqrt(2.0 * thrust / (1000.0 * PAPER_FISH.body.drag_area)))
    assert speed_from_thrust(-1.0, 1e-3) == 0.0


def test_mathematical_model_gives_the_fin_no_mass() -> None:
    assert mean_thrust_held(Fin(density=7800.0)) == mean_thrust_held(Fin(density=0.0))


def test_model_is_faster_than_the_simulation() -> None:
    assert mathematical_model(Fin()) > simulation(Fin()).mean_speed


def test_towed_body_keeps_its_speed() -> None:
    result = towed(Fin(), 0.03)
    assert np.ptp(result.surge) == 0.0
    assert result.mean_speed == pytest.approx(0.03)
    assert result.efficiency == pytest.approx(result.mean_thrust * 0.03 / result.mean_servo_power)


@pytest.mark.parametrize(("thrust", "area"), [(float("nan"), 1e-3), (1e-3, 0.0), (1e-3, -1.0)])
def test_speed_from_thrust_refuses_what_cannot_be(thrust: float, area: float) -> None:
    with pytest.raises(ValueError, match=r"thrust|drag_area"):
        speed_from_thrust(thrust, area)


def test_gait_that_does_not_beat_has_no_model_speed() -> None:
    with pytest.raises(ValueError, match="gait frequency"):
        mathematical_model(Fin(), gait=carangiform(0.1, 0.0))


# -- peduncle and gaits ----------------------------------------------------------------------------------------------

PEDUNCLE = {
    "peduncle.length": [0.03],
    "peduncle.root_height": [0.05],
    "peduncle.tip_height": [0.035],
    "peduncle.mass_per_area": [20.0],
}


def test_peduncle_comes_from_parameters() -> None:
    fish = Fish.from_parameters(SIMULATOR_PARAMETERS.checked(PEDUNCLE))
    assert fish.peduncle == (Link(0.03, 0.05, 0.035, 20.0),)
    assert fish.driven_joints == 2


def test_peduncle_arrays_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match=r"peduncle\.length 2, peduncle\.root_height 1"):
        Fish.from_parameters(SIMULATOR_PARAMETERS.checked({**PEDUNCLE, "peduncle.length": [0.03, 0.02]}))


@pytest.mark.parametrize("joints", [2, 3])
def test_sub_carangiform_fish_swims_forward(joints: int) -> None:
    links = {name: values * (joints - 1) for name, values in PEDUNCLE.items()}
    fish = Fish.from_parameters(SIMULATOR_PARAMETERS.checked(links))
    result = swim(fish=fish, gait=sub_carangiform(math.radians(14.0), 1.2, joints), duration=8.0)
    assert result.steady_speed > 0.02
    assert result.beat_mean(result.surge) > 0.0


def test_longer_chain_than_allowed_is_refused() -> None:
    fish = replace(PAPER_FISH, peduncle=(Link(0.01, 0.02, 0.02),) * 3)
    gait = Gait(tuple(PAPER_GAIT.joints[0] for _ in range(4)))
    with pytest.raises(ValueError, match="number of links = 24"):
        swim(Fin(segments=20), fish, gait)
