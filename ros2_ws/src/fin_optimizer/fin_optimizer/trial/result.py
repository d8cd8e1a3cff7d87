"""How a trial ends."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from fin_plant import checks


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
        score: m/s, needed for OK and refused otherwise.
        spread: m/s, None if unknown.
        cost: Energy per metre in J/m, None if unknown.
        samples: Number of velocities in the score.

    Raises:
        ValueError: An OK trial without a finite score, or another one with a score or without a reason.
    """

    outcome: Outcome
    reason: str = ""
    score: float | None = None
    spread: float | None = None
    cost: float | None = None
    samples: int = 0

    def __post_init__(self) -> None:
        if self.outcome is Outcome.OK:
            checks.number("score of an OK trial", float("nan") if self.score is None else self.score, unit="m/s")
            checks.number("energy per metre of an OK trial", self.cost or 0.0, unit="J/m")
        elif self.outcome not in {Outcome.FAILED, Outcome.INTERRUPTED, Outcome.INFEASIBLE}:
            msg = f"a trial cannot end as {self.outcome}: it ends OK, FAILED, INTERRUPTED or INFEASIBLE"
            raise ValueError(msg)
        elif self.score is not None or not self.reason:
            msg = f"a trial that ends {self.outcome} has a reason and no score, got {self.reason!r}, {self.score}"
            raise ValueError(msg)
