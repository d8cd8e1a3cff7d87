"""Robot file and parameters make the robot that is opened, or are refused before any port is."""

from __future__ import annotations

import os
import pty
from typing import TYPE_CHECKING

import pytest

from fin_plant.fin import node_table
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.robot_setup import RobotSetup
from fin_servo_driver.set_points import ServoMotion

if TYPE_CHECKING:
    from fin_plant.parameters import Value

DEFAULTS: dict[str, Value] = {
    name: parameter.default for name, parameter in node_table("fin_servo_driver", "servo_driver").items()
}


def given(**values: Value) -> dict[str, Value]:
    return {**DEFAULTS, **values}


def test_a_servo_file_and_a_relay_file_make_their_motions_at_the_rate_of_their_line() -> None:
    servo = RobotSetup.from_parameters(given(robot_file="firmata", port="/dev/ttyACM7"))
    assert (servo.port, servo.baud, type(servo.motion)) == ("/dev/ttyACM7", 57600, ServoMotion)
    relays = RobotSetup.from_parameters(given(robot_file="modbus", port="/dev/ttyUSB7"))
    assert type(relays.motion) is RelayMotion


def test_without_a_port_the_one_of_the_file_is_taken() -> None:
    assert RobotSetup.from_parameters(given(robot_file="firmata")).port.startswith("/dev/")


def test_a_rehearsal_takes_a_pseudo_terminal_and_no_other_port() -> None:
    master, slave = pty.openpty()
    try:
        own = os.ttyname(slave)
        assert RobotSetup.from_parameters(given(robot_file="firmata", plant="rehearsal", port=own)).port == own
    finally:
        os.close(master)
        os.close(slave)
    with pytest.raises(ValueError, match="port /dev/ttyUSB7 is no pseudo-terminal: a rehearsal arms its driver"):
        RobotSetup.from_parameters(given(robot_file="firmata", plant="rehearsal", port="/dev/ttyUSB7"))


def test_what_is_no_robot_is_refused() -> None:
    with pytest.raises(ValueError, match="robot_file is empty"):
        RobotSetup.from_parameters(given(robot_file=""))
