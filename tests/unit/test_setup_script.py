"""The set-up says what is missing on a machine where it cannot work, and changes nothing there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    "bash",
    "cat",
    "cut",
    "dirname",
    "env",
    "find",
    "flock",
    "grep",
    "head",
    "ls",
    "sha256sum",
    "sort",
    "tail",
    "uname",
)

# A Python whose virtual environments hold a copy of itself, and whose pip fails.
FAILING_PYTHON = """#!/bin/bash
environment="${*: -1}"
case "$1 $2" in
"-m venv")
    mkdir -p "$environment/bin"
    cat "$0" >"$environment/bin/python"
    chmod +x "$environment/bin/python"
    ;;
"-m pip")
    echo "ERROR: no network"
    exit 1
    ;;
*_base_executable*)
    echo "$0"
    ;;
esac
"""


def copy_of_scripts(tmp_path: Path, tools: Sequence[str] = TOOLS) -> tuple[Path, dict[str, str]]:
    """Return a repository with the set-up alone in it, and an environment with these tools and no Python."""
    root = tmp_path / "repository"
    (root / "ros2_ws" / "src").mkdir(parents=True)
    shutil.copytree(ROOT / "scripts", root / "scripts")
    shutil.copytree(ROOT / "requirements", root / "requirements")
    shutil.copy(ROOT / "run", root / "run")
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in tools:
        path = shutil.which(tool)
        assert path, f"{tool} is needed by the set-up"
        (folder / tool).symlink_to(path)
    environment = {"PATH": str(folder), "HOME": str(tmp_path), "FIN_ROS_PREFIX": str(tmp_path / "no_ros")}
    return root, environment


def set_up(root: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(shutil.which("bash")), str(root / "scripts" / "setup.sh")],
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )


def test_without_python_and_without_ros_it_says_what_is_missing_and_how_to_get_it(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path)
    result = set_up(root, environment)
    assert result.returncode == 1
    assert "no usable Python 3.12, 3.11 or 3.13" in result.stderr
    assert "sudo apt install python3-venv" in result.stderr
    assert "pyenv install 3.12" in result.stderr
    assert not (root / ".venv").exists()


def test_a_python_that_does_not_start_is_no_python(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path)
    shim = Path(environment["PATH"]) / "python3.12"
    shim.write_text("#!/bin/sh\necho 'pyenv: python3.12: command not found' >&2\nexit 127\n")
    shim.chmod(0o755)
    result = set_up(root, environment)
    assert result.returncode == 1
    assert "no usable Python" in result.stderr


def test_the_python_found_is_never_that_of_an_activated_environment(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "activated")], check=True)
    environment = os.environ | {"PATH": f"{tmp_path}/activated/bin:{os.environ['PATH']}"}
    result = subprocess.run(
        [str(ROOT / "scripts" / "find_python.sh")], capture_output=True, text=True, check=True, env=environment
    )
    assert not Path(result.stdout.strip()).is_relative_to(tmp_path)


def test_a_shell_with_another_ros_distribution_is_refused(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path)
    result = set_up(root, environment | {"ROS_DISTRO": "humble"})
    assert result.returncode == 1
    assert "this shell has ROS 2 humble sourced" in result.stderr


def test_a_failed_installation_shows_its_output_and_is_not_taken_for_done(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path, (*TOOLS, "chmod", "mkdir", "rm", "touch"))
    python = Path(environment["PATH"]) / "python3.12"
    python.write_text(FAILING_PYTHON)
    python.chmod(0o755)
    for _ in range(2):
        result = set_up(root, environment)
        assert result.returncode == 1
        assert "ERROR: no network" in result.stderr
        assert not (root / ".venv" / ".installed").exists()


def test_run_before_the_set_up_says_so(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path, (*TOOLS, "readlink", "sed"))
    result = subprocess.run(
        [str(root / "run"), "fin_sim", "simulator"],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "run 'make setup'" in result.stderr
