"""The swims of a folder: CSV files, and bags of trials, whose own descriptions say what was commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.bags.files import bags_in
from fin_optimizer.bags.messages import VELOCITY_TYPE, BagError
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.calibration.swims import LONGEST_GAP, SwimError, read_csv, swim_of
from fin_optimizer.score.mean_speed import ScoreError
from fin_optimizer.score.swim import start_of_swim
from fin_plant import yaml_file
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from fin_optimizer.bags.reader import Bag
    from fin_optimizer.calibration.swims import Swim
    from fin_plant.parameters import Value

    Array = np.ndarray[Any, np.dtype[np.float64]]

_POSE_TYPE = "geometry_msgs/msg/PoseStamped"
_GAIT_TYPE = "std_msgs/msg/Float64MultiArray"
_STATE_TYPE = "diagnostic_msgs/msg/DiagnosticStatus"
_SETTLED = 1.0  # s after the gait's start: its ramp is over, the beat is even
_RATE = 20.0  # Hz, at most, to which samples are thinned


def read_folder(folder: Path) -> list[Swim]:
    """Return the swims of a folder: its CSV files and the bags in it, by name.

    Raises:
        SwimError: There is none, or one cannot be used.
        OSError: It cannot be read.
    """
    if not folder.is_dir():
        msg = f"{folder} is no folder: give the one that holds the swims"
        raise SwimError(msg)
    if (folder / "bags").is_dir():  # a study, whose table of trials is no swim
        swims = [read_swim_of_bag(bag) for bag in _bags(folder)]
    else:
        swims = [read_csv(path) for path in sorted(folder.glob("*.csv"))]
        swims = swims or [read_swim_of_bag(bag) for bag in _bags(folder)]
    if not swims:
        msg = f"{folder} holds no swims: neither amplitude<degrees>_bias<degrees>_<run>.csv nor bags of trials"
        raise SwimError(msg)
    return swims


def _bags(folder: Path) -> list[Path]:
    try:
        return list(bags_in(folder))
    except BagError:  # there is none
        return []


def read_swim_of_bag(path: Path) -> Swim:
    """Return the swim of a trial's bag, from one second after its gait's start to its end.

    Raises:
        SwimError: It holds no swim that can be used.
    """
    try:
        return _swim_of(read_bag(path))
    except (BagError, ScoreError) as error:
        raise SwimError(error.reason) from None


def _swim_of(bag: Bag) -> Swim:
    start = start_of_swim((message for _, message in bag.decoded("plant_state", _STATE_TYPE)), bag.metadata)
    gaits = [(at, message.data) for at, message in bag.decoded("gait_applied", _GAIT_TYPE)]
    moving = [(at, gait) for at, gait in gaits if len(gait) == 4 and gait[0] > 0.0]  # noqa: PLR2004
    if len(moving) != 1:
        msg = f"bag {bag.path} has {len(moving)} gaits of one joint that moves, needed is one for the whole swim"
        raise SwimError(msg)
    (begun, gait), ends = moving[0], [at for at, _ in gaits if at > moving[0][0]]
    twists = _stamped(bag, "velocity", VELOCITY_TYPE, lambda message: _twist(message.twist))
    poses = _stamped(bag, "pose", _POSE_TYPE, lambda message: _pose(message.pose))
    end = min([start + at - begun for at in ends] + [int(twists[-1, 0]), int(poses[-1, 0])])
    kept = twists[(twists[:, 0] >= start + _SETTLED * NANOSECONDS) & (twists[:, 0] <= end)]
    if len(kept) < 2:  # noqa: PLR2004
        msg = f"bag {bag.path} has no samples from {_SETTLED:g} s after its gait's start on"
        raise SwimError(msg)
    every = max(1, round(NANOSECONDS / _RATE / float(np.median(np.diff(kept[:, 0])))))
    kept = kept[::every]
    _check_poses(bag, kept[:, 0], poses[:, 0], float(gait[1]))
    heading = np.unwrap(poses[:, 3])
    x, y, turned = (np.interp(kept[:, 0], poses[:, 0], each) for each in (poses[:, 1], poses[:, 2], heading))
    columns = {
        "t": (kept[:, 0] - float(start)) / NANOSECONDS,
        "v_forward": kept[:, 1],
        "v_lateral": kept[:, 2],
        "yaw_rate": kept[:, 3],
        "heading": turned,
        "x": x,
        "y": y,
    }
    return swim_of(str(bag.name.name), float(gait[0]), float(gait[3]), columns, float(gait[1]), _fin(bag.metadata))


def _check_poses(bag: Bag, samples: Array, poses: Array, frequency: float) -> None:
    """Refuse a bag whose poses, all by their stamps in ns, leave too long a part of a beat out."""
    inside = poses[(poses > samples[0]) & (poses < samples[-1])]
    gaps = np.diff(np.concatenate((samples[:1], inside, samples[-1:]))) / NANOSECONDS
    if (longest := float(gaps.max())) * frequency > LONGEST_GAP:
        msg = f"bag {bag.path} has no pose for {longest:.2f} s, more than {LONGEST_GAP:g} of a beat: swim it again"
        raise SwimError(msg)


def _stamped(bag: Bag, topic: str, kind: str, numbers: Any) -> Array:
    """Return stamp in ns and numbers of each message of a topic, in the order of the stamps."""
    rows = [
        (message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec, *numbers(message))
        for _, message in bag.decoded(topic, kind)
    ]
    if not rows:
        msg = f"bag {bag.path} has no messages of {topic}: a calibration needs velocity and pose"
        raise SwimError(msg)
    table = np.array(rows, dtype=np.float64)
    if not np.isfinite(table).all():
        msg = f"bag {bag.path} has numbers in {topic} that are not finite: leave it out, or swim it again"
        raise SwimError(msg)
    return table[np.argsort(table[:, 0], kind="stable")]


def _twist(twist: Any) -> tuple[float, float, float]:
    return twist.linear.x, twist.linear.y, twist.angular.z


def _pose(pose: Any) -> tuple[float, float, float]:
    turn = pose.orientation
    yaw = np.arctan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))
    return pose.position.x, pose.position.y, float(yaw)


def _fin(metadata: Mapping[str, str]) -> dict[str, Value]:
    """Return the fin that a bag's description names."""
    told = {name: text for name, text in metadata.items() if name in FIN_PARAMETERS}
    texts = {
        name: text if FIN_PARAMETERS[name].kind == "string" else yaml_file.parse(text) for name, text in told.items()
    }
    return {name: FIN_PARAMETERS[name].check(value) for name, value in texts.items()}
