"""What is to be driven, and over which port, before any opens: a robot file and the parameters. Nothing knows ROS."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from fin_servo_driver import backends, robot_file
from fin_servo_driver.port import SerialLine
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.set_points import ServoMotion

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.parameters import Value
    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.robot_file import Robot
    from fin_servo_driver.set_points import Motion

_PSEUDO_TERMINALS = "/dev/pts/"


@dataclass(frozen=True)
class RobotSetup:
    """A robot as it is to be opened.

    Attributes:
        backend: Speaks the device's language.
        motion: Makes set-points of a gait.
        port: Of the device.
        baud: Bits a second.
        schemes: Of ports that are no files, such as ``loop``, where they are allowed.
    """

    backend: Backend
    motion: Motion
    port: str
    baud: int
    schemes: list[str]

    @classmethod
    def from_parameters(cls, values: Mapping[str, Value]) -> RobotSetup:
        """Return the robot of the driver's parameters.

        Raises:
            ValueError: The robot file is refused, there is no port, or a rehearsal is to take a real device.
        """
        robot = robot_file.load(robot_file.find(cast("str", values["robot_file"])))
        backend = backends.make(robot)
        port = cast("str", values["port"]) or robot.port
        if not port:
            msg = "no port: give it in the robot file or as parameter port"
            raise ValueError(msg)
        if values["plant"] == "rehearsal" and not os.path.realpath(port).startswith(_PSEUDO_TERMINALS):
            msg = (
                f"port {port} is no pseudo-terminal: a rehearsal arms its driver by itself, so it takes no real device"
            )
            raise ValueError(msg)
        motion, baud = _motion(robot, 1.0 / backend.rate), robot.baud or backend.baud
        return cls(backend, motion, port, baud, cast("list[str]", values["port_schemes"]))

    def open_line(self) -> SerialLine:
        """Open the port.

        Raises:
            DeviceError: It cannot be opened.
        """
        return SerialLine(self.port, self.baud, self.schemes)


def _motion(robot: Robot, period: float) -> Motion:
    if robot.relays:
        return RelayMotion(robot.relays, robot.timing, period)
    return ServoMotion(robot.servos, period)
