"""Command ``score_bag``: the score of recorded trials, equal to the live run's to the last digit."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.bag import BagError, decode, header_stamp, read_bag
from fin_optimizer.journal import StudyError
from fin_optimizer.pipe import end_with_the_reader
from fin_optimizer.repair_bags import bag_folders
from fin_optimizer.score import Measurement, Score, ScoreError, Window, mean_power, score
from fin_plant.plant_state import State

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.bag import Bag

_STAMP_KEY = "stamp_ns"  # as fin_plant.messages writes it; that module needs ROS, which a bag does not
_JOURNAL_FILE = "journal.log"  # as fin_optimizer.study names it, which needs Optuna
_FIN = "fin."
_JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
_DRIVEN = "tail_joint"
"""What the names of the driven joints start with; the fin's own hinges are springs and take no power from a servo."""


def start_of_swim(states: Iterable[Any], metadata: Mapping[str, str]) -> int:
    """Return the plant's time in ns at which the gait of a trial started.

    Args:
        states: All messages of its ``plant_state``.
        metadata: Of its bag; the entries ``fin.*`` tell which fin it is about.

    Raises:
        ScoreError: The plant started to swim never, more than once, with another fin, or did not say when.
    """
    fin = {name: value for name, value in metadata.items() if name.startswith(_FIN)}
    starts = set()
    for message in states:
        if message.message != State.SWIMMING:
            continue
        said = {item.key: item.value for item in message.values}
        if differs := [name for name in fin if said.get(name, fin[name]) != fin[name]]:
            words = ", ".join(f"{name} = {said[name]} instead of {fin[name]}" for name in differs)
            msg = f"the fish swam with {words}: it is another fin's swim"
            raise ScoreError(msg)
        try:
            starts.add(int(said.get(_STAMP_KEY, "")))
        except ValueError:
            stamp = said.get(_STAMP_KEY)
            msg = f"plant_state SWIMMING has {_STAMP_KEY} = {stamp!r}, needed is the plant's time in ns at its start"
            raise ScoreError(msg) from None
    if len(starts) != 1:
        msg = f"plant_state tells {len(starts)} starts of a swim, needed is one: the bag holds no whole trial"
        raise ScoreError(msg)
    return starts.pop()


def swimming_since(bag: Bag) -> int:
    """Return the plant's time in ns at which the gait of a recorded trial started.

    Raises:
        BagError: The bag has no ``plant_state``, or is damaged.
        ScoreError: As `start_of_swim` says.
    """
    return start_of_swim((message for _, message in bag.decoded("plant_state")), bag.metadata)


def power_samples(messages: Sequence[bytes]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return header stamps in ns and the tail servos' mechanical power in W, both (n,), of serialised JointStates.

    The power is NaN where a message does not tell it.
    """
    stamps = np.fromiter(map(header_stamp, messages), dtype=np.int64, count=len(messages))
    power = np.fromiter((_power(decode(data, _JOINT_STATE_TYPE)) for data in messages), np.float64, len(messages))
    return stamps, power


def tail_angle(message: bytes) -> float:
    """Return the largest angle in rad of the driven joints in a serialised JointState; 0 without any."""
    joints = decode(message, _JOINT_STATE_TYPE)
    pairs = zip(joints.name, joints.position, strict=False)
    return max((abs(float(angle)) for name, angle in pairs if name.startswith(_DRIVEN)), default=0.0)


def _power(joints: Any) -> float:
    driven = [index for index, name in enumerate(joints.name) if name.startswith(_DRIVEN)]
    if not driven or len(joints.effort) != len(joints.name) or len(joints.velocity) != len(joints.name):
        return float("nan")
    return float(sum(joints.effort[index] * joints.velocity[index] for index in driven))


def scored_swim(
    velocity: tuple[NDArray[np.int64], NDArray[np.float64]],
    joint_states: Sequence[bytes] | None,
    window: Window,
    measurement: Measurement,
) -> tuple[Score, float | None]:
    """Return the score of a swim and its cost of transport in J/m.

    The cost is the servos' mean mechanical power over the mean speed: energy for a metre of way. None without
    headway, where there is no such thing, and where it is not asked for.

    Args:
        velocity: Header stamps in ns and forward speeds in m/s, both (n,).
        joint_states: Serialised messages, None if the cost of transport is not asked for.
        window: What counts.
        measurement: How it was measured.

    Raises:
        ScoreError: The samples give no score, or no power.
    """
    scored = score(*velocity, window, block=measurement.block)
    if joint_states is None:
        return scored, None
    power = mean_power(*power_samples(joint_states), window)
    return scored, power / scored.value if scored.value > 0.0 else None


def score_bag(path: Path) -> tuple[Score, Bag]:
    """Return the score of a recorded trial, and its bag.

    Raises:
        BagError: There is no bag, it lacks a topic, or it is damaged.
        ScoreError: Its samples give no score.
    """
    bag = read_bag(path)
    measurement = Measurement.from_metadata(bag.metadata)
    window = measurement.window(swimming_since(bag))
    return score(*bag.velocity(), window, block=measurement.block), bag


def cost_of_transport(bag: Bag) -> float | None:
    """Return the cost of transport of a recorded trial in J/m, None without headway.

    Raises:
        BagError: It lacks a topic, or is damaged.
        ScoreError: Its samples give no score, or no power.
    """
    measurement = Measurement.from_metadata(bag.metadata)
    joints = [data for _, _, data in bag.messages("joint_states")]
    return scored_swim(bag.velocity(), joints, measurement.window(swimming_since(bag)), measurement)[1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the score of each bag; return 0, or 2 if one has none that should have one.

    Of a study, the bags of trials without a score are told and left out.
    """
    if arguments is None:
        end_with_the_reader()
    parser = argparse.ArgumentParser(
        prog="score_bag",
        description="Print one line a recorded trial: mean forward speed (m/s), its spread (m/s), bag.",
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help="a bag, its .mcap file, a folder of bags, or a study"
    )
    failed = False
    paths = parser.parse_args(arguments).paths
    if sys.stdout.isatty():  # a program that reads the numbers knows what they are
        sys.stdout.write(f"{'speed (m/s)':<20} {'spread (m/s)':<20} bag\n")
    for given in paths:
        try:
            bags = list(bag_folders(given)) if given.is_dir() else [given]
        except BagError as error:
            sys.stderr.write(f"error: {error}\n")
            failed = True
            continue
        unscored = _trials_without_score(given)
        for path in bags:
            if path in unscored:
                sys.stderr.write(f"note: {path}: {unscored[path]}\n")
            else:
                failed = not _print_score(path) or failed
    return 2 if failed else 0


def _trials_without_score(path: Path) -> dict[Path, str]:
    """Return what the journal of a study says of each bag whose trial is not OK; nothing if the path is no study."""
    if not (path / _JOURNAL_FILE).exists():
        return {}
    # Optuna takes a third of a second, which only a study's scores spend.
    from fin_optimizer.study import read_trials  # noqa: PLC0415
    from fin_optimizer.trial import Outcome  # noqa: PLC0415

    try:
        trials = read_trials(path)
    except (StudyError, OSError) as error:
        sys.stderr.write(f"note: {error}: every bag of {path} is scored\n")
        return {}
    found = {}
    for trial in trials:
        if trial.outcome is not Outcome.OK:
            because = f" ({trial.reason})" if trial.reason else ""
            found[path / trial.bag] = f"trial {trial.number} is {trial.outcome.value}{because}"
    return found


def _print_score(path: Path) -> bool:
    try:
        result, bag = score_bag(path)
    except (BagError, ScoreError) as error:
        sys.stderr.write(f"error: {path}: {error}\n")
        return False
    if not bag.complete:
        count = sum(bag.counts.values())
        sys.stderr.write(f"note: {path} was not closed; scored from the {count} messages that it holds\n")
    sys.stdout.write(f"{result.value!r} {result.spread!r} {path}\n")
    return True


if __name__ == "__main__":
    sys.exit(main())
