"""Lists the materials that ``swim --material`` knows: Young's modulus, density, loss and who states them."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from fin_plant.command import command
from fin_plant.executables import screen_width
from fin_plant.node_help import wrap
from fin_sim.materials import MATERIALS_FILE, materials

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_sim.materials import Material

_PASCAL_A_GIGAPASCAL = 1e9
_AFTER = (
    "A sheet's thickness is no property of its material: measure it and give swim --material NAME --fin.thickness "
    "METRES. Where the speed matters measure E too. The sources' full names stand at the head of the table, in"
)


def _shown(limits: tuple[float, float] | None, unit: float = 1.0) -> str:
    if limits is None:
        return "unknown"
    low, high = (f"{limit / unit:.4g}" for limit in limits)
    return low if low == high else f"{low} to {high}"


def _lines(entries: Sequence[Material], width: int) -> list[str]:
    """Return the table for a screen of so many columns; what a material is and who says so follows its numbers."""
    rows = [
        (entry.key, _shown(entry.young_modulus, _PASCAL_A_GIGAPASCAL), _shown(entry.density), f"{entry.loss_factor:g}")
        for entry in entries
    ]
    heads = ("material", "E, GPa", "kg/m^3", "tan delta")
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    lines = ["  ".join(map(str.ljust, heads, widths)).rstrip()]
    for row, entry in zip(rows, entries, strict=True):
        modulus_source = entry.modulus_source.rstrip(".")
        said = f"{entry.name}. E: {modulus_source}. Density: {entry.density_source}. tan delta: {entry.loss_source}."
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip(), wrap(said, width, 4, 4)]
    return [*lines, "", wrap(_AFTER, width, 0, 0), str(MATERIALS_FILE.resolve())]


def _json(entries: Sequence[Material]) -> str:
    units = {"young_modulus": "Pa", "density": "kg/m^3"}
    return json.dumps([{**asdict(entry), "units": units} for entry in entries], indent=1)


@command("materials")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0."""
    parser = argparse.ArgumentParser(prog="materials", description=__doc__.replace("``", ""))
    parser.add_argument("--json", action="store_true", help="as JSON, in Pa and kg/m^3, instead of a table")
    options = parser.parse_args(arguments)
    entries = list(materials().values())
    print(_json(entries) if options.json else "\n".join(_lines(entries, screen_width())))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())
