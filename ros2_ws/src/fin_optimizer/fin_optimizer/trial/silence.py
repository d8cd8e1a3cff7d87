"""What is said of one of the fish's topics on which nothing comes, from what is seen of the graph. Without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fin_plant.discovery import nothing_on

if TYPE_CHECKING:
    from fin_plant.discovery import End, Sight

_ELSEWHERE = {"plant_state": "did you mean plants:=[{namespace}]?"}
"""What to do where a topic of that name is in another namespace."""
_MOVED = "remap it, or start its node in this namespace"


def silence(topic: str, asked: End, sight: Sight) -> str:
    """Return what is seen of a topic, by its full name, on which nothing comes.

    Args:
        topic: Its full name.
        asked: Its type, and what is asked of its publishers.
        sight: What is seen.
    """
    namespace, _, name = topic.rpartition("/")
    seen = nothing_on(topic, asked, sight, advice=_ELSEWHERE.get(name, _MOVED))
    if name != "velocity" or sight.publishers.get(topic):
        return seen
    return f"{seen}; {_no_estimate(f'{namespace}/pose', sight)}"


def _no_estimate(pose: str, sight: Sight) -> str:
    """Return what is known of where a robot's velocity would come from: a tracker, and an estimator of velocities."""
    trackers = ", ".join(end.shown for end in sight.publishers.get(pose, ()))
    if not trackers:
        return f"on a robot the velocity needs a tracker that publishes {pose}"
    return f"{trackers} publishes {pose}: does fin_servo_driver's velocity_estimator run in this namespace?"
