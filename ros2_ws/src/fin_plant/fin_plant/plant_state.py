"""What a plant is doing, without any message: for state machines and reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


EMERGENCY = "the emergency stop is latched: release it with ~/estop false"
"""Why a plant is in FAULT after ``~/estop``."""
RELEASE = "release"
"""What it waits for then, in the detail ``waiting_for``."""
LIMITS = ("limits.sweep", "limits.frequency")
"""Details of every plant: largest angle of a driven joint in rad and highest frequency in Hz to which a gait is cut."""


class State(StrEnum):
    """What a plant is doing."""

    READY = "READY"
    WAITING_FOR_FIN = "WAITING_FOR_FIN"
    WAITING_FOR_RESET = "WAITING_FOR_RESET"
    SWIMMING = "SWIMMING"
    FAULT = "FAULT"


@dataclass(frozen=True)
class PlantState:
    """State of a plant as published on ``plant_state``.

    Attributes:
        state: What it is doing.
        plant: What kind of plant, for example ``simulator``.
        stamp: Time of the plant in ns at which the state began. A reset or another fin begins the state anew.
        reason: Why, for FAULT and the waiting states.
        fin: The fin mounted, as parameters by name.
        details: Further facts, by name; ``waiting_for`` is what somebody must do at the plant.
    """

    state: State
    plant: str
    stamp: int
    reason: str = ""
    fin: Mapping[str, str] = field(default_factory=dict)
    details: Mapping[str, str] = field(default_factory=dict)

    @property
    def waits_for_people(self) -> bool:
        """Whether somebody must do something at the plant: mount a fin, or release an emergency stop."""
        waits = self.state in {State.WAITING_FOR_FIN, State.WAITING_FOR_RESET}
        return waits or bool(self.details.get("waiting_for"))
