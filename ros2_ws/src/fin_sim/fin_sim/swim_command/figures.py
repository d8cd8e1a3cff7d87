"""The figures of a swim: their names and units, in files and in tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from fin_sim.swim_result import Swim


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
