"""The curve behind a study's trials is drawn for each fish whose swims can be computed, whatever it calls itself."""

from __future__ import annotations

import numpy as np
import pytest

from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study import pictures
from fin_optimizer.study.settings import Settings
from fin_plant.fin import FIN_PARAMETERS, Fin, node_table
from fin_plant.gait import carangiform
from fin_sim.fish import Fish
from fin_sim.swim import swim

RANGE = Dimension("fin.young_modulus", 0.5e9, 4e9, "Pa")
FIN = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()}
GAIT = {"gait.frequency": 0.9, "gait.amplitude": 0.2}
WINDOW = {"measurement.settle": 0.0, "measurement.duration": 1.0}
SETTINGS = Settings(Space((RANGE,)), details={**FIN, **GAIT, **WINDOW})


def deciding(package: str, node: str, plant: str) -> dict[str, object]:
    """Return what the journal keeps of a fish."""
    table = node_table(package, node)
    return {"plant": plant, **{name: table[name].default for name in table.deciding_swims - FIN_PARAMETERS.keys()}}


SIMULATED = deciding("fin_sim", "simulator", "simulator")


@pytest.mark.parametrize("plant", ["simulator", "a fish with a name of its own"])
def test_a_computed_fish_has_its_curve(plant: str) -> None:
    curve = pictures._simulated(SETTINGS, {**SIMULATED, "plant": plant})
    assert curve is not None
    values, speeds = curve
    softest = swim(
        Fin.from_parameters({**FIN, RANGE.name: values[0]}),
        Fish.from_parameters(SIMULATED),
        carangiform(0.2, 0.9),
        duration=1.0,
        reactive=SIMULATED["reactive"],  # type: ignore[arg-type]  # one of its choices
        ramp_time=SIMULATED["drive.ramp_time"],  # type: ignore[arg-type]  # a number
    )
    assert speeds[0] == pytest.approx(float(np.trapezoid(softest.surge, softest.time)) / 1.0, rel=0.01)


@pytest.mark.parametrize(
    "fish",
    [
        {},
        deciding("fin_servo_driver", "servo_driver", "robot"),
        deciding("fin_servo_driver", "servo_driver", "simulator"),
        {name: value for name, value in SIMULATED.items() if name != "body.yaw_drag"},
    ],
    ids=["unknown", "robot", "a robot that calls itself a simulator", "an older simulator"],
)
def test_a_fish_of_which_too_little_is_known_has_none(fish: dict[str, object]) -> None:
    assert pictures._simulated(SETTINGS, fish) is None
