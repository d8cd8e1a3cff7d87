"""One swim: fin, fish, gait and duration in; arrays and the figures that a laboratory asks for out."""

from __future__ import annotations

import math

import numpy as np

from fin_plant import checks
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, Gait
from fin_plant.gait_follower import GaitFollower
from fin_plant.parameters import load_table
from fin_sim import dynamics, time_stepping
from fin_sim.chain import Chain, Clamp, Reactive, build_chain
from fin_sim.fish import Fish
from fin_sim.servo import Servo, TailDrive
from fin_sim.swim_result import Swim

__all__ = ["LARGEST_NORMAL_DRAG", "PAPER_FISH", "SIMULATOR_PARAMETERS", "Swim", "swim", "swim_chain"]

SIMULATOR_PARAMETERS = load_table("fin_sim", "simulator_parameters.yaml")
LARGEST_NORMAL_DRAG = SIMULATOR_PARAMETERS["water.normal_drag"].maximum
"""C_N of the tail that the simulator takes."""
PAPER_FISH = Fish.from_parameters(SIMULATOR_PARAMETERS.checked({}))
"""The papers' fish as it was measured: body of 14 cm; its numbers and their reasons stand in
``simulator_parameters.yaml``."""

RAMP_TIME = 0.5
STEP = 1e-3
IDEAL_SERVO = Servo()
SAMPLE_TIME = 1e-2
"""Time between two samples in s, where the tail does not beat faster than 2.5 Hz."""
MOTOR_SAMPLE_TIME = 2.5e-3
"""The same where servos have a motor, whose power has kinks: its mean is then right to 0.1 %."""
_SAMPLES_A_BEAT = 40
_STEPS_A_BEAT, _STEPS_A_RAMP = 400.0, 40.0
SHORTEST, LONGEST = 1e-6, 1e5
"""Range of a swim's duration, s."""
# Steps times links: what a swim holds in memory grows with it, to 2 GB.
_LARGEST_SWIM = 10_000_000
# A fin that flutters or whips may need a shorter step than was asked for: a quarter, then a sixteenth of it.
_SHORTER_STEPS = 2


def _default_sample_time(chain: Chain, gait: Gait, duration: float) -> float:
    """Return the chain's sample time or, where that is shorter, a fortieth of the fastest beat or the whole swim, s."""
    own = MOTOR_SAMPLE_TIME if chain.motor else SAMPLE_TIME
    fastest = max(joint.frequency for joint in gait.joints)
    return min(own, duration, 1.0 / (_SAMPLES_A_BEAT * fastest) if fastest > 0.0 else own)


def longest_step(gait: Gait, ramp_time: float) -> float:
    """Return the longest step in s for a fast beat or a short ramp; infinite where `STEP` resolves them."""
    fastest = max(joint.frequency for joint in gait.joints)
    if fastest == 0.0:
        return math.inf
    resolved = 1.0 / (_STEPS_A_BEAT * fastest)
    if ramp_time > 0.0:
        resolved = min(resolved, max(ramp_time / _STEPS_A_RAMP, 0.05 * resolved))
    return resolved if resolved < STEP else math.inf


def _refuse_too_many_steps(links: int, duration: float, step: float) -> None:
    most = _LARGEST_SWIM // links
    if duration / step > most:
        msg = (
            f"duration = {duration:g} s in steps of step = {step:g} s takes {duration / step:.3g} steps, more than the "
            f"{most} that a tail of {links} links may take: give a shorter duration or a longer step"
        )
        raise ValueError(msg)


def swim_chain(
    chain: Chain,
    gait: Gait,
    duration: float,
    *,
    servo: Servo = IDEAL_SERVO,
    ramp_time: float = RAMP_TIME,
    step: float = STEP,
    sample_time: float | None = None,
    quick: bool = False,
) -> Swim:
    """Swim a chain from rest; with the step given, or a shorter one that its motors need; see `swim`.

    ``quick``: in a plane ideal flow the coarser table will do, see `ideal_2d.plane_stepper`.

    Raises:
        ValueError: A duration, ramp, step or sample time outside its range, or a gait with another number of joints.
        StepError: The state stopped being finite.
    """
    duration = checks.number("duration", duration, SHORTEST, LONGEST, unit="s")
    if sample_time is None:
        sample_time = _default_sample_time(chain, gait, duration)
    sample_time = checks.number("sample_time", sample_time, 0.0, duration, unit="s", exclusive_minimum=True)
    step = min(checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True), chain.longest_step)
    _refuse_too_many_steps(len(chain.links), duration, min(step, sample_time))
    samples = max(1, round(duration / sample_time))
    every = time_stepping.steps_a_sample(duration / samples, step)
    chain = chain.for_gait(gait)
    stepper = time_stepping.stepper_of(chain, duration / (samples * every), every, quick=quick)
    follower = GaitFollower(sum(chain.driven), ramp_time, as_asked=True)
    follower.command(gait, 0.0)
    motion = TailDrive(follower, servo).motion(stepper.half_step_times(samples))
    states, records = stepper.advance(stepper.start(), motion)
    links, first = len(chain.links), dynamics.BODY_STATES
    water_surge, water_sway = states[:, dynamics.SURGE], states[:, dynamics.SWAY]
    surge, sway = chain.water.over_ground(water_surge, water_sway, states[:, dynamics.HEADING])
    return Swim(
        chain=chain,
        gait=gait,
        ramp_time=ramp_time,
        time=np.linspace(0.0, duration, samples + 1),
        x=states[:, dynamics.X],
        y=states[:, dynamics.Y],
        heading=states[:, dynamics.HEADING],
        surge=surge,
        sway=sway,
        water_surge=water_surge,
        water_sway=water_sway,
        yaw_rate=states[:, dynamics.YAW_RATE],
        joint_angles=states[:, first : first + links],
        joint_rates=states[:, first + links :],
        joint_torques=records[:, dynamics.RECORD_HEAD :],
        servo_power=records[:, dynamics.SERVO_POWER],
        electrical_power=records[:, dynamics.ELECTRICAL_POWER],
        force=records[:, [dynamics.FORCE_X, dynamics.FORCE_Y]],
        convective_force=records[:, [dynamics.CONVECTIVE_X, dynamics.CONVECTIVE_Y]],
    )


def swim(
    fin: Fin | None = None,
    fish: Fish = PAPER_FISH,
    gait: Gait = PAPER_GAIT,
    duration: float = 10.0,
    *,
    reactive: Reactive = "distributed",
    clamp: Clamp = "free",
    tow_speed: float = 0.0,
    servo: Servo = IDEAL_SERVO,
    ramp_time: float = RAMP_TIME,
    step: float = STEP,
    sample_time: float | None = None,
) -> Swim:
    """Swim a fish from rest.

    Args:
        fin: The fin; the default one where none is given.
        fish: The fish.
        gait: The gait, one row for each driven joint.
        duration: s.
        reactive: ``distributed`` or ``tip``, see `Chain`.
        clamp: ``free``, ``fixed`` or ``towed``.
        tow_speed: m/s, for ``towed``.
        servo: What shapes the command of every driven joint; nothing where none is given. What drives the joints after
            it is the fish's `Motor`.
        ramp_time: Time in which the gait starts, s.
        step: Longest time step, s; shortened to divide the sample time, for a beat faster than 2.5 Hz or a ramp
            shorter than 40 ms, and where it proves too long for the fin.
        sample_time: Time between two samples, s; where none is given `SAMPLE_TIME`, with a motor `MOTOR_SAMPLE_TIME`,
            or a fortieth of a faster beat.

    Raises:
        ValueError: An argument that is refused; the message names it.
        StepError: The state stopped being finite.
    """
    chain = build_chain(fish, fin or Fin(), reactive=reactive, clamp=clamp, tow_speed=tow_speed)
    step = min(step, longest_step(gait, ramp_time))
    for _ in range(_SHORTER_STEPS):
        try:
            return swim_chain(
                chain, gait, duration, servo=servo, ramp_time=ramp_time, step=step, sample_time=sample_time
            )
        except time_stepping.StepError:
            step = 0.25 * min(step, sample_time or _default_sample_time(chain, gait, duration))
    return swim_chain(chain, gait, duration, servo=servo, ramp_time=ramp_time, step=step, sample_time=sample_time)
