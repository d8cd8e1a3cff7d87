"""The equations of one fish in the lanes, put together link by link: with plain numbers, or recorded whole."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from fin_sim.batch import kernel
from fin_sim.batch.equations import (
    Wrench,
    accelerate_body,
    accelerate_link,
    body_end,
    enter_link,
    gather_link,
    leave_link,
    sine_cosine,
)
from fin_sim.batch.step import (
    Code,
    Uniform,
    drive_at,
    lane_loop,
    link_at,
    move_body,
    move_hinge,
    predicted_hinge,
    predicted_velocity,
    sum_means,
)
from fin_sim.batch.tracing import Number, Real, Tape

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pytest

    from fin_sim.batch.equations import Drive, Hinge, LaneBody, LaneLink, Motion, Precision
    from fin_sim.batch.step import Form


def interpret(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let generated code run as it stands, uncompiled: for few steps that takes less time than to compile it."""

    def load(source: str) -> Any:
        names: dict[str, Any] = {}
        exec(source.replace("from fin_sim.compiled import kernel", "kernel = lambda function: function"), names)  # noqa: S102
        return SimpleNamespace(**names)

    monkeypatch.setattr(import_module("fin_sim.batch.lanes"), "generate", kernel.generate.__wrapped__)
    monkeypatch.setattr(kernel, "_load", load)


@dataclass(frozen=True)
class Response:
    """What the equations give: accelerations, forward force of the water less its reaction, servos' power."""

    surge: Real
    sway: Real
    yaw: Real
    hinges: tuple[Real, ...]
    thrust: Real
    power: Real


def respond(
    body: LaneBody,
    links: Sequence[LaneLink],
    drives: Sequence[Drive],
    hinges: Sequence[Hinge],
    velocity: Motion,
    *,
    free: bool,
    distributed: bool,
    precision: Precision,
) -> Response:
    """Return the accelerations of the body (in body axes) and of the hinges.

    Args:
        body: The body.
        links: From the head to the tail.
        drives: Of the first joints.
        hinges: The joints behind them.
        velocity: Surge, sway, yaw rate.
        free: Whether the body moves under its forces.
        distributed: Form of the reactive force.
        precision: Of sines and arctangents.
    """
    turns = [(drive.sine, drive.cosine) for drive in drives]
    turns += [sine_cosine(hinge.angle, precision) for hinge in hinges]
    rates = [drive.rate for drive in drives] + [hinge.rate for hinge in hinges]
    motions = []
    front = body_end(body, velocity)
    for link, turn, rate in zip(links, turns, rates, strict=True):
        motions.append(enter_link(front, turn, rate))
        front = leave_link(motions[-1], link.length)

    wrench = Wrench()
    joints: tuple[Drive | Hinge, ...] = (*drives, *hinges)
    last = len(links) - 1
    kept: list[tuple[Real, ...]] = [()] * len(links)
    for k in range(last, -1, -1):
        kept[k] = gather_link(
            wrench, links[k], motions[k], joints[k], turns[k], distributed=distributed, last=k == last
        )

    thrust = wrench.thrust_e
    change, ahead = accelerate_body(body, wrench, velocity, free=free, precision=precision)
    accelerations: list[Real] = []
    power: Real = 0.0
    for k, link in enumerate(links):
        drive = drives[k] if k < len(drives) else None
        ahead, value = accelerate_link(ahead, link, turns[k], motions[k][2], kept[k], drive)
        if drive:
            power = power + value
        else:
            accelerations.append(value)
    return Response(*change, tuple(accelerations), thrust, power)


class _Slots:
    """Places of the lanes' numbers in the flat array, in the order in which they are first named."""

    def __init__(self, lanes: int) -> None:
        self.tape, self._lanes = Tape(), lanes
        self.index: dict[str, int] = {}
        self.written: dict[str, Real] = {}

    def place(self, name: str, link: int | None = None) -> str:
        """Return the expression for a number of lane i."""
        key = name if link is None else f"{name}_{link}"
        return f"work[{self.index.setdefault(key, len(self.index)) * self._lanes} + i]"

    def read(self, name: str, link: int | None = None) -> Number:
        """Return the number as it was before the step."""
        return self.tape.load(self.place(name, link))

    def write(self, name: str, value: Real, link: int | None = None) -> None:
        """Give the number a new value at the end of the step."""
        self.written[self.place(name, link)] = value


def _trace_step(form: Form, slots: _Slots) -> None:
    """Record one step of one fish."""
    links = [link_at(form, slots, index) for index in range(form.links)]
    uniform = Uniform.load(form, slots.tape)
    passive = range(form.driven, form.links)
    drives = [drive_at(form, slots, joint) for joint in range(form.driven)]
    hinges = [predicted_hinge(slots, joint, uniform.step) for joint in passive]
    response = respond(
        uniform.body,
        links,
        drives,
        [hinge for hinge, _ in hinges],
        predicted_velocity(uniform, slots),
        free=form.free,
        distributed=form.distributed,
        precision=form.degrees,
    )
    largest: Real = slots.read("largest_angle")
    for joint, (_, known), acceleration in zip(passive, hinges, response.hinges, strict=True):
        largest = move_hinge(slots, joint, uniform.step, known, acceleration, largest)
    slots.write("largest_angle", largest)
    move_body(uniform, slots, (response.surge, response.sway, response.yaw))
    sum_means(uniform, slots, response.thrust, response.power)


def straight_code(form: Form) -> Code:
    """Return the code of a form without a loop over the links: a step of the whole chain at once."""
    slots, lanes = _Slots(form.lanes), form.lanes
    _trace_step(form, slots)
    constants = {"ZERO": 0.0}
    step = slots.tape.lines(slots.written, constants)
    results = [name for name in slots.index if slots.place(name) in slots.written]
    parameters = [name for name in slots.index if name not in results]
    gather, scatter = (
        [
            (f"chunk * {len(names) * lanes} + {column * lanes} + i", slots.place(name))
            for column, name in enumerate(names)
        ]
        for names in (parameters, results)
    )
    return Code(
        size=f"{len(slots.index) * lanes}",
        gather=lane_loop(0, lanes, [f"{place} = parameters[{source}]" for source, place in gather]),
        step=lane_loop(0, lanes, step),
        scatter=lane_loop(0, lanes, [f"results[{target}] = {place}" for target, place in scatter]),
        parameters=tuple(parameters),
        results=tuple(results),
        constants=constants,
        operations=slots.tape.count(slots.written.values()),
    )
