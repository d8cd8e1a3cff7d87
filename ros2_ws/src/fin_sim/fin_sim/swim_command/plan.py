"""What one swim of the command needs: fin, fish, gait and run, as options and parameter files describe them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.gait import Gait, gait_preset
from fin_plant.parameters import ParameterTable, Value
from fin_sim.chain import Clamp, Reactive, build_chain
from fin_sim.fish import Fish
from fin_sim.materials import damping_time
from fin_sim.servo import Servo
from fin_sim.swim import SIMULATOR_PARAMETERS, swim

if TYPE_CHECKING:
    from collections.abc import Collection

    from fin_sim.swim_result import Swim

# What only the node has, its pace, clock and rate of messages, and what the command has options of its own for.
_NODE_ONLY = {"speed", "publish_clock", "sample_rate", "reactive", "step"}
PARAMETERS = ParameterTable(
    {**FIN_PARAMETERS, **{n: entry for n, entry in SIMULATOR_PARAMETERS.items() if n not in _NODE_ONLY}}
)
"""Parameters of fin, fish, water and servo, by the names that the node gives them."""

GAIT_NUMBERS = {"amplitude": "degrees", "frequency": "Hz", "bias": "degrees", "tow_speed": "m/s"}
"""What can vary besides the parameters, and its units."""


@dataclass(frozen=True)
class SwimPlan:
    """One swim as the command describes it.

    Attributes:
        values: Parameters of `PARAMETERS` that differ from their defaults.
        gait: Name of the gait.
        amplitude: Of the last driven joint, degrees.
        frequency: Hz.
        bias: Of every driven joint, degrees.
        duration: s.
        ramp_time: s.
        reactive: ``distributed`` or ``tip``.
        clamp: ``free``, ``fixed`` or ``towed``.
        tow_speed: m/s, for ``towed``.
        step: Longest time step, s.
        loss_factor: tan delta of the fin's material, from which its damping time follows with the frequency; where it
            is None the fin's own damping time holds.
    """

    values: dict[str, Value]
    gait: str = "carangiform"
    amplitude: float = 15.0
    frequency: float = 0.9
    bias: float = 0.0
    duration: float = 10.0
    ramp_time: float = 0.5
    reactive: Reactive = "distributed"
    clamp: Clamp = "free"
    tow_speed: float = 0.0
    step: float = 1e-3
    loss_factor: float | None = None

    def fin(self) -> Fin:
        """Return the fin.

        Raises:
            ValueError: A value that is refused.
        """
        fin = Fin.from_parameters(self.values)
        if self.loss_factor is None or self.frequency <= 0.0:
            return fin
        return replace(fin, damping_time=damping_time(self.loss_factor, self.frequency))

    def fish(self) -> Fish:
        """Return the fish.

        Raises:
            ValueError: A value that is refused.
        """
        return Fish.from_parameters(PARAMETERS.checked(self.values))

    def body_axes(self) -> tuple[float, float]:
        """Return the body's length and width, m.

        Raises:
            ValueError: A value that is refused.
        """
        values = PARAMETERS.checked(self.values)
        return cast("float", values["body.length"]), cast("float", values["body.width"])

    def title(self, varied: Collection[str] = ()) -> str:
        """Return what swims how, for the heading of a picture; the numbers in ``varied`` are left out."""
        gait = [self.gait.replace("_", "-")]
        gait += [f"{self.amplitude:g}\N{DEGREE SIGN}"] if "amplitude" not in varied else []
        gait += [f"{self.frequency:g} Hz"] if "frequency" not in varied else []
        gait += [f"bias {self.bias:g}\N{DEGREE SIGN}"] if self.bias and "bias" not in varied else []
        body = [] if self.clamp == "free" else [f"body {self.clamp}"]
        return "; ".join([self.fin().describe(varied), " ".join(gait), *body, f"swims of {self.duration:g} s"])

    def check(self) -> None:
        """Refuse what cannot swim, without swimming it.

        Raises:
            ValueError: A value that is refused.
        """
        fish = self.fish()
        build_chain(fish, self.fin(), reactive=self.reactive, clamp=self.clamp, tow_speed=self.tow_speed)
        self.drive(fish.driven_joints)
        self.servo()

    def servo(self) -> Servo:
        """Return what shapes the command of every driven joint.

        Raises:
            ValueError: A value that is refused.
        """
        return Servo.from_parameters(PARAMETERS.checked(self.values))

    def drive(self, joints: int) -> Gait:
        """Return the gait for a tail of so many driven joints.

        Raises:
            ValueError: A gait that does not fit the tail, or a drive that is refused.
        """
        checks.number("amplitude", self.amplitude, 0.0, 180.0, unit="degrees")
        checks.number("bias", self.bias, -180.0, 180.0, unit="degrees")
        if self.amplitude > 0.0 and self.frequency == 0.0:
            msg = "frequency = 0 Hz: a tail does not beat at it; give one above 0 Hz, or amplitude 0"
            raise ValueError(msg)
        if self.gait == "sub_carangiform" and joints < 2:  # noqa: PLR2004
            msg = (
                f"driven joints of a sub-carangiform gait = {joints}, it needs 2 or 3: give the tail links before the "
                f"fin with {', '.join(name for name in PARAMETERS if name.startswith('peduncle.'))}"
            )
            raise ValueError(msg)
        gait = gait_preset(self.gait, joints, math.radians(self.amplitude), self.frequency)
        return Gait(tuple(replace(joint, bias=math.radians(self.bias)) for joint in gait.joints))

    def swim(self) -> Swim:
        """Swim it.

        Raises:
            ValueError: A value that is refused.
            StepError: The state stopped being finite.
        """
        fish = self.fish()
        return swim(
            self.fin(),
            fish,
            self.drive(fish.driven_joints),
            self.duration,
            reactive=self.reactive,
            clamp=self.clamp,
            tow_speed=self.tow_speed,
            servo=self.servo(),
            ramp_time=self.ramp_time,
            step=self.step,
        )

    def changed(self, name: str, value: float | str) -> SwimPlan:
        """Return the plan with one number or word changed.

        Raises:
            ValueError: An unknown name.
        """
        if name in GAIT_NUMBERS:
            return replace(self, **{name: value})  # type: ignore[arg-type]
        PARAMETERS.require(name)
        return replace(self, values={**self.values, name: value})
