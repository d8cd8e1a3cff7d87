"""``swim --water ideal_2d --chain FILE``: a swimmer of one's own in a plane ideal flow."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_sim.ideal_2d.added_mass import AddedMass
from fin_sim.ideal_2d.elastic import move
from fin_sim.ideal_2d.stroke import swim_stroke

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_sim.ideal_2d.stroke import JointAngle
    from fin_sim.ideal_2d.swimmer_file import Swimmer

_SAMPLES_A_STROKE = 64
_FINER = 1.5
_UNITS = {
    "dx": "m",
    "dy": "m",
    "dtheta": "rad",
    "distance": "m",
    "speed": "m/s",
    "period": "s",
    "time_error": "m",
    "mean_kinetic_energy": "J/m",
    "strokes": "",
}
"""Of what is told of a swimmer, by name."""


@dataclass(frozen=True)
class SwumStrokes:
    """What a swimmer did.

    Attributes:
        swimmer: The swimmer.
        time: s, shape (S,).
        angles: Of the joints, rad, shape (S, J).
        place: Of the first link, x + i y in its axes at time 0, m, shape (S,).
        heading: rad, shape (S,).
        figures: Net motion of a stroke in the first link's axes at its start, and more, by name; see `units`.
    """

    swimmer: Swimmer
    time: NDArray[np.float64]
    angles: NDArray[np.float64]
    place: NDArray[np.complex128]
    heading: NDArray[np.float64]
    figures: dict[str, Any]

    @property
    def units(self) -> dict[str, str]:
        """Units of the figures, by name; empty for a number without."""
        return {name: _UNITS[name] for name in self.figures}

    def table(self) -> str:
        """Return the samples as CSV."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        names = [f"angle_{name} [rad]" for name in self.swimmer.names[1:]]
        writer.writerow(["t [s]", "x [m]", "y [m]", "heading [rad]", *names])
        writer.writerows(
            [time, place.real, place.imag, heading, *angles]
            for time, place, heading, angles in zip(
                self.time.tolist(), self.place.tolist(), self.heading.tolist(), self.angles.tolist(), strict=True
            )
        )
        return text.getvalue()

    def draw(self, path: Path, title: str) -> None:
        """Draw the picture; see `plot_swimmer`."""
        from fin_sim.ideal_2d.swimmer_picture import plot_swimmer  # noqa: PLC0415

        plot_swimmer(self.swimmer.linkage, self.time, self.angles, self.place, self.heading, path, title)

    def animate(self, path: Path) -> None:
        """Draw the animation; see `animate_swimmer`."""
        from fin_sim.ideal_2d.swimmer_picture import animate_swimmer  # noqa: PLC0415

        animate_swimmer(self.swimmer.linkage, self.time, self.angles, self.place, self.heading, path)


def swim_swimmer(swimmer: Swimmer) -> SwumStrokes:
    """Return what a swimmer does: one stroke where every joint is driven, else all from rest, of which the last counts.

    Raises:
        StrokeError: Links collide, or it does not converge.
        MassError: The mass matrix is not positive.
    """
    water = AddedMass(swimmer.linkage)
    if swimmer.is_driven:
        angles: list[JointAngle] = list(swimmer.joints)  # type: ignore[arg-type]
        stroke = swim_stroke(swimmer.linkage, water.matrix, angles, swimmer.period)
        figures = _net(stroke.place, stroke.heading, swimmer.period)
        figures |= {"time_error": stroke.error, "mean_kinetic_energy": float(np.mean(stroke.energy[:-1])), "strokes": 1}
        return SwumStrokes(swimmer, stroke.time, stroke.angles, stroke.place, stroke.heading, figures)
    samples = swimmer.strokes * _SAMPLES_A_STROKE
    times = np.linspace(0.0, swimmer.strokes * swimmer.period, samples + 1)
    motion = move(swimmer.linkage, water, swimmer.moving_joints(), times, tolerance=1e-7)
    last = slice(samples - _SAMPLES_A_STROKE, None)
    figures = _net(motion.place[last], motion.heading[last], swimmer.period)
    figures |= {"mean_kinetic_energy": float(np.mean(motion.energy[last])), "strokes": swimmer.strokes}
    return SwumStrokes(swimmer, times, motion.angles, motion.place, motion.heading, figures)


def _net(place: NDArray[np.complex128], heading: NDArray[np.float64], period: float) -> dict[str, Any]:
    moved = complex((place[-1] - place[0]) * np.exp(-1j * heading[0]))
    distance = math.hypot(moved.real, moved.imag)
    return {
        "dx": moved.real,
        "dy": moved.imag,
        "dtheta": float(heading[-1] - heading[0]),
        "distance": distance,
        "speed": distance / period,
        "period": period,
    }
