"""Start a robot without a study: ros2 launch fin_servo_driver robot.launch.py robot_file:=my_robot.yaml.

The driver moves nothing before a person has led it there by `ros2 run fin_servo_driver operator`.
"""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from fin_plant.node_process import END_BY_SIGNAL_IS_SUCCESS
from fin_plant.topics import NAMESPACE
from fin_servo_driver import robot_file

COMMON = {
    "namespace": LaunchConfiguration("namespace"),
    "additional_env": {END_BY_SIGNAL_IS_SUCCESS: "1"},  # else a signal, by which launch ends nodes, is a death to it
    "output": "screen",
}


def robot(context: object) -> list[Node]:
    """Return the driver of a robot and the estimator of its velocity; the driver's end ends all.

    Raises:
        ValueError: There is no such robot file, or something in it is refused: the driver would say so when configured.
    """
    given = {name: LaunchConfiguration(name).perform(context) for name in ("robot_file", "port", "params")}
    robot_file.load(robot_file.find(given["robot_file"]))
    files = [given["params"]] if given["params"] else []
    own = {name: given[name] for name in ("robot_file", "port") if given[name]}
    driver = {"executable": "servo_driver", "name": "servo_driver", "parameters": [*files, own], "on_exit": Shutdown()}
    estimator = {"executable": "velocity_estimator", "name": "velocity_estimator", "parameters": files}
    return [Node(package="fin_servo_driver", **node, **COMMON) for node in (driver, estimator)]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, the robot's nodes, and what shows it if asked for."""
    layout = PathJoinSubstitution([FindPackageShare("fin_bringup"), "layouts", "fish.rviz"])
    live, rviz = (IfCondition(LaunchConfiguration(name)) for name in ("live", "rviz"))
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot_file", description="The robot's YAML file, or the name of an example."),
            DeclareLaunchArgument("port", default_value="", description="Serial port, instead of the robot file's."),
            DeclareLaunchArgument("namespace", default_value=NAMESPACE, description="Namespace of the fish."),
            DeclareLaunchArgument("params", default_value="", description="Parameter file of the nodes, YAML."),
            DeclareLaunchArgument(
                "live", default_value="false", description="Serve the graph to Foxglove, at ws://localhost:8765."
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="Show the fish in RViz."),
            OpaqueFunction(function=robot),
            Node(package="fin_bringup", executable="live", condition=live, **COMMON),
            Node(package="rviz2", executable="rviz2", arguments=["-d", layout], condition=rviz, **COMMON),
        ]
    )
