"""The set-up says what is missing on a machine where it cannot work, and changes nothing there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

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


def test_without_flock_it_says_so_and_how_to_get_it(tmp_path: Path) -> None:
    root, environment = copy_of_scripts(tmp_path, [tool for tool in TOOLS if tool != "flock"])
    result = set_up(root, environment)
    assert result.returncode == 1
    assert result.stderr == (
        "setup: error: the command flock is missing\nsetup: error: to get it: sudo apt install util-linux\n"
    )
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


def start_quietly(root: Path) -> subprocess.CompletedProcess[str]:
    """Let the set-up write the first line of the one executable in this workspace."""
    script = (
        'set -euo pipefail; root=$1 venv=$1/.venv; eval "$(sed -n \'/^start_quietly()/,/^}/p\' "$2")"; start_quietly'
    )
    command = ["bash", "-c", script, "bash", str(root), str(ROOT / "scripts" / "setup.sh")]
    return subprocess.run(command, cwd=root / "ros2_ws", capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["plain", "two words", "Ann's", "Ann's #1 & |only| (best) tank", "Öl"])
def test_an_executable_starts_in_a_folder_of_any_name(name: str, tmp_path: Path) -> None:
    root = tmp_path / name
    executable = root / "ros2_ws" / "install" / "fin_sim" / "lib" / "fin_sim" / "swim"
    for folder in (executable.parent, root / "ros2_ws" / "build", root / ".venv" / "bin"):
        folder.mkdir(parents=True)
    (root / ".venv" / "bin" / "python").symlink_to(str(shutil.which("printf")))
    executable.write_text("#!/the/builders/python\nimport sys\n")
    executable.chmod(0o755)
    for _ in range(2):  # again as at first
        assert start_quietly(root).returncode == 0
        first, rest = executable.read_text().split("\n", 1)
        assert (first[:15], rest) == ("#!/usr/bin/env ", "import sys\n")
    executable.write_text(first.replace("-P -m", "%s,"))  # so that printf tells its arguments
    told = subprocess.run([executable, "a b"], capture_output=True, text=True, check=True).stdout
    assert told == f"fin_plant.start,{executable},a b,"


@pytest.mark.parametrize("name", ['the "big" tank', "$HOME", "`id`", "a\\b", "a:b", "a\nb"])
def test_a_folder_that_the_scripts_of_pip_and_colcon_cannot_take_is_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "all" / name
    folder.mkdir(parents=True)
    root, environment = copy_of_scripts(folder)
    result = set_up(root, environment | {"PATH": os.environ["PATH"]})
    assert result.returncode == 1
    assert "has a character that the scripts of pip and colcon cannot take" in result.stderr
    assert not (root / ".venv").exists()


def test_a_folder_whose_name_is_too_long_for_linux_is_refused(tmp_path: Path) -> None:
    root = tmp_path / ("x" * 200)
    (root / "ros2_ws" / "build").mkdir(parents=True)
    result = start_quietly(root)
    assert result.returncode == 1
    assert f"the path {root} is too long" in result.stderr


@pytest.mark.parametrize("words", [(), ("--help",), ("fin_sim", "simulator"), ("fin_sim", "simulator", "--help")])
def test_run_before_the_set_up_says_so(words: tuple[str, ...], tmp_path: Path) -> None:
    folder = tmp_path / "Ann's tank"
    folder.mkdir()
    root, environment = copy_of_scripts(folder, (*TOOLS, "readlink", "sed"))
    result = subprocess.run(
        [str(root / "run"), *words],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == f"environment.sh: error: the workspace is not set up: run 'make setup' in {root}\n"
