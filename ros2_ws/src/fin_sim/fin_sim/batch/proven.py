"""Which fins need no second swim at a shorter step.

Two kinds, each with the gait, the fish and the fins for which swims at the first step were compared with swims at much
shorter ones; `tests/unit/test_batch_errors.py` does so again. The limits are numbers here, whatever a file of
parameters says: they are of the proof. Nearly all of an error comes from the hinges.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fin_sim.batch.columns import PROFILE
from fin_sim.batch.links import least_damping_times, stiffness_per_height
from fin_sim.fish import Body, Fish, Water

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.gait import Gait
    from fin_sim.batch.task import Task

    Columns = Mapping[str, NDArray[np.generic]]
    Range = tuple[float, float]

PROVEN_ANGLE = 0.25 * np.pi
"""Largest hinge angle up to which a fin that `proven_fins` names needs no second swim, rad."""
_AMPLITUDE = (0.17, 0.28)  # rad
_BEATS, _RAMP_BEATS, _STEP_BEATS = 7.9, 0.44, 1.0 / 55.0

# An ellipsoid's body and sheets whose damping grows with their stiffness, in numbers without units.
_ELLIPSOID = Fish(Body.ellipsoid(0.14, 0.045, 0.06, drag_area=3.65e-3, lift_area=0.05, yaw_drag=4e-4))
_ELLIPSOID_DRAG_AREA = (1.2e-3, 3.65e-3)  # m^2
_DAMPING_BEATS, _FREQUENCY_RATIO, _SEGMENTS, _MASS_RATIO = 0.0085, 0.15, 6, 0.05
_SEGMENTS_HELD = 4  # of six some are off by several tolerances over a window of a beat, on a held fish

# A box without added mass and lift in water without resistive force, as an engine for rigid bodies swims it (presets of
# 2012), and fins in three segments, 0.3 mm thick, with a damper of their own in each hinge.
_BOX = Fish(
    Body(
        mass=0.3,
        added_surge=0.0,
        added_sway=0.0,
        inertia=5e-4,
        added_inertia=0.0,
        drag_area=7e-3,
        lift_area=0.0,
        yaw_drag=0.0,
        tail_offset=0.07,
    ),
    Water(normal_drag=0.0),
)
_BOX_RANGES: Mapping[str, Range] = {
    "mass": (0.25, 0.5),
    "inertia": (4e-4, 8e-4),
    "drag_area": (3e-3, 1e-2),
    "yaw_drag": (0.0, 4e-4),
}
_FIN_RANGES: Mapping[str, Range] = {
    "young_modulus": (1e7, 1e10),
    "length": (0.04, 0.14),
    "thickness": (3e-4, 3e-4),
    "density": (0.0, 1180.0),
    "damping_time": (0.0, 0.0),
    "hinge_damping": (1e-4, 2e-4),
    "segments": (3, 3),
}
_BOX_BEAT, _AREA, _DAMPING_STEPS = 1.0 / 0.9, (6e-4, 2.001e-3), 0.5


def proven_fins(task: Task, fins: Columns) -> NDArray[np.bool_]:
    """Return for which fins the first step is known to be short enough, shape (n,)."""
    if task.gait is None:
        return np.zeros(len(fins["length"]), dtype=bool)
    joint = task.gait.joints[0]
    beat = _beat(task.gait)
    like_the_papers = (
        task.fish.driven_joints == 1
        and task.clamp != "towed"
        and joint.phase == joint.bias == 0.0
        and _within(joint.amplitude, _AMPLITUDE)
        and task.ramp_time >= _RAMP_BEATS * beat
        and task.duration >= _BEATS * beat
        and task.duration - task.settle >= (1.0 - 1e-9) * beat
        and task.step <= _STEP_BEATS * beat
    )
    known = np.zeros(len(fins["length"]), dtype=bool)
    if like_the_papers and _is_the_ellipsoid(task.fish):
        known = _sheets(task, fins, beat)
    elif like_the_papers and _is_a_box(task, beat):
        known = _damped_hinges(task, fins)
    for name in PROFILE:
        if name in fins:
            known &= np.isnan(fins[name].astype(float)).all(axis=1)
    return known


def _beat(gait: Gait) -> float:
    fastest = max(joint.frequency for joint in gait.joints)
    return 1.0 / fastest if fastest > 0.0 else math.inf


def _in_strips(fish: Fish) -> Fish:
    """Return the fish in the water of strips, if the proof is of its own too: each link lighter, and so quicker.

    The body's axes count for a matrix of added mass and for the plane flow alone.
    """
    if fish.water.has_matrix or fish.water.model == "ideal_2d":
        return fish
    return replace(fish, axes=None, water=replace(fish.water, model="strip"))


def _is_the_ellipsoid(fish: Fish) -> bool:
    body = replace(fish.body, drag_area=_ELLIPSOID.body.drag_area)
    return _within(fish.body.drag_area, _ELLIPSOID_DRAG_AREA) and replace(_in_strips(fish), body=body) == _ELLIPSOID


def _within(value: float, limits: Range) -> bool:
    return limits[0] <= value <= limits[1]


def _sheets(task: Task, fins: Columns, beat: float) -> NDArray[np.bool_]:
    length, height, tip, thickness, density, damping = (
        fins[name].astype(float) for name in ("length", "height", "tip_height", "thickness", "density", "damping_time")
    )
    segments = fins["segments"].astype(float)
    most = _SEGMENTS_HELD if task.clamp == "fixed" else _SEGMENTS
    virtual = 0.25 * np.pi * task.fish.water.density
    # A hinge's own frequency with the water of a fin that is as high as its highest end over the beat's.
    with np.errstate(all="ignore"):  # a fin that is refused may be of any size
        stiffness = stiffness_per_height(fins) * 0.5 * (height + tip)
        ratio = np.sqrt(3.0 * stiffness / (virtual * tip**2 * length**3)) * beat / (2.0 * np.pi)
        return np.asarray(
            (ratio >= _FREQUENCY_RATIO)
            & (fins["stiffness_length"] == "segment")
            & (fins["hinge_damping"].astype(float) == 0.0)
            & (tip >= height)
            & (tip <= 3.01 * height)
            & (segments <= most)
            & (damping >= _DAMPING_BEATS * beat)
            & (density * thickness <= _MASS_RATIO * virtual * height)
        )


def _is_a_box(task: Task, beat: float) -> bool:
    body = task.fish.body
    alike = replace(body, **{name: getattr(_BOX.body, name) for name in _BOX_RANGES})
    return (
        replace(_in_strips(task.fish), body=alike) == _BOX
        and all(_within(getattr(body, name), limits) for name, limits in _BOX_RANGES.items())
        and task.clamp == "free"  # a stiff fin on a held body swings on at its own frequency for too long
        and task.reactive == "tip"
        and math.isclose(beat, _BOX_BEAT)
    )


def _damped_hinges(task: Task, fins: Columns) -> NDArray[np.bool_]:
    known = (fins["hinges"] == "between") & (fins["stiffness_length"] == "fin")
    for name, (low, high) in _FIN_RANGES.items():
        values = fins[name].astype(float)
        known &= (values >= low) & (values <= high)
    height = fins["height"].astype(float)
    with np.errstate(all="ignore"):
        area = fins["length"].astype(float) * height
        known &= (height == fins["tip_height"]) & (area >= _AREA[0]) & (area <= _AREA[1])
        return np.asarray(known & (least_damping_times(fins) >= _DAMPING_STEPS * task.step))
