"""The simulator's speed over a parameter, computed without ROS, to draw behind the trials of a study."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fin_optimizer.score.mean_speed import Measurement
    from fin_optimizer.search.space import Dimension
    from fin_plant.fin import Fin
    from fin_plant.gait import Gait
    from fin_plant.parameters import Value

    SpeedCurve = tuple[Sequence[float], Sequence[float]]
    """Values of the parameter in SI units, and the speed in m/s at each."""

_POINTS = 71
_OF_A_COMPUTED_FISH = {"body.length", "water.density", "sample_rate"}


def can_be_computed(fish: Mapping[str, object]) -> bool:
    """Return whether a fish's parameters tell enough to compute its swims: a robot's driver knows no body, no water."""
    return fish.keys() >= _OF_A_COMPUTED_FISH


def simulated_speed(
    name: str, fin: Fin, gait: Gait, measurement: Measurement, simulator: Mapping[str, Value]
) -> Callable[[float], float]:
    """Return the mean forward speed in m/s as a function of one parameter of the fin.

    Args:
        name: The parameter, for example ``fin.young_modulus``.
        fin: All other parameters of the fin.
        gait: What the fish swims.
        measurement: Which part of the swim counts.
        simulator: The simulator's parameters, which describe its fish.
    """
    # Numba takes a second to load, which only the end of a study spends.
    from fin_sim.fish import Fish  # noqa: PLC0415
    from fin_sim.swim import swim  # noqa: PLC0415

    fish = Fish.from_parameters(simulator)
    number = cast("Mapping[str, float]", simulator)
    limited = gait.limited(number["limits.sweep"], number["limits.frequency"])
    sample_time = 1.0 / number["sample_rate"]
    field = name.removeprefix("fin.")

    def speed(value: float) -> float:
        varied: Any = {field: value}
        result = swim(
            fin=replace(fin, **varied),
            fish=fish,
            gait=limited,
            duration=measurement.settle + measurement.duration,
            reactive=simulator["reactive"],  # type: ignore[arg-type]
            ramp_time=number["drive.ramp_time"],
            step=sample_time,  # a step a sample is within 1e-6 of the simulator's speed, and four times as fast
            sample_time=sample_time,
        )
        counted = result.time >= measurement.settle
        return float(np.trapezoid(result.surge[counted], result.time[counted]) / measurement.duration)

    return speed


def speed_over_range(dimension: Dimension, speed: Callable[[float], float], points: int = _POINTS) -> SpeedCurve:
    """Return the curve of ``speed`` (SI to m/s) over the whole range of a parameter."""
    values = np.linspace(dimension.minimum, dimension.maximum, points)
    return [float(value) for value in values], [speed(float(value)) for value in values]
