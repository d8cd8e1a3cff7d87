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
  a DEGREES  the joint stands so far to the left (with a minus: to the right):
             gives scale and direction
  l, h       here is the lowest, highest position that the mechanism stands
  s          store and leave
  q          leave without storing
"""

from __future__ import annotations

import argparse
import io
import signal
import sys
import time
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_plant.command import command
from fin_plant.paths import given_path
from fin_servo_driver import backends, robot_file
from fin_servo_driver.calibration import Calibration, Leave
from fin_servo_driver.line import DeviceError, Stop, StoppableLine
from fin_servo_driver.port import SerialLine
from fin_servo_driver.servo_holder import Holder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from fin_servo_driver.robot_file import Robot, ServoJoint

_WARNING_SECONDS = 2.0
"""s between a warning and what it warns of, for a person at a terminal: to take the hand away, or press Ctrl-C."""
_MEASURING = frozenset("calh")
"""The commands that take where the servo stands for a fact; they wait until it has got there."""


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
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
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
        holder = Holder(backend, line, robot, calibration, stop, _say)
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


@command("calibrate_servo", failures=(DeviceError, ValueError, OSError), when_output_closes=None)
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
    except KeyboardInterrupt:
        _say("nothing stored")
        return 128 + (signals.number or signal.SIGINT)
    _say(f"stored in {given.robot_file} at {time.strftime('%H:%M:%S')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
