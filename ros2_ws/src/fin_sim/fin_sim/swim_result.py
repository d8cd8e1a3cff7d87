"""What a swim did, and the figures that a laboratory draws from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy

from fin_plant import validity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_plant.gait import Gait
    from fin_sim.chain import Chain

MEASURED_BEATS = 3
"""Whole beats at the end of a swim that the steady figures are drawn from, or fewer where it has fewer."""


def beat_frequency(gait: Gait) -> float:
    """Return the tail-beat frequency in Hz: the first joint's that is driven to and fro; 0 where none is."""
    beating = (joint.frequency for joint in gait.joints if joint.amplitude > 0.0 and joint.frequency > 0.0)
    return next(beating, 0.0)


def measured_beats(gait: Gait, duration: float, ramp_time: float) -> NDArray[np.float64]:
    """Return the times in s at which the beats begin and end that steady figures are means over; see `Swim.beats`.

    Raises:
        ValueError: The tail does not beat, or the swim is too short for one beat after the ramp.
    """
    frequency = beat_frequency(gait)
    if frequency == 0.0:
        msg = "the gait has no joint with amplitude and frequency above 0: steady figures need a beating tail"
        raise ValueError(msg)
    whole = math.floor((duration - ramp_time) * frequency + 1e-9)
    if whole < 1:
        msg = (
            f"duration = {duration:g} s is too short for a steady figure: it needs at least the ramp of "
            f"{ramp_time:g} s and one beat, {ramp_time + 1.0 / frequency:g} s"
        )
        raise ValueError(msg)
    return duration - np.arange(min(whole, MEASURED_BEATS), -1, -1) / frequency


@dataclass(frozen=True)
class Swim:
    """What a swim did: samples over time, and figures drawn from them.

    *Steady* figures are means over the last whole beats: three, or as many as lie between the end of the gait's ramp
    and the end of the swim. They raise ValueError where there is not even one.

    With S samples, N links and J driven joints the arrays are:

    Attributes:
        chain: What swam.
        gait: The gait commanded.
        ramp_time: Time in which the gait started, s.
        time: s, shape (S,), from 0.
        x: Position in the tank, m, shape (S,).
        y: Position in the tank, m, shape (S,).
        heading: rad, shape (S,), continuous.
        surge: Forward velocity over ground, m/s, shape (S,): what a tracker sees and the velocity topic has.
        sway: The same to the left, m/s, shape (S,).
        water_surge: Forward velocity through the water, m/s, shape (S,); in still water the same as over ground.
        water_sway: The same to the left, m/s, shape (S,).
        yaw_rate: rad/s, shape (S,).
        joint_angles: rad, shape (S, N).
        joint_rates: rad/s, shape (S, N).
        joint_torques: Servo's at its shaft, or spring's and damper's, N m, shape (S, N).
        servo_power: Mechanical power of all servos at their shafts, W, shape (S,).
        electrical_power: What all servos draw from their supply, W, shape (S,); below 0 where they give back. Of ideal
            servos 0: they tell none.
        force: Of the water on the tail in tank axes, N, shape (S, 2), its inertial reaction included.
        convective_force: The same without the reaction: convective and resistive part, N, shape (S, 2).
    """

    chain: Chain
    gait: Gait
    ramp_time: float
    time: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    surge: NDArray[np.float64]
    sway: NDArray[np.float64]
    water_surge: NDArray[np.float64]
    water_sway: NDArray[np.float64]
    yaw_rate: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    joint_rates: NDArray[np.float64]
    joint_torques: NDArray[np.float64]
    servo_power: NDArray[np.float64]
    electrical_power: NDArray[np.float64]
    force: NDArray[np.float64]
    convective_force: NDArray[np.float64]

    # -- the run -----------------------------------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        """Length of the swim in s."""
        return float(self.time[-1])

    @cached_property
    def mean_speed(self) -> float:
        """Distance over ground from start to end over the duration, m/s: the papers' mean speed over the run."""
        return math.hypot(self.x[-1] - self.x[0], self.y[-1] - self.y[0]) / self.duration

    @cached_property
    def mean_forward_speed(self) -> float:
        """Mean over time of the forward velocity over ground, m/s: what is scored from the velocity topic."""
        return float(np.mean(self.surge))

    @cached_property
    def path_length(self) -> float:
        """Length of the path of the centre of mass over ground, m."""
        return self.duration * self.mean_between(np.hypot(self.surge, self.sway), 0.0, self.duration)

    # -- the last whole beats ----------------------------------------------------------------------------------------

    @cached_property
    def frequency(self) -> float:
        """Tail-beat frequency in Hz: the first joint's that is driven to and fro; 0 where none is."""
        return beat_frequency(self.gait)

    @cached_property
    def beats(self) -> NDArray[np.float64]:
        """Times in s at which the measured beats begin and end, shape (beats + 1,), the last one the swim's end.

        Raises:
            ValueError: The tail does not beat, or the swim is too short for one beat after the ramp.
        """
        return measured_beats(self.gait, self.duration, self.ramp_time)

    def beat_mean(self, values: NDArray[np.float64]) -> float:
        """Return the mean over the measured beats of ``values``, shape (S,); beats need not end on a sample.

        Raises:
            ValueError: There is no whole beat, see `beats`.
        """
        return self.mean_between(values, max(self.beats[0], 0.0), self.beats[-1])

    def mean_between(self, values: NDArray[np.float64], begin: float, end: float) -> float:
        """Return the mean of ``values``, shape (S,), from ``begin`` to ``end`` s of the swim."""
        return float(scipy.interpolate.CubicSpline(self.time, values).integrate(begin, end)) / (end - begin)

    def _at(self, values: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
        result: NDArray[np.float64] = scipy.interpolate.CubicSpline(self.time, values)(times)
        return result

    @cached_property
    def steady_speed(self) -> float:
        """Distance over ground from beat to beat over the period, mean of the last whole beats, m/s."""
        return self._steady_speed(self.x, self.y)

    @cached_property
    def steady_water_speed(self) -> float:
        """The same through the water, m/s."""
        return self._steady_speed(*self._drifting(self.x, self.y))

    def _steady_speed(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
        steps = np.hypot(*np.diff(np.stack((self._at(x, self.beats), self._at(y, self.beats)))))
        return float(np.mean(steps)) * self.frequency

    def _drifting(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a path, m, shape (S,) each, as seen from the water."""
        water = self.chain.water
        return x - water.current_x * self.time, y - water.current_y * self.time

    @cached_property
    def thrust(self) -> NDArray[np.float64]:
        """Forward part of the water's force on the tail, its inertial reaction included, N, shape (S,)."""
        thrust: NDArray[np.float64] = self.force[:, 0] * np.cos(self.heading) + self.force[:, 1] * np.sin(self.heading)
        return thrust

    @cached_property
    def mean_thrust(self) -> float:
        """Mean of `thrust` over the last whole beats, N: what balances the body's drag in steady swimming."""
        return self.beat_mean(self.thrust)

    @cached_property
    def mean_servo_power(self) -> float:
        """Mean over the last whole beats of all servos' mechanical power, W; a servo takes power back as well."""
        return self.beat_mean(self.servo_power)

    @cached_property
    def mean_electrical_power(self) -> float:
        """Mean of `electrical_power` over the last whole beats, W.

        Raises:
            ValueError: The servos are ideal, without a motor.
        """
        if self.chain.motor is None:
            msg = "servo.stall_torque = 0 N m, an ideal servo: electrical power needs servos with a motor"
            raise ValueError(msg)
        return self.beat_mean(self.electrical_power)

    @cached_property
    def servo_amplitude(self) -> float:
        """Half of how far the fin's servo really goes in the last beat from one side to the other, rad."""
        begin, end = max(self.beats[-2], 0.0), self.beats[-1]
        angles = self.joint_angles[:, int(np.flatnonzero(self.chain.driven)[-1])]
        return 0.5 * float(np.ptp(self._at(angles, np.linspace(begin, end, 401))))

    @cached_property
    def largest_servo_torque(self) -> float:
        """Largest torque of any servo after the gait's ramp, N m.

        Raises:
            ValueError: The swim is not longer than the ramp.
        """
        if self.duration <= self.ramp_time:
            msg = (
                f"duration = {self.duration:g} s is not longer than the gait's ramp of {self.ramp_time:g} s: "
                "the servo's largest torque is that after it"
            )
            raise ValueError(msg)
        driven = np.array(self.chain.driven)
        return float(np.abs(self.joint_torques[self.time >= self.ramp_time][:, driven]).max())

    @cached_property
    def largest_hinge_angle(self) -> float:
        """Largest angle of any passive joint at any sample, rad; 0 where every joint is driven."""
        bends = np.abs(self.joint_angles[:, ~np.array(self.chain.driven)])
        return float(bends.max()) if bends.size else 0.0

    @property
    def warnings(self) -> list[str]:
        """What is doubtful in the swim; see `validity`."""
        return [text for text in (validity.bent(self.largest_hinge_angle), *self.chain.warnings()) if text]

    @cached_property
    def efficiency(self) -> float:
        """Hydrodynamic (Froude) efficiency of the last whole beats: mean thrust times forward speed over servo power.

        The speed is that through the water: of a body that is held in still water 0.

        Raises:
            ValueError: The force acts at the tip, which gives wrong power; or the servos deliver no power.
        """
        if self.chain.reactive != "distributed":
            msg = "reactive = 'tip' gives wrong servo power: efficiency needs reactive = 'distributed'"
            raise ValueError(msg)
        if self.mean_servo_power <= 0.0:
            msg = f"mean servo power = {self.mean_servo_power:g} W: efficiency needs servos that deliver power"
            raise ValueError(msg)
        return self.mean_thrust * self.beat_mean(self.water_surge) / self.mean_servo_power

    @cached_property
    def tip_path(self) -> NDArray[np.float64]:
        """Position of the fin's trailing edge in the tank, m, shape (S, 2)."""
        return self.joint_path[:, -1]

    @cached_property
    def joint_path(self) -> NDArray[np.float64]:
        """Positions of the links' joints and of the trailing edge in the tank, m, shape (S, N + 1, 2)."""
        lengths = np.array([link.length for link in self.chain.links])
        angles = self.heading[:, None] + np.cumsum(self.joint_angles, axis=1)
        angles = np.concatenate((self.heading[:, None], angles), axis=1)
        lengths = np.concatenate(([self.chain.body.tail_offset], lengths))
        links = lengths[None, :, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        joints: NDArray[np.float64] = np.stack((self.x, self.y), axis=-1)[:, None] - np.cumsum(links, axis=1)
        return joints

    @cached_property
    def tip_amplitude(self) -> float:
        """Half the trailing edge's largest excursion across the course in the last whole beat, m, peak to peak.

        The course leads through the water from the body's place at the beat's start to that at its end; a body that
        is held, towed or does not move keeps to its mean heading.
        """
        begin, end = max(self.beats[-2], 0.0), self.beats[-1]
        times = np.linspace(begin, end, 401)
        ends = times[[0, -1]]
        course = self._drifting(self.x, self.y)
        dx, dy = (float(np.diff(self._at(place, ends))[0]) for place in course)
        tip_x, tip_y = self._drifting(*self.tip_path.T)
        if self.chain.clamp != "free" or math.hypot(dx, dy) == 0.0:
            direction = self.beat_mean(self.heading)
            dx, dy = math.cos(direction), math.sin(direction)
            tip_x, tip_y = self.tip_path.T
        across = (tip_y * dx - tip_x * dy) / math.hypot(dx, dy)
        excursion = self._at(across, times)
        return 0.5 * float(np.ptp(excursion))

    @cached_property
    def strouhal_number(self) -> float:
        """Frequency times peak-to-peak tip excursion over steady speed through the water; at none infinite."""
        if self.steady_water_speed == 0.0:
            return math.inf
        return self.frequency * 2.0 * self.tip_amplitude / self.steady_water_speed

    @cached_property
    def mass(self) -> float:
        """Mass of body and tail without the water's, kg."""
        sides = (link.mass_per_area * link.area for link in self.chain.links)
        return self.chain.body.mass + sum(sides)

    @cached_property
    def cost_of_transport(self) -> float:
        """Mean servo power over mass and steady speed through the water, J/(kg m).

        Divided by 9.81 m/s^2 it has no unit. Infinite for a body that stands still in the water.
        """
        if self.steady_water_speed == 0.0:
            return math.inf
        return self.mean_servo_power / (self.mass * self.steady_water_speed)

    @cached_property
    def turning_rate(self) -> float:
        """Mean yaw rate over the last whole beats, rad/s, positive to the left."""
        return self.beat_mean(self.yaw_rate)

    @cached_property
    def turning_radius(self) -> float:
        """Steady speed over the absolute turning rate, m; infinite on a straight course."""
        return self.steady_speed / abs(self.turning_rate) if self.turning_rate else math.inf
