"""What alone speaks to the device, turn by turn: reads the mailbox, ticks the tail, sends, listens, reconnects.

The command watchdog ticks here, so that a node that hangs cannot keep the tail moving. A cut ends whatever is under way
on the line; the next frame takes the force away. So does the end of the loop, and neither moves the tail: only a tail
that is led to rest, tick by tick, goes to neutral.

No thread is started here, and the clock is handed in: `io_thread` gives the loop a thread on this machine's clock.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

from fin_servo_driver.backends.backend import Feedback
from fin_servo_driver.clock import seconds_asleep
from fin_servo_driver.health import Health, Sample
from fin_servo_driver.line import DeviceError, LineStalledError, Stop, StopAskedError, StoppableLine
from fin_servo_driver.mailbox import Mailbox
from fin_servo_driver.port import BackOff, is_present
from fin_servo_driver.tail import Phase, Tail

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.clock import Clock
    from fin_servo_driver.line import Line, OpenLine
    from fin_servo_driver.set_points import Motion, Outputs
    from fin_servo_driver.tail import Command, Settings

STALLED_SECONDS = 0.5
"""s without one frame that got through, after which the line counts as lost."""
REPEAT_SECONDS = 0.5
"""s between two times at which a device at rest that confirms nothing is told to disable: the frame may be lost."""
_LATENESSES_KEPT = 1000
_SAMPLES_KEPT = 1000
_IDLE_LOOK = 0.05
_FAULT_SHOWN = 5.0
"""s for which a complaint of the device is told; one that goes on is told anew."""
_START_SECONDS = 0.2
"""s for which a start is tried again while the servos do not tell where they stand."""
_SLEPT_SECONDS = 0.5
"""s of sleep of the machine that count; less may be the time between a look at the one clock and at the other."""
_DRAIN_SECONDS = 0.1
"""s in which the last frames get out before the port is closed."""


class _Force(Enum):
    """Whether the device gives force."""

    RELEASED = "told to disable"
    UNSURE = "enabling or disabling it has not gone through"
    ENABLED = "holds what it is sent"


class DeviceLoop:
    """Owns the line from `connect` to `finish`; in between `turn` is called again and again.

    Attributes:
        mailbox: Where commands are left.
        samples: Joint angles of the last ticks, for who takes them out.
        health: The newest snapshot.
    """

    def __init__(
        self,
        backend: Backend,
        motion: Motion,
        settings: Settings,
        open_line: Callable[[], OpenLine],
        port: str,
        report: Callable[[str], None],
        clock: Clock = time,
        asleep: Callable[[], float] = seconds_asleep,
    ) -> None:
        """Take what the thread works with; nothing is opened yet.

        Args:
            backend: The device.
            motion: The tail.
            settings: Timeout and ramp, see `set_settings`.
            open_line: Opens the port; raises PortUnavailableError.
            port: Its name, to see whether it is there.
            report: Takes a text for the log.
            clock: What counts as the time.
            asleep: Returns for how many s the machine has slept, which no clock counts that stands meanwhile.
        """
        self.mailbox = Mailbox()
        self.samples: deque[Sample] = deque(maxlen=_SAMPLES_KEPT)
        self.health = Health()
        self._backend = backend
        self._motion = motion
        self._tail = Tail(motion, settings)
        self._open_line = open_line
        self._port = port
        self._report = report
        self._clock = clock
        self._asleep = asleep
        self._slept = asleep()
        self._line: StoppableLine | None = None
        self._was_identified = False
        self._force = _Force.RELEASED
        self._disabled_at = 0.0
        self._feedback = Feedback()
        self._last_good = self._due = 0.0
        self._back_off = BackOff()
        self._latenesses: deque[float] = deque(maxlen=_LATENESSES_KEPT)
        self._fault_at = 0.0
        self._commanded = -math.inf
        self._asked: deque[tuple[str, float]] = deque()
        self._stop = Stop()
        self._is_ending = False

    # -- what other threads may call -----------------------------------------------------------------------------------

    def arm(self) -> None:
        """Allow motion from the next command on."""
        self._ask("arm")

    def disarm(self) -> None:
        """Lead the tail to neutral, then disable."""
        self._ask("disarm")

    def stop_tail(self) -> None:
        """Lead the tail to neutral, then disable; the next command moves it again."""
        self._ask("stop")

    def cut(self) -> None:
        """Disable at once, whatever is under way: no frame that moves or enables goes out after this has returned."""
        self._stop.ask()
        self._wake_up()

    def end(self) -> None:
        """Ask the loop to disable the device and end, whatever is under way; a signal's handler may call it."""
        self._is_ending = True
        self._stop.ask()
        self._wake_up()

    def set_settings(self, settings: Settings) -> None:
        """Change timeout and ramp; the ramp counts from the next start on."""
        self._tail.settings = settings

    def latenesses(self) -> list[float]:
        """Return how late in s the last ticks were, and forget them."""
        kept = list(self._latenesses)
        self._latenesses.clear()
        return kept

    @property
    def is_asked(self) -> bool:
        """Whether something was asked for that is not begun."""
        return bool(self._asked) or self._stop.asked

    @property
    def rated_operations(self) -> int:
        """After how many operations a relay should be replaced."""
        return self._backend.robot.timing.rated_operations

    def _ask(self, what: str) -> None:
        self._asked.append((what, self._clock.monotonic()))
        self._wake_up()

    def _wake_up(self) -> None:
        """Let the next turn begin at once, where somebody waits for it; a signal's handler may call it."""

    # -- the loop ------------------------------------------------------------------------------------------------------

    def turn(self) -> float | None:
        """Do what was asked for and what is due; return for how many s nothing else is, or None at the end."""
        self._see_sleep()
        now = self._clock.monotonic()
        if not self._obey():
            return None
        with contextlib.suppress(StopAskedError):  # `_obey` carries it out
            if self._line is None:
                self._reconnect(now)
                self._due = self._clock.monotonic()
            elif now >= self._due:
                self._due = self._next_after(now)
                self._guarded_tick(now)
        self._publish_health()
        return max(0.0, self._due - self._clock.monotonic()) if self._line else _IDLE_LOOK

    def finish(self, reason: str) -> None:
        """Make the device safe, close the port and say so; each step is done whatever becomes of the others."""
        try:
            self._make_safe()
        finally:
            try:
                self._disconnect()
            finally:
                self._tail.phase = Phase.DISARMED
                self.health = replace(self.health, connected=False, phase=Phase.DISARMED, still=True, reason=reason)

    def _see_sleep(self) -> None:
        """Take the force away after a sleep of the machine: nobody who wakes it expects the swim to go on."""
        in_all = self._asleep()
        slept, self._slept = in_all - self._slept, max(self._slept, in_all)
        if slept <= _SLEPT_SECONDS:
            return
        self.mailbox.take()
        self._tail.cut(self._clock.monotonic())
        self._make_safe()
        self.health = replace(self.health, reconnects=self.health.reconnects + 1)
        self._publish_health()
        self._report(
            f"the computer has slept for {slept:.0f} s: the force is taken away, the tail waits for a fresh gait"
        )

    def _next_after(self, now: float) -> float:
        """Note how late the tick is that is due, and return when the next one is."""
        late, period = now - self._due, 1.0 / self._backend.rate
        self._latenesses.append(late)
        missed = int(late / period)
        if missed and self._force is _Force.ENABLED:
            self.health = replace(self.health, missed=self.health.missed + missed)
        return self._due + (missed + 1) * period

    def _obey(self) -> bool:
        """Do what the node has asked for; return False to end. Commands received before it count no more."""
        if self._is_ending:
            return False
        if self._stop.asked:
            self._stop.begin()
            self._tail.cut(self._clock.monotonic())
            self._make_safe()
            self._publish_health()
        while self._asked:
            what, asked_at = self._asked.popleft()
            self._tail.refuse_before(asked_at)
            now = self._clock.monotonic()
            match what:
                case "arm":
                    self._tail.arm(now)
                case "disarm":
                    self._tail.disarm(now)
                case "stop":
                    self._tail.stop(now)
            self._publish_health()
        return True

    def _guarded_tick(self, now: float) -> None:
        try:
            self._tick(now)
            self._last_good = now
        except StopAskedError:
            raise
        except LineStalledError as error:
            self.health = replace(self.health, dropped=self.health.dropped + 1)
            self._note_fault(str(error))
            if self._clock.monotonic() - self._last_good > STALLED_SECONDS:
                self._lose(str(error))
        except DeviceError as error:
            self._lose(str(error))

    def _tick(self, now: float) -> None:
        line = self._line
        if line is None:
            return
        command = self.mailbox.take()
        if command is not None:
            self._take(command)
            self._commanded = command.time
            self._publish_health()  # at once: to enable the device may take longer than the node waits
        if self._force is not _Force.ENABLED and self._tail.phase is Phase.STOPPING:
            self._tail.cut(now)  # nothing has moved yet
        if self._force is not _Force.ENABLED and self._tail.phase is Phase.FOLLOWING:
            self._enable(line)  # the first set-point is computed afterwards, at the next tick
        elif (outputs := self._tail.tick(now)) is not None:
            self._send(line, outputs)
        elif self._force is not _Force.RELEASED:
            self._disable(line)  # until that has worked it is tried at each tick
        elif not self._backend.confirms and now - self._disabled_at >= REPEAT_SECONDS:
            self._disable(line)
        self._listen(line, now)

    def _take(self, command: Command) -> None:
        if self._tail.phase is not Phase.SILENT or not self._tail.accepts(command):
            self._tail.command(command, {})
            return
        refusal = self._cannot_start()
        self.health = replace(self.health, refusal=refusal)
        if not refusal:
            self._tail.command(command, self._feedback.positions)
        elif self._clock.monotonic() - command.time < _START_SECONDS:
            self.mailbox.put_back(command)

    def _cannot_start(self) -> str:
        """Return why the tail must not start from where it stands, or an empty text; it could only jump from there."""
        if not self._backend.measures:
            return ""
        for number, joint in enumerate(self._backend.robot.servos, start=1):
            position = self._feedback.positions.get(joint.channel)
            if position is None:
                return f"joint {number}: its servo does not tell where it stands"
            if not joint.lowest <= position <= joint.highest:
                allowed = f"[{joint.lowest:g}, {joint.highest:g}] {self._backend.unit}"
                return f"joint {number} stands at {position:g}, outside {allowed}: bring the tail inside by hand"
        return ""

    def _enable(self, line: StoppableLine) -> None:
        _refuse_if_behind(line)
        self._force = _Force.UNSURE  # what fails half-way is done anew, or disabled
        self._backend.enable(line, self._motion.neutral())
        if self._backend.measures:
            self._stand(line)
        self._force = _Force.ENABLED

    def _stand(self, line: StoppableLine) -> None:
        """Begin from where the servos hold now; until they had force somebody may have moved them.

        Raises:
            LineStalledError: They do not tell.
        """
        self._feedback = self._backend.read(line)
        if refusal := self._cannot_start():
            raise LineStalledError(refusal)
        self._motion.stand_at(self._feedback.positions)

    def _disable(self, line: Line) -> None:
        self._force = _Force.UNSURE
        self._backend.disable(line)
        self._force = _Force.RELEASED
        self._disabled_at = self._clock.monotonic()

    def _send(self, line: StoppableLine, outputs: Outputs) -> None:
        try:
            _refuse_if_behind(line)
            self._backend.send(line, outputs)
        except DeviceError:
            self._motion.not_sent()
            raise
        self._motion.sent(self._clock.monotonic())
        self.health = replace(self.health, ticks=self.health.ticks + 1)

    def _listen(self, line: StoppableLine, now: float) -> None:
        feedback = self._backend.read(line)
        if feedback.voltage is not None or feedback.temperature is not None:
            self.health = replace(self.health, voltage=feedback.voltage, temperature=feedback.temperature)
        if feedback.fault:
            self._note_fault(feedback.fault)
        if not feedback.positions_asked:
            return  # where the servos stand is known from the tick before
        self._feedback = feedback
        if self._tail.phase is Phase.DISARMED:
            return
        servos = self._backend.robot.servos
        measured = bool(servos) and all(joint.channel in feedback.positions for joint in servos)
        if measured:
            angles = [joint.angle_at(feedback.positions[joint.channel]) for joint in servos]
        else:
            angles = self._motion.angles if self._force is _Force.ENABLED else [0.0] * self._motion.joints
        self.samples.append(Sample(now, tuple(angles), measured))

    def _note_fault(self, text: str) -> None:
        self._fault_at = self._clock.monotonic()
        self.health = replace(self.health, fault=text)

    # -- the line ----------------------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open and identify the device.

        Raises:
            DeviceError: Port or device are not as configured, or a stop was asked for; nothing stays open.
        """
        line = StoppableLine(self._open_line(), self._stop)
        try:
            if self._was_identified and self._backend.can_be_disabled_unseen:
                # It may have kept its power, and what it was told last; to identify it may take half a second.
                with contextlib.suppress(LineStalledError):
                    self._backend.disable(line)
            identity = self._backend.identify(line)
            self._disable(line)  # whatever an earlier driver, or this one before the cable was out, has left
        except BaseException as error:
            # One servo of several may be missing, or somebody has cut: none may keep force, not one that an earlier
            # driver has left either. Otherwise a device that has never been the right one is left alone.
            cut = isinstance(error, StopAskedError) and not self._is_ending
            if self._was_identified or cut:
                self._cut(line.raw)
            line.raw.close()
            raise
        self._line = line
        self._was_identified = True
        self._last_good = self._due = self._clock.monotonic()
        self.health = replace(
            self.health, connected=True, identity=identity, reason="", fault="", connected_since=self._clock.monotonic()
        )

    def _reconnect(self, now: float) -> None:
        if not self._back_off.due(now, present=is_present(self._port)):
            return
        try:
            self.connect()
        except StopAskedError:
            raise
        except DeviceError as error:
            self._back_off.failed(self._clock.monotonic())
            self.health = replace(self.health, reason=str(error))
            return
        self.mailbox.take()  # a command from before is stale
        self._tail.cut(self._clock.monotonic())
        self.health = replace(self.health, reconnects=self.health.reconnects + 1)
        self._report(f"reconnected: {self.health.identity}; the tail waits for a fresh gait")

    def _lose(self, reason: str) -> None:
        self._make_safe()
        self._disconnect()
        self._tail.cut(self._clock.monotonic())
        self._back_off.restart(self._clock.monotonic())
        self.health = replace(self.health, connected=False, reason=reason)
        self._report(reason)

    def _make_safe(self) -> None:
        """Disable straight through the port; a failure is reported, and it is tried again at the next tick."""
        line = self._line
        if line is not None:
            self._cut(line.raw)

    def _cut(self, line: OpenLine) -> None:
        """Take the force away before anything that still waits in the port, where the device stands a frame cut so."""
        if self._backend.takes_cut_frames:
            self._attempt(lambda: line.discard())  # noqa: PLW0108 - a line without it is a failure like any
        self._attempt(lambda: self._disable(line))

    def _attempt(self, work: Callable[[], None]) -> None:
        """Do it; report a failure of any kind."""
        try:
            work()
        except DeviceError as error:
            self._report(f"while making the device safe: {error}")
        except Exception as error:  # noqa: BLE001 - whatever is broken, the next step is to be done
            self._report(f"while making the device safe: {error!r}")

    def _disconnect(self) -> None:
        if (line := self._line) is not None:
            self._line = None
            self._attempt(lambda: line.raw.drain(_DRAIN_SECONDS))
            line.raw.close()

    def _publish_health(self) -> None:
        operations = getattr(self._motion, "operations", {})
        if self.health.fault and self._clock.monotonic() - self._fault_at > _FAULT_SHOWN:
            self.health = replace(self.health, fault="")
        self.health = replace(
            self.health,
            phase=self._tail.phase,
            still=self._tail.is_still(self._clock.monotonic()),
            commanded=self._commanded,
            limited=self._motion.limited,
            timeouts=self._tail.timeouts,
            operations=operations,
        )


def _refuse_if_behind(line: StoppableLine) -> None:
    """Write nothing more to a line whose buffer is full of the past.

    Raises:
        LineStalledError: It is.
    """
    if line.is_behind():
        msg = "the line is behind: the device takes its bytes too slowly; is its baud rate the configured one?"
        raise LineStalledError(msg)
