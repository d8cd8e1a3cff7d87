"""Whatever happens to the bring-up's output, each of its processes is asked to end before it may be killed.

The nodes are small shell scripts in the place of the real ones; tests/graph/test_bringup_output.py has those.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

NODES = {"simulator": "fin_sim", "optimizer": "fin_optimizer"}
# A real node ignores SIGPIPE, as every Python does.
NODE = """#!/bin/sh
say() {{ echo "{name} $1" >> {diary}; }}
trap '' PIPE
trap 'echo "the last words" >&2; say ended; exit 7' TERM
say began
while [ ! -e {folder}/{name}_may_end ]; do echo "going on" >&2; sleep 0.05; done
say "ended by itself"
exit 3
"""
BRINGUP = """
import sys
from fin_bringup import bringup, processes
{defect}
sys.argv[1:] = ['trials:=1']
sys.exit(bringup.main())
"""
DEFECT = """
from pathlib import Path

def defect(self, echo=processes.Child.echo, left=[{times}]):
    if left[0] and Path('{trigger}').exists():
        left[0] -= 1
        raise RuntimeError('a defect')
    return echo(self)

processes.Child.echo = defect
"""


class Study:
    """A bring-up of two scripts, its output on a descriptor of the test's choice."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._diary = folder / "diary"
        self._diary.touch()
        for name, package in NODES.items():
            path = folder / "prefix" / "lib" / package / name
            path.parent.mkdir(parents=True)
            path.write_text(NODE.format(name=name, diary=self._diary, folder=folder))
            path.chmod(0o755)
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, output: int | None, *before: str, defect: str = "", stdin: int = subprocess.DEVNULL) -> None:
        """Start it and wait for its nodes."""
        self.process = subprocess.Popen(
            [*before, sys.executable, "-c", BRINGUP.format(defect=defect)],
            stdin=stdin,
            stdout=output,
            stderr=output,
            env=os.environ | {"AMENT_PREFIX_PATH": str(self._folder / "prefix")},
        )
        wait_until(lambda: len(self.diary()) == len(NODES), 20, "the nodes")

    def diary(self) -> list[str]:
        """Return what the nodes have written about themselves."""
        return self._diary.read_text().splitlines()

    def let_end(self, name: str) -> None:
        """Let a node end."""
        (self._folder / f"{name}_may_end").touch()

    def signal(self, number: signal.Signals) -> None:
        """Send the bring-up alone a signal."""
        assert self.process is not None
        self.process.send_signal(number)

    def wait(self) -> int:
        """Wait for the end; return the exit code."""
        assert self.process is not None
        return self.process.wait(60.0)

    def end(self) -> None:
        """Leave nothing behind, whatever has failed."""
        for name in NODES:
            self.let_end(name)
        if self.process is not None:
            self.process.kill()
            self.process.wait()


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Study]:
    study = Study(tmp_path)
    yield study
    study.end()


def start_and_stop_reading(study: Study) -> None:
    reader, writer = os.pipe()
    study.start(writer)
    os.close(writer)
    os.close(reader)


IN_ORDER = ["optimizer ended", "simulator ended"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_reader_that_has_gone_does_not_keep_the_nodes_from_ending_in_order(
    study: Study, number: signal.Signals
) -> None:
    start_and_stop_reading(study)
    study.signal(number)
    assert study.wait() == 128 + number
    assert study.diary()[2:] == IN_ORDER


def test_nor_does_a_full_disk(study: Study) -> None:
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        study.start(full.fileno())
    study.signal(signal.SIGINT)
    assert study.wait() == 130
    assert study.diary()[2:] == IN_ORDER


def test_nor_an_output_that_was_never_there(study: Study) -> None:
    study.start(None, "sh", "-c", 'exec "$@" >&- 2>&-', "sh")
    study.signal(signal.SIGINT)
    assert study.wait() == 130
    assert study.diary()[2:] == IN_ORDER


def test_a_terminal_that_is_closed_ends_the_nodes_in_order(study: Study) -> None:
    master, slave = os.openpty()
    study.start(slave, "setsid", "--ctty", stdin=slave)
    os.close(slave)
    os.close(master)
    assert study.wait() == 129
    assert study.diary()[2:] == IN_ORDER


def test_a_terminal_that_is_closed_does_not_matter_under_nohup(study: Study) -> None:
    study.start(subprocess.DEVNULL, "sh", "-c", 'trap "" HUP; exec "$@"', "sh")
    study.signal(signal.SIGHUP)
    study.signal(signal.SIGTERM)
    assert study.wait() == 143


@pytest.mark.parametrize(
    ("name", "code", "ends"),
    [
        ("optimizer", 3, ["optimizer ended by itself", "simulator ended"]),
        ("simulator", 1, ["simulator ended by itself", "optimizer ended"]),
    ],
)
def test_the_exit_code_is_the_same_where_nobody_reads(study: Study, name: str, code: int, ends: list[str]) -> None:
    start_and_stop_reading(study)
    study.let_end(name)
    assert study.wait() == code
    assert study.diary()[2:] == ends


@pytest.mark.parametrize("times", [1, 1000])
def test_a_defect_of_the_bring_up_still_lets_every_node_end_by_itself(study: Study, tmp_path: Path, times: int) -> None:
    log, trigger = tmp_path / "log", tmp_path / "go_wrong"
    with log.open("wb") as output:
        study.start(output.fileno(), defect=DEFECT.format(times=times, trigger=trigger))
    trigger.touch()
    assert study.wait() == 1
    assert "RuntimeError: a defect" in log.read_text()
    wait_until(lambda: len(study.diary()) == 4, 20, "the end of the nodes")
    assert sorted(study.diary()[2:]) == IN_ORDER
    assert times > 1 or study.diary()[2:] == IN_ORDER
