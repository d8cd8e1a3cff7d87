"""From a robot file to the emulated device that fits it, and from its outputs to the angles of the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_servo_driver.backends import kmtronic, lcus
from fin_servo_driver.emulator import devices
from fin_servo_driver.robot_file import ServoJoint

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.robot_file import Robot


def device_for(robot: Robot, angle_of: Callable[[int], float]) -> devices.Device:
    """Return the device of a robot; ``angle_of`` tells the true angle in rad of a joint by its index.

    Raises:
        ValueError: There is no emulation of it.
    """
    servos = {joint.channel: index for index, joint in enumerate(robot.servos)}

    def present(servo: int) -> float:
        return robot.servos[servos[servo]].position_at(angle_of(servos[servo]))

    makers: dict[str, Callable[[], devices.Device]] = {
        "dynamixel": lambda: devices.Dynamixel(list(servos), present),
        "firmata": devices.Firmata,
        "kmtronic": lambda: devices.SilentRelays(kmtronic.switch_frame),
        "lcus": lambda: devices.SilentRelays(lcus.switch_frame),
        "maestro": devices.Maestro,
        "modbus": lambda: devices.Modbus(int(str(robot.options.get("unit", 1)))),
    }
    if robot.device not in makers:
        msg = f"device {robot.device} has no emulation: choose one of {', '.join(makers)}"
        raise ValueError(msg)
    return makers[robot.device]()


def targets(robot: Robot, device: devices.Device) -> list[float | None]:
    """Return the angle in rad that each joint is driven to, None where its servo has no force."""
    result: list[float | None] = []
    for joint in robot.joints:
        if isinstance(joint, ServoJoint):
            position = device.outputs.get(joint.channel)
            result.append(None if position is None else joint.angle_at(position))
        else:
            left, right = (device.outputs.get(channel) or 0.0 for channel in joint.channels)
            result.append(joint.stroke * (right - left))
    return result
