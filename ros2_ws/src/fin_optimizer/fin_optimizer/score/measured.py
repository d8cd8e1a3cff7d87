"""The measures of a swim, by name: what `fin_optimizer.goals` has in its table, from what was recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.bags.messages import WRENCH_TYPE, decode, header_stamp, yaw_rate_samples
from fin_optimizer.goals import ENERGY_PER_METRE, VELOCITY
from fin_optimizer.score.mean_speed import ScoreError, Window, mean_power, mean_value
from fin_plant.plant_state import SERVO_TORQUE, THRUST
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.goals import Measure
    from fin_optimizer.score.joints import Joints
    from fin_optimizer.score.mean_speed import Score

    Samples = tuple[NDArray[np.int64], NDArray[np.float64]]
    """Header stamps in ns and a number a sample, both (n,)."""

STEADY_BEATS = 3
"""Whole beats at the window's end that steady figures are means over, or fewer where it has fewer."""
DRIVEN_PREFIX = "tail_joint"
"""What the names of the driven joints start with; the fin's own hinges are springs and take no power from a servo."""
TOPICS = {SERVO_TORQUE: "joint_states", THRUST: "thrust", VELOCITY: "velocity"}
"""Topic of each thing that a plant may tell."""
_NONE_OF_IT = {
    ENERGY_PER_METRE: "without headway there is no energy per metre",
    "efficiency": "servos that take up power have no efficiency",
    "turning_radius": "without a turn there is no turning radius",
}
"""Why a swim may have none of a measure."""


@dataclass(frozen=True)
class Figures:
    """What measures are made of, each computed when it is asked for. A ScoreError says what it lacks.

    Attributes:
        scored: The mean speed over the window.
        velocity: Forward speeds in m/s.
        velocity_messages: The same messages as serialised TwistStamped; empty where nobody kept them.
        joints: What joint_states tell.
        thrust_messages: Serialised WrenchStamped; empty where there are none.
        window: What counts.
        beat: Period of a beat in s.
    """

    scored: Score
    velocity: Samples
    velocity_messages: Sequence[bytes]
    joints: Sequence[Joints]
    thrust_messages: Sequence[bytes]
    window: Window
    beat: float

    def of(self, asked: Iterable[Measure]) -> dict[str, float]:
        """Return measures by name, in SI; NaN where a swim has none of it, see `why_none`.

        Raises:
            ScoreError: What was recorded does not tell one of them.
        """
        return {each.name: float(getattr(self, each.name)) for each in asked}

    @property
    def mean_speed(self) -> float:
        """Mean forward speed, m/s."""
        return self.scored.value

    @cached_property
    def steady(self) -> Window:
        """The last whole beats of the window."""
        beats = min(math.floor(self.window.duration / self.beat + 1e-9), STEADY_BEATS)
        if beats < 1:
            msg = (
                f"the window of {self.window.duration:g} s is shorter than a beat, {self.beat:g} s, which steady "
                "figures need: give a longer measurement.duration"
            )
            raise ScoreError(msg)
        end = self.window.end_ns
        return Window(max(end - round(beats * self.beat * NANOSECONDS), self.window.start_ns), end)

    @cached_property
    def steady_speed(self) -> float:
        """Mean forward speed over the last whole beats, m/s."""
        return mean_value(*self.velocity, self.steady, "velocity", "no speed")

    @cached_property
    def power(self) -> float:
        """Mean mechanical power of the servos, W."""
        return mean_power(*power_samples(self.joints), self.window)

    @property
    def energy_per_metre(self) -> float:
        """Mean power over mean speed, J/m."""
        return self.power / self.mean_speed if self.mean_speed > 0.0 else math.nan

    @cached_property
    def thrust(self) -> float:
        """Mean forward force of the water on the tail over the last whole beats, N."""
        wrenches = (decode(data, WRENCH_TYPE) for data in self.thrust_messages)
        forces = np.array([each.wrench.force.x for each in wrenches], dtype=np.float64)
        stamps = np.array(list(map(header_stamp, self.thrust_messages)), dtype=np.int64)
        return mean_value(stamps, forces, self.steady, "thrust", "no force")

    @property
    def efficiency(self) -> float:
        """Steady thrust times steady speed over steady power."""
        power = mean_power(*power_samples(self.joints), self.steady)
        useful = self.thrust * self.steady_speed
        return useful / power if power > 0.0 else math.nan

    @cached_property
    def turning_rate(self) -> float:
        """Mean yaw rate over the last whole beats, either way, rad/s."""
        stamps, rates = yaw_rate_samples(self.velocity_messages)
        if not rates.any():
            msg = "velocity tells no yaw rate: twist.angular.z is 0 throughout, give it there"
            raise ScoreError(msg)
        return abs(mean_value(stamps, rates, self.steady, "velocity", "no yaw rate"))

    @property
    def turning_radius(self) -> float:
        """Steady speed over turning rate, m."""
        rate = self.turning_rate
        return abs(self.steady_speed) / rate if rate > 0.0 else math.nan

    @property
    def servo_torque(self) -> float:
        """Largest torque of any servo in the window, N m."""
        stamps = np.concatenate([each.stamps for each in self.joints] or [np.zeros(0, dtype=np.int64)])
        torques = np.concatenate([_largest_torque(each) for each in self.joints] or [np.zeros(0)])
        mean_value(stamps, torques, self.window, TOPICS[SERVO_TORQUE], "no torque of the tail's joints")  # or says why
        inside = (stamps >= self.window.start_ns) & (stamps <= self.window.end_ns)
        return float(torques[inside].max())


def why_none(measured: Mapping[str, float]) -> str:
    """Return why a swim has none of some measures, or an empty text."""
    return "; ".join(_NONE_OF_IT[name] for name, value in measured.items() if math.isnan(value))


def power_samples(joints: Sequence[Joints]) -> Samples:
    """Return header stamps in ns and the tail servos' mechanical power in W, both (n,); NaN where none is told."""
    stamps = [each.stamps for each in joints] or [np.zeros(0, dtype=np.int64)]
    return np.concatenate(stamps), np.concatenate([_power(each) for each in joints] or [np.zeros(0)])


def _driven(joints: Joints) -> list[int]:
    return [index for index, name in enumerate(joints.names) if name.startswith(DRIVEN_PREFIX)]


def _power(joints: Joints) -> NDArray[np.float64]:
    driven, told = _driven(joints), len(joints.names)
    if not driven or joints.effort.shape[1] != told or joints.velocity.shape[1] != told:
        return np.full(joints.stamps.shape, np.nan)
    power = np.zeros(joints.stamps.shape)
    for index in driven:
        power += joints.effort[:, index] * joints.velocity[:, index]
    return power


def _largest_torque(joints: Joints) -> NDArray[np.float64]:
    driven = _driven(joints)
    if not driven or joints.effort.shape[1] != len(joints.names):
        return np.full(joints.stamps.shape, np.nan)
    return np.asarray(np.abs(joints.effort[:, driven]).max(axis=1))
