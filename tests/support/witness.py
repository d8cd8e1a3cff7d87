"""A bystander that notes how far a fish has swum, whatever becomes of those who record it."""

from __future__ import annotations

import threading
from typing import Self

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

from fin_optimizer.bags.messages import header_stamp
from fin_plant import topics


class Witness:
    """Listens to velocity without holding anybody up; a context manager."""

    def __init__(self, domain: int) -> None:
        self.newest = 0
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("witness", namespace=topics.NAMESPACE, context=self._context)
        qos = QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, depth=1)
        self._node.create_subscription(topics.VELOCITY.type, topics.VELOCITY.name, self._note, qos, raw=True)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin)

    def _note(self, data: bytes) -> None:
        self.newest = header_stamp(data)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
