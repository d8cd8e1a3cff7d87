"""The output of a study goes away: the study goes on, and who stops it then still stops everything in order."""

from __future__ import annotations

import csv
import itertools
import os
import signal
import subprocess
import time
from typing import IO, TYPE_CHECKING

import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.study.records import read_trials
from fin_optimizer.trial.result import Outcome
from fin_plant import topics
from fin_plant.messages import time_message
from fin_plant.plant_state import State
from fin_servo_driver.emulator.devices import Firmata
from support.processes import executable_path, workspace_environment
from support.robot_client import ACTIVATE, RobotClient, plugged_in
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Bringup = subprocess.Popen[bytes]
    StartBringup = Callable[..., Bringup]

pytestmark = pytest.mark.graph
SHORT = ("measurement.duration:=1.0",)
NEUTRAL = 1500.0
"""us, of the example robot."""
END_SECONDS = 180.0
"""A kernel that is being compiled, on a machine that is busy, is neither interrupted nor quick."""


class Board(Firmata):
    """The emulated Arduino, with every pulse width that it was told."""

    def __init__(self) -> None:
        super().__init__()
        self.widths = [0.0]

    def _pulse(self, pin: int, width: int) -> None:
        super()._pulse(pin, width)
        self.widths.append(float(width))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "study"


@pytest.fixture
def bringup(ros_domain: int, tmp_path: Path, folder: Path) -> Iterator[StartBringup]:
    """Start bring-ups with an output of the test's choice, and in a terminal of their own if it is given."""
    started: list[Bringup] = []
    environment = workspace_environment() | {"ROS_DOMAIN_ID": str(ros_domain), "ROS_LOG_DIR": str(tmp_path / "log")}

    def start(*arguments: str, stdout: int, stderr: int, terminal: int | None = None) -> Bringup:
        before = () if terminal is None else ("setsid", "--ctty")
        command = [*before, str(executable_path("fin_optimizer", "bringup")), f"study_folder:={folder}", *arguments]
        stdin = subprocess.DEVNULL if terminal is None else terminal
        process = subprocess.Popen(command, stdin=stdin, stdout=stdout, stderr=stderr, env=environment, cwd=tmp_path)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()  # its nodes end with it
        process.wait()


def reader_of(process: Bringup) -> IO[bytes]:
    assert process.stdout is not None
    return process.stdout


def outcomes(folder: Path) -> list[Outcome]:
    return [trial.outcome for trial in read_trials(folder)]


def check_an_orderly_end(folder: Path) -> None:
    """The optimiser has had its time: the trial under way is told, its bag closed, the table written."""
    trials = read_trials(folder)
    assert trials[-1].outcome is Outcome.INTERRUPTED
    assert "in phase" in trials[-1].reason
    assert all(read_bag(folder / trial.bag).complete for trial in trials if trial.bag)
    with (folder / "trials.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == len(trials)


@pytest.mark.long
def test_a_study_whose_reader_has_seen_enough_runs_to_its_end(
    bringup: StartBringup, folder: Path, tmp_path: Path
) -> None:
    """As `bringup trials:=8 | head -2` does."""
    with (tmp_path / "errors").open("wb") as errors:
        study = bringup("trials:=8", *SHORT, stdout=subprocess.PIPE, stderr=errors.fileno())
    reader = reader_of(study)
    lines = [reader.readline(), reader.readline()]
    reader.close()
    assert lines[1].startswith(b"trial 0000")
    assert study.wait(END_SECONDS) == 0
    assert outcomes(folder) == [Outcome.OK] * 8
    assert (folder / "speed_over_modulus.png").exists()
    said = (tmp_path / "errors").read_text()
    assert "Traceback" not in said
    assert "Exception ignored" not in said


@pytest.mark.long
def test_a_study_whose_log_is_on_a_full_disk_runs_to_its_end(bringup: StartBringup, folder: Path) -> None:
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        study = bringup("trials:=2", *SHORT, stdout=full.fileno(), stderr=full.fileno())
    assert study.wait(END_SECONDS) == 0
    assert outcomes(folder) == [Outcome.OK] * 2


@pytest.mark.long
def test_a_study_on_a_terminal_that_goes_away_without_a_word_runs_to_its_end(
    bringup: StartBringup, folder: Path
) -> None:
    """As one that was sent to the background and disowned."""
    master, slave = os.openpty()
    study = bringup("trials:=4", *SHORT, stdout=slave, stderr=slave)
    os.close(slave)
    swum = folder / "bags"
    wait_until(lambda: list(swum.glob("trial_0001_*")), 30, "the second trial", lambda: os.read(master, 4096))
    os.close(master)
    assert study.wait(END_SECONDS) == 0
    assert outcomes(folder) == [Outcome.OK] * 4


def test_a_terminal_that_is_closed_ends_a_study_in_order(bringup: StartBringup, folder: Path) -> None:
    master, slave = os.openpty()
    study = bringup("trials:=1000", "speed:=4", stdout=slave, stderr=slave, terminal=slave)
    os.close(slave)
    swum = folder / "bags"
    wait_until(
        lambda: list(swum.glob("trial_0000_*/*.mcap")), END_SECONDS, "the first swim", lambda: os.read(master, 4096)
    )
    os.close(master)
    assert study.wait(END_SECONDS) == 129
    check_an_orderly_end(folder)


def test_without_a_reader_ctrl_c_still_leads_a_robots_tail_to_neutral(
    bringup: StartBringup, folder: Path, ros_domain: int, tmp_path: Path
) -> None:
    """As `bringup 2>&1 | tee log` does, where Ctrl-C ends the reader too."""
    board = Board()
    with plugged_in(board, tmp_path) as port, RobotClient(ros_domain) as person:
        robot = ("plant:=robot", "robot_file:=firmata", f"port:={port.path}")
        study = bringup(*robot, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        watch(person)
        let_it_swim(person)
        reader_of(study).close()
        # Again and again: the driver keeps the newest gait only, and the optimiser sends some too.
        person.publish_gait(Float64MultiArray(data=[1.0]), repeat=True)
        person.wait_until(lambda: int(person.diagnostic("gaits_refused") or 0) > 0, "a warning that nobody reads")
        person.publish_gait(None)
        person.wait_until(lambda: swims(person) and board.widths[-1] > NEUTRAL + 100.0, "a stroke")
        study.send_signal(signal.SIGINT)
        assert study.wait(END_SECONDS) == 130
        wait_until(lambda: not board.outputs, 30.0, "no more pulses")
        assert board.widths[-1] == NEUTRAL
    check_an_orderly_end(folder)


def watch(person: RobotClient) -> None:
    """Be the tracker, whenever the client waits; it sees the fish where it is held, with the noise of a camera."""
    poses = person._node.create_publisher(topics.POSE.type, topics.POSE.name, topics.POSE.qos)
    noise = itertools.cycle((0.0, 1e-5, -1e-5))

    def see() -> None:
        pose = PoseStamped()
        pose.header.frame_id = topics.TANK_FRAME
        pose.header.stamp = time_message(time.time_ns())
        pose.pose.position.x = next(noise)
        poses.publish(pose)

    person._node.create_timer(0.02, see)


def let_it_swim(person: RobotClient) -> None:
    """Do whatever the driver waits for, until the fish swims."""
    person.wait_until(lambda: swims(person), "swim")


def swims(person: RobotClient) -> bool:
    """Do what the driver waits for, and return whether the fish swims."""
    act = {
        "configuring": person.configure,
        "fin": person.confirm_fin,
        "arming": lambda: person.change_state(ACTIVATE),
        "mark": person.confirm_mark,
    }
    state = person.state()
    if state is not None and (waiting := state.details.get("waiting_for")):
        act[waiting]()
    return state is not None and state.state is State.SWIMMING
