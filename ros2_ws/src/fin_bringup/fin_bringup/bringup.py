"""Start a study as processes of their own: plant and optimiser, on a machine with or without the launch system.

Usage: bringup [name:=value ...], for example bringup plant:=sim trials:=30 seed:=1. It ends with the optimiser's
exit code.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from fin_bringup import study_arguments, study_nodes
from fin_bringup.processes import StudyProcesses
from fin_plant import ros_environment
from fin_plant.command import EXIT_FAILURE, EXIT_USAGE, tell_error
from fin_plant.executables import screen_width
from fin_plant.node_help import wrap
from fin_plant.output import go_on_when_output_closes

if TYPE_CHECKING:
    from collections.abc import Iterable


def parse(words: Iterable[str]) -> dict[str, str]:
    """Return arguments of the form ``name:=value`` by name.

    Raises:
        ValueError: Another form, or a name twice.
    """
    given: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not separator or not name:
            msg = f"{word!r} is not of the form name:=value, for example trials:=30"
            raise ValueError(msg)
        if name in given:
            msg = f"{name}:= is given twice"
            raise ValueError(msg)
        given[name] = value
    return given


def usage(width: int) -> str:
    """Return the help text with every argument and its default, for a screen of so many columns."""
    lines = ["usage: bringup [name:=value ...]", "", "arguments:"]
    lines += [
        f"  {a.name}:={a.default or '(empty)'}\n{wrap(a.description, width, 6, 6)}" for a in study_arguments.arguments()
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the command."""
    go_on_when_output_closes()
    words = sys.argv[1:]
    if {"-h", "--help"} & set(words):
        sys.stdout.write(usage(screen_width()) + "\n")
        return 0
    ros_environment.prepare()
    try:
        given = parse(words)
        nodes, viewers = study_nodes.nodes(given), study_nodes.viewers(given)
        study_nodes.check_tails(nodes)
        study = StudyProcesses(nodes, viewers)
    except (ValueError, FileNotFoundError) as error:
        tell_error("bringup", error)
        return EXIT_USAGE if isinstance(error, ValueError) else EXIT_FAILURE
    try:
        return study.run()
    finally:
        study.close()


if __name__ == "__main__":
    sys.exit(main())
