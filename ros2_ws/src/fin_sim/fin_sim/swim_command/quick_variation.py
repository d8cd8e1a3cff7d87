"""Swims that ask only for what `swim_batch` gives, right to its `TOLERANCES`: many swims side by side.

The swims of one fish and gait form one batch, its fins the columns. A figure that the batch does not have is left out
of the table: whatever needs a swim's samples, and a free body's thrust, whose inertial reaction has a mean in the axes
of a body that yaws.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING

from fin_sim.batch import Status, swim_batch
from fin_sim.swim_command.figures import FIGURES, Figure
from fin_sim.swim_command.variation import Swum, swimming_threads
from fin_sim.swim_result import measured_beats

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from concurrent.futures import Future

    from fin_sim.batch import BatchSwim
    from fin_sim.swim_command.plan import SwimPlan

_FIGURES = ("mean_speed", "mean_servo_power", "largest_hinge_angle")
_OF_A_HELD_BODY = ("mean_thrust", "efficiency")
_OF_A_MOTOR = ("mean_electrical_power", "largest_servo_torque")
_MOST_AT_A_TIME = 256
"""Fins of a batch: between two of them a variation shows its progress and can be stopped."""


def quick_figures(plan: SwimPlan) -> tuple[Figure, ...]:
    """Return the figures that a quick variation has, in the order of `FIGURES`."""
    names = {*_FIGURES, *(_OF_A_HELD_BODY if plan.clamp != "free" else ()), *(_OF_A_MOTOR if plan.fish().motor else ())}
    return tuple(figure for figure in FIGURES if figure.name in names)


def refuse_slow(plans: Sequence[SwimPlan]) -> None:
    """Refuse what does not swim in a batch.

    Raises:
        ValueError: A servo with a lag.
    """
    for plan in plans:
        servo = plan.servo()
        if servo.lag > 0.0:
            msg = (
                f"servo.lag = {servo.lag:g} s: --quick swims with servos that are told what the gait says; leave out "
                "--quick, or the lag and what needs it"
            )
            raise ValueError(msg)


def _shared(plan: SwimPlan) -> tuple[object, ...]:
    """Return all of a plan but its fin: what the swims of one batch have in common."""
    values = sorted((name, str(value)) for name, value in plan.values.items() if not name.startswith("fin."))
    return (tuple(values), *(getattr(plan, item.name) for item in fields(plan) if item.name != "values"))


def _batches(plans: Sequence[SwimPlan]) -> list[list[int]]:
    """Return the indices of the plans that swim together."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, plan in enumerate(plans):
        groups.setdefault(_shared(plan), []).append(index)
    return [
        group[start : start + _MOST_AT_A_TIME]
        for group in groups.values()
        for start in range(0, len(group), _MOST_AT_A_TIME)
    ]


def _swim(plans: Sequence[SwimPlan], names: Sequence[str]) -> list[Swum]:
    """Swim plans that differ in their fins alone; return the figures of these names, None where they have none."""
    plan = plans[0]
    fish = plan.fish()
    gait = plan.drive(fish.driven_joints)
    try:
        begin = max(float(measured_beats(gait, plan.duration, plan.ramp_time)[0]), 0.0)
    except ValueError:  # the tail does not beat, or not once after the ramp: speeds and angles only
        begin = None
    batch = swim_batch(
        [each.fin() for each in plans],
        fish,
        gait,
        plan.duration,
        reactive=plan.reactive,
        clamp=plan.clamp,
        tow_speed=plan.tow_speed,
        ramp_time=plan.ramp_time,
        settle=begin or 0.0,
        threads=1,
    )
    own = [figure.name for figure in quick_figures(plan)]
    steady = _steady_figures(plan, batch) if begin is not None else {}
    result = []
    for index in range(len(plans)):
        failure = batch.reason(index)
        if failure:
            result.append(Swum(dict.fromkeys(names), failure=failure))
            continue
        known: dict[str, float | None] = {
            "mean_speed": float(batch.mean_speed[index]),
            "largest_hinge_angle": float(batch.largest_hinge_angle[index]),
            **{name: values[index] for name, values in steady.items()},
        }
        result.append(Swum({name: known.get(name) if name in own else None for name in names}, batch.warnings(index)))
    return result


def _steady_figures(plan: SwimPlan, batch: BatchSwim) -> dict[str, list[float | None]]:
    """Return the means over the measured beats, and the efficiency where the force acts where it arises."""
    rows: dict[str, list[float | None]] = {
        "mean_thrust": batch.thrust.tolist(),
        "mean_servo_power": batch.servo_power.tolist(),
        "mean_electrical_power": batch.electrical_power.tolist(),
        "largest_servo_torque": batch.servo_torque.tolist(),
    }
    if plan.reactive == "distributed":
        # Only a held body has an efficiency here; it heads along x.
        useful = (batch.thrust * (batch.mean_forward_speed - plan.fish().water.current_x)).tolist()
        powers = batch.servo_power.tolist()
        rows["efficiency"] = [
            one / power if status == Status.OK and power > 0.0 else None
            for one, power, status in zip(useful, powers, batch.status, strict=True)
        ]
    return rows


@contextmanager
def swim_quickly(plans: Sequence[SwimPlan], cores: int | None = None) -> Iterator[Iterator[Swum]]:
    """Swim plans in batches on all cores; yield their outcomes in order, as `variation.swim_all` does.

    Args:
        plans: To swim.
        cores: Batches at a time; as many as this process may use if None.

    Raises:
        ValueError: A plan that does not swim in a batch.
    """
    refuse_slow(plans)
    places: dict[int, tuple[Future[list[Swum]], int]] = {}
    batches = _batches(plans)
    known = {figure.name for batch in batches for figure in quick_figures(plans[batch[0]])}
    names = [figure.name for figure in FIGURES if figure.name in known]
    with swimming_threads(cores) as executor:
        for batch in batches:
            future = executor.submit(_swim, [plans[index] for index in batch], names)
            places |= {index: (future, row) for row, index in enumerate(batch)}
        ordered = (places[index] for index in range(len(plans)))
        yield (future.result()[row] for future, row in ordered)
