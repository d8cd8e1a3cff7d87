"""What all fins of a batch share: the fish, its gait and the time steps, checked once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from fin_plant import checks
from fin_sim.batch.step import LANES
from fin_sim.chain import CLAMPS, Clamp, Reactive, convective_form, refuse_unready

if TYPE_CHECKING:
    from fin_plant.gait import Gait
    from fin_sim.fish import Fish

Precision = Literal["double", "single"]


STEPS_A_BEAT = 56.0
LONGEST_STEP = 0.02
"""Default step in s for slow gaits: the mean speeds of fins like the default one are then within 0.1 % of the
converged ones."""
RAMP_STEPS, MOST_STEPS_A_BEAT = 16.0, 224.0
"""Least steps in the gait's ramp, as far as that takes no more than so many a beat."""
LEAST_STEPS = 4


@dataclass(frozen=True)
class Task:
    """What all fins of a batch share."""

    fish: Fish
    gait: Gait
    duration: float
    steps: int
    settle: float
    reactive: Reactive
    clamp: Clamp
    tow_speed: float
    ramp_time: float
    precision: Precision

    @property
    def step(self) -> float:
        """Time step, s."""
        return self.duration / self.steps

    @property
    def body_speed(self) -> float:
        """Speed that a held or towed body keeps, m/s."""
        return self.tow_speed if self.clamp == "towed" else 0.0

    @property
    def fastest(self) -> float:
        """Highest frequency of any joint that moves, Hz."""
        return max(joint.frequency for joint in self.gait.joints)

    @property
    def beat(self) -> float:
        """Duration of the fastest joint's beat, s; infinite where none beats."""
        return 1.0 / self.fastest if self.fastest > 0.0 else np.inf

    @property
    def beating(self) -> float:
        """Largest product of frequency and amplitude of any joint, rad/s."""
        return max(joint.frequency * joint.amplitude for joint in self.gait.joints)

    def refined(self, factor: int) -> Task:
        """Return the same swim at a step shorter by a factor."""
        return replace(self, steps=self.steps * factor)


def window_step(duration: float, settle: float) -> float:
    """Return the longest step in s for the window over which means are taken, as far as it has any length."""
    window = duration - settle
    return window / LEAST_STEPS if window >= 1e-4 * duration else np.inf


@lru_cache(maxsize=64)
def checked_task(
    fish: Fish,
    gait: Gait,
    duration: float,
    reactive: str,
    clamp: str,
    tow_speed: float,
    ramp_time: float,
    settle: float,
    step: float | None,
    precision: str,
) -> Task:
    """Return what all fins share; see `swim_batch`.

    Raises:
        ValueError: An argument that is refused; the message names it.
    """
    duration = checks.number("duration", duration, 0.0, 1e5, unit="s", exclusive_minimum=True)
    settle = checks.number("settle", settle, 0.0, duration, unit="s")
    fastest = max(joint.frequency for joint in gait.joints)
    if step is None:
        step = min(LONGEST_STEP, 1.0 / (STEPS_A_BEAT * fastest) if fastest > 0.0 else LONGEST_STEP)
        if fastest > 0.0 and ramp_time > 0.0:
            step = min(step, max(ramp_time / RAMP_STEPS, 1.0 / (MOST_STEPS_A_BEAT * fastest)))
    step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
    step = min(step, window_step(duration, settle))
    if len(gait.joints) != fish.driven_joints:
        msg = f"gait has {len(gait.joints)} rows, the tail has {fish.driven_joints} driven joints: give one row a joint"
        raise ValueError(msg)
    refuse_unready(fish.water)
    steps = max(LEAST_STEPS, int(np.ceil(duration / step - 1e-9)))
    return Task(
        fish=fish,
        gait=gait,
        duration=duration,
        steps=steps,
        settle=min(settle, duration - 1e-3 * step),
        reactive=convective_form(reactive, fish.water),
        clamp=cast("Clamp", checks.choice("clamp", clamp, CLAMPS)),
        tow_speed=checks.number("tow_speed", tow_speed, unit="m/s"),
        ramp_time=checks.number("ramp_time", ramp_time, 0.0, unit="s"),
        precision=cast("Precision", checks.choice("precision", precision, tuple(LANES))),
    )
