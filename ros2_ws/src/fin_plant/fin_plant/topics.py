"""The topics of the node graph: names, types and quality of service, in one place.

Names are relative: they live in the namespace of the fish. Frames follow REP 103, units are SI and radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Path
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

NAMESPACE = "/fish"
TANK_FRAME = "tank"
BODY_FRAME = "base_link"

STREAM = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1000)
"""What a plant offers: reliable, with room for a slice of a swim that runs faster than real time."""
EVERY_MESSAGE = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)
"""What a scorer or recorder asks for: a full queue holds the plant back instead of losing a message."""
LATEST = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1)
LATCHED = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
)
CLOCK_QOS = QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1)

MessageT = TypeVar("MessageT")


@dataclass(frozen=True)
class Topic(Generic[MessageT]):
    """A topic: its name, its message type, and what its publisher offers."""

    name: str
    type: type[MessageT]
    qos: QoSProfile
    description: str

    @property
    def type_name(self) -> str:
        """Type as ROS writes it, for example ``std_msgs/msg/Float64``."""
        package = self.type.__module__.split(".")[0]
        return f"{package}/msg/{self.type.__name__}"

    def name_in(self, namespace: str) -> str:
        """Return the name in a fish's namespace, for example ``/fish/gait``; in an empty one it stays relative."""
        if self.name.startswith("/"):
            return self.name
        return f"{namespace.rstrip('/')}/{self.name}" if namespace else self.name


GAIT = Topic("gait", Float64MultiArray, LATEST, "gait asked for; repeat at 2 Hz or more")
GAIT_APPLIED = Topic("gait_applied", Float64MultiArray, LATCHED, "gait after the limits")
JOINT_STATES = Topic(
    "joint_states", JointState, STREAM, "angles (positive: to the right), rates and servo torques of tail and fin"
)
POSE = Topic("pose", PoseStamped, STREAM, "pose of base_link in tank")
VELOCITY = Topic("velocity", TwistStamped, STREAM, "velocity of base_link in base_link")
THRUST = Topic("thrust", WrenchStamped, STREAM, "force of the water on the tail, in base_link")
PLANT_STATE = Topic("plant_state", DiagnosticStatus, LATCHED, "READY, WAITING_FOR_..., SWIMMING or FAULT, and the fin")
MARKERS = Topic("markers", MarkerArray, LATEST, "body, fin and floor as shapes in tank")
ROBOT_DESCRIPTION = Topic("robot_description", String, LATCHED, "URDF of the fish with its fin, anew with each fin")
PATH = Topic("path", Path, LATEST, "where base_link has been since the swim began, in tank")
CANDIDATE = Topic("candidate", DiagnosticStatus, LATCHED, "the trial under way")
SCORE = Topic("score", Float64, STREAM, "score of each trial that ended OK")
PROGRESS = Topic("progress", DiagnosticStatus, LATCHED, "the study so far")
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STREAM, "health of every node, 1 Hz")
CLOCK = Topic("/clock", Clock, CLOCK_QOS, "time of the plant when it does not run in real time")

ALL_TOPICS: tuple[Topic[Any], ...] = (
    GAIT,
    GAIT_APPLIED,
    JOINT_STATES,
    POSE,
    VELOCITY,
    THRUST,
    PLANT_STATE,
    ROBOT_DESCRIPTION,
    MARKERS,
    PATH,
    CANDIDATE,
    SCORE,
    PROGRESS,
    DIAGNOSTICS,
    CLOCK,
)
RECORDED_TOPICS: tuple[Topic[Any], ...] = (
    GAIT,
    GAIT_APPLIED,
    JOINT_STATES,
    POSE,
    VELOCITY,
    THRUST,
    PLANT_STATE,
    CANDIDATE,
    ROBOT_DESCRIPTION,
    DIAGNOSTICS,
)
"""What the bag of a trial holds of what was said; frames, shapes and path are computed into it from these."""
TF = "/tf"
TF_TYPE = "tf2_msgs/msg/TFMessage"
"""Transforms from tank to each link. Its package is not among the wheels of ROS 2: see `fin_plant.model_topics`."""

SET_PARAMETERS_SERVICE = "set_parameters_atomically"
REQUEST_RESET_SERVICE = "request_reset"
"""What programs ask a plant for: the fish at rest at its start. A simulator does it, a robot asks a person for it."""
CONFIRM_FIN_SERVICE = "confirm_fin"
CONFIRM_MARK_SERVICE = "confirm_mark"
"""What a person's tools alone call, of a robot: the fin is mounted, the fish is back at its mark."""
EMERGENCY_STOP_SERVICE = "estop"
