"""One step of one fish, in pieces that the generated code is made of.

One step costs one evaluation of the equations, at the state predicted for its end:

* hinges: backward differentiation of order 4, y_1 = 48/25 y_0 - 36/25 y_-1 + 16/25 y_-2 - 3/25 y_-3 + 12/25 h y'_1, for
  angle and rate. Springs and dampers act on the state at the step's end (linearly implicit), all other forces on the
  state extrapolated from the last four (Ascher, Ruuth & Wetton, SIAM J. Numer. Anal. 32, 1995, fourth-order SBDF).
  So the stiffest hinge does not bound the step, and no matrix is inverted but by the recursion over the links.
* body: Adams-Bashforth of order 3 predicts, Adams-Moulton of order 4 corrects (Hairer, Norsett & Wanner, *Solving
  Ordinary Differential Equations I*, 1993, section III.1); position and heading by the trapezoidal rule.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Protocol

from fin_sim.batch.equations import (
    DOUBLE,
    SINGLE,
    Beat,
    Drive,
    Fade,
    Hinge,
    LaneBody,
    LaneLink,
    LanePiece,
    Motion,
    Precision,
    ProfiledLink,
    driven_by,
    sine_cosine,
)
from fin_sim.batch.tracing import Number, Real, Tape, absolute, maximum

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Sequence

LANES = {"double": 8, "single": 16}
"""Fish side by side: 64 bytes, the widest vector register there is; where they are narrower a lane loop takes two."""

HINGE_HISTORY = (48.0 / 25.0, -36.0 / 25.0, 16.0 / 25.0, -3.0 / 25.0)
HINGE_REACH = 12.0 / 25.0
EXTRAPOLATION = (4.0, -6.0, 4.0, -1.0)
PREDICTOR = (23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0)
CORRECTOR = (9.0 / 24.0, 19.0 / 24.0, -5.0 / 24.0, 1.0 / 24.0)
LEAST_DAMPING = 0.4
"""Damping time over step below which a lightly damped hinge may grow: order 4 is stable for all stiffnesses from 0.36
on (found from the roots of its characteristic polynomial)."""

UNIFORM = (*(item.name for item in fields(LaneBody)), "step", "held_surge", "held_sway")
PIECE_FIELDS = tuple(item.name for item in fields(LanePiece))
LINK_FIELDS = tuple(item.name for item in fields(LaneLink))
TAPER_FIELDS = tuple(name for name in LINK_FIELDS if name.startswith("taper"))
HINGE_FIELDS = ("stiffness", "damping", "compliance")
HINGE_STATES = ("angle", "rate")
WEIGHTS = ("window_weight", "path_weight")
DRIVE_FIELDS = tuple(item.name for item in fields(Drive))
BEAT_FIELDS = tuple(item.name for item in fields(Beat))
FADE_FIELDS = tuple(f"fade_{item.name}" for item in fields(Fade))
VELOCITIES = ("surge", "sway", "yaw")
WINDOW_BEGIN = "window_begin"
"""A constant of the first joint: where a fish with a gait of its own has a window of its own, its beginning, s."""


@dataclass(frozen=True)
class Form:
    """What the generated code is special to.

    Attributes:
        driven: Number of driven joints, the first ones.
        links: Number of links.
        free: Whether the body moves under its forces.
        distributed: Form of the reactive force.
        tapered: Whether a link's height changes along it.
        precision: ``double`` or ``single``.
        viscous: Whether the body has a linear drag.
        current: Whether the water flows.
        own_gaits: Whether each fish has a gait of its own.
        pieces: Most pieces between two points of the profile that a link has.
    """

    driven: int
    links: int
    free: bool
    distributed: bool
    tapered: bool
    precision: str = "double"
    viscous: bool = False
    current: bool = False
    own_gaits: bool = False
    pieces: int = 1

    @property
    def rigid(self) -> bool:
        """Whether no link is passive."""
        return self.links == self.driven

    @property
    def lanes(self) -> int:
        """Number of fish side by side."""
        return LANES[self.precision]

    @property
    def degrees(self) -> Precision:
        """Degrees of the polynomials."""
        return DOUBLE if self.precision == "double" else SINGLE

    @property
    def link_fields(self) -> tuple[str, ...]:
        """Names of the constants of a link that are not 0 for all fish."""
        if self.pieces > 1:
            own = tuple(name for name in LINK_FIELDS if name not in PIECE_FIELDS or name == "length")
            return (*own, *(piece_field(name, place) for place in range(self.pieces) for name in PIECE_FIELDS))
        return tuple(name for name in LINK_FIELDS if self.tapered or name not in TAPER_FIELDS)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the constants of a link and its joint."""
        return (*self.link_fields, *HINGE_FIELDS, *((*BEAT_FIELDS, WINDOW_BEGIN) if self.own_gaits else ()))


def piece_field(name: str, place: int) -> str:
    """Return the name of a constant of one piece of a link."""
    return f"{name}@{place}"


class Slots(Protocol):
    """Where generated code keeps the lanes' numbers, those of the body and those of each link, by name."""

    tape: Tape

    def read(self, name: str, link: int | None = None) -> Number:
        """Return the number as it was before the piece of code at hand."""

    def write(self, name: str, value: Real, link: int | None = None) -> None:
        """Give the number a new value at the end of the piece of code at hand."""


def history(slots: Slots, name: str, count: int, link: int | None = None) -> list[Number]:
    """Return a number's last values, the latest first."""
    return [slots.read(f"{name}_{age}", link) for age in range(count)]


def _push(slots: Slots, name: str, value: Real, old: Sequence[Real], link: int | None = None) -> None:
    """Give a history a new latest value; the oldest one is forgotten."""
    for age, kept in enumerate((value, *old[:-1])):
        slots.write(f"{name}_{age}", kept, link)


def _sum(weights: Sequence[float], values: Sequence[Real]) -> Real:
    total: Real = 0.0
    for weight, value in zip(weights, values, strict=True):
        total = total + weight * value
    return total


@dataclass(frozen=True)
class Uniform:
    """What all fish share at one step: the body and the numbers of ``UNIFORM`` and ``WEIGHTS``."""

    form: Form
    body: LaneBody
    number: dict[str, Number]

    @classmethod
    def load(cls, form: Form, tape: Tape) -> Uniform:
        """Return them as the code at hand reads them."""
        number = {name: tape.load(name) for name in (*UNIFORM, *WEIGHTS)}
        absent = {"linear_drag": form.viscous, "current_x": form.current, "current_y": form.current}
        body = LaneBody(**{item.name: number[item.name] for item in fields(LaneBody) if absent.get(item.name, True)})
        return cls(form, body, number)

    @property
    def step(self) -> Number:
        """The time step, s."""
        return self.number["step"]


def link_at(form: Form, slots: Slots, link: int) -> LaneLink:
    """Return a link's constants."""
    varying: dict[str, Real] = {name: slots.read(name, link) for name in form.link_fields}
    if form.pieces > 1:
        pieces = tuple(
            LanePiece(**{name: varying.pop(piece_field(name, place)) for name in PIECE_FIELDS})
            for place in range(form.pieces)
        )
        return ProfiledLink(**dict.fromkeys(LINK_FIELDS, 0.0) | varying, pieces=pieces)
    straight: dict[str, Real] = {} if form.tapered else dict.fromkeys(TAPER_FIELDS, 0.0)
    return LaneLink(**varying, **straight)


def drive_at(form: Form, slots: Slots, joint: int) -> Drive:
    """Return a driven joint's motion."""
    if not form.own_gaits:
        return Drive(*(slots.tape.load(f"{name}_{joint}") for name in DRIVE_FIELDS))
    beat = Beat(*(slots.read(name, joint) for name in BEAT_FIELDS))
    return driven_by(beat, Fade(*map(slots.tape.load, FADE_FIELDS)), form.degrees)


def predicted_hinge(slots: Slots, joint: int, step: Real) -> tuple[Hinge, tuple[Real, Real]]:
    """Return a hinge at the end of the step, and what history gives to its new angle and rate."""
    angles, rates = (history(slots, name, len(HINGE_HISTORY), joint) for name in HINGE_STATES)
    stiffness, damping, compliance = (slots.read(name, joint) for name in HINGE_FIELDS)
    angle, rate = _sum(HINGE_HISTORY, angles), _sum(HINGE_HISTORY, rates)
    torque = -(stiffness * (angle + HINGE_REACH * step * rate) + damping * rate)
    return Hinge(_sum(EXTRAPOLATION, angles), _sum(EXTRAPOLATION, rates), torque, compliance), (angle, rate)


def move_hinge(
    slots: Slots, joint: int, step: Real, known: tuple[Real, Real], acceleration: Real, largest: Real
) -> Real:
    """Give a hinge its new angle and rate; return the largest angle so far, with the new one."""
    angle, rate = known
    new_rate = rate + HINGE_REACH * step * acceleration
    new_angle = angle + HINGE_REACH * step * new_rate
    largest = maximum(largest, absolute(new_angle))
    for name, value in zip(HINGE_STATES, (new_angle, new_rate), strict=True):
        _push(slots, name, value, history(slots, name, len(HINGE_HISTORY), joint), joint)
    return largest


def predicted_velocity(uniform: Uniform, slots: Slots) -> Motion:
    """Return surge, sway and yaw rate at the end of the step."""
    if not uniform.form.free:
        return uniform.number["held_surge"], uniform.number["held_sway"] if uniform.form.current else 0.0, 0.0
    predicted = [_sum(PREDICTOR, history(slots, f"{name}_rate", len(PREDICTOR))) for name in VELOCITIES]
    surge, sway, yaw = (
        slots.read(name) + uniform.step * slope for name, slope in zip(VELOCITIES, predicted, strict=True)
    )
    return surge, sway, yaw


def move_body(uniform: Uniform, slots: Slots, slopes: Motion) -> None:
    """Correct the body's velocity and move it, if it is free."""
    if not uniform.form.free:
        return
    step = uniform.step
    new = []
    for name, slope in zip(VELOCITIES, slopes, strict=True):
        old = history(slots, f"{name}_rate", len(CORRECTOR) - 1)
        new.append(slots.read(name) + step * _sum(CORRECTOR, (slope, *old)))
        slots.write(name, new[-1])
        _push(slots, f"{name}_rate", slope, old)
    surge, sway, yaw = new
    turned = slots.read("turned") + step * yaw
    slots.write("turned", turned)
    # Trapezoidal rule with its end correction, from rest: the sum counts the last rate in full.
    heading = turned - 0.5 * step * yaw - step * step * (1.0 / 12.0) * slopes[2]
    sine, cosine = sine_cosine(heading, uniform.form.degrees)
    weight = uniform.number["path_weight"]
    slots.write("x_sum", slots.read("x_sum") + weight * (surge * cosine - sway * sine))
    slots.write("y_sum", slots.read("y_sum") + weight * (surge * sine + sway * cosine))
    over_ground = surge + uniform.body.current_x * cosine + uniform.body.current_y * sine
    slots.write("surge_sum", slots.read("surge_sum") + _window_weight(uniform, slots) * over_ground)
    slots.write("heading", heading)


def sum_means(uniform: Uniform, slots: Slots, thrust: Real, power: Real) -> None:
    """Add thrust and power to their means over the window."""
    for name, value in (("thrust_sum", thrust), ("power_sum", power)):
        slots.write(name, slots.read(name) + _window_weight(uniform, slots) * value)


def _window_weight(uniform: Uniform, slots: Slots) -> Real:
    """Return a step's weight in the means over the window, which a fish with a gait of its own begins by itself.

    Samples before the beginning do not count, and those next to it as they do in the integral of the line through all
    of them (`window.line_weights`).
    """
    weight = uniform.number["window_weight"]
    if not uniform.form.own_gaits:
        return weight
    after = (slots.tape.load("fade_time") - slots.read(WINDOW_BEGIN, 0)) * (1.0 / uniform.step)
    before, behind = _between_0_and_1(after + 1.0), _between_0_and_1(after)
    return weight * (0.5 * before * before + behind - 0.5 * behind * behind)


def _between_0_and_1(value: Real) -> Real:
    return 1.0 - maximum(1.0 - maximum(value, 0.0), 0.0)


def table_names(form: Form) -> list[str]:
    """Return the names of a step's numbers that all fish share."""
    drives = (f"{name}_{joint}" for joint in range(form.driven) for name in DRIVE_FIELDS)
    return [*WEIGHTS, *(FADE_FIELDS if form.own_gaits else drives)]


def lane_loop(indent: int, lanes: int, body: Sequence[str]) -> list[str]:
    """Return the lines of a loop over the lanes."""
    return [" " * indent + f"for i in range({lanes}):", *(" " * (indent + 4) + line for line in body)]


@dataclass(frozen=True)
class Code:
    """The parts of a form's code.

    Attributes:
        size: Length of the array that holds the lanes' numbers, an expression in ``links``.
        gather: Lines that take a chunk's parameters into it.
        step: Lines that take one step.
        scatter: Lines that leave a chunk's results.
        parameters: Names of a fish's constants, each with its link.
        results: Names of what is left at the end.
        constants: Numbers by their names in the lines.
        operations: Floating-point operations of one step of one fish, by kind.
    """

    size: str
    gather: list[str]
    step: list[str]
    scatter: list[str]
    parameters: tuple[str, ...]
    results: tuple[str, ...]
    constants: dict[str, float]
    operations: Counter[str]
