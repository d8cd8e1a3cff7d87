"""The devices that the driver speaks to. Adding one is a module beside this file and a line in `BACKENDS`.

* `backend`: what every device offers, and the checks that all share;
* `maestro`, `dynamixel`, `firmata`: servos;
* `kmtronic`, `lcus`, `modbus`: relay boards.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from fin_servo_driver.backends.dynamixel import Dynamixel
from fin_servo_driver.backends.firmata import Firmata
from fin_servo_driver.backends.kmtronic import Kmtronic
from fin_servo_driver.backends.lcus import Lcus
from fin_servo_driver.backends.maestro import Maestro
from fin_servo_driver.backends.modbus import Modbus

if TYPE_CHECKING:
    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.clock import Clock
    from fin_servo_driver.robot_file import Robot

BACKENDS: dict[str, type[Backend]] = {
    "dynamixel": Dynamixel,
    "firmata": Firmata,
    "kmtronic": Kmtronic,
    "lcus": Lcus,
    "maestro": Maestro,
    "modbus": Modbus,
}


def make(robot: Robot, clock: Clock = time) -> Backend:
    """Return the back end of a robot, with what it takes for the time.

    Raises:
        ValueError: There is none of that name, or it cannot drive these joints.
    """
    if robot.device not in BACKENDS:
        msg = f"device {robot.device!r} is not known: choose one of {', '.join(BACKENDS)}"
        raise ValueError(msg)
    return BACKENDS[robot.device](robot, clock)
