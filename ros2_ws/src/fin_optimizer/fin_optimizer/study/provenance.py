"""Where a result comes from: the versions of what made it and the commit of the source."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

_DISTRIBUTIONS = (
    "fin_plant",
    "fin_sim",
    "fin_optimizer",
    "numpy",
    "scipy",
    "numba",
    "optuna",
    "mcap",
    "ros-jazzy-rclpy",
    "rclpy",
)
_GIT_SECONDS = 5.0


def provenance() -> dict[str, str]:
    """Return versions and commit by name, as the metadata of a bag: ``version.<package>``, ``git.commit``.

    Packages that are not installed are left out; ``git.commit`` is ``unknown`` outside a clone of the source and ends
    in ``-dirty`` if files of the clone differ from the commit.
    """
    versions = {"version.python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            versions[f"version.{name}"] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {**versions, "git.commit": _commit(Path(__file__).parent)}


def _commit(folder: Path) -> str:
    root = _git(folder, "rev-parse", "--show-toplevel")
    # An installed package may lie inside somebody else's clone, whose commit says nothing about it.
    if not root or not (Path(root) / "ros2_ws/src/fin_optimizer").is_dir():
        return "unknown"
    return _git(folder, "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty") or "unknown"


def _git(folder: Path, *arguments: str) -> str:
    """Return what git prints, empty if there is no git, no clone or no answer."""
    command = ["git", "-C", str(folder), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_SECONDS, check=True)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
