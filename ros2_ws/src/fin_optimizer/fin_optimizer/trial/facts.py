"""The facts that a trial's conditions look at, as the node sees them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import velocity_samples
from fin_optimizer.parameters import SIMULATOR
from fin_optimizer.score.mean_speed import recent_speed
from fin_optimizer.score.swim import tail_angle
from fin_optimizer.trial.silence import silence
from fin_plant import topics
from fin_plant.discovery import ends_of, look_around, nobody_hears, wanted
from fin_plant.gait import COLUMNS
from fin_plant.plant_state import LIMITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.node import Node

    from fin_optimizer.trial.plant_client import PlantClient
    from fin_optimizer.trial.recorder import Recorder
    from fin_optimizer.trial.result import Result
    from fin_optimizer.trial.trial import Reply, Trial
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
_SLOWEST_SIMULATION = 0.01
_SLOWEST_ROBOT = 0.5
_MANY_VELOCITIES = 500
"""The last 0.5 s of a tracker with 1 kHz."""
_ROUNDING = 1e-4
"""Relative difference of two numbers that are meant to be one: people write 0.2618 rad for 15 degrees."""


class Observation:
    """What the plant, the recorder and the graph show now.

    Attributes:
        trial: Whose facts are looked at.
        bag_error: Why the bag could not be opened or closed, or empty.
        result: How the swim was scored, None before.
        other_fish: Why the fish is not the study's, or empty; None until that is known.
    """

    def __init__(self, node: Node, plant: PlantClient, recorder: Recorder, namespace: str, gait: Gait) -> None:
        self._node = node
        self._client = plant
        self._recorder = recorder
        self._namespace = namespace.rstrip("/")
        self._gait = gait
        self.trial: Trial | None = None
        self.bag_error = ""
        self.result: Result | None = None
        self.other_fish: str | None = None

    @property
    def plants(self) -> Sequence[str]:
        """Nodes that publish the plant's state."""
        return self._client.plants()

    @property
    def publishers(self) -> frozenset[str]:
        """What tells the publishers of the plant's state apart."""
        return self._client.publishers()

    def nothing_on(self, topic: str) -> str:
        """Return what the graph shows of a topic on which nothing comes."""
        name = topic.rpartition("/")[2]
        if name == topics.PLANT_STATE.name and self._client.unreadable:
            return f"what was said on topic {topic} is no plant's state: {self._client.unreadable}"
        if name == topics.GAIT_APPLIED.name and self._client.applied is not None:
            return f"the last message on topic {topic} is of a tail at rest"
        asked = _BY_NAME[name]
        if name not in _AS_PROMISED:  # the recorder hears whatever is offered
            asked = replace(asked, reliable=False, latched=False)
        return silence(topic, asked, look_around(self._node))

    @property
    def deaf_to_gait(self) -> str:
        """Why nobody hears the gait, or empty."""
        name = self._full(topics.GAIT.name)
        return nobody_hears(name, wanted(topics.GAIT), ends_of(self._node.get_subscriptions_info_by_topic(name)))

    @property
    def missing_services(self) -> Sequence[str]:
        """The plant's services that are not there."""
        return self._client.missing_services()

    @property
    def plant(self) -> PlantState | None:
        """What the plant said last."""
        return self._client.state

    @property
    def fin_reply(self) -> Reply | None:
        """Answer to the fin."""
        return self._client.fin_reply

    @property
    def reset_reply(self) -> Reply | None:
        """Answer to the reset."""
        return self._client.reset_reply

    @property
    def follows_a_gait(self) -> bool:
        """Whether the plant has said which gait it follows."""
        return self._client.applied is not None and self._client.applied.moves

    @property
    def other_gait(self) -> str:
        """Why the plant does not swim the gait that is asked for, or empty; a still tail follows none yet."""
        applied = self._client.applied
        if applied is not None and self.follows_a_gait and not applied.same_as(self._gait, _ROUNDING):
            return f"the plant swims another gait than the one asked for: {_differences(self._gait, applied)}"
        return ""

    @property
    def cut_gait(self) -> str:
        """What the plant's limits would make of the gait, or empty."""
        details = self._client.state.details if self._client.state is not None else {}
        if not set(LIMITS) <= set(details):
            return ""
        sweep, frequency = (float(details[name]) for name in LIMITS)
        cut = self._gait.limited(sweep, frequency)
        if cut.same_as(self._gait, _ROUNDING):
            return ""
        limits = f"limits.sweep = {sweep:g} rad, limits.frequency = {frequency:g} Hz"
        return f"the plant's limits ({limits}) would cut the gait: {_differences(self._gait, cut)}"

    @property
    def tail_angle(self) -> float | None:
        """Largest angle of a driven joint in rad, None before the first joint state."""
        data = self._recorder.newest(topics.JOINT_STATES)
        return None if data is None else tail_angle(data)

    @property
    def unmatched_topics(self) -> Sequence[str]:
        """Topics without publisher, and streams of which nothing has come yet: only that proves the way is open."""
        required = [*_ALWAYS_RECORDED, *self._optional_streams()]
        silent = {t.name for t in required if t in _STREAMS and not self._recorder.received(t)}
        return [self._full(name) for name in sorted({*self._recorder.unmatched(required), *silent})]

    @property
    def newest_velocity(self) -> int | None:
        """Stamp in ns of the velocity that came last."""
        return self._recorder.newest_stamp(topics.VELOCITY)

    @property
    def velocities(self) -> int:
        """Number of velocities that have come."""
        return self._recorder.received(topics.VELOCITY)

    @property
    def least_pace(self) -> float:
        """Seconds that the plant swims at least in a second: a robot's clock is the wall's, a simulator's is not."""
        return _SLOWEST_SIMULATION if self.is_simulated else _SLOWEST_ROBOT

    @property
    def drift(self) -> float | None:
        """Mean forward speed in m/s of late; a simulator puts its fish at rest."""
        if self.is_simulated:
            return 0.0
        return recent_speed(*velocity_samples(self._recorder.messages(topics.VELOCITY)[-_MANY_VELOCITIES:]))

    @property
    def is_simulated(self) -> bool:
        """Whether the plant has said that it is a simulator."""
        return self.plant is not None and self.plant.plant == SIMULATOR

    @property
    def late_topics(self) -> Sequence[str]:
        """Streams that have not reached the end of the window."""
        if self.trial is None or self.trial.window is None:
            return []
        # Of an optional stream something may have come from who publishes it no more: a bag that was played.
        streams = (*_ALWAYS_STREAMED, *self._optional_streams())
        newest = {topic.name: self._recorder.newest_stamp(topic) for topic in streams}
        end = self.trial.window.end_ns
        return [self._full(name) for name, stamp in newest.items() if stamp is not None and stamp < end]

    @property
    def recorder_failure(self) -> str:
        """Why the bag cannot be written."""
        return self.bag_error or self._recorder.failure or ""

    def _optional_streams(self) -> list[Topic[Any]]:
        """Return the streams that a plant need not have, of those that somebody publishes."""
        return [topic for topic in _RECORDED_IF_THERE if self._node.count_publishers(topic.name_in(self._namespace))]

    def _full(self, name: str) -> str:
        return f"{self._namespace}/{name}"


def _differences(asked: Gait, swum: Gait) -> str:
    """Return each number of a gait that is another one, asked and swum."""
    if len(asked.joints) != len(swum.joints):
        return f"{len(asked.joints)} driven joints asked, {len(swum.joints)} swum"
    units = dict(zip(COLUMNS, ("rad", "Hz", "rad", "rad"), strict=True))
    pairs = [
        f"joint {number}: {name} {getattr(one, name):g} {unit} asked, {getattr(other, name):g} {unit} swum"
        for number, (one, other) in enumerate(zip(asked.joints, swum.joints, strict=True), start=1)
        for name, unit in units.items()
        if getattr(one, name) != getattr(other, name)
    ]
    return "; ".join(pairs)
