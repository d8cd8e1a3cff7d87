"""Body and fin as markers, so that RViz or Foxglove shows the fish swim."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Pose
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from fin_plant.topics import TANK_FRAME
from fin_sim.dynamics import BODY_STATES, HEADING, X, Y

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from fin_plant.parameters import Value
    from fin_sim.chain import Chain

_BODY_COLOUR = ColorRGBA(r=0.16, g=0.35, b=0.54, a=1.0)
_SERVO_COLOUR = ColorRGBA(r=0.35, g=0.35, b=0.38, a=1.0)
_FIN_COLOUR = ColorRGBA(r=0.93, g=0.55, b=0.14, a=1.0)
# They are published ten times a second: a link that is gone, of a longer fin before, vanishes.
_LIFETIME = Duration(sec=1)
# Thinner sheets would not be seen.
_LEAST_THICKNESS = 0.002


def _pose(x: float, y: float, heading: float) -> Pose:
    pose = Pose()
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
    return pose


def _marker(number: int, shape: int, pose: Pose, size: tuple[float, ...], colour: ColorRGBA) -> Marker:
    marker = Marker(ns="fish", id=number, type=shape, action=Marker.ADD, pose=pose, color=colour)
    marker.lifetime = _LIFETIME
    marker.header.frame_id = TANK_FRAME
    marker.scale.x, marker.scale.y, marker.scale.z = size
    return marker


def fish_markers(chain: Chain, values: Mapping[str, Value], state: NDArray[np.float64], stamp: Time) -> MarkerArray:
    """Return an ellipsoid for the body and a box for each link.

    Args:
        chain: The chain.
        values: The plant's parameters, for the body's axes.
        state: Shape (6 + 2 N,), see `fin_sim.dynamics`.
        stamp: Time of the state.
    """
    x, y, heading = (float(state[index]) for index in (X, Y, HEADING))
    axes = tuple(cast("float", values[f"body.{axis}"]) for axis in ("length", "width", "height"))
    markers = [_marker(0, Marker.SPHERE, _pose(x, y, heading), axes, _BODY_COLOUR)]
    x -= chain.body.tail_offset * math.cos(heading)
    y -= chain.body.tail_offset * math.sin(heading)
    for number, (link, driven) in enumerate(zip(chain.links, chain.driven, strict=True), start=1):
        heading += float(state[BODY_STATES + number - 1])
        half_x, half_y = 0.5 * link.length * math.cos(heading), 0.5 * link.length * math.sin(heading)
        size = (link.length, _LEAST_THICKNESS, 0.5 * (link.root_height + link.tip_height))
        colour = _SERVO_COLOUR if driven else _FIN_COLOUR
        markers.append(_marker(number, Marker.CUBE, _pose(x - half_x, y - half_y, heading), size, colour))
        x, y = x - 2.0 * half_x, y - 2.0 * half_y
    for marker in markers:
        marker.header.stamp = stamp
    return MarkerArray(markers=markers)
