"""The four streams of a swimming fish as serialised messages: joint states, pose, velocity, thrust."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState

from fin_plant import topics
from fin_plant.fish_model import joint_names
from fin_sim import dynamics
from fin_sim.message_template import MessageTemplate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_sim.chain import Chain

STREAMS = (topics.JOINT_STATES, topics.POSE, topics.VELOCITY, topics.THRUST)


class StreamMessages:
    """Makes the messages of `STREAMS` from what the kernel computed, many samples at once.

    Attributes:
        joints: Names of the joints, from the head to the tail.
    """

    def __init__(self, chain: Chain) -> None:
        """Learn the layout; the joints have the names of this chain's tail and hinges."""
        names = joint_names(chain.driven)
        self.joints = names
        self._water = chain.water
        self._templates = (
            MessageTemplate(partial(_joint_state, names), 3 * len(names)),
            MessageTemplate(_pose, 4),
            MessageTemplate(_velocity, 3),
            MessageTemplate(_thrust, 2),
        )

    def serialized(
        self, stamps: NDArray[np.int64], states: NDArray[np.float64], records: NDArray[np.float64]
    ) -> list[list[bytes]]:
        """Return the messages of each stream, in the order of `STREAMS`.

        Args:
            stamps: ns, shape (n,).
            states: Of the kernel, shape (n, body states + 2 joints).
            records: Of the kernel, shape (n, head + joints).
        """
        heading = states[:, dynamics.HEADING]
        sine, cosine = np.sin(heading), np.cos(heading)
        force_x, force_y = records[:, dynamics.FORCE_X], records[:, dynamics.FORCE_Y]
        joints = (states[:, dynamics.BODY_STATES :], records[:, dynamics.RECORD_HEAD :])
        surge, sway = self._water.over_ground(states[:, dynamics.SURGE], states[:, dynamics.SWAY], heading)
        place = (states[:, dynamics.X], states[:, dynamics.Y], np.sin(heading / 2), np.cos(heading / 2))
        numbers = (
            np.concatenate(joints, axis=1),
            np.stack(place, axis=1),
            np.stack((surge, sway, states[:, dynamics.YAW_RATE]), axis=1),
            np.stack((force_x * cosine + force_y * sine, force_y * cosine - force_x * sine), axis=1),
        )
        return [template.fill(stamps, rows) for template, rows in zip(self._templates, numbers, strict=True)]


def _joint_state(names: Sequence[str], numbers: Sequence[float]) -> JointState:
    message, joints = JointState(name=names), len(names)
    message.position, message.velocity = numbers[:joints], numbers[joints : 2 * joints]
    message.effort = numbers[2 * joints :]
    return message


def _pose(numbers: Sequence[float]) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = topics.TANK_FRAME
    place, turn = message.pose.position, message.pose.orientation
    place.x, place.y, turn.z, turn.w = numbers
    return message


def _velocity(numbers: Sequence[float]) -> TwistStamped:
    message = TwistStamped()
    message.header.frame_id = topics.BODY_FRAME
    message.twist.linear.x, message.twist.linear.y, message.twist.angular.z = numbers
    return message


def _thrust(numbers: Sequence[float]) -> WrenchStamped:
    message = WrenchStamped()
    message.header.frame_id = topics.BODY_FRAME
    message.wrench.force.x, message.wrench.force.y = numbers
    return message
