"""What `./run` and the commands of wheels list: each executable with the first line of its module's description."""

from __future__ import annotations

import ast
import importlib.util
import re
import shutil
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from fin_plant.sub_commands import executables

if TYPE_CHECKING:
    from collections.abc import Iterable
    from importlib.metadata import EntryPoint

# What the first line repeats: which kind of thing it is, and its name.
_KIND = re.compile(r"^(?:(?:the )?command ``\w+``|`\w+`|the [a-z ']*node): ", re.IGNORECASE)
_NARROWEST, _WIDEST = 40, 100
_INDENT = 6 * " "


def description(entry: EntryPoint) -> str:
    """Return what the first paragraph of the module's description says, without loading the module."""
    specification = importlib.util.find_spec(entry.module.partition(".")[0])
    folder = Path((specification.submodule_search_locations or [""])[0] if specification else "")
    source = folder.joinpath(*entry.module.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8")
    words = " ".join((ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0].split())
    text = _KIND.sub("", words).replace("``", "").replace("`", "")
    return text[:1].upper() + text[1:]


def screen_width() -> int:
    """Return the columns of the user's screen, 80 where there is none."""
    return shutil.get_terminal_size((80, 24)).columns


def lines(command: str, entries: Iterable[EntryPoint]) -> str:
    """Return two lines or more for each executable, as wide as the screen: how it is called, and what it does."""
    wrap = textwrap.TextWrapper(
        min(max(screen_width(), _NARROWEST), _WIDEST) - 1, initial_indent=_INDENT, subsequent_indent=_INDENT
    )
    return "\n".join(
        line for entry in entries for line in (f"  {command} {entry.name}", *wrap.wrap(description(entry)))
    )


def listing(install: Path) -> str:
    """Return the text that `./run` shows: of all packages that are installed below this folder."""
    folders = sorted(path for path in install.glob("*/lib/*") if path.parents[1].name == path.name)
    texts = []
    for folder in folders:
        there = [entry for name, entry in executables(folder.name).items() if (folder / name).exists()]
        texts += [lines(f"./run {folder.name}", there)] if there else []
    return "\n".join(texts)


if __name__ == "__main__":
    print(listing(Path(sys.argv[1])))  # noqa: T201
