"""The velocity estimator with a tracker whose clock is not this computer's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

from fin_plant import topics
from fin_plant.messages import time_message
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.processes import StartedProcess

SPEED = 0.03
PERIOD = 0.02


class Tracker:
    """Publishes a fish that swims straight on, by its own clock, and keeps what the estimator says."""

    def __init__(self, domain: int) -> None:
        self.ahead = 0.0
        self._begin = time.time_ns()
        self._poses: Any = None
        self.velocities: list[Any] = []
        self.statuses: list[DiagnosticStatus] = []
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node("tracker", namespace=topics.NAMESPACE, context=self._context)
        self.publish_on(topics.POSE.name, topics.POSE.qos)
        velocity, diagnostics = topics.VELOCITY, topics.DIAGNOSTICS
        self.node.create_subscription(velocity.type, velocity.name, self.velocities.append, velocity.qos)
        self.node.create_subscription(diagnostics.type, diagnostics.name, self._keep, diagnostics.qos)
        self.node.create_timer(PERIOD, self._publish)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def publish_on(self, topic: str, qos: QoSProfile) -> None:
        """Publish on this topic, and on no other."""
        if self._poses is not None:
            self.node.destroy_publisher(self._poses)
        self._poses = self.node.create_publisher(topics.POSE.type, topic, qos)

    def _keep(self, message: Any) -> None:
        self.statuses += message.status

    def _publish(self) -> None:
        now = time.time_ns()
        pose = PoseStamped()
        pose.header.stamp = time_message(now + round(self.ahead * 1e9))
        pose.pose.position.x = SPEED * (now - self._begin) * 1e-9
        pose.pose.orientation.w = 1.0
        self._poses.publish(pose)

    def wait_for_status(self, level: bytes, text: str) -> DiagnosticStatus:
        """Wait for such a status of the estimator, said after this call."""
        self.statuses.clear()

        def found() -> DiagnosticStatus | None:
            said = (s for s in self.statuses if s.level == level and text in s.message)
            return next(said, None)

        wait_until(found, 15, lambda: f"'{text}', got {self.statuses[-1:]}", self.spin)
        status = found()
        assert status is not None
        return status

    def wait_for_silence(self, level: bytes, text: str) -> DiagnosticStatus:
        """Wait until two such statuses come, a second apart, without a velocity between them; return the latter.

        What was estimated before is told by another topic, and may come after the first of them.
        """
        status = self.wait_for_status(level, text)

        def is_silent() -> bool:
            nonlocal status
            self.velocities.clear()
            status = self.wait_for_status(level, text)
            return not self.velocities

        wait_until(is_silent, 15, "an end of the velocities")
        return status

    def spin(self) -> None:
        """Take what has come."""
        self._executor.spin_once(timeout_sec=0.01)

    def close(self) -> None:
        """Stop tracking."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def tracker(ros_domain: int) -> Iterator[Tracker]:
    one = Tracker(ros_domain)
    yield one
    one.close()


def test_a_tracker_whose_clock_differs_is_refused(start: Callable[..., StartedProcess], tracker: Tracker) -> None:
    start("fin_servo_driver", "velocity_estimator")
    tracker.wait_for_status(DiagnosticStatus.OK, "estimating")
    wait_until(lambda: tracker.velocities, 15, "a velocity", tracker.spin)
    assert tracker.velocities[-1].twist.linear.x == pytest.approx(SPEED, rel=0.01)
    tracker.ahead = 1.0
    refused = tracker.wait_for_silence(DiagnosticStatus.WARN, "ahead of this computer's clock")
    assert "chrony" in refused.message
    assert int(next(item.value for item in refused.values if item.key == "poses_refused_from_the_future")) > 0
    tracker.ahead = -1.0
    tracker.wait_for_silence(DiagnosticStatus.WARN, "behind this computer's clock, largest_age is 0.2 s")


def test_what_is_on_the_graph_is_told_and_a_best_effort_tracker_is_heard(
    start: Callable[..., StartedProcess], tracker: Tracker
) -> None:
    tracker.publish_on("somewhere", topics.POSE.qos)
    start("fin_servo_driver", "velocity_estimator")
    tracker.wait_for_status(
        DiagnosticStatus.WARN,
        "nobody publishes topic /fish/pose; published is /fish/somewhere by /fish/tracker: remap it (pose:=/fish/some",
    )
    tracker.publish_on(topics.POSE.name, QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
    tracker.wait_for_status(DiagnosticStatus.OK, "estimating")
    wait_until(lambda: tracker.velocities, 15, "a velocity", tracker.spin)
    second = tracker.node.create_publisher(topics.POSE.type, topics.POSE.name, topics.POSE.qos)
    tracker.wait_for_status(DiagnosticStatus.WARN, "2 publishers share the topic (/fish/tracker, /fish/tracker)")
    tracker.node.destroy_publisher(second)
    tracker.wait_for_status(DiagnosticStatus.OK, "estimating")
