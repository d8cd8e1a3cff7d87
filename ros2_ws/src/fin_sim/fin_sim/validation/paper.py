"""The papers' curves of speed over stiffness: which readings of what they leave open give them, and how nearly."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq

from fin_plant.figures import new_figure, own_style
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_sim.chain import build_chain
from fin_sim.paper_models import mean_thrust_held, simulation, speed_from_thrust
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR
from fin_sim.presets import Preset, preset
from fin_sim.swim import PAPER_FISH
from fin_sim.validation.page import PUBLISHED_TOLERANCE, Check, Published, Section

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_sim.fish import Fish

FIGURE = "validation_paper_curves.png"
_GRID = np.geomspace(0.1e9, 6e9, 49)
# What the sensitivity is measured for: half as much again of each assumed number.
_MORE = 1.5


@dataclass(frozen=True)
class SpeedCurve:
    """Speed over stiffness.

    Attributes:
        modulus: E, Pa, shape (P,).
        speed: m/s, shape (P,).
    """

    modulus: NDArray[np.float64]
    speed: NDArray[np.float64]

    @property
    def best(self) -> tuple[float, float]:
        """E in Pa and speed in m/s of the fastest point."""
        index = int(np.argmax(self.speed))
        return float(self.modulus[index]), float(self.speed[index])

    @property
    def ratio(self) -> float:
        """Fastest speed over that at the curve's stiff end."""
        return self.best[1] / float(self.speed[-1])

    def at(self, modulus: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the speeds at ``modulus``, read between the points over log E."""
        return np.interp(np.log(modulus), np.log(self.modulus), self.speed)


def published(path: Path) -> dict[str, SpeedCurve]:
    """Return the points of ``paper_curves.csv`` that have a modulus, by curve.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["young_modulus_gpa"]]
    curves = {}
    for name in ("model", "simulation", "physical"):
        chosen = [row for row in rows if row["curve"] == name]
        modulus = np.array([1e9 * float(row["young_modulus_gpa"]) for row in chosen])
        curves[name] = SpeedCurve(modulus, np.array([0.01 * float(row["speed_cm_s"]) for row in chosen]))
    return curves


@dataclass(frozen=True)
class Reading:
    """One way to read what the papers leave open.

    Attributes:
        name: What it assumes beyond the reading before it.
        model: Fin and fish of the mathematical model.
        simulated: Fin and fish of the simulation.
        fits_drag: Whether both drag areas are fitted at the curves' stiff ends; otherwise they are the reading's own.
    """

    name: str
    model: Preset
    simulated: Preset
    fits_drag: bool = True


def readings() -> list[Reading]:
    """Return the readings, from this project's first to the papers' presets; each adds to the one before it."""
    first = preset("three_segments")
    model, simulated = preset("clark2012_model"), preset("clark2012_simulation")
    damper = model.fin.hinge_damping

    def with_fin(given: Preset, **changes: Any) -> Preset:
        return replace(given, fin=replace(given.fin, **changes))

    thicker = with_fin(first, thickness=model.fin.thickness)
    ideal = replace(first.fish, water=replace(first.fish.water, normal_drag=0.0))
    ideal_model, ideal_simulated = replace(thicker, fish=ideal), replace(first, fish=ideal)
    damped = {"damping_time": 0.0, "hinge_damping": damper}
    heavier = replace(
        simulated.fish.body,
        mass=model.fish.body.mass,
        inertia=model.fish.body.inertia,
        drag_area=model.fish.body.drag_area,
    )
    box = replace(with_fin(simulated, hinge_damping=damper), fish=replace(simulated.fish, body=heavier))
    return [
        Reading("0.208 mm, C_N 1, damping that grows with E, ellipsoid with added mass", first, first),
        Reading("and 0.30 mm in the model, whose l is a segment's length", thicker, first),
        Reading("and C_N 0", ideal_model, ideal_simulated),
        Reading(
            f"and a damper of {damper:.1e} N m s/rad whatever E",
            with_fin(ideal_model, **damped),
            with_fin(ideal_simulated, **damped),
        ),
        Reading("and a box without added mass and lift, one drag area for both", model, box, fits_drag=False),
        Reading("and the simulation's own damper, mass and drag area", model, simulated, fits_drag=False),
    ]


def _with_drag_area(given: Preset, drag_area: float) -> Preset:
    return replace(given, fish=replace(given.fish, body=replace(given.fish.body, drag_area=drag_area)))


def _model_thrust(given: Preset, modulus: float) -> float:
    return mean_thrust_held(replace(given.fin, young_modulus=modulus), given.fish)


def _simulated_speed(given: Preset, modulus: float) -> float:
    return simulation(replace(given.fin, young_modulus=modulus), given.fish).mean_speed


def _grid(points: SpeedCurve) -> NDArray[np.float64]:
    return np.append(_GRID[points.modulus[-1] > _GRID], points.modulus[-1])


def model_curve(given: Preset, points: SpeedCurve, *, fits_drag: bool) -> tuple[float, SpeedCurve]:
    """Return S C_D in m^2, that of the stiffest point where it is fitted, and the model's curve up to that point."""
    grid = _grid(points)
    thrusts = [_model_thrust(given, float(modulus)) for modulus in grid]
    drag_area, density = given.fish.body.drag_area, given.fish.water.density
    if fits_drag:
        drag_area = 2.0 * thrusts[-1] / (density * float(points.speed[-1]) ** 2)
    return drag_area, SpeedCurve(grid, np.array([speed_from_thrust(one, drag_area, density) for one in thrusts]))


def simulation_curve(given: Preset, points: SpeedCurve, *, fits_drag: bool) -> tuple[float, SpeedCurve]:
    """Return S C_D in m^2, that of the stiffest point where it is fitted, and the simulation's curve up to it."""
    stiffest = float(points.modulus[-1])
    drag_area = given.fish.body.drag_area
    if fits_drag:

        def miss(area: float) -> float:
            return _simulated_speed(_with_drag_area(given, area), stiffest) - float(points.speed[-1])

        drag_area = float(brentq(miss, 1e-4, 0.1, xtol=1e-7))
    fitted = _with_drag_area(given, drag_area)
    grid = _grid(points)
    return drag_area, SpeedCurve(grid, np.array([_simulated_speed(fitted, float(modulus)) for modulus in grid]))


def bending_frequency(given: Preset, modulus: float) -> float:
    """Return the first bending frequency in Hz, in water, of a preset's fin of that stiffness without mass."""
    chain = build_chain(given.fish, replace(given.fin, young_modulus=modulus, density=0.0))
    return float(chain.bending_frequencies()[0])


def sensitivities() -> list[tuple[str, float, float]]:
    """Return each assumed number, its value, and by how much of itself half as much again changes the mean speed."""
    fish, fin = PAPER_FISH, Fin()
    body, water = fish.body, fish.water

    def speed(fish: Fish, fin: Fin = fin) -> float:
        return simulation(fin, fish, reactive="distributed").mean_speed

    base, result = speed(fish), []
    for name in ("mass", "added_surge", "added_sway", "inertia", "added_inertia", "drag_area", "lift_area", "yaw_drag"):
        value = getattr(body, name)
        changed = replace(fish, body=replace(body, **{name: _MORE * value}))
        result.append((f"body.{name}", value, speed(changed) / base - 1.0))
    changed = replace(fish, water=replace(water, normal_drag=_MORE * water.normal_drag))
    result.append(("water.normal_drag", water.normal_drag, speed(changed) / base - 1.0))
    for name in ("damping_time", "density", "young_modulus"):
        value = getattr(fin, name)
        result.append((f"fin.{name}", value, speed(fish, replace(fin, **{name: _MORE * value})) / base - 1.0))
    value = fin.thickness
    result.append(("fin.thickness", value, speed(fish, replace(fin, thickness=_MORE * value)) / base - 1.0))
    return result


@own_style()
def _draw(path: Path, points: dict[str, SpeedCurve], found: Sequence[Comparison]) -> None:
    figure, axes = new_figure(9.0, 4.8)
    panel = axes[0, 0]
    last, before = found[-1], found[-2]
    for curve, colour, style, label in (
        (last.model, BODY_COLOUR, "-", "this project: clark2012_model"),
        (last.simulated, FIN_COLOUR, "-", "this project: clark2012_simulation"),
        (before.simulated, FIN_COLOUR, "--", "the same with the model's damper and drag area"),
    ):
        panel.plot(1e-9 * curve.modulus, 100.0 * curve.speed, style, color=colour, label=label)
    for name, colour, marker in (("model", BODY_COLOUR, "o"), ("simulation", FIN_COLOUR, "s")):
        curve = points[name]
        panel.plot(
            1e-9 * curve.modulus, 100.0 * curve.speed, marker, color=colour, label=f"Clark et al. 2012: {name}", ls=""
        )
    panel.set(xlabel="Young's modulus, GPa", ylabel="speed, cm/s", xscale="log", ylim=(0.0, 7.0))
    ticks = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.legend(frameon=False, fontsize="small", loc="upper left")
    figure.savefig(path, dpi=120)


@dataclass(frozen=True)
class Comparison:
    """The published points, and this project's two curves in one reading.

    Attributes:
        reading: The reading.
        points: What is published, by curve.
        model: The mathematical model's curve.
        model_area: Its S C_D, m^2.
        simulated: The simulation's curve.
        simulation_area: Its S C_D, m^2.
    """

    reading: Reading
    points: dict[str, SpeedCurve]
    model: SpeedCurve
    model_area: float
    simulated: SpeedCurve
    simulation_area: float

    @classmethod
    def of(cls, reading: Reading, points: dict[str, SpeedCurve]) -> Comparison:
        """Swim the fins of a reading."""
        fits = reading.fits_drag
        model_area, model = model_curve(reading.model, points["model"], fits_drag=fits)
        simulation_area, simulated = simulation_curve(reading.simulated, points["simulation"], fits_drag=fits)
        return cls(reading, points, model, model_area, simulated, simulation_area)

    @property
    def pairs(self) -> tuple[tuple[str, Preset, SpeedCurve, SpeedCurve], ...]:
        """Name, what swam, own curve and published one."""
        own = (("model", self.reading.model, self.model), ("simulation", self.reading.simulated, self.simulated))
        return tuple((name, swum, curve, self.points[name]) for name, swum, curve in own)

    def miss(self, name: str) -> float:
        """Return the root mean square difference from a curve's published points but the stiffest, m/s."""
        _, _, curve, theirs = next(pair for pair in self.pairs if pair[0] == name)
        return float(np.sqrt(np.mean((curve.at(theirs.modulus) - theirs.speed)[:-1] ** 2)))

    def row(self) -> str:
        """Return the row of the table of readings."""
        cells = [
            f"{area:.2e} | {1e-9 * curve.best[0]:.2f} | {100.0 * curve.best[1]:.2f} | {100.0 * self.miss(name):.3f}"
            for name, area, curve in (
                ("model", self.model_area, self.model),
                ("simulation", self.simulation_area, self.simulated),
            )
        ]
        return f"| {self.reading.name} | {' | '.join(cells)} | {self.model.best[1] / self.simulated.best[1]:.2f} |"


def section(data: Path, figures: Path) -> Section:
    """Return the part on the papers' curves and draw its picture."""
    points = published(data / "paper_curves.csv")
    found = [Comparison.of(reading, points) for reading in readings()]
    _draw(figures / FIGURE, points, found)
    text = "\n\n".join([_fit(found), _fish(found[-1]), _sensitivity()])
    caption = "Points of Clark et al. 2012, read off their figures, and the curves of the two presets."
    return Section("The papers' curves", _checks(found[-1]), text, FIGURE, caption)


def _checks(found: Comparison) -> list[Check]:
    checks: list[Check] = []
    drive = PAPER_GAIT.joints[0].frequency
    for name, swum, curve, theirs in found.pairs:
        allowed = PUBLISHED_TOLERANCE * 100.0 * float(np.mean(theirs.speed[:-1]))
        here, there = (bending_frequency(swum, each.best[0]) / drive for each in (curve, theirs))
        checks += [
            Published(f"{name}: E of the fastest fin, GPa", 1e-9 * curve.best[0], 1e-9 * theirs.best[0]),
            Published(f"{name}: its speed, cm/s", 100.0 * curve.best[1], 100.0 * theirs.best[1]),
            Published(f"{name}: fastest over stiff end", curve.ratio, theirs.ratio),
            Check(
                f"{name}: root mean square of the points' errors, cm/s", 100.0 * found.miss(name), allowed, finding=True
            ),
            Published(f"{name}: fastest fin's bending frequency over the drive's", here, there),
        ]
    here = found.model.best[1] / found.simulated.best[1]
    there = found.points["model"].best[1] / found.points["simulation"].best[1]
    return [*checks, Published("model's fastest over simulation's", here, there)]


def _fit(found: Sequence[Comparison]) -> str:
    """Return what was fitted, what each assumption buys, and how the table is to be read."""
    rows = "\n".join(each.row() for each in found)
    printed = [
        f"{1e-9 * found[-1].points[name].best[0]:.2f} | {100.0 * found[-1].points[name].best[1]:.2f}"
        for name in ("model", "simulation")
    ]
    theirs = found[-1].points["model"].best[1] / found[-1].points["simulation"].best[1]
    return f"""
Clark et al. 2012 print length and height of the fin, E, drive and the two forces, but neither mass, drag nor damping,
and a thickness of 1 mm, with which their equation 3 makes the simulated fin rigid. The two curves follow from one
reading of what is left open: 0.30 mm; l of equation 3 a segment's length in the model and the fin's in the simulation,
which gives both hinge stiffnesses that they print; a hinge damper that does not depend on E; C_N 0; force at the tip;
and for the simulation a box without added mass and lift, since an engine for rigid bodies has none. All this is
**inferred from fits to the same curves that it is compared with**; nothing of it is printed, and other readings fit
the model's curve as well (C_N 2.3 in place of the damper). The presets `clark2012_model` and `clark2012_simulation`
under `fin_sim/config` say of each number whether it is printed, fitted or assumed.

What each assumption buys, S C_D in m^2, E in GPa, U in cm/s, rms of the points' errors in cm/s; in the first four rows
S C_D is fitted at each curve's stiffest point, and the simulation has 0.208 mm with a segment's l, the same stiffness
as 0.30 mm with the fin's:

| reading | model: S C_D | E | U | rms | simulation: S C_D | E | U | rms | model over simulation |
|---|---|---|---|---|---|---|---|---|---|
{rows}
| *published* | | {printed[0]} | | | {printed[1]} | | {theirs:.2f} |

Targets of the table below, for the last reading, are the published points, read off the papers' figures to 0.03 cm/s
and 0.03 GPa; a bending frequency is this project's for the fin of that E, and the points' errors may reach
{PUBLISHED_TOLERANCE:.0%} of their mean."""


def _fish(found: Comparison) -> str:
    """Return what the papers' curves say of the measured fish."""
    modulus, speed = found.points["physical"].best
    model, simulated = (100.0 * float(theirs.at(np.array([modulus]))[0]) for _, _, _, theirs in found.pairs)
    return f"""\
**The measured fish.** With a fin of {1e-9 * modulus:.1f} GPa it swims at {100.0 * speed:.2f} cm/s; the published model
has {model:.2f} there and the published simulation {simulated:.2f} cm/s. The printed fins were 1 mm thick, 37 times as
stiff as those of 0.30 mm that were simulated: over E the three cannot agree, and the fish is no check of the curves."""


def _sensitivity() -> str:
    """Return the table of the assumed numbers."""
    rows = [f"| `{name}` | {value:.4g} | {change:+.1%} |" for name, value, change in sensitivities()]
    return f"""\
**Sensitivity.** Change of the default fin's mean speed over 10 s (`distributed`) when a number is half as
large again:

| number | value, SI | change of mean speed |
|---|---|---|
{chr(10).join(rows)}
"""
