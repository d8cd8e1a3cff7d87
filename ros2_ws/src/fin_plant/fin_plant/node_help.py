"""What a node shows for ``--help``: every parameter, before anything of ROS 2 is loaded."""

from __future__ import annotations

import sys
import textwrap
from typing import TYPE_CHECKING

from fin_plant.executables import description, screen_width
from fin_plant.fin import node_table
from fin_plant.output import go_on_when_output_closes

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from fin_plant.parameters import Parameter, ParameterTable

_NARROWEST, _WIDEST = 40, 100


def _head(parameter: Parameter) -> str:
    parts = [parameter.kind, parameter.unit, f"default {parameter.shown_default}"]
    if parameter.choices:
        parts.append(f"one of {parameter.allowed}")
    elif parameter.kind in {"double", "integer", "double_array"}:
        parts.append(parameter.allowed)
    return f"{parameter.name}: {', '.join(part for part in parts if part)}"


def wrap(text: str, width: int, first: int, later: int) -> str:
    """Return the text in lines for a screen of so many columns, between 40 and 100 of which are used.

    Args:
        text: A paragraph.
        width: Columns of the screen.
        first: Spaces before the first line.
        later: Spaces before each other line.
    """
    columns = min(max(width, _NARROWEST), _WIDEST) - 1
    before, after = first * " ", later * " "
    return textwrap.fill(text, columns, initial_indent=before, subsequent_indent=after, break_on_hyphens=False)


def usage(command: str, what: str, table: ParameterTable, width: int) -> str:
    """Return the help of a node for a screen of so many columns.

    Args:
        command: How the node is started.
        what: What the node does.
        table: Its parameters.
        width: Columns of the screen.
    """

    def wrapped(text: str, first: int = 0, later: int = 0) -> str:
        return wrap(text, width, first, later)

    parameters = "Parameters, with type, unit, default and allowed values; docs/parameters.md has their reasons:"
    lines = [
        wrapped(f"usage: {command} [--ros-args -p PARAMETER:=VALUE ...]", 0, 7),
        "",
        wrapped(what),
        "",
        wrapped(parameters),
    ]
    for parameter in table.values():
        fixed = " Fixed while the node runs." if parameter.read_only else ""
        lines += [wrapped(_head(parameter), 2, 4), wrapped(parameter.description + fixed, 6, 6)]
    return "\n".join(lines)


def answer(package: str, entry: EntryPoint, command: str) -> bool:
    """Print the help of the executable if it is a node; return False if it is not, and answers for itself."""
    try:
        table = node_table(package, entry.name)
    except FileNotFoundError:
        return False
    go_on_when_output_closes()
    print(usage(command, description(entry), table, screen_width()))  # noqa: T201
    sys.stdout.flush()
    return True
