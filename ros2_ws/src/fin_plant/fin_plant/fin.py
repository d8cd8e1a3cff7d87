"""The caudal fin that a laboratory cuts: a sheet of one material, and its hinge model."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

from fin_plant import checks
from fin_plant.parameters import ParameterTable, Value, load_table

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

PLANT_PARAMETERS: ParameterTable = load_table("fin_plant", "plant_parameters.yaml")
FIN_PARAMETERS: ParameterTable = PLANT_PARAMETERS.group("fin")
_SHARED = {"simulator": PLANT_PARAMETERS, "servo_driver": PLANT_PARAMETERS, "optimizer": FIN_PARAMETERS}
"""What a node has besides the table that bears its name: the optimiser the fin that its search starts from."""

_REHEARSAL = "rehearsal"
"""Has the simulator's peduncle besides its own, fixed: its hidden fish is built as the simulated one."""

SHAPES = {"rectangular": 1.0, "flaring": 3.0, "tapered": 1.0 / 3.0}
"""Named fins: height at the tip over height at the root. A fin that triples is a delta that a servo can still hold."""

_DEFAULTS: dict[str, Any] = {name.removeprefix("fin."): entry.default for name, entry in FIN_PARAMETERS.items()}

_PROFILE = ("profile_position", "profile_height")

AREA = "fin.area"
"""Side area in m^2, by the name under which a study that varies a fin's length holds it; no parameter of a plant."""

Hinges = Literal["between", "midpoint"]
StiffnessLength = Literal["segment", "fin"]


def node_table(package: str, node: str) -> ParameterTable:
    """Return every parameter of a node, its own first.

    Raises:
        FileNotFoundError: The package has no table of parameters by that name.
    """
    table = {**load_table(package, f"{node}_parameters.yaml"), **_SHARED.get(node, {})}
    if node == _REHEARSAL:
        peduncle = load_table("fin_sim", "simulator_parameters.yaml").group("peduncle")
        table |= {name: replace(entry, read_only=True) for name, entry in peduncle.items()}
    return ParameterTable(table)


@dataclass(frozen=True)
class Fin:
    """A fin of linear height profile; without arguments a sheet of the papers' size, as its hinges converge to it.

    Attributes are the plant's parameters ``fin.<name>``; their units, ranges and reasons stand in
    ``plant_parameters.yaml``.

    Raises:
        ValueError: A value outside its range, or a fin thicker than long or than high.
    """

    young_modulus: float = _DEFAULTS["young_modulus"]
    length: float = _DEFAULTS["length"]
    height: float = _DEFAULTS["height"]
    tip_height: float = _DEFAULTS["tip_height"]
    thickness: float = _DEFAULTS["thickness"]
    density: float = _DEFAULTS["density"]
    segments: int = _DEFAULTS["segments"]
    hinges: Hinges = _DEFAULTS["hinges"]
    stiffness_length: StiffnessLength = _DEFAULTS["stiffness_length"]
    damping_time: float = _DEFAULTS["damping_time"]
    hinge_damping: float = _DEFAULTS["hinge_damping"]

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

    @property
    def largest_height(self) -> float:
        """Height in m where the fin is highest."""
        return max(self.height, self.tip_height)

    def height_at(self, position: float) -> float:
        """Return the height in m at ``position`` m behind the fin's root."""
        fraction = min(max(position / self.length, 0.0), 1.0)
        return self.height * (1.0 - fraction) + self.tip_height * fraction

    def hinge_stiffness(self, position: float) -> float:
        """Return the stiffness in N m/rad of a hinge at ``position`` m behind the fin's root.

        K = E d h^3 / (12 l) with d the local height, h the thickness and l the length of a segment (Raja Mohamed &
        Raviraj, eq. 3) or, as ``stiffness_length`` says, of the whole fin (Clark et al. 2012, eq. 3).
        """
        length = self.length / self.segments if self.stiffness_length == "segment" else self.length
        return self.young_modulus * self.height_at(position) * self.thickness**3 / (12.0 * length)  # eq. 3

    @property
    def heights(self) -> tuple[float, ...]:
        """Heights in m from root to tip: at both, and at the points of a profile between them."""
        return (self.height, self.tip_height)

    def describe(self, without: Collection[str] = ()) -> str:
        """Return the fin in the words of a laboratory, for headings: ``fin 8 cm long, 2.5 cm high, 0.208 mm thick``.

        Args:
            without: Parameters (``fin.<name>``) that are not told, because they vary.
        """
        heights = dict.fromkeys(f"{100.0 * height:.4g}" for height in self.heights)
        shape = "-".join(heights if len(heights) == 1 else (f"{100.0 * height:.4g}" for height in self.heights))
        told = {
            "fin.length": f"{100.0 * self.length:.4g} cm long",
            "fin.height": f"{shape} cm high",
            "fin.thickness": f"{1000.0 * self.thickness:.4g} mm thick",
            "fin.young_modulus": f"E {self.young_modulus / 1e9:.4g} GPa",
        }
        return f"fin {', '.join(text for name, text in told.items() if name not in without)}"

    def at_length(self, length: float) -> Fin:
        """Return the fin at another length in m with the same side area, all its heights scaled alike.

        Raises:
            ValueError: A length, or heights that follow from it, outside their range.
        """
        FIN_PARAMETERS["fin.length"].check(length)
        return Fin.from_parameters(scaled_to_area({**self.as_parameters(), "fin.length": length}, self.area))

    def shaped(self, shape: str) -> Fin:
        """Return the fin of the same length and area with straight edges of a named shape, see `SHAPES`.

        Raises:
            ValueError: An unknown shape, or heights outside their range.
        """
        ratio = SHAPES[checks.choice("shape", shape, SHAPES)]
        root = 2.0 * self.area / (self.length * (1.0 + ratio))
        own = {field.name: getattr(self, field.name) for field in fields(Fin)}
        return Fin(**{**own, "height": root, "tip_height": ratio * root})

    def as_parameters(self) -> dict[str, Value]:
        """Return the fin as the plant's parameters; straight edges are an empty profile."""
        values: dict[str, Value] = {f"fin.{name}": value for name, value in asdict(self).items()}
        return {**values, **{f"fin.{name}": list(getattr(self, name, ())) for name in _PROFILE}}

    @classmethod
    def from_parameters(cls, values: Mapping[str, object]) -> Fin:
        """Build the fin from a plant's parameters; names outside ``fin.`` are ignored.

        Raises:
            ValueError: An unknown ``fin.`` name or a value that is refused.
        """
        own = {name: value for name, value in values.items() if name.startswith("fin.")}
        checked = {name.removeprefix("fin."): value for name, value in FIN_PARAMETERS.checked(own).items()}
        profile = {name: checked.pop(name) for name in _PROFILE}
        if any(profile.values()):
            return ProfiledFin(**checked, **{name: tuple(heights) for name, heights in profile.items()})  # type: ignore[arg-type]
        return Fin(**checked)  # type: ignore[arg-type]


def scaled_to_area(parameters: Mapping[str, Any], area: float) -> dict[str, Any]:
    """Return fins' parameters with all heights scaled so that the side area is ``area`` m^2, the profile's too.

    Nothing is checked: whether the fin can be is judged by the plant that gets it. For many fins a value may be an
    array, shape (n,).
    """
    positions = (0.0, *parameters["fin.profile_position"], 1.0)
    heights = (parameters["fin.height"], *parameters["fin.profile_height"], parameters["fin.tip_height"])
    mean = sum(0.5 * (d + e) * (b - a) for (a, d), (b, e) in pairwise(zip(positions, heights, strict=True)))
    factor = area / (mean * parameters["fin.length"])
    return {
        **parameters,
        "fin.height": factor * parameters["fin.height"],
        "fin.tip_height": factor * parameters["fin.tip_height"],
        "fin.profile_height": [factor * height for height in parameters["fin.profile_height"]],
    }


@dataclass(frozen=True)
class ProfiledFin(Fin):
    """A fin whose height changes piecewise linearly through further points between root and tip.

    Attributes:
        profile_position: Where the points lie, fraction of the length behind the root, rising, between 0 and 1.
        profile_height: Height at each of them, m.

    Raises:
        ValueError: As for `Fin`; or no point, arrays of different lengths, positions that do not rise.
    """

    profile_position: tuple[float, ...] = ()
    profile_height: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        positions, heights = tuple(self.profile_position), tuple(self.profile_height)
        if len(positions) != len(heights) or not positions:
            msg = (
                f"fin.profile_position has {len(positions)} entries and fin.profile_height {len(heights)}: "
                "give one height for each position, or neither"
            )
            raise ValueError(msg)
        rising = (0.0, *positions, 1.0)
        if any(after <= before for before, after in pairwise(rising)):
            msg = f"fin.profile_position = {list(positions)} must rise from above 0 to below 1"
            raise ValueError(msg)
        object.__setattr__(self, "profile_position", positions)
        object.__setattr__(self, "profile_height", heights)

    @property
    def heights(self) -> tuple[float, ...]:
        """Heights in m from root to tip: at both, and at the points of the profile between them."""
        return (self.height, *self.profile_height, self.tip_height)

    @property
    def _stations(self) -> list[tuple[float, float]]:
        inner = zip(self.profile_position, self.profile_height, strict=True)
        return [(0.0, self.height), *inner, (1.0, self.tip_height)]

    @property
    def area(self) -> float:
        """Side area of the fin in m^2."""
        return sum(0.5 * (d + e) * (b - a) * self.length for (a, d), (b, e) in pairwise(self._stations))

    @property
    def largest_height(self) -> float:
        """Height in m where the fin is highest."""
        return max(height for _, height in self._stations)

    def height_at(self, position: float) -> float:
        """Return the height in m at ``position`` m behind the fin's root."""
        fraction = min(max(position / self.length, 0.0), 1.0)
        for (before, low), (after, high) in pairwise(self._stations):
            if fraction <= after:
                share = (fraction - before) / (after - before)
                return low * (1.0 - share) + high * share
        return self.tip_height

    def points_between(self, start: float, end: float) -> tuple[tuple[float, float], ...]:
        """Return distance in m behind the root, and height, of the profile's points inside (start, end) m."""
        points = ((self.length * at, d) for at, d in zip(self.profile_position, self.profile_height, strict=True))
        return tuple((distance, height) for distance, height in points if start < distance < end)
