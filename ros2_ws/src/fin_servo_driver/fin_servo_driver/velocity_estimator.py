"""The velocity estimator node: from the tracker's ``pose`` to ``velocity`` in the fish's own frame."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, cast

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped

from fin_plant import node_process, topics
from fin_plant.messages import key_values, nanoseconds_of, time_message
from fin_plant.node_parameters import NodeParameters, create_node
from fin_plant.parameters import load_table
from fin_servo_driver.velocity_estimate import Settings, VelocityEstimator, heading_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.parameters import Value

PARAMETERS = load_table("fin_servo_driver", "velocity_estimator_parameters.yaml")
_LOOK = 0.1


def settings_of(values: Mapping[str, Value]) -> Settings:
    """Return the estimator's settings from the node's parameters.

    Raises:
        ValueError: A value that is refused.
    """
    names = ("window", "position_floor", "heading_floor", "largest_lead", "largest_age")
    return Settings(**{name: cast("float", values[name]) for name in names})


class VelocityEstimatorNode:
    """Publishes a velocity for every pose that leads to one, and says why where none does."""

    def __init__(self) -> None:
        """Listen to the tracker.

        Raises:
            ValueError: A start parameter that is refused.
        """
        self.node = create_node("velocity_estimator")
        values = NodeParameters(self.node, PARAMETERS, validate=settings_of).values
        self._yaw_in_z = values["orientation"] == "yaw"
        self._estimator = VelocityEstimator(settings_of(values))
        self._poses = self._published = self._late_before = 0
        self._velocities = self.node.create_publisher(topics.VELOCITY.type, topics.VELOCITY.name, topics.VELOCITY.qos)
        self._diagnostics = self.node.create_publisher(
            topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.qos
        )
        self.node.create_subscription(topics.POSE.type, topics.POSE.name, self._on_pose, topics.POSE.qos)
        self.node.create_timer(1.0, self._publish_diagnostics)
        settings = self._estimator.settings
        self.node.get_logger().info(f"delay {settings.delay:g} s, bandwidth {settings.bandwidth:.2g} Hz")

    def _on_pose(self, message: PoseStamped) -> None:
        self._poses += 1
        place, turn = message.pose.position, message.pose.orientation
        heading = turn.z if self._yaw_in_z else heading_of(turn.x, turn.y, turn.z, turn.w)
        now = self.node.get_clock().now().nanoseconds
        estimate = self._estimator.add(nanoseconds_of(message.header.stamp), place.x, place.y, heading, now=now)
        if estimate is None:
            return
        self._published += 1
        velocity = TwistStamped()
        velocity.header.frame_id = topics.BODY_FRAME
        velocity.header.stamp = time_message(estimate.stamp)
        velocity.twist.linear.x, velocity.twist.linear.y = estimate.forward, estimate.left
        velocity.twist.angular.z = estimate.yaw_rate
        self._velocities.publish(velocity)

    def step(self) -> float:
        """Wait for poses."""
        return _LOOK

    def finished(self) -> int | None:
        """Return None: the node runs until it is stopped."""
        return None

    def close(self) -> None:
        """Nothing moves that has to be made safe."""

    def _publish_diagnostics(self) -> None:
        estimator = self._estimator
        topic = self.node.resolve_topic_name(topics.POSE.name)
        text = estimator.silent if self._poses else f"no pose on {topic}: does the tracker run?"
        if not text and estimator.late > self._late_before:
            allowed = estimator.settings.largest_age
            text = (
                f"poses are {estimator.age:.3f} s old when they come, more than largest_age = {allowed:g} s: "
                "is the tracker's clock synchronised with this computer's (chrony)?"
            )
        self._late_before = estimator.late
        values = {
            "poses": self._poses,
            "velocities": self._published,
            "delay_s": estimator.settings.delay,
            "bandwidth_hz": round(estimator.settings.bandwidth, 3),
            "age_of_newest_pose_s": round(estimator.age, 4),
            "poses_late": estimator.late,
            **{f"poses_refused_{reason.replace(' ', '_')}": count for reason, count in estimator.refused.items()},
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if text else DiagnosticStatus.OK,
            name=f"{self.node.get_fully_qualified_name()}: estimate",
            message=text or "estimating",
            values=key_values(values),
        )
        self._poses = self._published = 0
        message = DiagnosticArray(status=[status])
        message.header.stamp = time_message(time.time_ns())
        self._diagnostics.publish(message)


def main(args: list[str] | None = None) -> int:
    """Run the velocity estimator node."""
    return node_process.run(VelocityEstimatorNode, args)


if __name__ == "__main__":
    sys.exit(main())
