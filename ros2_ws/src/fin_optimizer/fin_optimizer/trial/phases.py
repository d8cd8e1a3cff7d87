"""The table of a trial's phases: what begins each, what ends it, and what holds while it lasts. Without ROS or clock.

`PHASES` is the trial. A phase begins with an action, which the swimmer carries out, and lasts until its condition
holds. Its rules say what else ends the trial in it, and what is made of an end. The guards, which the table names, look
at `Facts` and at the trial's `Course`, and change nothing.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from enum import Enum, Flag, auto
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_plant.plant_state import State
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_optimizer.score.mean_speed import Measurement, Window
    from fin_optimizer.trial.facts import Facts
    from fin_plant.parameters import Value
    from fin_plant.plant_state import PlantState

_WAITING = (State.WAITING_FOR_FIN, State.WAITING_FOR_RESET)
STRAIGHT = 0.05
"""rad. In a rehearsal a tail that began at 0.06 rad changed a score by 1.4 %, at 0.2 rad by 8 %."""
_LONG = 1000.0
"""s. From here on whole seconds tell enough."""


class Action(Enum):
    """What the swimmer does when a phase begins."""

    RECOVER = "ask the plant for a reset, which clears a simulator's fault"
    SET_FIN = "set the candidate's parameters, all at once"
    RESET = "ask the plant for the fish at rest at its start"
    OPEN_BAG = "open the trial's bag"
    GAIT_ON = "send the gait, and repeat it"
    GAIT_OFF = "send a gait of zero amplitude"
    CLOSE_BAG = "close the trial's bag"
    SCORE = "score the swim"


class Rule(Flag):
    """What holds in a phase."""

    ONE_PLANT = auto()
    """A second plant ends the trial."""
    NO_FAULT = auto()
    """A fault ends the trial; before, it is an earlier trial's, and the trial's first care is to clear it."""
    SAME_PLANT = auto()
    """The plant has taken the fin: one that is started now, or the want of any, ends the trial."""
    SAME_FIN = auto()
    """The fin must stay mounted."""
    ATTEMPT = auto()
    """A failure counts as an attempt at the fin; before, nothing has happened that could tell anything of it."""
    VELOCITY = auto()
    """The trial may fail for want of velocity."""
    SWIMS = auto()
    """The fish swims: only time that it has swum is progress, and a plant that stops ends the trial."""


ONE_PLANT, NO_FAULT, SAME_PLANT = Rule.ONE_PLANT, Rule.NO_FAULT, Rule.SAME_PLANT
SAME_FIN, ATTEMPT, VELOCITY, SWIMS = Rule.SAME_FIN, Rule.ATTEMPT, Rule.VELOCITY, Rule.SWIMS


@dataclass(frozen=True)
class Timeouts:
    """How long a phase may last without a sign of progress, in s of the wall clock.

    Attributes:
        find: Until a plant is found with its services.
        plant: Until the plant is at rest, ready and matched.
        reply: Until a service answers.
        silence: Until velocities have carried a swim on, or until the next state around it.
        rest: Until the water is still, and the fish with it.
        people: Until somebody has mounted a fin or brought the fish back to its mark; 0 waits for ever.
    """

    find: float = 60.0
    plant: float = 10.0
    reply: float = 10.0
    silence: float = 5.0
    rest: float = 60.0
    people: float = 0.0

    def __post_init__(self) -> None:
        for name in ("find", "plant", "reply", "silence", "rest"):
            checks.number(f"timeout.{name}", getattr(self, name), 0.0, unit="s", exclusive_minimum=True)
        checks.number("timeout.people", self.people, 0.0, unit="s")


@dataclass
class Course:
    """What a trial remembers from one look to the next. Its machine writes it, the guards only read it.

    Attributes:
        namespace: Of the fish, for example ``/fish``; only for messages.
        fin: The fin that is tried, by the plant's parameters, in SI units.
        measurement: Which part of the swim is scored, and what a swim must be to be scored.
        timeouts: How long to wait for what.
        window: Over which it is scored, None until the fish swims.
        swimming_since: Plant's time in ns at which the swim began.
        reset_after: Plant's time in ns of the last state that was said before the reset.
        swum: How far into the swim the velocities reach, in s of the plant's time.
        swum_before: The same when progress was last made.
        velocities_before: Number of velocities that had come when progress was last made.
    """

    namespace: str
    fin: Mapping[str, Value]
    measurement: Measurement
    timeouts: Timeouts
    window: Window | None = None
    swimming_since: int = 0
    reset_after: int = -1
    swum: float = 0.0
    swum_before: float = 0.0
    velocities_before: int = 0

    def topic(self, name: str) -> str:
        """Return the full name of one of the fish's topics."""
        return f"{self.namespace.rstrip('/')}/{name}"


@dataclass(frozen=True)
class Phase:
    """A row of the trial's table.

    Attributes:
        name: As it is shown.
        action: What begins it; None for phases that only wait. A function chooses by the facts.
        done: Whether it is over.
        patience: Name of the timeout that bounds it.
        missing: What was missing if time runs out.
        rules: What holds in it.
        looks_up: Facts of `LOOKED_UP` that it asks for.
    """

    name: str
    action: Action | Callable[[Facts], Action | None] | None
    done: Callable[[Course, Facts], bool]
    patience: str
    missing: Callable[[Course, Facts], str]
    rules: Rule
    looks_up: frozenset[str] = frozenset()


def because(plant: PlantState) -> str:
    """Return the reason that a plant gives for its state, in brackets, or nothing."""
    return f" ({plant.reason})" if plant.reason else ""


def says(course: Course, facts: Facts) -> str:
    """Return what the plant says of its state, for a message."""
    if facts.plant is None:
        return f"nothing was said on topic {course.topic('plant_state')}"
    return f"topic {course.topic('plant_state')} says {facts.plant.state}{because(facts.plant)}"


def is_in(facts: Facts, *states: State) -> bool:
    """Whether the plant says that it is in one of these states."""
    return facts.plant is not None and facts.plant.state in states


def no_plant(course: Course, facts: Facts) -> str:
    """Return why there is no plant to speak to."""
    topic = course.topic("plant_state")
    if not facts.plants:
        return facts.nothing_on(topic)
    if len(facts.plants) > 1:
        return f"topic {topic} has {len(facts.plants)} publishers ({', '.join(facts.plants)}): leave only one plant"
    missing = [f"service {' and '.join(facts.missing_services)} missing"] if facts.missing_services else []
    if facts.plant is None:
        missing.append(facts.nothing_on(topic))
    return "; ".join(missing) or says(course, facts)


def same_value(text: str, value: Value) -> bool:
    """Whether a key-value of the plant's state, which has all digits of a number, says ``value``."""
    if isinstance(value, str):
        return text == value
    try:
        said = json.loads(text)
    except ValueError:
        return False
    return bool(said == (list(value) if isinstance(value, list | tuple) else value))


def _wrong(course: Course, facts: Facts) -> list[str]:
    """Return the names of the fin's parameters in which the fin mounted differs from the trial's."""
    mounted = facts.plant.fin if facts.plant is not None else {}
    return [name for name, value in course.fin.items() if not same_value(mounted.get(name, ""), value)]


def fin_differences(course: Course, facts: Facts) -> str:
    """Return in what the fin mounted differs from the trial's, or an empty text."""
    mounted = facts.plant.fin if facts.plant is not None else {}
    wrong = _wrong(course, facts)
    return ", ".join(f"{name} = {mounted.get(name, 'nothing')} instead of {course.fin[name]}" for name in wrong)


def _fin_not_ready(course: Course, facts: Facts) -> str:
    differs = fin_differences(course, facts)
    return f"{says(course, facts)}, needed is READY" + (f"; the fin mounted has {differs}" if differs else "")


def _at_start(course: Course, facts: Facts) -> bool:
    """Whether the plant is ready and said so after the reset, not in a message still on its way."""
    return (
        is_in(facts, State.READY)
        and facts.plant is not None
        and facts.plant.stamp > course.reset_after
        and not _wrong(course, facts)
        and _is_straight(facts)
        and facts.other_fish is not None
    )


def _is_straight(facts: Facts) -> bool:
    return facts.tail_angle is None or facts.tail_angle <= STRAIGHT


def _not_at_start(course: Course, facts: Facts) -> str:
    if facts.other_fish is None:
        return _service(facts, "get_parameters")
    if _is_straight(facts):
        return _fin_not_ready(course, facts)
    angle = math.degrees(facts.tail_angle or 0.0)
    return (
        f"the tail stands at {angle:.1f} degrees, and a swim begins with a straight one, within "
        f"{math.degrees(STRAIGHT):.0f} degrees: straighten it by hand"
    )


def _service(facts: Facts, name: str) -> str:
    plant = facts.plants[0] if len(facts.plants) == 1 else "the plant"
    return f"no answer from service {plant}/{name}"


def _velocity_after(course: Course, facts: Facts, end: int) -> bool:
    return course.window is not None and facts.newest_velocity is not None and facts.newest_velocity >= end


def _seconds(time: float) -> str:
    return f"{time:.3g} s" if time < _LONG else f"{time:.0f} s"


def _no_progress(course: Course, facts: Facts) -> str:
    """Return what is wrong with the velocities of a swim that does not go on."""
    topic, came = course.topic("velocity"), facts.velocities - course.velocities_before
    if not came or facts.newest_velocity is None:
        return f"no message on topic {topic} after {course.swum:.2f} s of the swim"
    behind = (course.swimming_since - facts.newest_velocity) / NANOSECONDS
    if behind > 0.0:
        return (
            f"{came} messages came on topic {topic}, the last one stamped {_seconds(behind)} before the start of "
            "the swim: its clock is not the plant's"
        )
    advanced = course.swum - course.swum_before
    return (
        f"{came} messages came on topic {topic}, but their stamps advanced by only {_seconds(advanced)}: needed "
        f"are {_seconds(facts.least_pace * course.timeouts.silence)}"
    )


def _at_rest(course: Course, facts: Facts) -> bool:
    return is_in(facts, State.READY) and facts.drift is not None and not course.measurement.no_rest(facts.drift)


def _no_rest(course: Course, facts: Facts) -> str:
    if not is_in(facts, State.READY):
        return f"{says(course, facts)}, needed is READY"
    if facts.drift is None:
        return f"too few messages on topic {course.topic('velocity')} tell whether the fish is at rest"
    return f"{course.measurement.no_rest(facts.drift)}: wait until the water is still, then bring it to its mark again"


def _still_swimming(course: Course, facts: Facts) -> str:
    if facts.late_topics and is_in(facts, State.READY, *_WAITING):
        return f"no message up to the end of the window on topic {', '.join(facts.late_topics)}"
    return f"the gait is off, but {says(course, facts)}"


def _nothing_to_record(_: Course, facts: Facts) -> str:
    seen = "; ".join(facts.nothing_on(topic) for topic in facts.unmatched_topics)
    return f"nothing to record on topic {', '.join(facts.unmatched_topics)}: {seen}"


def _no_effect(course: Course, facts: Facts) -> str:
    if is_in(facts, State.SWIMMING):
        return f"it is not told which gait the plant swims: {facts.nothing_on(course.topic('gait_applied'))}"
    why = facts.deaf_to_gait()
    deaf = f"; {why}" if why else ""
    return f"the gait on topic {course.topic('gait')} had no effect: {says(course, facts)}{deaf}"


PHASES: tuple[Phase, ...] = (
    Phase(
        "find the plant",
        action=None,
        done=lambda _, facts: len(facts.plants) == 1 and not facts.missing_services and facts.plant is not None,
        patience="find",
        missing=no_plant,
        rules=Rule(0),
        looks_up=frozenset({"missing_services"}),
    ),
    Phase(
        "wait until it is at rest",
        action=lambda facts: Action.RECOVER if is_in(facts, State.FAULT) else None,
        done=lambda _, facts: is_in(facts, State.READY, *_WAITING),
        patience="plant",
        missing=lambda course, facts: f"{says(course, facts)}, needed is READY",
        rules=ONE_PLANT,
        looks_up=frozenset({"cut_gait"}),
    ),
    Phase(
        "set the fin",
        action=Action.SET_FIN,
        done=lambda _, facts: facts.fin_reply is not None,
        patience="reply",
        missing=lambda _, facts: _service(facts, "set_parameters_atomically"),
        rules=ONE_PLANT | NO_FAULT,
    ),
    Phase(
        "wait for the fin",
        action=None,
        done=lambda course, facts: is_in(facts, State.READY, State.WAITING_FOR_RESET) and not _wrong(course, facts),
        patience="plant",
        missing=_fin_not_ready,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT,
        looks_up=frozenset({"cut_gait"}),  # of a driver that is configured only now
    ),
    Phase(
        "reset",
        action=Action.RESET,
        done=lambda _, facts: facts.reset_reply is not None,
        patience="reply",
        missing=lambda _, facts: _service(facts, "request_reset"),
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT,
    ),
    Phase(
        "wait at the start",
        action=None,
        done=_at_start,
        patience="plant",
        missing=_not_at_start,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT,
        looks_up=frozenset({"tail_angle", "cut_gait"}),
    ),
    Phase(
        "open the bag",
        action=Action.OPEN_BAG,
        done=lambda _, facts: not facts.unmatched_topics,
        patience="plant",
        missing=_nothing_to_record,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | VELOCITY,
        looks_up=frozenset({"unmatched_topics"}),
    ),
    Phase(
        "wait until the water is still",
        action=None,
        done=_at_rest,
        patience="rest",
        missing=_no_rest,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | VELOCITY,
        looks_up=frozenset({"drift"}),
    ),
    Phase(
        "start the gait",
        action=Action.GAIT_ON,
        done=lambda _, facts: is_in(facts, State.SWIMMING) and facts.follows_a_gait,
        patience="silence",
        missing=_no_effect,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT,
    ),
    Phase(
        "settle",
        action=None,
        done=lambda course, facts: _velocity_after(course, facts, course.window.start_ns if course.window else 0),
        patience="silence",
        missing=_no_progress,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT | VELOCITY | SWIMS,
    ),
    Phase(
        "measure",
        action=None,
        done=lambda course, facts: _velocity_after(course, facts, course.window.end_ns if course.window else 0),
        patience="silence",
        missing=_no_progress,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT | VELOCITY | SWIMS,
    ),
    Phase(
        "stop the gait",
        action=Action.GAIT_OFF,
        done=lambda _, facts: is_in(facts, State.READY, *_WAITING) and not facts.late_topics,
        patience="silence",
        missing=_still_swimming,
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT | VELOCITY,
        looks_up=frozenset({"late_topics"}),
    ),
    Phase(
        "close the bag",
        action=Action.CLOSE_BAG,
        done=lambda *_: True,
        patience="reply",
        missing=lambda *_: "the bag was not closed",
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT,
    ),
    Phase(
        "score",
        action=Action.SCORE,
        done=lambda _, facts: facts.result is not None,
        patience="reply",
        missing=lambda *_: "no score",
        rules=ONE_PLANT | NO_FAULT | SAME_PLANT | SAME_FIN | ATTEMPT | VELOCITY,
    ),
)
