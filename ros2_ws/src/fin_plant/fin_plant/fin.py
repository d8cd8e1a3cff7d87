"""The caudal fin that a laboratory cuts: a sheet of one material, and its hinge model."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Literal, cast

from fin_plant.parameters import ParameterTable, Value, load_table

if TYPE_CHECKING:
    from collections.abc import Mapping

PLANT_PARAMETERS: ParameterTable = load_table("fin_plant", "plant_parameters.yaml")
FIN_PARAMETERS: ParameterTable = PLANT_PARAMETERS.group("fin")

Hinges = Literal["between", "midpoint"]


def _default(name: str) -> Value:
    return FIN_PARAMETERS[f"fin.{name}"].default


@dataclass(frozen=True)
class Fin:
    """A fin of linear height profile; without arguments the *paper fin* at its default stiffness.

    Attributes are the plant's parameters ``fin.<name>``; their units, ranges and reasons stand in
    ``plant_parameters.yaml``.

    Raises:
        ValueError: A value outside its range, or a fin thicker than long or than high.
    """

    young_modulus: float = cast("float", _default("young_modulus"))
    length: float = cast("float", _default("length"))
    height: float = cast("float", _default("height"))
    tip_height: float = cast("float", _default("tip_height"))
    thickness: float = cast("float", _default("thickness"))
    density: float = cast("float", _default("density"))
    segments: int = cast("int", _default("segments"))
    hinges: Hinges = cast("Hinges", _default("hinges"))
    damping_time: float = cast("float", _default("damping_time"))

    def __post_init__(self) -> None:
        for field in fields(self):
            checked = FIN_PARAMETERS[f"fin.{field.name}"].check(getattr(self, field.name))
            object.__setattr__(self, field.name, checked)
        for name in ("length", "height"):
            extent = getattr(self, name)
            if self.thickness >= extent:
                msg = (
                    f"fin.thickness = {self.thickness:g} m must be less than fin.{name} = {extent:g} m: "
                    "a fin is a sheet; check that both are in metres"
                )
                raise ValueError(msg)

    @property
    def area(self) -> float:
        """Side area of the fin in m^2."""
        return 0.5 * (self.height + self.tip_height) * self.length

    def height_at(self, position: float) -> float:
        """Return the height in m at ``position`` m behind the fin's root."""
        fraction = min(max(position / self.length, 0.0), 1.0)
        return self.height * (1.0 - fraction) + self.tip_height * fraction

    def hinge_stiffness(self, position: float) -> float:
        """Return the stiffness in N m/rad of a hinge at ``position`` m behind the fin's root.

        K = E d h^3 / (12 l) with d the local height, h the thickness and l the length of a segment
        (Raja Mohamed & Raviraj, eq. 3; Clark et al. 2012, eq. 3).
        """
        segment = self.length / self.segments
        return self.young_modulus * self.height_at(position) * self.thickness**3 / (12.0 * segment)

    def as_parameters(self) -> dict[str, Value]:
        """Return the fin as the plant's parameters."""
        return {f"fin.{name}": value for name, value in asdict(self).items()}

    @classmethod
    def from_parameters(cls, values: Mapping[str, object]) -> Fin:
        """Build the fin from a plant's parameters; names outside ``fin.`` are ignored.

        Raises:
            ValueError: An unknown ``fin.`` name or a value that is refused.
        """
        own = {name: value for name, value in values.items() if name.startswith("fin.")}
        checked = FIN_PARAMETERS.checked(own)
        return cls(**{name.removeprefix("fin."): value for name, value in checked.items()})  # type: ignore[arg-type]
