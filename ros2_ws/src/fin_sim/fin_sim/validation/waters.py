"""Speed in each kind of water, over stiffness and over length: the figures and tables of docs/water.md.

`python -m fin_sim.validation.waters docs/figures` draws them and prints the tables.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.figures import new_figure, own_style
from fin_sim.batch import swim_batch
from fin_sim.presets import preset
from fin_sim.water_settings import PRESETS, Settings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.water_settings import TipTerm

    Array = NDArray[np.float64]

FISH = "three_segments"
WATERS = {
    "strip": PRESETS["strip"],
    "surface_3d, wake, drag": Settings("surface_3d", "lighthill", "on"),
    "strip, no wake, drag": Settings("strip", "none", "on"),
    "paper_simulation": PRESETS["paper_simulation"],
    "soleil": PRESETS["soleil"],
    "bht": PRESETS["bht"],
}
SHAPED = tuple(name for name in WATERS if WATERS[name].drag == "on")
"""Waters of the ridges."""
LANDSCAPES = ("strip", "soleil", "paper_simulation")
MODULUS, LENGTH = (1e8, 2e10), (0.04, 0.14)
_SCALED = "surface_3d, wake, drag, scaled tip term"


def speeds(water: Settings, modulus: Array, length: Array | None = None, tip_term: TipTerm = "strip") -> Array:
    """Return the mean speed over 10 s from rest in m/s of fins of one area; NaN where there is none.

    Args:
        water: The settings.
        modulus: E, Pa, shape (n,).
        length: m, shape (n,); the preset's where none is given.
        tip_term: See `Water`.
    """
    given = preset(FISH)
    fish = replace(
        given.fish,
        water=replace(given.fish.water, **water._asdict(), tip_term=tip_term),
    )
    fins = {**vars(given.fin), "young_modulus": modulus}
    if length is not None:
        height = given.fin.area / length
        fins |= {"length": length, "height": height, "tip_height": height}
    return swim_batch(fins, fish, reactive=given.reactive).mean_speed


def ridge(water: Settings, lengths: Array, points: int, tip_term: TipTerm = "strip") -> tuple[Array, Array]:
    """Return for each length the best E in Pa and its speed in m/s."""
    modulus, length = np.meshgrid(np.geomspace(*MODULUS, points), lengths)
    table = speeds(water, modulus.ravel(), length.ravel(), tip_term).reshape(modulus.shape)
    best = np.nanargmax(np.where(np.isnan(table), -1.0, table), axis=1)
    rows = np.arange(len(lengths))
    return modulus[rows, best], table[rows, best]


@own_style()
def draw_speeds(path: Path, points: int) -> list[str]:
    """Draw speed over E for each water; return the rows of the table of peaks.

    Raises:
        OSError: The file cannot be written.
    """
    figure, panels = new_figure(7.0, 4.5, 1, 1)
    panel = panels[0, 0]
    rows = ["| water | fastest, cm/s | at E, GPa |", "|---|---|---|"]
    for name, water in WATERS.items():
        modulus = np.geomspace(*MODULUS, points)
        speed = speeds(water, modulus)
        panel.plot(1e-9 * modulus, 100.0 * speed, label=name)  # with a gap where the fin folds too far
        best = int(np.nanargmax(speed))
        rows.append(f"| {name} | {100.0 * speed[best]:.3g} | {1e-9 * modulus[best]:.2g} |")
    panel.set(xscale="log", yscale="log", ylim=(1e-3, 30.0), xlabel="E, GPa", ylabel="mean speed over 10 s, cm/s")
    panel.legend(frameon=False, fontsize="small", loc="upper center", ncols=3)
    figure.savefig(path, dpi=120)
    return rows


@own_style()
def draw_ridges(path: Path, lengths: int, points: int) -> list[str]:
    """Draw the best E and its speed over the length for each water; return the rows of the table of best shapes.

    Raises:
        OSError: The file cannot be written.
    """
    figure, panels = new_figure(10.0, 4.5, 1, 2)
    left, right = panels[0]
    at = np.linspace(*LENGTH, lengths)
    cases: list[tuple[str, Settings, TipTerm]] = [(name, WATERS[name], "strip") for name in SHAPED]
    cases.insert(2, (_SCALED, WATERS["surface_3d, wake, drag"], "scaled"))
    rows = ["| water | best length, cm | E, GPa | speed, cm/s |", "|---|---|---|---|"]
    for name, water, tip_term in cases:
        modulus, speed = ridge(water, at, points, tip_term)
        left.plot(100.0 * at, 1e-9 * modulus, marker="o", ms=3, label=name)
        right.plot(100.0 * at, 100.0 * speed, marker="o", ms=3, label=name)
        best = int(np.argmax(speed))
        rows.append(f"| {name} | {100.0 * at[best]:.3g} | {1e-9 * modulus[best]:.2g} | {100.0 * speed[best]:.3g} |")
    left.set(yscale="log", xlabel="length, cm", ylabel="best E, GPa")
    right.set(ylim=(0.0, None), xlabel="length, cm", ylabel="speed at the best E, cm/s")
    right.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=120)
    return rows


@own_style()
def draw_landscapes(path: Path, lengths: int, points: int) -> list[str]:
    """Draw speed over E and length in three waters, each with its ridge; return the rows of the table of best shapes.

    Raises:
        OSError: The file cannot be written.
    """
    figure, panels = new_figure(11.0, 3.8, 1, len(LANDSCAPES))
    at, modulus = np.linspace(*LENGTH, lengths), np.geomspace(*MODULUS, points)
    rows = ["| landscape | best length, cm | E, GPa | speed, cm/s |", "|---|---|---|---|"]
    for name, panel in zip(LANDSCAPES, panels[0], strict=True):
        mesh, length = np.meshgrid(modulus, at)
        speed = 100.0 * speeds(WATERS[name], mesh.ravel(), length.ravel()).reshape(mesh.shape)
        drawn = panel.pcolormesh(1e-9 * modulus, 100.0 * at, speed, shading="nearest")
        ridge_at = np.nanargmax(np.where(np.isnan(speed), -1.0, speed), axis=1)
        panel.plot(1e-9 * modulus[ridge_at], 100.0 * at, color="white", marker="o", ms=2.5, lw=1.0)
        figure.colorbar(drawn, ax=panel, label="mean speed over 10 s, cm/s")
        panel.set(xscale="log", xlabel="E, GPa", ylabel="length, cm", title=name)
        row, column = np.unravel_index(int(np.nanargmax(speed)), speed.shape)
        told = f"{100.0 * at[row]:.3g} | {1e-9 * modulus[column]:.2g} | {speed[row, column]:.3g}"
        rows.append(f"| {name} | {told} |")
    figure.savefig(path, dpi=120)
    return rows


def main(folder: Path) -> None:
    """Draw the figures into a folder and print their tables."""
    tables = (
        draw_speeds(folder / "water_speed.png", 41),
        draw_ridges(folder / "water_ridges.png", 21, 41),
        draw_landscapes(folder / "water_landscapes.png", 21, 41),
    )
    for rows in tables:
        sys.stdout.write("\n".join(rows) + "\n\n")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
