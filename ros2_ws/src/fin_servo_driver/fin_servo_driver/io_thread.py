"""The thread that alone speaks to the device: reads the mailbox, ticks the tail, sends, listens, reconnects.

The command watchdog ticks here, so that a node that hangs cannot keep the tail moving. A cut ends whatever the thread
is doing on the line; the next frame takes the force away. So does every way out of the thread, and none of them moves
the tail: only a tail that is led to rest, tick by tick, goes to neutral.
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

from fin_servo_driver.backends.backend import Feedback
from fin_servo_driver.line import DeviceError, LineStalledError, Stop, StopAskedError, StoppableLine
from fin_servo_driver.port import BackOff, is_present
from fin_servo_driver.tail import Phase, Tail

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_servo_driver.backends.backend import Backend
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
_JOIN_SECONDS = 10.0
_DRAIN_SECONDS = 0.1
"""s in which the last frames get out before the port is closed."""


class _Force(Enum):
    """Whether the device gives force."""

    RELEASED = "told to disable"
    UNSURE = "enabling or disabling it has not gone through"
    ENABLED = "holds what it is sent"


class Mailbox:
    """Holds the newest command; a newer one takes the place of one that was not yet taken."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._command: Command | None = None

    def put(self, command: Command) -> None:
        """Leave a command."""
        with self._lock:
            self._command = command

    def put_back(self, command: Command) -> None:
        """Leave a command that was taken out, unless a newer one has come."""
        with self._lock:
            self._command = self._command or command

    def take(self) -> Command | None:
        """Take the command out, None if there is none."""
        with self._lock:
            command, self._command = self._command, None
        return command


@dataclass(frozen=True)
class Sample:
    """Joint angles at one tick.

    Attributes:
        time: s of the monotonic clock.
        angles: rad, from the head to the tail.
        measured: Whether the servos have reported them; otherwise they are what was sent.
    """

    time: float
    angles: tuple[float, ...]
    measured: bool


@dataclass(frozen=True)
class Health:
    """What the thread has seen; a snapshot.

    Attributes:
        connected: Whether the device is there.
        phase: Of the tail.
        still: Whether the tail stands, and nothing moves it of what was commanded by ``commanded``.
        commanded: s of the monotonic clock at which the newest command was received that the tail has been given.
        identity: What the device says of itself.
        reason: Why it is not connected.
        reconnects: How often it came back.
        connected_since: s of the monotonic clock.
        ticks: Set-points sent.
        missed: Ticks that were skipped because the thread was late.
        dropped: Set-points not sent because the line was behind or stalled.
        limited: Set-points that a limit has changed.
        timeouts: How often the commander fell silent.
        voltage: V, None where it is not reported.
        temperature: Degrees Celsius, None where it is not reported.
        fault: What the device complains about, or has complained about in the last seconds.
        refusal: Why the tail did not start at the last command, empty since it has.
        operations: Of each relay's channel.
    """

    connected: bool = True
    phase: Phase = Phase.DISARMED
    still: bool = True
    commanded: float = -math.inf
    identity: str = ""
    reason: str = ""
    reconnects: int = 0
    connected_since: float = 0.0
    ticks: int = 0
    missed: int = 0
    dropped: int = 0
    limited: int = 0
    timeouts: int = 0
    voltage: float | None = None
    temperature: float | None = None
    fault: str = ""
    refusal: str = ""
    operations: Mapping[int, int] = field(default_factory=dict)


class IoThread:
    """Owns the line from `start` to `close`."""

    def __init__(
        self,
        backend: Backend,
        motion: Motion,
        settings: Settings,
        open_line: Callable[[], OpenLine],
        port: str,
        report: Callable[[str], None],
    ) -> None:
        """Take what the thread works with; nothing is opened yet.

        Args:
            backend: The device.
            motion: The tail.
            settings: Timeout and ramp, see `set_settings`.
            open_line: Opens the port; raises PortUnavailableError.
            port: Its name, to see whether it is there.
            report: Takes a text for the log.
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
        self._line: StoppableLine | None = None
        self._was_identified = False
        self._force = _Force.RELEASED
        self._disabled_at = 0.0
        self._feedback = Feedback()
        self._last_good = 0.0
        self._back_off = BackOff()
        self._latenesses: deque[float] = deque(maxlen=_LATENESSES_KEPT)
        self._fault_at = 0.0
        self._commanded = -math.inf
        self._asked: deque[tuple[str, float]] = deque()
        self._stop = Stop()
        self._is_ending = False
        self._wake: queue.SimpleQueue[None] = queue.SimpleQueue()  # unlike an Event safe in a signal's handler
        self._thread = threading.Thread(target=self._run, name="servo I/O", daemon=False)

    # -- called by the node ------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Open and identify the device, then start the thread.

        Raises:
            DeviceError: Port or device are not as configured, or a stop was asked for; nothing stays open.
        """
        self._connect()
        self._thread.start()

    def arm(self) -> None:
        """Allow motion from the next command on."""
        self._ask("arm")

    def disarm(self) -> None:
        """Lead the tail to neutral, then disable; `wait_for` tells when."""
        self._ask("disarm")

    def stop_tail(self) -> None:
        """Lead the tail to neutral, then disable; the next command moves it again."""
        self._ask("stop")

    def cut(self) -> None:
        """Disable at once, whatever is under way: no frame that moves or enables goes out after this has returned."""
        self._stop.ask()
        self._wake.put(None)

    def set_settings(self, settings: Settings) -> None:
        """Change timeout and ramp; the ramp counts from the next start on."""
        self._tail.settings = settings

    def wait_for(self, phases: set[Phase], timeout: float) -> bool:
        """Wait until the tail is in one of the phases; False if it is not after ``timeout`` s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline and self._thread.is_alive():
            if self.health.phase in phases and not self._asked and not self._stop.asked:
                return True
            time.sleep(0.002)
        return self.health.phase in phases

    def latenesses(self) -> list[float]:
        """Return how late in s the last ticks were, and forget them."""
        kept = list(self._latenesses)
        self._latenesses.clear()
        return kept

    def end(self) -> None:
        """Ask the thread to disable the device and end, whatever is under way; a signal's handler may call it."""
        self._is_ending = True
        self._stop.ask()
        self._wake.put(None)

    def close(self) -> None:
        """End the thread; it disables the device and closes the port."""
        self.end()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_SECONDS)
        if self._line is not None:  # the thread was never started, or hangs
            self._end("the driver has closed its port")

    @property
    def rated_operations(self) -> int:
        """After how many operations a relay should be replaced."""
        return self._backend.robot.timing.rated_operations

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def _ask(self, what: str) -> None:
        self._asked.append((what, time.monotonic()))
        self._wake.put(None)

    # -- the thread --------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        period = 1.0 / self._backend.rate
        due = time.monotonic()
        reason = "the driver's I/O thread has ended"
        try:
            while True:
                now = time.monotonic()
                if not self._obey():
                    return
                with contextlib.suppress(StopAskedError):  # `_obey` carries it out
                    if self._line is None:
                        self._reconnect(now)
                        due = time.monotonic()
                    elif now >= due:
                        due = self._on_time(now, due, period)
                        self._guarded_tick(now)
                self._publish_health()
                self._sleep(max(0.0, due - time.monotonic()) if self._line else _IDLE_LOOK)
        except Exception as error:
            reason = f"the driver's I/O thread has failed: {error!r}"
            self._report(reason)
            raise
        finally:
            self._end(reason)

    def _sleep(self, seconds: float) -> None:
        """Wait until somebody asks for something, at most so long."""
        with contextlib.suppress(queue.Empty):
            self._wake.get(timeout=seconds)

    def _end(self, reason: str) -> None:
        """Make the device safe, close the port and say so; each step is done whatever becomes of the others."""
        try:
            self._make_safe()
        finally:
            try:
                self._disconnect()
            finally:
                self._tail.phase = Phase.DISARMED
                self.health = replace(self.health, connected=False, phase=Phase.DISARMED, still=True, reason=reason)

    def _on_time(self, now: float, due: float, period: float) -> float:
        """Note how late the tick is, and return when the next one is due."""
        late = now - due
        self._latenesses.append(late)
        missed = int(late / period)
        if missed and self._force is _Force.ENABLED:
            self.health = replace(self.health, missed=self.health.missed + missed)
        return due + (missed + 1) * period

    def _obey(self) -> bool:
        """Do what the node has asked for; return False to end. Commands received before it count no more."""
        while not self._wake.empty():
            self._wake.get_nowait()
        if self._is_ending:
            return False
        if self._stop.asked:
            self._stop.begin()
            self._tail.cut(time.monotonic())
            self._make_safe()
            self._publish_health()
        while self._asked:
            what, asked_at = self._asked.popleft()
            self._tail.refuse_before(asked_at)
            now = time.monotonic()
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
            if time.monotonic() - self._last_good > STALLED_SECONDS:
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
        elif time.monotonic() - command.time < _START_SECONDS:
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
        self._disabled_at = time.monotonic()

    def _send(self, line: StoppableLine, outputs: Outputs) -> None:
        try:
            _refuse_if_behind(line)
            self._backend.send(line, outputs)
        except DeviceError:
            self._motion.not_sent()
            raise
        self._motion.sent(time.monotonic())
        self.health = replace(self.health, ticks=self.health.ticks + 1)

    def _listen(self, line: StoppableLine, now: float) -> None:
        self._feedback = feedback = self._backend.read(line)
        if feedback.voltage is not None or feedback.temperature is not None:
            self.health = replace(self.health, voltage=feedback.voltage, temperature=feedback.temperature)
        if feedback.fault:
            self._note_fault(feedback.fault)
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
        self._fault_at = time.monotonic()
        self.health = replace(self.health, fault=text)

    # -- the line ----------------------------------------------------------------------------------------------------

    def _connect(self) -> None:
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
        self._last_good = time.monotonic()
        self.health = replace(
            self.health, connected=True, identity=identity, reason="", fault="", connected_since=time.monotonic()
        )

    def _reconnect(self, now: float) -> None:
        if not self._back_off.due(now, present=is_present(self._port)):
            return
        try:
            self._connect()
        except StopAskedError:
            raise
        except DeviceError as error:
            self._back_off.failed(time.monotonic())
            self.health = replace(self.health, reason=str(error))
            return
        self.mailbox.take()  # a command from before is stale
        self._tail.cut(time.monotonic())
        self.health = replace(self.health, reconnects=self.health.reconnects + 1)
        self._report(f"reconnected: {self.health.identity}; the tail waits for a fresh gait")

    def _lose(self, reason: str) -> None:
        self._make_safe()
        self._disconnect()
        self._tail.cut(time.monotonic())
        self._back_off.restart(time.monotonic())
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
        if self.health.fault and time.monotonic() - self._fault_at > _FAULT_SHOWN:
            self.health = replace(self.health, fault="")
        self.health = replace(
            self.health,
            phase=self._tail.phase,
            still=self._tail.is_still(time.monotonic()),
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
