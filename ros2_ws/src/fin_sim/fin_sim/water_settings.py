"""Which water a fish swims in: three independent settings, and the presets that name all three.

Where the kinetic energy of the water comes from (`MODELS`), whether the trailing edge sheds Lighthill's wake (`WAKES`),
and whether the water resists (`DRAGS`). Without wake and drag the water is an ideal fluid: its forces follow from its
kinetic energy alone (Kirchhoff 1869; Lamb, *Hydrodynamics*, 1932, chapter VI).
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from fin_plant import checks

Model = Literal["strip", "ideal_2d", "surface_3d"]
Wake = Literal["lighthill", "none"]
Drag = Literal["on", "off"]
TipTerm = Literal["strip", "scaled"]
MODELS: tuple[Model, ...] = ("strip", "ideal_2d", "surface_3d")
WAKES: tuple[Wake, ...] = ("lighthill", "none")
DRAGS: tuple[Drag, ...] = ("on", "off")
TIP_TERMS: tuple[TipTerm, ...] = ("strip", "scaled")
AddedMass = Literal["links", "matrix"]
ADDED_MASSES: tuple[AddedMass, ...] = ("links", "matrix")
AS_PRESET = "as_preset"
"""A setting's value that leaves it to the preset."""


class Settings(NamedTuple):
    """The three settings."""

    model: Model
    wake: Wake
    drag: Drag


PRESETS = {
    "strip": Settings("strip", "lighthill", "on"),
    "bht": Settings("ideal_2d", "none", "off"),
    "soleil": Settings("surface_3d", "none", "off"),
    "paper_simulation": Settings("surface_3d", "none", "on"),
}


def settings(preset: str, model: str = AS_PRESET, wake: str = AS_PRESET, drag: str = AS_PRESET) -> Settings:
    """Return the settings of a preset, of which those given take the place.

    Raises:
        ValueError: An unknown name.
    """
    own: Any = PRESETS[checks.choice("water.preset", preset, PRESETS)]
    given = {"model": (model, MODELS), "wake": (wake, WAKES), "drag": (drag, DRAGS)}
    for name, (value, names) in given.items():
        if checks.choice(f"water.{name}", value, (*names, AS_PRESET)) != AS_PRESET:
            own = own._replace(**{name: value})
    return Settings(*own)
