"""What every back end offers, and the checks that they share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

from fin_plant import checks
from fin_servo_driver.line import LineLostError, LineStalledError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Outputs


BITS_A_BYTE = 10
"""On the line, with a start bit and a stop bit."""
FRAMES_WAITING = 2
"""Frames of a relay that may wait on the line when one switches on."""


ONLY_AN_ECHO = "only an echo of what was sent came back: the adapter hears itself, and no device on its wires answers"
HEARS_ITSELF = (
    "what is sent comes back before its answer: the adapter hears itself, which is supported on RS-485 only "
    "(dynamixel, modbus); use separate wires for both directions"
)


@dataclass(frozen=True)
class Feedback:
    """What a device reported.

    Attributes:
        positions: Measured position of each channel, in the device's unit; empty where the device measures none.
        voltage: V.
        temperature: Of the hottest servo, degrees Celsius.
        fault: What the device complains about.
        positions_asked: Whether positions were asked for; a slow line has no time for all questions in one tick.
    """

    positions: Mapping[int, float] = field(default_factory=dict)
    voltage: float | None = None
    temperature: float | None = None
    fault: str = ""
    positions_asked: bool = True


NOTHING = Feedback()


class LifeSign:
    """Notices that a device has fallen silent which answers when it is asked.

    Attributes:
        every: s between two questions.
        patience: s without an answer after which the device counts as lost.
    """

    def __init__(self, every: float, patience: float, clock: Clock) -> None:
        self._clock = clock
        self.every = every
        self.patience = patience
        self._heard = self._asked = self._clock.monotonic()

    def heard(self) -> None:
        """Note an answer."""
        self._heard = self._clock.monotonic()

    def due(self) -> bool:
        """Whether to ask now.

        Raises:
            LineLostError: Nothing was heard for too long.
        """
        now = self._clock.monotonic()
        if now - self._heard > self.patience:
            msg = f"the device has fallen silent: no answer for {self.patience:g} s; has it power?"
            raise LineLostError(msg)
        if now - self._asked < self.every:
            return False
        self._asked = now
        return True


class Backend(ABC):
    """A kind of device.

    The order of calls is: `identify`, `disable`; then any number of times `enable`, `send`..., `disable`; `read` at any
    time. The first `disable` ends what an earlier driver has left behind.
    Every method may raise a DeviceError of `line`. A stop that is asked for raises StopAskedError out of whatever
    method is at work, between two frames or while it waits for an answer. It must pass: no method catches it, writes
    anything on the way out, or waits other than in `line.read`. `disable` follows, whatever was left half done.
    """

    drives: ClassVar[Literal["servos", "relays"]]
    unit: ClassVar[str]
    """Of positions."""
    channels: ClassVar[range]
    lowest: ClassVar[float] = 0.0
    highest: ClassVar[float] = 1.0
    rate: float
    """Set-points a second: what the line carries; the device or its servos gain nothing from more."""
    baud: ClassVar[int]
    """Bits a second that the device has when bought."""
    options: ClassVar[tuple[str, ...]] = ()
    measures: ClassVar[bool] = False
    """Whether `read` tells where the servos stand."""
    takes_cut_frames: ClassVar[bool] = False
    """Whether `disable` works right behind a frame that ends anywhere, and such a frame does no harm: what waits in the
    port's buffer is then taken back before a stop."""
    confirms: ClassVar[bool] = False
    """Whether `disable` returns only once the device has answered that it took it."""

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints, and what this back end takes for the time.

        Raises:
            ValueError: Joints, channels, ranges or options that the device cannot have.
        """
        self.robot = robot
        self._clock = clock
        self.can_be_disabled_unseen = True  # before `identify`, where it is known to be on this port
        kind = "servos" if robot.servos else "relays"
        if kind != self.drives:
            msg = f"device {robot.device} drives {self.drives}, and joints describes {kind}"
            raise ValueError(msg)
        for number, joint in enumerate(robot.joints, start=1):
            for channel in joint.channels:
                self._check_channel(number, channel)
        for number, joint in enumerate(robot.servos, start=1):
            for name in ("lowest", "highest"):
                value = getattr(joint, name)
                checks.number(f"joint {number}: {name}", value, self.lowest, self.highest, unit=self.unit)
        unknown = [name for name in robot.options if name not in self.options]
        if unknown:
            known = ", ".join(self.options) or "none"
            msg = f"options has unknown {', '.join(unknown)}: {robot.device} knows {known}"
            raise ValueError(msg)

    def _check_channel(self, number: int, channel: int) -> None:
        if channel not in self.channels:
            first, last = self.channels[0], self.channels[-1]
            msg = f"joint {number}: channel {channel} is not one of {self.robot.device}'s, {first} to {last}"
            raise ValueError(msg)

    @abstractmethod
    def identify(self, line: Line) -> str:
        """Make sure that the device is there, and return what it says of itself.

        Raises:
            WrongDeviceError: Something else answers, or nothing.
        """

    @abstractmethod
    def enable(self, line: Line, neutral: Outputs) -> None:
        """Make the servos hold ``neutral`` from now on."""

    @abstractmethod
    def send(self, line: Line, outputs: Outputs) -> None:
        """Send a position to each channel."""

    @abstractmethod
    def disable(self, line: Line) -> None:
        """Take force from the servos, or switch the relays off; must work whatever was done before.

        This is the emergency stop too: nothing in it moves a servo, and the first frames take the force from all of
        them; only then is waited for answers, or asked whether they did.
        """

    def read(self, line: Line) -> Feedback:
        """Return what the device has reported since the last call; wait for an answer within the tick at most."""
        line.read(0.0)
        return NOTHING


class RelayBackend(Backend):
    """A board of relays: on and off for one channel at a time, sent on change.

    Dead time and shortest on-time are kept at the board: a frame counts from when it is sure to have got there until
    the next one is sent, not from when it was decided on.
    """

    drives = "relays"
    unit = "on"
    rate = 100.0
    frame_bytes: ClassVar[int]
    """Of a frame that switches one relay."""

    def __init__(self, robot: Robot, clock: Clock) -> None:
        """Take the robot's joints."""
        super().__init__(robot, clock)
        self._on: Outputs = {}
        self._on_since: dict[int, float] = {}
        self._off_since: dict[int, float] = {}
        self._line_free_at = 0.0
        self._partner = {a: b for joint in robot.relays for a, b in (joint.channels, joint.channels[::-1])}

    def enable(self, line: Line, neutral: Outputs) -> None:
        """Switch all relays off: that is the neutral of a relay tail."""
        del neutral
        self.disable(line)

    def send(self, line: Line, outputs: Outputs) -> None:
        """Switch what has changed: first off, then on.

        A relay goes off only when it was on for its shortest time, and comes on only a dead time after its partner's
        "off" and while few frames wait on the line: those of a stop would wait behind them. What has to wait is tried
        again at the next call.
        """
        changed = {channel: value for channel, value in outputs.items() if self._on.get(channel) != value}
        ends = [channel for channel, value in changed.items() if value <= 0.0 and self._was_on_long_enough(channel)]
        self._switch_off(line, ends)
        for channel, value in changed.items():
            if value > 0.0 and self._partner_rests(channel) and not self._line_is_full():
                self._on.pop(channel, None)  # not known until the frame is out
                self.switch(line, channel, on=True)
                self._on[channel] = value
                self._on_since[channel] = self._arrived_by()

    def _was_on_long_enough(self, channel: int) -> bool:
        on_for = self._clock.monotonic() - self._on_since.get(channel, -math.inf)
        return self._on.get(channel) is None or on_for >= self.robot.timing.shortest_on

    def _arrived_by(self) -> float:
        """Return when the frame that was written just now has reached the board at the latest, s of monotonic time.

        The bytes written before it go first; a port takes them all at once.
        """
        seconds = self.frame_bytes * BITS_A_BYTE / (self.robot.baud or self.baud)
        self._line_free_at = max(self._line_free_at, self._clock.monotonic()) + seconds
        return self._line_free_at

    def _line_is_full(self) -> bool:
        seconds = FRAMES_WAITING * self.frame_bytes * BITS_A_BYTE / (self.robot.baud or self.baud)
        return self._line_free_at - self._clock.monotonic() > seconds

    def _partner_rests(self, channel: int) -> bool:
        partner = self._partner[channel]
        rested = self._clock.monotonic() - self._off_since.get(partner, math.inf)
        return self._on.get(partner) == 0.0 and rested >= self.robot.timing.dead_time

    def disable(self, line: Line) -> None:
        """Switch all relays of the joints off, also those that are thought to be off, and even if one fails.

        Those that may be on come first: on a slow line each frame takes some milliseconds.

        Raises:
            LineStalledError: Not all did.
        """
        channels = [channel for joint in self.robot.relays for channel in joint.channels]
        self._switch_off(line, sorted(channels, key=lambda channel: self._on.get(channel) == 0.0))

    def _switch_off(self, line: Line, channels: Iterable[int]) -> None:
        failures = []
        for channel in channels:
            was_off = self._on.pop(channel, None) == 0.0
            try:
                self.switch(line, channel, on=False)
            except LineStalledError as error:
                failures.append(str(error))
                continue
            self._on[channel] = 0.0
            arrived = self._arrived_by()
            if not was_off:
                self._off_since[channel] = arrived
        if failures:
            raise LineStalledError("; ".join(failures))

    @abstractmethod
    def switch(self, line: Line, channel: int, *, on: bool) -> None:
        """Switch one relay."""
