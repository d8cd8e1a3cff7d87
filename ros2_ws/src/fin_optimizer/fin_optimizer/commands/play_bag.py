"""Command ``play_bag``: publishes a recorded trial again."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING

from fin_optimizer.bags.integrity import UNGUARDED
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.player.node import Options, Player
from fin_plant import checks, node_process
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Sequence


def _positive(text: str) -> float:
    value = checks.read_number(text)
    if not (math.isfinite(value) and value >= 0.0):
        msg = f"{text} must be a finite number, 0 or more"
        raise argparse.ArgumentTypeError(msg)
    return value


def _parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    words = argparse.ArgumentParser(
        prog="play_bag",
        description="Publish a recorded bag again. gait, /clock and what all nodes say of themselves are left out, and "
        "a topic that another node publishes is refused, unless --topics names it. /clock comes before the messages of "
        "its time; more than 10 s without a message are stepped over.",
        epilog="remaps and namespaces as for every node, for example --ros-args -r /fish/velocity:=/replay/velocity; "
        "services ~/pause and ~/resume",
    )
    words.add_argument("bag", type=given_path, metavar="BAG", help="folder of the bag, or its .mcap file")
    words.add_argument(
        "--rate", type=_positive, default=1.0, help="times the fish's pace; 0: as fast as listeners take it"
    )
    words.add_argument(
        "--start", type=_positive, default=0.0, metavar="S", help="begin so many s after the bag's beginning"
    )
    words.add_argument(
        "--loop", action="store_true", help="begin again at the end; clock and header stamps go on rising"
    )
    words.add_argument("--paused", action="store_true", help="wait for ~/resume")
    words.add_argument("--quiet", action="store_true", help="print errors only")
    words.add_argument(
        "--topics", nargs="+", metavar="TOPIC", default=(), help="only these, by their last name or in full"
    )
    return words


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a bag; return 0 at its end, 2 if it cannot be played."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    own = words[: words.index("--ros-args")] if "--ros-args" in words else words
    given = vars(_parser().parse_args(own))
    path = given.pop("bag")

    def player() -> Player:
        try:
            bag = read_bag(path)
            if not bag.guarded:
                sys.stderr.write(f"note: {bag.name} was {UNGUARDED}\n")
            return Player(bag, Options(**given))
        except BagError as error:
            raise ValueError(str(error)) from error

    return node_process.run(player, [sys.argv[0], *words])


if __name__ == "__main__":
    sys.exit(main())
