"""Takes the snapshots of facts that a trial's machine looks at, from the plant, the recorder and the graph."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import velocity_samples
from fin_optimizer.score.mean_speed import recent_speed
from fin_optimizer.score.swim import tail_angle
from fin_optimizer.trial.facts import Facts
from fin_optimizer.trial.gait_check import cut_gait, other_gait
from fin_optimizer.trial.silence import silence
from fin_plant import topics
from fin_plant.discovery import ends_of, look_around, nobody_hears, wanted
from fin_plant.plant_state import PACE_OF_A_ROBOT

if TYPE_CHECKING:
    from collections.abc import Container, Sequence

    from rclpy.node import Node

    from fin_optimizer.score.mean_speed import Window
    from fin_optimizer.trial.plant_client import PlantClient
    from fin_optimizer.trial.recorder import Recorder
    from fin_plant.gait import Gait
    from fin_plant.plant_state import PlantState
    from fin_plant.topics import Topic

# A robot offers no thrust, and a pose only with a tracker: those are waited for only where somebody publishes them.
_ALWAYS_RECORDED = (
    topics.GAIT,
    topics.GAIT_APPLIED,
    topics.JOINT_STATES,
    topics.VELOCITY,
    topics.PLANT_STATE,
    topics.CANDIDATE,
)
_RECORDED_IF_THERE = (topics.POSE, topics.THRUST)
_ALWAYS_STREAMED = (topics.JOINT_STATES, topics.VELOCITY)
_STREAMS = (*_ALWAYS_STREAMED, *_RECORDED_IF_THERE)
_AS_PROMISED = (topics.PLANT_STATE.name, topics.GAIT_APPLIED.name)
"""Topics of which who comes later must get the last message."""
_BY_NAME = {topic.name: wanted(topic) for topic in topics.RECORDED_TOPICS}
_MANY_VELOCITIES = 500
"""The last 0.5 s of a tracker with 1 kHz."""


class Observer:
    """Looks at the plant, the recorder and the graph for a trial's `Facts`.

    Attributes:
        gait: What the fish is to swim.
    """

    def __init__(self, node: Node, plant: PlantClient, recorder: Recorder, namespace: str, gait: Gait) -> None:
        self._node = node
        self._client = plant
        self._recorder = recorder
        self._namespace = namespace.rstrip("/")
        self.gait = gait

    def look(self, looks_up: Container[str], window: Window | None) -> Facts:
        """Return what is seen now; what only the trial's swimmer knows is missing.

        Args:
            looks_up: Which facts of `LOOKED_UP` to take.
            window: Of the trial, None before its swim.
        """
        client, recorder = self._client, self._recorder
        state, applied = client.state, client.applied
        follows = applied is not None and applied.moves
        return Facts(
            plants=client.plants,
            publishers=client.publishers,
            missing_services=client.missing_services() if "missing_services" in looks_up else (),
            plant=state,
            fin_reply=client.fin_reply,
            reset_reply=client.reset_reply,
            cut_gait=cut_gait(state, self.gait) if "cut_gait" in looks_up else "",
            follows_a_gait=follows,
            other_gait=other_gait(applied, self.gait) if applied is not None and follows else "",
            tail_angle=self._tail_angle() if "tail_angle" in looks_up else None,
            unmatched_topics=self._unmatched_topics() if "unmatched_topics" in looks_up else (),
            newest_velocity=recorder.newest_stamp(topics.VELOCITY),
            velocities=recorder.received(topics.VELOCITY),
            least_pace=state.slowest_pace if state is not None else PACE_OF_A_ROBOT,
            drift=self._drift(state) if "drift" in looks_up else None,
            late_topics=self._late_topics(window) if "late_topics" in looks_up else (),
            recorder_failure=recorder.failure or "",
            nothing_on=self.nothing_on,
            deaf_to_gait=self._deaf_to_gait,
        )

    def nothing_on(self, topic: str) -> str:
        """Return what the graph shows of a topic, by its full name, on which nothing comes."""
        name = topic.rpartition("/")[2]
        if name == topics.PLANT_STATE.name and self._client.unreadable:
            return f"what was said on topic {topic} is no plant's state: {self._client.unreadable}"
        if name == topics.GAIT_APPLIED.name and self._client.applied is not None:
            return f"the last message on topic {topic} is of a tail at rest"
        asked = _BY_NAME[name]
        if name not in _AS_PROMISED:  # the recorder hears whatever is offered
            asked = replace(asked, reliable=False, latched=False)
        return silence(topic, asked, look_around(self._node))

    def _deaf_to_gait(self) -> str:
        name = self._full(topics.GAIT.name)
        return nobody_hears(name, wanted(topics.GAIT), ends_of(self._node.get_subscriptions_info_by_topic(name)))

    def _tail_angle(self) -> float | None:
        data = self._recorder.newest(topics.JOINT_STATES)
        return None if data is None else tail_angle(data)

    def _unmatched_topics(self) -> Sequence[str]:
        """Return topics without publisher, and streams of which nothing has come: only that proves the way is open."""
        required = [*_ALWAYS_RECORDED, *self._optional_streams()]
        silent = {t.name for t in required if t in _STREAMS and not self._recorder.received(t)}
        return [self._full(name) for name in sorted({*self._recorder.unmatched(required), *silent})]

    def _drift(self, state: PlantState | None) -> float | None:
        """Return the mean forward speed in m/s of late; 0 for a plant whose reset puts the fish at rest."""
        if state is not None and state.starts_at_rest:
            return 0.0
        return recent_speed(*velocity_samples(self._recorder.messages(topics.VELOCITY)[-_MANY_VELOCITIES:]))

    def _late_topics(self, window: Window | None) -> Sequence[str]:
        """Return the streams that have not reached the end of the window."""
        if window is None:
            return []
        # Of an optional stream something may have come from who publishes it no more: a bag that was played.
        streams = (*_ALWAYS_STREAMED, *self._optional_streams())
        newest = {topic.name: self._recorder.newest_stamp(topic) for topic in streams}
        return [self._full(name) for name, stamp in newest.items() if stamp is not None and stamp < window.end_ns]

    def _optional_streams(self) -> list[Topic[Any]]:
        """Return the streams that a plant need not have, of those that somebody publishes."""
        return [topic for topic in _RECORDED_IF_THERE if self._node.count_publishers(topic.name_in(self._namespace))]

    def _full(self, name: str) -> str:
        return f"{self._namespace}/{name}"
