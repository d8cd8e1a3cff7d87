"""How a trial ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from fin_optimizer.goals import MEAN_SPEED, MEASURES
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Mapping


class Outcome(StrEnum):
    """What became of a trial.

    One that is INTERRUPTED ended for a reason that says nothing about the fin, like a stop or a plant that is gone: it
    is no attempt at the fin. One that FAILED is.
    """

    PROPOSED = "PROPOSED"
    RUNNING = "RUNNING"
    OK = "OK"
    FAILED = "FAILED"
    INTERRUPTED = "INTERRUPTED"
    INFEASIBLE = "INFEASIBLE"


@dataclass(frozen=True)
class Result:
    """How a trial ended.

    Attributes:
        outcome: OK, FAILED, INTERRUPTED or INFEASIBLE.
        reason: Why, unless OK.
        measured: What was asked for, by measure in SI; of an OK trial the mean speed at least, else nothing.
        spread: m/s, None if unknown.
        samples: Number of velocities in the score.

    Raises:
        ValueError: An OK trial without a finite mean speed or with another number that is not finite, or another trial
            with numbers or without a reason.
    """

    outcome: Outcome
    reason: str = ""
    measured: Mapping[str, float] = field(default_factory=dict)
    spread: float | None = None
    samples: int = 0

    def __post_init__(self) -> None:
        if self.outcome is Outcome.OK:
            for name, value in {MEAN_SPEED: math.nan, **self.measured}.items():
                checks.number(f"{name} of an OK trial", value, unit=MEASURES[name].unit)
        elif self.outcome not in {Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE}:
            msg = f"a trial cannot end as {self.outcome}: it ends OK, FAILED, INTERRUPTED or INFEASIBLE"
            raise ValueError(msg)
        elif self.measured or not self.reason:
            msg = f"a trial that ends {self.outcome} has a reason and no score, got {self.reason!r}, {self.measured}"
            raise ValueError(msg)

    @property
    def score(self) -> float | None:
        """Mean speed in m/s, None unless OK."""
        return self.measured.get(MEAN_SPEED)
