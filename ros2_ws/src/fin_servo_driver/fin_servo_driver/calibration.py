"""What is measured of one servo by a person's commands, one a line; no port, thread or terminal is known here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from fin_servo_driver.robot_file import ServoJoint

_STEP = 5.0
_SMALLEST_ANGLE = math.radians(2.0)


class Leave(Exception):  # noqa: N818 - it is the way out, no error
    """The person wants to leave.

    Attributes:
        store: Whether what was measured is to be stored.
    """

    def __init__(self, *, store: bool) -> None:
        super().__init__()
        self.store = store


@dataclass
class Calibration:
    """A calibration under way.

    Attributes:
        joint: With what was measured so far.
        position: Where the servo is told to stand.
        lowest: Smallest position that the device can be asked for.
        highest: Largest.
        beyond: Where the person wants the servo, outside the joint's range, and has not said yes to it; else None.
    """

    joint: ServoJoint
    position: float
    lowest: float
    highest: float
    beyond: float | None = None

    def __post_init__(self) -> None:
        self._range = (self.joint.lowest, self.joint.highest)

    def obey(self, text: str) -> str:
        """Do what a line says; return what to show.

        Raises:
            ValueError: The line means nothing, or something that cannot be.
            Leave: The person wants to leave.
        """
        words = text.split()
        if not words:
            return self.summary()
        command, *rest = words
        wanted, self.beyond = self.beyond, None  # a "yes" counts for the question right before it
        value = _number(rest[0]) if rest else None
        match command:
            case "+" | "-":
                step = _STEP if value is None else value
                return self._move(self.position + (step if command == "+" else -step))
            case "=" if value is not None:
                return self._move(value)
            case "y" if wanted is not None:
                self.position = wanted
            case "c":
                self.joint = replace(self.joint, centre=self.position)
            case "a" if value is not None:
                self._stands_to_the_left_by(math.radians(value))
            case "l":
                self.joint = replace(self.joint, lowest=self.position)
            case "h":
                self.joint = replace(self.joint, highest=self.position)
            case "s" | "q":
                raise Leave(store=command == "s")
            case _:
                known = "+ N, - N, = N, c, a DEGREES, l, h, s or q; y only answers a question"
                msg = f"{text.strip()!r} is no command: {known}"
                raise ValueError(msg)
        return self.summary()

    def _move(self, position: float) -> str:
        """Move inside the range of the robot file and what was measured since; ask before one beyond it."""
        if not self.lowest <= position <= self.highest:
            msg = f"position {position:g} is outside the device's range [{self.lowest:g}, {self.highest:g}]"
            raise ValueError(msg)
        lowest, highest = min(self._range[0], self.joint.lowest), max(self._range[1], self.joint.highest)
        if not lowest <= position <= highest:
            self.beyond = position
            end = f"lowest = {lowest:g}" if position < lowest else f"highest = {highest:g}"
            return (
                f"{position:g} is beyond {end} of the robot file: does the mechanism stand it? y moves there; "
                f"anything else leaves it at {self.position:g}"
            )
        self.position = position
        return self.summary()

    def _stands_to_the_left_by(self, angle: float) -> None:
        change = self.position - self.joint.centre
        if abs(angle) < _SMALLEST_ANGLE or change == 0.0:
            msg = (
                f"an angle of {math.degrees(angle):g} degrees is too small to measure by: step on to 10 or more, then a"
            )
            raise ValueError(msg)
        direction = 1 if change * angle > 0.0 else -1
        self.joint = replace(self.joint, units_per_radian=abs(change / angle), direction=direction)

    def summary(self) -> str:
        """Return what is known so far, in a line."""
        joint = self.joint
        to_the_right = math.degrees(joint.angle_at(self.position))
        return (
            f"at {self.position:g}: centre {joint.centre:g}, {joint.units_per_radian:.1f} a rad, "
            f"direction {joint.direction}, range {joint.lowest:g} to {joint.highest:g}, "
            f"this is {abs(to_the_right):.1f} degrees to the {'right' if to_the_right > 0.0 else 'left'}"
        )


def _number(text: str) -> float:
    value = checks.read_number(text)
    if not math.isfinite(value):
        msg = f"{text} is no finite number"
        raise ValueError(msg)
    return value
