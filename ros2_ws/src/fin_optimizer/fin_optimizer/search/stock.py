"""The sheets that a laboratory has: material and thickness are drawn together, as a drawer holds them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant import checks
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.parameters import Parameter
from fin_plant.units import in_range, quantity
from fin_sim.materials import damping_time, material

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.parameters import Value

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,39}")
_ENTRIES = ("material", "young_modulus", "spread", "density", "thickness", "sheet")
_EDGE = Parameter("sheet", "double", 0.2, "Edge of a sheet.", "m", 0.005, 5.0)
SETS = ("fin.young_modulus", "fin.thickness", "fin.density")
"""What a sheet gives a fin."""


@dataclass(frozen=True)
class Sheet:
    """One kind of sheet.

    Attributes:
        name: By which the laboratory finds it.
        young_modulus: E, Pa.
        spread: Standard deviation of E as measured, or half the range that the material's sources state, Pa.
        density: kg/m^3.
        thickness: m.
        size: Two edges of the sheet in m; none if a fin of any size can be cut.
        loss_factor: tan delta of its material; None where it is not known and the fin's damping time stays.
    """

    name: str
    young_modulus: float
    spread: float
    density: float
    thickness: float
    size: tuple[float, ...] = ()
    loss_factor: float | None = None

    def parameters(self, frequency: float) -> dict[str, Value]:
        """Return what a fin cut from it has, by the plant's parameters, where it beats at ``frequency`` Hz."""
        fin: dict[str, Value] = dict(zip(SETS, (self.young_modulus, self.thickness, self.density), strict=True))
        if self.loss_factor is not None:
            fin["fin.damping_time"] = damping_time(self.loss_factor, frequency)
        return fin

    def refusal(self, length: float, height: float) -> str:
        """Return why a fin of this length and largest height in m cannot be cut from it, or an empty text."""
        if not self.size or all(f <= s for f, s in zip(sorted((length, height)), sorted(self.size), strict=True)):
            return ""
        fin, sheet = (" x ".join(f"{1e3 * edge:.4g}" for edge in edges) for edges in ((length, height), self.size))
        return f"sheet {self.name} of {sheet} mm is too small for a fin of {fin} mm"

    @property
    def traits(self) -> tuple[float, ...]:
        """What a fin of it is like: logarithms of its bending stiffness E h^3, its thickness and its density."""
        return (
            math.log(self.young_modulus * self.thickness**3),
            math.log(self.thickness),
            math.log(self.density),
        )

    @property
    def told(self) -> str:
        """It in a line, in SI."""
        size = f", {' x '.join(f'{edge:g}' for edge in self.size)} m" if self.size else ""
        loss = "" if self.loss_factor is None else f", tan delta {self.loss_factor:g}"
        modulus = f"E {self.young_modulus!r} +- {self.spread!r} Pa"
        return f"{modulus}, {self.density!r} kg/m^3, {self.thickness!r} m thick{size}{loss}"


def sheet(name: str, entry: object) -> Sheet:
    """Return the sheet that an entry of a table describes.

    Raises:
        ValueError: An entry that is unknown, missing or out of the plant's range.
    """
    where = f"sheet {name}"
    if not _NAME.fullmatch(name):
        msg = f"{where}: name it with a letter first, then letters, digits, _ . and -, 40 at most"
        raise ValueError(msg)
    if not isinstance(entry, dict) or not set(entry) <= set(_ENTRIES):
        wrong = f", not {', '.join(sorted(set(entry) - set(_ENTRIES)))}" if isinstance(entry, dict) else ""
        msg = f"{where} needs a mapping with {', '.join(_ENTRIES)}{wrong}"
        raise ValueError(msg)
    if "thickness" not in entry:
        msg = f"{where} has no thickness: measure it, for example thickness: 0.5 mm"
        raise ValueError(msg)
    modulus, spread = _modulus(where, entry)
    return Sheet(
        name,
        modulus,
        spread,
        _density(where, entry),
        in_range(f"{where}: thickness", entry["thickness"], FIN_PARAMETERS["fin.thickness"]),
        _size(where, entry.get("sheet")),
        material(str(entry["material"])).loss_factor if "material" in entry else None,
    )


def _modulus(where: str, entry: Mapping[str, object]) -> tuple[float, float]:
    """Return E and its spread in Pa: as measured, or the middle and half the range of the material."""
    table = FIN_PARAMETERS["fin.young_modulus"]
    if "young_modulus" in entry:
        modulus = in_range(f"{where}: young_modulus", entry["young_modulus"], table)
        spread = quantity(f"{where}: spread", entry.get("spread", 0.0), table.unit)
        return modulus, checks.number(f"{where}: spread", spread, 0.0, modulus, unit=table.unit)
    if "spread" in entry or "material" not in entry:
        msg = f"{where} needs young_modulus (and spread) as measured by measure_strip, or a material"
        raise ValueError(msg)
    known = material(str(entry["material"]))
    if known.young_modulus is None:
        msg = f"{where}: {known.modulus_source} Measure it and give young_modulus instead"
        raise ValueError(msg)
    low, high = known.young_modulus
    return 0.5 * (low + high), 0.5 * (high - low)


def _density(where: str, entry: Mapping[str, object]) -> float:
    if "density" in entry:
        return in_range(f"{where}: density", entry["density"], FIN_PARAMETERS["fin.density"])
    if "material" not in entry:
        msg = f"{where} needs a density or a material: weigh the sheet"
        raise ValueError(msg)
    return math.fsum(material(str(entry["material"])).density) / 2.0


def _size(where: str, given: object) -> tuple[float, ...]:
    if given is None:
        return ()
    if not isinstance(given, list) or len(given) != 2:  # noqa: PLR2004
        msg = f"{where}: sheet = {given!r} must be a list of its two edges, for example [210 mm, 297 mm]"
        raise ValueError(msg)
    return tuple(in_range(f"{where}: sheet", edge, _EDGE) for edge in given)
