"""What a swim that was recorded makes of its trial, whether it has just ended or is read from its bag."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fin_optimizer.score.mean_speed import NotThisSwimError, ScoreError
from fin_optimizer.score.swim import score_swim
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.words import show_speed

if TYPE_CHECKING:
    from fin_optimizer.score.swim import SwimRecord


def result_of(swim: SwimRecord, *, wants_cost: bool) -> Result:
    """Return how the trial ends whose whole swim was recorded.

    Args:
        swim: What was recorded.
        wants_cost: Whether the energy per metre is asked for too; without headway there is none, and no such fin.
    """
    try:
        scored, cost = score_swim(swim, with_cost=wants_cost)
    except NotThisSwimError as error:
        return Result(Outcome.INTERRUPTED, error.reason)
    except ScoreError as error:
        return Result(Outcome.FAILED, error.reason)
    if wants_cost and cost is None:
        reason = f"swims {show_speed(scored.value)}: without headway there is no energy per metre"
        return Result(Outcome.INFEASIBLE, reason)
    spread = scored.spread if math.isfinite(scored.spread) else None
    return Result(Outcome.OK, score=scored.value, spread=spread, cost=cost, samples=scored.samples)
