"""The servo between command and joint: lag, rate limit, play and the relay's wave, slice by slice."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, gait_preset, sub_carangiform
from fin_plant.gait_follower import GaitFollower, three_level
from fin_sim.servo import Servo, TailDrive
from fin_sim.swim import SIMULATOR_PARAMETERS, swim

if TYPE_CHECKING:
    from numpy.typing import NDArray

STEP = 5e-4
SERVOS = [
    Servo(lag=0.05),
    Servo(lag=0.02, rate_limit=1.0),
    Servo(lag=0.02, backlash=0.05),
    Servo(lag=0.02, rate_limit=5.0, backlash=0.02, waveform="three_level"),
]


def _times(first: int, last: int) -> NDArray[np.float64]:
    return np.array([STEP * index for index in range(first, last + 1)])


def _motion(servo: Servo, gait: Gait = PAPER_GAIT, duration: float = 4.0, slices: int = 1) -> NDArray[np.float64]:
    follower = GaitFollower(len(gait.joints), 0.5)
    follower.command(gait, 0.0)
    drive = TailDrive(follower, servo)
    count = round(duration / STEP) // slices
    parts = [drive.motion(_times(part * count, (part + 1) * count)) for part in range(slices)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def test_ideal_servo_does_what_the_gait_says() -> None:
    follower = GaitFollower(1, 0.5)
    follower.command(PAPER_GAIT, 0.0)
    assert np.array_equal(_motion(Servo()), follower.motion(_times(0, 8000)))


def test_lag_delays_by_itself() -> None:
    angle = _motion(Servo(lag=0.05), duration=6.0)[:, 0, 0]
    # Amplitude and phase over the last beats, by projection; 0.9 Hz is slow against 50 ms.
    times = STEP * np.arange(len(angle))
    last = times > times[-1] - 2.0 / 0.9
    wave = 2.0 * np.mean(angle[last] * np.exp(-2j * math.pi * 0.9 * times[last]))
    delay = -(np.angle(wave) + 0.5 * math.pi) / (2.0 * math.pi * 0.9)
    assert delay == pytest.approx(0.05, rel=0.03)
    assert abs(wave) == pytest.approx(math.radians(15.0), rel=0.03)


def test_rate_stays_within_its_limit() -> None:
    motion = _motion(Servo(lag=0.02, rate_limit=1.0))
    assert np.abs(motion[:, 0, 1]).max() <= 1.0
    assert np.abs(motion[:, 0, 1]).max() == pytest.approx(1.0, abs=1e-3)


def test_backlash_takes_half_its_play_from_either_side() -> None:
    motion = _motion(Servo(lag=0.01, backlash=0.06), duration=6.0)
    assert np.abs(motion[6000:, 0, 0]).max() == pytest.approx(math.radians(15.0) - 0.03, abs=2e-3)


def test_step_of_the_command_is_followed_without_overshoot() -> None:
    motion = _motion(Servo(lag=0.05, waveform="three_level"), Gait((JointDrive(0.2617993877991494, 0.2),)), 4.0)
    assert np.abs(motion[:, 0, 0]).max() <= 0.2617993877991494 + 1e-9
    assert np.abs(motion[:, 0, 0]).max() == pytest.approx(0.2617993877991494, rel=1e-3)


@pytest.mark.parametrize("servo", SERVOS, ids=repr)
def test_angle_rate_and_acceleration_belong_together(servo: Servo) -> None:
    angle, rate, acceleration = _motion(servo)[:, 0].T
    assert np.isfinite(acceleration).all()
    # Trapezoids over the step; where the command jumps, the acceleration does and one step is off by half a jump.
    jump = np.abs(np.diff(acceleration)).max()
    assert np.abs(np.cumsum(0.5 * STEP * (rate[1:] + rate[:-1])) - (angle[1:] - angle[0])).max() < 2e-3
    assert np.abs(np.diff(rate) - 0.5 * STEP * (acceleration[1:] + acceleration[:-1])).max() <= STEP * jump


@pytest.mark.parametrize("servo", SERVOS, ids=repr)
def test_slices_of_time_join_without_a_trace(servo: Servo) -> None:
    assert np.abs(_motion(servo) - _motion(servo, slices=8)).max() < 1e-9


def test_joint_goes_on_from_where_it_is_when_the_servo_changes() -> None:
    follower = GaitFollower(1, 0.5)
    follower.command(PAPER_GAIT, 0.0)
    drive = TailDrive(follower, Servo())
    before = drive.motion(_times(0, 2000))
    drive.servo = Servo(lag=0.05)
    after = drive.motion(_times(2000, 2100))
    assert after[0, 0, :2] == pytest.approx(before[-1, 0, :2])


def test_relay_wave_centres_its_windows_on_the_peaks() -> None:
    argument = np.linspace(0.0, 2.0 * math.pi, 100_001)
    half = np.full_like(argument, 0.5)
    wave = three_level(argument, half, np.zeros_like(argument), 1.0)
    # theta_L = 2 asin(1/2): a third of half a turn on either side.
    assert np.mean(wave == 1.0) == pytest.approx(1.0 / 6.0, abs=1e-4)
    assert np.mean(wave == -1.0) == pytest.approx(1.0 / 6.0, abs=1e-4)
    assert argument[wave == 1.0].mean() == pytest.approx(0.5 * math.pi, abs=1e-3)


def test_relay_wave_turns_bias_into_asymmetry() -> None:
    argument = np.linspace(0.0, 2.0 * math.pi, 100_001)
    wave = three_level(argument, np.full_like(argument, 0.5), np.full_like(argument, 0.5), 1.0)
    assert np.mean(wave == 1.0) == pytest.approx(0.5, abs=1e-4)
    assert not (wave == -1.0).any()


def test_relay_tail_swims() -> None:
    result = swim(servo=Servo(lag=0.05, waveform="three_level"), duration=8.0)
    assert result.steady_speed > 0.02


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rate_limit": 1.0}, r"servo\.lag = 0 s with a rate limit"),
        ({"backlash": 0.1}, r"servo\.lag = 0 s"),
        ({"waveform": "three_level"}, r"servo\.lag = 0 s"),
        ({"waveform": "square"}, r"servo\.waveform = 'square'"),
        ({"lag": 1e-3}, r"servo\.lag = 0\.001 s"),
        ({"lag": -1.0}, r"servo\.lag = -1 s"),
        ({"lag": float("nan")}, r"servo\.lag = nan s"),
        ({"lag": 0.1, "rate_limit": -1.0}, r"servo\.rate_limit"),
        ({"lag": 0.1, "backlash": 4.0}, r"servo\.backlash"),
        ({"swing": 0.0}, r"servo\.swing"),
    ],
)
def test_servo_refuses_what_cannot_be(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Servo(**arguments)  # type: ignore[arg-type]


def test_servo_comes_from_parameters_and_is_ideal_by_default() -> None:
    assert Servo.from_parameters(SIMULATOR_PARAMETERS.checked({})) == Servo()
    given = SIMULATOR_PARAMETERS.checked({"servo.lag": 0.05, "servo.backlash": 0.01})
    assert Servo.from_parameters(given) == Servo(lag=0.05, backlash=0.01)


@pytest.mark.parametrize("joints", [2, 3])
def test_sub_carangiform_gait_rises_and_lags_towards_the_tail(joints: int) -> None:
    gait = sub_carangiform(0.25, 1.2, joints)
    amplitudes, phases = gait.rows()[:, 0], gait.rows()[:, 2]
    assert (np.diff(amplitudes) > 0.0).all()
    assert (np.diff(phases) < 0.0).all()
    assert amplitudes[-1] == 0.25


def test_gait_presets_fit_the_tail_or_are_refused() -> None:
    assert gait_preset("carangiform", 1, 0.2, 1.0).rows().shape == (1, 4)
    assert gait_preset("sub_carangiform", 3, 0.2, 1.0).rows().shape == (3, 4)
    with pytest.raises(ValueError, match="choose the gait sub_carangiform"):
        gait_preset("carangiform", 2, 0.2, 1.0)
    with pytest.raises(ValueError, match="driven joints of a sub-carangiform gait = 1"):
        gait_preset("sub_carangiform", 1, 0.2, 1.0)
    with pytest.raises(ValueError, match="gait = 'eel'"):
        gait_preset("eel", 1, 0.2, 1.0)
