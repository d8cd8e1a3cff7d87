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
