"""Write docs/parameters.md from the packages' tables of parameters, topics and services: `make pages` calls it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_plant import topics
from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS, node_table
from fin_plant.parameters import Parameter, ParameterTable, load_table
from fin_plant.services import SERVICES

if TYPE_CHECKING:
    from collections.abc import Iterable

PAGE = Path(__file__).resolve().parent.parent / "docs" / "parameters.md"
HEAD = """# Parameters, topics and services

Every parameter of every node, written by `make pages` from the tables that the nodes declare them from. Units are SI.
Give them at the start (`-p name:=value` after `--ros-args`, or `name:=value` to the launch file), change those that are
not *fixed* with `ros2 param set`. A value outside its range is refused and the node keeps the last good one.
A study goes on only with the fish that it was begun with: with the same values of its plant's parameters, but for the
fin's and those that *may differ within a study*.
What `ros2 param dump` writes starts the same node again (`--ros-args --params-file`).

Lists of which each entry belongs to one of another list, as a profile's heights to its positions, may be set in any
order. While their lengths differ, those before stay in force and `plant_state` says which are awaited; a swim under way
goes on, and no gait starts one.
"""


def rows(parameters: Iterable[Parameter]) -> Iterable[str]:
    """Return the lines of a table of parameters."""
    yield "| parameter | unit | default | range | meaning, and where the default comes from |"
    yield "|---|---|---|---|---|"
    for parameter in parameters:
        fixed = " *Fixed while the node runs.*" if parameter.read_only else ""
        fixed += "" if parameter.decides_swim else " *May differ within a study.*"
        meaning = f"{parameter.description} {parameter.reason}".strip().replace("|", "\\|") + fixed
        cells = (f"`{parameter.name}`", parameter.unit, parameter.shown_default, parameter.allowed, meaning)
        yield f"| {' | '.join(cells)} |"


def topic_rows() -> Iterable[str]:
    """Return the lines of the table of topics; relative names live in the fish's namespace."""
    yield "| topic | type | reliability, durability, depth | what |"
    yield "|---|---|---|---|"
    for topic in topics.ALL_TOPICS:
        qos = topic.qos
        offered = f"{qos.reliability.name.lower()}, {qos.durability.name.lower()}, {qos.depth}"
        yield f"| `{topic.name}` | `{topic.type_name}` | {offered} | {topic.description} |"
    what = "`tank` to `base_link` to each link, where its type is installed"
    yield f"| `{topics.TF}` | `{topics.TF_TYPE}` | reliable, volatile, 1000 | {what} |"


def service_rows() -> Iterable[str]:
    """Return the lines of the table of services."""
    yield "| service | type | nodes | what |"
    yield "|---|---|---|---|"
    for each in SERVICES:
        nodes = ", ".join(f"`{node}`" for node in each.nodes)
        yield f"| `~/{each.name}` | `{each.type_name}` | {nodes} | {each.description} |"


def page() -> str:
    """Return the text of the page."""
    own = ParameterTable({name: entry for name, entry in OPTIMIZER_PARAMETERS.items() if name not in FIN_PARAMETERS})
    chapters: list[tuple[str, ParameterTable]] = [
        ("Every plant: `simulator` and `servo_driver`", PLANT_PARAMETERS),
        ("`simulator`", load_table("fin_sim", "simulator_parameters.yaml")),
        ("`servo_driver`", load_table("fin_servo_driver", "servo_driver_parameters.yaml")),
        ("`velocity_estimator`", load_table("fin_servo_driver", "velocity_estimator_parameters.yaml")),
        ("`rehearsal`", node_table("fin_servo_driver", "rehearsal")),
        ("`optimizer`, besides the `fin.*` that its search starts from", own),
    ]
    parts = [HEAD]
    for title, table in chapters:
        parts += [f"\n## {title}\n", "\n".join(rows(table.values())) + "\n"]
    parts += ["\n## Topics\n", "\n".join(topic_rows()) + "\n", "\n## Services\n", "\n".join(service_rows()) + "\n"]
    return "\n".join(parts)


def main() -> int:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
