"""Case files: one swim with every parameter written out, as JSON, so that another solver can repeat it.

The file holds an object ``case``: the attributes of `Water`, its density as ``rho`` and its model as ``water``, of
which all but ``rho`` and ``normal_drag`` may be left out; ``body``, ``links`` and, where the servos are not ideal,
``servo`` with the attributes of `Body`, `Link` and `Motor`; ``joints`` (each ``{"drive": {amplitude, frequency, phase,
bias}}`` or ``{"passive": true}``), ``ramp`` and ``duration`` in s, ``clamp`` (``free``, ``fixed`` or ``{"tow": m/s}``)
and ``reactive``. SI units, radians.
"""

from __future__ import annotations

import csv
from dataclasses import MISSING, dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fin_plant import checks, json_file, text_file
from fin_plant.gait import Gait, JointDrive
from fin_sim.chain import Chain
from fin_sim.fish import Body, Link, Water
from fin_sim.motor import Motor
from fin_sim.swim import LONGEST, SHORTEST, swim_chain

if TYPE_CHECKING:
    from pathlib import Path

    from fin_sim.swim_result import Swim

ValueT = TypeVar("ValueT", Body, Link, JointDrive, Motor)

_REQUIRED = {"rho", "normal_drag", "body", "links", "joints", "ramp", "duration", "clamp", "reactive"}
_WATER_KEYS = {"density": "rho", "model": "water"}
_OF_A_BODY_WITH_AXES = {"added_mass", "gap"}  # a case knows no axes
_WATER = {
    _WATER_KEYS.get(item.name, item.name): item.name for item in fields(Water) if item.name not in _OF_A_BODY_WITH_AXES
}
"""The water's attributes by the keys of a case."""
_WORDS = {"model", "wake", "drag", "tip_term"}
_KEYS = {*_REQUIRED, *_WATER, "servo"}
_MEANS_OVER = 2
# Intervals of a trajectory file; a held fish is sampled finer, since its forces are what is asked of it.
_FREE_ROWS, _HELD_ROWS = 200, 800
SAMPLES_A_ROW = 5
"""A case is sampled this much more densely than it is written, for its means over beats."""


@dataclass(frozen=True)
class Case:
    """A swim with every parameter.

    Attributes:
        chain: Body, tail and water.
        gait: One row for each driven joint.
        ramp_time: s.
        duration: s.
    """

    chain: Chain
    gait: Gait
    ramp_time: float
    duration: float

    def swim(self, *, step: float = 1e-3) -> Swim:
        """Swim the case, sampled `SAMPLES_A_ROW` times as densely as a trajectory file.

        Raises:
            ValueError: A duration or ramp outside its range.
            StepError: The state stopped being finite.
        """
        rows = _FREE_ROWS if self.chain.clamp == "free" else _HELD_ROWS
        return swim_chain(
            self.chain,
            self.gait,
            self.duration,
            ramp_time=self.ramp_time,
            step=step,
            sample_time=self.duration / (SAMPLES_A_ROW * rows),
        )


def _object(where: str, value: object, allowed: set[str], required: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict):
        msg = f"{where} must be an object with the keys {', '.join(sorted(required))}, got {value!r}"
        raise ValueError(msg)
    missing, unknown = required - value.keys(), value.keys() - allowed
    if missing or unknown:
        problem = f"lacks {', '.join(sorted(missing))}" if missing else f"has unknown {', '.join(sorted(unknown))}"
        msg = f"{where} {problem}: its keys are {', '.join(sorted(allowed))}"
        raise ValueError(msg)
    return value


def _build(kind: type[ValueT], where: str, value: object) -> ValueT:
    names = {item.name for item in fields(kind)}
    required = {item.name for item in fields(kind) if item.default is MISSING}
    try:
        return kind(**_object(where, value, names, required))
    except ValueError as error:
        message = str(error)
        msg = message if message.startswith(where) else f"{where}: {message}"
        raise ValueError(msg) from None


def _array(where: str, value: object) -> list[object]:
    if not isinstance(value, list):
        msg = f"{where} must be a list, got {value!r}"
        raise ValueError(msg)
    return value


def _link(where: str, value: object) -> Link:
    """Return a link; the lists of its profile become tuples."""
    if not isinstance(value, dict) or "profile" not in value:
        return _build(Link, where, value)
    profile = []
    for number, point in enumerate(_array(f"{where} profile", value["profile"]), start=1):
        if not isinstance(point, list) or len(point) != 2:  # noqa: PLR2004
            msg = f"{where} profile point {number} must be a distance and a height in m, got {point!r}"
            raise ValueError(msg)
        names = ("distance", "height")
        profile.append(
            tuple(checks.number(f"{where} profile {n}", item, unit="m") for n, item in zip(names, point, strict=True))
        )
    return _build(Link, where, {**value, "profile": tuple(profile)})


def _water(case: dict[str, Any]) -> Water:
    """Return the water; a refusal names the key of the case."""
    values: dict[str, Any] = {
        name: case[key] if name in _WORDS else checks.number(f"case {key}", case[key])
        for key, name in _WATER.items()
        if key in case
    }
    try:
        return Water(**values)
    except ValueError as error:
        message = str(error)
        for key, name in _WATER.items():
            message = message.replace(f"water.{name} ", f"case {key} ")
        raise ValueError(message) from None


def parse_case(content: object) -> Case:
    """Return the case of a parsed JSON file, or of its ``case`` object alone.

    Raises:
        ValueError: A key that is missing or unknown, or a value that is refused.
    """
    case = content["case"] if isinstance(content, dict) and "case" in content else content
    case = _object("case", case, _KEYS, _REQUIRED)
    links = tuple(_link(f"link {i}", item) for i, item in enumerate(_array("case links", case["links"]), 1))
    driven, drives = [], []
    for number, item in enumerate(_array("case joints", case["joints"]), start=1):
        where = f"joint {number}"
        joint = _object(where, item, {"drive", "passive"}, set())
        if ("drive" in joint) == (joint.get("passive") is True):
            msg = f'{where} must be {{"drive": ...}} or {{"passive": true}}, got {item!r}'
            raise ValueError(msg)
        driven.append("drive" in joint)
        if driven[-1]:
            drives.append(_build(JointDrive, where, joint["drive"]))
    clamp, tow_speed = case["clamp"], 0.0
    if isinstance(clamp, dict):
        clamp, tow_speed = "towed", _object("case clamp", clamp, {"tow"}, {"tow"})["tow"]
    elif clamp == "towed":
        msg = 'case clamp = "towed" does not say how fast: write {"tow": speed in m/s}'
        raise ValueError(msg)
    chain = Chain(
        body=_build(Body, "case body", case["body"]),
        links=links,
        driven=tuple(driven),
        water=_water(case),
        reactive=case["reactive"],
        clamp=clamp,
        tow_speed=checks.number("case clamp tow", tow_speed, unit="m/s"),
        motor=_build(Motor, "case servo", case["servo"]) if "servo" in case else None,
    )
    return Case(
        chain=chain,
        gait=Gait(tuple(drives)),
        ramp_time=checks.number("case ramp", case["ramp"], 0.0, unit="s"),
        duration=checks.number("case duration", case["duration"], SHORTEST, LONGEST, unit="s"),
    )


def read_case(path: Path) -> Case:
    """Read a case file.

    Raises:
        ValueError: The file cannot be read, is not JSON, or its case is refused; the message names the file.
    """
    with text_file.named(path):
        return parse_case(json_file.read(path))


def summary(swim: Swim, *, every: int | None = None) -> dict[str, float]:
    """Return the figures that are compared between solvers.

    ``mean_speed`` m/s and ``final_psi`` rad; for a held or towed body ``mean_thrust_last_two_periods``, the mean
    convective and resistive force on the tail along x in N, and ``mean_power_last_two_periods`` of the servos in W.

    Args:
        swim: The swim.
        every: Samples from one row of a case's trajectory file to the next: the two means then run as in the reference
            cases, by trapezoids over those rows that lie in the last two periods, up to a row less than two periods.
            Without it they run over the two periods exactly.

    Raises:
        ValueError: A held or towed swim shorter than two periods.
    """
    figures = {"mean_speed": swim.mean_speed, "final_psi": float(swim.heading[-1])}
    if swim.chain.clamp != "free":
        if swim.frequency == 0.0 or swim.duration * swim.frequency < _MEANS_OVER * (1.0 - 1e-9):
            msg = (
                f"duration = {swim.duration:g} s holds less than {_MEANS_OVER} tail beats at {swim.frequency:g} Hz: "
                "let it beat for longer"
            )
            raise ValueError(msg)
        begin = swim.duration - _MEANS_OVER / swim.frequency
        for name, values in (("thrust", swim.convective_force[:, 0]), ("power", swim.servo_power)):
            if every is None:
                mean = swim.mean_between(values, max(begin, 0.0), swim.duration)
            else:
                time = swim.time[::every]
                chosen = time >= begin - 1e-9
                mean = float(np.trapezoid(values[::every][chosen], time[chosen]) / np.ptp(time[chosen]))
            figures[f"mean_{name}_last_two_periods"] = mean
    return figures


def write_trajectory(swim: Swim, path: Path, *, every: int = SAMPLES_A_ROW, units: bool = False) -> None:
    """Write t, x, y, psi, theta_k, servo power, and the tail's convective and resistive force in tank axes as CSV.

    The header has no units where the file is to be one of a case, whose columns are named so.

    Args:
        swim: The swim.
        path: The file; it must not exist.
        every: Samples from one row to the next.
        units: Whether the header tells the units, like ``t [s]``.

    Raises:
        FileExistsError: The file exists.
        OSError: The file cannot be written.
    """
    angles = {f"theta{index}": "rad" for index in range(len(swim.chain.links))}
    forces = {"power": "W", "tip_force_x": "N", "tip_force_y": "N"}
    columns = {"t": "s", "x": "m", "y": "m", "psi": "rad", **angles, **forces}
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"{name} [{unit}]" if units else name for name, unit in columns.items()])
        for row in range(0, len(swim.time), every):
            numbers = (
                swim.time[row],
                swim.x[row],
                swim.y[row],
                swim.heading[row],
                *swim.joint_angles[row],
                swim.servo_power[row],
                *swim.convective_force[row],
            )
            writer.writerow([f"{number:.9e}" for number in numbers])
