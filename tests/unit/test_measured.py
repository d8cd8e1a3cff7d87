"""The measures of a swim, from messages whose means are known, live and from a bag alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.bags.messages import decode, message_types, velocity_samples
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter
from fin_optimizer.goals import MEASURES, Goals
from fin_optimizer.score.mean_speed import Measurement, ScoreError
from fin_optimizer.score.measured import why_none
from fin_optimizer.score.recorded import achieved, goals_of, recorded_swim
from fin_optimizer.score.swim import SwimRecord, score_swim
from fin_optimizer.trial.result import Outcome
from fin_optimizer.trial.scored import result_of
from support.bags import JOINTS, SECOND, START, STATE, STEP, VELOCITY, joint_states, quality, state

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

THRUST = BagTopic("/fish/thrust", "geometry_msgs/msg/WrenchStamped", quality())
MEASUREMENT = Measurement(1.0, 2.5, block=0.5)
"""A window from 1 s to 3.5 s, of which the last three beats, from 2 s on, count as steady."""
TIMES = np.arange(401) * (STEP / SECOND)


def header(stamp: int) -> Any:
    types = message_types().types
    return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), "")


def vector(x: float = 0.0, z: float = 0.0) -> Any:
    return message_types().types["geometry_msgs/msg/Vector3"](x, 0.0, z)


def twist(stamp: int, forward: float, yaw_rate: float) -> bytes:
    types = message_types().types
    turning = types["geometry_msgs/msg/Twist"](vector(forward), vector(z=yaw_rate))
    return bytes(message_types().serialize_cdr(types[VELOCITY.type_name](header(stamp), turning), VELOCITY.type_name))


def wrench(stamp: int, force: float) -> bytes:
    types = message_types().types
    pushing = types["geometry_msgs/msg/Wrench"](vector(force), vector())
    return bytes(message_types().serialize_cdr(types[THRUST.type_name](header(stamp), pushing), THRUST.type_name))


def surge(time: float) -> float:
    """Return a speed in m/s that rises to 0.2 in 1 s, then to 0.3 at 2 s, where it sways; its mean there is 0.3."""
    swaying = 0.3 + 0.02 * math.sin(4.0 * math.pi * (time - 2.0))
    return 0.2 * time if time < 1.0 else 0.2 + 0.1 * (time - 1.0) if time < 2.0 else swaying


def yaw_rate(time: float) -> float:
    return -0.6 + 0.1 * math.cos(4.0 * math.pi * time) if time >= 2.0 else 5.0


def torque(time: float) -> float:
    return 0.4 if time < 2.0 else -0.2 * (1.0 + math.cos(4.0 * math.pi * time))


def record(
    yaw: Callable[[float], float] = yaw_rate,
    forward: Callable[[float], float] = surge,
    measurement: Measurement = MEASUREMENT,
) -> SwimRecord:
    stamps = (START + STEP * np.arange(len(TIMES))).tolist()
    velocities = [twist(stamp, forward(time), yaw(time)) for stamp, time in zip(stamps, TIMES, strict=True)]
    joints = [joint_states(stamp, torque(time), -2.0) for stamp, time in zip(stamps, TIMES, strict=True)]
    thrust = [wrench(stamp, 9.0 if time < 2.0 else 0.5) for stamp, time in zip(stamps, TIMES, strict=True)]
    started = decode(state("SWIMMING", START), STATE.type_name)
    return SwimRecord(velocity_samples(velocities), [started], joints, measurement.metadata(), velocities, thrust)


def measured(swim: SwimRecord, *names: str) -> dict[str, float]:
    return score_swim(swim, [MEASURES[name] for name in names])[1]


def test_each_measure_is_the_mean_that_its_table_says() -> None:
    """Mean speed (0.25 + 0.3 1.5) / 2.5; power 0.4 N m times -2 rad/s for 1 s, then 0.4 W on the mean for 1.5 s."""
    found = measured(record(), *MEASURES)
    assert [*found] == [*MEASURES]
    assert found["mean_speed"] == pytest.approx((0.25 + 0.45) / 2.5, rel=1e-4)
    assert found["steady_speed"] == pytest.approx(0.3, rel=1e-4)
    assert found["power"] == pytest.approx((-0.8 * 1.0 + 0.4 * 1.5) / 2.5, abs=4e-3)
    assert found["energy_per_metre"] == pytest.approx(found["power"] / found["mean_speed"])
    assert found["thrust"] == pytest.approx(0.5, rel=1e-12)
    assert found["efficiency"] == pytest.approx(0.5 * 0.3 / 0.4, rel=1e-3)
    assert found["turning_rate"] == pytest.approx(0.6, rel=1e-3)
    assert found["turning_radius"] == pytest.approx(0.5, rel=1e-3)
    assert found["servo_torque"] == pytest.approx(0.4, rel=1e-12)


def test_of_a_window_of_less_than_three_beats_the_whole_ones_count_and_less_than_one_is_refused() -> None:
    one = record(measurement=Measurement(1.0, 2.5, block=1.5))
    assert measured(one, "thrust")["thrust"] == pytest.approx(0.5, rel=1e-12)
    with pytest.raises(ScoreError, match=r"the window of 2\.5 s is shorter than a beat, 3 s.*longer measurement\.dur"):
        measured(record(measurement=Measurement(1.0, 2.5, block=3.0)), "steady_speed")
    assert measured(record(measurement=Measurement(1.0, 2.5, block=3.0)), "power")


def test_a_swim_may_have_none_of_a_measure_and_then_its_fin_cannot_be() -> None:
    backwards = record(forward=lambda time: -surge(time))
    found = measured(backwards, "energy_per_metre", "turning_radius")
    assert math.isnan(found["energy_per_metre"])
    assert found["turning_radius"] == pytest.approx(0.5, rel=1e-3), "also backwards"
    assert why_none(found) == "without headway there is no energy per metre"
    result = result_of(backwards, Goals.of(["efficiency", "energy_per_metre"]))
    assert (result.outcome, dict(result.measured)) == (Outcome.INFEASIBLE, {})
    assert "without headway there is no energy per metre" in result.reason


@pytest.mark.parametrize(
    ("changed", "name", "message"),
    [
        ({"thrust": ()}, "thrust", "no thrust for 1.5 s"),
        ({"joint_states": None}, "servo_torque", "no joint_states for 2.5 s"),
        ({"joint_states": None}, "efficiency", "no joint_states for 1.5 s"),
        ({"velocity_messages": ()}, "turning_rate", "velocity tells no yaw rate"),
    ],
)
def test_what_was_not_recorded_is_named(changed: dict[str, Any], name: str, message: str) -> None:
    swim = record()
    lacking = SwimRecord(**{**swim.__dict__, **changed})
    with pytest.raises(ScoreError, match=message):
        measured(lacking, name)
    assert measured(lacking, "steady_speed")


def driven_by(torques: NDArray[np.float64], name: str = "tail_joint_1", told: int = 1) -> SwimRecord:
    """Return the swim with these torques at `TIMES`, all at -2 rad/s, of a joint with this name."""
    types, type_name = message_types().types, JOINTS.type_name
    joints = []
    for index, each in enumerate(torques.tolist()):
        numbers = np.array([0.1]), np.array([-2.0]), np.array([each] * told)
        message = types[type_name](header(START + STEP * index), [name], *numbers)
        joints.append(bytes(message_types().serialize_cdr(message, type_name)))
    return SwimRecord(**{**record().__dict__, "joint_states": joints})


def test_the_largest_torque_is_that_between_the_windows_ends_which_count() -> None:
    for place, largest in ((99, 0.1), (100, 3.0), (350, 3.0), (351, 0.1)):  # from 1 s to 3.5 s
        torques = np.full(len(TIMES), -0.1)
        torques[place] = 3.0
        assert measured(driven_by(torques), "servo_torque")["servo_torque"] == largest


@pytest.mark.parametrize(("name", "told"), [("fin_hinge_1", 1), ("tail_joint_1", 0)])
def test_a_torque_that_the_tails_joints_do_not_tell_is_missed(name: str, told: int) -> None:
    with pytest.raises(ScoreError, match=r"^joint_states tell no torque of the tail's joints$"):
        measured(driven_by(np.ones(len(TIMES)), name, told), "servo_torque")


@pytest.mark.parametrize("torque", [0.0, 0.2])
def test_servos_that_give_no_power_have_no_efficiency(torque: float) -> None:
    found = measured(driven_by(np.full(len(TIMES), torque)), "power", "efficiency")
    assert found["power"] == pytest.approx(-2.0 * torque)
    assert math.isnan(found["efficiency"])


def test_a_swim_that_is_straight_where_it_is_steady_has_no_radius() -> None:
    straight = record(yaw=lambda time: 5.0 if time < 1.5 else 0.0)
    assert measured(straight, "turning_rate")["turning_rate"] == 0.0
    assert math.isnan(measured(straight, "turning_radius")["turning_radius"])


def test_why_a_swim_has_none_of_two_measures_is_told_of_both() -> None:
    why = "servos that take up power have no efficiency; without a turn there is no turning radius"
    assert why_none({"efficiency": math.nan, "power": 1.0, "turning_radius": math.nan}) == why
    assert why_none({"power": 1.0}) == ""


def test_a_window_of_one_beat_is_steady_as_a_whole() -> None:
    one = record(measurement=Measurement(1.0, 2.5, block=2.5))
    assert measured(one, "steady_speed")["steady_speed"] == pytest.approx((0.25 + 0.45) / 2.5, rel=1e-4)


def test_what_is_no_number_in_the_steady_part_is_named() -> None:
    no_yaw = record(yaw=lambda time: math.nan if time == 3.0 else 0.5)
    with pytest.raises(ScoreError, match=r"^velocity tells no yaw rate$"):
        measured(no_yaw, "turning_rate")
    swim = record()
    thrust = [*swim.thrust[:300], wrench(START + 300 * STEP, math.nan), *swim.thrust[301:]]
    with pytest.raises(ScoreError, match=r"^thrust tells no force$"):
        measured(SwimRecord(**{**swim.__dict__, "thrust": thrust}), "thrust")


def test_a_velocity_without_a_yaw_rate_turns_at_no_rate_that_is_known() -> None:
    straight = record(yaw=lambda _: 0.0)
    with pytest.raises(ScoreError, match=r"twist\.angular\.z is 0 throughout"):
        measured(straight, "turning_radius")
    assert measured(straight, "mean_speed")


def test_a_thrust_that_ends_early_is_a_swim_of_which_the_rest_was_lost() -> None:
    swim = record()
    short = SwimRecord(**{**swim.__dict__, "thrust": swim.thrust[:330]})
    with pytest.raises(ScoreError, match=r"thrust ends 0\.21 s before the window does"):
        measured(short, "thrust")


def test_a_bag_gives_what_the_live_trial_had_to_the_last_digit(tmp_path: Path) -> None:
    swim = record()
    goals = Goals.of(["efficiency", "turning_radius"], ["power <= 0.5 W", "mean_speed >= 2 cm/s"])
    metadata = {"study.objective": goals.objective, "study.constraints": "power <= 0.5 W; mean_speed >= 2 cm/s"}
    with BagWriter(tmp_path / "bag", (VELOCITY, STATE, JOINTS, THRUST), metadata | MEASUREMENT.metadata()) as writer:
        writer.write(STATE.name, state("SWIMMING", START))
        for velocity, joints, thrust in zip(swim.velocity_messages, swim.joint_states or (), swim.thrust, strict=True):
            writer.write(VELOCITY.name, velocity)
            writer.write(JOINTS.name, joints)
            writer.write(THRUST.name, thrust)
    bag = read_bag(tmp_path / "bag")
    assert goals_of(bag.metadata) == goals
    scored, live = score_swim(swim, goals.asked)
    assert score_swim(recorded_swim(bag, {}, goals.needs), goals.asked)[1] == live
    assert achieved(bag) == {
        "speed [m/s]": scored.value,
        "spread [m/s]": scored.spread,
        "efficiency": live["efficiency"],
        "turning radius [m]": live["turning_radius"],
        "power [W]": live["power"],
    }


def test_a_bag_of_a_study_about_something_unknown_is_no_bag_of_this_version() -> None:
    assert goals_of({}) == Goals()
    with pytest.raises(ScoreError, match=r"study\.objective, study\.constraints: 'beauty' is no measure"):
        goals_of({"study.objective": "beauty"})
