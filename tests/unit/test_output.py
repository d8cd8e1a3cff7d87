"""The output of a process that outlasts its reader; what becomes of studies and nodes is in the graph tests."""

from __future__ import annotations

import os
import select
import subprocess
import sys

import pytest

SAY = """
import sys
from fin_plant.output import go_on_when_output_closes

go_on_when_output_closes()
sys.{stream}.write("a line\\n")
sys.stdin.read()
"""


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_line_is_written_at_once(stream: str, unbuffered: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SAY.format(stream=stream)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    ) as process:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], 20.0)[0], "nothing came while the process was running"
        assert process.communicate()[0] == b"a line\n"
    assert process.returncode == 0


@pytest.mark.parametrize(("launched", "code"), [({}, 130), ({"FIN_END_BY_SIGNAL_IS_SUCCESS": "1"}, 0)])
def test_an_executable_that_is_interrupted_while_it_loads_ends_as_its_starter_expects(
    launched: dict[str, str], code: int
) -> None:
    """Of 130 launch would say in red that the process has died."""
    words = "import os, signal; from fin_plant import start; start._listen(); signal.raise_signal(signal.SIGINT)"
    done = subprocess.run([sys.executable, "-c", words], env=os.environ | launched, check=False)
    assert done.returncode == code
