"""What sits between a command and the tail's joint: a servo with a lag, a limited rate and play in its gears.

The integration prescribes a driven joint's angle, rate and acceleration, so the servo must give all three, finite and
each the derivative of the other, even when the command jumps as a relay's does. A lag of first order alone would let
the rate jump with the command, and the acceleration be infinite. Hence the joint's rate itself follows the lag's with
the time constant of the motor,

    d(angle)/dt = rate,   d(rate)/dt = (limited((command - angle) / lag) - rate) / motor_time,   motor_time = lag / 4,

which for small and slow commands is a lag of first order (gain 1, delay ``lag``), is critically damped (no
overshoot; a double pole at -2 / lag) and approaches a limited rate without ever passing it. The play acts on the
command before the lag: behind it, a tooth that meets the next would make the rate jump.

Where the servo has a motor (`motor`), all this is what the motor is told to follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import numpy as np

from fin_plant import checks
from fin_sim.compiled import kernel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.gait_follower import GaitFollower

Waveform = Literal["sine", "three_level"]
WAVEFORMS = ("sine", "three_level")
_SHORTEST_LAG, _LONGEST_LAG = 0.004, 1.0
_MOTOR_FRACTION = 0.25
# Largest step of the servo's own Runge-Kutta method over its shortest time constant: the error of a step is 1e-5.
_LARGEST_STEP = 0.25
_LAST_STAGE = 3  # of the classical Runge-Kutta method, counted from 0


@dataclass(frozen=True)
class Servo:
    """A servo; every imperfection is off where it is 0.

    Attributes:
        rate_limit: Fastest rate of the joint, rad/s.
        lag: Delay with which the joint follows, s; 0.004 to 1.
        backlash: Full play of the gears, rad.
        waveform: ``sine``, or ``three_level``: left, off and right only, as relays drive a tail.
        swing: Angle to which a three-level tail is thrown, rad.

    Raises:
        ValueError: A value out of range, or a rate limit, play or three-level wave without a lag: they alone would
            ask the joint for infinite acceleration.
    """

    rate_limit: float = 0.0
    lag: float = 0.0
    backlash: float = 0.0
    waveform: Waveform = "sine"
    swing: float = math.radians(15.0)

    def __post_init__(self) -> None:
        checks.number("servo.rate_limit", self.rate_limit, 0.0, 1000.0, unit="rad/s")
        checks.number("servo.lag", self.lag, 0.0, _LONGEST_LAG, unit="s")
        checks.number("servo.backlash", self.backlash, 0.0, math.pi, unit="rad")
        checks.choice("servo.waveform", self.waveform, WAVEFORMS)
        checks.number("servo.swing", self.swing, 0.0, math.pi, unit="rad", exclusive_minimum=True)
        if 0.0 < self.lag < _SHORTEST_LAG:
            checks.number("servo.lag", self.lag, _SHORTEST_LAG, _LONGEST_LAG, unit="s", advice="or 0 for none")
        if not self.lag and (self.rate_limit or self.backlash or self.waveform != "sine"):
            msg = (
                "servo.lag = 0 s with a rate limit, backlash or the three-level wave asks the joint for infinite "
                f"acceleration: set servo.lag to {_SHORTEST_LAG:g} s or more, 0.02 s for a hobby servo"
            )
            raise ValueError(msg)

    @classmethod
    def from_parameters(cls, values: Mapping[str, object]) -> Servo:
        """Build the servo from the simulator's parameters ``servo.*``; other names are ignored.

        Raises:
            ValueError: A value that is refused.
        """
        return cls(**{item.name: values[f"servo.{item.name}"] for item in fields(cls)})  # type: ignore[arg-type]


@kernel
def _follow(
    command: NDArray[np.float64],
    state: NDArray[np.float64],
    step: float,
    substeps: int,
    rate_limit: float,
    lag: float,
    motor_time: float,
    backlash: float,
    motion: NDArray[np.float64],
) -> None:
    """Let the joints follow a command.

    Args:
        command: Shape (2 substeps intervals + 1, joints), rad, at every half of a substep.
        state: Shape (3, joints): angle, rate and what the play lets through of the command; overwritten.
        step: Length of a substep in s.
        substeps: Substeps in an interval.
        rate_limit: rad/s, 0 for none.
        lag: s.
        motor_time: s.
        backlash: rad.
        motion: Written, shape (intervals + 1, joints, 3): angle, rate, acceleration.
    """
    half = 0.5 * backlash
    limit = rate_limit if rate_limit > 0.0 else np.inf
    ask = np.zeros(3)  # what the play lets through at the substep's begin, middle and end
    for joint in range(command.shape[1]):
        angle, rate, through = state[0, joint], state[1, joint], state[2, joint]
        for index in range((motion.shape[0] - 1) * substeps + 1):
            through = min(max(through, command[2 * index, joint] - half), command[2 * index, joint] + half)
            ask[0] = through
            wanted = min(max((ask[0] - angle) / lag, -limit), limit)
            bend = (wanted - rate) / motor_time
            if index % substeps == 0:
                row = index // substeps
                motion[row, joint, 0], motion[row, joint, 1], motion[row, joint, 2] = angle, rate, bend
                if row == motion.shape[0] - 1:
                    break
            for part in range(1, 3):
                at = command[2 * index + part, joint]
                ask[part] = min(max(ask[part - 1], at - half), at + half)
            angle_sum, rate_sum, rate_slope, bend_slope = 0.0, 0.0, rate, bend
            for stage in range(4):  # the classical Runge-Kutta method
                weight = 2.0 if 0 < stage < _LAST_STAGE else 1.0
                angle_sum += weight * rate_slope
                rate_sum += weight * bend_slope
                if stage == _LAST_STAGE:
                    break
                at_end = stage == _LAST_STAGE - 1
                reach = step if at_end else 0.5 * step
                new_angle, new_rate = angle + reach * rate_slope, rate + reach * bend_slope
                now = ask[2] if at_end else ask[1]
                wanted = min(max((now - new_angle) / lag, -limit), limit)
                rate_slope, bend_slope = new_rate, (wanted - new_rate) / motor_time
            angle += step / 6.0 * angle_sum
            rate += step / 6.0 * rate_sum
        state[0, joint], state[1, joint], state[2, joint] = angle, rate, through


class TailDrive:
    """What the driven joints do: a gait followed through a servo, slice of time by slice of time.

    ``servo`` may be exchanged between two slices; the joints go on from where they are.
    """

    def __init__(self, follower: GaitFollower, servo: Servo) -> None:
        """Start at neutral.

        Args:
            follower: The gait; commands go to it.
            servo: The servos, all alike.
        """
        self._follower = follower
        self.servo = servo
        self._state = np.zeros((3, follower.joints))

    @property
    def state(self) -> NDArray[np.float64]:
        """Where the servos are, shape (3, joints); set it to go back to where they were."""
        return self._state.copy()

    @state.setter
    def state(self, state: NDArray[np.float64]) -> None:
        self._state[:] = state

    def motion(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the joints' motion and move on to the end of ``times``.

        Args:
            times: Shape (T,), s, evenly spaced; the first one is the last one of the call before.

        Returns:
            Shape (T, joints, 3): angle in rad, rate in rad/s, acceleration in rad/s^2.
        """
        servo = self.servo
        if not servo.lag:
            motion = self._follower.motion(times)
            self._state[:] = motion[-1, :, [0, 1, 0]]  # where a servo with a lag would go on
            return motion
        motor_time = _MOTOR_FRACTION * servo.lag
        intervals = len(times) - 1
        interval = (times[-1] - times[0]) / intervals if intervals else 0.0
        substeps = max(1, math.ceil(interval / (_LARGEST_STEP * motor_time)))
        fine = np.linspace(times[0], times[-1], 2 * substeps * intervals + 1)
        if servo.waveform == "sine":
            command = self._follower.motion(fine)[:, :, 0]
        else:
            command = servo.swing * self._follower.levels(fine, servo.swing)
        motion = np.zeros((intervals + 1, command.shape[1], 3))
        _follow(
            np.ascontiguousarray(command),
            self._state,
            interval / substeps,
            substeps,
            servo.rate_limit,
            servo.lag,
            motor_time,
            servo.backlash,
            motion,
        )
        return motion
