"""Young's modulus of a sheet from a strip of it: clamped at one end, level, with a weight at the other.

The strip may bend far: its shape is the elastica of an inextensible cantilever whose load keeps its direction (K. E.
Bisshopp & D. C. Drucker, Large deflection of cantilever beams, Quarterly of Applied Mathematics 3, 1945). For small
deflections that is E = 4 F L^3 / (b h^3 w).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

LARGEST_SAG = 0.5
"""Deflection over length up to which a strip is measured: beyond it the weight slides, and a reading says less."""
_SMALL_SAG = 1e-3
"""Below, two terms of the series are exact to 1e-11, and the integrals lose digits."""
_SLENDER = 10.0
"""Least length over thickness: a shorter strip also bends by shear."""
_STEP = 1e-4
"""Relative, of the difference quotient."""


@dataclass(frozen=True)
class Measured:
    """A number with its standard deviation, both in SI.

    Raises:
        ValueError: A value that is not above 0, or an error below 0 or not below the value.
    """

    name: str
    value: float
    error: float = 0.0

    def __post_init__(self) -> None:
        checks.number(self.name, self.value, 0.0, exclusive_minimum=True)
        checks.number(f"error of {self.name}", self.error, 0.0)
        if self.error >= self.value:
            msg = f"{self.name} = {self.value:g} has an error of {self.error:g}: measure it better than to 100 %"
            raise ValueError(msg)

    @property
    def relative(self) -> float:
        """Error over value."""
        return self.error / self.value


@dataclass(frozen=True)
class Modulus:
    """Young's modulus as a strip gives it.

    Attributes:
        value: E, Pa.
        error: Its standard deviation, Pa.
        shares: Relative standard deviation that comes from each quantity, by its name.
        largest_sag: Largest deflection over the length.
        correction: The straight beam's E over this one at the largest deflection.
        scatter: By how many times the readings differ more than their own errors say; 1 where they do not, or for one.
    """

    value: float
    error: float
    shares: dict[str, float]
    largest_sag: float
    correction: float
    scatter: float


def load_number(sag: float) -> float:
    """Return F L^2 / (E I) of a cantilever whose tip sinks by ``sag`` times its length (Bisshopp & Drucker, eq. 8, 12).

    Raises:
        ValueError: A sag that is not positive, or beyond `LARGEST_SAG`.
    """
    checks.number(
        "deflection over length",
        sag,
        0.0,
        LARGEST_SAG,
        exclusive_minimum=True,
        advice="take a smaller weight or a shorter strip",
    )
    if sag < _SMALL_SAG:
        return 3.0 * sag * (1.0 + 36.0 / 35.0 * sag**2)  # from w / L = a / 3 - 4 a^3 / 105
    modulus = brentq(lambda each: _sag(each)[0] - sag, math.sqrt(0.5) + 1e-12, 1.0 - 1e-6, xtol=1e-15, rtol=1e-14)
    return _sag(float(modulus))[1]


def _sag(modulus: float) -> tuple[float, float]:
    """Return tip's deflection over length, and load number, for the elliptic modulus of a bent strip's shape."""
    parameter, start = modulus**2, math.asin(math.sqrt(0.5) / modulus)
    root = float(ellipk(parameter) - ellipkinc(start, parameter))
    return 1.0 - 2.0 / root * float(ellipe(parameter) - ellipeinc(start, parameter)), root**2


def modulus_of_strip(
    length: Measured,
    width: Measured,
    thickness: Measured,
    readings: Sequence[tuple[Measured, Measured]],
) -> Modulus:
    """Return Young's modulus of a strip, with its error by propagation to first order.

    E = F L^2 / (a I) with I = b h^3 / 12 and a the load number of the deflection over the length. Readings are weighted
    by their own errors; where they differ by more than these say, the error is enlarged by as much (R. T. Birge,
    Physical Review 40, 1932). Errors of the strip's own measures are common to all readings.

    Args:
        length: From the clamp to the weight, m.
        width: m.
        thickness: m.
        readings: Force in N, and the deflection in m by which the tip sinks when it is hung on.

    Raises:
        ValueError: No reading, a strip that is no slender beam, or a deflection that is too large.
    """
    if not readings:
        msg = "give one weight at least, and the deflection that it makes"
        raise ValueError(msg)
    if length.value < _SLENDER * thickness.value:
        msg = f"a strip {length.value:g} m long and {thickness.value:g} m thick is no beam: take one ten times as long"
        raise ValueError(msg)
    second_moment = width.value * thickness.value**3 / 12.0
    moduli, own, slopes = [], [], []
    for force, deflection in readings:
        sag = deflection.value / length.value
        number = load_number(sag)
        moduli.append(force.value * length.value**2 / (number * second_moment))
        slopes.append(_slope(sag))
        own.append(math.hypot(force.relative, slopes[-1] * deflection.relative))
    weights = [1.0 / (error * each) ** 2 if error else 1.0 for error, each in zip(own, moduli, strict=True)]
    weights = weights if all(own) else [1.0] * len(own)
    total = math.fsum(weights)
    value = math.fsum(weight * each for weight, each in zip(weights, moduli, strict=True)) / total
    slope = math.fsum(weight * each for weight, each in zip(weights, slopes, strict=True)) / total
    readings_error, scatter = _of_readings(moduli, weights, own, value)
    shares = {
        length.name: (2.0 + slope) * length.relative,
        width.name: width.relative,
        thickness.name: 3.0 * thickness.relative,
        "readings": readings_error / value,
    }
    largest = max(deflection.value for _, deflection in readings) / length.value
    return Modulus(
        value, value * math.hypot(*shares.values()), shares, largest, load_number(largest) / (3.0 * largest), scatter
    )


def _slope(sag: float) -> float:
    """Return d ln a / d ln sag, 1 for a beam that bends a little."""
    low, high = sag * (1.0 - _STEP), min(sag * (1.0 + _STEP), LARGEST_SAG)
    return math.log(load_number(high) / load_number(low)) / math.log(high / low)


def _of_readings(
    moduli: Sequence[float], weights: Sequence[float], own: Sequence[float], mean: float
) -> tuple[float, float]:
    """Return the error of the readings' mean in Pa, and by how much their scatter exceeds their errors."""
    degrees = len(moduli) - 1
    spread = math.fsum(weight * (each - mean) ** 2 for weight, each in zip(weights, moduli, strict=True))
    if not all(own):  # no errors given: the scatter is all that is known
        return (math.sqrt(spread / degrees / len(moduli)) if degrees else 0.0), 1.0
    ratio = max(1.0, math.sqrt(spread / degrees)) if degrees else 1.0
    return ratio / math.sqrt(math.fsum(weights)), ratio
