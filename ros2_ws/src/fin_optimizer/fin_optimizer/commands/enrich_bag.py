"""Command ``enrich_bag``: copies of bags with frames and shapes of the fish, for 3-D views, where they lack them."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from fin_optimizer.bags.enrich import enriched
from fin_optimizer.bags.files import bags_in
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_plant.command import command, tell_error
from fin_plant.output import go_on_when_output_closes
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


@command("enrich_bag", when_output_closes=go_on_when_output_closes)
def main(arguments: Sequence[str] | None = None) -> int:
    """Copy what is asked for; return 0, or 2 if a bag could not be copied."""
    parser = argparse.ArgumentParser(
        prog="enrich_bag",
        description="Copy bags of older versions, adding what a 3-D view shows the fish by: robot_description, /tf, "
        "markers and path. The originals stay as they are.",
    )
    parser.add_argument("paths", nargs="+", type=given_path, metavar="PATH", help="a bag, a folder of bags, or a study")
    parser.add_argument(
        "--into", type=given_path, metavar="FOLDER", help="put the copies there (default: beside each, as BAG_3d)"
    )
    given = parser.parse_args(arguments)
    code = 0
    for path in given.paths:
        try:
            bags = list(bags_in(path))
        except BagError as error:
            code = _tell(error)
            continue
        for bag in bags:
            try:
                sys.stdout.write(f"{_copied(bag, given.into)}\n")
            except (BagError, ValueError) as error:
                code = _tell(error)
    return code


def _copied(path: Path, into: Path | None) -> Path:
    bag = read_bag(path)
    copy = (into / bag.name.name) if into is not None else bag.name.with_name(f"{bag.name.name}_3d")
    enriched(bag, copy)
    return copy


def _tell(error: Exception) -> int:
    tell_error("enrich_bag", error)
    return 2


if __name__ == "__main__":
    sys.exit(main())
