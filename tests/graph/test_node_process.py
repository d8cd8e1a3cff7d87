"""A node's process ends, whatever happens in it."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
    ended = subprocess.run([sys.executable, "-c", DEFECT], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert "TypeError: a defect" in ended.stderr


THREADS = """
import time
import numpy as np
import scipy.linalg
from fin_sim import simulator

def compute(self):
    matrix = np.random.default_rng(1).random((40, 40))
    begin = time.process_time()
    for _ in range(20):
        scipy.linalg.expm(matrix)
        time.sleep(0.02)
    print("processor time", time.process_time() - begin)
    return 0

simulator.Simulator.finished = compute
simulator.main(["--ros-args"])
"""


def test_no_helper_thread_of_the_linear_algebra_spins_on_a_core_that_others_need(ros_domain: int) -> None:
    ended = subprocess.run([sys.executable, "-c", THREADS], capture_output=True, text=True, timeout=60, check=False)
    # 20 pauses of 0.02 s, through which such a thread spins; the work itself is 20 ms.
    assert float(ended.stdout.split()[-1]) < 0.2
