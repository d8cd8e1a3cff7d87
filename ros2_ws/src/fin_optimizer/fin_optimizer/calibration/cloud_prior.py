"""What a calibrated fish leaves open, for a cloud of plausible fish: narrower priors around the fitted fish."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from fin_optimizer.calibration.fish_file import read_errors, read_fish
from fin_optimizer.calibration.settings import AMPLITUDE_FACTOR, STIFFNESS_FACTOR
from fin_optimizer.search.plausible import STIFFNESS_WIDTH, WIDTHS, Prior
from fin_sim.fish import Fish

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from fin_optimizer.calibration.model import Model

_PARAMETERS = {
    "mass": "body.mass",
    "added_sway": "body.added_sway",
    "drag_area": "body.drag_area",
    "lift_area": "body.lift_area",
    "yaw_drag": "body.yaw_drag",
    "normal_drag": "water.normal_drag",
    "damping_time": "fin.damping_time",
    "amplitude": AMPLITUDE_FACTOR,
}
_LEAST_WIDTH = 0.05
"""Of what was fitted: a model that is not quite the fish has errors larger than it states."""


def around(path: Path) -> Mapping[str, Any]:
    """Return the nominal fish and the prior that a calibrated file tells, as `plausible.Fins` names them.

    What was not fitted stays as wide as it is without the file.

    Raises:
        ValueError: It cannot be read, is no such file, or a number in it is refused; the message names the file.
    """
    model, errors = read_fish(path), read_errors(path)
    widths = dict(WIDTHS)
    for name, parameter in _PARAMETERS.items():
        if parameter in errors:
            widths[name] = min(widths[name], _width(errors[parameter]))
    stiffness = STIFFNESS_WIDTH
    if STIFFNESS_FACTOR in errors:
        stiffness = min(stiffness, _width(errors[STIFFNESS_FACTOR]))
    lag = {}
    if _has_drive(model):
        widths["servo_lag"] = 0.0  # the amplitude factor holds the lag too
        lag = {"servo_lag": 0.0}
    prior = Prior(tuple(widths.values()), stiffness, model.knots.at(0.0)[0], model.own[STIFFNESS_FACTOR], **lag)
    return {"fish": Fish.from_parameters(model.fish), "prior": prior}


def _has_drive(model: Model) -> bool:
    return any(factor != 1.0 for factor in model.knots.amplitude_factor)


def _width(pair: tuple[float, float]) -> float:
    """Return the standard deviation of the logarithm; not told by what may be zero or less."""
    low, high = pair
    return max(_LEAST_WIDTH, 0.5 * math.log(high / low)) if 0.0 < low < high else math.inf
