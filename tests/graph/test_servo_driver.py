"""The servo driver node on an emulated Arduino: silent until armed, safe on every way out, bad set-ups refused."""

from __future__ import annotations

import contextlib
import math
import os
import pty
import re
import signal
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
import serial
import yaml
from std_msgs.msg import Float64MultiArray

from fin_plant import topics
from fin_plant.fin import PLANT_PARAMETERS
from fin_plant.gait import PAPER_GAIT, carangiform
from fin_plant.messages import gait_message, nanoseconds_of, plant_state_from_message
from fin_plant.plant_state import EMERGENCY, State
from fin_plant.ros_environment import PROFILES, RANGE
from fin_servo_driver.backends import lcus
from fin_servo_driver.driver_topics import DriverTopics
from fin_servo_driver.emergency_stop import EmergencyStop
from fin_servo_driver.emulator.devices import Firmata, Modbus, SilentRelays
from fin_servo_driver.robot_states import Answer, RobotStates, Standing, Waiting
from fin_servo_driver.wall_clock import stamp_of
from support.random_gaits import random_gaits
from support.robot_client import (
    ACTIVATE,
    ACTIVE,
    CLEAN_UP,
    CONFIGURE,
    DEACTIVATE,
    FINALIZED,
    INACTIVE,
    SHUT_DOWN,
    UNCONFIGURED,
    RobotClient,
    plugged_in,
)
from support.steady import on_time
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from fin_servo_driver.emulator.pty_port import PtyPort
    from support.processes import StartedProcess

pytestmark = pytest.mark.graph
STILL = gait_message([[0.0, 0.9, 0.0, 0.0]])
LONGEST_STEP = 573.0 * 6.0 * 0.04 + 1.0
"""us, of the example robot: its joint's rate over the two periods that count after a late tick; widths are rounded."""
LOWEST, HIGHEST = 1200.0, 1800.0
"""us, of the example robot."""


class Recorder(Firmata):
    """The emulated board, with every pulse width that it was told."""

    def __init__(self) -> None:
        super().__init__()
        self.widths: list[float] = []

    def _pulse(self, pin: int, width: int) -> None:
        super()._pulse(pin, width)
        if (told := self.outputs.get(pin)) is not None:
            self.widths.append(told)


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    with plugged_in(Recorder(), tmp_path, keep=True) as plugged:
        yield plugged


@pytest.fixture
def driver(start: Callable[..., StartedProcess], port: PtyPort) -> StartedProcess:
    """A driver that goes on where a busy machine puts aside the test that commands it."""
    return start_driver(start, f"port:={port.path}", "command_timeout:=10.0")


@pytest.fixture
def driver_as_it_comes(start: Callable[..., StartedProcess], port: PtyPort) -> StartedProcess:
    return start_driver(start, f"port:={port.path}")


@pytest.fixture
def client(ros_domain: int) -> Iterator[RobotClient]:
    with RobotClient(ros_domain) as robot_client:
        yield robot_client


def start_driver(start: Callable[..., StartedProcess], *parameters: str) -> StartedProcess:
    words = [word for parameter in ("robot_file:=firmata", *parameters) for word in ("-p", parameter)]
    return start("fin_servo_driver", "servo_driver", "--ros-args", *words)


def recorder(port: PtyPort) -> Recorder:
    assert isinstance(port.device, Recorder)
    return port.device


def swim_a_little(client: RobotClient, port: PtyPort, seconds: float = 1.2) -> None:
    """Send the paper's gait again and again until the tail moves."""
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    client.wait_until(lambda: max(recorder(port).widths, default=0.0) > 1640.0, "stroke")
    client.spin(seconds)


def pulses(port: PtyPort) -> bool:
    return bool(port.device.outputs)


def test_it_is_silent_until_it_is_armed(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.spin(0.5)
    assert bytes(port.received) == b""
    client.configure()
    client.spin(1.5)
    # It takes force from all pins, and asks for the version and for pins, no more; a question may be under way.
    asked = re.sub(rb"\xf0\x6d(.\xf7|.?$)|\xf0$", b"", bytes(port.received), flags=re.DOTALL)
    assert set(asked) <= {0xF7, 0xF9, 0xFF}
    client.wait_for_state(State.WAITING_FOR_FIN)
    client.wait_until(lambda: int(client.diagnostic("gaits_refused") or 0) > 0, "count of refusals")


def test_a_gait_moves_the_tail_as_asked_and_joint_states_say_what_was_sent(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    assert not pulses(port)
    clock_before = stamp_of(0.0)
    client.publish_gait(gait_message(PAPER_GAIT.rows()))
    client.spin(0.005)  # well inside a tick: the repetition comes before the first gait was looked at
    swim_a_little(client, port, 3.0)
    amplitude = 573.0 * math.radians(15.0)
    client.wait_until(lambda: max(recorder(port).widths) > 1500.0 + amplitude - 1.0, "the largest angle to the left")
    client.wait_until(lambda: min(recorder(port).widths) < 1500.0 - amplitude + 1.0, "the largest angle to the right")
    client.wait_until(lambda: np.sum(on_time(stamps_of(client), 50.0)) > 100, "two seconds on time")
    drift = 1e-9 * abs(stamp_of(0.0) - clock_before)
    widths = recorder(port).widths
    assert max(widths) == pytest.approx(1500.0 + amplitude, abs=1.0)
    assert min(widths) == pytest.approx(1500.0 - amplitude, abs=1.0)
    states = client.received(topics.JOINT_STATES)
    assert {m.header.frame_id for m in states} == {"commanded"}
    assert list(states[-1].name) == ["tail_joint_1"]
    stamps = np.array([nanoseconds_of(m.header.stamp) for m in states])
    steady = on_time(stamps, 50.0)
    assert np.median(np.diff(stamps)[steady[1:]]) == pytest.approx(2e7, rel=0.1)
    angles = np.array([m.position[0] for m in states])
    moving = (angles != 0.0) & steady
    begin = client.wait_for_state(State.SWIMMING).stamp
    times = (stamps[moving] - begin) / 1e9
    settled = times > 0.5
    expected = math.radians(15.0) * np.sin(2.0 * math.pi * 0.9 * times[settled])
    # The stamp is the tick's own time, but for what the wall clock was set or slewed meanwhile.
    peak_rate = math.radians(15.0) * 2.0 * math.pi * 0.9
    # A set-point that was handed over late shortens the next step; on simulated time test_device_loop.py asks for all.
    assert np.median(np.abs(angles[moving][settled] - expected)) < 1e-3 + peak_rate * drift


@pytest.mark.parametrize("repeat", [False, True])
def test_a_swim_ends_when_the_tail_stands_at_neutral_and_not_before(
    driver: StartedProcess, client: RobotClient, port: PtyPort, repeat: bool
) -> None:
    """Who leads a robot to rest waits for READY, and may take the force from the tail then."""
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    client.publish_gait(STILL, repeat=repeat)
    ready = client.wait_for_state(State.READY)
    assert ready.reason == ""
    client.wait_until(lambda: stamps_and_angles(client)[-1][0] > ready.stamp + 200_000_000, "what the tail does then")
    moving = [stamp for stamp, angle in stamps_and_angles(client) if angle != 0.0]
    assert moving
    assert max(moving) < ready.stamp - 50_000_000, "held at neutral before"


def stamps_of(client: RobotClient) -> list[int]:
    return [nanoseconds_of(m.header.stamp) for m in client.received(topics.JOINT_STATES)]


def stamps_and_angles(client: RobotClient) -> list[tuple[int, float]]:
    return [(nanoseconds_of(m.header.stamp), m.position[0]) for m in client.received(topics.JOINT_STATES)]


# -- the four tests of a stale command -------------------------------------------------------------------------------


def test_a_stale_command_times_out_to_neutral_and_then_no_pulse(
    driver_as_it_comes: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver_as_it_comes
    client.make_ready()
    swim_a_little(client, port, 0.0)
    client.publish_gait(None)
    client.wait_until(lambda: not pulses(port), "silence")
    assert recorder(port).widths[-1] == 1500.0
    state = client.wait_for_state(State.READY)
    assert "no fresh gait within command_timeout: nothing came on topic /fish/gait, which /fish/" in state.reason
    client.wait_until(lambda: client.received(topics.GAIT_APPLIED)[-1].data[0] == 0.0, "gait_applied of no amplitude")
    sent = len(recorder(port).widths)
    client.spin(1.0)
    assert len(recorder(port).widths) == sent


@pytest.mark.long
def test_a_driver_that_was_stopped_as_a_whole_does_not_go_on_with_its_swim(
    driver_as_it_comes: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    """Ctrl-Z and fg: it finds gaits that are waiting for it before it finds that none came."""
    client.make_ready()
    swim_a_little(client, port, 0.0)
    begun = client.wait_for_state(State.SWIMMING).stamp
    driver_as_it_comes.signal(signal.SIGSTOP)
    client.spin(1.0)
    driver_as_it_comes.signal(signal.SIGCONT)

    def ended() -> bool:
        state = client.state()
        return state is not None and state.stamp != begun

    client.wait_until(ended, "that swim's end", 20.0)


def test_deactivating_leads_to_neutral_and_then_no_pulse(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    client.make_ready()

    def deactivated_in_time() -> bool:
        client.activate()
        swim_a_little(client, port, 0.0)
        late = driver.output().count("did not reach neutral in time")  # on a machine that puts it aside for long
        assert client.change_state(DEACTIVATE)
        return driver.output().count("did not reach neutral in time") == late

    assert client.change_state(DEACTIVATE)
    client.wait_until(deactivated_in_time, "a tail that is led to neutral")
    client.wait_until(lambda: not pulses(port), "silence")  # the frame may be on its way to the board
    assert recorder(port).widths[-1] == 1500.0
    sent = len(recorder(port).widths)
    client.spin(1.0)  # the gait is still repeated
    assert len(recorder(port).widths) == sent
    assert client.change_state(CLEAN_UP)
    assert client.life_cycle() == UNCONFIGURED
    client.configure()
    client.activate()
    client.wait_for_state(State.SWIMMING)  # armed anew by an explicit act, it follows the next gait


def test_the_first_pulses_are_numbers_and_neutral(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    assert recorder(port).widths[0] == 1500.0
    steps = np.abs(np.diff(recorder(port).widths))
    assert np.max(steps) <= LONGEST_STEP


def test_the_timeout_cannot_be_switched_off_by_a_slip(
    start: Callable[..., StartedProcess], client: RobotClient, port: PtyPort
) -> None:
    driver = start_driver(start, f"port:={port.path}", "command_timeout:=0.0")
    assert driver.wait() == 2
    assert "command_timeout = 0 s is outside the allowed range [0.05, 10] s" in driver.output()
    driver = start_driver(start, f"port:={port.path}", "watchdog.disabled_knowingly:=true")
    client.make_ready()
    driver.wait_for_output("the command watchdog is OFF")
    swim_a_little(client, port, 0.0)
    client.publish_gait(gait_message(PAPER_GAIT.rows()))
    client.spin(1.5)
    assert pulses(port)
    assert client.set_parameters({"watchdog.disabled_knowingly": False}).successful is False


# -- ways out --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP, pytest.param(signal.SIGQUIT, marks=pytest.mark.long)]
)
def test_a_signal_stops_the_pulses_and_moves_nothing(
    driver: StartedProcess, client: RobotClient, port: PtyPort, number: signal.Signals
) -> None:
    client.make_ready()
    swim_a_little(client, port)
    driver.signal(number)
    assert driver.wait(5.0) == 128 + number
    wait_until(lambda: not pulses(port), 2.0, "silence")
    steps = np.abs(np.diff(recorder(port).widths))
    assert steps.max() <= LONGEST_STEP
    assert recorder(port).widths[-1] != 1500.0 or steps[-1] < 20.0, "no leap to neutral"


def test_a_signal_ends_the_wait_for_a_banner(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    port.silent = True
    answer = client.ask_for_state(CONFIGURE)
    client.wait_until(lambda: port._is_open, "an open port")
    assert driver.interrupt() == 130
    assert "no Firmata banner" not in driver.output(), "the board is waited for during 5 s"
    assert "Traceback" not in driver.output()
    assert not answer.done() or not answer.result().success


def test_a_node_that_is_started_without_any_setting_stays_on_this_machine_and_is_seen_by_any_tool_there(
    start: Callable[..., StartedProcess], port: PtyPort, ros_domain: int
) -> None:
    unset = {PROFILES: "", RANGE: ""}  # as with `ros2 run`
    words = ["--ros-args", "-p", "robot_file:=firmata", "-p", f"port:={port.path}"]
    driver = start("fin_servo_driver", "servo_driver", *words, environment=unset)
    tool = """
import rclpy, sys, time
from rcl_interfaces.srv import ListParameters
rclpy.init()
node = rclpy.create_node("tool")
client = node.create_client(ListParameters, "/fish/servo_driver/list_parameters")
assert client.wait_for_service(60.0)
answer = client.call_async(ListParameters.Request())
rclpy.spin_until_future_complete(node, answer, timeout_sec=60.0)
until = time.monotonic() + 60.0  # the names come by a topic of their own
while "servo_driver" not in node.get_node_names() and time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.1)
assert "servo_driver" in node.get_node_names()
print("parameters:", len(answer.result().result.names))
"""
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    told = subprocess.run(
        [sys.executable, "-c", tool], env=environment, capture_output=True, text=True, check=False, timeout=150
    )
    assert told.returncode == 0, told.stderr
    assert int(told.stdout.rpartition(":")[2]) > 10
    assert udp_addresses(driver.pid) == {"127.0.0.1", "239.255.0.1"}  # and discovery's group, joined there


def udp_addresses(pid: int) -> set[str]:
    """Return the addresses that a process' UDP sockets are bound to."""
    inodes = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(str(link.readlink()).removeprefix("socket:[").removesuffix("]"))
    sockets = (line.split() for line in Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:])
    return {
        ".".join(str(byte) for byte in reversed(bytes.fromhex(socket[1].partition(":")[0])))
        for socket in sockets
        if socket[9] in inodes
    }


def test_the_emergency_stop_is_at_once_and_latched(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port)
    assert client.emergency_stop(on=True).success
    client.wait_until(lambda: not pulses(port), "silence", timeout=0.2)
    client.wait_for_state(State.FAULT)
    sent = len(recorder(port).widths)
    client.spin(0.7)
    assert len(recorder(port).widths) == sent
    assert not client.request_reset().success
    assert not client.confirm_mark().success
    assert client.change_state(DEACTIVATE)
    assert not client.change_state(ACTIVATE)
    assert client.emergency_stop(on=False).success
    client.activate()
    client.wait_for_state(State.WAITING_FOR_RESET)
    client.spin(0.5)
    assert len(recorder(port).widths) == sent
    assert client.request_reset().success
    client.wait_for_state(State.WAITING_FOR_RESET)
    assert client.confirm_mark().success
    client.wait_for_state(State.SWIMMING)


@pytest.mark.parametrize("transition", [DEACTIVATE, SHUT_DOWN])
def test_the_emergency_stop_does_not_wait_for_a_tail_that_is_led_to_neutral(
    start: Callable[..., StartedProcess], client: RobotClient, tmp_path: Path, transition: int
) -> None:
    joint = {"channel": 9, "centre": 1500, "direction": -1, "units_per_radian": 573, "lowest": 1400, "highest": 1600}
    robot = robot_with(tmp_path, joints=[{**joint, "rate": 0.045}])  # back at neutral after four seconds
    with plugged_in(Recorder(), tmp_path) as port:
        start_driver(start, f"robot_file:={robot}", "command_timeout:=10.0")
        client.make_ready()
        client.publish_gait(gait_message([[0.0, 0.9, 0.0, 0.15]]), repeat=True)
        client.wait_until(lambda: max(recorder(port).widths, default=0.0) > 1570.0, "the way to the right")
        ended = client.ask_for_state(transition)
        client.wait_until(lambda: recorder(port).widths[-1] < max(recorder(port).widths), "the way back")
        assert pulses(port)
        assert client.emergency_stop(on=True).success
        client.wait_until(lambda: not pulses(port), "silence")
        assert recorder(port).widths[-1] > 1500.0, "before it was there"
        client.wait_until(ended.done, "the end of the transition", timeout=1.0)
        assert ended.result().success
        client.wait_for_state(State.FAULT)
        assert client.life_cycle() == (INACTIVE if transition == DEACTIVATE else FINALIZED)


def test_after_an_emergency_stop_nothing_that_an_optimiser_calls_leads_on(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)  # whose gait goes on being sent
    assert client.emergency_stop(on=True).success
    assert client.emergency_stop(on=False).success
    assert client.wait_for_state(State.WAITING_FOR_RESET).details["waiting_for"] == "mark"
    client.wait_until(lambda: not pulses(port), "silence")  # the frame may be on its way to the board
    sent = len(recorder(port).widths)
    for _ in range(3):
        assert client.request_reset().success
        assert client.set_parameters({"fin.length": 0.08}).successful
        client.spin(0.3)
        state = client.state()
        assert state is not None
        assert state.details["waiting_for"] == "mark"
    assert len(recorder(port).widths) == sent
    assert client.confirm_mark().success
    client.wait_for_state(State.SWIMMING)


def test_an_emergency_stop_that_fails_says_so_and_the_next_one_is_served(ros_domain: int) -> None:
    answers: list[Answer] = []

    def act(stop: bool) -> Answer:
        if not answers:
            answers.append(Answer(accepted=stop, text="stopped"))
            msg = "something unforeseen"
            raise RuntimeError(msg)
        return answers[0]

    rclpy.init(domain_id=ros_domain)
    try:
        served = EmergencyStop(rclpy.create_node("servo_driver", namespace="/fish"), act)
        with RobotClient(ros_domain) as client:
            first, second = (client.emergency_stop(on=True) for _ in range(2))
        served.close()
    finally:
        rclpy.shutdown()
    assert (first.success, second.success) == (False, True)
    assert "use the switch" in first.message


def test_a_stop_that_is_told_before_the_node_has_noted_the_tails_rest_is_told_once(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another thread cuts, so any callback may tell of it first: the state has one stamp all the same."""
    published: list[Any] = []
    values = {name: parameter.default for name, parameter in PLANT_PARAMETERS.items()}
    states, stopped = RobotStates(values), Standing(State.FAULT, EMERGENCY, Waiting.RELEASE)
    rclpy.init(domain_id=ros_domain)
    try:
        subject = DriverTopics(rclpy.create_node("servo_driver", namespace="/fish"), "robot")
        monkeypatch.setattr(subject, "_state", SimpleNamespace(publish=published.append))
        states.swimming_since = 1
        subject.tell_state(stopped, states, values, "", (), anew=False)
        states.rest()
        subject.tell_state(stopped, states, values, "", (), anew=False)
    finally:
        rclpy.shutdown()
    assert len(published) == 1


def test_a_device_that_was_away_is_back_at_its_mark_only_when_a_person_says_so(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    port.unplug()
    client.wait_for_state(State.FAULT)
    stop = client.emergency_stop(on=True)
    assert not stop.success, "nothing has told the device, which may keep its force"
    assert "use its switch" in stop.message
    assert client.emergency_stop(on=False).success
    port.plug()
    assert client.wait_for_state(State.WAITING_FOR_RESET).details["waiting_for"] == "mark"
    assert client.request_reset().success
    client.spin(0.5)
    assert not pulses(port)
    assert client.confirm_mark().success
    client.wait_for_state(State.SWIMMING)


def test_a_fin_that_was_asked_off_and_on_again_is_confirmed_by_a_person(
    driver: StartedProcess, client: RobotClient
) -> None:
    del driver
    client.make_ready()
    for length in ("0.07", "0.08"):
        assert client.set_parameters({"fin.length": float(length)}).successful
        state = client.wait_for_state(State.WAITING_FOR_FIN)
        assert state.details["wanted.fin.length"] == length or length == "0.08"
    assert client.confirm_fin().success
    client.wait_for_state(State.READY)


def test_the_ramp_is_not_changed_in_a_swim(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    refused = client.set_parameters({"drive.ramp_time": 2.0})
    assert not refused.successful
    assert "stop the gait first" in refused.reason
    client.stop_swimming()
    assert client.set_parameters({"drive.ramp_time": 2.0}).successful


def test_a_rehearsal_takes_no_real_device(start: Callable[..., StartedProcess], client: RobotClient) -> None:
    start_driver(start, "plant:=rehearsal", "robot_file:=firmata", "port:=/dev/tty")
    assert not client.change_state(CONFIGURE)
    client.wait_until(lambda: "is no pseudo-terminal" in client.reason(), "the reason")


def test_a_killed_driver_leaves_an_arduino_pulsing(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    """What docs/robot.md warns of: only a power switch helps. A driver that is started anew stops it."""
    client.make_ready()
    swim_a_little(client, port, 0.0)
    driver.kill()
    client.wait_until(lambda: not port._is_open, "a port that nobody has open")
    assert pulses(port)


# -- gaits, fins, resets ---------------------------------------------------------------------------------------------


def test_bad_gaits_are_refused_counted_and_do_not_feed_the_watchdog(
    driver_as_it_comes: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver_as_it_comes
    client.make_ready()
    swim_a_little(client, port, 0.0)
    rows = [[math.nan, 0.9, 0.0, 0.0], [math.inf, 0.9, 0.0, 0.0], [0.1, 0.9, 0.0], [], [0.1, 0.9, 0.0, 0.0] * 2]
    for data in rows:
        client.publish_gait(Float64MultiArray(data=data), repeat=True)
        client.spin(0.25)
    client.wait_until(lambda: not pulses(port), "silence")
    client.wait_until(lambda: int(client.diagnostic("gaits_refused") or 0) >= len(rows), "count of refusals")
    assert all(LOWEST <= width <= HIGHEST for width in recorder(port).widths)


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=[pytest.mark.long, pytest.mark.timeout(600)])])
def test_no_message_makes_the_node_fail_or_the_tail_leave_its_limits(
    driver: StartedProcess, client: RobotClient, port: PtyPort, count: int
) -> None:
    client.make_ready()
    random = np.random.default_rng(21)

    def send() -> None:
        for number, message in enumerate(random_gaits(random, count)):
            client.publish_gait(message)
            if number % 20 == 0:
                client.spin(0.005)

    send()
    # Its queue keeps the newest only, so most are overtaken, on a busy machine nearly all.
    wait_until(lambda: int(client.diagnostic("gaits_refused") or 0) > 20, 60.0, "refusals", send)
    wait_until(lambda: len(set(recorder(port).widths)) > 10, 60.0, "some of it moves the tail", send)
    client.publish_gait(None)
    assert driver.running
    assert "Traceback" not in driver.output()
    assert all(LOWEST <= width <= HIGHEST for width in recorder(port).widths)
    client.publish_gait(gait_message(PAPER_GAIT.rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)


def test_a_gait_beyond_the_limits_is_applied_inside_them_and_said_so(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    client.publish_gait(gait_message(carangiform(1.5, 50.0).rows()), repeat=True)
    client.wait_for_state(State.SWIMMING)
    client.wait_until(lambda: client.received(topics.GAIT_APPLIED)[-1].data[0] > 0.0, "gait_applied")
    amplitude, frequency, *_ = client.received(topics.GAIT_APPLIED)[-1].data
    assert frequency == 5.0
    assert amplitude == pytest.approx(6.0 / (2.0 * math.pi * 5.0))  # the joint's rate limits it
    client.spin(1.0)
    assert all(LOWEST <= width <= HIGHEST for width in recorder(port).widths)
    client.wait_until(lambda: int(client.diagnostic("gaits_limited") or 0) > 0, "count of limited gaits")


def test_another_fin_stops_the_tail_until_it_is_mounted(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    assert not client.confirm_fin().success
    swim_a_little(client, port, 0.0)
    assert client.set_parameters({"fin.young_modulus": 2.35e9, "fin.length": 0.07}).successful
    state = client.wait_for_state(State.WAITING_FOR_FIN)
    assert "polycarbonate" in state.reason
    assert "length 70.0 mm, height 25.0 mm, thickness 0.208 mm" in state.reason
    assert state.details["wanted.fin.length"] == "0.07"
    assert state.fin["fin.length"] == "0.08"
    client.wait_until(lambda: not pulses(port), "silence")
    assert not client.request_reset().success
    client.publish_gait(None)
    assert client.confirm_fin().success
    assert client.wait_for_state(State.READY).fin["fin.length"] == "0.07"


@pytest.mark.parametrize(
    "values", [{"fin.young_modulus": -1.0}, {"fin.length": 1e-4}, {"fin.thickness": 0.02, "fin.height": 0.01}]
)
def test_a_bad_fin_is_refused_and_changes_nothing(
    driver: StartedProcess, client: RobotClient, values: dict[str, float]
) -> None:
    del driver
    client.make_ready()
    before = client.state()
    result = client.set_parameters(values)
    assert not result.successful
    assert "fin." in result.reason
    client.spin(0.2)
    assert client.state() == before


def test_a_reset_is_asked_for_by_programs_and_confirmed_by_a_person(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    assert not client.confirm_mark().success
    swim_a_little(client, port, 0.0)
    assert client.request_reset().success
    first = client.wait_for_state(State.WAITING_FOR_RESET)
    assert first.details["waiting_for"] == "mark"
    client.wait_until(lambda: not pulses(port), "silence")
    client.publish_gait(None)
    assert client.confirm_mark().success
    client.wait_for_state(State.READY)
    # A trial is given up while the operator is asked: the next one's questions are no answer to it.
    assert client.request_reset().success
    client.wait_for_state(State.WAITING_FOR_RESET)
    assert client.set_parameters({"fin.length": 0.08}).successful
    assert client.request_reset().success
    client.spin(0.3)
    state = client.state()
    assert state is not None
    assert state.state is State.WAITING_FOR_RESET
    assert state.stamp > first.stamp
    # A second driver of the same name, be it a rehearsal's, would get whatever is confirmed to this one, and this one
    # what an emulated operator confirms to the other.
    with client.another_plant():
        client.wait_until(lambda: "2 plants publish topic /fish/plant_state" in client.reason(), "a plant not alone")
        assert not client.confirm_fin().success
        assert client.change_state(DEACTIVATE)
        assert not client.change_state(ACTIVATE)
    client.wait_until(lambda: "not armed" in client.reason(), "a plant alone")


# -- bad set-ups: configure fails with the reason --------------------------------------------------------------------


def robot_with(tmp_path: Path, **changes: object) -> Path:
    joint = {"channel": 9, "centre": 1500, "direction": 1, "units_per_radian": 573, "lowest": 1200, "highest": 1800}
    content = {"device": "firmata", "port": str(tmp_path / "port"), "baud": 57600, "joints": [joint], **changes}
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def refusal(client: RobotClient) -> str:
    """Try to configure; return why that failed."""
    assert not client.change_state(CONFIGURE)
    assert client.life_cycle() == UNCONFIGURED
    client.wait_until(lambda: "cannot configure" in client.reason(), "reason")
    state = client.state()
    assert state is not None
    assert state.state is State.WAITING_FOR_RESET
    assert state.details["waiting_for"] == "configuring"
    return state.reason


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"device": "telepathy"}, "device 'telepathy' is not known: choose one of dynamixel, firmata"),
        ({"joints": [{"left": 1, "right": 1}]}, "channel 1 is used by joint 1 and joint 1"),
        (
            {
                "joints": [
                    {"channel": 9, "centre": 2000, "direction": 1, "units_per_radian": 5, "lowest": 1, "highest": 9}
                ]
            },
            "centre = 2000 must lie between lowest = 1 and highest = 9",
        ),
    ],
)
def test_a_bad_robot_file_is_refused(
    start: Callable[..., StartedProcess],
    client: RobotClient,
    tmp_path: Path,
    changes: dict[str, Any],
    complaint: str,
) -> None:
    path = robot_with(tmp_path, **changes)
    start_driver(start, f"robot_file:={path}")
    reason = refusal(client)
    assert str(path) in reason or "telepathy" in reason
    assert complaint in reason


def test_an_absent_port_is_refused(start: Callable[..., StartedProcess], client: RobotClient, tmp_path: Path) -> None:
    start_driver(start, f"port:={tmp_path}/none")
    assert f"port {tmp_path}/none is absent: is the device plugged in?" in refusal(client)


def test_a_busy_port_is_refused(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    with serial.Serial(str(port.path), exclusive=True):
        assert f"port {port.path} is busy: close the other program" in refusal(client)
    client.configure()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything; the text is tested in test_servo_port.py")
def test_a_port_without_permission_is_refused(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    port.path.resolve().chmod(stat.S_IRUSR)
    assert "is not permitted to you: it belongs to the group" in refusal(client)


def test_a_wrong_device_is_refused_by_its_missing_banner(
    start: Callable[..., StartedProcess], client: RobotClient
) -> None:
    master, slave = pty.openpty()
    try:
        start_driver(start, f"port:={os.ttyname(slave)}")
        reason = refusal(client)
    finally:
        os.close(master)
        os.close(slave)
    assert "no Firmata banner within 5 s" in reason
    assert "57600" in reason


def test_a_wrong_baud_rate_shows_as_garbage_without_a_banner(
    start: Callable[..., StartedProcess], client: RobotClient, tmp_path: Path
) -> None:
    class Garbled(Firmata):
        def opened(self, now: float) -> bytes:
            return bytes(byte ^ 0x5A for byte in super().opened(now))

        def feed(self, data: bytes, now: float) -> bytes:
            return bytes(byte ^ 0x5A for byte in super().feed(data, now))

    with plugged_in(Garbled(), tmp_path) as garbled:
        start_driver(start, f"port:={garbled.path}")
        reason = refusal(client)
    assert "other bytes came" in reason
    assert "baud rate (now 57600)" in reason


def test_without_a_robot_file_the_advice_is_to_give_one(
    start: Callable[..., StartedProcess], client: RobotClient
) -> None:
    start("fin_servo_driver", "servo_driver")
    assert "robot_file is empty: give the path of your robot's YAML file, or an example" in refusal(client)


def test_a_device_that_falls_silent_is_lost_and_comes_back(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    port.silent = True
    client.wait_for_state(State.FAULT)
    assert "fallen silent" in client.reason()
    assert client.life_cycle() == ACTIVE
    port.silent = False
    assert client.wait_for_state(State.WAITING_FOR_RESET, timeout=15.0).details["waiting_for"] == "mark"
    assert client.confirm_mark().success
    client.wait_for_state(State.SWIMMING)


def test_lost_bytes_never_lead_beyond_the_limits(driver: StartedProcess, client: RobotClient, port: PtyPort) -> None:
    del driver
    client.make_ready()
    swim_a_little(client, port, 0.0)
    port.drop_rate = 0.05
    begun = len(recorder(port).widths)

    def goes_on() -> bool:
        """Whether three seconds of set-points have come; a line that was lost meanwhile is back at its mark at once."""
        state = client.state()
        if state is not None and state.details["waiting_for"] == "mark":
            client.confirm_mark()
        return len(recorder(port).widths) > begun + 150

    client.wait_until(goes_on, "three seconds of set-points")
    # A broken frame may carry any width to the board; the firmware's own range, as coarse as it is, stops it there.
    widths = recorder(port).widths
    assert all(1056.0 <= width <= 1892.0 for width in widths)
    assert sum(LOWEST <= width <= HIGHEST for width in widths) > 0.8 * len(widths)


class Deaf(Modbus):
    """A board that hears, while `deaf`, only each third order to switch."""

    def __init__(self) -> None:
        super().__init__(1)
        self.deaf = False
        self.orders = 0

    def _execute(self, frame: bytes) -> bytes:
        if frame[1] == 0x05:
            self.orders += 1
            if self.deaf and self.orders % 3:
                return b""
        return super()._execute(frame)


def test_a_device_that_takes_long_to_start_is_one_swim(
    start: Callable[..., StartedProcess], client: RobotClient, tmp_path: Path
) -> None:
    board = Deaf()
    with plugged_in(board, tmp_path) as port:
        start_driver(start, "robot_file:=modbus", f"port:={port.path}", "command_timeout:=10.0")
        client.make_ready()
        before = len(client.received(topics.PLANT_STATE))
        board.deaf = True
        board.orders = 0
        client.publish_gait(gait_message(carangiform(math.radians(15.0), 1.0).rows()), repeat=True)
        client.wait_until(lambda: board.orders > 5, "the relays' start")
        board.deaf = False
        client.wait_until(lambda: any(board.outputs.values()), "a stroke")
        client.spin(0.5)
        states = [plant_state_from_message(message) for message in client.received(topics.PLANT_STATE)[before:]]
        assert {state.state for state in states} == {State.SWIMMING}
        assert len({state.stamp for state in states}) == 1


def test_relays_swim_and_their_operations_are_counted(
    start: Callable[..., StartedProcess], client: RobotClient, tmp_path: Path
) -> None:
    board = SilentRelays(lcus.switch_frame)
    with plugged_in(board, tmp_path) as port:
        start_driver(start, "robot_file:=lcus", f"port:={port.path}", "command_timeout:=10.0")
        client.make_ready()
        client.publish_gait(gait_message(carangiform(math.radians(15.0), 2.0).rows()), repeat=True)
        client.wait_for_state(State.SWIMMING)
        for relay, operations in ((1, 3), (2, 2)):
            key = f"relay_{relay}_operations"
            client.wait_until(lambda key=key, least=operations: int(client.diagnostic(key) or 0) >= least, key)  # type: ignore[misc]
        assert client.emergency_stop(on=True).success
        client.wait_until(lambda: not any(board.outputs.values()), "all relays off")


def test_a_transition_that_its_state_does_not_have_is_refused_and_changes_nothing(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    assert not client.change_state(ACTIVATE)
    client.make_ready()
    swim_a_little(client, port, 0.0)
    for transition in (CONFIGURE, ACTIVATE, CLEAN_UP, 250):
        assert not client.change_state(transition)
    assert driver.running
    assert client.life_cycle() == ACTIVE
    state = client.state()
    assert state is not None
    assert state.state is State.SWIMMING


def test_inactive_it_keeps_its_port_and_publishes_its_state(
    driver: StartedProcess, client: RobotClient, port: PtyPort
) -> None:
    del driver, port
    client.configure()
    assert client.life_cycle() == INACTIVE
    assert client.confirm_fin().success
    client.wait_until(lambda: "not armed" in client.reason(), "a question to arm")
    client.wait_for_state(State.WAITING_FOR_RESET)
    assert client.request_reset().success
    assert not client.confirm_mark().success  # the driver is to be armed first
    client.activate()
    assert client.wait_for_state(State.WAITING_FOR_RESET).details["waiting_for"] in {"mark", "arming"}
    client.wait_until(lambda: "mark" in client.reason(), "wait for the mark")
    assert client.confirm_mark().success
    client.wait_for_state(State.READY)
