"""What `./run` lists: each executable of the workspace with the first line of its module's description."""

from __future__ import annotations

import ast
import importlib.util
import re
import shutil
import sys
import textwrap
from importlib.metadata import EntryPoint, distribution
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

# What the first line repeats: which kind of thing it is, and its name.
_KIND = re.compile(r"^(?:(?:the )?command ``\w+``|`\w+`|the [a-z ']*node): ", re.IGNORECASE)
_WIDEST = 100
_INDENT = 6 * " "


def description(entry: EntryPoint) -> str:
    """Return what the first paragraph of the module's description says, without loading the module."""
    specification = importlib.util.find_spec(entry.module.partition(".")[0])
    folder = Path((specification.submodule_search_locations or [""])[0] if specification else "")
    source = folder.joinpath(*entry.module.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8")
    words = " ".join((ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0].split())
    text = _KIND.sub("", words).replace("``", "").replace("`", "")
    return text[:1].upper() + text[1:]


def executables(install: Path) -> Iterator[tuple[str, EntryPoint]]:
    """Yield package and entry point of all that is installed below this folder."""
    for package in sorted(path.name for path in install.glob("*") if (path / "lib" / path.name).is_dir()):
        for entry in sorted(distribution(package).entry_points, key=lambda entry: entry.name):
            if entry.group == "console_scripts" and (install / package / "lib" / package / entry.name).exists():
                yield package, entry


def listing(install: Path, width: int) -> str:
    """Return the text that `./run` shows on a screen of so many columns."""
    lines = []
    wrap = textwrap.TextWrapper(min(width, _WIDEST) - 1, initial_indent=_INDENT, subsequent_indent=_INDENT)
    for package, entry in executables(install):
        lines += [f"  ./run {package} {entry.name}", *wrap.wrap(description(entry))]
    return "\n".join(lines)


if __name__ == "__main__":
    print(listing(Path(sys.argv[1]), max(shutil.get_terminal_size((80, 24)).columns, 40)))  # noqa: T201
