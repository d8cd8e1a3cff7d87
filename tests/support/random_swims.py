"""Swims drawn over all that a laboratory may ask for: what the batch's promise of accuracy is tested on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive

if TYPE_CHECKING:
    import numpy as np

    from fin_sim.chain import Clamp, Reactive


@dataclass(frozen=True)
class RandomSwim:
    """One swim; attributes as of `fin_sim.swim_batch`."""

    fin: Fin
    gait: Gait
    duration: float
    ramp_time: float
    settle: float
    clamp: Clamp
    reactive: Reactive


def random_swim(random: np.random.Generator) -> RandomSwim:
    """Return a swim over 1e7 to 2e11 Pa, 4 to 14 cm, all shapes, 0.1 to 10 Hz, 3 to 60 degrees, any ramp."""

    def between(low: float, high: float) -> float:
        return float(10.0 ** random.uniform(math.log10(low), math.log10(high)))

    def one_of(*values: float) -> float:
        return values[int(random.integers(len(values)))]

    height = random.uniform(0.01, 0.05)
    fin = Fin(
        young_modulus=between(1e7, 2e11),
        length=random.uniform(0.04, 0.14),
        height=height,
        tip_height=one_of(height, min(3.0 * height, 0.1), height / 3.0, random.uniform(0.0, 0.06), 0.0),
        thickness=one_of(2e-4, between(1e-4, 1e-3)),
        density=one_of(0.0, 1180.0, between(500.0, 8000.0)),
        segments=int(one_of(1, 2, 3, 3, 3, 4, 5, 8)),
        hinges="between" if random.random() < 0.5 else "midpoint",
        damping_time=one_of(0.0, 0.01, 0.01, 0.01, between(1e-3, 0.1)),
    )
    frequency = one_of(between(0.1, 10.0), between(0.3, 3.0))
    ramp_time = one_of(0.5, between(0.02, 3.0), between(0.02, 0.2))
    drive = JointDrive(
        math.radians(between(3.0, 60.0)),
        frequency,
        one_of(0.0, 0.0, random.uniform(-3.0, 3.0)),
        one_of(0.0, 0.0, math.radians(random.uniform(-20.0, 20.0))),
    )
    duration = min(ramp_time + random.uniform(2.0, 8.0) / frequency, 40.0)
    last_beat = max(0.0, duration - 1.0 / frequency)
    return RandomSwim(
        fin=fin,
        gait=Gait((drive,)),
        duration=duration,
        ramp_time=ramp_time,
        settle=one_of(0.0, last_beat, random.uniform(0.0, 0.9) * duration),
        clamp="fixed" if random.random() < 0.25 else "free",
        reactive="tip" if random.random() < 0.5 else "distributed",
    )
