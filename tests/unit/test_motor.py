"""A servo with a motor: stall, no-load speed, the linear closed form, power, and what a strong and a weak one do."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy.linalg
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from fin_plant.gait import Gait, JointDrive
from fin_plant.gait_follower import GaitFollower
from fin_sim import dynamics, time_stepping
from fin_sim.angular_momentum import angular_momentum_budget
from fin_sim.batch import Status, swim_batch
from fin_sim.chain import Chain, build_chain
from fin_sim.energy import energy_budget
from fin_sim.fish import Fish, Link, Water
from fin_sim.motor import Motor
from fin_sim.servo import Servo
from fin_sim.swim import Swim, swim
from fin_sim.swim_command.command import main as swim_main
from support.paper_fish import BODY, FIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

_QUICK = settings(derandomize=True, deadline=None, max_examples=12, suppress_health_check=[HealthCheck.too_slow])
HOBBY = Motor(stall_torque=0.3, no_load_speed=7.0, gain=10.0, derivative_time=0.02, time_constant=0.02)
WATER = Water(1000.0, 1.0)
AIR = Water(1e-9, 0.0)
"""So thin that a link is as good as alone."""
BEAT = Gait((JointDrive(math.radians(15.0), 0.9),))
TURN = Gait((JointDrive(math.radians(15.0), 0.9, 0.0, math.radians(10.0)),))
PLATE = Link(0.08, 0.025, 0.025, mass_per_area=1.2)


def turned(motor: Motor, link: Link, target: float, duration: float) -> tuple[NDArray[np.float64], ...]:
    """Return what one link out of the water does that is told to go to ``target`` at once.

    Time, angle, rate, torque at the shaft and electrical power.
    """
    stepper = time_stepping.Stepper(Chain(BODY, (link,), (True,), AIR, clamp="fixed", motor=motor), 1e-3)
    steps = round(duration / 1e-3)
    motion = np.zeros((2 * steps + 1, 1, 3))
    motion[:, :, 0] = target
    states, records = stepper.advance(stepper.start(), motion)
    torque, power = records[:, [dynamics.RECORD_HEAD, dynamics.ELECTRICAL_POWER]].T
    return np.linspace(0.0, duration, steps + 1), states[:, 6], states[:, 7], torque, power


@pytest.mark.parametrize("motor", [HOBBY, replace(HOBBY, derivative_time=0.0), replace(HOBBY, gain=2.0)])
def test_one_joint_follows_the_closed_form_while_its_duty_is_not_the_whole_one(motor: Motor) -> None:
    """I d2a/dt2 + (stall / w0 + stall gain Td) da/dt + stall gain (a - target) = 0 from rest."""
    target = 0.9 / motor.gain
    time, angle, rate, torque, electrical = turned(motor, PLATE, target, 0.5)
    plate = 1.2 * 0.025 * 0.08**3 / 3.0
    inertia = motor.stall_torque * motor.time_constant / motor.no_load_speed + plate
    damping = motor.stall_torque * (1.0 / motor.no_load_speed + motor.gain * motor.derivative_time)
    stiffness = motor.stall_torque * motor.gain
    matrix = np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])
    over_step = scipy.linalg.expm(1e-3 * matrix)
    expected = np.array(
        list(accumulate(time[1:], lambda error, _: over_step @ error, initial=np.array([-target, 0.0])))
    )
    duty = motor.gain * (target - angle - motor.derivative_time * rate)
    assert np.abs(duty).max() <= 1.0
    assert angle == pytest.approx(target + expected[:, 0], abs=2e-6 * target)
    assert rate == pytest.approx(expected[:, 1], abs=2e-6 * np.abs(rate).max())
    motors_own = motor.stall_torque * (duty - rate / motor.no_load_speed)
    assert torque == pytest.approx(motors_own * plate / inertia, abs=1e-12)  # the rotor takes the rest
    assert electrical == pytest.approx(duty * motor.no_load_speed * motors_own, abs=1e-12)


def test_a_held_servo_gives_its_stall_torque_and_draws_the_whole_voltage_times_the_stall_current() -> None:
    """A link of 1 kg m^2 goes nowhere in 10 ms."""
    heavy = replace(PLATE, mass_per_area=3.0 / (0.025 * 0.08**3))
    for target in (1.0, -1.0, 100.0):
        _, _, _, torque, electrical = turned(HOBBY, heavy, target, 0.01)
        assert torque == pytest.approx(math.copysign(0.3, target), rel=2e-3)
        assert electrical == pytest.approx(0.3 * 7.0, rel=2e-3)


def test_without_a_load_it_comes_to_its_no_load_speed_with_its_time_constant_and_then_draws_nothing() -> None:
    light = replace(PLATE, mass_per_area=0.0)
    time, angle, rate, torque, electrical = turned(HOBBY, light, 1e3, 0.4)
    assert rate == pytest.approx(7.0 * (1.0 - np.exp(-time / 0.02)), rel=1e-5)
    assert angle[-1] == pytest.approx(7.0 * (0.4 - 0.02), rel=1e-5)
    assert np.abs(torque).max() < 1e-6 * 0.3
    assert electrical == pytest.approx(0.3 * 7.0 * np.exp(-time / 0.02), abs=1e-5)
    slow = turned(replace(HOBBY, no_load_speed=2.0), light, -1e3, 0.4)
    assert slow[2][-1] == pytest.approx(-2.0, rel=1e-5)


motors = st.builds(
    Motor,
    stall_torque=st.floats(-4.0, 1.0).map(lambda power: 10.0**power),
    no_load_speed=st.floats(1.0, 30.0),
    gain=st.floats(1.0, 60.0),
    derivative_time=st.sampled_from([0.0, 0.02]),
    time_constant=st.floats(0.005, 0.1),
)


def duties(result: Swim) -> NDArray[np.float64]:
    """Return the share of the voltage that the servo's controller gives at each sample, from the command alone."""
    motor = result.chain.motor
    assert motor is not None
    follower = GaitFollower(1, result.ramp_time, as_asked=True)
    follower.command(result.gait, 0.0)
    error = follower.motion(result.time)[:, 0, :2] - np.stack(
        (result.joint_angles[:, 0], result.joint_rates[:, 0]), axis=1
    )
    return np.clip(motor.gain * (error[:, 0] + motor.derivative_time * error[:, 1]), -1.0, 1.0)


@_QUICK
@given(motor=motors, modulus=st.sampled_from([2e8, 1.2e9, 5e10]), clamp=st.sampled_from(["free", "fixed"]))
def test_electrical_power_is_mechanical_power_and_heat_and_the_mechanical_balance_closes(
    motor: Motor, modulus: float, clamp: str
) -> None:
    fish = Fish(BODY, WATER, motor=motor)
    result = swim(replace(FIN, young_modulus=modulus), fish, TURN, 2.5, clamp=clamp, sample_time=2e-3)  # type: ignore[arg-type]
    rate, size = result.joint_rates[:, 0], motor.stall_torque * motor.no_load_speed
    torque = motor.stall_torque * (duties(result) - rate / motor.no_load_speed)
    heat = torque**2 * motor.no_load_speed / motor.stall_torque
    assert result.electrical_power == pytest.approx(duties(result) * motor.no_load_speed * torque, abs=1e-9 * size)
    assert result.electrical_power == pytest.approx(torque * rate + heat, abs=1e-9 * size)
    assert result.servo_power == pytest.approx(result.joint_torques[:, 0] * rate, abs=1e-15)
    # What the motor gives and the shaft does not get is in the rotor.
    left = result.electrical_power - heat - result.servo_power
    turning = 0.5 * motor.inertia * rate**2
    kept = cumulative_simpson(left, x=result.time, initial=0.0)
    assert kept == pytest.approx(turning, abs=2e-3 * turning.max())
    budget = energy_budget(result)
    gained = result.duration * result.mean_between(budget.supplied - budget.lost, 0.0, result.duration)
    turnover = np.trapezoid(np.abs(budget.supplied) + np.abs(budget.lost), result.time)
    assert gained == pytest.approx(budget.stored[-1] - budget.stored[0], abs=2e-4 * float(turnover))


@_QUICK
@given(st.integers(0, 2**32 - 1), motors, st.sampled_from(["free", "fixed"]), st.sampled_from(["tip", "distributed"]))
def test_a_motor_that_gives_the_torque_of_a_prescribed_motion_moves_all_as_that_does(
    seed: int, motor: Motor, clamp: str, reactive: str
) -> None:
    """At any state of a fish with two servos and a flexible fin: same accelerations, forces, torques and power."""
    random = np.random.default_rng(seed)
    links = build_chain(
        Fish(BODY, WATER, (Link(0.04, 0.04, 0.03, 1.0),)),
        FIN,
        reactive=reactive,  # type: ignore[arg-type]
        clamp=clamp,  # type: ignore[arg-type]
    )
    count = len(links.links)
    state = random.normal(size=6 + 2 * count) * np.concatenate(
        (np.full(6, 0.1), np.full(count, 0.4), np.full(count, 3))
    )
    drive = np.zeros((count, 3))
    drive[:2, :2] = np.stack((state[6 : 6 + count], state[6 + count :]), axis=1)[:2] + random.normal(size=(2, 2)) * 0.3

    def evaluated(chain: Chain, drive: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        derivative, record = np.zeros(len(state)), np.zeros(dynamics.RECORD_HEAD + count)
        dynamics.evaluate(
            state.copy(),
            drive,
            chain.link_table(),
            chain.body_vector(),
            chain.clamp == "free",
            chain.reactive == "distributed",
            derivative,
            record,
            np.zeros((count, dynamics.SCRATCH_COLUMNS)),
        )
        return derivative, record

    derivative, record = evaluated(replace(links, motor=motor), drive)
    motion = np.zeros((count, 3))
    motion[:2] = np.stack((state[6 : 6 + count], state[6 + count :], derivative[6 + count :]), axis=1)[:2]
    prescribed, told = evaluated(links, motion)
    assert derivative == pytest.approx(prescribed, rel=1e-8, abs=1e-8 * np.abs(prescribed).max())
    for of in (slice(0, dynamics.ELECTRICAL_POWER), slice(dynamics.RECORD_HEAD, None)):
        assert record[of] == pytest.approx(told[of], rel=1e-6, abs=1e-8 * np.abs(told[of]).max())
    assert told[dynamics.ELECTRICAL_POWER] == 0.0


def swum(motor: Motor | None, gait: Gait = BEAT, **arguments: object) -> Swim:
    return swim(FIN, Fish(BODY, WATER, motor=motor), gait, 6.0, **arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def ideal() -> Swim:
    return swum(None)


def test_a_servo_strong_and_fast_enough_swims_as_the_ideal_one(ideal: Swim) -> None:
    strong = swum(Motor(stall_torque=100.0, no_load_speed=1e3, gain=50.0, derivative_time=1e-3, time_constant=0.02))
    for name in ("mean_speed", "steady_speed", "mean_thrust", "tip_amplitude", "servo_amplitude", "strouhal_number"):
        assert getattr(strong, name) == pytest.approx(getattr(ideal, name), rel=1e-3), name
    assert strong.mean_servo_power == pytest.approx(ideal.mean_servo_power, rel=1e-3)
    assert strong.joint_angles[::4, 0] == pytest.approx(ideal.joint_angles[:, 0], abs=1e-3 * math.radians(15.0))


def test_lag_and_rate_limit_shape_what_the_motor_is_told() -> None:
    strong = Motor(stall_torque=100.0, no_load_speed=1e3, gain=50.0, derivative_time=1e-3, time_constant=0.02)
    late = Servo(lag=0.05, rate_limit=0.8)
    told, follows = swum(None, servo=late), swum(strong, servo=late)
    assert told.servo_amplitude < 0.95 * math.radians(15.0)
    assert follows.joint_angles[::4, 0] == pytest.approx(told.joint_angles[:, 0], abs=1e-3 * math.radians(15.0))


def phase(result: Swim) -> float:
    """Return the phase of the servo's motion over the last beat at 0.9 Hz, rad."""
    last = result.time >= result.duration - 1.0 / 0.9
    return float(np.angle(np.sum(result.joint_angles[last, 0] * np.exp(-2j * np.pi * 0.9 * result.time[last]))))


def test_a_weak_servo_lags_and_goes_less_far(ideal: Swim) -> None:
    before, fast = ideal.servo_amplitude, 0.0
    lag = 0.0
    for stall in (3e-4, 1e-4, 3e-5):  # the ideal servo needs up to 0.5 mN m
        weak = swum(replace(HOBBY, stall_torque=stall))
        assert weak.servo_amplitude < 0.999 * before
        later = (phase(ideal) - phase(weak)) % (2.0 * math.pi)
        assert later > lag
        before, lag = weak.servo_amplitude, later
        fast = weak.steady_speed
    assert before < 0.5 * math.radians(15.0)
    assert fast < 0.5 * ideal.steady_speed


def test_a_servo_too_slow_for_the_gait_moves_at_its_no_load_speed_at_most() -> None:
    quick = Gait((JointDrive(math.radians(30.0), 4.0),))  # asks for 13 rad/s
    result = swum(HOBBY, quick)
    assert np.abs(result.joint_rates[:, 0]).max() < 7.0
    assert result.servo_amplitude < math.radians(20.0)


def test_a_motors_swim_converges_with_the_step(ideal: Swim) -> None:
    del ideal
    weak, fine = (swum(replace(HOBBY, stall_torque=3e-4), step=step) for step in (1e-3, 1.25e-4))
    assert weak.mean_speed == pytest.approx(fine.mean_speed, rel=1e-5)
    assert weak.mean_electrical_power == pytest.approx(fine.mean_electrical_power, rel=1e-3)


def test_a_very_stiff_fin_swims_on_a_light_rotor_at_the_default_step() -> None:
    """Its springs shake the servo at 2 kHz; they are integrated exactly with it."""
    fish = Fish(BODY, WATER, motor=replace(HOBBY, stall_torque=1e-3))
    stiff = replace(FIN, young_modulus=2e11)
    coarse, fine = (swim(stiff, fish, BEAT, 3.0, step=step) for step in (1e-3, 1.25e-4))
    assert coarse.mean_speed == pytest.approx(fine.mean_speed, rel=1e-3)


def test_the_rotor_gives_no_angular_momentum_to_the_fish() -> None:
    result = swim(FIN, Fish(BODY, WATER, motor=HOBBY), TURN, 6.0, sample_time=2.5e-3)
    budget = angular_momentum_budget(result)
    moments = budget.wake + budget.resistive + budget.body
    given_moment = result.duration * result.mean_between(moments, 0.0, result.duration)
    size = float(sum(np.trapezoid(np.abs(each), result.time) for each in (budget.wake, budget.resistive, budget.body)))
    assert budget.stored[-1] - budget.stored[0] == pytest.approx(given_moment, abs=1e-5 * size)


def test_an_ideal_servo_has_no_electrical_power(ideal: Swim) -> None:
    with pytest.raises(ValueError, match=r"servo\.stall_torque = 0 N m"):
        _ = ideal.mean_electrical_power


def test_parameters_give_a_motor_only_with_a_stall_torque_and_refuse_a_controller_that_no_step_resolves() -> None:
    values: dict[str, object] = {f"servo.{name}": value for name, value in vars(HOBBY).items()}
    assert Motor.from_parameters(values) == HOBBY
    assert Motor.from_parameters({**values, "servo.stall_torque": 0.0}) is None
    with pytest.raises(ValueError, match=r"servo\.gain = 1000/rad .*lower them, or raise"):
        Motor.from_parameters(
            {**values, "servo.gain": 1000.0, "servo.derivative_time": 0.1, "servo.no_load_speed": 900}
        )


@pytest.mark.parametrize("clamp", ["free", "fixed"])
@pytest.mark.parametrize("stall", [0.3, 3e-4])
def test_the_batch_swims_with_motors_and_tells_their_power_and_torque(clamp: str, stall: float) -> None:
    fish, settle = Fish(BODY, WATER, motor=replace(HOBBY, stall_torque=stall)), 4.0 - 2.0 / 0.9
    batch = swim_batch([FIN], fish, BEAT, 4.0, clamp=clamp, settle=settle, threads=1)  # type: ignore[arg-type]
    one = swim(FIN, fish, BEAT, 4.0, clamp=clamp, sample_time=2.5e-3)  # type: ignore[arg-type]
    assert batch.status[0] == Status.OK
    assert batch.mean_speed[0] == pytest.approx(one.mean_speed, rel=1e-3)
    assert batch.servo_power[0] == pytest.approx(one.mean_between(one.servo_power, settle, 4.0), rel=3e-3)
    assert batch.electrical_power[0] == pytest.approx(one.mean_between(one.electrical_power, settle, 4.0), rel=3e-3)
    assert batch.servo_torque[0] == pytest.approx(one.largest_servo_torque, rel=1e-2)


def test_the_batch_tells_no_electrical_power_of_ideal_servos() -> None:
    batch = swim_batch([FIN], Fish(BODY, WATER), BEAT, 4.0, threads=1)
    assert batch.status[0] == Status.OK
    assert np.isnan(batch.electrical_power[0])
    assert np.isnan(batch.servo_torque[0])


def test_a_variation_over_the_stall_torque_has_one_table_quick_or_not(capsys: pytest.CaptureFixture[str]) -> None:
    variation = ("--vary", "servo.stall_torque=0,0.3", "--duration", "3", "--fin.damping_time", "0.01", "--json")
    for more in ((), ("--quick",)):
        assert swim_main([*variation, *more]) == 0
        ideal, motor = json.loads(capsys.readouterr().out)
        assert ideal.keys() == motor.keys()
        assert ideal["mean_electrical_power"] is None
        assert motor["mean_electrical_power"] > motor["mean_servo_power"] > 0.0
        assert motor["largest_servo_torque"] > 0.0
