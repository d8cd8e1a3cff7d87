"""A fish whose physics the optimiser does not know: the simulator's, with other parameters, and servos that lag."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks
from fin_plant.checks import counted
from fin_sim import dynamics, time_stepping
from fin_sim.chain import build_chain
from fin_sim.fish import Fish
from fin_sim.swim import LARGEST_NORMAL_DRAG, SIMULATOR_PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from fin_plant.fin import Fin
    from fin_plant.parameters import Value

SAMPLE_TIME = 0.01
_STEP = 1e-3
HIDDEN_WIDTHS = {
    "mass": 0.15,
    "drag": 0.3,
    "stiffness": 0.25,
    "servo_lag": 0.4,
    "lift": 0.3,
    "yaw_drag": 0.4,
    "normal_drag": 0.4,
}
"""Standard deviations of the logarithms of what a seed draws: about half of what a cloud of fish believes."""


@dataclass(frozen=True)
class Deviation:
    """How the hidden fish differs from the simulator's.

    Attributes:
        mass: Factor on the body's mass and moment of inertia.
        drag: Factor on the body's drag.
        stiffness: Factor on the fin's Young's modulus: the sheet is not what its label says.
        servo_lag: Time constant in s of the critically damped servos.
        lift: Factor on the body's lift.
        yaw_drag: Factor on the body's resistance to turning.
        normal_drag: Factor on the fin's resistance across the flow.

    Raises:
        ValueError: A value out of range.
    """

    mass: float = 1.1
    drag: float = 1.2
    stiffness: float = 0.85
    servo_lag: float = 0.03
    lift: float = 1.0
    yaw_drag: float = 1.0
    normal_drag: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mass", "drag", "stiffness", "lift", "yaw_drag", "normal_drag"):
            checks.number(f"hidden.{name}", getattr(self, name), 0.1, 10.0)
        checks.number("hidden.servo_lag", self.servo_lag, 0.001, 1.0, unit="s")

    @classmethod
    def drawn(cls, seed: int) -> Deviation:
        """Return a deviation that nobody has chosen: each number off by its own width, the same for a seed."""
        random = np.random.default_rng(seed)
        middle = {"servo_lag": cls.servo_lag}
        factors = {
            name: float(np.exp(np.clip(random.standard_normal(), -2.0, 2.0) * width))
            for name, width in HIDDEN_WIDTHS.items()
        }
        return cls(**{name: middle.get(name, 1.0) * factor for name, factor in factors.items()})


class Servo:
    """Servos that follow their targets as critically damped second-order systems, exactly for a constant target."""

    def __init__(self, joints: int, lag: float) -> None:
        """Start at neutral, at rest."""
        self.angle = np.zeros(joints)
        self.rate = np.zeros(joints)
        self._lag = lag

    def straighten(self) -> None:
        """Turn all joints to neutral by hand, at rest."""
        self.angle[:], self.rate[:] = 0.0, 0.0

    def motion(self, targets: Sequence[float | None], times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Advance to the last of ``times`` s, shape (T,), from 0; return the motion on the way, shape (T, joints, 3).

        A servo without a target has no force; its angle stays, held by gear and water.
        """
        target = np.array([self.angle[i] if value is None else value for i, value in enumerate(targets)])
        first = self.angle - target
        second = self.rate + first / self._lag
        decay, t = np.exp(-times / self._lag)[:, None], times[:, None]
        offset = (first + second * t) * decay
        rate = second * decay - offset / self._lag
        acceleration = -second * decay / self._lag - rate / self._lag
        result = np.stack((target + offset, rate, acceleration), axis=-1)
        self.angle, self.rate = result[-1, :, 0].copy(), result[-1, :, 1].copy()
        return result


class HiddenFish:
    """The fish in its tank."""

    def __init__(
        self, fin: Fin, joints: int, deviation: Deviation, peduncle: Mapping[str, Value] = MappingProxyType({})
    ) -> None:
        """Put the fish at the origin, at rest.

        Args:
            fin: On its tail.
            joints: Of the robot, each with a servo or its relays.
            deviation: From the simulator's fish.
            peduncle: The simulator's ``peduncle.*``: driven links between body and fin; empty for none.

        Raises:
            ValueError: A fin or a peduncle that cannot be, or another number of joints than the fish has.
        """
        self._deviation = deviation
        self._peduncle = dict(peduncle)
        self._servo = Servo(joints, deviation.servo_lag)
        self.mount(fin)

    def mount(self, fin: Fin) -> None:
        """Put another fin on, and the fish at the origin, at rest.

        Raises:
            ValueError: A fin that cannot be.
        """
        values = SIMULATOR_PARAMETERS.checked(self._peduncle)
        fish = Fish.from_parameters(values)
        body = replace(
            fish.body,
            mass=fish.body.mass * self._deviation.mass,
            inertia=fish.body.inertia * self._deviation.mass,
            drag_area=fish.body.drag_area * self._deviation.drag,
            lift_area=fish.body.lift_area * self._deviation.lift,
            yaw_drag=fish.body.yaw_drag * self._deviation.yaw_drag,
        )
        water = replace(
            fish.water, normal_drag=min(fish.water.normal_drag * self._deviation.normal_drag, LARGEST_NORMAL_DRAG)
        )
        softer = replace(fin, young_modulus=fin.young_modulus * self._deviation.stiffness)
        chain = build_chain(replace(fish, body=body, water=water), softer)
        if sum(chain.driven) != len(self._servo.angle):
            joints = len(self._servo.angle)
            msg = (
                f"the robot file has {counted(joints, 'driven joint')}, the hidden fish {sum(chain.driven)}: "
                f"give peduncle.length and the other peduncle.* {joints - 1} values, one link a joint but the fin's"
            )
            raise ValueError(msg)
        self._stepper = time_stepping.stepper_of(chain, _STEP, round(SAMPLE_TIME / _STEP))
        self.put_at_origin()

    def put_at_origin(self) -> None:
        """Bring the fish back to its mark, at rest and with a straight tail, as a person does who holds it."""
        self._state = self._stepper.start()
        self._servo.straighten()

    def angle(self, joint: int) -> float:
        """Return the true angle of a joint in rad."""
        return float(self._servo.angle[joint])

    def advance(self, targets: Sequence[float | None]) -> tuple[float, float, float]:
        """Swim `SAMPLE_TIME` s with the servos driven to ``targets`` rad; return x, y in m and the heading in rad."""
        states, _ = self._stepper.advance(self._state, self._servo.motion(targets, self._stepper.half_step_times(1)))
        last = states[-1]
        return float(last[dynamics.X]), float(last[dynamics.Y]), float(last[dynamics.HEADING])

    @property
    def forward_speed(self) -> float:
        """True forward velocity in m/s, which no observer sees."""
        return float(self._state[dynamics.SURGE])


@dataclass(frozen=True)
class Camera:
    """An overhead camera with a tracker.

    Attributes:
        position_noise: Standard deviation in m.
        heading_noise: Standard deviation in rad.
        dropouts: Part of the pictures in which the fish is not found.
        outliers: Part of the pictures in which something else is taken for the fish.
    """

    position_noise: float = 3e-4
    heading_noise: float = math.radians(0.5)
    dropouts: float = 0.01
    outliers: float = 0.002

    def see(self, pose: tuple[float, float, float], random: np.random.Generator) -> tuple[float, float, float] | None:
        """Return the pose as the tracker reports it, or None."""
        if random.random() < self.dropouts:
            return None
        x, y, heading = pose
        if random.random() < self.outliers:
            x, y = x + random.normal(0.0, 0.2), y + random.normal(0.0, 0.2)
        x, y = x + random.normal(0.0, self.position_noise), y + random.normal(0.0, self.position_noise)
        return x, y, heading + random.normal(0.0, self.heading_noise)
