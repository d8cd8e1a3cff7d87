"""Tells on a fish's topics which fin it swims, and how its trial ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Float64

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_optimizer.words import show_values, trial_name
from fin_plant import topics
from fin_plant.messages import key_values

if TYPE_CHECKING:
    from rclpy.node import Node

    from fin_optimizer.study.candidate import TrialRecord


class Announcer:
    """Publishes a fish's ``candidate`` and ``score``.

    Args:
        node: Node that publishes.
        namespace: Of the fish, absolute.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self._candidate, self._score = (
            node.create_publisher(topic.type, topic.name_in(namespace), topic.qos)
            for topic in (topics.CANDIDATE, topics.SCORE)
        )

    def tell(self, record: TrialRecord) -> None:
        """Say which fin swims, or how it ended."""
        values: dict[str, object] = {
            "trial": record.number,
            "fin": record.candidate + 1,
            **record.values,
            "outcome": record.outcome.value,
        }
        others = {MEASURES[name].column: value for name, value in record.measured.items() if name != MEAN_SPEED}
        known = {"score [m/s]": record.score, **others, "reason": record.reason or None}
        values |= {name: value for name, value in known.items() if value is not None}
        level = DiagnosticStatus.WARN if record.reason else DiagnosticStatus.OK
        shown = f"{trial_name(record.number)}: {show_values(record.values)}"
        self._candidate.publish(
            DiagnosticStatus(
                level=level,
                name="candidate",
                message=shown,
                hardware_id=record.plant or "study",
                values=key_values(values),
            )
        )
        if record.score is not None:
            self._score.publish(Float64(data=record.score))
