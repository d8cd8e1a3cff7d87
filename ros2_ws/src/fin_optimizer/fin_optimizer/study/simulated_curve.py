"""The simulator's speed at any candidate of a study, computed without ROS, to draw behind its trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from fin_optimizer.goals import ENERGY_PER_METRE, MEAN_SPEED
from fin_optimizer.search.rules import gait_of
from fin_optimizer.search.space import Choice
from fin_optimizer.study.settings import earlier, sent_parameters
from fin_plant.fin import Fin

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.search.space import AnyDimension, Scalar
    from fin_optimizer.study.settings import Settings
    from fin_plant.gait import Gait
    from fin_plant.parameters import Value
    from fin_sim.swim_result import Swim

    SpeedCurve = tuple[Sequence[float], Sequence[float]]
    """Values of the parameter in SI units, and the speed in m/s at each."""

_OF_A_COMPUTED_FISH = {"body.length", "water.density", "sample_rate"}
_GAIT = {"gait.frequency", "gait.amplitude"}
POWER = "power"
TOLD = frozenset({MEAN_SPEED, POWER, ENERGY_PER_METRE})
"""Measures that many simulated swims at once tell as a trial does: means over the whole window."""
SETTLE, DURATION = "measurement.settle", "measurement.duration"


def can_be_computed(fish: Mapping[str, object]) -> bool:
    """Return whether a fish's parameters tell enough to compute its swims: a robot's driver knows no body, no water."""
    return fish.keys() >= _OF_A_COMPUTED_FISH


@dataclass(frozen=True)
class SimulatedFish:
    """The fish of a study, if the simulator can swim it.

    Attributes:
        settings: Of the study.
        parameters: The simulator's, which describe the fish.
    """

    settings: Settings
    parameters: Mapping[str, Value]

    @classmethod
    def of(cls, settings: Settings, fish: Mapping[str, object]) -> Self | None:
        """Return the fish that swam a study, None where it cannot be computed, or not in seconds: in a plane flow.

        Args:
            settings: Of the study; one of an older version may lack the gait.
            fish: What swam, as the journal has it.
        """
        told = settings.details.keys() | set(settings.space.names)  # a gait that is searched is no setting
        if not can_be_computed(fish) or not told >= {*_GAIT, SETTLE, DURATION}:
            return None
        known = {name: value for name, value in fish.items() if name != "plant"}
        parameters = cast("Mapping[str, Value]", {**earlier(), **known})
        from fin_sim.fish import Fish  # noqa: PLC0415  (Numba takes a second to load)

        try:
            simulated = Fish.from_parameters(parameters)
        except (LookupError, ValueError):  # a simulator of long ago, which had other parameters
            return None
        if simulated.water.model == "ideal_2d":  # a swim costs up to half a minute, a curve a hundred swims
            return None
        return cls(settings, parameters)

    @property
    def settle(self) -> float:
        """Time of a swim before what counts, s."""
        return cast("float", self.settings.details[SETTLE])

    @property
    def duration(self) -> float:
        """Time of a swim that counts, s."""
        return cast("float", self.settings.details[DURATION])

    def fin_and_gait(self, values: Mapping[str, Any]) -> tuple[Fin, Gait]:
        """Return what a plant is sent for a candidate.

        Raises:
            ValueError: The candidate cannot be; the message says why.
        """
        rules, start = self.settings.rules, sent_parameters(self.settings.details)
        if rules is not None and (why := rules.judge(start, values)):
            raise ValueError(why)
        sent = {**start, **self.settings.sent(values)}
        return Fin.from_parameters(sent), gait_of(sent)

    def swim(self, values: Mapping[str, Any]) -> Swim:
        """Swim a candidate as long as in a trial.

        Raises:
            ValueError: The candidate cannot be, or cannot swim; the message says why.
        """
        # Numba takes a second to load, which only the end of a study spends.
        from fin_sim.fish import Fish  # noqa: PLC0415
        from fin_sim.swim import swim  # noqa: PLC0415

        fin, gait = self.fin_and_gait(values)
        number = cast("Mapping[str, float]", self.parameters)
        sample_time = 1.0 / number["sample_rate"]
        return swim(
            fin=fin,
            fish=Fish.from_parameters(self.parameters),
            gait=gait.limited(number["limits.sweep"], number["limits.frequency"]),
            duration=self.settle + self.duration,
            reactive=self.parameters["reactive"],  # type: ignore[arg-type]
            ramp_time=number["drive.ramp_time"],
            step=sample_time,  # a step a sample is within 1e-6 of the simulator's speed, and four times as fast
            sample_time=sample_time,
        )

    def speed(self, values: Mapping[str, Any]) -> float:
        """Return the mean forward speed of a candidate in m/s as a trial scores it; NaN where it cannot be."""
        try:
            swum = self.swim(values)
        except (ArithmeticError, ValueError):
            return math.nan
        counted = swum.time >= self.settle
        return float(np.trapezoid(swum.surge[counted], swum.time[counted]) / self.duration)

    def speeds(self, some: Sequence[Mapping[str, Any]]) -> list[float]:
        """Return speeds as `speed`, to 1e-3 the same and many times as fast; raises as `told`."""
        return self.told(MEAN_SPEED, some)

    def told(self, measure: str, some: Sequence[Mapping[str, Any]]) -> list[float]:
        """Return a measure of `TOLD` of many candidates in SI, NaN of those that have none.

        Raises:
            ValueError: The fish has another number of driven joints than the gaits.
        """
        from fin_sim.batch import swim_batch  # noqa: PLC0415  (as above)
        from fin_sim.fish import Fish  # noqa: PLC0415

        number = cast("Mapping[str, float]", self.parameters)
        able: list[tuple[int, Fin, Gait]] = []
        for index, values in enumerate(some):
            try:
                fin, gait = self.fin_and_gait(values)
            except (ArithmeticError, ValueError):
                continue
            able.append((index, fin, gait.limited(number["limits.sweep"], number["limits.frequency"])))
        found = [math.nan] * len(some)
        if able:
            swum = swim_batch(
                [fin for _, fin, _ in able],
                Fish.from_parameters(self.parameters),
                np.array([gait.rows() for _, _, gait in able]),
                self.settle + self.duration,
                reactive=self.parameters["reactive"],  # type: ignore[arg-type]
                ramp_time=number["drive.ramp_time"],
                settle=self.settle,
            )
            speed, power = swum.mean_forward_speed, swum.servo_power
            with np.errstate(all="ignore"):
                values = {
                    MEAN_SPEED: speed,
                    POWER: power,
                    ENERGY_PER_METRE: np.where(speed > 0.0, power / speed, np.nan),
                }
            for (index, _, _), value in zip(able, values[measure].tolist(), strict=True):
                found[index] = value
        return found


def values_along(dimension: AnyDimension, points: int) -> list[Scalar]:
    """Return values of a parameter over its whole range, each once: choices all, a range's evenly as it is searched."""
    if isinstance(dimension, Choice):
        return list(dimension.choices)
    count = points if dimension.count is None else min(points, dimension.count)
    inset = 0.0 if dimension.count is None else 0.5 * (dimension.high - dimension.low) / dimension.count
    if dimension.log:
        inset = 0.0
    numbers = dimension.numbers(np.linspace(dimension.low + inset, dimension.high - inset, count))
    return list(dict.fromkeys(dimension.value(float(number)) for number in numbers))
