"""Leads a servo slowly to where its calibration wants it, and holds it there."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import TYPE_CHECKING

from fin_servo_driver.line import DeviceError, LineStalledError, Stop, StopAskedError, StoppableLine
from fin_servo_driver.safety import within_rate

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.calibration import Calibration
    from fin_servo_driver.clock import Clock
    from fin_servo_driver.robot_file import Robot, ServoJoint
    from fin_servo_driver.set_points import Outputs

UNITS_A_SECOND = 300.0
"""How fast a horn is led to a new place at most; half a turn of a hobby servo takes some seconds."""
_PERIODS_AT_MOST = 2.0
"""Periods that count for the rate: a program that was held up does not make good in one jump what it has missed."""
_MEASURE_SECONDS = 1.0


class Ramp:
    """Leads each channel to where it is wanted at its own rate, between frames as they are sent."""

    def __init__(self, rates: Mapping[int, float], longest_elapsed: float) -> None:
        """Take the rates in units of the device a second; not more than ``longest_elapsed`` s count for a step."""
        self.positions: Outputs = {}
        self._rates = rates
        self._longest_elapsed = longest_elapsed
        self._sent_at = math.inf

    def restart(self, positions: Mapping[int, float], at: float) -> None:
        """Begin where the servos stand by ``at`` s."""
        self.positions = dict(positions)
        self._sent_at = at

    def step(self, wanted: Mapping[int, float], now: float) -> Outputs:
        """Return what to send at ``now`` s or later; then say when it was out by `sent`."""
        elapsed = now - self._sent_at
        self.positions = {
            channel: within_rate(wanted[channel], last, self._rates[channel], elapsed, self._longest_elapsed)
            for channel, last in self.positions.items()
        }
        return self.positions

    def sent(self, at: float) -> None:
        """Note that the last step was out by ``at`` s."""
        self._sent_at = at


def slow_rate(joint: ServoJoint) -> float:
    """Return how fast a servo is led while it is calibrated, in units of the device a second."""
    return min(UNITS_A_SECOND, joint.rate * joint.units_per_radian)


class Holder:
    """Leads the servo to where the calibration wants it, and holds it, in a thread of its own."""

    def __init__(
        self,
        backend: Backend,
        line: StoppableLine,
        robot: Robot,
        calibration: Calibration,
        stop: Stop,
        report: Callable[[str], None],
        clock: Clock = time,
    ) -> None:
        """Take what to hold, and the stop of the line; nothing is sent before `start`.

        Args:
            backend: The device.
            line: To it.
            robot: Its joints.
            calibration: Says where one of them is wanted.
            stop: Of the line.
            report: Takes a text for the person.
            clock: What counts as the time.
        """
        self.failure = ""
        self._backend = backend
        self._line = line
        self._stop = stop
        self._report = report
        self._clock = clock
        self._calibration = calibration
        self._joints = robot.servos
        self._centres = {joint.channel: joint.centre for joint in robot.servos}
        self._period = 1.0 / backend.rate
        rates = {joint.channel: slow_rate(joint) for joint in robot.servos}
        self._ramp = Ramp(rates, _PERIODS_AT_MOST * self._period)
        self._stands: Outputs = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._hold, name="hold the servo")

    def warning(self) -> str:
        """Return what to say before the servos get force."""
        if self._backend.measures:
            return "the servos get force now, and are led slowly from where they stand to their centres"
        places = ", ".join(f"joint {n} to {joint.centre:g}" for n, joint in enumerate(self._joints, start=1))
        return (
            f"HANDS OFF: the servos get force now and JUMP to their centres, {places} {self._backend.unit}, as fast as "
            "they can: nothing tells where such a servo stands. Ctrl-C takes the force away"
        )

    def start(self) -> None:
        """Begin where the servos say that they stand; those that measure nothing can only jump to their centres.

        Whoever calls it calls `close` on every way out, one out of this method too.

        Raises:
            DeviceError: A servo that measures does not tell where it stands, or stands where it cannot be sent.
        """
        self.enable()
        self._thread.start()

    def enable(self) -> None:
        """Give the servos force where they stand, see `start`; `step` leads them from there."""
        begin = self._measured() if self._backend.measures else self._centres
        self._backend.enable(self._line, begin)
        if self._backend.measures:  # until they had force somebody may have moved them
            begin = self._measured()
        self._ramp.restart(begin, self._clock.monotonic())

    def _measured(self) -> dict[int, float]:
        deadline = self._clock.monotonic() + _MEASURE_SECONDS
        while self._clock.monotonic() < deadline:
            positions = self._backend.read(self._line).positions
            if self._centres.keys() <= positions.keys():
                self._require_inside(positions)
                return {channel: positions[channel] for channel in self._centres}
        channels = ", ".join(map(str, self._centres))
        msg = f"not all of channels {channels} tell where they stand: is one of them overloaded?"
        raise LineStalledError(msg)

    def _require_inside(self, positions: Mapping[int, float]) -> None:
        lowest, highest = self._backend.lowest, self._backend.highest
        for number, joint in enumerate(self._joints, start=1):
            if not lowest <= positions[joint.channel] <= highest:
                stands = f"joint {number} stands at {positions[joint.channel]:g} {self._backend.unit}"
                msg = f"{stands}, outside [{lowest:g}, {highest:g}], where it can be sent: turn its horn inside by hand"
                raise LineStalledError(msg)

    def step(self) -> None:
        """Lead the servos on for the time since the last step.

        Raises:
            DeviceError: Of the line or of the device.
        """
        wanted = self._centres | {self._calibration.joint.channel: self._calibration.position}
        self._backend.send(self._line, self._ramp.step(wanted, self._clock.monotonic()))
        self._ramp.sent(self._clock.monotonic())
        self._stands = self._ramp.positions
        self._backend.read(self._line)

    def _hold(self) -> None:
        try:
            while not self._ended.wait(self._period):
                self.step()
        except StopAskedError:
            return
        except Exception as error:  # noqa: BLE001 - whatever it is, the servo must not be left under force unseen
            self.failure = str(error) if isinstance(error, DeviceError) else repr(error)
            self._report(f"the servo is let go: {self.failure}; Enter ends the program")
            with contextlib.suppress(DeviceError):
                self._backend.disable(self._line.raw)

    def arrive(self) -> None:
        """Wait until the servo has been led to where it is wanted, or is held no more."""
        channel = self._calibration.joint.channel
        while self._thread.is_alive() and self._stands.get(channel) != self._calibration.position:
            self._ended.wait(self._period)

    def close(self) -> None:
        """Take the force away, whatever is under way; no motion is commanded any more.

        Raises:
            DeviceError: The device has not taken it.
        """
        self._stop.ask()
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._stop.begin()
        try:
            self._backend.disable(self._line.raw)
        except DeviceError as error:
            msg = f"the servo may still have force, switch its supply off: {error}"
            raise DeviceError(msg) from error
