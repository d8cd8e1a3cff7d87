"""A node's process ends, whatever happens in it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import Float64MultiArray

from fin_plant.gait import PAPER_GAIT
from fin_plant.node_process import END_BY_SIGNAL_IS_SUCCESS
from support.plant_tester import PlantTester
from support.processes import executable_path
from support.waiting import PATIENCE

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.graph
DEFECT = """
import sys
from fin_sim import simulator

def defect(self, samples):
    raise TypeError("a defect")

simulator.Simulator._advance = defect
sys.exit(simulator.main(["--ros-args"]))
"""


def test_a_defect_ends_the_process_with_its_traceback_and_exit_code_1(ros_domain: int) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", DEFECT], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert ended.returncode == 1
    assert "TypeError: a defect" in ended.stderr


DEFECT_AT_THE_END = """
import rclpy
from fin_sim import simulator

def defect(self):
    raise TypeError("a defect")

simulator.Simulator.finished = lambda self: 0
simulator.Simulator.close = defect
try:
    simulator.main(["--ros-args"])
finally:
    print("ROS is", "up" if rclpy.ok() else "down")
"""


def test_a_defect_while_it_closes_still_shuts_everything_down(ros_domain: int) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", DEFECT_AT_THE_END], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert ended.returncode == 1
    assert "TypeError: a defect" in ended.stderr
    assert ended.stdout == "ROS is down\n"


@pytest.mark.parametrize(("arguments", "code"), [(("--help",), 0), (("--ros-args", "-p", "speed:=-1.0"), 2)])
def test_a_full_disk_does_not_change_the_exit_code(ros_domain: int, arguments: tuple[str, ...], code: int) -> None:
    command = [str(executable_path("fin_sim", "simulator")), *arguments]
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        ended = subprocess.run(command, stdout=full, stderr=full, timeout=PATIENCE, check=False)
    assert ended.returncode == code


def test_a_node_that_launch_interrupts_has_ended_well(ros_domain: int) -> None:
    environment = os.environ | {END_BY_SIGNAL_IS_SUCCESS: "1"}
    node = subprocess.Popen([executable_path("fin_sim", "simulator")], env=environment)
    try:
        with PlantTester(ros_domain) as client:
            client.swim(PAPER_GAIT, 0.2)
        node.send_signal(signal.SIGINT)
        assert node.wait(PATIENCE) == 0
    finally:
        node.kill()
        node.wait()


def test_a_node_goes_on_and_logs_to_its_file_where_nobody_reads_its_errors(ros_domain: int, tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    environment = os.environ | {"ROS_LOG_DIR": str(tmp_path)}
    node = subprocess.Popen([executable_path("fin_sim", "simulator")], stdout=writer, stderr=writer, env=environment)
    os.close(writer)
    try:
        with PlantTester(ros_domain) as client:
            client.publish_gait(Float64MultiArray(data=[1.0]))
            client.wait_until(lambda: "gait refused" in "".join(log.read_text() for log in tmp_path.iterdir()), "a log")
            client.swim(PAPER_GAIT, 0.2)
        node.send_signal(signal.SIGINT)
        assert node.wait(PATIENCE) == 130
    finally:
        node.kill()
        node.wait()


THREADS = """
import time
import numpy as np
import scipy.linalg
from fin_sim import simulator

def processor_time(pause):
    matrix = np.random.default_rng(1).random((40, 40))
    begin = time.process_time()
    for _ in range(20):
        scipy.linalg.expm(matrix)
        time.sleep(pause)
    return time.process_time() - begin

def compute(self):
    processor_time(0.0)
    print("processor time", processor_time(0.02) - processor_time(0.0))
    return 0

simulator.Simulator.finished = compute
simulator.main(["--ros-args"])
"""


def test_no_helper_thread_of_the_linear_algebra_spins_on_a_core_that_others_need(ros_domain: int) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", THREADS], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    # 20 pauses of 0.02 s, through which such a thread spins; the work itself costs the same without them.
    assert float(ended.stdout.split()[-1]) < 0.2
