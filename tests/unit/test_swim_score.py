"""What a swim's messages tell: the servos' power, the tail's angle, where it began, and whether the fin folded."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fin_optimizer.bags.messages import decode, message_types
from fin_optimizer.goals import MEASURES
from fin_optimizer.score.joints import joint_columns
from fin_optimizer.score.mean_speed import Measurement, NotThisSwimError, Score, ScoreError
from fin_optimizer.score.measured import power_samples
from fin_optimizer.score.swim import SwimRecord, refuse_folded, score_swim, start_of_swim, tail_angle
from support.bags import JOINTS, SECOND, START, STATE, STEP, state

TAIL = "tail_joint_1"


def joints(**told: tuple[float, ...]) -> bytes:
    """Return a serialised JointState: by joint its angle, and its rate and torque where they are told."""
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](3, 5), "")
    columns = [[numbers[place] for numbers in told.values() if len(numbers) > place] for place in range(3)]
    message = types[JOINTS.type_name](header, list(told), *map(np.array, columns))
    return bytes(message_types().serialize_cdr(message, JOINTS.type_name))


def test_power_is_torque_times_rate_of_the_driven_joints_alone() -> None:
    """2 x 3 + 5 x 7 = 41 W; the hinge is a spring."""
    message = joints(tail_joint_1=(0.1, 3.0, 2.0), fin_hinge_1=(0.2, 100.0, 100.0), tail_joint_2=(0.1, 7.0, 5.0))
    stamps, power = power_samples(joint_columns([message, message]))
    assert stamps.tolist() == [3 * SECOND + 5] * 2
    assert power.tolist() == [41.0, 41.0]


@pytest.mark.parametrize(
    "told",
    [
        {"fin_hinge_1": (0.1, 1.0, 1.0)},
        {TAIL: (0.1, 1.0)},
        {TAIL: (0.1,)},
        {TAIL: (0.1, 1.0, 2.0), "fin_hinge_1": (0.1, 1.0)},
        {TAIL: (0.1, 1.0, 2.0), "fin_hinge_1": (0.1,)},
    ],
)
def test_a_message_that_does_not_tell_the_power_has_none(told: dict[str, tuple[float, ...]]) -> None:
    assert math.isnan(power_samples(joint_columns([joints(**told)]))[1][0])


def test_no_messages_tell_no_power_at_no_time() -> None:
    assert [column.tolist() for column in power_samples([])] == [[], []]


def test_the_tails_angle_is_the_largest_of_its_joints_either_way() -> None:
    assert tail_angle(joints(tail_joint_1=(0.2,), tail_joint_2=(-0.3,), fin_hinge_1=(2.0,))) == 0.3
    assert tail_angle(joints(fin_hinge_1=(2.0,))) == 0.0


def test_a_fin_folds_where_a_hinge_bends_beyond_half_a_turn() -> None:
    straight, folded = joints(fin_hinge_1=(0.1,)), joints(fin_hinge_1=(-3.2,))
    refuse_folded(joint_columns([]))
    refuse_folded(joint_columns([straight, straight]))
    refuse_folded(joint_columns([joints(tail_joint_1=(3.2,))] * 2))
    with pytest.raises(ScoreError, match="183 degrees"):
        refuse_folded(joint_columns([joints(fin_hinge_1=(0.1,), fin_hinge_2=(0.1,)), folded]))
    with pytest.raises(ScoreError, match="183 degrees"):
        refuse_folded(joint_columns([straight, folded, straight]))


def start(*messages: bytes, **metadata: str) -> int:
    return start_of_swim([decode(message, STATE.type_name) for message in messages], metadata)


def test_a_swim_begins_where_its_state_says() -> None:
    said = {"fin__length": "0.08"}
    fin = {"fin.length": "0.08", "study.seed": "1"}
    assert start(state("READY", 1), state("SWIMMING", START, **said), state("READY", 2), **fin) == START
    assert start(state("SWIMMING", 7), **fin) == 7, "a state that tells no fin is believed"
    with pytest.raises(NotThisSwimError, match=r"swam with fin\.length = 0\.09 instead of 0\.08"):
        start(state("SWIMMING", START, fin__length="0.09"), **fin)
    with pytest.raises(NotThisSwimError, match=r"0\.09 instead of 0\.08, fin\.height = 3 instead of 2: it is another"):
        start(state("SWIMMING", START, fin__length="0.09", fin__height="3"), **fin, **{"fin.height": "2"})
    with pytest.raises(NotThisSwimError, match="0 starts of a swim, needed is one: no swim begins"):
        start(state("READY", 1), **fin)
    with pytest.raises(NotThisSwimError, match="2 starts of a swim, needed is one: the bag holds more"):
        start(state("SWIMMING", 1), state("SWIMMING", 2), **fin)


def scored(
    velocity: tuple[np.ndarray, np.ndarray], joint_states: list[bytes] | None, measurement: Measurement
) -> tuple[Score, float | None]:
    started = decode(state("SWIMMING", START), STATE.type_name)
    record = SwimRecord(velocity, [started], joint_states, measurement.metadata())
    reached, measured = score_swim(record, [] if joint_states is None else [MEASURES["energy_per_metre"]])
    return reached, measured.get("energy_per_metre")


def steady(speed: float) -> tuple[np.ndarray, np.ndarray]:
    """A swim from rest that takes 0.2 s to be at its speed, about which it sways from sample to sample."""
    number = np.arange(401)
    stamps = START + STEP * number
    swaying = speed + np.where(number % 2, 0.01, -0.01)
    return stamps, swaying * np.minimum((stamps - START) / (SECOND / 5), 1.0)


def power_of(torque: float) -> list[bytes]:
    types = message_types().types
    messages = []
    for stamp in START + STEP * np.arange(401):
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(int(stamp), SECOND)), "")
        numbers = (np.array([value]) for value in (0.1, 0.5, torque))
        message = types[JOINTS.type_name](header, [TAIL], *numbers)
        messages.append(bytes(message_types().serialize_cdr(message, JOINTS.type_name)))
    return messages


def test_energy_per_metre_is_asked_for_and_there_with_headway() -> None:
    """2 N m at 0.5 rad/s are 1 W; at 0.25 m/s that is 4 J for a metre."""
    measurement = Measurement(1.0, 2.0)
    assert scored(steady(0.25), power_of(2.0), measurement)[1] == pytest.approx(4.0, rel=1e-12)
    assert scored(steady(0.25), None, measurement)[1] is None
    for speed in (0.0, -0.25):
        reached, energy = scored(steady(speed), power_of(2.0), measurement)
        assert reached.value == pytest.approx(speed, rel=1e-12)
        assert energy is not None
        assert math.isnan(energy)


def test_a_swim_faster_than_a_fish_or_not_from_rest_is_refused() -> None:
    measurement = Measurement(1.0, 2.0, largest_speed=0.2)
    with pytest.raises(ScoreError, match="largest_speed"):
        scored(steady(0.25), None, measurement)
    stamps, speeds = steady(0.25)
    measurement = Measurement(1.0, 2.0, largest_start_speed=0.1)
    with pytest.raises(NotThisSwimError, match=r"25 cm/s before the gait.*within 10 cm/s"):
        scored((stamps, 0.25 + 0.0 * speeds), None, measurement)


def test_the_recording_reaches_the_windows_end() -> None:
    """To the nanosecond; what ends before it has lost the rest of the swim, though no gap is too long."""
    measurement = Measurement(1.0, 2.0)
    stamps, speeds = steady(0.25)
    joints = power_of(2.0)
    reached = slice(0, 301)
    assert scored((stamps[reached], speeds[reached]), joints[reached], measurement)[1] is not None
    short = slice(0, 276)
    with pytest.raises(ScoreError, match=r"^velocity ends 0\.25 s before the window does"):
        scored((stamps[short], speeds[short]), None, measurement)
    with pytest.raises(ScoreError, match=r"^joint_states ends 0\.25 s before the window does"):
        scored((stamps, speeds), joints[short], measurement)


def test_a_swim_whose_joints_nobody_recorded_has_no_energy() -> None:
    started = decode(state("SWIMMING", START), STATE.type_name)
    record = SwimRecord(steady(0.25), [started], None, Measurement(1.0, 2.0).metadata())
    with pytest.raises(ScoreError, match="no joint_states for"):
        score_swim(record, [MEASURES["energy_per_metre"]])


def test_a_swim_of_a_folded_fin_or_of_a_tracker_that_stands_still_has_no_score() -> None:
    measurement = Measurement(1.0, 2.0)
    with pytest.raises(ScoreError, match="183 degrees"):
        scored(steady(0.25), [joints(fin_hinge_1=(-3.2,))], measurement)
    stamps, speeds = steady(0.25)
    speeds[150:250] = 0.25
    with pytest.raises(ScoreError, match="to the last bit"):
        scored((stamps, speeds), None, measurement)


def test_a_swim_without_the_time_of_its_start_is_refused() -> None:
    for stamp in ("", "soon"):
        with pytest.raises(ScoreError, match=f"stamp_ns = '{stamp}', needed is the plant's time"):
            start(state("SWIMMING", START, stamp_ns=stamp))
    message = decode(state("SWIMMING", START), STATE.type_name)
    message.values.clear()
    with pytest.raises(ScoreError, match="stamp_ns = None"):
        start_of_swim([message], {})


def test_a_joint_without_an_angle_is_not_looked_at() -> None:
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](3, 5), "")
    names, angles = ["tail_joint_1", "tail_joint_2"], np.array([0.2])
    message = types[JOINTS.type_name](header, names, angles, np.zeros(0), np.zeros(0))
    assert tail_angle(bytes(message_types().serialize_cdr(message, JOINTS.type_name))) == 0.2
