"""What the person at the tank should do now, by what the robot waits for: for every program that says so.

Nothing is confirmed by itself, nor by a key that bounces or a finger that taps twice: an answer counts for a step only
after the step was on the screen for a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant.plant_state import State
from fin_servo_driver.robot_states import NOT_THERE

if TYPE_CHECKING:
    from fin_plant.plant_state import PlantState

CALM = 1.0
"""s for which a step must be on the screen before an answer to it counts."""
SILENT = 3.0
"""s without a word from the driver, which speaks once a second, after which what it said last is not shown as true."""
NOTHING_ASKED = "nothing to confirm"
SWITCH = "The robot may still move: use the switch of its servos."
"""What is left to do where nobody answers."""


@dataclass(frozen=True)
class Controls:
    """How a program is told things, as its sentences name it, each beginning with a small letter.

    Attributes:
        confirm: To say that what is asked for is done, for example ``press Enter``.
        release: To release an emergency stop.
        stop: What stops the robot.
    """

    confirm: str
    release: str
    stop: str


KEYBOARD = Controls("press Enter", "press r", "the space bar")

_WAITING = {
    "configuring": ("{Confirm} to open the port and check the device. Nothing moves by that.", "configure"),
    "fin": ("Mount this fin. When it is on and nobody's hands are near the tail, {confirm}.", "confirm_fin"),
    "arming": ("Hands off the tail. {Confirm} to ARM the driver: from then on a gait moves it.", "activate"),
    "being alone": ("End the other plant, or give it a namespace of its own. Until then nothing is confirmed.", ""),
    "mark": ("Bring the fish back to its mark and let the water settle. Then {confirm}.", "confirm_mark"),
}
"""What to do, and what a confirmation then asks for, by what the driver waits for."""
EMERGENCY = "emergency stop"
_FAULTS = (
    (NOT_THERE, f"{{Stop}} has not reached the device. {SWITCH} When all is safe, {{release}} to release the stop."),
    (EMERGENCY, "Stopped. When all is safe, {release} to release the emergency stop."),
    ("request_reset", "The simulated fish has stopped. Nothing to do: the study's next trial puts it back to rest."),
    ("I/O thread", "The driver has failed and moves nothing any more. Look at its log, then start it anew."),
    ("", "Check cable and power; the driver reconnects by itself."),
)
"""The same by a part of the fault's reason; the last one fits every reason."""


def next_step(state: PlantState | None, controls: Controls = KEYBOARD) -> tuple[str, str]:
    """Return what the operator should do now, and what a confirmation asks for: an action's name, or an empty text."""
    if state is None:
        advice, action = "Waiting for the servo driver. Start it with plant:=robot.", ""
    elif state.state is State.FAULT:
        advice, action = next(advice for cause, advice in _FAULTS if cause in state.reason), ""
    else:
        waiting = state.details.get("waiting_for", "")
        advice, action = _WAITING.get(waiting, ("Nothing to do. {Stop} stops the fish.", ""))
    words = {"confirm": controls.confirm, "release": controls.release, "stop": controls.stop}
    capitals = {name.capitalize(): text[:1].upper() + text[1:] for name, text in words.items()}
    return advice.format(**words, **capitals), action


def advice_says_all(state: PlantState) -> bool:
    """Whether the state's reason adds nothing to what `next_step` says."""
    if NOT_THERE in state.reason:
        return False
    return EMERGENCY in state.reason or state.details.get("waiting_for") in {"fin", "arming", "mark"}


def question(state: PlantState | None) -> tuple[str, ...]:
    """Return the action that a state asks for, and after it all that tells this question from every other one.

    Its stamp does not: a driver that is asked for the same fin again and again tells the same state anew.
    """
    if state is None:
        return ("", "")
    return (next_step(state)[1], state.reason, *state.details.values())


def too_new(shown_for: float, controls: Controls = KEYBOARD) -> str:
    """Return why an answer does not count that came so many s after its step was shown; empty where it does."""
    return "" if shown_for >= CALM else f"this came with a new step: read it, then {controls.confirm} again"
