"""The papers' curves of speed over stiffness: one number is fitted at the stiff end, the rest is predicted."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_sim.chain import build_chain
from fin_sim.paper_models import mean_thrust_held, simulation, speed_from_thrust
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, TAIL_COLOUR, new_figure
from fin_sim.swim import PAPER_FISH
from fin_sim.validation.page import Section

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_sim.fish import Fish

FIGURE = "validation_paper_curves.png"
_GRID = np.geomspace(0.1e9, 6e9, 49)
# What the sensitivity is measured for: half as much again of each assumed number.
_MORE = 1.5


@dataclass(frozen=True)
class Curve:
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


def published(path: Path) -> dict[str, Curve]:
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
        curves[name] = Curve(modulus, np.array([0.01 * float(row["speed_cm_s"]) for row in chosen]))
    return curves


def with_drag_area(drag_area: float) -> Fish:
    """Return the paper's fish with another S C_D in m^2."""
    return replace(PAPER_FISH, body=replace(PAPER_FISH.body, drag_area=drag_area))


def fit_model(points: Curve) -> tuple[float, Curve]:
    """Return S C_D in m^2 that gives the model's stiffest point, and the curve that follows."""
    stiff = mean_thrust_held(Fin(young_modulus=float(points.modulus[-1])))
    drag_area = 2.0 * stiff / (1000.0 * float(points.speed[-1]) ** 2)
    grid = np.append(_GRID[points.modulus[-1] > _GRID], points.modulus[-1])
    thrusts = [mean_thrust_held(Fin(young_modulus=float(modulus))) for modulus in grid]
    return drag_area, Curve(grid, np.array([speed_from_thrust(thrust, drag_area) for thrust in thrusts]))


def fit_simulation(points: Curve) -> tuple[float, Curve]:
    """Return S C_D in m^2 that gives the simulation's stiffest point, and the curve that follows."""
    stiff = Fin(young_modulus=float(points.modulus[-1]))

    def miss(drag_area: float) -> float:
        return simulation(stiff, with_drag_area(drag_area)).mean_speed - float(points.speed[-1])

    drag_area = float(brentq(miss, 1e-4, 0.1, xtol=1e-7))
    fish = with_drag_area(drag_area)
    grid = np.append(_GRID[points.modulus[-1] > _GRID], points.modulus[-1])
    speeds = [simulation(Fin(young_modulus=float(modulus)), fish).mean_speed for modulus in grid]
    return drag_area, Curve(grid, np.array(speeds))


def best_fin_frequency(modulus: float) -> float:
    """Return the first bending frequency in Hz, in water, of the paper fin of that stiffness without mass."""
    chain = build_chain(PAPER_FISH, Fin(young_modulus=modulus, density=0.0))
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


def _draw(path: Path, points: dict[str, Curve], model: Curve, simulated: Curve) -> None:
    figure, axes = new_figure(9.0, 4.8)
    panel = axes[0, 0]
    panel.plot(1e-9 * model.modulus, 100.0 * model.speed, color=BODY_COLOUR, label="this model, fitted at 4.75 GPa")
    panel.plot(
        1e-9 * simulated.modulus, 100.0 * simulated.speed, color=FIN_COLOUR, label="this simulation, fitted at 5 GPa"
    )
    for name, colour, marker in (
        ("model", BODY_COLOUR, "o"),
        ("simulation", FIN_COLOUR, "s"),
        ("physical", TAIL_COLOUR, "^"),
    ):
        curve = points[name]
        label = f"published: {name}" if name != "physical" else "published: fish with VeroWhite"
        panel.plot(1e-9 * curve.modulus, 100.0 * curve.speed, marker, color=colour, label=label, ls="")
    panel.set(xlabel="Young's modulus, GPa", ylabel="speed, cm/s", xscale="log", ylim=(0.0, None))
    ticks = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=120)


def section(data: Path, figures: Path) -> Section:
    """Return the part on the papers' curves and draw its picture."""
    points = published(data / "paper_curves.csv")
    model_area, model = fit_model(points["model"])
    simulation_area, simulated = fit_simulation(points["simulation"])
    _draw(figures / FIGURE, points, model, simulated)
    default_area = PAPER_FISH.body.drag_area
    rows = []
    for name, curve in (("model", model), ("simulation", simulated)):
        theirs = points[name]
        drive = PAPER_GAIT.joints[0].frequency
        resonance = [best_fin_frequency(each.best[0]) / drive for each in (theirs, curve)]
        miss = 100.0 * np.sqrt(np.mean((curve.at(theirs.modulus) - theirs.speed)[:-1] ** 2))
        rows += [
            f"| {name}: E of the fastest fin, GPa | {1e-9 * theirs.best[0]:.2f} | {1e-9 * curve.best[0]:.2f} |",
            f"| {name}: its speed, cm/s | {100.0 * theirs.best[1]:.2f} | {100.0 * curve.best[1]:.2f} |",
            f"| {name}: fastest over stiff end | {theirs.ratio:.2f} | {curve.ratio:.2f} |",
            f"| {name}: root mean square of the predicted points' errors, cm/s | | {miss:.2f} |",
            f"| {name}: fastest fin's bending frequency over the drive's | {resonance[0]:.2f} | {resonance[1]:.2f} |",
        ]
    ratio_theirs = points["model"].best[1] / points["simulation"].best[1]
    same = simulation(Fin(young_modulus=model.best[0]), with_drag_area(model_area), duration=40.0)
    run = simulation(Fin(young_modulus=model.best[0]), with_drag_area(model_area)).mean_speed
    rows.append(f"| model's fastest over simulation's | {ratio_theirs:.1f} | {model.best[1] / simulated.best[1]:.1f} |")
    stiffness = (points["model"].best[0] / model.best[0]) ** (1.0 / 3.0)
    sensitive = [f"| `{name}` | {value:.4g} | {change:+.1%} |" for name, value, change in sensitivities()]
    text = f"""
Fitted, one number each, at the stiffest published point: S C_D = {model_area:.2e} m^2 for the model (4.75 GPa, 3.56
cm/s), {simulation_area:.2e} m^2 for the simulation (5 GPa, 1.07 cm/s). The project's own S C_D is {default_area:.2e}
m^2, from the measured fish with the stiff VeroWhite fin. Everything else is predicted, in the papers' own form: force
at the tip, hinges `between`, three segments; the model holds the body and gives the fin no mass, the simulation is
free and its speed the mean over 10 s from rest. Assumed, not fitted: body 0.198 kg with Lamb's added masses, C_N 1,
damping time 0.01 s, and 0.208 mm of thickness.

| | published | here |
|---|---|---|
{chr(10).join(rows)}

**What agrees.** There is one optimum and it is inside the range of E; the first bending frequency of the fastest fin
lies within a third of the drive's in both models, here and published; stiffer fins fall towards the plate's thrust; the
model is faster than the simulation: {100.0 * model.best[1]:.2f} cm/s against {100.0 * run:.2f} over 10 s with the
same fin and
S C_D. A free fish's acceleration explains the smaller part of that (its steady speed is {100.0 * same.steady_speed:.2f}
cm/s), its recoil, which takes angle from the tail, the larger.

**What does not.** The model's optimum lies at {1e-9 * model.best[0]:.2f} GPa, the published one at
{1e-9 * points["model"].best[0]:.2f}: since only K counts, the model's curve asks for a
fin of {1e3 * Fin().thickness / stiffness:.3f} mm in place of {1e3 * Fin().thickness:.3f} (or another frequency); the
thickness
that the papers print (1 mm) fits neither. Below the optimum the published model loses speed far more slowly than
this one: 3.21 cm/s at 0.23
GPa against {100.0 * float(model.at(np.array([0.23e9]))[0]):.2f} here. Damping or resistive force of another form on
soft
fins would do that; neither paper states them. The simulation's optimum falls between the papers' two statements (0.9
and
1.9 GPa), but is more pronounced than the published 1.29, and the soft fins swim up to twice as fast as published. The
two fits ask for different S C_D, {simulation_area / model_area:.1f} to 1: no one drag area makes both published curves,
so their model and simulation cannot have shared this one. The measured fish swims at 3.05 cm/s with a fin of 2.5
GPa, between the published model and
simulation.

**Sensitivity.** Change of the paper fin's mean speed over 10 s (E = 1.2 GPa, `distributed`) when a number is half as
large again:

| number | value, SI | change of mean speed |
|---|---|---|
{chr(10).join(sensitive)}
"""
    return Section("The papers' curves", [], text, FIGURE, "Published points and this project's two models.")
