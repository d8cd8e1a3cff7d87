"""What a plant is doing, without any message: for state machines and reports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from fin_plant import checks, json_file
from fin_plant.gait import MAXIMUM_JOINTS, JointLimits

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


EMERGENCY = "the emergency stop is latched: release it with ~/estop false"
"""Why a plant is in FAULT after ``~/estop``."""
RELEASE = "release"
"""What it waits for then, in the detail ``waiting_for``."""
LIMITS = ("limits.sweep", "limits.frequency")
"""Details of every plant: largest angle of a driven joint in rad and highest frequency in Hz to which a gait is cut."""
DRIVEN_JOINTS = "driven_joints"
"""Detail of a plant that knows its tail: number of driven joints, each of which a gait needs a row for."""
JOINT_SWEEPS, JOINT_RATES = "joints.sweep", "joints.rate"
"""Details of a robot: what each driven joint can do by itself, lists in rad and rad/s from the head to the tail."""
SLOWEST_PACE = "slowest_pace"
"""Detail of a plant that need not keep the wall's time: s of its own that it swims at least in one of the wall's."""
STARTS_AT_REST = "starts_at_rest"
"""Detail of a plant whose reset leaves fish and water at rest: ``true``. Of any other, its velocity has to tell."""
TELLS = "tells"
"""Detail of a plant that says which of `SERVO_TORQUE` and `THRUST` its streams tell, commas between. Of any other, its
messages have to show it."""
SERVO_TORQUE, THRUST = "torque in joint_states", "thrust"
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
        ValueError: One of `LIMITS`, `SLOWEST_PACE` or of what is said of the joints is no number that it can be.
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
        if DRIVEN_JOINTS in self.details:
            checks.whole_number(DRIVEN_JOINTS, self.driven_joints, 1, MAXIMUM_JOINTS)
        for name in (JOINT_SWEEPS, JOINT_RATES):
            if name in self.details and len(self._numbers(name)) != self.driven_joints:
                msg = f"{name} = {self.details[name]} needs a value for each of {DRIVEN_JOINTS} = {self.driven_joints}"
                raise ValueError(msg)
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

    def _numbers(self, name: str) -> list[float]:
        """Return a detail that is a list of numbers of 0 or more; empty where it is not told.

        Raises:
            ValueError: It is none.
        """
        try:
            told = json_file.parse(self.details.get(name, "[]"))
            return [checks.number(name, value, 0.0) for value in told]  # type: ignore[attr-defined]
        except (TypeError, ValueError) as error:
            msg = f"{name} = {self.details[name]!r} must be a list of numbers: {error}"
            raise ValueError(msg) from error

    @property
    def driven_joints(self) -> int:
        """Number of driven joints; 0 where the plant does not tell it."""
        number = self._number(DRIVEN_JOINTS, 0.0)
        return checks.whole_number(DRIVEN_JOINTS, int(number) if number.is_integer() else number)

    @property
    def joint_limits(self) -> tuple[JointLimits, ...]:
        """What each driven joint can do by itself; empty where the plant does not tell it."""
        sweeps, rates = self._numbers(JOINT_SWEEPS), self._numbers(JOINT_RATES)
        if not rates:
            return tuple(map(JointLimits, sweeps))
        return tuple(JointLimits(*each) for each in zip(sweeps, rates, strict=True))

    @property
    def slowest_pace(self) -> float:
        """Seconds of its own time that the plant swims at least in a second of the wall's."""
        return self._number(SLOWEST_PACE, PACE_OF_A_ROBOT)

    @property
    def starts_at_rest(self) -> bool:
        """Whether a reset leaves fish and water at rest, so that nobody need wait for it."""
        return self.details.get(STARTS_AT_REST) == "true"

    @property
    def tells(self) -> frozenset[str] | None:
        """What its streams tell beside the velocity, of `SERVO_TORQUE` and `THRUST`; None where it does not say so."""
        said = self.details.get(TELLS)
        return None if said is None else frozenset(word.strip() for word in said.split(",") if word.strip())

    @property
    def waits_for_people(self) -> bool:
        """Whether somebody must do something at the plant: mount a fin, or release an emergency stop."""
        waits = self.state in {State.WAITING_FOR_FIN, State.WAITING_FOR_RESET}
        return waits or bool(self.details.get("waiting_for"))


def joint_details(limits: Sequence[JointLimits]) -> dict[str, str]:
    """Return what `PlantState.driven_joints` and `PlantState.joint_limits` are read from, as details of a plant."""
    details = {DRIVEN_JOINTS: str(len(limits)), JOINT_SWEEPS: repr([each.sweep for each in limits])}
    rates = [each.rate for each in limits]
    return details if math.inf in rates else {**details, JOINT_RATES: repr(rates)}
