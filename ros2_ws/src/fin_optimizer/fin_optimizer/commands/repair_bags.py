"""Command ``repair_bags``: closes bags that a kill or a power cut left open."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.repair import repair_bags
from fin_plant.command import command, tell_error
from fin_plant.output import go_on_when_output_closes
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Sequence


@command("repair_bags", when_output_closes=go_on_when_output_closes)
def main(arguments: Sequence[str] | None = None) -> int:
    """Repair what is asked for; return 0, or 2 if a bag could not be repaired."""
    parser = argparse.ArgumentParser(
        prog="repair_bags",
        description="Close bags that a kill or a power cut left open. The optimiser does the same when it goes on.",
    )
    parser.add_argument("paths", nargs="+", type=given_path, metavar="PATH", help="a bag, a folder of bags, or a study")
    code = 0
    for path in parser.parse_args(arguments).paths:
        try:
            repairs = repair_bags(path)
        except BagError as error:
            tell_error("repair_bags", error)
            code = 2
            continue
        for repair in repairs:
            if repair.failure:
                tell_error("repair_bags", repair)
            else:
                sys.stdout.write(f"{repair}\n")
        if any(repair.failure for repair in repairs):
            code = 2
        if not repairs:
            sys.stdout.write(f"{path}: every bag was closed, nothing to repair\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
