"""What a prediction is judged by. All windows are in true time, s since the swim's first sample."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.calibration.prediction import GIVEN
from fin_optimizer.calibration.swims import LAST

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fin_optimizer.calibration.prediction import Prediction
    from fin_optimizer.calibration.swims import Swim

AFTER = 3.0
"""s after the first second at which the position is compared."""
_FORMATS = {"speed": (100.0, 1, "%"), "turning_rate": (100.0, 1, "%"), "position": (100.0, 2, " cm")}
"""How each kind is shown: the factor that makes the unit of it, digits, unit."""
KINDS = tuple(_FORMATS)
_FIRST = 1.0


@dataclass(frozen=True)
class Errors:
    """How far a prediction is off.

    Attributes:
        speed: Of the mean forward speed over the last 2 s, relative; None where the fish made no way in them.
        turning_rate: Of the mean turning rate from the end of what was given to the swim's end, relative; None for a
            swim that was not asked to turn, or did not.
        position: m, at 4 s; None where no position was recorded, or where the swim is shorter.
    """

    speed: float | None
    turning_rate: float | None
    position: float | None


def errors(swim: Swim, predicted: Prediction, given: float = GIVEN) -> Errors:
    """Return the errors of a prediction that was shown the first ``given`` s."""
    time, last = swim.time, swim.time >= swim.time[-1] - LAST
    speed = _relative(float(np.mean(predicted.forward[last])), float(np.mean(swim.forward[last])))
    turning = None
    if swim.turns:
        rest = np.flatnonzero(time >= given)
        turned = [float(heading[rest[-1]] - heading[rest[0]]) for heading in (predicted.heading, swim.heading)]
        turning = _relative(*turned)
    apart = None
    if swim.position is not None and time[-1] >= _FIRST + AFTER:
        at = int(np.argmin(np.abs(time - _FIRST - AFTER)))
        apart = math.dist(predicted.position[at], swim.position[at])
    return Errors(speed, turning, apart)


def _relative(predicted: float, recorded: float) -> float | None:
    return abs(predicted - recorded) / abs(recorded) if recorded else None


def shown(kind: str, *values: float) -> str:
    """Return an error of a kind as people read it, with its unit; a second one in brackets."""
    factor, digits, unit = _FORMATS[kind]
    first, *rest = (f"{factor * value:.{digits}f}" for value in values)
    return f"{first} ({', '.join(rest)}) {unit.strip()}" if rest else f"{first}{unit}"


def summary(all_errors: Sequence[Errors], of: Callable[[list[float]], float]) -> dict[str, float | None]:
    """Return one number for each kind of error over many swims; None where no swim has it."""
    result: dict[str, float | None] = {}
    for kind in KINDS:
        told = [value for each in all_errors if (value := getattr(each, kind)) is not None]
        result[kind] = of(told) if told else None
    return result


def medians_and_90(all_errors: Sequence[Errors]) -> dict[str, dict[str, float | None]]:
    """Return medians and 90th percentiles by kind of error."""
    return {
        "median": summary(all_errors, lambda told: float(np.median(told))),
        "p90": summary(all_errors, lambda told: float(np.percentile(told, 90.0))),
    }
