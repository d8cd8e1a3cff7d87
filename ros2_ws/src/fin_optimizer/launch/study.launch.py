"""Start a study: ros2 launch fin_optimizer study.launch.py plant:=sim trials:=30 seed:=1."""

from __future__ import annotations

from typing import TYPE_CHECKING

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from fin_optimizer import graph

if TYPE_CHECKING:
    from launch import LaunchContext


def start_nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the study. The first that ends takes the others with it: without one there is no study."""
    plant = context.launch_configurations["plant"]
    names = [argument.name for argument in graph.arguments(plant)]
    given = {name: context.launch_configurations[name] for name in names}
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.name,
            namespace=spec.namespace,
            parameters=[dict(spec.parameters)],
            output="screen",
            on_exit=Shutdown(reason=f"{spec.name} has ended"),
        )
        for spec in graph.nodes(given)
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments of a study and what starts its nodes."""
    declared = [
        DeclareLaunchArgument(argument.name, default_value=argument.default, description=argument.description)
        for argument in graph.arguments()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_nodes)])
