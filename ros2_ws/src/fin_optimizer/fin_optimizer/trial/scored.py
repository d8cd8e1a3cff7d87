"""What a swim that was recorded makes of its trial, whether it has just ended or is read from its bag."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fin_optimizer.score.mean_speed import NotThisSwimError, ScoreError
from fin_optimizer.score.measured import why_none
from fin_optimizer.score.swim import score_swim
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.words import show_speed

if TYPE_CHECKING:
    from fin_optimizer.goals import Goals
    from fin_optimizer.score.swim import SwimRecord


def result_of(swim: SwimRecord, goals: Goals) -> Result:
    """Return how the trial ends whose whole swim was recorded.

    Args:
        swim: What was recorded.
        goals: What is asked of it; a fin that has none of it, as energy per metre without headway, cannot be.
    """
    try:
        scored, measured = score_swim(swim, goals.asked)
    except NotThisSwimError as error:
        return Result(Outcome.INTERRUPTED, error.reason)
    except ScoreError as error:
        return Result(Outcome.FAILED, error.reason)
    if reason := why_none(measured):
        return Result(Outcome.INFEASIBLE, f"swims {show_speed(scored.value)}: {reason}")
    spread = scored.spread if math.isfinite(scored.spread) else None
    return Result(Outcome.OK, measured=measured, spread=spread, samples=scored.samples)
