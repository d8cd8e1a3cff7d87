"""What the tail does from tick to tick: silent until armed, moving while commanded, neutral and then silent otherwise.

Every way to rest goes to neutral within the joints' rates, from where the tail stands, or moves nothing at all.

Nothing here knows ROS, a port or a clock; the I/O thread hands in the time and sends what comes out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.gait_follower import smooth_step
from fin_servo_driver.safety import CommandWatchdog

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.gait import Gait
    from fin_servo_driver.set_points import Motion, Outputs


LONGEST_STOP = 10.0
"""s. A tail that cannot be led to neutral within it loses its force where it stands."""


class Phase(StrEnum):
    """What the tail is doing."""

    DISARMED = "disarmed"
    SILENT = "armed, no pulses"
    FOLLOWING = "following the gait"
    STOPPING = "returning to neutral"


@dataclass(frozen=True)
class Command:
    """A gait that was accepted.

    Attributes:
        gait: Inside all limits.
        time: s of the monotonic clock at which it was received; it is fresh from then on.
        since: s at which the gait was first received, where this command repeats it: the gait's phase counts from then,
            also where the repetition took the first one's place before anybody saw it. None if this is the first.
    """

    gait: Gait
    time: float
    since: float | None = None


@dataclass(frozen=True)
class Settings:
    """What may change while the driver runs.

    Attributes:
        command_timeout: s without a command after which the tail stops; None never, for somebody who knows why.
        ramp_time: s in which a gait starts, stops or changes.
    """

    command_timeout: float | None
    ramp_time: float


class Tail:
    """The tail's state machine.

    Attributes:
        phase: What the tail is doing.
        timeouts: How often the commander fell silent.
    """

    def __init__(self, motion: Motion, settings: Settings) -> None:
        """Start disarmed."""
        self.phase = Phase.DISARMED
        self.settings = settings
        self.timeouts = 0
        self._motion = motion
        self._watchdog = CommandWatchdog()
        self._stop_begin = self._fade = 0.0
        self._neutral_since = math.inf
        self._disarm_next = False
        self._not_before = -float("inf")

    def arm(self, now: float) -> None:
        """Allow motion from the next command on."""
        if self.phase is Phase.DISARMED:
            self._watchdog.forget()
            self._motion.release(now)
            self._disarm_next = False
            self.phase = Phase.SILENT

    def disarm(self, now: float) -> None:
        """Lead the tail to neutral, then allow no motion."""
        self.stop(now)
        if self.phase is Phase.STOPPING:
            self._disarm_next = True
        else:
            self.phase = Phase.DISARMED

    def stop(self, now: float) -> None:
        """Lead the tail to neutral from where it stands, then fall silent; at once if that would take too long."""
        self._watchdog.forget()
        if self.phase is not Phase.FOLLOWING:
            return
        if self._motion.stop_time > LONGEST_STOP:
            self.cut(now)
            return
        self.phase = Phase.STOPPING
        self._stop_begin, self._fade, self._neutral_since = now, self._motion.fade_time, math.inf

    def refuse_before(self, time: float) -> None:
        """Let commands count no more that were received before ``time`` s: somebody has asked for something since."""
        self._not_before = max(self._not_before, time)

    def cut(self, now: float) -> None:
        """Fall silent at once; commands received before ``now`` count no more."""
        self._watchdog.forget()
        self._motion.release(now)
        self.refuse_before(now)
        if self.phase is not Phase.DISARMED:
            self.phase = Phase.DISARMED if self._disarm_next else Phase.SILENT
        self._disarm_next = False

    def accepts(self, command: Command) -> bool:
        """Whether the command would be followed: armed, not stopping, and received after the last cut or request."""
        return self.phase in {Phase.SILENT, Phase.FOLLOWING} and command.time >= self._not_before

    def command(self, command: Command, measured: Mapping[int, float]) -> bool:
        """Follow a command if it is acceptable; a start from silence begins at neutral or at the measured positions."""
        if not self.accepts(command):
            return False
        if self.phase is Phase.SILENT:
            self._motion.restart(self.settings.ramp_time, measured)
            self.phase = Phase.FOLLOWING
            self._neutral_since = math.inf
        self._watchdog.feed(command.time)
        since = command.since
        if since is None or since < self._not_before:
            since = command.time
        self._motion.command(command.gait, since)
        return True

    def is_still(self, now: float) -> bool:
        """Return whether the tail stands at ``now`` s, held at neutral or silent, and no command moves it."""
        if self.phase is Phase.FOLLOWING:
            return self._motion.is_still(now) and now - self._neutral_since >= self._motion.hold_time
        return self.phase is not Phase.STOPPING

    def tick(self, now: float) -> Outputs | None:
        """Return what to send at ``now`` s, or None while nothing may be sent."""
        if self.phase is Phase.FOLLOWING and self._watchdog.expired(now, self.settings.command_timeout):
            self.timeouts += 1
            self.stop(now)
        if self.phase is Phase.STOPPING:
            return self._stopping(now)
        if self.phase is Phase.FOLLOWING:
            outputs = self._motion.outputs(now, 1.0)
            self._neutral_since = min(self._neutral_since, now) if self._motion.is_still(now) else math.inf
            return outputs
        return None

    def _stopping(self, now: float) -> Outputs | None:
        elapsed = max(now - self._stop_begin, 0.0)  # it may have been asked after the tick had looked at the clock
        has_faded = not elapsed < self._fade
        if has_faded and self._motion.at_neutral:
            self._neutral_since = min(self._neutral_since, now)
        # Only what was sent counts as neutral: a joint that has not got there in time is left where it stands.
        if not now - self._neutral_since < self._motion.hold_time or not elapsed < LONGEST_STOP:
            self.cut(now)
            return None
        scale = 0.0 if has_faded else 1.0 - float(smooth_step(np.array(elapsed / self._fade))[0])
        # Never quite 1, so that a tail of relays knows that it is being stopped.
        return self._motion.outputs(now, min(scale, 0.999))
