"""The measurement of lateness with the real driver, optimiser and recorder; nothing here depends on how late it is."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from support.processes import workspace_environment


def lateness(domain: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    return subprocess.run(
        [sys.executable, "-m", "fin_bringup.benchmarks.lateness", *arguments],
        env=workspace_environment() | {"ROS_DOMAIN_ID": str(domain)},
        capture_output=True,
        text=True,
        check=False,
        timeout=100.0,
    )


@pytest.mark.long
def test_the_table_names_its_command_and_counts_the_ticks_of_the_driver(ros_domain: int) -> None:
    done = lateness(ros_domain, "--seconds", "4", "firmata")
    assert done.returncode == 0, done.stderr
    command, _, header, _, row = done.stdout.splitlines()
    assert command == "./run fin_bringup lateness --seconds 4 firmata"
    assert header.startswith("| device | lateness p50, ms |")
    found = re.fullmatch(r"\| firmata \|( \d+\.\d\d \|){3} (\d+) of (\d+) \| \d+ % of a core \| -?\d+ \|", row)
    assert found, row
    assert int(found[3]) > 0


@pytest.mark.long
def test_a_study_that_fails_ends_the_measurement_with_its_reason(ros_domain: int) -> None:
    done = lateness(ros_domain, "no_such_device")
    assert done.returncode == 1
    assert "there is no such file, and no example of that name" in done.stderr
