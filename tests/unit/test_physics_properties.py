"""Known answers of the equations, and what must hold for every fin: symmetry, invariance, energy, finite results."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.gait import Gait, JointDrive, carangiform
from fin_plant.gait_follower import GaitFollower
from fin_sim import closed_forms, dynamics, time_stepping
from fin_sim.chain import build_chain
from fin_sim.energy import energy_budget
from fin_sim.fish import ellipsoid_added_mass_factors
from fin_sim.servo import Servo
from fin_sim.swim import PAPER_FISH, Swim, swim
from fin_sim.validation import convergence, equations

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

# Each example swims for some milliseconds; what is slow is the first call, which loads the compiled kernel.
# The same examples every time, so that a change is not blamed for a find by luck; 400 and 1500 have been tried.
_ALIKE = settings(derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def holds_for(*strategies: st.SearchStrategy[Any], few: int = 10) -> Callable[[Callable[..., None]], Any]:
    """Make a property the test of a few examples, and in the long set of fifteen times as many."""

    def tested(check: Callable[..., None]) -> Any:
        @pytest.mark.parametrize("examples", [few, pytest.param(15 * few, marks=pytest.mark.long)])
        def test(examples: int) -> None:
            settings(_ALIKE, max_examples=examples)(given(*strategies)(check))()

        return test

    return tested


@st.composite
def fins(draw: st.DrawFn) -> Fin:
    """Return any fin that is accepted: all of the range of stiffness, length, height and thickness."""

    def spread(name: str, low: float | None = None) -> float:
        entry = FIN_PARAMETERS[f"fin.{name}"]
        ends = math.log(low or entry.minimum), math.log(entry.maximum)
        return min(max(math.exp(draw(st.floats(*ends))), entry.minimum), entry.maximum)

    length, height = spread("length"), spread("height")
    thickness = spread("thickness")
    assume(thickness < min(length, height))
    return Fin(
        young_modulus=spread("young_modulus", 1e7),
        length=length,
        height=height,
        tip_height=draw(st.sampled_from([0.0, height, min(2.0 * height, 0.5)])),
        thickness=thickness,
        density=draw(st.sampled_from([0.0, 1180.0, 7800.0])),
        segments=draw(st.integers(1, 20)),
        hinges=draw(st.sampled_from(["between", "midpoint"])),
        damping_time=draw(st.sampled_from([0.0, 0.01, 1.0])),
    )


def _start(fin: Fin, gait: Gait, *, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> NDArray[np.float64]:
    """Return the states of 2 s from a start elsewhere in the tank."""
    chain = build_chain(PAPER_FISH, fin)
    stepper = time_stepping.Stepper(chain, 2e-3, 10)
    follower = GaitFollower(1, 0.5)
    follower.command(gait, 0.0)
    state = stepper.start()
    state[[dynamics.X, dynamics.Y, dynamics.HEADING]] = x, y, heading
    return stepper.advance(state, follower.motion(stepper.half_step_times(100)))[0]


@pytest.mark.parametrize(("amplitude", "frequency", "speed"), equations.PLATES)
def test_towed_plate_has_the_closed_forms_thrust_and_power(amplitude: float, frequency: float, speed: float) -> None:
    thrust, power = equations.plate_errors(amplitude, frequency, speed)
    assert abs(thrust) < 1e-6
    assert abs(power) < 1e-6


@pytest.mark.parametrize(
    ("case", "thrust", "power"),
    [
        ((15.0, 0.9, 0.0), 1.706655e-3, 0.0),
        ((15.0, 0.9, 0.0305), 1.699160e-3, 0.104106e-3),
        ((30.0, 2.0, 0.1), 32.567549e-3, 6.570037e-3),
    ],
)
def test_closed_forms_have_the_published_values(case: tuple[float, float, float], thrust: float, power: float) -> None:
    mass = closed_forms.plate_virtual_mass(0.025)
    arguments = (0.08, mass, math.radians(case[0]), case[1], case[2])
    assert closed_forms.plate_thrust(*arguments) == pytest.approx(thrust, rel=5e-7)
    assert closed_forms.plate_power(*arguments) == pytest.approx(power, rel=5e-6)


def test_force_at_the_tip_overstates_the_plates_power_by_half() -> None:
    assert equations.tip_power_excess() == pytest.approx(0.5, abs=1e-6)


def test_energy_over_whole_beats_balances_under_tow() -> None:
    assert abs(equations.towed_energy_error()) < 1e-7


def test_energy_over_whole_beats_does_not_balance_with_the_force_at_the_tip() -> None:
    assert abs(equations.towed_energy_error("tip")) > 0.1


def test_energy_of_a_tumbling_body_is_conserved_for_100_s() -> None:
    assert equations.kirchhoff_energy_error() < 1e-8


def test_body_coasts_as_the_closed_form() -> None:
    assert abs(equations.coasting_error()) < 1e-9


@pytest.mark.parametrize(("ratio", "row"), equations.ADDED_MASSES.items())
def test_added_masses_are_lambs(ratio: int, row: tuple[float, float, float]) -> None:
    assert ellipsoid_added_mass_factors(float(ratio), 1.0, 1.0) == pytest.approx(row, abs=5.1e-5)


def test_stiff_fin_tends_to_the_plate() -> None:
    assert abs(equations.stiff_limit_error()) < 1e-4


def test_soft_fin_gives_no_thrust() -> None:
    assert abs(equations.soft_limit_thrust()) < 0.01


def test_integration_has_order_4() -> None:
    assert convergence.order(convergence.STEPS, convergence.step_errors(convergence.FEW)) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("segments", [1, 3, 5, 10, 20])
def test_midpoint_chain_bends_as_the_beam_less_a_quarter_over_n_squared(segments: int) -> None:
    fin = Fin(segments=segments, hinges="midpoint")
    assert convergence.static_deflection(fin) == pytest.approx(closed_forms.midpoint_deflection(segments), rel=1e-12)


def test_swimming_speed_converges_with_order_2_in_segments() -> None:
    counts = (4, 6, 10, 14)
    speeds = convergence.swim_speeds(counts)
    errors = np.abs(speeds / convergence.extrapolated(counts, speeds) - 1.0)[:-2]
    assert -convergence.order(np.array(counts[:-2], dtype=float), errors) == pytest.approx(2.0, abs=0.35)


def test_segments_step_and_lanes_change_a_default_swim_by_less_than_a_hundredth() -> None:
    changes = convergence.default_swim_changes()
    assert len(changes) == 3
    assert all(abs(change) < 0.01 for change in changes.values()), changes


@pytest.mark.parametrize("modulus", [0.8e9, 4e9])
def test_fins_about_the_best_swim_within_a_hundredth_of_the_converged_speed(modulus: float) -> None:
    counts = (Fin().segments, 14, 20)
    speeds = convergence.swim_speeds(counts, young_modulus=modulus)
    assert speeds[0] == pytest.approx(convergence.extrapolated(counts, speeds), rel=0.01)


@holds_for(fins(), st.floats(1.0, 30.0), st.floats(0.2, 3.0), st.floats(-20.0, 20.0))
def test_mirrored_drive_swims_the_mirrored_path(fin: Fin, amplitude: float, frequency: float, bias: float) -> None:
    drive = JointDrive(math.radians(amplitude), frequency, bias=math.radians(bias))
    mirrored = replace(drive, phase=math.pi, bias=-drive.bias)
    one, other = (_start(fin, Gait((joint,))) for joint in (drive, mirrored))
    one[:, [dynamics.Y, dynamics.HEADING, dynamics.SWAY, dynamics.YAW_RATE]] *= -1.0
    one[:, dynamics.BODY_STATES :] *= -1.0
    # sin(p + pi) is -sin(p) to 1e-16 only, which a soft fin's hinges make larger.
    assert np.abs(one[:, :3] - other[:, :3]).max() < 1e-8 * max(1.0, float(np.abs(one).max()))


@holds_for(fins(), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_turned_and_shifted_start_turns_and_shifts_the_path(fin: Fin, heading: float, x: float, y: float) -> None:
    gait = carangiform(math.radians(15.0), 0.9)
    here, there = _start(fin, gait), _start(fin, gait, x=x, y=y, heading=heading)
    cosine, sine = math.cos(heading), math.sin(heading)
    turned = np.stack(
        (x + cosine * here[:, 0] - sine * here[:, 1], y + sine * here[:, 0] + cosine * here[:, 1]), axis=1
    )
    assert np.abs(there[:, :2] - turned).max() < 1e-9
    assert np.abs(there[:, 2:] - here[:, 2:] - heading * (np.arange(here.shape[1] - 2) == 0)).max() < 1e-8


@holds_for(fins(), st.floats(0.3, 2.0))
def test_no_energy_comes_from_nowhere(fin: Fin, frequency: float) -> None:
    result = swim(fin, gait=carangiform(math.radians(15.0), frequency), duration=2.0, sample_time=2e-3)
    budget = energy_budget(result)
    for loss in (budget.resistive, budget.dampers, budget.drag, budget.yaw_damping):
        assert loss.min() >= 0.0
    balance = np.concatenate(
        ([0.0], np.cumsum(0.5 * (budget.supplied - budget.lost)[1:] + 0.5 * (budget.supplied - budget.lost)[:-1]))
    )
    miss = budget.stored - budget.stored[0] - balance * 2e-3
    turnover = float(np.abs(budget.supplied).mean() * result.duration + budget.stored.max())
    # The trapezoids' own error; hinges that ring at more than 50 Hz are not resolved by the samples.
    ringing = result.chain.bending_frequencies()
    assume(len(ringing) == 0 or float(ringing[0]) < 50.0 or fin.damping_time > 0.0)
    assert np.abs(miss).max() < 0.02 * turnover


def test_energy_under_tow_balances_over_whole_beats_and_the_tip_form_is_refused() -> None:
    result = swim(Fin(), duration=20.0, clamp="towed", tow_speed=0.05)
    budget = energy_budget(result)
    miss = result.beat_mean(budget.supplied) - result.beat_mean(budget.lost)
    assert abs(miss) < 1e-4 * result.mean_servo_power
    with pytest.raises(ValueError, match=r"reactive = 'tip'.*distributed"):
        energy_budget(swim(Fin(), duration=1.0, reactive="tip"))


@holds_for(fins(), st.sampled_from(["distributed", "tip"]), st.sampled_from(["free", "fixed", "towed"]), few=20)
def test_every_accepted_fin_swims_with_finite_results(fin: Fin, reactive: str, clamp: str) -> None:
    result = swim(fin, duration=2.0, reactive=reactive, clamp=clamp, tow_speed=0.05)  # type: ignore[arg-type]
    for values in (result.x, result.surge, result.joint_angles, result.joint_torques, result.servo_power, result.force):
        assert np.isfinite(values).all()
    assert abs(result.mean_speed) < 5.0


def test_fin_that_flutters_gets_a_shorter_step() -> None:
    fin = Fin(
        young_modulus=24154952.7535753,
        length=0.006737946999085467,
        height=0.36787944117144233,
        tip_height=0.0,
        thickness=4.5399929762484854e-05,
        density=0.0,
        segments=5,
        hinges="midpoint",
        damping_time=0.0,
    )
    chain = build_chain(PAPER_FISH, fin, clamp="towed", tow_speed=0.05)
    stepper, follower = time_stepping.Stepper(chain, 2e-3, 5), GaitFollower(1, 0.5)
    follower.command(carangiform(math.radians(15.0), 0.9), 0.0)
    with pytest.raises(time_stepping.StepError, match="use a shorter step"):
        stepper.advance(stepper.start(), follower.motion(stepper.half_step_times(200)))
    result = swim(fin, duration=2.0, clamp="towed", tow_speed=0.05, step=2e-3)
    assert np.isfinite(result.joint_angles).all()


@pytest.mark.parametrize("modulus", [1e5, 1e7, 1e8, 1e9, 1e10, 2e11])
@pytest.mark.parametrize("length", [0.005, 0.5])
@pytest.mark.parametrize("height", [0.002, 0.5])
def test_corners_of_the_accepted_fins_are_finite(modulus: float, length: float, height: float) -> None:
    result = swim(Fin(young_modulus=modulus, length=length, height=height, tip_height=height), duration=2.0)
    assert np.isfinite(result.mean_speed)


_WITHOUT_COMPILER = """
import json, sys
import numpy as np
from pathlib import Path
from fin_sim.compiled import numba
from fin_sim.swim import swim
from fin_plant.fin import Fin
from fin_sim.servo import Servo
assert numba.config.DISABLE_JIT
result = swim(Fin(segments=4, tip_height=0.04), duration=0.4, servo=Servo(lag=0.05, backlash=0.02), step=5e-3)
json.dump([result.x[-1], result.y[-1], result.heading[-1], *result.joint_angles[-1], *result.force[-1]], sys.stdout)
"""


def test_kernel_gives_the_same_without_the_compiler() -> None:
    compiled: Swim = swim(
        Fin(segments=4, tip_height=0.04), duration=0.4, servo=Servo(lag=0.05, backlash=0.02), step=5e-3
    )
    expected = [
        compiled.x[-1],
        compiled.y[-1],
        compiled.heading[-1],
        *compiled.joint_angles[-1],
        *compiled.force[-1],
    ]
    paths = os.pathsep.join(
        str(Path(__file__).parents[2] / "ros2_ws" / "src" / name) for name in ("fin_plant", "fin_sim")
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT_COMPILER], env=environment, capture_output=True, text=True, check=True
    )
    # The compiler may reorder sums.
    assert json.loads(done.stdout) == pytest.approx(expected, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: closed_forms.plate_virtual_mass(0.0), "height = 0 m"),
        (lambda: closed_forms.plate_virtual_mass(0.02, -1.0), "density = -1 kg/m"),
        (lambda: closed_forms.plate_thrust(math.nan, 1.0, 0.1, 1.0, 0.0), "length = nan"),
        (lambda: closed_forms.plate_power(0.1, 1.0, math.inf, 1.0, 0.0), "amplitude = inf"),
        (lambda: closed_forms.coasting_speed(0.1, 0.0, 1.0, 1.0), "mass = 0 kg"),
        (lambda: closed_forms.coasting_speed(0.1, 1.0, 1.0, -1.0), "time = -1 s"),
        (lambda: closed_forms.midpoint_deflection(0), "segments = 0"),
    ],
)
def test_closed_forms_refuse_what_cannot_be(call: Callable[[], float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()
