"""Start a study: ros2 launch fin_bringup study.launch.py plant:=sim trials:=30 seed:=1.

`ros2 launch` ends with the optimiser's exit code, as `bringup` does.
"""

from __future__ import annotations

import atexit
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, Shutdown
from launch.events.process import ShutdownProcess
from launch_ros.actions import Node

from fin_bringup import study_arguments, study_nodes
from fin_bringup.processes import SECONDS_TO_END
from fin_plant.node_process import END_BY_SIGNAL_IS_SUCCESS

if TYPE_CHECKING:
    from launch import Action, LaunchContext
    from launch.events.process import ProcessExited


def note_given(given: dict[str, str], context: LaunchContext) -> None:
    """Note in ``given`` which arguments were given, before launch adds defaults, which are those of no one plant.

    Raises:
        ValueError: Where another launch file includes this one: what looks like a slip of the pen. Other names may be
            that file's own.
    """
    configurations = context.launch_configurations
    if any(word.endswith(Path(__file__).name) for word in sys.argv):
        said = [word.partition(":=")[0] for word in context.argv or ()]
        given.update({name: configurations[name] for name in said if name in configurations})
        return
    plant = configurations.get("plant", "sim")
    if wrong := study_arguments.misspelt(configurations, plant):
        raise ValueError("; ".join(wrong))
    known = (argument.name for argument in study_arguments.arguments(plant))
    given.update({name: configurations[name] for name in known if name in configurations})


def start_nodes(given: dict[str, str], _context: LaunchContext) -> list[Node]:
    """Return the nodes of the study. The optimiser's end takes the others with it, as does the end of the last fish.

    Raises:
        ValueError: An argument that is unknown or whose value is refused.
    """
    specs = study_nodes.nodes(given)
    study_nodes.check_tails(specs)
    *plants, optimizer = specs
    fish: dict[str, list[Node]] = {}
    for spec in plants:
        fish.setdefault(spec.namespace, []).append(_node(spec, partial(end_fish, fish, spec)))
    nodes = [node for each in fish.values() for node in each]
    shown = [_node(spec, None) for spec in study_nodes.viewers(given)]
    return [*nodes, _node(optimizer, end_study), *shown]


def _node(spec: study_nodes.NodeSpec, on_exit: object) -> Node:
    return Node(
        package=spec.package,
        executable=spec.executable,
        name=spec.name,
        namespace=spec.namespace,
        parameters=[dict(spec.parameters)],
        arguments=list(spec.words),
        additional_env={END_BY_SIGNAL_IS_SUCCESS: "1"},  # launch ends plants by a signal; other codes it calls a death
        output="screen",
        sigterm_timeout=str(SECONDS_TO_END),
        on_exit=on_exit,
    )


def end_study(event: ProcessExited, context: LaunchContext) -> list[Action]:
    """Return what follows from the optimiser's end: that of the plants, and its exit code as that of `ros2 launch`.

    Raises:
        RuntimeError: The optimiser failed: launch shuts down and ends with an exit code other than 0.
    """
    if event.returncode:
        atexit.register(_exit, event.returncode if event.returncode > 0 else 1)
    if context.is_shutdown:
        return []
    if event.returncode:
        msg = f"the optimiser has ended with exit code {event.returncode}"
        raise RuntimeError(msg)
    return [Shutdown(reason="the study has ended")]


def _exit(code: int) -> None:
    """End the process with this code: launch itself knows only 0 and 1."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def end_fish(
    fish: dict[str, list[Node]], spec: study_nodes.NodeSpec, event: ProcessExited, context: LaunchContext
) -> list[Action]:
    """Return what follows from the end of a plant's node: the rest of that fish ends, of the last one the study.

    Raises:
        RuntimeError: It was the last fish: launch shuts down and ends with exit code 1.
    """
    if context.is_shutdown or spec.namespace not in fish:
        return []
    rest = fish.pop(spec.namespace)
    ended = f"{spec.namespace}/{spec.name} has ended with exit code {event.returncode}"
    if not fish:
        msg = f"{ended} before the study did"
        raise RuntimeError(msg)
    return [
        LogInfo(msg=f"{ended}: the study goes on without {spec.namespace}"),
        EmitEvent(event=ShutdownProcess(process_matcher=lambda process: process in rest)),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments of a study and what starts its nodes."""
    declared = [
        DeclareLaunchArgument(argument.name, default_value=argument.default, description=argument.description)
        for argument in study_arguments.arguments()
    ]
    given: dict[str, str] = {}
    first, last = (OpaqueFunction(function=partial(work, given)) for work in (note_given, start_nodes))
    return LaunchDescription([first, *declared, last])
