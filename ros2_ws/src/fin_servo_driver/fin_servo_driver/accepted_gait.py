"""What becomes of the gait that was accepted last, by what the I/O thread tells. Nothing here knows ROS or a clock."""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import TYPE_CHECKING

from fin_servo_driver.tail import Command, Phase

if TYPE_CHECKING:
    from fin_plant.gait import Gait
    from fin_servo_driver.health import Health

TAKE_SECONDS = 0.3
"""s. The I/O thread takes a command within a tick, unless it is held up; what is not taken so long is given up."""


class End(Enum):
    """How a tail that was commanded to swim came to swim no more."""

    STOPPED = auto()
    NOT_STARTED = auto()


class AcceptedGait:
    """The gait that was accepted last, from its first message until the tail is at rest.

    Attributes:
        since: s at which the gait was first received; minus infinity before the first.
    """

    def __init__(self) -> None:
        """Begin without one."""
        self.since = -math.inf
        self._command: Command | None = None
        self._was_followed = False

    @property
    def moves(self) -> bool:
        """Whether there is a gait, and it moves the tail."""
        return self._command is not None and self._command.gait.moves

    def command(self, gait: Gait, now: float) -> Command:
        """Take a gait that was received at ``now`` s; return the command for the I/O thread."""
        if self._command is None or not self._command.gait.same_as(gait):
            self.since = now
        self._command = Command(gait, now, self.since)
        return self._command

    def fell_silent(self, now: float, timeout: float | None) -> bool:
        """Return whether a gait that moves was not repeated in time before ``now`` s, whoever else has noticed.

        A driver that was stopped as a whole, Ctrl-Z for one, finds the next gait there before it finds that none came.
        """
        if self._command is None or not self.moves or timeout is None:
            return False
        return not now - self._command.time <= timeout

    def forget(self) -> None:
        """Note that the tail is at rest, or is being led to it."""
        self._command = None
        self._was_followed = False

    def stands(self, health: Health) -> bool:
        """Return whether the tail stands after the gait's end, held at neutral."""
        return self._command is not None and not self.moves and health.still and health.commanded >= self.since

    def ended(self, health: Health, now: float) -> End | None:
        """Return how the swim ended, None while it goes on, may still start, or was never asked for."""
        if self._command is None:
            return None
        is_followed = health.phase in {Phase.FOLLOWING, Phase.STOPPING}
        self._was_followed = self._was_followed or is_followed
        if is_followed or not (self._was_followed or now - self.since > TAKE_SECONDS):
            return None
        return End.STOPPED if self._was_followed else End.NOT_STARTED


def not_started(health: Health) -> str:
    """Return why the tail may not have started, as far as the I/O thread knows."""
    said = f"the tail did not start within {TAKE_SECONDS:g} s of its gait"
    if health.fault:
        return f"{said}: {health.fault}"
    return f"{said}: what speaks to the device was held up, by the device's answers or by a busy computer"
