"""Paths as a person gives them, to a command, in an argument of a launch or in a parameter; and a package's config."""

from __future__ import annotations

import os
from argparse import ArgumentTypeError
from importlib import resources
from pathlib import Path


class UnknownHomeError(ValueError, ArgumentTypeError):
    """A path begins with the home of somebody who has none here."""


def given_path(text: str) -> Path:
    """Return the path that a text means; also a `type` of argparse.

    A `~` or `~user` at its start is a home, as to the shell, which leaves it alone in `study_folder:=~/x`.

    Raises:
        UnknownHomeError: There is no such home; no folder by the name of `~` is made in its place.
    """
    path = os.path.expanduser(text)  # noqa: PTH111  (pathlib takes ./~ for a home too)
    if path.startswith("~"):
        home = path.split("/")[0]
        msg = f"{text}: {home} is nobody's home here: give the whole path, or ./{text} for a folder of that name"
        raise UnknownHomeError(msg)
    return Path(path)


def check_output(path: Path) -> None:
    """Refuse a file that could not be written, before what goes into it is computed.

    Raises:
        ValueError: Its folder does not exist or cannot be written to, or it is a folder itself.
    """
    if not path.parent.is_dir() or path.is_dir():
        msg = f"{path}: its folder does not exist, or it is a folder itself"
        raise ValueError(msg)
    if not os.access(path.parent, os.W_OK):
        msg = f"{path}: its folder cannot be written to"
        raise ValueError(msg)


def config_folder(package: str) -> Path:
    """Return the folder ``config`` of a package: PREFIX/share/PACKAGE/config around its modules, or beside its source.

    Raises:
        FileNotFoundError: It is in neither.
    """
    modules = Path(str(resources.files(package)))
    for folder in (*(prefix / "share" / package / "config" for prefix in modules.parents), modules.parent / "config"):
        if folder.is_dir():
            return folder
    msg = f"no folder share/{package}/config around {modules}: install {package} again"
    raise FileNotFoundError(msg)
