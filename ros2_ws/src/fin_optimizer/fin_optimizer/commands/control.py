"""Command ``control``: starts, pauses or stops the study of a running optimiser, or repeats a trial."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from fin_optimizer.parameters import OPTIMIZER
from fin_plant import node_process, topics
from fin_plant.command import EXIT_FAILURE, EXIT_OK, command, tell_error
from fin_plant.discovery import look_around, no_service

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.client import Client

WORDS = ("start", "pause", "repeat", "stop")
_PATIENCE = 5.0
"""s in which the optimiser must be found, and answer."""


@command("control", when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0 if the optimiser has done it, 1 if it refuses or is not there."""
    parser = argparse.ArgumentParser(
        prog="control",
        description="Start a study that holds, let it hold after the trial under way (pause), have that trial or else "
        "the last one swum again (repeat), or end the study there (stop).",
    )
    parser.add_argument("word", choices=WORDS)
    parser.add_argument("--namespace", default=topics.NAMESPACE, help="of the optimiser (default: %(default)s)")
    given = parser.parse_args(arguments)
    try:
        with node_process.starting_ros():
            node = Node(f"{OPTIMIZER}_control", namespace=given.namespace)
        return _ask(node, node.create_client(Trigger, f"{OPTIMIZER}/{given.word}"))
    finally:
        rclpy.try_shutdown()


def _ask(node: Node, client: Client) -> int:
    if not client.wait_for_service(_PATIENCE):
        seen = no_service(str(client.service_name), look_around(node), advice="give --namespace {namespace}")
        tell_error("control", f"no optimiser found within {_PATIENCE:g} s: {seen}")
        return EXIT_FAILURE
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    future = client.call_async(Trigger.Request())
    executor.spin_until_future_complete(future, _PATIENCE)
    answer = future.result() if future.done() else None
    if answer is None:
        tell_error("control", f"no answer from {client.service_name} within {_PATIENCE:g} s")
        return EXIT_FAILURE
    (sys.stdout if answer.success else sys.stderr).write(f"{answer.message}\n")
    return EXIT_OK if answer.success else EXIT_FAILURE


if __name__ == "__main__":
    sys.exit(main())
