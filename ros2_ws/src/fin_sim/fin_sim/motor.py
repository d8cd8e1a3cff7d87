"""The direct-current motor in a servo: what torque a driven joint has, and what that costs.

A motor with its gears, seen from the joint, has at the duty u, the share of the supply's voltage that its controller
lets through, the torque and the power drawn from the supply

    torque = stall_torque (u - rate / no_load_speed),   power = u no_load_speed torque
                                                              = torque rate + torque^2 no_load_speed / stall_torque

with the motor's mechanical power and its windings' heat in the second line; driven backwards it may give power back
(Hughes & Drury, *Electric Motors and Drives*, 2013, chapter 3; without inductance and friction). The controller gives
duty in proportion to the error of the angle, up to the whole voltage either way,

    u = gain (e + derivative_time de/dt) between -1 and 1,   e = target - angle.

The rotor turns many times as fast as the joint: its inertia there is stall_torque time_constant / no_load_speed, with
the time in which the servo alone comes to 63 % of its no-load speed. It acts on the joint's own acceleration only, and
takes its torque before the shaft: what a joint's torque and the servos' mechanical power tell is what is left there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Mapping


# The servo's fastest motion takes so many steps of the classical Runge-Kutta method: the error of one is 1e-5.
_LARGEST_STEP = 0.25
_SHORTEST_STEP = 1e-5


@dataclass(frozen=True)
class Motor:
    """A servo's motor with its gears and controller, seen from the joint.

    Attributes:
        stall_torque: At full voltage when the joint is held, N m.
        no_load_speed: At full voltage without a load, rad/s.
        gain: Duty for an error of the angle, 1/rad: its inverse is the error from which on the servo gives all it has.
        derivative_time: Weight of the error's rate against the error, s.
        time_constant: Mechanical time constant without a load, s.

    Raises:
        ValueError: A value out of range, or a controller that would need steps shorter than 10 us.
    """

    stall_torque: float
    no_load_speed: float
    gain: float
    derivative_time: float
    time_constant: float

    def __post_init__(self) -> None:
        checks.number("servo.stall_torque", self.stall_torque, 0.0, unit="N m", exclusive_minimum=True)
        checks.number("servo.no_load_speed", self.no_load_speed, 0.0, unit="rad/s", exclusive_minimum=True)
        checks.number("servo.gain", self.gain, 0.0, unit="1/rad", exclusive_minimum=True)
        checks.number("servo.derivative_time", self.derivative_time, 0.0, unit="s")
        checks.number("servo.time_constant", self.time_constant, 0.0, unit="s", exclusive_minimum=True)
        if self.longest_step < _SHORTEST_STEP:
            msg = (
                f"servo.gain = {self.gain:g}/rad with servo.derivative_time = {self.derivative_time:g} s asks for "
                f"steps of {self.longest_step:.2g} s, shorter than {_SHORTEST_STEP:g} s: lower them, or raise "
                f"servo.time_constant = {self.time_constant:g} s"
            )
            raise ValueError(msg)

    @classmethod
    def from_parameters(cls, values: Mapping[str, object]) -> Motor | None:
        """Build the motor from the simulator's parameters ``servo.*``; None where its stall torque is 0.

        Raises:
            ValueError: A value that is refused.
        """
        own = {item.name: values[f"servo.{item.name}"] for item in fields(cls)}
        return cls(**own) if own["stall_torque"] != 0.0 else None  # type: ignore[arg-type]

    @property
    def back_emf(self) -> float:
        """Torque that is lost to speed, N m s/rad."""
        return self.stall_torque / self.no_load_speed

    @property
    def inertia(self) -> float:
        """Inertia of the rotor at the joint, kg m^2."""
        return self.back_emf * self.time_constant

    @property
    def constants(self) -> tuple[float, ...]:
        """Columns of the kernel's table of links: stall torque, back EMF, gain of angle and of rate, inertia."""
        return self.stall_torque, self.back_emf, self.gain, self.gain * self.derivative_time, self.inertia

    @property
    def longest_step(self) -> float:
        """Longest time step in s that resolves the servo without a load, as long as its duty is not the whole one."""
        damping = (1.0 + self.no_load_speed * self.gain * self.derivative_time) / self.time_constant
        stiffness = self.no_load_speed * self.gain / self.time_constant
        rest = 0.25 * damping**2 - stiffness
        fastest = 0.5 * damping + math.sqrt(rest) if rest > 0.0 else math.sqrt(stiffness)
        return _LARGEST_STEP / fastest
