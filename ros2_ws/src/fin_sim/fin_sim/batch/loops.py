"""The code of a step, as loops over the links, each around a loop over the lanes.

The pieces of `equations` and `step` are recorded once for any link, and once each for the driven links with the body
and for the last link with the tip's force. The code does not know how many links there are, so one compilation serves
chains of every length. A copy of it for each link takes time and memory to compile that grow faster than the chain;
three links swim up to 8 % faster by it, six and seven slower (docs/performance.md).

A step goes five times along the chain, from record to record (a link's numbers in the flat array, ``_Layout``):

    begin    body and driven links: their motion
    outward  from the first passive link to the last: sine, cosine, motion, torque
    tip      last link: wrench with the tip's force
    inward   back to the first passive link: wrench and what `gather_link` keeps
    body     driven links and body: wrench, accelerations, new velocity and place
    forward  from the first passive link to the last: acceleration, new angle and rate

A tail without a passive link has begin and body alone.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import astuple, fields
from typing import TYPE_CHECKING

from fin_sim.batch.equations import (
    Drive,
    Hinge,
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
    CORRECTOR,
    HINGE_HISTORY,
    HINGE_STATES,
    VELOCITIES,
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
    from collections.abc import Callable, Iterable, Sequence

    from fin_sim.batch.equations import Motion, Turn
    from fin_sim.batch.step import Form

_TURN = ("sine", "cosine")
_DRIVE = (*_TURN, "drive_rate", "drive_acceleration")
_MOTION = ("along", "normal", "turn")
_WRENCH = tuple(f"wrench_{item.name}" for item in fields(Wrench))
_KEPT = ("kept_e", "kept_n", "kept_inertia", "kept_bias", "kept_push", "kept_inverse")
_AHEAD = ("end_along", "end_normal", "end_turn")
_LEFT = ("largest_angle", *(f"{name}_0" for name in HINGE_STATES))
"""What is left of each hinge; a state that is not finite must be seen."""
_HERE, _BEFORE, _BEHIND = 0, -1, 1


class _Layout:
    """The flat array: the body's numbers, then a record for each link and an empty one behind the last."""

    def __init__(self, form: Form) -> None:
        rates = [f"{name}_rate_{age}" for name in VELOCITIES for age in range(len(CORRECTOR) - 1)]
        sums = ["x_sum", "y_sum", "surge_sum", "thrust_sum", "power_sum"]
        body = [*VELOCITIES, *rates, "turned", "heading", *sums]
        states = [f"{name}_{age}" for name in HINGE_STATES for age in range(len(HINGE_HISTORY))]
        self.parameters = form.parameters
        carried = (*(_DRIVE if form.own_gaits else _TURN), *_MOTION, "torque", *_WRENCH, *_KEPT, *_AHEAD)
        record = [*self.parameters, *states, "largest_angle", *carried]
        self.body = {name: index for index, name in enumerate(body)}
        self.record = {name: index for index, name in enumerate(record)}
        self.lanes = form.lanes

    @property
    def width(self) -> int:
        """Length of a record."""
        return len(self.record) * self.lanes

    @property
    def begin(self) -> int:
        """Where the first record begins."""
        return len(self.body) * self.lanes

    def over(self, links: str, body: Sequence[str]) -> list[str]:
        """Return a loop over links, in which ``part`` is the record of one and those before and behind it.

        All that the loop over the lanes touches must lie in one array at offsets written as literals, hence ``part``.
        """
        start = f"{self.begin - self.width} + link * {self.width}"
        part = f"part = work[{start} : {start} + {3 * self.width}]"
        return [f"for link in {links}:", f"    {part}", *lane_loop(4, self.lanes, body)]


class _Piece:
    """One loop over the lanes: of any link, whose neighbours are -1 and 1, or of the body and the driven links."""

    def __init__(self, form: Form, layout: _Layout, name: str, *, of_a_link: bool) -> None:
        self.form, self._layout, self._of_a_link = form, layout, of_a_link
        self.tape = Tape(prefix=f"{name}_")
        self.uniform = Uniform.load(form, self.tape)
        self.written: dict[str, Real] = {}

    def _place(self, name: str, link: int | None) -> str:
        layout = self._layout
        if link is None:
            return f"work[{layout.body[name] * layout.lanes} + i]"
        column = layout.record[name] * layout.lanes
        if self._of_a_link:
            return f"part[{(link + 1) * layout.width + column} + i]"
        return f"work[{layout.begin + link * layout.width + column} + i]"

    def read(self, name: str, link: int | None = None) -> Number:
        """Return a number as it was before this piece."""
        return self.tape.load(self._place(name, link))

    def write(self, name: str, value: Real, link: int | None = None) -> None:
        """Give a number a new value at the end of this piece."""
        self.written[self._place(name, link)] = value

    def read_all(self, names: Iterable[str], link: int) -> list[Number]:
        """Return some of a link's numbers."""
        return [self.read(name, link) for name in names]

    def write_all(self, names: Sequence[str], values: Sequence[Real], link: int) -> None:
        """Give some of a link's numbers new values."""
        for name, value in zip(names, values, strict=True):
            self.write(name, value, link)

    def motion(self, names: Sequence[str], link: int) -> Motion:
        """Return a velocity or an acceleration."""
        along, normal, turn = self.read_all(names, link)
        return along, normal, turn

    def turn(self, link: int) -> Turn:
        """Return the sine and cosine of a link's joint."""
        sine, cosine = self.read_all(_TURN, link)
        return sine, cosine


def _begin(piece: _Piece) -> None:
    front = body_end(piece.uniform.body, predicted_velocity(piece.uniform, piece))
    for joint in range(piece.form.driven):
        drive = drive_at(piece.form, piece, joint)
        if piece.form.own_gaits:
            piece.write_all(_DRIVE, astuple(drive), joint)
        motion = enter_link(front, (drive.sine, drive.cosine), drive.rate)
        piece.write_all(_MOTION, motion, joint)
        front = leave_link(motion, piece.read("length", joint))


def _outward(piece: _Piece) -> None:
    hinge, _ = predicted_hinge(piece, _HERE, piece.uniform.step)
    turn = sine_cosine(hinge.angle, piece.form.degrees)
    front = leave_link(piece.motion(_MOTION, _BEFORE), piece.read("length", _BEFORE))
    piece.write_all(_TURN, turn, _HERE)
    piece.write_all(_MOTION, enter_link(front, turn, hinge.rate), _HERE)
    piece.write("torque", hinge.torque, _HERE)


def _inward(piece: _Piece, *, last: bool) -> None:
    wrench = Wrench() if last else Wrench(*piece.read_all(_WRENCH, _BEHIND))
    kept = gather_link(
        wrench,
        link_at(piece.form, piece, _HERE),
        piece.motion(_MOTION, _HERE),
        Hinge(0.0, 0.0, piece.read("torque", _HERE), piece.read("compliance", _HERE)),
        piece.turn(_HERE),
        distributed=piece.form.distributed,
        last=last,
    )
    piece.write_all(_KEPT, kept, _HERE)
    piece.write_all(_WRENCH, astuple(wrench), _HERE)


def _body(piece: _Piece) -> None:
    form, uniform = piece.form, piece.uniform
    drives = [
        Drive(*piece.read_all(_DRIVE, joint)) if form.own_gaits else drive_at(form, piece, joint)
        for joint in range(form.driven)
    ]
    turns = [(drive.sine, drive.cosine) for drive in drives]
    links = [link_at(form, piece, joint) for joint in range(form.driven)]
    motions = [piece.motion(_MOTION, joint) for joint in range(form.driven)]
    wrench = Wrench() if form.rigid else Wrench(*piece.read_all(_WRENCH, form.driven))
    kept: list[tuple[Real, ...]] = [()] * form.driven
    for joint in reversed(range(form.driven)):
        kept[joint] = gather_link(
            wrench,
            links[joint],
            motions[joint],
            drives[joint],
            turns[joint],
            distributed=form.distributed,
            last=joint == form.links - 1,
        )
    thrust = wrench.thrust_e
    power: Real = 0.0
    velocity = predicted_velocity(uniform, piece)
    slopes, ahead = accelerate_body(uniform.body, wrench, velocity, free=form.free, precision=form.degrees)
    for joint, drive in enumerate(drives):
        ahead, value = accelerate_link(ahead, links[joint], turns[joint], motions[joint][2], kept[joint], drive)
        power = power + value
    if not form.rigid:
        piece.write_all(_AHEAD, ahead, form.driven - 1)
    move_body(uniform, piece, slopes)
    sum_means(uniform, piece, thrust, power)


def _forward(piece: _Piece) -> None:
    step = piece.uniform.step
    _, known = predicted_hinge(piece, _HERE, step)
    ahead, acceleration = accelerate_link(
        piece.motion(_AHEAD, _BEFORE),
        link_at(piece.form, piece, _HERE),
        piece.turn(_HERE),
        piece.read("turn", _HERE),
        piece.read_all(_KEPT, _HERE),
        None,
    )
    piece.write_all(_AHEAD, ahead, _HERE)
    largest = piece.read("largest_angle", _HERE)
    piece.write("largest_angle", move_hinge(piece, _HERE, step, known, acceleration, largest), _HERE)


def code_of(form: Form) -> Code:
    """Return the code of a form: the same for any number of links beyond the driven ones."""
    layout, constants, operations = _Layout(form), {"ZERO": 0.0}, Counter[str]()
    passive = form.links - form.driven

    def lines(name: str, record: Callable[[_Piece], None], times: int, *, of_a_link: bool = True) -> list[str]:
        piece = _Piece(form, layout, name, of_a_link=of_a_link)
        record(piece)
        for kind, number in piece.tape.count(piece.written.values()).items():
            operations[kind] += number * times
        return piece.tape.lines(piece.written, constants)

    driven, lanes = form.driven, form.lanes
    step = lane_loop(0, lanes, lines("begin", _begin, 1, of_a_link=False))
    if passive:
        step += [
            *layout.over(f"range({driven}, links)", lines("outward", _outward, passive)),
            *layout.over("range(links - 1, links)", lines("tip", lambda piece: _inward(piece, last=True), 1)),
            *layout.over(
                f"range(links - 2, {driven - 1}, -1)",
                lines("inward", lambda piece: _inward(piece, last=False), passive - 1),
            ),
        ]
    step += lane_loop(0, lanes, lines("body", _body, 1, of_a_link=False))
    if passive:
        step += layout.over(f"range({driven}, links)", lines("forward", _forward, passive))
    here, count = layout.width, len(layout.parameters) * lanes
    gather = [
        "for link in range(links):",
        f"    for i in range({count}):",
        f"        work[{layout.begin} + link * {here} + i] = parameters[(chunk * links + link) * {count} + i]",
    ]
    state = [name for name in layout.body if form.free or name in ("thrust_sum", "power_sum")]
    left = f"chunk * (links - {driven}) * {len(_LEFT) * lanes} + chunk * {len(state) * lanes}"
    row = f"{left} + {len(state) * lanes} + (link - {driven}) * {len(_LEFT) * lanes}"
    scatter = lane_loop(
        0,
        lanes,
        [f"results[{left} + {n * lanes} + i] = work[{layout.body[name] * lanes} + i]" for n, name in enumerate(state)],
    )
    scatter += layout.over(
        f"range({driven}, links)",
        [
            f"results[{row} + {n * lanes} + i] = part[{here + layout.record[name] * lanes} + i]"
            for n, name in enumerate(_LEFT)
        ],
    )
    return Code(
        size=f"{layout.begin} + (links + 1) * {layout.width}",
        gather=gather,
        step=step,
        scatter=scatter,
        parameters=tuple(f"{name}_{link}" for link in range(form.links) for name in layout.parameters),
        results=(*state, *(f"{name}_{link}" for link in range(driven, form.links) for name in _LEFT)),
        constants=constants,
        operations=operations,
    )
