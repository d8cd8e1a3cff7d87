"""The user's own settings, whatever they are, change neither the numbers nor whether there are any."""

from __future__ import annotations

import json
import os
import subprocess
from functools import cache
from typing import TYPE_CHECKING

import pytest

from support.processes import ROOT

if TYPE_CHECKING:
    from pathlib import Path

# What a user's profile, another project or a bare container may set; None: unset. {folder} is the test's own.
SETTINGS: dict[str, dict[str, str | None]] = {
    "a foreign numpy and fin_sim": {"PYTHONPATH": "{folder}/foreign"},
    "Python's own": {
        "PYTHONSTARTUP": "/nowhere",
        "PYTHONHOME": "/nowhere",
        "PYTHONPLATLIBDIR": "nowhere",
        "PYTHONSAFEPATH": "1",
        "PYTHONINSPECT": "1",
        "PYTHONOPTIMIZE": "2",
        "PYTHONPYCACHEPREFIX": "/proc/nowhere",
    },
    "warnings as errors": {"PYTHONWARNINGS": "error"},
    "another environment": {"VIRTUAL_ENV": "/nowhere", "CONDA_PREFIX": "/nowhere", "CONDA_DEFAULT_ENV": "base"},
    "plain C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"},
    "decimal comma": {"LC_NUMERIC": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"},
    "no home": {"HOME": None, "XDG_CACHE_HOME": None},
    "nothing writable": {
        "HOME": "/proc/nowhere",
        "XDG_CACHE_HOME": None,
        "TMPDIR": "/proc",
        "NUMBA_CACHE_DIR": "/proc",
    },
    "matplotlib's": {"MPLBACKEND": "nonsense", "MATPLOTLIBRC": "{folder}/matplotlibrc", "MPLCONFIGDIR": "/proc"},
    "a dumb terminal": {"TERM": "dumb", "NO_COLOR": "1", "COLUMNS": "1"},
    "CDPATH": {"CDPATH": "/:.", "GREP_OPTIONS": "--color=always", "BASH_ENV": "/nowhere"},
    "bash's functions and options": {
        "BASH_FUNC_cd%%": "() {{ builtin cd /; echo there; }}",
        "BASH_FUNC_dirname%%": "() {{ echo /nowhere; }}",
        "BASH_FUNC_exec%%": "() {{ false; }}",
        "BASH_FUNC_python%%": "() {{ false; }}",
        "SHELLOPTS": "noglob:xtrace",
    },
}
SWIM = (str(ROOT / "run"), "fin_sim", "swim", "--duration", "2", "--json")


def swim(folder: Path, settings: dict[str, str | None], *options: str) -> str:
    """Swim with these settings; return what was printed."""
    for package in ("numpy", "fin_sim"):
        (folder / "foreign" / package).mkdir(parents=True)
        (folder / "foreign" / package / "__init__.py").write_text("raise ImportError('foreign')")
    (folder / "matplotlibrc").write_text("text.usetex: True\nbackend: QtAgg\nfigure.dpi: 1\n")
    environment = os.environ | {name: value.format(folder=folder) for name, value in settings.items() if value}
    for name in (name for name, value in settings.items() if value is None):
        environment.pop(name, None)
    result = subprocess.run(
        (*SWIM, *options),
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "swim: wrote swim.png\n" if options else "")
    return result.stdout


@cache
def _plain() -> dict[str, float]:
    plain = subprocess.run(SWIM, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True)
    return figures(plain.stdout)


def figures(said: str) -> dict[str, float]:
    """Return the figures of a swim without their units; an ideal servo has no electrical power, which is left out."""
    return {name: value for name, value in json.loads(said).items() if name != "units" and value is not None}


# Without them compiled code, Python's or the swim's, and the list of fonts must be made anew: up to a minute.
CACHES = ("HOME", "PYTHONPYCACHEPREFIX", "PYTHONOPTIMIZE", "MPLCONFIGDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")


def test_all_settings_of_a_user_at_once_change_nothing(tmp_path: Path) -> None:
    every = {name: value for settings in SETTINGS.values() for name, value in settings.items() if name not in CACHES}
    assert figures(swim(tmp_path, every)) == pytest.approx(_plain(), rel=1e-12)  # compiled anew


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_no_setting_of_a_user_changes_anything(settings: dict[str, str | None], tmp_path: Path) -> None:
    assert figures(swim(tmp_path, settings, "--plot=swim.png")) == pytest.approx(_plain(), rel=1e-12)  # compiled anew
    assert (tmp_path / "swim.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    "closed",
    [
        "2>&-",
        "<&- >&- 2>&-",
        *(pytest.param(how, marks=pytest.mark.long) for how in ("<&-", ">&-", "<&- 2>&-", ">&- 2>&-")),
    ],
)
def test_a_closed_stream_is_no_failure(closed: str, tmp_path: Path) -> None:
    command = f'"{ROOT}/run" fin_sim swim --duration 1 --csv=swim.csv {closed}'
    assert subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, check=False).returncode == 0
    assert (tmp_path / "swim.csv").stat().st_size > 1000


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(("words", "code"), [("", 0), ("fin_simm x", 2), ("fin_sim simulator --help", 0)])
def test_a_closed_stream_changes_no_exit_code(words: str, code: int, closed: str) -> None:
    command = f'"{ROOT}/run" {words} {closed}'
    assert subprocess.run(["bash", "-c", command], capture_output=True, check=False).returncode == code


@pytest.mark.parametrize(("mask", "mode"), [("077", 0o600), pytest.param("000", 0o666, marks=pytest.mark.long)])
def test_what_is_written_has_the_mode_that_the_user_wants(mask: str, mode: int, tmp_path: Path) -> None:
    command = f'umask {mask} && exec "{ROOT}/run" fin_sim swim --duration 1 --csv=swim.csv'
    subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, check=True)
    assert (tmp_path / "swim.csv").stat().st_mode & 0o777 == mode


@pytest.mark.long
def test_a_home_is_found_that_the_shell_has_not_expanded(ros_domain: int, tmp_path: Path) -> None:
    words = ("trials:=1", "study_folder:=~/study", "measurement.duration:=0.5", "disk.minimum_free:=0")
    environment = os.environ | {"HOME": str(tmp_path), "ROS_DOMAIN_ID": str(ros_domain)}
    work = tmp_path / "work"
    work.mkdir()
    for command in (("bringup", *words), ("show_study", "~/study"), ("export", "~/study", "--into=~/tables")):
        done = subprocess.run(
            [str(ROOT / "run"), "fin_optimizer", *command], cwd=work, env=environment, capture_output=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "study" / "study.json").exists()
    assert list((tmp_path / "tables").iterdir())
    assert list(work.iterdir()) == []  # least of all one by the name of ~


READ_ONLY = 'mount --bind "$1" "$1" && mount -o remount,ro,bind "$1" && shift && ! touch "$0/x" && exec "$@"'


def test_a_set_up_checkout_that_cannot_be_written_to_swims(tmp_path: Path) -> None:
    own_mounts = ["unshare", "--map-root-user", "--mount"]
    if subprocess.run([*own_mounts, "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("this machine lets nobody make mounts of their own")
    command = [*own_mounts, "bash", "-c", READ_ONLY, str(ROOT), str(ROOT), *SWIM]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "Read-only file system" in result.stderr  # it was
    assert figures(result.stdout) == pytest.approx(_plain(), rel=1e-12)  # compiled anew
