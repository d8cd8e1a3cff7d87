"""Start a robot without a study: ros2 launch fin_servo_driver robot.launch.py robot_file:=my_robot.yaml.

The driver moves nothing before a person has led it there by `ros2 run fin_servo_driver operator`.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from fin_plant.node_process import END_BY_SIGNAL_IS_SUCCESS
from fin_plant.topics import NAMESPACE


def generate_launch_description() -> LaunchDescription:
    """Return the driver of a robot and the estimator of its velocity; the driver's end ends both."""
    common = {
        "package": "fin_servo_driver",
        "namespace": LaunchConfiguration("namespace"),
        "additional_env": {
            END_BY_SIGNAL_IS_SUCCESS: "1"
        },  # else a signal, by which launch ends nodes, is a death to it
        "output": "screen",
    }
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in ("robot_file", "port")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot_file", description="The robot's YAML file, or the name of an example."),
            DeclareLaunchArgument("port", default_value="", description="Serial port, instead of the robot file's."),
            DeclareLaunchArgument("namespace", default_value=NAMESPACE, description="Namespace of the fish."),
            Node(executable="servo_driver", name="servo_driver", parameters=[parameters], on_exit=Shutdown(), **common),
            Node(executable="velocity_estimator", name="velocity_estimator", **common),
        ]
    )
