"""The papers' curves of speed over stiffness: one number is fitted at the stiff end, the rest is predicted."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from fin_plant.figures import new_figure, own_style
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT
from fin_sim.chain import build_chain
from fin_sim.paper_models import mean_thrust_held, simulation, speed_from_thrust
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, TAIL_COLOUR
from fin_sim.swim import PAPER_FISH, swim
from fin_sim.validation.page import PUBLISHED_TOLERANCE, Check, Published, Section

if TYPE_CHECKING:
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


def with_drag_area(drag_area: float) -> Fish:
    """Return the paper's fish with another S C_D in m^2."""
    return replace(PAPER_FISH, body=replace(PAPER_FISH.body, drag_area=drag_area))


def fit_model(points: SpeedCurve) -> tuple[float, SpeedCurve]:
    """Return S C_D in m^2 that gives the model's stiffest point, and the curve that follows."""
    stiff = mean_thrust_held(Fin(young_modulus=float(points.modulus[-1])))
    drag_area = 2.0 * stiff / (1000.0 * float(points.speed[-1]) ** 2)
    grid = np.append(_GRID[points.modulus[-1] > _GRID], points.modulus[-1])
    thrusts = [mean_thrust_held(Fin(young_modulus=float(modulus))) for modulus in grid]
    return drag_area, SpeedCurve(grid, np.array([speed_from_thrust(thrust, drag_area) for thrust in thrusts]))


def fit_simulation(points: SpeedCurve) -> tuple[float, SpeedCurve]:
    """Return S C_D in m^2 that gives the simulation's stiffest point, and the curve that follows."""
    stiff = Fin(young_modulus=float(points.modulus[-1]))

    def miss(drag_area: float) -> float:
        return simulation(stiff, with_drag_area(drag_area)).mean_speed - float(points.speed[-1])

    drag_area = float(brentq(miss, 1e-4, 0.1, xtol=1e-7))
    fish = with_drag_area(drag_area)
    grid = np.append(_GRID[points.modulus[-1] > _GRID], points.modulus[-1])
    speeds = [simulation(Fin(young_modulus=float(modulus)), fish).mean_speed for modulus in grid]
    return drag_area, SpeedCurve(grid, np.array(speeds))


def best_fin_frequency(modulus: float) -> float:
    """Return the first bending frequency in Hz, in water, of the paper fin of that stiffness without mass."""
    chain = build_chain(PAPER_FISH, Fin(young_modulus=modulus, density=0.0))
    return float(chain.bending_frequencies()[0])


def towed_equilibrium(fin: Fin, fish: Fish) -> float:
    """Return the speed in m/s at which the thrust of a body that is towed without recoil balances its drag."""
    half_density = 0.5 * fish.water.density

    def excess(speed: float) -> float:
        run = swim(fin, fish, reactive="tip", clamp="towed", tow_speed=speed)
        return run.mean_thrust - half_density * fish.body.drag_area * speed**2

    return float(brentq(excess, 1e-3, 0.2, xtol=1e-6))


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
def _draw(path: Path, points: dict[str, SpeedCurve], model: SpeedCurve, simulated: SpeedCurve) -> None:
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


def _maxima(curve: SpeedCurve) -> int:
    """Return how many maxima a curve has between its ends."""
    rises = np.diff(curve.speed) > 0.0
    return int(np.count_nonzero(rises[:-1] & ~rises[1:]))


@dataclass(frozen=True)
class Comparison:
    """The published points, and this project's two models fitted to them.

    Attributes:
        points: What is published, by curve.
        model: The mathematical model's curve.
        model_area: Its fitted S C_D, m^2.
        simulated: The simulation's curve.
        simulation_area: Its fitted S C_D, m^2.
    """

    points: dict[str, SpeedCurve]
    model: SpeedCurve
    model_area: float
    simulated: SpeedCurve
    simulation_area: float

    @property
    def pairs(self) -> tuple[tuple[str, SpeedCurve, SpeedCurve], ...]:
        """Name, own curve and published one."""
        own = (("model", self.model), ("simulation", self.simulated))
        return tuple((name, curve, self.points[name]) for name, curve in own)

    def over_drive(self, curve: SpeedCurve) -> float:
        """Return the bending frequency of a curve's fastest fin over the drive's."""
        return best_fin_frequency(curve.best[0]) / PAPER_GAIT.joints[0].frequency


def section(data: Path, figures: Path) -> Section:
    """Return the part on the papers' curves and draw its picture."""
    points = published(data / "paper_curves.csv")
    model_area, model = fit_model(points["model"])
    simulation_area, simulated = fit_simulation(points["simulation"])
    _draw(figures / FIGURE, points, model, simulated)
    found = Comparison(points, model, model_area, simulated, simulation_area)
    paragraphs = (_fit, _stations, _optimum, _soft_fins, _drag)
    text = "\n\n".join([*(tell(found) for tell in paragraphs), _sensitivity()])
    return Section(
        "The papers' curves", _checks(found), text, FIGURE, "Published points and this project's two models."
    )


def _checks(found: Comparison) -> list[Check]:
    checks: list[Check] = []
    for name, curve, theirs in found.pairs:
        miss = 100.0 * float(np.sqrt(np.mean((curve.at(theirs.modulus) - theirs.speed)[:-1] ** 2)))
        allowed = PUBLISHED_TOLERANCE * 100.0 * float(np.mean(theirs.speed[:-1]))
        here, there = found.over_drive(curve), found.over_drive(theirs)
        checks += [
            Published(f"{name}: E of the fastest fin, GPa", 1e-9 * curve.best[0], 1e-9 * theirs.best[0]),
            Published(f"{name}: its speed, cm/s", 100.0 * curve.best[1], 100.0 * theirs.best[1]),
            Published(f"{name}: fastest over stiff end", curve.ratio, theirs.ratio),
            Check(f"{name}: root mean square of the predicted points' errors, cm/s", miss, allowed, finding=True),
            Published(f"{name}: fastest fin's bending frequency over the drive's", here, there),
        ]
    here = found.model.best[1] / found.simulated.best[1]
    there = found.points["model"].best[1] / found.points["simulation"].best[1]
    return [*checks, Published("model's fastest over simulation's", here, there)]


def _fit(found: Comparison) -> str:
    """Return what was fitted, what is predicted, and how the table is to be read."""
    body, water, fin = PAPER_FISH.body, PAPER_FISH.water, Fin()
    model, simulated = (
        f"{1e-9 * theirs.modulus[-1]:.2f} GPa, {100.0 * theirs.speed[-1]:.2f} cm/s" for _, _, theirs in found.pairs
    )
    return f"""
Fitted, one number each, at the stiffest published point: S C_D = {found.model_area:.2e} m^2 for the model
({model}), {found.simulation_area:.2e} m^2 for the simulation
({simulated}). The project's own S C_D is {body.drag_area:.2e}
m^2, from the measured fish with the stiff VeroWhite fin. Everything else is predicted, in the papers' own form: force
at the tip, hinges `between`, three segments; the model holds the body and gives the fin no mass, the simulation is
free and its speed the mean over 10 s from rest. Assumed, not fitted: body {body.mass:.3f} kg with Lamb's added masses,
C_N {water.normal_drag:g}, damping time {fin.damping_time:g} s, and {1e3 * fin.thickness:.3f} mm of thickness.

Targets of the table below are the published points, read off the papers' figures to 0.03 cm/s and 0.03 GPa; a bending
frequency is this project's for the fin of that E, and the errors of the predicted points may reach
{PUBLISHED_TOLERANCE:.0%} of their mean. A *no* is a disagreement with the papers, told here and not tuned away."""


def _stations(found: Comparison) -> str:
    """Return the four stations from the model's speed to the simulation's, with the same fin and drag area."""
    fin, fish = Fin(young_modulus=found.model.best[0]), with_drag_area(found.model_area)
    stations = (
        found.model.best[1],
        towed_equilibrium(fin, fish),
        simulation(fin, fish, duration=40.0).steady_speed,
        simulation(fin, fish).mean_speed,
    )
    held, in_tow, steady, run = (100.0 * speed for speed in stations)
    return f"""\
**From the model to the simulation.** With the model's fastest fin and S C_D the held model gives {held:.2f} cm/s, the
free fish {run:.2f} over 10 s from rest. Of these {held - run:.2f} cm/s, {held - in_tow:.2f} are thrust that falls as
the fish gains speed (a body towed without recoil has as much thrust as drag at {in_tow:.2f} cm/s, where the model
takes the thrust at rest), {in_tow - steady:.2f} are recoil, which takes angle from the tail (the free fish's steady
speed is {steady:.2f} cm/s), and {steady - run:.2f} are the start from rest."""


def _optimum(found: Comparison) -> str:
    """Return where the fastest fins lie, and the thickness that would bring the model's to its published place."""
    resonances = [found.over_drive(curve) for _, own, theirs in found.pairs for curve in (own, theirs)]
    here, there = found.model.best[0], found.points["model"].best[0]
    thickness, stiffness = Fin().thickness, (there / here) ** (1.0 / 3.0)
    return f"""\
**Optimum.** Inside the range of E the model's curve here has {_maxima(found.model)} and the simulation's
{_maxima(found.simulated)} maximum; the first bending frequency of the fastest fin is {min(resonances):.2f} to
{max(resonances):.2f} of the drive's, here and published. The model's lies at {1e-9 * here:.2f} GPa, the published one
at {1e-9 * there:.2f}: since only K counts, the model's curve asks for a fin of {1e3 * thickness / stiffness:.3f} mm in
place of {1e3 * thickness:.3f} (or another frequency). The simulation's lies at {1e-9 * found.simulated.best[0]:.2f}
GPa; the papers state 0.9 (Raja Mohamed & Raviraj) and 1.9 GPa (Clark et al.)."""


def _soft_fins(found: Comparison) -> str:
    """Return how the curves compare at the soft end."""
    theirs, swum = found.points["model"], found.points["simulation"]
    softest = theirs.modulus[:1]
    published_kept, kept = (float(each.at(softest)[0]) / each.best[1] for each in (theirs, found.model))
    soft = swum.modulus < min(found.simulated.best[0], swum.best[0])
    faster = found.simulated.at(swum.modulus[soft]) / swum.speed[soft]
    return f"""\
**Soft fins.** At {1e-9 * softest[0]:.2f} GPa the published model keeps {published_kept:.0%} of its best speed, this one
{kept:.0%}: damping or a resistive force of another form would change that; neither paper states them. The
simulation's soft fins swim {faster.min():.1f} to {faster.max():.1f} times as fast as published."""


def _drag(found: Comparison) -> str:
    """Return how the two fitted drag areas compare, and what is published beside the measured fish."""
    modulus, speed = found.points["physical"].best
    model, simulated = (100.0 * float(theirs.at(np.array([modulus]))[0]) for _, _, theirs in found.pairs)
    return f"""\
**Drag.** The simulation's fit asks for {found.simulation_area / found.model_area:.1f} times the model's S C_D. The
measured fish swims at {100.0 * speed:.2f} cm/s with a fin of {1e-9 * modulus:.1f} GPa, at which the published model has
{model:.2f} and the published simulation {simulated:.2f} cm/s."""


def _sensitivity() -> str:
    """Return the table of the assumed numbers."""
    rows = [f"| `{name}` | {value:.4g} | {change:+.1%} |" for name, value, change in sensitivities()]
    return f"""\
**Sensitivity.** Change of the paper fin's mean speed over 10 s (E = 1.2 GPa, `distributed`) when a number is half as
large again:

| number | value, SI | change of mean speed |
|---|---|---|
{chr(10).join(rows)}
"""
