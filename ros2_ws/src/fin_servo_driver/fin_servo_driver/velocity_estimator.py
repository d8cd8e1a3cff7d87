"""The velocity estimator node: from the tracker's ``pose`` to ``velocity`` in the fish's own frame."""

from __future__ import annotations

import sys
import time
from dataclasses import fields
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState  # noqa: TC002  (likewise)
from std_msgs.msg import String  # noqa: TC002  (rclpy reads the annotation's class at run time)

from fin_plant import node_process, topics
from fin_plant.discovery import ends_of, look_around, nothing_on, wanted
from fin_plant.fin import node_table
from fin_plant.frames import Pose
from fin_plant.messages import key_values, nanoseconds_of, plant_state_from_message, time_message
from fin_plant.model_topics import ModelTopics
from fin_plant.node_parameters import NodeParameters, create_node
from fin_plant.plant_state import State
from fin_servo_driver.pose_checks import Limits, Refusal, heading_of
from fin_servo_driver.velocity_estimate import Settings, VelocityEstimator

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.subscription import Subscription

    from fin_plant.parameters import Value
    from fin_servo_driver.velocity_estimate import Velocity

PARAMETERS = node_table("fin_servo_driver", "velocity_estimator")
_LOOK = 0.1
_ANY_TRACKER = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=topics.POSE.qos.depth
)
"""Matches every tracker; a reliable subscription hears nothing of one that offers best effort, as many do."""


def settings_of(values: Mapping[str, Value]) -> Settings:
    """Return the estimator's settings from the node's parameters.

    Raises:
        ValueError: A value that is refused.
    """
    number = {name: value for name, value in values.items() if isinstance(value, float)}
    limits = Limits(**{each.name: number[each.name] for each in fields(Limits)})
    return Settings(number["window"], number["position_floor"], number["heading_floor"], limits)


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
        self._poses = self._published = 0
        self._trackers: list[str] = []
        self._swim = 0
        self._velocities = self.node.create_publisher(topics.VELOCITY.type, topics.VELOCITY.name, topics.VELOCITY.qos)
        self._diagnostics = self.node.create_publisher(
            topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.qos
        )
        self.node.create_subscription(topics.POSE.type, topics.POSE.name, self._on_pose, _ANY_TRACKER)
        self.node.create_subscription(
            topics.PLANT_STATE.type, topics.PLANT_STATE.name, self._on_plant_state, topics.PLANT_STATE.qos
        )
        self._model = ModelTopics(self.node)
        self._joints: dict[str, float] = {}
        self._joint_states: Subscription | None = None
        self.node.create_subscription(
            topics.ROBOT_DESCRIPTION.type,
            topics.ROBOT_DESCRIPTION.name,
            self._on_description,
            topics.ROBOT_DESCRIPTION.qos,
        )
        self.node.create_timer(1.0, self._publish_diagnostics)
        settings = self._estimator.settings
        self.node.get_logger().info(f"delay {settings.delay:g} s, bandwidth {settings.bandwidth:.2g} Hz")

    def _on_plant_state(self, message: DiagnosticStatus) -> None:
        try:
            plant = plant_state_from_message(message)
        except ValueError as error:
            self.node.get_logger().error(str(error))
            return
        if plant.state is State.SWIMMING and plant.stamp != self._swim:
            self._swim = plant.stamp
            self._model.restart()
        self._estimator.plant_says(swims=plant.state is State.SWIMMING, since=plant.stamp)

    def _on_description(self, message: String) -> None:
        try:
            self._model.take_description(message.data)
        except ValueError as error:
            self.node.get_logger().error(str(error))

    def _on_joint_states(self, message: JointState) -> None:
        self._joints = dict(zip(message.name, message.position, strict=False))

    def _listen_to_joints(self) -> None:
        """Hear the joints' angles, a hundred a second, only while somebody looks at what comes of them."""
        topic = topics.JOINT_STATES
        if self._model.heard and self._joint_states is None:
            self._joint_states = self.node.create_subscription(
                topic.type, topic.name, self._on_joint_states, _ANY_TRACKER
            )
        elif not self._model.heard and self._joint_states is not None:
            self.node.destroy_subscription(self._joint_states)
            self._joint_states, self._joints = None, {}

    def _on_pose(self, message: PoseStamped) -> None:
        self._poses += 1
        estimate = self._estimate(message)
        if estimate is None:
            return
        self._published += 1
        velocity = TwistStamped()
        velocity.header.frame_id = topics.BODY_FRAME
        velocity.header.stamp = time_message(estimate.stamp)
        velocity.twist.linear.x, velocity.twist.linear.y = estimate.forward, estimate.left
        velocity.twist.angular.z = estimate.yaw_rate
        self._velocities.publish(velocity)

    def _estimate(self, message: PoseStamped) -> Velocity | None:
        if len(self._trackers) > 1:
            self._estimator.refuse(several_trackers(self._trackers))
            return None
        place, turn = message.pose.position, message.pose.orientation
        heading: float | Refusal = turn.z
        if not self._yaw_in_z:
            heading = heading_of((turn.x, turn.y, turn.z, turn.w), self._estimator.settings.limits)
        if isinstance(heading, Refusal):
            self._estimator.refuse(heading)
            return None
        stamp = nanoseconds_of(message.header.stamp)
        self._model.tell(stamp, Pose(place.x, place.y, place.z, heading), self._joints)
        now = self.node.get_clock().now().nanoseconds
        return self._estimator.add(stamp, place.x, place.y, heading, now=now, frame=message.header.frame_id)

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
        self._listen_to_joints()
        self._trackers = self._publishers()
        text = self._trouble()
        estimator.impossible = ""
        values = {
            "poses": self._poses,
            "velocities": self._published,
            "delay_s": estimator.settings.delay,
            "bandwidth_hz": round(estimator.settings.bandwidth, 3),
            "age_of_newest_pose_s": round(estimator.age, 4),
            **{f"poses_refused_{reason.replace(' ', '_')}": count for reason, count in estimator.refused.items()},
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if text else DiagnosticStatus.OK,
            name=f"{self.node.get_fully_qualified_name()}: estimate",
            message=text or "estimating",
            hardware_id="tracker",
            values=key_values(values),
        )
        self._poses = self._published = 0
        message = DiagnosticArray(status=[status])
        message.header.stamp = time_message(time.time_ns())
        self._diagnostics.publish(message)

    def _trouble(self) -> str:
        """Return what is wrong now or was since the last report, or nothing."""
        if not self._poses:
            return self._no_pose()
        return self._estimator.impossible or self._estimator.silent or self._estimator.note

    def _publishers(self) -> list[str]:
        topic = self.node.resolve_topic_name(topics.POSE.name)
        ends = ends_of(self.node.get_publishers_info_by_topic(topic))
        return [end.shown for end in ends if end.type_name == topics.POSE.type_name]

    def _no_pose(self) -> str:
        return nothing_on(
            self.node.resolve_topic_name(topics.POSE.name),
            wanted(topics.POSE, _ANY_TRACKER),
            look_around(self.node),
            advice="remap it (pose:={topic})",
            of_any_name=True,
            since="within the last second",
        )


def several_trackers(names: Sequence[str]) -> Refusal:
    """Return why poses are refused that several nodes publish: which of them saw the fish nobody can tell."""
    return Refusal(
        "several trackers",
        f"{len(names)} publishers share the topic ({', '.join(names)}): leave only one; one that was killed is seen "
        "for some seconds more",
    )


def main(args: list[str] | None = None) -> int:
    """Run the velocity estimator node."""
    return node_process.run(VelocityEstimatorNode, args)


if __name__ == "__main__":
    sys.exit(main())
