"""Start the simulated fish without a study: ros2 launch fin_sim simulator.launch.py.

To make it swim, publish a gait on ``gait``, or start a study's optimiser beside it.
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


def simulator(context: object) -> list[Node]:
    """Return the simulator, with the parameter file if one is given; its end ends the viewers."""
    params = LaunchConfiguration("params").perform(context)
    return [
        Node(
            package="fin_sim",
            executable="simulator",
            name="simulator",
            namespace=LaunchConfiguration("namespace"),
            parameters=[params] if params else [],
            additional_env={END_BY_SIGNAL_IS_SUCCESS: "1"},  # else a signal, by which launch ends nodes, is a death
            output="screen",
            on_exit=Shutdown(),
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, the simulator, and what shows it if asked for."""
    layout = PathJoinSubstitution([FindPackageShare("fin_bringup"), "layouts", "fish.rviz"])
    viewer = {"namespace": LaunchConfiguration("namespace"), "additional_env": {END_BY_SIGNAL_IS_SUCCESS: "1"}}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value=NAMESPACE, description="Namespace of the fish."),
            DeclareLaunchArgument("params", default_value="", description="Parameter file of the simulator, YAML."),
            DeclareLaunchArgument(
                "live", default_value="false", description="Serve the graph to Foxglove, at ws://localhost:8765."
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="Show the fish in RViz."),
            OpaqueFunction(function=simulator),
            Node(
                package="fin_bringup", executable="live", condition=IfCondition(LaunchConfiguration("live")), **viewer
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", layout],
                condition=IfCondition(LaunchConfiguration("rviz")),
                **viewer,
            ),
        ]
    )
