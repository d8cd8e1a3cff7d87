"""Calibrate a servo, step by step, and store the numbers in its robot file.

It steps the servo to angles, you measure where the joint stands.

A program of its own, without a node: the servo driver must not have the port
meanwhile. Every servo moves slowly, at 300 units of the device (us, ticks) a
second or at its joint's rate in the robot file, whichever is less. Ctrl-C ends
it at any time, and takes the force away. Commands, one a line:

  + N, - N   move by N units of the device; N is 5 if left out
  = N        move to N
  y          yes, also beyond the robot file's lowest and highest; each time
  c          the joint is straight here: this is the centre
  a DEGREES  the joint stands at this angle, to the left positive: gives scale
             and direction
  l, h       here is the lowest, highest position that the mechanism stands
  s          store and leave
  q          leave without storing
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import signal
import sys
import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_plant.paths import given_path
from fin_servo_driver import backends, robot_file
from fin_servo_driver.line import DeviceError, LineStalledError, Stop, StopAskedError, StoppableLine
from fin_servo_driver.port import SerialLine
from fin_servo_driver.safety import within_rate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.robot_file import Robot, ServoJoint
    from fin_servo_driver.set_points import Outputs

_STEP = 5.0
_SMALLEST_ANGLE = math.radians(2.0)
UNITS_A_SECOND = 300.0
"""How fast a horn is led to a new place at most; half a turn of a hobby servo takes some seconds."""
_PERIODS_AT_MOST = 2.0
"""Periods that count for the rate: a program that was held up does not make good in one jump what it has missed."""
_MEASURE_SECONDS = 1.0
_WARNING_SECONDS = 2.0
"""s between a warning and what it warns of, for a person at a terminal: to take the hand away, or press Ctrl-C."""
_MEASURING = frozenset("calh")
"""The commands that take where the servo stands for a fact; they wait until it has got there."""


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
                self._angle_is(math.radians(value))
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

    def _angle_is(self, angle: float) -> None:
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
        return (
            f"at {self.position:g}: centre {joint.centre:g}, {joint.units_per_radian:.1f} a rad, "
            f"direction {joint.direction}, range {joint.lowest:g} to {joint.highest:g}, "
            f"this is {math.degrees(joint.angle_at(self.position)):.1f} degrees"
        )


def _number(text: str) -> float:
    value = checks.read_number(text)
    if not math.isfinite(value):
        msg = f"{text} is no finite number"
        raise ValueError(msg)
    return value


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
        self, backend: Backend, line: StoppableLine, robot: Robot, calibration: Calibration, stop: Stop
    ) -> None:
        """Take what to hold, and the stop of the line; nothing is sent before `start`."""
        self.failure = ""
        self._backend = backend
        self._line = line
        self._stop = stop
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
        begin = self._measured() if self._backend.measures else self._centres
        self._backend.enable(self._line, begin)
        if self._backend.measures:  # until they had force somebody may have moved them
            begin = self._measured()
        self._ramp.restart(begin, time.monotonic())
        self._thread.start()

    def _measured(self) -> dict[int, float]:
        deadline = time.monotonic() + _MEASURE_SECONDS
        while time.monotonic() < deadline:
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

    def _hold(self) -> None:
        try:
            while not self._ended.wait(self._period):
                wanted = self._centres | {self._calibration.joint.channel: self._calibration.position}
                self._backend.send(self._line, self._ramp.step(wanted, time.monotonic()))
                self._ramp.sent(time.monotonic())
                self._stands = self._ramp.positions
                self._backend.read(self._line)
        except StopAskedError:
            return
        except Exception as error:  # noqa: BLE001 - whatever it is, the servo must not be left under force unseen
            self.failure = str(error) if isinstance(error, DeviceError) else repr(error)
            _say(f"the servo is let go: {self.failure}; Enter ends the program")
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


class Signals:
    """Ctrl-C and the like: the first one ends everything on the line at once; none breaks the tear-down.

    Attributes:
        number: Of the first signal, 0 before.
    """

    def __init__(self, stop: Stop) -> None:
        self.number = 0
        self._stop = stop
        self._only_noted = False

    def install(self) -> None:
        """Take the signals from now on. A closed terminal must not leave the servo under force either."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._take)

    def _take(self, number: int, _frame: object) -> None:
        was_first, self.number = not self.number, self.number or number
        if was_first and not self._only_noted:
            self._stop.ask()
            raise KeyboardInterrupt

    def only_note(self) -> None:
        """Interrupt nothing any more: the force is taken away."""
        self._only_noted = True


def calibrate(
    robot: Robot, number: int, port: str, lines: Iterable[str], signals: Signals | None = None, stop: Stop | None = None
) -> ServoJoint | None:
    """Calibrate one joint by the commands in ``lines``; return it to store, or None.

    Raises:
        DeviceError: The port or the device are not as configured.
        ValueError: The joint cannot be calibrated.
        KeyboardInterrupt: A signal has asked for the end; the force is taken away.
    """
    if not 1 <= number <= len(robot.servos):
        msg = f"--joint {number} is not one of the robot's servos, 1 to {len(robot.servos)}"
        raise ValueError(msg)
    stop = stop or Stop()
    backend = backends.make(robot)
    joint = robot.servos[number - 1]
    calibration = Calibration(joint, joint.centre, backend.lowest, backend.highest)
    line = StoppableLine(SerialLine(port, robot.baud or backend.baud), stop)
    try:
        _say(backend.identify(line))
        holder = Holder(backend, line, robot, calibration, stop)
        try:
            try:
                backend.disable(line)
                _warn(holder.warning(), lines)
                holder.start()
                return _converse(
                    calibration, holder, lines, lambda joint: backends.make(robot_file.with_joint(robot, number, joint))
                )
            finally:
                if signals is not None:  # a signal that interrupts this very line is the last that interrupts anything
                    signals.only_note()
        finally:
            holder.close()
    finally:
        line.raw.drain(0.1)
        line.raw.close()


def _warn(text: str, lines: Iterable[str]) -> None:
    """Say it, and give a person at a terminal the time to read it."""
    _say(text)
    if isinstance(lines, io.TextIOBase) and lines.isatty():
        time.sleep(_WARNING_SECONDS)


def _converse(
    calibration: Calibration, holder: Holder, lines: Iterable[str], check: Callable[[ServoJoint], object]
) -> ServoJoint | None:
    """Obey the lines; ``check`` raises ValueError for a joint that the driver would refuse."""
    _say(calibration.summary())
    for text in lines:
        if text.split()[:1] and text.split()[0] in _MEASURING:
            holder.arrive()
        if holder.failure:
            raise DeviceError(holder.failure)
        try:
            _say(calibration.obey(text))
        except Leave as leave:
            if not leave.store:
                return None
            try:
                check(calibration.joint)
            except ValueError as error:
                _say(f"not stored: {error}")
            else:
                return calibration.joint
        except ValueError as error:
            _say(f"no: {error}")
    return None


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - a program for a terminal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(
        prog="calibrate_servo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot_file", type=given_path, help="YAML file of the robot; start with a copy of an example")
    parser.add_argument(
        "--joint", type=checks.read_whole_number, default=1, help="number of the joint from the head (default: 1)"
    )
    parser.add_argument("--port", default="", help="instead of the robot file's")
    given = parser.parse_args(arguments)
    stop = Stop()
    signals = Signals(stop)
    signals.install()
    try:
        robot = robot_file.load(given.robot_file)
        joint = calibrate(robot, given.joint, given.port or robot.port, sys.stdin, signals, stop)
        if joint is None or signals.number:
            _say("nothing stored")
            return 128 + signals.number if signals.number else 0
        robot_file.save(robot_file.with_joint(robot, given.joint, joint), given.robot_file)
    except (DeviceError, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        _say("nothing stored")
        return 128 + (signals.number or signal.SIGINT)
    _say(f"stored in {given.robot_file} at {time.strftime('%H:%M:%S')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
