"""The launch file of a robot, where the launch system is: a pip-only machine lacks it."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

import fin_servo_driver
from fin_servo_driver import robot_file

launch = pytest.importorskip("launch", reason="comes with a ROS installation")
launch_ros = pytest.importorskip("launch_ros.actions", reason="comes with a ROS installation")
PACKAGE = Path(fin_servo_driver.__file__).parents[1]
FILE = PACKAGE / "launch" / "robot.launch.py"


def test_it_starts_the_driver_and_the_estimator_of_the_robot_that_is_given() -> None:
    file = runpy.run_path(str(FILE))
    description = file["generate_launch_description"]()
    declared = {argument.name: argument.default_value for argument in description.get_launch_arguments()}
    assert list(declared) == ["robot_file", "port", "namespace", "params", "live", "rviz"]
    assert declared["robot_file"] is None, "without one it says so"
    context = launch.LaunchContext()
    given = {"robot_file": "firmata", "port": "", "namespace": "/tank_a/fish", "params": ""}
    context.launch_configurations.update(given)
    nodes = file["robot"](context)
    assert [node.node_executable for node in nodes] == ["servo_driver", "velocity_estimator"]
    for node in nodes:
        node._perform_substitutions(context)
    assert [node.node_name for node in nodes] == ["/tank_a/fish/servo_driver", "/tank_a/fish/velocity_estimator"]


def test_a_robot_file_that_cannot_be_is_refused_before_anything_starts() -> None:
    context = launch.LaunchContext()
    context.launch_configurations.update({"robot_file": "nonsense", "port": "", "namespace": "/fish", "params": ""})
    with pytest.raises(ValueError, match="robot_file = nonsense: there is no such file"):
        runpy.run_path(str(FILE))["robot"](context)


def test_every_example_is_a_config_file_of_the_package() -> None:
    found = {robot_file.find(name) for name in robot_file.examples()}
    assert found == set((PACKAGE / "config").iterdir())
