"""`./run` is `ros2 run`: same executables, same signals, same exit codes."""

from __future__ import annotations

import importlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fin_plant.fin import node_table
from fin_plant.node_help import usage
from support.processes import INSTALL, ROOT, StartedProcess, workspace_environment
from support.waiting import wait_until

EXECUTABLES = sorted(
    (path.parent.name, path.name) for path in INSTALL.glob("*/lib/*/*") if path.is_file() and os.access(path, os.X_OK)
)


def run(*arguments: str, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(ROOT / "run"), *arguments],
        capture_output=True,
        text=True,
        env=os.environ | (environment or {}),
        stdin=subprocess.DEVNULL,
        check=False,
    )


def test_without_arguments_it_lists_every_executable_with_what_it_does() -> None:
    result = run(environment={"COLUMNS": "60"})
    assert result.returncode == 0
    lines = result.stdout.splitlines()
    for package, executable in EXECUTABLES:
        what = lines[lines.index(f"  ./run {package} {executable}") + 1]
        assert what.startswith("      ")
        assert what.strip()[0].isupper()
    assert max(map(len, lines)) < 60


NODES = ("optimizer", "rehearsal", "servo_driver", "simulator", "velocity_estimator")


@pytest.mark.parametrize(
    ("package", "executable"),
    [pytest.param(*pair, marks=() if pair[1] in NODES else pytest.mark.long) for pair in EXECUTABLES],
)
def test_help_fits_the_screen_and_needs_no_ros_that_can_start(package: str, executable: str) -> None:
    result = run(package, executable, "--help", environment={"COLUMNS": "80", "ROS_DOMAIN_ID": "300"})
    assert (result.returncode, result.stderr) == (0, "")
    assert executable in result.stdout
    assert max(map(len, result.stdout.splitlines())) < 80


@pytest.mark.parametrize("node", NODES)
def test_the_help_of_a_node_lists_every_parameter_that_it_has(node: str) -> None:
    (package,) = (package for package, executable in EXECUTABLES if executable == node)
    text = usage("", "A node.", node_table(package, node), 80)
    module = importlib.import_module(f"{package}.{node}")
    declared = vars(module).get("PARAMETERS") or module.OPTIMIZER_PARAMETERS
    assert re.findall(r"^  ([a-z][a-z0-9_.]+): ", text, re.MULTILINE) == list(declared)


def test_the_help_of_a_node_says_type_unit_default_range_meaning_and_what_is_fixed() -> None:
    words = "body.width: double, m, default 0.045, [0.005, 1] Width of the body. "
    assert words in " ".join(usage("", "", node_table("fin_sim", "simulator"), 60).split())
    rehearsal = " ".join(usage("", "", node_table("fin_servo_driver", "rehearsal"), 80).split())
    assert "operator.acts: bool, default true Play the operator as well" in rehearsal
    assert "Factor on the simulator's drag. Fixed while the node runs." in rehearsal
    estimator = node_table("fin_servo_driver", "velocity_estimator")
    assert "one of quaternion, yaw What the tracker" in " ".join(usage("", "", estimator, 80).split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fin_simm", "simulator"), "no package 'fin_simm'"),
        (("fin_sim", "simulatr"), "no executable 'simulatr'"),
        (("fin_sim",), "no executable ''"),
        (("fin_sim", "../fin_sim/simulator"), "no executable '../fin_sim/simulator'"),
    ],
)
def test_an_unknown_name_is_refused_with_what_there_is(arguments: tuple[str, ...], message: str) -> None:
    result = run(*arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert "./run fin_sim simulator\n" in result.stderr


def test_the_process_is_the_executable_itself_and_ctrl_c_reaches_it(ros_domain: int, tmp_path: Path) -> None:
    log = tmp_path / "simulator.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [str(ROOT / "run"), "fin_sim", "simulator"],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env=os.environ | {"ROS_LOG_DIR": str(tmp_path)},
        )
    started = StartedProcess("./run fin_sim simulator", process, log)
    command = Path(f"/proc/{process.pid}/cmdline")
    executable = str(INSTALL / "fin_sim" / "lib" / "fin_sim" / "simulator")
    try:
        wait_until(lambda: executable in command.read_text().split("\0"), 10, "exec of the simulator")
        started.wait_for_output("kernel ready")
        started.signal(signal.SIGINT)
        assert started.wait(timeout=60.0) == 130
    finally:
        complaints = started.end()
    assert complaints == []


def test_an_environment_that_is_set_already_is_kept() -> None:
    script = (
        f'. "{ROOT}/scripts/environment.sh" && echo "$ROS_AUTOMATIC_DISCOVERY_RANGE $FASTRTPS_DEFAULT_PROFILES_FILE"'
    )
    given = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTRTPS_DEFAULT_PROFILES_FILE": "/my/profile.xml"}
    result = subprocess.run(
        ["bash", "-euc", script], capture_output=True, text=True, check=True, env=os.environ | given
    )
    assert result.stdout.strip() == "SUBNET /my/profile.xml"


USERS_OF_ROS = {
    "bringup": (),
    "control": ("pause",),
    "lateness": (),
    "operator": (),
    "optimizer": (),
    "play_bag": ("bag",),
    "rehearsal": (),
    "servo_driver": (),
    "simulator": (),
    "velocity_estimator": (),
}


@pytest.mark.parametrize(("package", "executable"), [pair for pair in EXECUTABLES if pair[1] in USERS_OF_ROS])
def test_a_start_that_ros_refuses_ends_with_one_line_and_exit_code_2(package: str, executable: str) -> None:
    # Fast DDS itself ends the process there, with its own words and exit code 1.
    result = run(package, executable, *USERS_OF_ROS[executable], environment={"ROS_DOMAIN_ID": "300"})
    assert result.stderr == (
        f"{executable}: error: ROS_DOMAIN_ID=300 must be a whole number from 0 to 232: change or unset it\n"
    )
    assert (result.returncode, result.stdout) == (2, "")


def test_a_middleware_that_is_not_installed_is_refused_before_ros_is_loaded() -> None:
    result = run("fin_sim", "simulator", environment={"RMW_IMPLEMENTATION": "rmw_none_cpp"})
    assert result.stderr.startswith("simulator: error: RMW_IMPLEMENTATION=rmw_none_cpp is not installed here: ")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)


def test_arguments_that_ros_refuses_are_one_line(ros_domain: int) -> None:
    result = run("fin_sim", "simulator", "--ros-args", "-p", "speed", environment={"ROS_DOMAIN_ID": str(ros_domain)})
    assert result.stderr.startswith("simulator: error: ROS 2 does not start: ")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)


def test_each_installed_executable_can_be_loaded() -> None:
    """All in one process, where the libraries are loaded once; `test_layering.py` imports the modules one by one."""
    load = (
        "import sys\nfrom importlib.metadata import distribution\n"
        "for package, name in (pair.split('/') for pair in sys.argv[1:]):\n"
        "    distribution(package).entry_points[name].load()"
    )
    result = subprocess.run(
        [sys.executable, "-c", load, *map("/".join, EXECUTABLES)],
        capture_output=True,
        text=True,
        env=workspace_environment(),
        check=False,
    )
    assert result.returncode == 0, result.stderr
