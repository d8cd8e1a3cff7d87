"""What the driver tells on its topics: joint states, the state of the plant, the gait applied, diagnostics."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState

from fin_plant import topics
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.fish_model import BodyShape, robot_links, urdf
from fin_plant.gait import Gait
from fin_plant.messages import as_text, gait_message, key_values, plant_state_message, time_message
from fin_plant.model_topics import DescriptionTopic
from fin_plant.plant_state import LIMITS, TELLS, PlantState, State, joint_details
from fin_servo_driver.diagnosis import describe
from fin_servo_driver.robot_states import Waiting
from fin_servo_driver.wall_clock import stamp_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.node import Node

    from fin_plant.gait import JointLimits
    from fin_plant.parameters import Value
    from fin_servo_driver.diagnosis import Counters
    from fin_servo_driver.io_thread import IoThread
    from fin_servo_driver.robot_states import RobotStates, Standing

MEASURED, COMMANDED = "measured", "commanded"
"""What joint_states carries, as its frame_id: a joint state has no frame of its own."""
_LEVELS = {State.READY: DiagnosticStatus.OK, State.SWIMMING: DiagnosticStatus.OK, State.FAULT: DiagnosticStatus.ERROR}


class DriverTopics:
    """Publishes what the driver tells.

    Attributes:
        applied: The gait that was told last.
    """

    def __init__(self, node: Node, plant: str) -> None:
        """Offer the topics.

        Args:
            node: Publishes them.
            plant: What the plant is called.
        """
        self._node, self._plant = node, plant
        offered = (topics.JOINT_STATES, topics.PLANT_STATE, topics.GAIT_APPLIED, topics.DIAGNOSTICS)
        self._joint_states, self._state, self._gait_applied, self._diagnostics = (
            node.create_publisher(topic.type, topic.name, topic.qos) for topic in offered
        )
        self._description = DescriptionTopic(node)
        self.applied = Gait.from_rows([[0.0, 0.0, 0.0, 0.0]])
        self._stamp = 0
        self._told: tuple[object, ...] = ()

    def tell_state(
        self,
        standing: Standing,
        states: RobotStates,
        values: Mapping[str, Value],
        awaited: str,
        limits: Sequence[JointLimits],
        *,
        anew: bool,
    ) -> None:
        """Publish the state if it has changed, or in any case; with a new stamp unless a swim goes on.

        Args:
            standing: Where the robot stands.
            states: What is mounted, and since when it swims.
            values: The node's parameters.
            awaited: Parameters that are incomplete, in words.
            limits: What each driven joint can do; empty while there is no device.
            anew: Whether to publish in any case.
        """
        begun = states.swimming_since if standing.state is State.SWIMMING else None
        told = (standing, begun)
        if told == self._told and not anew:
            return
        self._told = told
        if begun is None or begun != self._stamp:
            self._stamp = max(self._stamp + 1, begun or time.time_ns())
        fin = Fin.from_parameters(states.mounted or {name: values[name] for name in FIN_PARAMETERS})
        self._description.tell(urdf(BodyShape(), robot_links(fin, max(1, len(limits)))))
        details = {"waiting_for": standing.waiting.value if standing.waiting else ""}
        details |= {name: as_text(values[name]) for name in LIMITS}
        details |= joint_details(limits) if limits else {}
        details[TELLS] = ""  # no device of it measures a torque
        if standing.waiting is Waiting.FIN:
            details |= {f"wanted.{name}": as_text(values[name]) for name in FIN_PARAMETERS}
        mounted = {name: as_text(value) for name, value in (states.mounted or {}).items()}
        reason = "; ".join(filter(None, (standing.reason, awaited)))
        state = PlantState(standing.state, self._plant, self._stamp, reason, mounted, details)
        self._state.publish(plant_state_message(state))

    def tell_gait(self, gait: Gait) -> None:
        """Publish the gait that is applied."""
        self.applied = gait
        self._gait_applied.publish(gait_message(gait.rows()))

    def tell_rest(self, joints: int) -> None:
        """Publish that so many joints stand still, with frequency and phase of the gait that they had."""
        known = len(self.applied.joints) == joints
        self.tell_gait(self.applied.at_rest if known else Gait.from_rows(np.zeros((joints, 4))))

    def tell_joint_states(self, io: IoThread) -> None:
        """Publish what the I/O thread has sampled since the last time."""
        if not io.samples:
            return
        offset = stamp_of(0.0)
        names = [f"tail_joint_{number + 1}" for number in range(len(io.samples[0].angles))]
        while io.samples:
            sample = io.samples.popleft()
            message = JointState(name=names, position=sample.angles)
            message.header.stamp = time_message(round(sample.time * 1e9) + offset)
            message.header.frame_id = MEASURED if sample.measured else COMMANDED
            self._joint_states.publish(message)

    def tell_diagnostics(
        self, standing: Standing, counters: Counters, io: IoThread | None, *, watchdog_off: bool
    ) -> None:
        """Publish how the plant is, and how its device is where there is one."""
        name = self._node.get_fully_qualified_name()
        statuses = [
            DiagnosticStatus(
                level=_LEVELS.get(standing.state, DiagnosticStatus.WARN),
                name=f"{name}: plant",
                message=standing.reason or standing.state.value,
                hardware_id=self._plant,
                values=key_values({"state": standing.state.value, **counters.values()}),
            )
        ]
        if io is not None:
            level, text, values = describe(
                io.health, io.latenesses(), rated_operations=io.rated_operations, watchdog_off=watchdog_off
            )
            statuses.append(
                DiagnosticStatus(
                    level=bytes((level,)),
                    name=f"{name}: device",
                    message=text,
                    hardware_id=io.health.identity or self._plant,
                    values=key_values(values),
                )
            )
        message = DiagnosticArray(status=statuses)
        message.header.stamp = time_message(time.time_ns())
        self._diagnostics.publish(message)
