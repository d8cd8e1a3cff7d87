"""The gait: a sinusoid for each driven joint, its presets, and the limits of what joints can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

COLUMNS = ("amplitude", "frequency", "phase", "bias")
MAXIMUM_JOINTS = 20
# Amplitude and bias are angles of a hinge: a larger number is a mistake of unit.
_LARGEST_ANGLE = math.pi
# A phase is a position on the circle, and who adds up its oscillator's phase sends many turns; beyond this a double
# no longer tells one position from the next.
_LARGEST_PHASE = 1e9
_LARGEST_FREQUENCY = 100.0
DRIVE_RANGES = {
    "amplitude": (0.0, _LARGEST_ANGLE, "rad"),
    "frequency": (0.0, _LARGEST_FREQUENCY, "Hz"),
    "phase": (-_LARGEST_PHASE, _LARGEST_PHASE, "rad"),
    "bias": (-_LARGEST_ANGLE, _LARGEST_ANGLE, "rad"),
}
"""Least and largest value of each column of a gait, and its unit."""
_SAME_PHASE = 1e-6
"""rad by which the phases of one gait may differ: less than any servo resolves, more than rounding at 1e9 rad."""


@dataclass(frozen=True)
class JointDrive:
    """Drive of one joint: angle = bias + amplitude sin(2 pi frequency t + phase).

    Attributes:
        amplitude: rad, 0 to pi.
        frequency: Hz, 0 to 100.
        phase: rad; kept as the same position on the circle in (-pi, pi].
        bias: rad, -pi to pi.

    Raises:
        ValueError: A value that is not finite or outside its range.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high, unit) in DRIVE_RANGES.items():
            value = checks.number(f"gait {name}", getattr(self, name), low, high, unit=unit)
            object.__setattr__(self, name, value)
        turned = math.remainder(self.phase, 2.0 * math.pi)
        object.__setattr__(self, "phase", math.pi if turned == -math.pi else turned)

    def limited(self, sweep: float, highest_frequency: float, rate: float = math.inf) -> JointDrive:
        """Return the drive with |bias| + amplitude at most ``sweep`` rad; the bias is kept before the amplitude.

        Where the rate in rad/s is the limit the amplitude gives way, so that the beat keeps its frequency.
        """
        bias = min(max(self.bias, -sweep), sweep)
        inside = replace(
            self,
            amplitude=min(self.amplitude, sweep - abs(bias)),
            frequency=min(self.frequency, highest_frequency),
            bias=bias,
        )
        peak_rate = 2.0 * math.pi * inside.frequency
        return replace(inside, amplitude=rate / peak_rate) if inside.amplitude * peak_rate > rate else inside

    @property
    def moves(self) -> bool:
        """Whether the joint is driven away from neutral."""
        return self.bias != 0.0 or self.amplitude > 0.0


@dataclass(frozen=True)
class JointLimits:
    """What one driven joint can do.

    Attributes:
        sweep: Largest angle to either side, rad.
        rate: Largest rate, rad/s; infinite where there is none.
    """

    sweep: float
    rate: float = math.inf


@dataclass(frozen=True)
class Gait:
    """Drives of the tail's driven joints, from the head to the tail.

    Raises:
        ValueError: No joint, or more than a chain can have.
    """

    joints: tuple[JointDrive, ...]

    def __post_init__(self) -> None:
        checks.whole_number("number of driven joints", len(self.joints), 1, MAXIMUM_JOINTS)

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> Gait:
        """Build a gait from an array (joints, 4) with the columns amplitude, frequency, phase, bias.

        Raises:
            ValueError: Another shape, or a value that is refused; the message names joint and column.
        """
        table = np.asarray(rows, dtype=float)
        if table.ndim != 2 or table.shape[1] != len(COLUMNS):  # noqa: PLR2004
            msg = f"gait has shape {table.shape}: needed is one row a driven joint, columns {', '.join(COLUMNS)}"
            raise ValueError(msg)
        joints = []
        for index, row in enumerate(table, start=1):
            try:
                joints.append(JointDrive(*map(float, row)))
            except ValueError as error:
                msg = f"joint {index}: {error}"
                raise ValueError(msg) from None
        return cls(tuple(joints))

    def rows(self) -> NDArray[np.float64]:
        """Return the gait as an array (joints, 4) with the columns of ``COLUMNS``."""
        return np.array([[getattr(joint, name) for name in COLUMNS] for joint in self.joints])

    def same_as(self, other: Gait, rounding: float = 0.0) -> bool:
        """Return whether the tail moves alike: equal numbers, phases up to whole turns and rounding.

        Args:
            other: Another gait.
            rounding: Relative difference up to which two amplitudes, frequencies or biases count as equal.
        """
        return len(self.joints) == len(other.joints) and same_rows(self.rows(), other.rows(), rounding)

    def limited(self, sweep: float, highest_frequency: float, limits: Sequence[JointLimits] = ()) -> Gait:
        """Return the gait with every joint inside the limits.

        Args:
            sweep: Largest angle of any joint, rad.
            highest_frequency: Hz.
            limits: Of each joint, from the head to the tail; empty where the others are all there are.

        Raises:
            ValueError: Another number of limits than of joints.
        """
        each = limits or [JointLimits(sweep)] * len(self.joints)
        require_rows(self, len(each))
        return Gait(
            tuple(
                joint.limited(min(sweep, own.sweep), highest_frequency, own.rate)
                for joint, own in zip(self.joints, each, strict=True)
            )
        )

    @property
    def at_rest(self) -> Gait:
        """The gait of the same tail led to its middle; frequencies and phases stay."""
        return Gait(tuple(replace(joint, amplitude=0.0, bias=0.0) for joint in self.joints))

    @property
    def moves(self) -> bool:
        """Whether any joint is driven away from neutral."""
        return any(joint.moves for joint in self.joints)


def require_rows(gait: Gait, joints: int) -> None:
    """Refuse a gait with another number of rows than the tail has joints.

    Raises:
        ValueError: It has.
    """
    if len(gait.joints) != joints:
        tail = checks.counted(joints, "driven joint")
        msg = f"gait has {len(gait.joints)} rows, the tail has {tail}: send one row a joint"
        raise ValueError(msg)


def same_rows(one: NDArray[np.float64], other: NDArray[np.float64], rounding: float = 0.0) -> bool:
    """Return whether two gaits of as many joints, as rows (joints, 4), are one; ``rounding`` as in `Gait.same_as`."""
    phase = COLUMNS.index("phase")
    turned = np.remainder(one[:, phase] - other[:, phase] + math.pi, 2.0 * math.pi) - math.pi
    others = np.arange(len(COLUMNS)) != phase
    differences = np.abs(one - other)[:, others]
    equal = np.all(differences <= rounding * np.abs(other)[:, others])
    return bool(np.all(np.abs(turned) <= _SAME_PHASE) and equal)


def carangiform(amplitude: float, frequency: float) -> Gait:
    """Return the paper's gait: one driven joint, amplitude in rad and frequency in Hz."""
    return Gait((JointDrive(amplitude, frequency),))


# Amplitude relative to the tail joint's, and phase behind the joint in front, rad: the reference swims with two
# driven joints use 8 and 14 degrees, 0.9 rad apart. Three joints rise evenly to the same end.
_SUB_CARANGIFORM_AMPLITUDES = {2: (0.57, 1.0), 3: (0.3, 0.65, 1.0)}
_SUB_CARANGIFORM_LAG = 0.9


def sub_carangiform(amplitude: float, frequency: float, joints: int = 2, lag: float = _SUB_CARANGIFORM_LAG) -> Gait:
    """Return the gait of a tail with a peduncle: amplitude rises and phase lags from joint to joint towards the tail.

    Args:
        amplitude: Of the last joint, the fin's, in rad.
        frequency: Hz.
        joints: Driven joints, 2 or 3.
        lag: Phase of a joint behind the one in front of it, rad.

    Raises:
        ValueError: Another number of joints, or a drive that is refused.
    """
    checks.whole_number("driven joints of a sub-carangiform gait", joints, 2, 3)
    rising = _SUB_CARANGIFORM_AMPLITUDES[joints]
    return Gait(tuple(JointDrive(part * amplitude, frequency, phase=-lag * index) for index, part in enumerate(rising)))


def gait_preset(name: str, joints: int, amplitude: float, frequency: float, lag: float = _SUB_CARANGIFORM_LAG) -> Gait:
    """Return the named gait, ``carangiform`` or ``sub_carangiform``, for a tail with so many driven joints.

    Args:
        name: Of the gait.
        joints: Driven joints.
        amplitude: Of the last joint, rad.
        frequency: Hz.
        lag: Phase of a joint behind the one in front of it, rad.

    Raises:
        ValueError: An unknown name, or a gait that does not fit that tail.
    """
    checks.choice("gait", name, ("carangiform", "sub_carangiform"))
    if name == "sub_carangiform":
        return sub_carangiform(amplitude, frequency, joints, lag)
    if joints != 1:
        msg = f"a carangiform tail has 1 driven joint, this one has {joints}: choose the gait sub_carangiform"
        raise ValueError(msg)
    return carangiform(amplitude, frequency)


PAPER_GAIT = carangiform(math.radians(15.0), 0.9)
"""Drive of the paper fin: 15 degrees either way (both papers) at 0.9 Hz (Clark et al. 2012)."""
