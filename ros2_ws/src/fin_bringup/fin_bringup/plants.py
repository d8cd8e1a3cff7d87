"""Which nodes make which plant, and which of their parameters are a study's arguments."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fin_optimizer.parameters import SIMULATOR
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS, node_table
from fin_plant.parameters import ParameterTable, load_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.parameters import Value


def _without_fin(table: ParameterTable) -> ParameterTable:
    """Return a plant's parameters, the fin excepted: that is the optimiser's to choose."""
    return ParameterTable({name: entry for name, entry in table.items() if name not in FIN_PARAMETERS})


PLANT_LIMITS = _without_fin(PLANT_PARAMETERS)
SIMULATOR_PARAMETERS = _without_fin(node_table("fin_sim", SIMULATOR))


@dataclass(frozen=True)
class PlantNode:
    """A node of a plant, the parameters of it that are a study's arguments, and those that the kind of plant fixes."""

    package: str
    name: str
    table: ParameterTable
    fixed: Mapping[str, Value] = field(default_factory=dict)


_DRIVER_PARAMETERS = load_table("fin_servo_driver", "servo_driver_parameters.yaml")
# What the driver takes on the robot alone: the rehearsal's operator tells it the port of the emulated device.
_ROBOT_ONLY = ("robot_file", "port", "watchdog.disabled_knowingly")
_ROBOT = ParameterTable({**{n: _DRIVER_PARAMETERS[n] for n in _ROBOT_ONLY}, **PLANT_LIMITS})
_ESTIMATOR = PlantNode(
    "fin_servo_driver", "velocity_estimator", load_table("fin_servo_driver", "velocity_estimator_parameters.yaml")
)
PLANTS = {
    "sim": (PlantNode("fin_sim", SIMULATOR, SIMULATOR_PARAMETERS),),
    "robot": (PlantNode("fin_servo_driver", "servo_driver", _ROBOT), _ESTIMATOR),
    # The emulated device comes first and so ends last: the driver's neutral must still find it.
    "rehearsal": (
        PlantNode("fin_servo_driver", "rehearsal", node_table("fin_servo_driver", "rehearsal")),
        PlantNode("fin_servo_driver", "servo_driver", PLANT_LIMITS, {"plant": "rehearsal"}),
        _ESTIMATOR,
    ),
}


def plant_named(plant: str) -> tuple[PlantNode, ...]:
    """Return the nodes of a kind of plant, in the order of their start.

    Raises:
        ValueError: No such kind.
    """
    if plant not in PLANTS:
        msg = f"plant:={plant} is not known: use plant:={' or plant:='.join(PLANTS)}"
        raise ValueError(msg)
    return PLANTS[plant]
