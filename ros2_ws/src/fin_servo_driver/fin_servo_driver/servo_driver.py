"""The servo driver node: a plant whose fish is real. Its life cycle and its states are described in docs/robot.md."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING, cast

from std_msgs.msg import Float64MultiArray  # noqa: TC002  (rclpy reads the annotation's class at run time)
from std_srvs.srv import Trigger

from fin_plant import node_process, topics
from fin_plant.discovery import ends_of, no_fresh_gait
from fin_plant.fin import Fin, node_table
from fin_plant.messages import (
    gait_from_message,
)
from fin_plant.node_parameters import NodeParameters
from fin_plant.plant_state import EMERGENCY, State
from fin_servo_driver.accepted_gait import AcceptedGait, End, not_started
from fin_servo_driver.diagnosis import Counters
from fin_servo_driver.driver_topics import DriverTopics
from fin_servo_driver.emergency_stop import EmergencyStop
from fin_servo_driver.io_thread import IoThread
from fin_servo_driver.line import DeviceError
from fin_servo_driver.managed_node import ManagedNode
from fin_servo_driver.port import name_warning
from fin_servo_driver.robot_setup import RobotSetup
from fin_servo_driver.robot_states import NOT_CONFIGURED, Device, RobotStates, other_plants
from fin_servo_driver.tail import Phase, Settings
from fin_servo_driver.wall_clock import stamp_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node

    from fin_plant.gait import Gait
    from fin_plant.parameters import Value
    from fin_servo_driver.robot_states import Answer, Standing
    from fin_servo_driver.set_points import Motion

PARAMETERS = node_table("fin_servo_driver", "servo_driver")
# What a line that stalls may add to the time that the tail takes to neutral.
_STALL_SECONDS = 1.6
_ACTIVE_LOOK, _IDLE_LOOK = 0.01, 0.05
_NICE = -10


def device_of(io: IoThread) -> Device:
    """Return the device as this thread has seen it."""
    health = io.health
    return Device(health.connected, health.reason, health.reconnects, io.alive)


class ServoDriver:
    """The plant: takes gaits and fins, drives the tail, says what it does."""

    def __init__(self) -> None:
        """Declare parameters, offer topics and services; the port stays closed until the node is configured.

        Raises:
            ValueError: A start parameter that is refused.
        """
        managed = ManagedNode("servo_driver", namespace=topics.NAMESPACE, allow_undeclared_parameters=True)
        managed.driver = self
        managed.refuse_what_is_no_transition()
        self.node: Node = managed
        self._log = self.node.get_logger()  # type: ignore[no-untyped-call]
        self._io: IoThread | None = None
        self._parameters = NodeParameters(
            self.node, PARAMETERS, validate=self._check, on_change=self._parameters_changed
        )
        self._values = self._parameters.values
        self._motion: Motion | None = None
        self._refusal = ""
        self._states = RobotStates(self._values)
        self._emergency_seen = True
        self._accepted_gait = AcceptedGait()
        self._counters = Counters()
        self._topics = DriverTopics(self.node, self._text("plant"))
        self._offer()
        self._stop = EmergencyStop(self.node, self._on_emergency_stop)
        self.publish_state()

    def _offer(self) -> None:
        node = self.node
        node.create_subscription(topics.GAIT.type, topics.GAIT.name, self._on_gait, topics.GAIT.qos)
        node.create_service(Trigger, f"~/{topics.REQUEST_RESET_SERVICE}", self._on_request_reset)
        node.create_service(Trigger, f"~/{topics.CONFIRM_FIN_SERVICE}", self._on_confirm_fin)
        node.create_service(Trigger, f"~/{topics.CONFIRM_MARK_SERVICE}", self._on_confirm_mark)
        node.create_timer(1.0, self._publish_diagnostics)

    # -- life cycle --------------------------------------------------------------------------------------------------

    def configure(self) -> None:
        """Read the robot file, open the port and make sure of the device.

        Raises:
            ValueError: The robot file is refused.
            DeviceError: Port or device are not as configured.
        """
        setup = RobotSetup.from_parameters(self._values)
        if warning := name_warning(setup.port):
            self._log.warning(warning)
        self._motion = setup.motion
        self._io = IoThread(
            setup.backend, setup.motion, self._settings(), setup.open_line, setup.port, self._log.warning
        )
        try:
            self._io.start()
        except DeviceError:
            self._io = None
            raise
        self._states.new_device()
        self._rest()
        self._log.info(f"{setup.port}: {self._io.health.identity}")

    def arm(self) -> None:
        """Allow motion.

        Raises:
            DeviceError: The emergency stop is latched, the tail is not at rest yet, or the device is not there.
        """
        io = self._need_io()
        if self._states.emergency:
            raise DeviceError(EMERGENCY)
        self._see_others()
        if self._states.others:
            raise DeviceError(self._states.others)
        if not io.health.connected:
            raise DeviceError(io.health.reason)
        if io.health.phase is not Phase.DISARMED:
            msg = f"the tail is not at rest yet ({io.health.phase}): activate again"
            raise DeviceError(msg)
        if self._values["watchdog.disabled_knowingly"]:
            self._log.warning("the command watchdog is OFF: stay at the power switch")
        io.arm()
        if not io.wait_for({Phase.SILENT, Phase.FOLLOWING}, self._patience):
            io.disarm()
            msg = "the device keeps the driver waiting: activate again"
            raise DeviceError(msg)
        self._states.armed = True

    def disarm(self) -> None:
        """Lead the tail to neutral and disable the device; if that is not done in time, disable it without neutral.

        Raises:
            DeviceError: There is no device.
        """
        io = self._need_io()
        self._states.armed = False
        self._rest("the driver was deactivated")
        io.disarm()
        if not io.wait_for({Phase.DISARMED}, self._patience):
            io.cut()
            self._log.error("the tail did not reach neutral in time; its device was told to disable")

    @property
    def _patience(self) -> float:
        return _STALL_SECONDS + (self._motion.stop_time if self._motion is not None else 0.0)

    def release(self) -> None:
        """Make the device safe and close the port."""
        self._states.armed = False
        if self._io is not None:
            self._io.disarm()
            self._io.wait_for({Phase.DISARMED}, self._patience)
            self._look()  # a device that was lost meanwhile is a fault
            self._io.close()
            self._io = None
        self._states.failure = NOT_CONFIGURED
        self._rest()

    def recover(self) -> None:
        """Make the device safe and close the port after something unforeseen, which stays the reason."""
        self.release()
        self._states.fault()
        self._states.failure = self._refusal

    def refused(self, what: str, reason: str) -> None:
        """Note why a transition was refused."""
        self._refusal = f"cannot {what}: {reason}"
        self._log.error(self._refusal)
        if self._io is None:
            self._states.failure = self._refusal
        self.publish_state()

    def _need_io(self) -> IoThread:
        if self._io is None:
            raise DeviceError(self._states.failure)
        return self._io

    def _text(self, name: str) -> str:
        return cast("str", self._values[name])

    def _number(self, name: str) -> float:
        return cast("float", self._values[name])

    def _settings(self) -> Settings:
        forever = bool(self._values["watchdog.disabled_knowingly"])
        return Settings(None if forever else self._number("command_timeout"), self._number("drive.ramp_time"))

    # -- state -------------------------------------------------------------------------------------------------------

    def _device(self) -> Device | None:
        """Return the device as the I/O thread has seen it, None while there is none."""
        return None if self._io is None else device_of(self._io)

    def _look(self) -> Standing:
        return self._states.look(self._device(), time.monotonic())

    def publish_state(self, *, anew: bool = False) -> None:
        """Publish the state if it has changed, or in any case; with a new stamp unless a swim goes on."""
        limits = self._motion.limits if self._io is not None and self._motion is not None else ()
        self._topics.tell_state(self._look(), self._states, self._values, self._parameters.awaited, limits, anew=anew)

    def _see_others(self) -> None:
        """See whether another plant tells its state here: under the same name it gets all that this one is asked."""
        topic = self.node.resolve_topic_name(topics.PLANT_STATE.name)
        ends = ends_of(self.node.get_publishers_info_by_topic(topic))
        self._states.others = other_plants(topic, [end.node for end in ends])
        if self._states.others and self._states.swimming_since is not None and self._io is not None:
            self._io.stop_tail()
            self._rest()

    def _rest(self, reason: str = "") -> None:
        """Note that the tail swims no more."""
        self._states.rest(reason)
        self._accepted_gait.forget()
        if self._motion is not None:
            self._topics.tell_rest(self._motion.joints)

    def _check(self, values: Mapping[str, Value]) -> None:
        """Refuse parameters that cannot be, or not now.

        Raises:
            ValueError: A fin that cannot be, or a ramp that would count from the next swim on only.
        """
        Fin.from_parameters(values)
        name = "drive.ramp_time"
        if self._io is not None and self._states.swimming_since is not None and values[name] != self._values[name]:
            msg = f"{name} = {values[name]} s cannot be taken in a swim, which goes on with {self._values[name]} s: "
            raise ValueError(msg + "stop the gait first")

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        self._values = dict(values)
        mounted = self._states.want_fin(values)
        if self._io is not None:
            self._io.set_settings(self._settings())
            if not mounted:
                self._io.stop_tail()
        if not mounted:
            self._rest()
        self.publish_state(anew=True)

    # -- callbacks ---------------------------------------------------------------------------------------------------

    def _on_gait(self, message: Float64MultiArray) -> None:
        if self._io is not None:
            self._follow_phase(self._io)
        now = time.monotonic()
        try:
            gait = self._accepted(gait_from_message(message), now)
        except (ValueError, DeviceError) as error:
            follows = self._io is not None and self._io.health.phase is Phase.FOLLOWING
            self._counters.refuse(str(error), follows=follows)
            self._log.warning(f"gait refused: {error}", throttle_duration_sec=1.0)
            return
        if gait is None:
            return
        beats = self._accepted_gait.moves
        self._counters.follow()
        self._need_io().mailbox.put(self._accepted_gait.command(gait, now))
        since = self._states.swimming_since
        self._states.rest()
        # A gait's end lasts until the tail stands, see `_follow_phase`; another gait before that is another swim.
        self._states.swimming_since = stamp_of(now) if gait.moves and (since is None or not beats) else since
        self.publish_state()
        if not gait.same_as(self._topics.applied):
            self._topics.tell_gait(gait)

    def _accepted(self, gait: Gait, now: float) -> Gait | None:
        """Return the gait that came at ``now`` s inside the limits; None for a still one while nothing moves anyway.

        Raises:
            ValueError: The gait cannot be driven, or not now.
            DeviceError: There is no device.
        """
        io, motion = self._need_io(), self._motion
        if motion is None:
            raise DeviceError(self._states.failure)
        limited = motion.allowed(gait, self._number("limits.sweep"), self._number("limits.frequency"))
        self._counters.clamp(changed=limited != gait)
        standing = self._look()
        if standing.state not in {State.READY, State.SWIMMING}:
            if not limited.moves:
                return None
            msg = f"the plant is in {standing.state}: {standing.reason}"
            raise ValueError(msg)
        if limited.moves and standing.state is not State.SWIMMING:
            self._parameters.refuse_incomplete()
        if io.health.phase is Phase.STOPPING:
            msg = "the tail is on its way to neutral: send the gait again"
            raise ValueError(msg)
        if self._accepted_gait.fell_silent(now, self._settings().command_timeout):
            io.stop_tail()
            msg = "no gait came for longer than command_timeout: the tail is led to neutral, send the gait again"
            raise ValueError(msg)
        return limited

    def _on_request_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        answer = self._states.request_reset(self._device(), time.monotonic())
        if answer.accepted:
            if self._io is not None:
                self._io.stop_tail()
            self._rest()
        return self._answered(answer, response)

    def _on_confirm_fin(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._see_others()
        return self._answered(self._states.confirm_fin(self._device(), time.monotonic()), response)

    def _on_confirm_mark(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._see_others()
        return self._answered(self._states.confirm_mark(self._device(), time.monotonic()), response)

    def _answered(self, answer: Answer, response: Trigger.Response) -> Trigger.Response:
        """Fill in the response; what was accepted begins a state with a stamp of its own."""
        response.success, response.message = answer.accepted, answer.text
        if answer.accepted:
            self.publish_state(anew=True)
        return response

    def _on_emergency_stop(self, stop: bool) -> Answer:
        """Stop or release, and return the answer. Called in another thread: `step` tells the rest of the node."""
        if not stop:
            return self._states.release()
        self._states.emergency = True  # first, so that no gait is accepted after the cut
        if (io := self._io) is not None:
            io.cut()
        self._emergency_seen = False
        self._log.error("emergency stop")
        return self._states.stop(None if io is None else device_of(io))

    # -- work --------------------------------------------------------------------------------------------------------

    def step(self) -> float:
        """Publish what the other threads have seen; return how long the executor may wait."""
        if not self._emergency_seen:
            self._emergency_seen = True
            self._rest()
        if self._io is not None:
            self._topics.tell_joint_states(self._io)
            self._follow_phase(self._io)
        self.publish_state()
        return _ACTIVE_LOOK if self._io is not None and self._states.armed else _IDLE_LOOK

    def _follow_phase(self, io: IoThread) -> None:
        """Notice that the tail stands after its gait's end.

        Or that it has stopped by itself, or has not started: no fresh gait, or something of the device.
        """
        health = io.health
        if self._accepted_gait.stands(health):
            self._states.swimming_since = None
        end = self._accepted_gait.ended(health, time.monotonic())
        if end is None:
            return
        io.stop_tail()  # it may be about to start: what is said of it here must stay true
        reason = io.health.refusal
        if not reason and self._accepted_gait.moves and self._states.swimming_since is not None and io.health.connected:
            reason = self._no_fresh_gait() if end is End.STOPPED else not_started(io.health)
        if reason:
            self._log.warning(reason)
        self._rest(reason)

    def _no_fresh_gait(self) -> str:
        topic = self.node.resolve_topic_name(topics.GAIT.name)
        publishers = ends_of(self.node.get_publishers_info_by_topic(topic))
        said = no_fresh_gait(topic, publishers, self._counters.refused_since, self._counters.refusal_since)
        return f"{said}; the tail returned to neutral"

    def finished(self) -> int | None:
        """Return None: a plant runs until it is stopped."""
        return None

    def interrupt(self) -> None:
        """Disable the device and end whatever waits for it; called in a signal's handler, `close` follows."""
        if (io := self._io) is not None:
            io.end()

    def close(self) -> None:
        """Make the device safe, straight to the port."""
        if self._io is not None:
            self._io.close()
            self._io = None
        self._stop.close()

    def _publish_diagnostics(self) -> None:
        self._see_others()
        forever = bool(self._values["watchdog.disabled_knowingly"])
        self._topics.tell_diagnostics(self._look(), self._counters, self._io, watchdog_off=forever)


def _ask_for_priority() -> None:
    """Put this process before others where the user may: root, or a `nice` limit in /etc/security/limits.conf.

    All its threads, because the one that speaks to the device waits for Python's lock while another one holds it.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    except PermissionError:
        return


def main(args: list[str] | None = None) -> int:
    """Run the servo driver node."""
    _ask_for_priority()
    return node_process.run(ServoDriver, args)


if __name__ == "__main__":
    sys.exit(main())
