"""Materials that fins are made of: a fin can be named by its material, whose range of stiffness is one of speeds."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fin_plant import checks, yaml_file
from fin_plant.fin import FIN_PARAMETERS

if TYPE_CHECKING:
    from fin_plant.fin import Fin

_LONGEST_DAMPING_TIME = FIN_PARAMETERS["fin.damping_time"].maximum
MATERIALS_FILE = Path(__file__).with_name("materials.yaml")


@dataclass(frozen=True)
class Material:
    """A material as makers and collections of their data describe it.

    Attributes:
        key: Short name by which a fin is named.
        name: What it is.
        young_modulus: Least and largest E, Pa; None where nobody states one.
        modulus_source: Who states it.
        density: Least and largest density, kg/m^3.
        density_source: Who states it.
        loss_factor: tan delta, loss modulus over storage modulus, near 1 Hz.
        loss_source: Who states it.
    """

    key: str
    name: str
    young_modulus: tuple[float, float] | None
    modulus_source: str
    density: tuple[float, float]
    density_source: str
    loss_factor: float
    loss_source: str

    def fins(self, fin: Fin) -> tuple[Fin, Fin]:
        """Return the fin cut from the softest and from the stiffest of this material, at the middle density.

        Raises:
            ValueError: No modulus is known, or the fin refuses it.
        """
        if self.young_modulus is None:
            msg = f"material {self.key}: {self.modulus_source} Measure it and give fin.young_modulus instead"
            raise ValueError(msg)
        density = 0.5 * sum(self.density)
        soft, stiff = (replace(fin, young_modulus=modulus, density=density) for modulus in self.young_modulus)
        return soft, stiff


def damping_time(loss_factor: float, frequency: float) -> float:
    """Return the Kelvin-Voigt damping time in s with which a hinge loses as much as its material at ``frequency`` Hz.

    tan delta = 2 pi f tau, tau at most what a fin takes. A material's tan delta changes little with the frequency, so
    tau belongs to one frequency.

    Raises:
        ValueError: A loss factor below 0, or a frequency that is not positive.
    """
    checks.number("loss_factor", loss_factor, 0.0)
    checks.number("frequency", frequency, 0.0, unit="Hz", exclusive_minimum=True)
    return min(loss_factor / (2.0 * math.pi * frequency), _LONGEST_DAMPING_TIME)


def _range(where: str, value: object) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:  # noqa: PLR2004
        msg = f"{where} = {value!r} must be a list of the least and the largest value"
        raise ValueError(msg)
    low, high = (checks.number(where, item, 0.0, exclusive_minimum=True) for item in value)
    if low > high:
        msg = f"{where} = {value!r}: the least value comes first"
        raise ValueError(msg)
    return low, high


@cache
def materials() -> dict[str, Material]:
    """Return the table of materials by key, in the order of ``materials.yaml``.

    Raises:
        ValueError: An entry of the file that is incomplete.
    """
    content = cast("dict[str, dict[str, Any]]", yaml_file.read(MATERIALS_FILE))
    table = {}
    for key, entry in content.items():
        modulus = entry.pop("young_modulus", None)
        table[key] = Material(
            key=key,
            name=entry["name"],
            young_modulus=None if modulus is None else _range(f"{key} young_modulus", modulus),
            modulus_source=entry["modulus_source"],
            density=_range(f"{key} density", entry["density"]),
            density_source=entry["density_source"],
            loss_factor=checks.number(f"{key} loss_factor", entry["loss_factor"], 0.0),
            loss_source=entry["loss_source"],
        )
    return table


def material(key: str) -> Material:
    """Return the material of that name, upper and lower case alike.

    Raises:
        ValueError: It is not in the table; the message offers what there is.
    """
    known = {name.lower(): entry for name, entry in materials().items()}
    if key.lower() not in known:
        near = difflib.get_close_matches(key.lower(), known, n=1)
        hint = f"did you mean {known[near[0]].key}? " if near else ""
        msg = f"material {key!r} is not in the table: {hint}There is {', '.join(materials())}"
        raise ValueError(msg)
    return known[key.lower()]
