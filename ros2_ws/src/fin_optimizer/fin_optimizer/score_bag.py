"""Command ``score_bag``: the score of a recorded trial, equal to the live run's to the last digit."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fin_optimizer.bag import BagError, read_bag
from fin_optimizer.score import Measurement, Score, ScoreError, score
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.bag import Bag

_STAMP_KEY = "stamp_ns"  # as fin_plant.messages writes it; that module needs ROS, which a bag does not


def swimming_since(bag: Bag) -> int:
    """Return the plant's time in ns at which the gait of a recorded trial started.

    Raises:
        BagError: The bag has no ``plant_state``, or is damaged.
        ScoreError: The plant started to swim never, or more than once.
    """
    starts = {
        int(item.value)
        for _, message in bag.decoded("plant_state")
        if message.message == State.SWIMMING
        for item in message.values
        if item.key == _STAMP_KEY
    }
    if len(starts) != 1:
        msg = f"plant_state tells {len(starts)} starts of a swim, needed is one: the bag holds no whole trial"
        raise ScoreError(msg)
    return starts.pop()


def score_bag(path: Path) -> tuple[Score, Bag]:
    """Return the score of a recorded trial, and its bag.

    Raises:
        BagError: There is no bag, it lacks a topic, or it is damaged.
        ScoreError: Its samples give no score.
    """
    bag = read_bag(path)
    measurement = Measurement.from_metadata(bag.metadata)
    stamps, speed = bag.velocity()
    window = measurement.window(swimming_since(bag))
    return score(stamps, speed, window, block=measurement.block), bag


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the score of each bag; return 0, or 2 if one has none."""
    parser = argparse.ArgumentParser(
        prog="score_bag",
        description="Print one line a recorded trial: mean forward speed, its spread (m/s), bag.",
    )
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="folder of a bag, or its .mcap file")
    failed = False
    for path in parser.parse_args(arguments).bags:
        try:
            result, bag = score_bag(path)
        except (BagError, ScoreError) as error:
            sys.stderr.write(f"error: {path}: {error}\n")
            failed = True
            continue
        if not bag.complete:
            count = sum(bag.counts.values())
            sys.stderr.write(f"note: {path} was not closed; scored from the {count} messages that it holds\n")
        sys.stdout.write(f"{result.value!r} {result.spread!r} {path}\n")
    return 2 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
