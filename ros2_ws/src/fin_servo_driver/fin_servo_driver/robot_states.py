"""What a robot waits for before it may swim: a state machine that knows neither ROS, nor a port, nor a clock.

Programs ask, people confirm. `RobotStates.want_fin` and `RobotStates.request_reset` are what an optimiser may call, in
any order and as often as it likes; nothing that it calls leads on to READY where a person's answer is owed. Owed are:
the fin, once another one was wanted than the one mounted; the mark, once a reset was asked for, after an emergency stop
was released, after every fault of the device, and after another plant was seen beside this one: what is confirmed to
the one may reach the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.plant_state import EMERGENCY, RELEASE, State
from fin_servo_driver.fin_instruction import instruction
from fin_servo_driver.health import ENDED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_plant.parameters import Value

LEAST_SIGHT = 0.2
"""s for which a question must have stood before an answer counts: within less no person can have seen it."""
LONGEST_BLINK = 3.0
"""s for which nobody has looked after which a question is a new one: a driver that hung so long was shown as silent,
and who answered it meanwhile has seen no effect, and may have his hands at the tail since."""
MARK = "bring the fish back to its mark, then confirm it"
NOT_THERE = "its device is not there and may not have been told"
NOT_CONFIGURED = "the driver is not configured"


class Waiting(Enum):
    """What an operator has to do, as plant_state's detail ``waiting_for``."""

    CONFIGURING = "configuring"
    FIN = "fin"
    ARMING = "arming"
    MARK = "mark"
    RELEASE = RELEASE
    BEING_ALONE = "being alone"
    DEVICE = "device"


@dataclass(frozen=True)
class Device:
    """The device as the I/O thread has seen it.

    Attributes:
        connected: Whether it is there.
        reason: Why it is not.
        reconnects: How often it came back, from a sleep of the computer too.
        alive: Whether the thread that speaks to it runs.
    """

    connected: bool = True
    reason: str = ""
    reconnects: int = 0
    alive: bool = True

    @property
    def is_away(self) -> bool:
        """Whether a stop may not have reached it: it is not there, and was not disabled when the driver had done."""
        return not self.connected and self.reason != ENDED


@dataclass(frozen=True)
class Standing:
    """Where the robot stands: its state, why, and what an operator has to do."""

    state: State
    reason: str = ""
    waiting: Waiting | None = None


@dataclass(frozen=True)
class Answer:
    """What a question or a confirmation is answered."""

    accepted: bool
    text: str


def other_plants(topic: str, publishers: Sequence[str]) -> str:
    """Return why a plant is not alone, from the names of all nodes that publish its state's topic; empty if it is."""
    if len(publishers) < 2:  # noqa: PLR2004 - the plant itself is one
        return ""
    names = ", ".join(sorted(publishers))
    return (
        f"{len(publishers)} plants publish topic {topic} ({names}), and what is confirmed to one may reach the other: "
        "leave only one; one that was killed is seen for up to 20 s more"
    )


class RobotStates:
    """What is owed, mounted, armed and stopped.

    Attributes:
        failure: Why there is no device, empty while there is one.
        armed: Whether a person has armed the driver.
        emergency: Whether the emergency stop is latched.
        mounted: The fin that a person has confirmed, by parameter; None before.
        swimming_since: Plant's time in ns at which the tail began to move, None while it does not.
        stop_reason: Why it stopped by itself.
        others: Which plants there are beside this one, as a reason; empty while it is alone.
    """

    def __init__(self, wanted: Mapping[str, Value]) -> None:
        """Start without a device and without a fin.

        Args:
            wanted: The fin wanted, by parameter.
        """
        self.failure = NOT_CONFIGURED
        self.armed = False
        self.emergency = False
        self.mounted: Mapping[str, Value] | None = None
        self.swimming_since: int | None = None
        self.stop_reason = ""
        self.others = ""
        self._wanted = {name: wanted[name] for name in FIN_PARAMETERS}
        self._fin_owed = True
        self._mark_owed = False
        self._reconnects = 0
        self._asked: tuple[object, ...] = ()
        self._asked_at = self._looked_at = 0.0

    # -- what programs may call --------------------------------------------------------------------------------------

    def want_fin(self, values: Mapping[str, Value]) -> bool:
        """Want a fin, by parameter; return whether the one mounted is it.

        Where another one was wanted in between, somebody may be at the tail to change it: it is owed all the same.
        """
        self._wanted = {name: values[name] for name in FIN_PARAMETERS}
        self._fin_owed = self._fin_owed or self._wanted != self.mounted
        return not self._fin_owed

    def request_reset(self, device: Device | None, now: float) -> Answer:
        """Ask for the fish back at its mark; asked again while that is owed it changes nothing."""
        standing = self.look(device, now)
        if standing.state is State.FAULT or standing.waiting in {Waiting.CONFIGURING, Waiting.FIN}:
            return Answer(accepted=False, text=standing.reason)
        self._mark_owed = True
        self.look(device, now)  # the question stands from now on
        return Answer(accepted=True, text=MARK)

    # -- what people call --------------------------------------------------------------------------------------------

    def confirm_fin(self, device: Device | None, now: float) -> Answer:
        """Confirm that the fin wanted is mounted."""
        refusal = self._refusal(Waiting.FIN, "fin", device, now)
        if refusal:
            return Answer(accepted=False, text=refusal)
        self._fin_owed = False
        self.mounted = self._wanted
        return Answer(accepted=True, text="the fin is mounted")

    def confirm_mark(self, device: Device | None, now: float) -> Answer:
        """Confirm that the fish is at its mark."""
        refusal = self._refusal(Waiting.MARK, "mark", device, now)
        if refusal:
            return Answer(accepted=False, text=refusal)
        self._mark_owed = False
        return Answer(accepted=True, text="the fish is at its mark")

    def stop(self, device: Device | None) -> Answer:
        """Return what to answer to an emergency stop that was latched and handed to the device."""
        if device is None:
            return Answer(accepted=True, text="latched until ~/estop false; no port is open, so no device was told")
        if device.is_away:
            return Answer(accepted=False, text=f"latched, but {NOT_THERE}, use its switch: {device.reason}")
        return Answer(accepted=True, text="stopped; latched until ~/estop false")

    def release(self) -> Answer:
        """Release the emergency stop: the mark is owed then."""
        if not self.emergency:
            return Answer(accepted=True, text="the emergency stop was not latched")
        self._mark_owed = True  # first: another thread may look between the two
        self._asked = ()
        self.emergency = False
        return Answer(accepted=True, text="released; the fish is expected back at its mark")

    def _refusal(self, asked: Waiting, what: str, device: Device | None, now: float) -> str:
        """Return why a confirmation does not count now, or an empty text."""
        standing = self.look(device, now)
        if standing.waiting is not asked:
            because = f": {standing.reason}" if standing.reason else ""
            return f"no {what} is waited for, the plant is in {standing.state}{because}"
        if now - self._asked_at < LEAST_SIGHT:
            return f"the {what} was asked for only {now - self._asked_at:.2f} s ago: look at the robot, then confirm it"
        return ""

    # -- where it stands ---------------------------------------------------------------------------------------------

    def rest(self, reason: str = "") -> None:
        """Note that the tail swims no more."""
        self.swimming_since = None
        self.stop_reason = reason

    def look(self, device: Device | None, now: float) -> Standing:
        """Return where the robot stands at ``now`` s, any clock that does not go back.

        Args:
            device: The device, None while there is none.
            now: s.
        """
        if device is not None and (not device.connected or device.reconnects != self._reconnects):
            self._mark_owed = True
            if device.reconnects != self._reconnects:
                self._asked = ()  # the question is a new one, though nobody has looked in between
            self._reconnects = device.reconnects
        if self.others:
            self._mark_owed = True
        if now - self._looked_at > LONGEST_BLINK:
            self._asked = ()
        self._looked_at = now
        standing = self._standing(device)
        asked = (standing.waiting, *self._wanted.values()) if standing.waiting is Waiting.FIN else (standing.waiting,)
        if asked != self._asked:
            self._asked, self._asked_at = asked, now
        return standing

    def fault(self) -> None:
        """Note a fault after which the mark is owed."""
        self._mark_owed = True

    def new_device(self) -> None:
        """Note that there is a device from now on; its count of reconnects begins anew."""
        self.failure = ""
        self._reconnects = 0

    def _standing(self, device: Device | None) -> Standing:
        if self.emergency:
            untold = f"; {NOT_THERE}: {device.reason}" if device is not None and device.is_away else ""
            return Standing(State.FAULT, f"{EMERGENCY}{untold}", Waiting.RELEASE)
        if device is not None and not device.connected:
            waiting = Waiting.DEVICE if device.alive else None
            return Standing(State.FAULT, device.reason or "the device is not connected", waiting)
        if device is not None and self.others:
            return Standing(State.WAITING_FOR_RESET, self.others, Waiting.BEING_ALONE)
        return self._owed(device) or Standing(State.READY, self.stop_reason)

    def _owed(self, device: Device | None) -> Standing | None:
        """Return what a person owes, or that the fish swims; None where it could."""
        if device is None:  # a person has to do something, so it is no fault that ends a trial
            return Standing(State.WAITING_FOR_RESET, self.failure, Waiting.CONFIGURING)
        if self._fin_owed:
            text = f"mount the fin: {instruction(Fin.from_parameters(self._wanted))}"
            return Standing(State.WAITING_FOR_FIN, text, Waiting.FIN)
        if not self.armed:
            text = "the driver is not armed: hands off the tail, then activate it"
            return Standing(State.WAITING_FOR_RESET, text, Waiting.ARMING)
        if self._mark_owed:
            return Standing(State.WAITING_FOR_RESET, MARK, Waiting.MARK)
        if self.swimming_since is not None:
            return Standing(State.SWIMMING)
        return None
