"""The gait of a study, from the parameters ``gait.*``: a preset, or a value for each driven joint."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_plant.checks import counted
from fin_plant.gait import Gait, JointDrive, gait_preset

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_PRESET, _DRIVEN_JOINTS = "gait.preset", "gait.driven_joints"
_AMPLITUDE, _FREQUENCY, _LAG, _BIAS = "gait.amplitude", "gait.frequency", "gait.lag", "gait.bias"
_OF_EACH_JOINT = {
    "amplitude": ("gait.joints.amplitude", (_AMPLITUDE, _PRESET)),
    "frequency": ("gait.joints.frequency", (_FREQUENCY,)),
    "phase": ("gait.joints.phase", (_LAG,)),
    "bias": ("gait.joints.bias", (_BIAS,)),
}
"""Of each column of a gait the list with a value a joint, and what it takes the place of."""


def gait_from_parameters(values: Mapping[str, Any]) -> Gait:
    """Return the gait that parameters ask for; what they leave out has its default.

    Args:
        values: ``gait.*`` by full name, among others; those of an older study lack some.

    Raises:
        ValueError: Lists of different lengths, a preset for another number of joints, or a list beside the value whose
            place it takes.
    """
    given = {n: values.get(n, entry.default) for n, entry in OPTIMIZER_PARAMETERS.group("gait").items()}
    lists = {column: cast("Sequence[float]", given[name]) for column, (name, _) in _OF_EACH_JOINT.items()}
    joints = len(lists["amplitude"]) or _joints_of_preset(given)
    _refuse_other_lengths(given, joints)
    _refuse_doubles(given)
    if joints == 1 and _is_given(given, _LAG):
        msg = f"{_LAG} = {given[_LAG]:g} rad has no joint to count for: the gait has 1 driven joint, leave it out"
        raise ValueError(msg)
    if lists["amplitude"]:
        drives = tuple(
            JointDrive(amplitude, given[_FREQUENCY], -given[_LAG] * index)
            for index, amplitude in enumerate(lists["amplitude"])
        )
    else:
        drives = gait_preset(given[_PRESET], joints, given[_AMPLITUDE], given[_FREQUENCY], given[_LAG]).joints
    rows = [replace(drive, bias=given[_BIAS]) for drive in drives]
    for column in ("frequency", "phase", "bias"):
        rows = [
            replace(row, **{column: value})
            for row, value in zip(rows, lists[column] or _own(rows, column), strict=True)
        ]
    return Gait(tuple(rows))


def beat_of(gait: Gait) -> float:
    """Return the period in s of the gait's beat: of its slowest joint that beats."""
    beating = [joint.frequency for joint in gait.joints if joint.amplitude > 0.0] or [gait.joints[0].frequency]
    return 1.0 / min(beating)


def describe_gait(gait: Gait) -> str:
    """Return a gait in words, as pictures have it: frequency, amplitudes, phases and biases from head to tail."""

    def listed(column: str, factor: float = 1.0) -> str:
        numbers = [f"{factor * getattr(joint, column):.4g}" for joint in gait.joints]
        return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)

    degrees = 180.0 / math.pi
    parts = [f"{listed('frequency')} Hz", f"{listed('amplitude', degrees)}° either way"]
    if len(gait.joints) > 1:
        parts.append(f"phases {listed('phase')} rad")
    if any(joint.bias for joint in gait.joints):
        parts.append(f"bias {listed('bias', degrees)}°")
    return ", ".join(parts)


def _own(rows: Sequence[JointDrive], column: str) -> list[float]:
    return [getattr(row, column) for row in rows]


def _joints_of_preset(given: Mapping[str, Any]) -> int:
    return given[_DRIVEN_JOINTS] or {"carangiform": 1, "sub_carangiform": 2}[given[_PRESET]]


def _is_given(given: Mapping[str, Any], name: str) -> bool:
    return bool(given[name] != OPTIMIZER_PARAMETERS[name].default)


def _refuse_other_lengths(given: Mapping[str, Any], joints: int) -> None:
    lengths = {name: len(given[name]) for name, _ in _OF_EACH_JOINT.values() if given[name]}
    lengths |= {_DRIVEN_JOINTS: given[_DRIVEN_JOINTS]} if given[_DRIVEN_JOINTS] else {}
    if set(lengths.values()) - {joints}:
        said = ", ".join(f"{name} {length}" for name, length in lengths.items())
        msg = (
            f"the gait has {counted(joints, 'driven joint')}, but not every list has as many values "
            f"({said}): give one a driven joint, from the head to the tail, or leave the list out"
        )
        raise ValueError(msg)


def _refuse_doubles(given: Mapping[str, Any]) -> None:
    for name, replaced in _OF_EACH_JOINT.values():
        for other in replaced:
            if given[name] and _is_given(given, other):
                msg = f"{other} = {given[other]} has no meaning beside {name}, which takes its place: leave one out"
                raise ValueError(msg)
