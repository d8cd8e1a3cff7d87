"""Which fins need no second swim at a shorter step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_sim.batch.links import stiffness_per_height
from fin_sim.swim import PAPER_FISH

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_sim.batch.task import Task

_PROVEN_AMPLITUDE = (0.17, 0.28)  # rad
_PROVEN_BEATS, _PROVEN_RAMP_BEATS, _PROVEN_DAMPING_BEATS, _PROVEN_STEP = 7.9, 0.44, 0.0085, 1.0 / 55.0
_PROVEN_FREQUENCY_RATIO, _PROVEN_SEGMENTS, _PROVEN_MASS_RATIO = 0.15, 4, 0.05
PROVEN_ANGLE = 0.25 * np.pi
"""Largest hinge angle up to which a fin that `proven_fins` names needs no second swim, rad."""


def proven_fins(task: Task, fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
    """Return for which fins the default step is known to be short enough, shape (n,).

    The papers' fish and the surroundings of their gait and fins, in numbers without units; the sweep of
    `tests/unit/test_batch_errors.py` swims them against the general kernel.
    """
    count, beat = len(fins["length"]), task.beat
    joint = task.gait.joints[0]
    like_the_papers = (
        task.fish == PAPER_FISH
        and task.clamp != "towed"
        and joint.phase == joint.bias == 0.0
        and _PROVEN_AMPLITUDE[0] <= joint.amplitude <= _PROVEN_AMPLITUDE[1]
        and task.ramp_time >= _PROVEN_RAMP_BEATS * beat
        and task.duration >= _PROVEN_BEATS * beat
        and task.duration - task.settle >= (1.0 - 1e-9) * beat
        and task.step <= _PROVEN_STEP * beat
    )
    if not like_the_papers:
        return np.zeros(count, dtype=bool)
    length, height, tip, thickness, density, damping = (
        fins[name].astype(float) for name in ("length", "height", "tip_height", "thickness", "density", "damping_time")
    )
    segments = fins["segments"].astype(float)
    virtual = 0.25 * np.pi * task.fish.water.density
    # A hinge's own frequency with the water of a fin that is as high as its highest end over the beat's.
    with np.errstate(all="ignore"):  # a fin that is refused may be of any size
        stiffness = stiffness_per_height(fins) * 0.5 * (height + tip)
        ratio = np.sqrt(3.0 * stiffness / (virtual * tip**2 * length**3)) * beat / (2.0 * np.pi)
        return np.asarray(
            (ratio >= _PROVEN_FREQUENCY_RATIO)
            & (fins["stiffness_length"] == "segment")
            & (fins["hinge_damping"].astype(float) == 0.0)
            & (tip >= height)
            & (tip <= 3.01 * height)
            & (segments <= _PROVEN_SEGMENTS)
            & (damping >= _PROVEN_DAMPING_BEATS * beat)
            & (density * thickness <= _PROVEN_MASS_RATIO * virtual * height)
        )
