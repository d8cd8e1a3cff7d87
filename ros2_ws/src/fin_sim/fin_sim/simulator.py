"""The simulator node: a plant whose fish swims in the model of `fin_sim.dynamics`."""

from __future__ import annotations

import math
import sys
import time
from typing import TYPE_CHECKING, cast

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray  # noqa: TC002  (rclpy reads the annotation's class at run time)
from std_srvs.srv import SetBool, Trigger

from fin_plant import node_process, topics, validity
from fin_plant.discovery import ends_of, no_fresh_gait
from fin_plant.fin import Fin, node_table
from fin_plant.frames import Pose
from fin_plant.gait import Gait
from fin_plant.gait_follower import GaitFollower
from fin_plant.messages import (
    as_text,
    gait_from_message,
    gait_message,
    key_values,
    plant_state_message,
    time_message,
)
from fin_plant.model_topics import DescriptionTopic, ModelTopics
from fin_plant.node_parameters import NodeParameters, create_node
from fin_plant.plant_state import (
    DRIVEN_JOINTS,
    EMERGENCY,
    LIMITS,
    RELEASE,
    SERVO_TORQUE,
    SLOWEST_PACE,
    STARTS_AT_REST,
    TELLS,
    THRUST,
    PlantState,
    State,
)
from fin_sim import dynamics, time_stepping
from fin_sim.chain import build_chain
from fin_sim.fish import Fish
from fin_sim.fish_shape import description
from fin_sim.pace import Pace
from fin_sim.servo import Servo, TailDrive
from fin_sim.stream_messages import STREAMS, StreamMessages
from fin_sim.swim import longest_step

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.parameters import Value

PARAMETERS = node_table("fin_sim", "simulator")
# Each one quarters the step.
_MOST_REFINEMENTS = 2
_CLOCK_PER_SECOND = 100.0
# Samples that may be on their way to the slowest listener; the publishers' queues hold twice as many.
_LARGEST_BACKLOG = topics.STREAM.depth // 2
# Whether they have arrived is asked from here on: the question costs as much as twenty messages.
_ASKED_BACKLOG = _LARGEST_BACKLOG // 2
_ACKNOWLEDGE_WAIT = Duration(seconds=0.02)
_HANGING_AFTER = 2.0
_SLOWEST_PACE = 0.01
"""Seconds that the fish swims at least in a second of the wall clock, however busy the machine."""
_NO_WAIT = Duration(seconds=0.0)


def build_stepper(values: Mapping[str, Value]) -> time_stepping.Stepper:
    """Return the chain of these parameters, ready to be advanced from sample to sample.

    Raises:
        ValueError: A fin, a fish or a servo that cannot be.
    """
    Servo.from_parameters(values)
    fish, fin = Fish.from_parameters(values), Fin.from_parameters(values)
    chain = build_chain(fish, fin, reactive=values["reactive"])  # type: ignore[arg-type]
    sample_time = 1.0 / cast("float", values["sample_rate"])
    every = time_stepping.steps_a_sample(sample_time, min(cast("float", values["step"]), chain.longest_step))
    return time_stepping.stepper_of(chain, sample_time / every, every)


class Simulator:
    """The plant: takes gaits and fins, swims, publishes what the fish does."""

    def __init__(self) -> None:
        """Declare parameters, compile the kernel, offer topics and services.

        Raises:
            ValueError: A start parameter that is refused.
        """
        self.node = create_node("simulator")
        self._built: tuple[dict[str, Value], time_stepping.Stepper] | None = None
        self._parameters = NodeParameters(
            self.node, PARAMETERS, validate=self._build, on_change=self._parameters_changed
        )
        self._values = self._parameters.values
        self._sample_time = 1.0 / self._number("sample_rate")
        self._pace = Pace(self._sample_time)
        self._stepper = self._build(self._values)
        self._compile()
        self._rest()
        self._offer()
        self._set_state(State.READY)
        self._publish_gait_applied()

    # -- set-up ------------------------------------------------------------------------------------------------------

    def _build(self, values: Mapping[str, Value]) -> time_stepping.Stepper:
        """Return the stepper of these parameters; the one that was checked last is the one that is then taken."""
        if self._built is None or self._built[0] != values:
            self._built = dict(values), build_stepper(values)
        return self._built[1]

    def _suit(self, gait: Gait) -> None:
        """Give the tail a gait's resistive coefficients and steps that resolve it; at rest it keeps its last gait's."""
        if not gait.moves:
            return
        stepper = self._stepper
        longest = longest_step(gait, self._number("drive.ramp_time"))
        chain = stepper.chain.for_gait(gait)
        every = max(stepper.every, time_stepping.steps_a_sample(self._sample_time, longest))
        if (chain, every) != (stepper.chain, stepper.every):
            self._stepper = time_stepping.stepper_of(chain, self._sample_time / every, every)

    def _number(self, name: str) -> float:
        return cast("float", self._values[name])

    def _compile(self) -> None:
        begin = time.monotonic()
        joints = sum(self._stepper.chain.driven)
        self._stepper.advance(self._stepper.start(), np.zeros((2 * self._stepper.every + 1, joints, 3)))
        self.node.get_logger().info(f"kernel ready after {time.monotonic() - begin:.1f} s")

    def _offer(self) -> None:
        node = self.node
        self._streams = [node.create_publisher(topic.type, topic.name, topic.qos) for topic in STREAMS]
        self._messages = StreamMessages(self._stepper.chain)  # which names the joints, and tells the current
        self._model, self._description = ModelTopics(node), DescriptionTopic(node)
        self._describe()
        self._state_topic = node.create_publisher(
            topics.PLANT_STATE.type, topics.PLANT_STATE.name, topics.PLANT_STATE.qos
        )
        self._gait_applied = node.create_publisher(
            topics.GAIT_APPLIED.type, topics.GAIT_APPLIED.name, topics.GAIT_APPLIED.qos
        )
        self._diagnostics = node.create_publisher(
            topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.qos
        )
        self._clock = node.create_publisher(topics.CLOCK.type, topics.CLOCK.name, topics.CLOCK.qos)
        self._last_clock = -math.inf
        self._swum = self._largest_hinge_angle = 0.0
        self._rejected = 0
        self._rejection = ""
        self._rejected_before = 0
        self._last_gait = -math.inf
        self._held_since: float | None = None
        self._stopped = False
        self._backlog = 0
        self._gaits = node.create_subscription(topics.GAIT.type, topics.GAIT.name, self._on_gait, topics.GAIT.qos)
        node.create_service(Trigger, f"~/{topics.REQUEST_RESET_SERVICE}", self._on_request_reset)
        node.create_service(SetBool, f"~/{topics.EMERGENCY_STOP_SERVICE}", self._on_emergency_stop)
        node.create_timer(1.0, self._publish_diagnostics)

    # -- state -------------------------------------------------------------------------------------------------------

    def _rest(self) -> None:
        """Put the fish at rest at the origin."""
        self._fish_state = self._stepper.start()
        self._stepper, self._refinements = self._build(self._values), 0
        self._neutral()
        self._samples = 0
        self._largest_hinge_angle = 0.0
        self._at_rest = True

    @property
    def _fish_time(self) -> float:
        """Time in s since the fish began to swim from rest; it stands still before, so that every swim repeats."""
        return self._samples * self._stepper.sample_time

    def _neutral(self) -> None:
        """Put the tail at neutral, without a gait."""
        self._follower = GaitFollower(sum(self._stepper.chain.driven), self._number("drive.ramp_time"))
        self._tail = TailDrive(self._follower, Servo.from_parameters(self._values))

    def _set_state(self, state: State, reason: str = "") -> None:
        self._state, self._reason = state, reason
        self._state_began = self._pace.begin_state(now=state is State.READY and self._number("speed") == 1.0)
        self._say_state()

    def _say_state(self) -> None:
        self._pace.set_speed(
            self._number("speed") if self._state is State.SWIMMING else min(self._number("speed"), 1.0) or 1.0
        )
        fin = {name: as_text(value) for name, value in self._values.items() if name.startswith("fin.")}
        details = {name: as_text(self._values[name]) for name in LIMITS}
        details[DRIVEN_JOINTS] = str(sum(self._stepper.chain.driven))
        details |= {SLOWEST_PACE: as_text(_SLOWEST_PACE), STARTS_AT_REST: "true"}
        in_plane = self._stepper.chain.water.model == "ideal_2d"  # where the force on the tail is not worked out
        details[TELLS] = SERVO_TORQUE if in_plane else f"{SERVO_TORQUE}, {THRUST}"
        if self._stopped:
            details["waiting_for"] = RELEASE
        reason = "; ".join(filter(None, (self._reason, self._parameters.awaited)))
        state = PlantState(self._state, "simulator", self._state_began, reason, fin, details)
        self._state_topic.publish(plant_state_message(state))

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        changed = {name for name, value in values.items() if value != self._values[name]}
        self._values = dict(values)
        if self._state is State.SWIMMING and changed.isdisjoint(PARAMETERS.deciding_swims):
            self._say_state()
            return
        body = self._fish_state[: dynamics.BODY_STATES].copy()
        self._stepper, self._refinements = self._build(values), 0
        if len(self._fish_state) != len(self._stepper.start()):
            self._fish_state = self._stepper.start()  # another number of hinges: they start straight
            self._fish_state[: dynamics.BODY_STATES] = body
        self._messages = StreamMessages(self._stepper.chain)
        self._describe()
        if sum(self._stepper.chain.driven) != self._follower.joints:
            self._neutral()
        self._follower.set_ramp_time(self._number("drive.ramp_time"))
        self._tail.servo = Servo.from_parameters(values)
        self._suit(Gait.from_rows(self._follower.target))
        self._set_state(self._state, self._reason)

    # -- callbacks ---------------------------------------------------------------------------------------------------

    def _on_gait(self, message: Float64MultiArray) -> None:
        if self._state is State.FAULT:
            return
        try:
            gait = gait_from_message(message)
            limited = gait.limited(self._number("limits.sweep"), self._number("limits.frequency"))
            if limited.moves and self._state is not State.SWIMMING:
                self._parameters.refuse_incomplete()
            changed = not limited.same_as(Gait.from_rows(self._follower.target))
            if changed:
                self._suit(limited)
            self._follower.command(limited, self._fish_time)
        except ValueError as error:
            self._rejected += 1
            self._rejection = str(error)
            self.node.get_logger().warning(f"gait refused: {error}", throttle_duration_sec=1.0)
            return
        self._last_gait = time.monotonic()
        self._rejected_before = self._rejected
        self._at_rest = self._at_rest and not limited.moves
        if limited.moves and self._state is not State.SWIMMING:
            self._set_state(State.SWIMMING)
            self._publish_start()
        elif not limited.moves and self._state is State.SWIMMING:
            self._set_state(State.READY)
        if changed:
            self._publish_gait_applied()

    def _on_emergency_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data or self._stopped:
            self._rest()
            self._stopped = request.data
            self._set_state(State.FAULT if self._stopped else State.READY, EMERGENCY if self._stopped else "")
            self._publish_gait_applied()
        response.success = True
        response.message = "stopped; latched until ~/estop false" if self._stopped else "the stop is released"
        return response

    def _on_request_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._stopped:
            response.success, response.message = False, EMERGENCY
            return response
        self._rest()
        self._set_state(State.READY)
        self._publish_gait_applied()
        response.success = True
        response.message = "the fish is at rest at the origin"
        return response

    def _no_fresh_gait(self) -> str:
        topic = self.node.resolve_topic_name(topics.GAIT.name)
        publishers = ends_of(self.node.get_publishers_info_by_topic(topic))
        said = no_fresh_gait(topic, publishers, self._rejected - self._rejected_before, self._rejection)
        return f"{said}; the tail returns to neutral"

    # -- work --------------------------------------------------------------------------------------------------------

    def step(self) -> float:
        """Compute and publish what is due; return how long the executor may wait."""
        if self._state is State.SWIMMING and self._commander_is_silent():
            self._follower.stop(self._fish_time)
            self._set_state(State.READY, self._no_fresh_gait())
            self.node.get_logger().warning(self._reason)
            self._publish_gait_applied()
        self._wait_for_listeners()
        samples = 0 if self._held_since is not None else self._pace.due()
        if samples:
            self._pace.advance(samples)
            self._advance(samples)
        return self._pace.wait()

    def _commander_is_silent(self) -> bool:
        """Whether no gait came in time; on a busy machine one may have come and wait for its callback."""
        timeout = self._number("command_timeout")
        if time.monotonic() - self._last_gait > timeout:
            waiting = self._gaits.handle.take_message(topics.GAIT.type, False)  # noqa: FBT003  (not raw; a C++ function)
            if waiting is not None:
                self._on_gait(waiting[0])
        return time.monotonic() - self._last_gait > timeout

    def _advance(self, samples: int) -> None:
        stamps = self._pace.stamps(samples)
        if self._state is State.FAULT:
            self._pace.stamp = int(stamps[-1])
            self._publish_clock()
            return
        try:
            states, records = self._swim(samples)
        except (time_stepping.StepError, validity.FoldedError) as error:
            self._rest()
            self._set_state(State.FAULT, f"{error}; call ~/request_reset")
            self.node.get_logger().error(self._reason)
            return
        bent = np.abs(states[1:, self._hinges])
        largest = float(bent.max()) if bent.size else 0.0
        if validity.folded(largest):
            self._rest()
            self._set_state(State.FAULT, f"{validity.folded(largest)}; call ~/request_reset")
            self._largest_hinge_angle = largest
            self.node.get_logger().error(self._reason)
            return
        self._largest_hinge_angle = max(self._largest_hinge_angle, largest)
        self._samples += 0 if self._at_rest else samples
        self._pace.stamp = int(stamps[-1])
        self._publish(stamps, states[1:], records[1:])

    def _swim(self, samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Advance the fish by so many samples, with a shorter step from now on if the present one fails.

        Raises:
            StepError: The shortest one failed too.
            FoldedError: A joint folded further than its water knows.
        """
        start, servos = self._fish_state.copy(), self._tail.state
        while True:
            try:
                times = self._stepper.half_step_times(samples, self._samples)
                return self._stepper.advance(self._fish_state, self._tail.motion(times))
            except validity.FoldedError as error:  # of the plane flow, whose table ends
                if isinstance(getattr(error, "time", None), float):
                    error.time += self._fish_time  # type: ignore[attr-defined]
                raise
            except time_stepping.StepError as error:
                if self._refinements == _MOST_REFINEMENTS:
                    raise time_stepping.StepError(self._fish_time + error.time) from error
            self._refinements += 1
            self._fish_state[:], self._tail.state = start, servos
            every = 4 * self._stepper.every
            self._stepper = time_stepping.stepper_of(self._stepper.chain, self._sample_time / every, every)
            self.node.get_logger().info(f"step shortened to {self._stepper.step:g} s: this fin needs it")

    @property
    def _hinges(self) -> slice:
        """Where the angles of the passive joints stand in the state."""
        driven = self._stepper.chain.driven
        return slice(dynamics.BODY_STATES + sum(driven), dynamics.BODY_STATES + len(driven))

    def _publish_start(self) -> None:
        """Publish the sample with which the swim begins, stamped as its state: the first of what is measured."""
        states, records = self._stepper.advance(
            self._fish_state.copy(), self._tail.motion(self._stepper.half_step_times(0, self._samples))
        )
        self._publish(np.array([self._pace.stamp]), states, records)

    def _publish(self, stamps: NDArray[np.int64], states: NDArray[np.float64], records: NDArray[np.float64]) -> None:
        for publisher, messages in zip(self._streams, self._messages.serialized(stamps, states, records), strict=True):
            for message in messages:
                publisher.publish(message)
        self._backlog += len(stamps)
        self._publish_clock()
        self._show(states[-1])
        if self._state is State.SWIMMING:
            self._swum += len(stamps) * self._sample_time

    def _publish_clock(self) -> None:
        now = time.monotonic()
        wanted = self._values["publish_clock"] and self._number("speed") != 1.0
        if wanted and now - self._last_clock >= 1.0 / _CLOCK_PER_SECOND:
            self._last_clock = now
            self._clock.publish(Clock(clock=time_message(self._pace.stamp)))

    def _describe(self) -> None:
        """Tell how the fish looks, with its present fin."""
        text = description(self._stepper.chain, self._values)
        self._model.take_description(text)
        self._description.tell(text)

    def _show(self, state: NDArray[np.float64]) -> None:
        pose = Pose(float(state[dynamics.X]), float(state[dynamics.Y]), 0.0, float(state[dynamics.HEADING]))
        angles = state[dynamics.BODY_STATES : dynamics.BODY_STATES + len(self._messages.joints)]
        self._model.tell(self._pace.stamp, pose, dict(zip(self._messages.joints, angles.tolist(), strict=True)))

    def _wait_for_listeners(self) -> None:
        """Hold the fish back while a reliable listener has more than the largest backlog before it.

        A listener whose queue is full does not acknowledge, so none can be outrun. One that hangs holds the fish back
        until it is gone; the callbacks still run meanwhile.
        """
        if self._backlog < _ASKED_BACKLOG:
            return
        wait = _NO_WAIT if self._backlog < _LARGEST_BACKLOG else _ACKNOWLEDGE_WAIT
        if all(publisher.wait_for_all_acked(wait) for publisher in self._streams):
            self._backlog, self._held_since = 0, None
            return
        if self._backlog < _LARGEST_BACKLOG:
            return
        self._held_since = self._held_since or time.monotonic()
        if self._stuck:
            self.node.get_logger().warning("a listener hangs; the fish waits for it", throttle_duration_sec=5.0)

    @property
    def _stuck(self) -> bool:
        """Whether a listener holds the fish back for longer than a busy one does as a matter of course."""
        return self._held_since is not None and time.monotonic() - self._held_since > _HANGING_AFTER

    def finished(self) -> int | None:
        """Return None: a plant runs until it is stopped."""
        return None

    def close(self) -> None:
        """Nothing moves that has to be made safe."""

    # -- reports -----------------------------------------------------------------------------------------------------

    def _publish_gait_applied(self) -> None:
        self._gait_applied.publish(gait_message(self._follower.target))

    def _publish_diagnostics(self) -> None:
        swum, self._swum = self._swum, 0.0
        fault = self._state is State.FAULT
        doubts = [validity.bent(self._largest_hinge_angle), *self._stepper.chain.warnings()]
        warnings = "; ".join(text for text in doubts if text)
        warned = self._stuck or warnings
        level = DiagnosticStatus.ERROR if fault else DiagnosticStatus.WARN if warned else DiagnosticStatus.OK
        status = DiagnosticStatus(
            level=level,
            name=f"{self.node.get_fully_qualified_name()}: plant",
            message=self._reason or self._state.value,
            hardware_id="simulator",
            values=key_values(
                {
                    "state": self._state.value,
                    "fish_seconds_a_second": round(swum, 2),
                    "gaits_refused": self._rejected,
                    "last_refusal": self._rejection,
                    "held_back_by_a_listener": self._stuck,
                    "largest_hinge_angle": round(self._largest_hinge_angle, 4),
                    "awaited": self._parameters.awaited,
                    "warnings": warnings,
                }
            ),
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = time_message(self._pace.stamp)
        self._diagnostics.publish(message)


def main(args: list[str] | None = None) -> int:
    """Run the simulator node."""
    return node_process.run(Simulator, args)


if __name__ == "__main__":
    sys.exit(main())
