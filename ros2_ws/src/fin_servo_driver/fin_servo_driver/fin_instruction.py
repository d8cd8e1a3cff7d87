"""A fin as a person would cut it: material or Young's modulus, sizes in mm."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from fin_plant.fin import FIN_PARAMETERS, Fin, ProfiledFin

if TYPE_CHECKING:
    from collections.abc import Mapping

# Young's modulus of common sheets in Pa, typical values of makers' data sheets; within a tenth the name is offered.
MATERIALS = {
    "silicone rubber, 60 Shore A": 3.5e6,
    "low-density polyethylene": 0.25e9,
    "polypropylene": 1.4e9,
    "polycarbonate": 2.35e9,
    "acrylic": 3.1e9,
    "PET film": 4.0e9,
    "glass-fibre laminate": 20.0e9,
    "aluminium": 70.0e9,
    "spring steel": 205.0e9,
}
_NEAR = 0.1
_MILLIMETRES = 1e3


def material(young_modulus: float) -> str:
    """Return Young's modulus in Pa as text, with the name of a common sheet that comes near to it."""
    text = f"E = {young_modulus / 1e9:.3g} GPa" if young_modulus >= 1e8 else f"E = {young_modulus / 1e6:.3g} MPa"  # noqa: PLR2004
    for name, modulus in MATERIALS.items():
        if abs(young_modulus - modulus) <= _NEAR * modulus:
            return f"{text} (about {name})"
    return text


def sizes(fin: Fin) -> dict[str, str]:
    """Return what to cut, by name."""
    points = {0.0: fin.height, fin.length: fin.tip_height}
    if isinstance(fin, ProfiledFin):
        inner = (fin.length * position for position in fin.profile_position)
        points = {0.0: fin.height, **dict(zip(inner, fin.profile_height, strict=True)), fin.length: fin.tip_height}
    height = f"{fin.height * _MILLIMETRES:.1f} mm"
    if len(set(points.values())) > 1:
        stations = (f"{d * _MILLIMETRES:.1f} mm at {s * _MILLIMETRES:.1f} mm" for s, d in points.items())
        height = f"{' - '.join(stations)} behind the tail"
    return {
        "material": material(fin.young_modulus),
        "length": f"{fin.length * _MILLIMETRES:.1f} mm",
        "height": height,
        "thickness": f"{fin.thickness * _MILLIMETRES:.3f} mm",
    }


def instruction(fin: Fin) -> str:
    """Return the fin in one sentence."""
    return ", ".join(f"{name} {value}" for name, value in sizes(fin).items())


def wanted_fin(details: Mapping[str, str]) -> Fin:
    """Return the fin that the driver asks for in the details ``wanted.*`` of its plant_state.

    Raises:
        KeyError: It asks for none.
        ValueError: There is no such fin.
    """
    values: dict[str, object] = {}
    for name, parameter in FIN_PARAMETERS.items():
        text = details[f"wanted.{name}"]
        values[name] = text if parameter.kind == "string" else json.loads(text)
    return Fin.from_parameters(values)
