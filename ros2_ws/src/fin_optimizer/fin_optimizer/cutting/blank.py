"""What is cut for a fin: its outline, the tab by which it is clamped, holes, and the line where it begins to swim.

Everything in a drawing is in mm: x runs from the fin's root to its tip, y upwards, and the root's middle is the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fin_plant import checks

if TYPE_CHECKING:
    from fin_plant.fin import Fin

Point = tuple[float, float]
MM = 1e-3
"""m"""
LEAST_WALL = 1.0
"""mm of sheet that must stay between a hole and an edge, or another hole."""
LONGEST_CLAMP = 500.0
LARGEST_HOLE = 50.0


@dataclass(frozen=True)
class Clamp:
    """The tab beyond the swimming length, as high as the fin's root.

    Attributes:
        length: mm; 0 for none.
        holes: Along the tab's height, evenly spread.
        hole_diameter: mm.

    Raises:
        ValueError: A value outside its range, or holes in no tab.
    """

    length: float = 10.0
    holes: int = 0
    hole_diameter: float = 3.0

    def __post_init__(self) -> None:
        checks.number("clamp", self.length, 0.0, LONGEST_CLAMP, unit="mm")
        checks.whole_number("holes", self.holes, 0, 20)
        checks.number("hole diameter", self.hole_diameter, 0.1, LARGEST_HOLE, unit="mm")
        if self.holes and self.length < self.hole_diameter + 2.0 * LEAST_WALL:
            msg = (
                f"a clamp of {self.length:g} mm has no room for holes of {self.hole_diameter:g} mm: at least "
                f"{LEAST_WALL:g} mm of sheet must stay around each; give a clamp of "
                f"{self.hole_diameter + 2.0 * LEAST_WALL:g} mm or more"
            )
            raise ValueError(msg)


@dataclass(frozen=True)
class Blank:
    """One piece to cut, in mm.

    Attributes:
        outline: Corners of the closed outline, from the root's lower one against the clock.
        stations: Where heights are told: distance behind the root, and height.
        holes: Middle of each.
        clamp: The tab.
        label: Lines written on it.
    """

    outline: tuple[Point, ...]
    stations: tuple[Point, ...]
    holes: tuple[Point, ...]
    clamp: Clamp
    label: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Swimming length, mm."""
        return self.stations[-1][0]

    @property
    def width(self) -> float:
        """Extent along x, mm."""
        return self.clamp.length + self.length

    @property
    def height(self) -> float:
        """Extent along y, mm."""
        return max(height for _, height in self.stations)


def blank(fin: Fin, clamp: Clamp, label: tuple[str, ...] = ()) -> Blank:
    """Return the piece to cut for a fin.

    Raises:
        ValueError: Its root is not high enough for the holes.
    """
    inner = getattr(fin, "profile_position", ()), getattr(fin, "profile_height", ())
    stations = (
        (0.0, fin.height / MM),
        *((position * fin.length / MM, height / MM) for position, height in zip(*inner, strict=True)),
        (fin.length / MM, fin.tip_height / MM),
    )
    root = stations[0][1]
    tab: tuple[Point, ...] = ((-clamp.length, -0.5 * root),) if clamp.length else ()
    lower = (*tab, *((x, -0.5 * height) for x, height in stations))
    upper = tuple((x, -y) for x, y in reversed(lower))
    return Blank((*lower, *upper), stations, _holes(clamp, root), clamp, label)


def _holes(clamp: Clamp, root: float) -> tuple[Point, ...]:
    if not clamp.holes:
        return ()
    pitch = root / (clamp.holes + 1)
    least = (clamp.hole_diameter if clamp.holes > 1 else 0.5 * clamp.hole_diameter) + LEAST_WALL
    if pitch < least:
        msg = (
            f"a root of {root:g} mm has no room for {checks.counted(clamp.holes, 'hole')} of "
            f"{clamp.hole_diameter:g} mm: it must be {least * (clamp.holes + 1):g} mm or more, so that "
            f"{LEAST_WALL:g} mm of sheet stay around each; give fewer or smaller holes"
        )
        raise ValueError(msg)
    return tuple((-0.5 * clamp.length, pitch * (place + 1) - 0.5 * root) for place in range(clamp.holes))
