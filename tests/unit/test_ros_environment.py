"""What ROS 2 cannot start with is refused in one line before it is loaded; what it can use is kept, or named."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from fin_plant import ros_environment
from fin_plant.ros_environment import FAST_DDS_PROFILE, LOCALHOST_PROFILE, PROFILES, RANGE
from support.processes import ROOT

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("domain", ["300", "233", "abc", "-1", "1.5", "0x10"])
def test_a_domain_that_has_no_ports_is_refused(domain: str) -> None:
    with pytest.raises(ValueError, match=rf"ROS_DOMAIN_ID={domain} must be a whole number from 0 to 232"):
        ros_environment.check({"ROS_DOMAIN_ID": domain})


@pytest.mark.parametrize("domain", ["", "0", "42", "232"])
def test_a_domain_that_has_ports_is_kept(domain: str) -> None:
    ros_environment.check({"ROS_DOMAIN_ID": domain})


def test_an_unknown_discovery_range_is_refused() -> None:
    with pytest.raises(ValueError, match="ROS_AUTOMATIC_DISCOVERY_RANGE=HOME must be one of SUBNET, LOCALHOST"):
        ros_environment.check({"ROS_AUTOMATIC_DISCOVERY_RANGE": "HOME"})


def test_a_middleware_that_is_not_installed_is_refused(tmp_path: Path) -> None:
    (tmp_path / "librmw_fastrtps_cpp.so").touch()
    libraries = {"LD_LIBRARY_PATH": f"/nowhere:{tmp_path}"}
    ros_environment.check({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"} | libraries)
    with pytest.raises(ValueError, match="RMW_IMPLEMENTATION=rmw_zenoh_cpp is not installed here"):
        ros_environment.check({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"} | libraries)


@pytest.mark.parametrize(
    ("content", "message"), [(None, "cannot be read"), ("<dds", "is no XML"), ("<cyclone/>", "its root is <cyclone>")]
)
def test_profiles_that_fast_dds_would_pass_over_are_refused(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "profile.xml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=message):
        ros_environment.check({PROFILES: str(path)})
    ros_environment.check({PROFILES: str(path), "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"})


@pytest.mark.parametrize("path", [FAST_DDS_PROFILE, LOCALHOST_PROFILE])
def test_the_own_profiles_pass(path: Path) -> None:
    ros_environment.check({PROFILES: str(path)})


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "/a.xml"}, "is not read by the Fast DDS of ROS 2 Jazzy"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "ROS_LOCALHOST_ONLY=1 brings shared memory in"),
        ({"ROS_STATIC_PEERS": "1.2.3.4", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}, "has no effect"),
        ({"ROS_DISCOVERY_SERVER": "1.2.3.4:11811", PROFILES: str(LOCALHOST_PROFILE)}, "run on this computer"),
        ({"RMW_FASTRTPS_USE_QOS_FROM_XML": "1"}, "takes the place of the topics' own"),
        ({"CYCLONEDDS_URI": "file:///a.xml"}, "CYCLONEDDS_URI has no effect"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "CYCLONEDDS_URI": "file:///a.xml"}, "is kept"),
    ],
)
def test_what_contradicts_is_named(given: dict[str, str], word: str) -> None:
    (note,) = ros_environment.contradictions(given)
    assert word in note


def test_what_does_not_contradict_is_not_named() -> None:
    kept = {"ROS_STATIC_PEERS": "1.2.3.4", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_LOCALHOST_ONLY": "0"}
    assert ros_environment.contradictions(kept | {PROFILES: "/my/profile.xml"}) == []


HERE = {PROFILES: str(LOCALHOST_PROFILE), RANGE: "SYSTEM_DEFAULT"}
ANYWHERE = {PROFILES: str(FAST_DDS_PROFILE)}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, HERE),
        ({RANGE: "", "ROS_STATIC_PEERS": "", PROFILES: "", "RMW_IMPLEMENTATION": ""}, HERE),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_DOMAIN_ID": "7"}, HERE),
        ({RANGE: "SUBNET"}, ANYWHERE),
        ({RANGE: "LOCALHOST"}, ANYWHERE),
        ({RANGE: "SYSTEM_DEFAULT"}, ANYWHERE),
        ({"ROS_STATIC_PEERS": "192.0.2.7"}, ANYWHERE),
        ({"ROS_LOCALHOST_ONLY": "0"}, ANYWHERE),
        ({"ROS_DISCOVERY_SERVER": "192.0.2.7:11811"}, ANYWHERE),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "/my/profile.xml"}, ANYWHERE),
        ({PROFILES: "/my/profile.xml"}, {}),
        ({PROFILES: "/my/profile.xml", RANGE: "SUBNET"}, {}),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, {}),
        ({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", RANGE: "SUBNET"}, {}),
    ],
)
def test_nodes_stay_on_this_machine_unless_the_user_has_said_otherwise_here_and_in_the_shell(
    given: dict[str, str], expected: dict[str, str], tmp_path: Path
) -> None:
    assert ros_environment.discovery(given, tmp_path) == expected
    assert ros_environment.discovery(given | expected, tmp_path) == {}  # a program that it starts says the same
    asked = {name: value for name, value in os.environ.items() if name not in {PROFILES, RANGE}} | given
    script = f". '{ROOT}/scripts/environment.sh'; exec env --null"
    told = subprocess.run(["bash", "-euc", script], env=asked, cwd=tmp_path, capture_output=True, text=True, check=True)
    result = dict(line.split("=", 1) for line in told.stdout.split("\0") if line)
    for name in (PROFILES, RANGE):
        assert result.get(name, "") == (given | expected).get(name, "")


def test_a_profile_in_the_folder_is_the_user_s_own(tmp_path: Path) -> None:
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<dds/>")
    assert ros_environment.discovery({}, tmp_path) == {}


def prepared(**variables: str) -> subprocess.CompletedProcess[str]:
    """Prepare a process with nothing but these variables set, and have it print where ROS 2 will log."""
    script = "import os; from fin_plant import ros_environment as r; r.prepare(); print(os.environ['ROS_LOG_DIR'])"
    return subprocess.run(
        [sys.executable, "-c", script],
        env={"PYTHONPATH": os.pathsep.join(sys.path), "PATH": os.environ["PATH"], **variables},
        capture_output=True,
        text=True,
        check=False,
    )


def test_logs_go_where_ros_puts_them(tmp_path: Path) -> None:
    assert prepared(HOME=str(tmp_path)).stdout == f"{tmp_path}/.ros/log\n"
    assert prepared(HOME=str(tmp_path), ROS_HOME=str(tmp_path / "a")).stdout == f"{tmp_path}/a/log\n"
    assert prepared(HOME=str(tmp_path), ROS_LOG_DIR="~/b").stdout == f"{tmp_path}/b\n"


def test_without_a_home_that_can_be_written_to_logs_go_to_a_temporary_folder(tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    result = prepared(HOME="/proc/nowhere", TMPDIR=str(tmp_path / "tmp"))
    assert result.returncode == 0
    assert result.stdout.startswith(f"{tmp_path / 'tmp' / 'fin-log'}-")
    assert list((tmp_path / "tmp").iterdir()) == []  # it goes with the process


def test_a_chosen_log_folder_that_cannot_be_written_to_is_refused() -> None:
    result = prepared(ROS_LOG_DIR="/proc/nowhere")
    assert result.returncode == 2
    assert result.stderr.startswith("-c: error: ROS_LOG_DIR=/proc/nowhere cannot be written to (")
    assert result.stderr.count("\n") == 1
