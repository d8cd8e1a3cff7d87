"""What `pip install` of the packages gives, without colcon: commands, data files, a study of nodes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from fin_plant.sub_commands import executables
from support.processes import ROOT, workspace_environment
from support.source_tree import PACKAGES, SOURCE

pytestmark = pytest.mark.long
COMMANDS = {"fin-sim": "fin_sim", "fin-servo-driver": "fin_servo_driver", "fin-optimizer": "fin_optimizer"}
COMMANDS |= {"fin-bringup": "fin_bringup"}


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a virtual environment with wheels of the packages, which sees the workspace's other packages."""
    folder = tmp_path_factory.mktemp("wheels")
    sources = [str(shutil.copytree(SOURCE / package, folder / "src" / package)) for package in PACKAGES]
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    python = folder / "venv" / "bin" / "python"
    here = subprocess.check_output([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], text=True)
    workspace = sysconfig.get_path("purelib")
    Path(here.strip(), "workspace.pth").write_text(f"import site; site.addsitedir({workspace!r})\n")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet")
    subprocess.run([python, "-m", "pip", "install", *options, *sources], env=environment(folder), check=True)
    return folder / "venv" / "bin"


def environment(folder: Path) -> dict[str, str]:
    """Return the workspace's environment without the workspace: that of an installed ROS, if there is one."""
    workspace = (str(ROOT / "ros2_ws"), str(ROOT / ".venv" / "bin"))
    variables = {}
    for name, value in (os.environ | workspace_environment()).items():
        kept = [part for part in value.split(os.pathsep) if not part.startswith(workspace)]
        if kept and name != "VIRTUAL_ENV":
            variables[name] = os.pathsep.join(kept)
    return variables | {"COLUMNS": "80", "TMPDIR": str(folder)}


def run(command: Path, *words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [command, *words], cwd=folder, env=environment(folder), capture_output=True, text=True, check=False
    )


def test_each_package_has_one_command_that_lists_its_executables(installed: Path, tmp_path: Path) -> None:
    ours = {path.name for path in installed.iterdir()} - {"python", "python3"}
    assert {name for name in ours if not name.startswith(("activate", "Activate", "python3."))} == set(COMMANDS)
    for command, package in COMMANDS.items():
        told = run(installed / command, "--help", folder=tmp_path)
        assert (told.returncode, told.stderr) == (0, "")
        for name in executables(package):
            assert f"  {command} {name}\n" in told.stdout
        assert max(map(len, told.stdout.splitlines())) < 80
    refused = run(installed / "fin-sim", "fly", folder=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith("fin-sim: error: there is no sub-command 'fly'\nusage: fin-sim SUB-COMMAND")


def test_a_sub_command_finds_its_data_and_a_node_says_how_it_is_called(installed: Path, tmp_path: Path) -> None:
    swum = run(installed / "fin-sim", "swim", "--material", "PP", "--duration", "2", "--json", folder=tmp_path)
    assert (swum.returncode, swum.stderr) == (0, "")
    assert '"mean_speed"' in swum.stdout
    preset = run(installed / "fin-sim", "swim", "--preset", "soleil", "--duration", "2", "--json", folder=tmp_path)
    assert (preset.returncode, preset.stderr) == (0, "")
    assert preset.stdout != swum.stdout
    node = run(installed / "fin-sim", "simulator", "--help", folder=tmp_path)
    assert node.stdout.startswith("usage: fin-sim simulator [--ros-args")


def test_a_study_through_nodes_and_its_report(installed: Path, tmp_path: Path, ros_domain: int) -> None:
    words = ("trials:=2", "study_folder:=study", "disk.minimum_free:=0", "measurement.duration:=2")
    study = run(installed / "fin-bringup", "bringup", *words, folder=tmp_path)
    assert study.returncode == 0, study.stderr
    assert "best of 2 trials" in study.stdout
    shown = run(installed / "fin-optimizer", "show_study", "study", folder=tmp_path)
    assert shown.returncode == 0, shown.stderr
    report = run(installed / "fin-optimizer", "report", "study", folder=tmp_path)
    assert report.returncode == 0, report.stderr
    assert (tmp_path / "study" / "report.html").stat().st_size > 1_000_000
