"""Start a study: ros2 launch fin_optimizer study.launch.py plant:=sim trials:=30 seed:=1."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, Shutdown
from launch.events.process import ShutdownProcess
from launch_ros.actions import Node

from fin_optimizer import graph

if TYPE_CHECKING:
    from launch import Action, LaunchContext
    from launch.events.process import ProcessExited


def start_nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the study. The optimiser's end takes the others with it, as does the end of the last fish."""
    plant = context.launch_configurations["plant"]
    if wrong := graph.misspelt(context.launch_configurations, plant):
        raise ValueError("; ".join(wrong))
    names = [argument.name for argument in graph.arguments(plant)]
    *plants, optimizer = graph.nodes({name: context.launch_configurations[name] for name in names})
    graph.check_robot_files(plants)
    fish: dict[str, list[Node]] = {}
    for spec in plants:
        fish.setdefault(spec.namespace, []).append(_node(spec, partial(end_fish, fish, spec)))
    nodes = [node for each in fish.values() for node in each]
    return [*nodes, _node(optimizer, Shutdown(reason=f"{optimizer.name} has ended"))]


def _node(spec: graph.NodeSpec, on_exit: object) -> Node:
    return Node(
        package=spec.package,
        executable=spec.executable,
        name=spec.name,
        namespace=spec.namespace,
        parameters=[dict(spec.parameters)],
        output="screen",
        on_exit=on_exit,
    )


def end_fish(
    fish: dict[str, list[Node]], spec: graph.NodeSpec, _event: ProcessExited, context: LaunchContext
) -> list[Action]:
    """Return what follows from the end of a plant's node: the rest of that fish ends, of the last one the study."""
    if context.is_shutdown or spec.namespace not in fish:
        return []
    rest = fish.pop(spec.namespace)
    ended = f"{spec.namespace}/{spec.name} has ended"
    if not fish:
        return [Shutdown(reason=ended)]
    return [
        LogInfo(msg=f"{ended}: the study goes on without {spec.namespace}"),
        EmitEvent(event=ShutdownProcess(process_matcher=lambda process: process in rest)),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments of a study and what starts its nodes."""
    declared = [
        DeclareLaunchArgument(argument.name, default_value=argument.default, description=argument.description)
        for argument in graph.arguments()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_nodes)])
