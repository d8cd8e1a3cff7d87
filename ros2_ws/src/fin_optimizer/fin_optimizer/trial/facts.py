"""What a trial's machine looks at: a snapshot of plain values, taken anew at each look and written into by nobody."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant.plant_state import PACE_OF_A_ROBOT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_optimizer.trial.result import Result
    from fin_plant.plant_state import PlantState


def _nothing_more(_: str) -> str:
    return ""


def _nobody_is_deaf() -> str:
    return ""


@dataclass(frozen=True)
class Reply:
    """What a service answered."""

    accepted: bool
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What is seen of a fish at one moment; those of `LOOKED_UP` have their defaults in phases that ask for others.

    Attributes:
        plants: Full names of the nodes that publish ``plant_state`` in the namespace.
        publishers: What tells each publisher of ``plant_state`` from one that is started later under the same name.
        missing_services: Full names of the plant's services that are not there.
        plant: Newest state of the plant.
        fin_reply: Answer to SET_FIN, None until it has come.
        reset_reply: Answer to RESET or RECOVER, likewise.
        other_fish: Why the plant's fish is not that of the study, or empty; None until the plant has told what swims.
        cut_gait: What the plant's limits would make of the gait, or empty; anything else ends the trial.
        follows_a_gait: Whether the plant has said, since GAIT_ON, which gait it follows.
        other_gait: Why the plant swims another gait than the one asked for, or empty.
        tail_angle: Largest angle of a driven joint in rad, as said last; None before.
        unmatched_topics: Full names of the topics to record from which nothing can arrive yet.
        newest_velocity: Stamp in ns of the velocity that came last.
        velocities: Number of velocities that have come.
        least_pace: Seconds of its own time that the plant swims at least in a second of the wall clock.
        drift: Mean forward speed in m/s of late, 0 for a plant that is at rest by nature; None before it is known.
        late_topics: Full names of the recorded streams whose newest stamp is before the end of the trial's window.
        recorder_failure: Why the bag cannot be written, or empty.
        result: Outcome of SCORE, None until it is carried out.
        nothing_on: Tells what the graph shows of a topic, by its full name, on which nothing comes. It is asked only
            when time has run out, because it takes long.
        deaf_to_gait: Tells why nobody hears the gait, or nothing; likewise.
    """

    plants: Sequence[str] = ()
    publishers: frozenset[str] = frozenset()
    missing_services: Sequence[str] = ()
    plant: PlantState | None = None
    fin_reply: Reply | None = None
    reset_reply: Reply | None = None
    other_fish: str | None = None
    cut_gait: str = ""
    follows_a_gait: bool = False
    other_gait: str = ""
    tail_angle: float | None = None
    unmatched_topics: Sequence[str] = ()
    newest_velocity: int | None = None
    velocities: int = 0
    least_pace: float = PACE_OF_A_ROBOT
    drift: float | None = None
    late_topics: Sequence[str] = ()
    recorder_failure: str = ""
    result: Result | None = None
    nothing_on: Callable[[str], str] = _nothing_more
    deaf_to_gait: Callable[[], str] = _nobody_is_deaf


LOOKED_UP = frozenset({"missing_services", "cut_gait", "tail_angle", "unmatched_topics", "drift", "late_topics"})
"""Facts that cost a question to the middleware or the reading of messages: taken only in phases that ask for them."""
