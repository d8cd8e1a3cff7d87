"""A tail pulled to either side by relays: which one is on when, and how long. Nothing here knows ROS or a port.

`GaitFollower.levels` says which side is wanted, to simulated relays too; what the relays stand decides whether it gets
it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.gait import JointLimits, require_rows
from fin_plant.gait_follower import GaitFollower

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_plant.gait import Gait
    from fin_servo_driver.robot_file import RelayJoint, RelayTiming
    from fin_servo_driver.set_points import Outputs

LEFT, OFF, RIGHT = -1, 0, 1
"""As `GaitFollower.levels` has them: a positive angle is to the right."""
HIGHEST_FREQUENCY = 5.0
"""Hz. Half a beat is then 100 ms: a dead time of 30 to 50 ms and the shortest on-time of 50 ms still fit in. What a
robot's relays need beyond that lowers it."""


class RelaySwitch:
    """The pair of relays of one joint: keeps dead time and on-times, never has both on, counts operations.

    Attributes:
        level: LEFT, OFF or RIGHT, as switched.
        operations: How often each side came on.
    """

    def __init__(self, timing: RelayTiming, period: float) -> None:
        """Start with both off.

        Args:
            timing: What the relays stand.
            period: s until the next step: a relay whose longest on-time would pass before it goes off now.
        """
        self.level = OFF
        self.operations = {LEFT: 0, RIGHT: 0}
        self._timing = timing
        self._period = period
        self._since = -math.inf
        self._last_side = OFF
        self._spent = OFF

    def step(self, wanted: int, now: float) -> int:
        """Return the level at ``now`` s for the level wanted."""
        if wanted != self._spent:
            self._spent = OFF
        on_for = now - self._since
        if self.level != OFF:
            too_long = on_for + self._period > self._timing.longest_on
            if too_long:
                self._spent = self.level
            if too_long or (wanted != self.level and on_for >= self._timing.shortest_on):
                self._switch(OFF, now)
            return self.level
        other_side = wanted != self._last_side
        rested = on_for >= self._timing.dead_time or not other_side
        if wanted not in {OFF, self._spent} and rested:
            self._switch(wanted, now)
            self.operations[wanted] += 1
            self._last_side = wanted
        return self.level

    def release(self, now: float) -> None:
        """Switch off at once, whatever the shortest on-time is: somebody stopped the tail."""
        if self.level != OFF:
            self._switch(OFF, now)

    def _switch(self, level: int, now: float) -> None:
        self.level = level
        self._since = now


class RelayMotion:
    """A tail of relays. A change of gait is ramped: the one beat's strokes get shorter while the other's get longer."""

    hold_time = fade_time = stop_time = 0.0
    at_neutral = True  # a relay that is switched off is at rest at once

    def __init__(self, joints: Sequence[RelayJoint], timing: RelayTiming, period: float) -> None:
        """Start with all relays off; ``period`` is the time in s between two looks."""
        self.angles = [0.0] * len(joints)
        self.limited = 0
        self.switches = [RelaySwitch(timing, period) for _ in joints]
        self._joints = tuple(joints)
        self._timing = timing
        self._strokes = np.array([joint.stroke for joint in joints])
        self._follower = GaitFollower(len(joints), 0.0)

    @property
    def joints(self) -> int:
        """Number of driven joints."""
        return len(self._joints)

    @property
    def limits(self) -> tuple[JointLimits, ...]:
        """What each driven joint can do, from the head to the tail."""
        return tuple(JointLimits(joint.stroke) for joint in self._joints)

    @property
    def operations(self) -> dict[int, int]:
        """How often the relay of each channel came on."""
        pairs = zip(self._joints, self.switches, strict=True)
        return {
            channel: switch.operations[side]
            for joint, switch in pairs
            for channel, side in ((joint.left, LEFT), (joint.right, RIGHT))
        }

    def is_still(self, now: float) -> bool:
        """Return whether the gait's end has faded at ``now`` s, and no relay is on."""
        return self._follower.is_still(now) and not any(self.angles)

    def allowed(self, gait: Gait, sweep: float, highest_frequency: float) -> Gait:
        """Return the gait inside the limits.

        Raises:
            ValueError: Another number of rows than joints, or a frequency that relays cannot follow.
        """
        require_rows(gait, self.joints)
        dead_time, shortest_on = self._timing.dead_time, self._timing.shortest_on
        highest, reason = HIGHEST_FREQUENCY, "dead time and shortest on-time fill half a beat"
        by_timing = 0.5 / (dead_time + shortest_on)
        if by_timing < highest:
            highest = by_timing
            needed = f"timing.dead_time = {dead_time:g} s and timing.shortest_on = {shortest_on:g} s"
            reason = f"half a beat must hold {needed}"
        for number, drive in enumerate(gait.joints, start=1):
            if drive.frequency > highest:
                msg = (
                    f"joint {number}: gait frequency = {drive.frequency:g} Hz is more than relays follow, at most "
                    f"{highest:g} Hz: {reason}"
                )
                raise ValueError(msg)
        return gait.limited(sweep, highest_frequency, self.limits)

    def restart(self, ramp_time: float, measured: Mapping[int, float]) -> None:
        """Begin anew with all relays off; nothing is measured on relays."""
        del measured
        self._follower = GaitFollower(len(self._joints), ramp_time)
        self.angles = [0.0] * len(self._joints)

    def command(self, gait: Gait, time: float) -> None:
        """Follow a gait from ``time`` s on."""
        self._follower.command(gait, time)

    def outputs(self, now: float, scale: float) -> Outputs:
        """Return on (1) or off (0) for each relay; a tail that is being stopped has all off."""
        wanted = self._follower.levels([now], self._strokes)[0]
        result: Outputs = {}
        for index, (joint, switch, level) in enumerate(zip(self._joints, self.switches, wanted, strict=True)):
            if scale < 1.0:
                switch.release(now)
            else:
                switch.step(int(level), now)
            self.angles[index] = switch.level * joint.stroke
            result[joint.left] = float(switch.level == LEFT)
            result[joint.right] = float(switch.level == RIGHT)
        return result

    def sent(self, at: float) -> None:
        """Take no note: no rate is to be kept."""

    def not_sent(self) -> None:
        """Take no note: what a relay was not sent is sent anew by the back end."""

    def stand_at(self, measured: Mapping[int, float]) -> None:
        """Take no note: nothing is measured on relays."""

    def neutral(self) -> Outputs:
        """Return all off."""
        return {channel: 0.0 for joint in self._joints for channel in joint.channels}

    def release(self, now: float) -> None:
        """Note that all relays were switched off at ``now`` s."""
        for switch in self.switches:
            switch.release(now)
        self.angles = [0.0] * len(self._joints)
