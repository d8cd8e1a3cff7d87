"""A recorded swim: forward and sideways velocity, yaw rate, heading and, where tracked, position over true time.

Files are CSV with a header, named ``amplitude<degrees>_bias<degrees>_<anything>.csv``; SI units, angles in radians.
What comes in other units or with another clock is told by what cannot be, and named.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks, text_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_plant.parameters import Value

    Array = NDArray[np.float64]

COLUMNS = ("t", "v_forward", "v_lateral", "yaw_rate", "heading")
POSITION = ("x", "y")
LOST_SPEED = -0.02
"""Forward speed in m/s below which the camera had lost the fish, which never swims backwards."""
SHORTEST = 4.5
"""s: one second to find the start from, three to predict, and what a beat leaves over."""
FEWEST_SWIMS = 3
"""Of which a fish can be learnt."""
LAST = 2.0
"""s at a swim's end over which its speed is judged."""
LONGEST_GAP = 0.4
"""Of a beat, without a sample."""
_NAME = re.compile(r"amplitude(\d+(?:\.\d+)?)_bias([+-]?\d+(?:\.\d+)?)(?:_.*)?\.csv\Z")
_FASTEST = 5.0  # m/s; no tail-fin fish of a tank swims as fast
_WIDEST_YAW = 1.2  # rad, amplitude of a fish's own yaw
_UNIT_RATIO = 15.0  # between quantities that ought to agree: above it the units differ
_CLOCK_RATIO = 1.5
_FREQUENCIES = (0.3, 4.0)  # Hz, looked through
_FREQUENCY_TOLERANCE = 0.2


class SwimError(ValueError):
    """A recorded swim that cannot be used; the message says which, why, and what to do."""


@dataclass(frozen=True)
class Swim:
    """One recorded swim.

    Attributes:
        name: As people know it.
        amplitude: Commanded, rad.
        bias: Commanded, rad, positive to the right as every joint's angle.
        frequency: Tail beats, Hz: as commanded, or found in the record.
        time: s since the first sample, shape (S,), rising.
        forward: m/s, (S,), body axes, as tracked.
        lateral: m/s, (S,), to the left.
        yaw_rate: rad/s, (S,).
        heading: rad, (S,), without jumps.
        position: m, (S, 2), in the tank; None where it was not tracked.
        fin: Parameters ``fin.*`` of the fin that it was swum with, where that is told.
        frequency_commanded: Whether the frequency is the commanded one.
    """

    name: str
    amplitude: float
    bias: float
    frequency: float
    time: Array
    forward: Array
    lateral: Array
    yaw_rate: Array
    heading: Array
    position: Array | None = None
    fin: Mapping[str, Value] = field(default_factory=dict)
    frequency_commanded: bool = False

    @property
    def condition(self) -> tuple[float | str, ...]:
        """What was commanded, and the fin: the same for swims that are repeats of each other."""
        beat = self.frequency if self.frequency_commanded else 0.0
        return (round(self.amplitude, 6), round(self.bias, 6), round(beat, 6), repr(sorted(self.fin.items())))

    @property
    def turns(self) -> bool:
        """Whether it was asked to turn."""
        return self.bias != 0.0


def beat_frequency(time: Array, yaw_rate: Array) -> float:
    """Return the tail-beat frequency in Hz: of the harmonic that, beside a parabola, fits the yaw rate best.

    Args:
        time: s, shape (S,), at any intervals.
        yaw_rate: rad/s, shape (S,).
    """
    span, middle = float(np.ptp(time)), float(np.mean(time))
    slow = np.vander((time - middle) / span, 3)
    left = yaw_rate - slow @ np.linalg.lstsq(slow, yaw_rate, rcond=None)[0]

    def unexplained(frequency: float) -> float:
        angle = 2.0 * math.pi * frequency * (time - middle)
        terms = np.column_stack((slow, np.cos(angle), np.sin(angle)))
        return float(np.sum((left - terms @ np.linalg.lstsq(terms, left, rcond=None)[0]) ** 2))

    highest = min(_FREQUENCIES[1], 0.45 / float(np.median(np.diff(time))))
    spacing = 0.15 / span
    grid = np.arange(_FREQUENCIES[0], max(highest, 2.0 * _FREQUENCIES[0]), spacing)
    best = float(grid[int(np.argmin([unexplained(each) for each in grid]))])
    for _ in range(3):
        spacing /= 5.0
        near = best + spacing * np.arange(-5, 6)
        best = float(near[int(np.argmin([unexplained(each) for each in near]))])
    return best


def _ratio(one: Array, other: Array) -> float:
    """Return the root mean square of one over that of the other, 1 where neither tells anything."""
    sizes = [float(np.sqrt(np.mean(np.square(each)))) for each in (one, other)]
    return sizes[0] / sizes[1] if min(sizes) > 0.0 else 1.0


def _refuse(name: str, text: str) -> None:
    msg = f"{name}: {text}"
    raise SwimError(msg)


def _check_order(name: str, time: Array) -> None:
    if len(time) < 2:  # noqa: PLR2004
        _refuse(name, "it has one row: record a whole swim")
    if not np.all(np.diff(time) > 0.0):
        at = int(np.argmin(np.diff(time) > 0.0)) + 1
        _refuse(name, f"t must rise from row to row, it does not at row {at + 1}: sort the rows, drop those told twice")
    interval = float(np.median(np.diff(time)))
    if interval > 1.0:
        _refuse(name, f"a sample comes every {interval:g} s: t must be in s; in milliseconds it would read like this")


def _check_units(swim: Swim) -> None:
    name, turning = swim.name, np.gradient(swim.heading, swim.time)
    ratio = _ratio(swim.yaw_rate, turning)
    if ratio > _UNIT_RATIO:
        _refuse(name, f"yaw_rate is {ratio:.0f} times the heading's own rate: it is in degrees/s, needed is rad/s")
    if ratio < 1.0 / _UNIT_RATIO:
        _refuse(name, f"heading changes {1.0 / ratio:.0f} times as fast as yaw_rate says: it is in degrees, not rad")
    yaw = float(np.std(swim.yaw_rate)) * math.sqrt(2.0) / (2.0 * math.pi * swim.frequency)
    if yaw > _WIDEST_YAW:
        _refuse(name, f"the fish yaws by {yaw:.3g} rad either way, above {_WIDEST_YAW:g}: are angles in degrees?")
    fastest = float(np.percentile(np.abs(swim.forward), 90))
    if fastest > _FASTEST:
        _refuse(name, f"v_forward reaches {fastest:.3g} m/s, above {_FASTEST:g}: are lengths in millimetres?")
    if swim.position is not None:
        _check_path(swim, swim.position)


def _check_path(swim: Swim, position: Array) -> None:
    """Refuse positions that contradict the velocities: other units or another clock."""
    step = max(1, round(1.0 / swim.frequency / float(np.median(np.diff(swim.time)))))
    moved = position[step:] - position[:-step]
    tank = np.array([swim.forward, swim.lateral])
    cosine, sine = np.cos(swim.heading), np.sin(swim.heading)
    velocity = np.stack((tank[0] * cosine - tank[1] * sine, tank[0] * sine + tank[1] * cosine), axis=1)
    between = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(swim.time)[:, None]
    told = np.concatenate((np.zeros((1, 2)), np.cumsum(between, axis=0)))
    ratio = _ratio(moved, told[step:] - told[:-step])
    if ratio > _UNIT_RATIO:
        _refuse(swim.name, f"x and y move {ratio:.0f} times as far as the velocities say: are they in millimetres?")
    if ratio < 1.0 / _UNIT_RATIO:
        _refuse(swim.name, f"x and y move {ratio:.2g} times as far as the velocities say: are these in mm/s?")
    if not 1.0 / _CLOCK_RATIO < ratio < _CLOCK_RATIO:
        text = f"x and y move {ratio:.2f} times as far as the velocities say: t is not the time that these are per"
        _refuse(swim.name, f"{text}; use one clock, that of the pictures, for both")


def check_swim(swim: Swim, stated_frequency: float) -> None:
    """Refuse a swim whose units, clock or gaps make it worthless.

    Args:
        swim: The swim.
        stated_frequency: Tail beats that are expected, Hz; 0 where it is not told. A swim that tells its commanded
            beat itself is held to that.

    Raises:
        SwimError: It cannot be used.
    """
    stated = 0.0 if swim.frequency_commanded else stated_frequency
    ratio = swim.frequency / stated if stated else 1.0
    if abs(ratio - 1.0) > _FREQUENCY_TOLERANCE:
        _refuse(
            swim.name,
            f"by its t the tail beats at {swim.frequency:.2f} Hz, expected are {stated:.3g} Hz: the time base is wrong "
            f"by a factor of {ratio:.2f} (a camera's nominal rate in place of its clock?), or the expected beat is",
        )
    if swim.time[-1] < SHORTEST:
        _refuse(
            swim.name, f"it lasts {swim.time[-1]:.2f} s, needed are {SHORTEST:g} s of true time: record longer swims"
        )
    gaps = np.diff(swim.time)
    widest = int(np.argmax(gaps))
    if gaps[widest] * (stated or swim.frequency) > LONGEST_GAP:
        _refuse(
            swim.name,
            f"no sample for {gaps[widest]:.2f} s after t = {swim.time[widest]:.2f} s, more than {LONGEST_GAP:g} of a "
            "beat: keep the longer piece only, and give the other as a swim of its own",
        )
    _check_units(swim)


def _read_columns(path: Path) -> dict[str, Array]:
    with text_file.named(path):
        text = text_file.read(path)
    file = str(path)
    if not text.strip():
        _refuse(file, f"it is empty: needed are the columns {', '.join(COLUMNS)}")
    reader = csv.DictReader(io.StringIO(text, newline=""))
    header = [name.strip() for name in reader.fieldnames or ()]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        has = ", ".join(header)
        _refuse(file, f"it has no column {', '.join(missing)}: needed are {', '.join(COLUMNS)}; it has {has}")
    if len(set(POSITION) & set(header)) == 1:
        _refuse(file, "it has one of the columns x and y only: give both or neither")
    reader.fieldnames = header
    wanted = [name for name in (*COLUMNS, *POSITION) if name in header]
    rows = [[_number(path, row, index, name) for name in wanted] for index, row in enumerate(reader, start=2)]
    if not rows:
        _refuse(file, "it has no rows")
    return dict(zip(wanted, np.array(rows).T, strict=True))


def _number(path: Path, row: Mapping[str, str | None], line: int, name: str) -> float:
    text = row.get(name) or ""
    try:
        return checks.number(name, checks.read_number(text.strip()))
    except ValueError:
        msg = f"{path}: line {line}: {name} = {text!r} is no finite number: leave out rows that were not measured"
        raise SwimError(msg) from None


def swim_of(
    name: str,
    amplitude: float,
    bias: float,
    columns: Mapping[str, Array],
    frequency: float = 0.0,
    fin: Mapping[str, Value] | None = None,
) -> Swim:
    """Return a swim of columns; its frequency in Hz is found in the yaw rate where it is not given.

    Args:
        name: Of the swim.
        amplitude: rad.
        bias: rad.
        columns: Those of ``COLUMNS`` and perhaps of ``POSITION``, each of shape (S,).
        frequency: Hz.
        fin: Parameters ``fin.*`` of its fin, where that is told.

    Raises:
        SwimError: Times that do not rise, or none in s.
    """
    time = columns["t"] - columns["t"][0]
    _check_order(name, time)
    heading = columns["heading"]
    if np.max(np.abs(np.diff(heading))) < 6.4:  # noqa: PLR2004  (of radians; degrees are told below)
        heading = np.unwrap(heading)
    return Swim(
        name=name,
        amplitude=amplitude,
        bias=bias,
        frequency=frequency or beat_frequency(time, columns["yaw_rate"]),
        time=time,
        forward=columns["v_forward"],
        lateral=columns["v_lateral"],
        yaw_rate=columns["yaw_rate"],
        heading=heading,
        position=np.stack([columns[each] for each in POSITION], axis=1) if "x" in columns else None,
        fin=fin or {},
        frequency_commanded=bool(frequency),
    )


def read_csv(path: Path) -> Swim:
    """Return the swim of a CSV file.

    Raises:
        ValueError: It cannot be read, or not be used (`SwimError`); the message names the file.
    """
    named = _NAME.match(path.name)
    if named is None:
        _refuse(str(path), "a swim's file is named amplitude<degrees>_bias<degrees>_<run>.csv: rename it")
        raise AssertionError
    amplitude, bias = (math.radians(float(each)) for each in named.groups())
    return swim_of(path.name.removesuffix(".csv"), amplitude, bias, _read_columns(path))


def _check_sides(swims: Sequence[Swim]) -> None:
    """Refuse swims that as a whole turn against their biases: signs of another convention."""
    turned = [(swim, swim.bias * float(swim.heading[-1] - swim.heading[0])) for swim in swims if swim.turns]
    if sum(each for _, each in turned) > 0.5 * sum(abs(each) for _, each in turned):
        most = max(turned, key=lambda each: each[1])[0]
        to, side = ("left", "above") if most.bias > 0.0 else ("right", "below")
        text = f"the fish turns to the {to} under a bias {side} 0, and most other swims do the like"
        _refuse(
            most.name, f"{text}: a bias above 0 is the tail to the right, headings are positive to the left; mend signs"
        )


def _check_beats(swims: Sequence[Swim]) -> None:
    """Refuse a swim whose beat, found in its record, is another one than that of the others of its bias."""
    found: dict[float, list[float]] = {}
    for swim in swims:
        if not swim.frequency_commanded:
            found.setdefault(swim.bias, []).append(swim.frequency)
    for swim in swims:
        usual = swim.frequency if swim.frequency_commanded else float(np.median(found[swim.bias]))
        if abs(swim.frequency / usual - 1.0) > _FREQUENCY_TOLERANCE:
            text = f"by its t the tail beats at {swim.frequency:.2f} Hz, in the swims of its bias at {usual:.2f} Hz"
            _refuse(swim.name, f"{text} (median): swims of several beats, or with wrong clocks, are no one calibration")


def usable(swims: Sequence[Swim], stated_frequency: float) -> tuple[list[Swim], list[str]]:
    """Return the swims that can be used, and a sentence on each that lost the fish; refuse wrong units and clocks.

    Raises:
        SwimError: A swim is in wrong units, of other signs, in another time base or of another beat, or has a gap.
    """
    kept, notes = [], []
    for swim in swims:
        check_swim(swim, stated_frequency)
    _check_sides(swims)
    _check_beats(swims)
    for swim in swims:
        if float(np.min(swim.forward)) < LOST_SPEED:
            lost = f"{-np.min(swim.forward):.3f} m/s backwards"
            notes.append(f"{swim.name} is left out: at {lost} the camera has lost the fish")
        else:
            kept.append(swim)
    return kept, notes
