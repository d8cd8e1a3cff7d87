"""Calibrate a servo: step it to angles, measure where the joint stands, store the numbers in the robot's YAML file.

A program of its own, without a node: the servo driver must not have the port meanwhile. Commands, one a line:

  + N, - N   move by N units of the device (us, ticks); N is 5 if left out
  = N        move to N
  c          the joint is straight here: this is the centre
  a DEGREES  the joint stands at this angle, to the left positive: gives scale and direction
  l, h       here is the lowest, highest position that the mechanism stands
  s          store and leave
  q          leave without storing
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from fin_servo_driver import backends, robot_file
from fin_servo_driver.line import DeviceError, LineStalledError
from fin_servo_driver.port import SerialLine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.line import Line
    from fin_servo_driver.robot_file import Robot, ServoJoint

_STEP = 5.0
_SMALLEST_ANGLE = math.radians(2.0)
_UNITS_A_SECOND = 300.0
"""How fast the horn is led to a new place; half a turn of a hobby servo takes some seconds."""
_MEASURE_SECONDS = 1.0


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
    """

    joint: ServoJoint
    position: float
    lowest: float
    highest: float

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
        value = _number(rest[0]) if rest else None
        match command:
            case "+" | "-":
                step = _STEP if value is None else value
                self._move(self.position + (step if command == "+" else -step))
            case "=" if value is not None:
                self._move(value)
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
                msg = f"{text.strip()!r} is no command: + N, - N, = N, c, a DEGREES, l, h, s or q"
                raise ValueError(msg)
        return self.summary()

    def _move(self, position: float) -> None:
        if not self.lowest <= position <= self.highest:
            msg = f"position {position:g} is outside the device's range [{self.lowest:g}, {self.highest:g}]"
            raise ValueError(msg)
        self.position = position

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
    value = float(text)
    if not math.isfinite(value):
        msg = f"{text} is no finite number"
        raise ValueError(msg)
    return value


class Holder:
    """Leads the servo to where the calibration wants it, and holds it, in a thread of its own."""

    def __init__(self, backend: Backend, line: Line, robot: Robot, calibration: Calibration) -> None:
        """Take what to hold; nothing is sent before `start`."""
        self.failure = ""
        self._backend = backend
        self._line = line
        self._calibration = calibration
        self._centres = {joint.channel: joint.centre for joint in robot.servos}
        self._sent = dict(self._centres)
        self._held = False
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._hold, name="hold the servo")

    def start(self) -> None:
        """Begin where the servos say that they stand; those that measure nothing can only jump to their centres.

        Whoever calls it calls `close` on every way out, one out of this method too.

        Raises:
            DeviceError: A servo that measures does not tell where it stands.
        """
        if self._backend.measures:
            self._sent = self._measured()
        self._held = True
        self._backend.enable(self._line, self._sent)
        self._thread.start()

    def _measured(self) -> dict[int, float]:
        deadline = time.monotonic() + _MEASURE_SECONDS
        while time.monotonic() < deadline:
            positions = self._backend.read(self._line).positions
            if self._centres.keys() <= positions.keys():
                return {channel: positions[channel] for channel in self._centres}
        channels = ", ".join(map(str, self._centres))
        msg = f"not all of channels {channels} tell where they stand: is one of them overloaded?"
        raise LineStalledError(msg)

    def _hold(self) -> None:
        period = 1.0 / self._backend.rate
        reach = _UNITS_A_SECOND * period
        try:
            while not self._ended.wait(period):
                wanted = self._centres | {self._calibration.joint.channel: self._calibration.position}
                for channel, position in wanted.items():
                    self._sent[channel] += min(max(position - self._sent[channel], -reach), reach)
                self._backend.send(self._line, self._sent)
                self._backend.read(self._line)
        except DeviceError as error:
            self.failure = str(error)

    def close(self) -> None:
        """Let go of the servo, if it was ever held."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._held:
            self._backend.disable(self._line)


def calibrate(robot: Robot, number: int, port: str, lines: Iterable[str]) -> ServoJoint | None:
    """Calibrate one joint by the commands in ``lines``; return it to store, or None.

    Raises:
        DeviceError: The port or the device are not as configured.
        ValueError: The joint cannot be calibrated.
    """
    if not 1 <= number <= len(robot.servos):
        msg = f"--joint {number} is not one of the robot's servos, 1 to {len(robot.servos)}"
        raise ValueError(msg)
    backend = backends.make(robot)
    joint = robot.servos[number - 1]
    calibration = Calibration(joint, joint.centre, backend.lowest, backend.highest)
    line = SerialLine(port, robot.baud or backend.baud)
    try:
        _say(backend.identify(line))
        backend.disable(line)
        holder = Holder(backend, line, robot, calibration)
        try:
            holder.start()
            return _converse(
                calibration, holder, lines, lambda joint: backends.make(robot_file.with_joint(robot, number, joint))
            )
        finally:
            holder.close()
    finally:
        line.drain(0.1)
        line.close()


def _converse(
    calibration: Calibration, holder: Holder, lines: Iterable[str], check: Callable[[ServoJoint], object]
) -> ServoJoint | None:
    """Obey the lines; ``check`` raises ValueError for a joint that the driver would refuse."""
    _say(calibration.summary())
    for text in lines:
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


def _end(number: int, _frame: object) -> None:
    """Leave by the ways out, which let go of the servo."""
    raise SystemExit(128 + number)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(
        prog="calibrate_servo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot_file", type=Path, help="YAML file of the robot; start with a copy of an example")
    parser.add_argument("--joint", type=int, default=1, help="number of the joint from the head (default: 1)")
    parser.add_argument("--port", default="", help="instead of the robot file's")
    given = parser.parse_args(arguments)
    for number in (signal.SIGTERM, signal.SIGHUP):  # a closed terminal must not leave the servo under force
        signal.signal(number, _end)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job starts with it ignored
    try:
        robot = robot_file.load(given.robot_file)
        joint = calibrate(robot, given.joint, given.port or robot.port, sys.stdin)
        if joint is None:
            _say("nothing stored")
            return 0
        robot_file.save(robot_file.with_joint(robot, given.joint, joint), given.robot_file)
    except (DeviceError, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        _say("nothing stored")
        return 130
    _say(f"stored in {given.robot_file} at {time.strftime('%H:%M:%S')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
