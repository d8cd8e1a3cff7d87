"""What one swim of the command needs, and many of them while one or two of its numbers vary."""

from __future__ import annotations

import contextlib
import difflib
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from threadpoolctl import threadpool_limits

from fin_plant import checks, validity
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.gait import Gait, gait_preset
from fin_plant.parameters import ParameterTable, Value
from fin_sim.chain import Clamp, Reactive, build_chain
from fin_sim.fish import Fish
from fin_sim.materials import damping_time
from fin_sim.servo import Servo
from fin_sim.swim import SIMULATOR_PARAMETERS, swim
from fin_sim.time_stepping import StepError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from fin_sim.swim_result import Swim

# What only the node has, its pace, clock and rate of messages, and what the command has options of its own for.
_NODE_ONLY = {"speed", "publish_clock", "sample_rate", "reactive", "step"}
PARAMETERS = ParameterTable(
    {**FIN_PARAMETERS, **{n: entry for n, entry in SIMULATOR_PARAMETERS.items() if n not in _NODE_ONLY}}
)
"""Parameters of fin, fish, water and servo, by the names that the node gives them."""

GAIT_NUMBERS = {"amplitude": "degrees", "frequency": "Hz", "bias": "degrees", "tow_speed": "m/s"}
"""What can vary besides the parameters, and its units."""

_LARGEST_SWEEP = 10_000
Cell = Any
"""What a row of a variation holds: a number, a word that varies, or None."""


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


@dataclass(frozen=True)
class Axis:
    """One number, or word, that varies, and the values that it takes."""

    name: str
    values: tuple[Any, ...]

    @property
    def of_words(self) -> bool:
        """Whether it is a word that varies."""
        return isinstance(self.values[0], str)

    @property
    def unit(self) -> str:
        """Unit of the values, empty for a number that has none."""
        return GAIT_NUMBERS[self.name] if self.name in GAIT_NUMBERS else PARAMETERS[self.name].unit


def parse_axis(text: str) -> Axis:
    """Return the axis of ``NAME=FIRST:LAST:COUNT``, ``NAME=FIRST:LAST:COUNT:log`` or ``NAME=VALUE,VALUE,...``.

    What has a choice of words takes the last form.

    Raises:
        ValueError: Another form, or a name that cannot vary.
    """
    name, _, rule = text.partition("=")
    if name not in GAIT_NUMBERS:
        if name not in PARAMETERS:
            near = difflib.get_close_matches(name, (*PARAMETERS, *GAIT_NUMBERS), n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            msg = (
                f"{name or repr(text)} is not a parameter that can vary: {hint}{', '.join(GAIT_NUMBERS)} can, and "
                "the numbers that `swim --help` lists last"
            )
            raise ValueError(msg)
        parameter = PARAMETERS[name]
        if parameter.choices:
            return Axis(name, tuple(parameter.check(word.strip()) for word in rule.split(",")))
        if parameter.kind not in {"double", "integer"}:
            msg = f"vary {name}: it is no number; vary one that is"
            raise ValueError(msg)
    try:
        values = _spaced(rule.split(":")) if ":" in rule else tuple(map(checks.read_number, rule.split(",")))
    except ValueError as error:
        msg = f"vary {text!r} must read {name}=FIRST:LAST:COUNT[:log] or {name}=VALUE,VALUE,...: {error}"
        raise ValueError(msg) from None
    return Axis(name, values)


def _spaced(parts: list[str]) -> tuple[float, ...]:
    logarithmic = parts[3:] == ["log"]
    if len(parts) != 3 and not logarithmic:  # noqa: PLR2004
        msg = "three numbers, and log or nothing"
        raise ValueError(msg)
    first, last = (
        checks.number(f"{end} value", checks.read_number(part))
        for end, part in zip(("first", "last"), parts, strict=False)
    )
    count = checks.whole_number("count", checks.read_number(parts[2]), 2, _LARGEST_SWEEP)
    if logarithmic and min(first, last) <= 0.0:
        msg = "a logarithmic range needs values above 0"
        raise ValueError(msg)
    spaced = np.geomspace(first, last, count) if logarithmic else np.linspace(first, last, count)
    return tuple(map(float, spaced))


def varied_plans(plan: SwimPlan, axes: list[Axis]) -> list[tuple[tuple[float | str, ...], SwimPlan]]:
    """Return the swims of a variation and their numbers, the first axis varying slowest; every plan is checked.

    Raises:
        ValueError: More than two axes, one twice, too many swims, or a value that is refused.
    """
    if len(axes) > 2 or len({axis.name for axis in axes}) < len(axes):  # noqa: PLR2004
        msg = f"vary {', '.join(axis.name for axis in axes)}: one or two different numbers can vary"
        raise ValueError(msg)
    checks.whole_number("number of swims", math.prod(len(axis.values) for axis in axes), 1, _LARGEST_SWEEP)
    result = []
    for numbers in product(*(axis.values for axis in axes)):
        changed = plan
        for axis, number in zip(axes, numbers, strict=True):
            changed = changed.changed(axis.name, number)
        changed.check()
        result.append((numbers, changed))
    return result


@dataclass(frozen=True)
class Figure:
    """One figure of a swim: its name and unit in CSV and JSON, and how tables show it.

    Attributes:
        name: The attribute of `Swim`.
        si: Its unit, empty for a number without.
        title: Its name in tables.
        unit: Its unit in tables.
        scale: What its value is multiplied with for tables.
    """

    name: str
    si: str
    title: str
    unit: str
    scale: float = 1.0

    def of(self, swim: Swim) -> float | None:
        """Return the figure, or None where this swim has none."""
        try:
            return cast("float", getattr(swim, self.name))
        except ValueError:  # too short for a steady figure, or the tip's force; the table shows a gap
            return None


FIGURES = (
    Figure("mean_speed", "m/s", "mean speed", "cm/s", 100.0),
    Figure("steady_speed", "m/s", "steady speed", "cm/s", 100.0),
    Figure("mean_thrust", "N", "mean thrust", "mN", 1000.0),
    Figure("mean_servo_power", "W", "servo power", "mW", 1000.0),
    Figure("mean_electrical_power", "W", "supply power", "mW", 1000.0),
    Figure("servo_amplitude", "rad", "servo amplitude", "degrees", 180.0 / math.pi),
    Figure("largest_servo_torque", "N m", "servo torque", "mN m", 1000.0),
    Figure("efficiency", "", "efficiency", "%", 100.0),
    Figure("strouhal_number", "", "Strouhal", ""),
    Figure("cost_of_transport", "J/(kg m)", "transport cost", "J/(kg m)"),
    Figure("tip_amplitude", "m", "tip amplitude", "cm", 100.0),
    Figure("largest_hinge_angle", "rad", "hinge angle", "degrees", 180.0 / math.pi),
    Figure("turning_rate", "rad/s", "turning rate", "rad/s"),
    Figure("turning_radius", "m", "turning radius", "m"),
)
VARIATION_TABLE = ("mean_speed", "steady_speed", "mean_thrust", "mean_servo_power", "efficiency", "strouhal_number")
"""What the table of a variation shows; its CSV has every figure."""
VARIATION_TABLE_OF_MOTORS = ("mean_electrical_power", *(name for name in VARIATION_TABLE if name != "mean_thrust"))
"""What it shows where servos have a motor: as much, so that 80 columns are enough."""


@dataclass(frozen=True)
class Swum:
    """What a variation keeps of a swim.

    Attributes:
        figures: Each of `FIGURES` by name; None where it is not defined, or the swim failed.
        warnings: What to know before they are believed.
        failure: Why the swim failed, or empty.
    """

    figures: Mapping[str, float | None]
    warnings: Sequence[str] = ()
    failure: str = ""


def swim_one(plan: SwimPlan) -> Swum:
    """Swim a plan and return its figures, or why there are none."""
    try:
        swum = plan.swim()
        validity.refuse_folded(swum.largest_hinge_angle)
        return Swum({figure.name: figure.of(swum) for figure in FIGURES}, tuple(swum.warnings))
    except (StepError, validity.FoldedError) as error:
        return Swum({figure.name: None for figure in FIGURES}, failure=str(error))


def cores_of_process() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@contextlib.contextmanager
def swimming_threads(cores: int | None) -> Iterator[ThreadPoolExecutor]:
    """Yield threads to swim in, one a core if None; what they have not begun at the end is not swum."""
    # The kernel runs beside other threads of Python; threads of the matrix exponential would only get in their way.
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(cores or cores_of_process(), "swim") as executor:
        try:
            yield executor
        finally:
            executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def swim_all(plans: Sequence[SwimPlan], cores: int | None = None) -> Iterator[Iterator[Swum]]:
    """Swim plans on all cores; yield their outcomes in order. What is not asked for any more is not swum.

    Args:
        plans: To swim.
        cores: Swims at a time; as many as this process may use if None.
    """
    with swimming_threads(cores) as executor:
        yield executor.map(swim_one, plans)
