"""What a plant is doing, without any message: for state machines and reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Mapping


EMERGENCY = "the emergency stop is latched: release it with ~/estop false"
"""Why a plant is in FAULT after ``~/estop``."""
RELEASE = "release"
"""What it waits for then, in the detail ``waiting_for``."""
LIMITS = ("limits.sweep", "limits.frequency")
"""Details of every plant: largest angle of a driven joint in rad and highest frequency in Hz to which a gait is cut."""
SLOWEST_PACE = "slowest_pace"
"""Detail of a plant that need not keep the wall's time: s of its own that it swims at least in one of the wall's."""
STARTS_AT_REST = "starts_at_rest"
"""Detail of a plant whose reset leaves fish and water at rest: ``true``. Of any other, its velocity has to tell."""
PACE_OF_A_ROBOT = 0.5
"""A real fish keeps the wall's time; half of it leaves room for a tracker that stutters."""


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

    Raises:
        ValueError: One of `LIMITS` or `SLOWEST_PACE` is no number that it can be.
    """

    state: State
    plant: str
    stamp: int
    reason: str = ""
    fin: Mapping[str, str] = field(default_factory=dict)
    details: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in LIMITS:
            self._number(name, 0.0)
        checks.number(SLOWEST_PACE, self.slowest_pace, 0.0, exclusive_minimum=True)

    def _number(self, name: str, untold: float) -> float:
        """Return a detail that is a number of 0 or more.

        Raises:
            ValueError: It is none.
        """
        if name not in self.details:
            return untold
        try:
            value = checks.read_number(self.details[name])
        except ValueError as error:
            msg = f"{name} = {self.details[name]!r} must be a number: {error}"
            raise ValueError(msg) from error
        return checks.number(name, value, 0.0)

    @property
    def slowest_pace(self) -> float:
        """Seconds of its own time that the plant swims at least in a second of the wall's."""
        return self._number(SLOWEST_PACE, PACE_OF_A_ROBOT)

    @property
    def starts_at_rest(self) -> bool:
        """Whether a reset leaves fish and water at rest, so that nobody need wait for it."""
        return self.details.get(STARTS_AT_REST) == "true"

    @property
    def waits_for_people(self) -> bool:
        """Whether somebody must do something at the plant: mount a fin, or release an emergency stop."""
        waits = self.state in {State.WAITING_FOR_FIN, State.WAITING_FOR_RESET}
        return waits or bool(self.details.get("waiting_for"))
